"""Drawing Gaussians, with the signature of gsplat."""

from __future__ import annotations

import math
import sys
import warnings
from dataclasses import dataclass, field
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, TypeVar

import numpy as np

from . import _splatweaver
from ._errors import InputError

A = TypeVar("A")

#: Modes of the picture: what its channels are.
MODES = ("RGB", "D", "ED", "RGB+D", "RGB+ED")
#: Arguments that have no meaning here, with the values that ask for nothing.
IGNORED: Mapping[str, Any] = {
    "packed": False,
    "tile_size": 16,
    "channel_chunk": 32,
    "distributed": False,
    "segmented": False,
}
#: Arguments of gsplat that are not there, with the values that ask for nothing.
MISSING: Mapping[str, Any] = {
    "sparse_grad": False,
    "camera_model": "pinhole",
    "covars": None,
    "with_ut": False,
    "with_eval3d": False,
    "radial_coeffs": None,
    "tangential_coeffs": None,
    "thin_prism_coeffs": None,
    "ftheta_coeffs": None,
    "rolling_shutter": None,
    "viewmats_rs": None,
}
_warned: set[str] = set()
#: Numbers of pictures from which on memory is looked at.
LARGE = 1 << 26


class Meta(Mapping[str, Any]):
    """By-products of a drawing by their names, numpy arrays or tensors as the pictures are; what is on the image is found when it is
    first asked for.

    | key | |
    |---|---|
    | `radii` | three standard deviations along x and y, pixels rounded up, int32 `[C, N, 2]`; 0 for Gaussians that are not seen |
    | `means2d` | projected means, pixels, `[C, N, 2]`. Of tensors, a leaf: after `backward()`, `.grad` has the gradient with respect to them and, with `absgrad=True`, `.absgrad` the sums of its absolute values over the pixels |
    | `depths` | camera z, world units, `[C, N]` |
    | `width`, `height`, `n_cameras`, `n_batches` | as given; scenes at once, 1 without dimensions in front |
    | `batch_ids`, `camera_ids`, `gaussian_ids` | None: nothing is packed |
    """

    def __init__(self, request: Request, cameras: int, batches: int) -> None:
        self._request = request
        width, height = request.settings["width"], request.settings["height"]
        self._plain: Dict[str, Optional[int]] = {"width": width, "height": height, "n_cameras": cameras, "n_batches": batches}
        self._plain.update(dict.fromkeys(("batch_ids", "camera_ids", "gaussian_ids")))

    def __getitem__(self, key: str) -> Any:
        if key in self._plain:
            return self._plain[key]
        request = self._request
        splats = dict(zip(("means2d", "radii", "depths"), request.splats))
        if key in splats:
            for at, drawing in request.drawings:
                request.backend.fill(request.splats, at, drawing.splats())
            request.drawings.clear()
        if key == "means2d":
            request.watched = True
            request.backend.settle(request, list(request.pending))
        return splats[key]

    def __iter__(self) -> Iterator[str]:
        return iter(("radii", "means2d", "depths", *self._plain))

    def __len__(self) -> int:
        return 3 + len(self._plain)


@dataclass
class Request:
    """One drawing, as checked arguments."""

    #: Rules of drawing, as the compiled part takes them.
    settings: Dict[str, Any]
    #: Colors are features of any number of channels, blended beside the image.
    as_features: bool
    mode: str
    absgrad: bool
    #: The module that draws.
    backend: Any
    #: Projected means, radii and depths of all cameras.
    splats: Tuple[Any, Any, Any]
    #: Drawings that have not told theirs yet, and the cameras that they are of.
    drawings: List[Tuple[slice, _splatweaver.Drawing]] = field(default_factory=list)
    #: Gradients of projected means are wanted. They are sums over all that was blended, so that they are found only then.
    watched: bool = False
    #: The drawings, by their first camera, whose last backward pass `means2d.grad` does not have yet.
    pending: Dict[int, Tuple[slice, _splatweaver.Drawing]] = field(default_factory=dict)


def rasterization(
    means: A,
    quats: A,
    scales: A,
    opacities: A,
    colors: A,
    viewmats: A,
    Ks: A,
    width: int,
    height: int,
    near_plane: float = 0.01,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    eps2d: float = 0.3,
    sh_degree: Optional[int] = None,
    packed: bool = False,
    tile_size: int = 16,
    backgrounds: Optional[A] = None,
    render_mode: str = "RGB",
    sparse_grad: bool = False,
    absgrad: bool = False,
    rasterize_mode: str = "classic",
    channel_chunk: int = 32,
    distributed: bool = False,
    camera_model: str = "pinhole",
    *,
    alpha_max: float = 0.999,
    **others: Any,
) -> Tuple[A, A, Meta]:
    """Draw Gaussians from cameras; every input gets a gradient.

    Takes numpy arrays, or torch tensors on the CPU, of float32 or float64, and returns the same kind. Names, shapes, units and order of
    the arguments are those of gsplat; all arrays may have further dimensions in front, for several scenes at once. Arguments of gsplat
    that mean nothing on a CPU are ignored with one warning; others that are not there raise NotImplementedError with their name.

    Args:
        means: Centers, world units, `[N, 3]`.
        quats: Rotations wxyz of any length but zero, `[N, 4]`.
        scales: Standard deviations, world units, `[N, 3]`.
        opacities: Opacities from 0 to 1, `[N]`.
        colors: Colors of any number of channels `[N, D]` or `[C, N, D]`; with `sh_degree`, harmonics `[N, K, 3]` or `[C, N, K, 3]`.
        viewmats: World to camera, OpenCV axes, `[C, 4, 4]`.
        Ks: Intrinsics, pixels, `[C, 3, 3]`; fx, fy, cx and cy are read.
        width: Width of the pictures, pixels.
        height: Height of the pictures, pixels.
        near_plane: Gaussians nearer than this are not drawn, world units.
        far_plane: Gaussians farther than this are not drawn, world units.
        radius_clip: Gaussians of a smaller radius are not drawn, pixels.
        eps2d: Variance that is added on the image, pixels squared.
        sh_degree: Degree of the harmonics that is used, 0 to 4; None if colors are colors.
        packed: Ignored.
        tile_size: Ignored.
        backgrounds: Colors behind everything, `[C, D]`; None is black.
        render_mode: "RGB", "D" (depth, summed), "ED" (expected depth), "RGB+D" or "RGB+ED".
        sparse_grad: Not there.
        absgrad: `meta["means2d"].absgrad` is computed with the gradients.
        rasterize_mode: "classic", or "antialiased": opacities are lowered where a Gaussian is widened by eps2d.
        channel_chunk: Ignored.
        distributed: Ignored.
        camera_model: "pinhole".
        alpha_max: Largest alpha of one Gaussian at a pixel: 0.999 is gsplat's, the command line draws with 0.99.
        **others: Further arguments of gsplat: `segmented` is ignored, `covars`, `with_ut`, lens coefficients and such are not there.

    Returns:
        The pictures `[C, H, W, X]`, their alphas `[C, H, W, 1]`, and `Meta`.

    Raises:
        InputError: Shapes or number types that do not fit, with what was expected and what was found.
        NotImplementedError: An argument that is not there.

    >>> import numpy as np
    >>> from splatweaver import rasterization
    >>> K = np.array([[[10, 0, 1.5], [0, 10, 1.5], [0, 0, 1]]])
    >>> picture, alpha, meta = rasterization(
    ...     means=np.array([[0, 0, 2.0]]), quats=np.array([[1.0, 0, 0, 0]]), scales=np.full((1, 3), 0.5),
    ...     opacities=np.array([0.8]), colors=np.array([[1, 0.5, 0]]), viewmats=np.eye(4)[None], Ks=K, width=3, height=3)
    >>> picture.shape, picture[0, 1, 1].round(3).tolist()
    ((1, 3, 3, 3), [0.8, 0.4, 0.0])
    """
    given = {
        "packed": packed,
        "tile_size": tile_size,
        "channel_chunk": channel_chunk,
        "distributed": distributed,
        "sparse_grad": sparse_grad,
        "camera_model": camera_model,
        **others,
    }
    _check_others(given)
    if render_mode not in MODES:
        raise InputError(f"render_mode: expected one of {', '.join(MODES)}, found {render_mode!r}")
    if rasterize_mode not in ("classic", "antialiased"):
        raise InputError(f"rasterize_mode: expected classic or antialiased, found {rasterize_mode!r}")
    arrays: Dict[str, Any] = {
        "means": means,
        "quats": quats,
        "scales": scales,
        "opacities": opacities,
        "colors": colors,
        "viewmats": viewmats,
        "Ks": Ks,
        **({} if backgrounds is None else {"backgrounds": backgrounds}),
    }
    backend = _backend(arrays)
    arrays = backend.taken(arrays)
    channels = _check_shapes(arrays, sh_degree)
    settings: Dict[str, Any] = {
        "width": _pixels("width", width),
        "height": _pixels("height", height),
        "near": float(near_plane),
        "far": float(far_plane),
        "eps2d": float(eps2d),
        "alpha_max": float(alpha_max),
        "antialiased": rasterize_mode == "antialiased",
        "radius_clip": float(radius_clip) if radius_clip > 0 else None,
        "degree": sh_degree if "RGB" in render_mode else None,
    }
    features = "RGB" in render_mode and channels != 3
    request = Request(settings, features, render_mode, absgrad, backend, backend.unseen(arrays), watched=absgrad)
    cameras, batch = arrays["viewmats"].shape[-3], tuple(arrays["means"].shape[:-2])
    if batch:
        flat = {name: array.reshape(-1, *array.shape[len(batch) :]) for name, array in arrays.items()}
        scenes = range(flat["means"].shape[0])
        drawn = [
            _of_cameras({name: array[b] for name, array in flat.items()}, request, sh_degree, b * cameras)
            for b in scenes
        ]
        flat_pictures = [backend.joined(part) for part in zip(*drawn)]
        picture, alpha = (part.reshape(*batch, cameras, *part.shape[1:]) for part in flat_pictures)
    else:
        picture, alpha = _of_cameras(arrays, request, sh_degree, 0)
    return picture, alpha, Meta(request, cameras, math.prod(batch))


def _of_cameras(arrays: Dict[str, Any], request: Request, sh_degree: Optional[int], first: int) -> Tuple[Any, Any]:
    """Draws all cameras at once, or one after the other where each has colors of its own; `first` is the number of the first one."""
    cameras = arrays["viewmats"].shape[0]
    colors = arrays["colors"]
    # A slice of all of them would be one more operation of autograd.
    if sh_degree is not None and colors.shape[-2] > (sh_degree + 1) ** 2:
        colors = colors[..., : (sh_degree + 1) ** 2, :]
    if len(colors.shape) == (2 if sh_degree is None else 3):
        return _drawn({**arrays, "colors": colors}, request, slice(first, first + cameras))
    own = ("viewmats", "Ks", "backgrounds")
    parts = []
    for c in range(cameras):
        one = {name: array[c : c + 1] if name in own else array for name, array in arrays.items()}
        parts.append(_drawn({**one, "colors": colors[c]}, request, slice(first + c, first + c + 1)))
    pictures, alphas = zip(*parts)
    return request.backend.joined(pictures), request.backend.joined(alphas)


def _drawn(arrays: Dict[str, Any], request: Request, at: slice) -> Tuple[Any, Any]:
    """The pictures of the cameras `at` in their mode, and their alphas."""
    backend = request.backend
    means, colors = arrays["means"], arrays["colors"]
    n, cameras = means.shape[0], arrays["viewmats"].shape[0]
    none = backend.zeros((n, 0), means)
    black = backend.zeros((cameras, 3), means)
    background = arrays.get("backgrounds")
    plain = "RGB" in request.mode and not request.as_features
    image, alpha, depth, features = backend.draw(
        (
            means,
            arrays["quats"],
            arrays["scales"],
            arrays["opacities"],
            colors if plain else none,
            colors if request.as_features else none,
            arrays["viewmats"],
            arrays["Ks"],
            background if plain and background is not None else black,
        ),
        request,
        at,
    )
    planes: List[Any] = []
    if request.as_features:
        behind = 0 if background is None else (1 - alpha) * background[:, None, None, :]
        planes.append(features + behind)
    elif plain:
        planes.append(image)
    if request.mode.endswith("ED"):
        planes.append(depth / backend.at_least(alpha, 1e-10))
    elif request.mode.endswith("D"):
        planes.append(depth)
    return (planes[0] if len(planes) == 1 else backend.side_by_side(planes)), alpha


def _check_others(given: Mapping[str, Any]) -> None:
    for name, value in given.items():
        if name in MISSING:
            if value is not None and value != MISSING[name]:
                raise NotImplementedError(f"rasterization: {name} is not there: expected {MISSING[name]!r}, found {value!r}")
        elif name not in IGNORED:
            raise TypeError(f"rasterization() got an unexpected keyword argument {name!r}")
    ignored = [name for name, value in IGNORED.items() if given.get(name, value) != value and name not in _warned]
    if ignored:
        _warned.update(ignored)
        warnings.warn(f"rasterization: no meaning on a CPU, ignored: {', '.join(ignored)}", stacklevel=3)


def _backend(arrays: Mapping[str, Any]) -> Any:
    """The module that draws: the one for tensors if any array is one."""
    torch = sys.modules.get("torch")
    if torch is not None and any(isinstance(array, torch.Tensor) for array in arrays.values()):
        from . import _torch

        return _torch
    return sys.modules[__name__]


def _pixels(name: str, value: Any) -> int:
    try:
        pixels = int(value)
    except (TypeError, ValueError):
        raise InputError(f"{name}: expected a number of pixels, found {value!r}") from None
    if pixels != value or not 1 <= pixels <= 1 << 20:
        raise InputError(f"{name}: expected 1 to {1 << 20} pixels, found {value!r}")
    return pixels


def _check_shapes(arrays: Mapping[str, Any], sh_degree: Optional[int]) -> int:
    """The number of channels of colors, if all shapes fit together."""
    shapes = {name: tuple(array.shape) for name, array in arrays.items()}
    if len(shapes["means"]) < 2:
        raise InputError(f"means: expected [N, 3], found {list(shapes['means'])}")
    *batch, n, _ = shapes["means"]
    c = shapes["viewmats"][-3] if len(shapes["viewmats"]) > 2 else 0
    if c == 0 or (batch and 0 in batch):
        raise InputError(f"viewmats: expected [C, 4, 4] with at least one camera, found {list(shapes['viewmats'])}")
    if sh_degree is None:
        tail: Tuple[int, ...] = shapes["colors"][-1:]
        form, fits = "D", len(tail) == 1 and tail[0] > 0
    else:
        if not isinstance(sh_degree, int) or not 0 <= sh_degree <= 4:
            raise InputError(f"sh_degree: expected 0 to 4, found {sh_degree!r}")
        least = (sh_degree + 1) ** 2
        tail = (*shapes["colors"][-2:-1], 3)
        form, fits = f"K of at least {least}, 3", len(tail) == 2 and tail[0] >= least
    front = "".join(f"{size}, " for size in batch)
    if not fits or shapes["colors"] not in ((*batch, n, *tail), (*batch, c, n, *tail)):
        expected = f"[{front}{n}, {form}] or [{front}{c}, {n}, {form}]"
        raise InputError(f"colors: expected {expected}, found {list(shapes['colors'])}")
    channels = tail[-1]
    for name, shape in {
        "means": (n, 3),
        "quats": (n, 4),
        "scales": (n, 3),
        "opacities": (n,),
        "viewmats": (c, 4, 4),
        "Ks": (c, 3, 3),
        "backgrounds": (c, channels),
    }.items():
        if name in shapes and shapes[name] != (*batch, *shape):
            raise InputError(f"{name}: expected {[*batch, *shape]}, found {list(shapes[name])}")
    return int(channels)


# The side of numpy; `_torch` has the same functions for tensors.


def taken(arrays: Mapping[str, Any]) -> Dict[str, Any]:
    """Arrays of one number type, that of the means; integers are converted."""
    found = {name: np.asarray(array) for name, array in arrays.items()}
    wanted = found["means"].dtype
    if wanted not in (np.float32, np.float64):
        raise InputError(f"means: expected float32 or float64, found {wanted}")
    for name, array in found.items():
        if array.dtype != wanted and array.dtype.kind not in "iub":
            raise InputError(f"{name}: expected {wanted}, the number type of means, found {array.dtype}")
    return {name: np.ascontiguousarray(array, dtype=wanted).reshape(array.shape) for name, array in found.items()}


def zeros(shape: Tuple[int, ...], like: Any) -> Any:
    return np.zeros(shape, like.dtype)


def joined(parts: Sequence[Any]) -> Any:
    return np.concatenate(parts)


def unseen(arrays: Mapping[str, Any]) -> Tuple[Any, Any, Any]:
    """Projected means, radii and depths before anything is drawn."""
    return no_splats(arrays, arrays["means"].dtype)


def no_splats(arrays: Mapping[str, Any], kind: Any) -> Tuple[Any, Any, Any]:
    """Zeros with the shapes of projected means, radii and depths."""
    shape = (*arrays["viewmats"].shape[:-2], arrays["means"].shape[-2])
    return np.zeros((*shape, 2), kind), np.zeros((*shape, 2), np.int32), np.zeros(shape, kind)


def side_by_side(planes: Sequence[Any]) -> Any:
    return np.concatenate(planes, axis=-1)


def at_least(array: Any, least: float) -> Any:
    return np.maximum(array, array.dtype.type(least))


def empty(shape: Tuple[int, ...], like: Any) -> Any:
    return np.empty(shape, like.dtype)


def fill(splats: Tuple[Any, Any, Any], at: slice, drawn: Tuple[Any, ...]) -> None:
    for kept, numbers, rank in zip(splats, drawn, (2, 2, 1)):
        place = rows(kept, rank)[at]
        place[...] = numbers.reshape(place.shape)


def settle(request: Request, firsts: Sequence[int]) -> None:
    """Arrays have no gradients."""


def rows(kept: Any, rank: int) -> Any:
    """By-products of cameras, `rank` dimensions each, those of several scenes one after the other."""
    front = len(kept.shape) - rank
    return kept.reshape(math.prod(kept.shape[:front]), *kept.shape[front:])


def draw(arrays: Tuple[Any, ...], request: Request, at: slice) -> Tuple[Any, ...]:
    contiguous = tuple(np.ascontiguousarray(array) for array in arrays)
    planes = planes_of(contiguous, request)
    request.drawings.append((at, _splatweaver.rasterize(contiguous, planes, request.settings)))
    return planes


def planes_of(arrays: Tuple[Any, ...], request: Request) -> Tuple[Any, ...]:
    """Memory for image, alpha, depth and features, None for what is not drawn."""
    cameras, height, width = arrays[6].shape[0], request.settings["height"], request.settings["width"]
    colors, features = arrays[4], arrays[5].shape[-1]
    channels = (3 if colors.shape[-1] else 0, 1, int("D" in request.mode), features)
    numbers = cameras * height * width * sum(channels)
    if numbers > LARGE:
        _splatweaver.check_memory(8 * numbers)
    shapes = [(cameras, height, width, count) if count else None for count in channels]
    return tuple(None if shape is None else request.backend.empty(shape, arrays[0]) for shape in shapes)
