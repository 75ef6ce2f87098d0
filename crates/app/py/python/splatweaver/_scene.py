"""Scenes of Gaussians."""

from __future__ import annotations

import html
from typing import Any, Iterable, List, NamedTuple, Optional, Sequence, Union, overload

import numpy as np
import numpy.typing as npt

from . import _splatweaver
from ._cameras import Camera, Path, _data, _plain
from ._errors import InputError

Array = npt.NDArray[np.float32]


class Format(NamedTuple):
    """A format of scenes: its name, the end of the names of its files, and what it keeps of a scene."""

    name: str
    suffix: str
    keeps: str


def formats() -> List[Format]:
    """The formats that `Scene.load` and `Scene.save` know; the end of a file's name selects one.

    Returns:
        For each, `.name`, `.suffix`, the end of the names of its files, and `.keeps`, what it keeps of a scene.

    >>> from splatweaver import formats
    >>> [format.suffix for format in formats()][:2]
    ['.ply', '.compressed.ply']
    """
    return [Format(*row) for row in _splatweaver.formats()]


class Scene:
    """Gaussians, and how they are to be drawn. A scene does not change; what edits it returns another.

    Args:
        means: Centers, world units, `[N, 3]`.
        log_scales: Natural logarithms of the standard deviations, `[N, 3]`.
        quats: Rotations wxyz, `[N, 4]`.
        opacity_logits: Opacities before the sigmoid, `[N]`.
        sh: Spherical harmonics, `[N, K, 3]` with K of 1, 4, 9, 16 or 25.
        antialiased: Opacities are lowered where a Gaussian is widened to a pixel.

    Raises:
        InputError: Shapes that do not fit.

    >>> import numpy as np
    >>> from splatweaver import Camera, Scene
    >>> scene = Scene.from_activated(means=[[0, 0, 0]], scales=[[0.1, 0.1, 0.1]], quats=[[1, 0, 0, 0]], opacities=[0.9],
    ...                              sh=np.zeros((1, 1, 3)))
    >>> scene.render(Camera.look_at((0, 0, -1), (0, 0, 0), 32, 24), background=(0, 0, 0)).shape
    (24, 32, 3)
    >>> moved = scene.transform(scale=2.0, translation=(1, 0, 0))
    >>> moved.means.tolist(), moved.scales.shape
    ([[1.0, 0.0, 0.0]], (1, 3))
    >>> both = scene.merge(moved).to(degree=2)
    >>> len(both), both.sh.shape, len(both.crop(center=(0, 0, 0), radius=0.5))
    (2, (2, 9, 3), 1)
    >>> both.save("both.spz")
    >>> Scene.load("both.spz")
    Scene(2 Gaussians, degree 2)
    """

    def __init__(
        self, means: Any, log_scales: Any, quats: Any, opacity_logits: Any, sh: Any, antialiased: bool = False
    ) -> None:
        self._data = _splatweaver.SceneData(
            _float32(means), _float32(log_scales), _float32(quats), _float32(opacity_logits), _float32(sh), antialiased
        )

    @classmethod
    def _of(cls, data: _splatweaver.SceneData) -> Scene:
        scene = cls.__new__(cls)
        scene._data = data
        return scene

    @classmethod
    def from_activated(
        cls, means: Any, scales: Any, quats: Any, opacities: Any, sh: Any, antialiased: bool = False
    ) -> Scene:
        """A scene of what `rasterization` takes, arrays or tensors.

        Args:
            means: Centers, world units, `[N, 3]`.
            scales: Standard deviations, world units, `[N, 3]`; those below 1e-12 become 1e-12.
            quats: Rotations wxyz, `[N, 4]`.
            opacities: Opacities, `[N]`; they are brought to 1e-6 at least and 1 - 1e-6 at most.
            sh: Spherical harmonics, `[N, K, 3]` with K of 1, 4, 9, 16 or 25.
            antialiased: Opacities are lowered where a Gaussian is widened to a pixel.

        Raises:
            InputError: Shapes that do not fit.
        """
        floor = np.maximum(_float64(scales), 1e-12)
        inside = np.clip(_float64(opacities), 1e-6, 1 - 1e-6)
        return cls(means, np.log(floor), quats, np.log(inside / (1 - inside)), sh, antialiased)

    @classmethod
    def load(cls, path: Path) -> Scene:
        """Read a file of any of `formats()`. A summary.json beside it says how the scene is drawn.

        Args:
            path: The file.

        Raises:
            FileError: A file that is missing or malformed, with the place in it.
        """
        return cls._of(_splatweaver.SceneData.load(path))

    def save(self, path: Path) -> None:
        """Write a file of any of `formats()`; several of them round.

        Args:
            path: The file; the end of its name selects the format.

        Raises:
            FileError: A file that cannot be written, or an unknown ending.
        """
        self._data.save(path)

    @property
    def means(self) -> Array:
        """Centers, world units, `[N, 3]`; a copy, as all arrays of a scene."""
        return self._data.means

    @property
    def log_scales(self) -> Array:
        """Natural logarithms of the standard deviations, `[N, 3]`."""
        return self._data.log_scales

    @property
    def scales(self) -> Array:
        """Standard deviations, world units, `[N, 3]`."""
        return self._data.activated()[0]

    @property
    def quats(self) -> Array:
        """Rotations wxyz as they are stored, `[N, 4]`."""
        return self._data.quats

    @property
    def opacity_logits(self) -> Array:
        """Opacities before the sigmoid, `[N]`."""
        return self._data.opacity_logits

    @property
    def opacities(self) -> Array:
        """Opacities from 0 to 1, `[N]`."""
        return self._data.activated()[1]

    @property
    def sh(self) -> Array:
        """Spherical harmonics, `[N, K, 3]`."""
        return self._data.sh

    @property
    def degree(self) -> int:
        """Degree of the harmonics, 0 to 4."""
        return self._data.degree

    @property
    def antialiased(self) -> bool:
        """True if opacities are lowered where a Gaussian is widened to a pixel."""
        return self._data.drawing[2]

    def to(self, degree: int) -> Scene:
        """The scene with harmonics up to a degree: those beyond are left out, those that are missing are zero.

        Args:
            degree: 0 to 4.

        Raises:
            InputError: Another degree.
        """
        return Scene._of(self._data.with_degree(degree))

    def transform(
        self,
        scale: float = 1.0,
        rotation: Optional[Any] = None,
        translation: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> Scene:
        """The scene in the world that `x -> scale * rotation @ x + translation` leads to; harmonics are turned, too.

        Args:
            scale: Factor of all lengths.
            rotation: Orthogonal matrix of determinant 1, `[3, 3]`; None turns nothing.
            translation: World units, `[3]`.

        Raises:
            InputError: A matrix that is no rotation, or a scale that is not positive.
        """
        matrix = np.eye(3) if rotation is None else _float64(rotation)
        if matrix.shape != (3, 3):
            raise InputError(f"rotation: expected [3, 3], found {list(matrix.shape)}")
        return Scene._of(self._data.transformed(scale, matrix.tolist(), [float(x) for x in translation]))

    @overload
    def crop(self, *, min: Sequence[float], max: Sequence[float]) -> Scene: ...
    @overload
    def crop(self, *, center: Sequence[float], radius: float) -> Scene: ...
    def crop(
        self,
        *,
        min: Optional[Sequence[float]] = None,
        max: Optional[Sequence[float]] = None,
        center: Optional[Sequence[float]] = None,
        radius: Optional[float] = None,
    ) -> Scene:
        """The Gaussians with their centers in a box or a sphere.

        Args:
            min: Least coordinates of a box, world units, `[3]`.
            max: Largest coordinates of the box, world units, `[3]`.
            center: Center of a sphere, world units, `[3]`.
            radius: Radius of the sphere, world units.

        Raises:
            InputError: Neither a box nor a sphere.
        """
        if min is not None and max is not None and center is None and radius is None:
            return Scene._of(self._data.in_box(list(min), list(max)))
        if center is not None and radius is not None and min is None and max is None:
            return Scene._of(self._data.in_sphere(list(center), radius))
        raise InputError("crop: expected min and max, or center and radius")

    def merge(self, *others: Scene) -> Scene:
        """The Gaussians of this scene and then of others, with harmonics up to the largest degree among them.

        Args:
            *others: The other scenes, in the same world.
        """
        return Scene._of(self._data.merged([other._data for other in others]))

    @overload
    def render(
        self,
        cameras: Camera,
        background: Optional[Sequence[float]] = ...,
        near: Optional[float] = ...,
        alpha_max: Optional[float] = ...,
        antialiased: Optional[bool] = ...,
    ) -> Array: ...
    @overload
    def render(
        self,
        cameras: Iterable[Camera],
        background: Optional[Sequence[float]] = ...,
        near: Optional[float] = ...,
        alpha_max: Optional[float] = ...,
        antialiased: Optional[bool] = ...,
    ) -> List[Array]: ...
    def render(
        self,
        cameras: Union[Camera, Iterable[Camera]],
        background: Optional[Sequence[float]] = None,
        near: Optional[float] = None,
        alpha_max: Optional[float] = None,
        antialiased: Optional[bool] = None,
    ) -> Union[Array, List[Array]]:
        """Draw from a camera, or a list of pictures from several; no gradients.

        Args:
            cameras: Cameras without distortion (`Camera.undistorted`).
            background: Color behind the scene, from 0 to 1 [default: the scene's, or white].
            near: Gaussians nearer than this are not drawn, world units [default: the scene's, or 0.01].
            alpha_max: Largest alpha of one Gaussian at a pixel [default: the scene's, or 0.99].
            antialiased: Whether opacities are lowered where a Gaussian is widened [default: the scene's].

        Returns:
            Pictures `[H, W, 3]`, sRGB values, not clamped.

        Raises:
            InputError: A camera with distortion, or numbers that mean nothing.
        """
        single = isinstance(cameras, Camera)
        views: Iterable[Camera] = [cameras] if isinstance(cameras, Camera) else list(cameras)
        for camera in views:
            if camera.distorted:
                raise InputError(f"camera {camera.name}: expected no distortion; .undistorted() has none")
        own = self._data.drawing
        drawing = (
            own[0] if near is None else near,
            own[1] if alpha_max is None else alpha_max,
            own[2] if antialiased is None else antialiased,
        )
        color = self._data.background if background is None else [float(part) for part in background]
        if len(color) != 3:
            raise InputError(f"background: expected three numbers, found {len(color)}")
        pictures = self._data.render(_data(views), color, drawing)
        return pictures[0] if single else pictures

    def html(self, cameras: Iterable[Camera] = (), title: str = "scene", lossless: bool = False) -> str:
        """One HTML page that shows the scene and needs nothing else.

        Args:
            cameras: Cameras to look from.
            title: Title of the page.
            lossless: The scene is in it as it is, not rounded as SPZ does.

        Returns:
            The text of the page.
        """
        return self._data.html(title, _data(cameras), lossless)

    def show(self, cameras: Iterable[Camera] = (), height: int = 600) -> View:
        """The scene in a notebook, to turn and to fly through.

        Args:
            cameras: Cameras to look from.
            height: Height of the frame, pixels.

        Returns:
            A `View`, which a notebook shows; its `.save(path)` writes the same as a page.
        """
        return View(self.html(cameras), height)

    def __len__(self) -> int:
        return len(self._data)

    def __repr__(self) -> str:
        return f"Scene({len(self)} Gaussians, degree {self.degree})"


class View:
    """A page that a notebook shows in a frame."""

    def __init__(self, page: str, height: int) -> None:
        #: The page.
        self.page = page
        self.height = height

    def save(self, path: Path) -> None:
        """Write the page.

        Args:
            path: The file; its name ends with .html.

        Raises:
            FileError: A file that cannot be written, or another ending.
        """
        _splatweaver.write_page(path, self.page)

    def _repr_html_(self) -> str:
        document = html.escape(self.page, quote=True)
        style = f"width: 100%; height: {int(self.height)}px; border: 0"
        return f'<iframe srcdoc="{document}" style="{style}" allowfullscreen></iframe>'

    def __repr__(self) -> str:
        return f"View({len(self.page) / 1e6:.1f} MB)"


def _float32(array: Any) -> Array:
    return np.ascontiguousarray(_plain(array), dtype=np.float32)


def _float64(array: Any) -> npt.NDArray[np.float64]:
    return np.asarray(_plain(array), dtype=np.float64)
