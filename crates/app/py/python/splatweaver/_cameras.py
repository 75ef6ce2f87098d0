"""Cameras, alone and as files."""

from __future__ import annotations

from os import PathLike
from typing import Any, Iterable, Iterator, List, Optional, Sequence, Union, overload

import numpy as np
import numpy.typing as npt

from . import _splatweaver
from ._errors import InputError

Path = Union[str, "PathLike[str]"]
Array = npt.NDArray[np.float64]


class Camera:
    """A pinhole camera: pose, intrinsics and the size of its picture.

    Args:
        viewmat: World to camera, OpenCV axes (x right, y down, z forward), `[4, 4]`.
        K: Intrinsics in pixels, centers of pixels at +0.5, `[3, 3]`.
        width: Width of the picture, pixels.
        height: Height of the picture, pixels.
        name: Name of the photo.

    Raises:
        InputError: A matrix that is not rigid, or numbers that mean nothing.

    >>> from splatweaver import Camera
    >>> camera = Camera.look_at(eye=(0, 0, -2), target=(0, 0, 0), width=64, height=48)
    >>> camera.viewmat[:3, 3].tolist()
    [0.0, 0.0, 2.0]
    """

    def __init__(self, viewmat: Any, K: Any, width: int, height: int, name: str = "") -> None:
        matrices = [np.ascontiguousarray(_plain(matrix), dtype=np.float64) for matrix in (viewmat, K)]
        for label, matrix, side in zip(("viewmat", "K"), matrices, (4, 3)):
            if matrix.shape != (side, side):
                raise InputError(f"{label}: expected [{side}, {side}], found {list(matrix.shape)}")
        self._data = _splatweaver.Camera(matrices[0], matrices[1], (width, height), name)

    @classmethod
    def _of(cls, data: _splatweaver.Camera) -> Camera:
        camera = cls.__new__(cls)
        camera._data = data
        return camera

    @classmethod
    def look_at(
        cls,
        eye: Sequence[float],
        target: Sequence[float],
        width: int,
        height: int,
        fov: float = 60.0,
        up: Sequence[float] = (0.0, -1.0, 0.0),
        name: str = "",
    ) -> Camera:
        """A camera at a point that looks at another.

        Args:
            eye: The center of the camera, world units.
            target: The point in the middle of the picture, world units.
            width: Width of the picture, pixels.
            height: Height of the picture, pixels.
            fov: Horizontal field of view, degrees.
            up: The direction that is up in the picture; y points down in worlds of photos.
            name: Name of the photo.

        Raises:
            InputError: A target at `eye`, or straight up or down from it.
        """
        place, toward = np.asarray(eye, dtype=np.float64), np.asarray(target, dtype=np.float64)
        forward = toward - place
        right = np.cross(-np.asarray(up, dtype=np.float64), forward)
        if not np.linalg.norm(right) > 0:
            raise InputError("look_at: expected a target that is neither at eye nor straight up or down from it")
        rows = [right / np.linalg.norm(right), forward / np.linalg.norm(forward)]
        rotation = np.stack([rows[0], np.cross(rows[1], rows[0]), rows[1]])
        viewmat = np.eye(4)
        viewmat[:3, :3], viewmat[:3, 3] = rotation, -rotation @ place
        focal = width / 2 / np.tan(np.radians(fov) / 2)
        return cls(viewmat, [[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]], width, height, name)

    @property
    def viewmat(self) -> Array:
        """World to camera, `[4, 4]`."""
        return self._data.viewmat

    @property
    def K(self) -> Array:
        """Intrinsics in pixels, `[3, 3]`."""
        return self._data.intrinsics

    @property
    def width(self) -> int:
        """Width of the picture, pixels."""
        return self._data.size[0]

    @property
    def height(self) -> int:
        """Height of the picture, pixels."""
        return self._data.size[1]

    @property
    def name(self) -> str:
        """Name of the photo, as the file has it."""
        return self._data.name

    @property
    def path(self) -> PathLike[str]:
        """Path of the photo, where its file tells it."""
        return self._data.path

    @property
    def distorted(self) -> bool:
        """True if the lens is distorted, which pictures of scenes are not."""
        return self._data.distorted

    def undistorted(self) -> Camera:
        """The camera of the photo whose distortion is undone."""
        return Camera._of(self._data.undistorted())

    def resized(self, width: int, height: int) -> Camera:
        """The same camera with a picture of another size.

        Args:
            width: Width of the picture, pixels.
            height: Height of the picture, pixels.
        """
        return Camera._of(self._data.resized(width, height))

    def __repr__(self) -> str:
        return f"Camera({self.name!r}, {self.width} x {self.height})"


class Cameras(Sequence[Camera]):
    """Cameras in an order: a sequence, whose slices are `Cameras` too.

    Args:
        cameras: The cameras.

    >>> from splatweaver import Camera, Cameras
    >>> cameras = Cameras([Camera.look_at((0, 0, -2), (0, 0, 0), 64, 48)])
    >>> len(cameras), cameras.viewmats.shape, cameras.Ks.shape
    (1, (1, 4, 4), (1, 3, 3))
    >>> cameras.save("cameras.json")
    >>> Cameras.load("cameras.json")[0].resized(32, 24)
    Camera('', 32 x 24)
    """

    def __init__(self, cameras: Iterable[Camera] = ()) -> None:
        self._cameras = list(cameras)

    @classmethod
    def load(cls, path: Path) -> Cameras:
        """Read cameras.

        Args:
            path: A transforms.json, a folder with a COLMAP model, or a RealEstate10K file.

        Raises:
            FileError: A file that is missing or malformed.
        """
        return cls(Camera._of(data) for data in _splatweaver.read_cameras(path))

    def save(self, path: Path) -> None:
        """Write a transforms.json.

        Args:
            path: The file; its name ends with .json.

        Raises:
            FileError: A file that cannot be written, or another ending.
        """
        _splatweaver.write_cameras(path, [camera._data for camera in self._cameras])

    @property
    def viewmats(self) -> Array:
        """World to camera, `[C, 4, 4]`."""
        return np.array([camera.viewmat for camera in self._cameras]).reshape(-1, 4, 4)

    @property
    def Ks(self) -> Array:
        """Intrinsics in pixels, `[C, 3, 3]`."""
        return np.array([camera.K for camera in self._cameras]).reshape(-1, 3, 3)

    @overload
    def __getitem__(self, index: int) -> Camera: ...
    @overload
    def __getitem__(self, index: slice) -> Cameras: ...
    def __getitem__(self, index: Union[int, slice]) -> Union[Camera, Cameras]:
        if isinstance(index, slice):
            return Cameras(self._cameras[index])
        return self._cameras[index]

    def __len__(self) -> int:
        return len(self._cameras)

    def __iter__(self) -> Iterator[Camera]:
        return iter(self._cameras)

    def __repr__(self) -> str:
        return f"Cameras({len(self)})"


def _plain(array: Any) -> Any:
    """Numbers without gradients, of arrays and tensors alike."""
    return array.detach() if hasattr(array, "detach") else array


def _data(cameras: Optional[Iterable[Camera]]) -> List[_splatweaver.Camera]:
    return [camera._data for camera in cameras or ()]
