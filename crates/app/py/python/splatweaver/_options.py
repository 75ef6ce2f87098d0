"""Further flags of the commands, by name and type. The page of flags says what each does."""

from __future__ import annotations

import os
from typing import Sequence, Tuple, TypedDict, Union

Path = Union[str, "os.PathLike[str]"]
#: One or several.
Paths = Union[Path, Sequence[Path]]
Color = Union[str, Tuple[float, float, float]]


class _Shared(TypedDict, total=False):
    #: Threads; `set_threads` is the default.
    threads: int


class _Matching(_Shared, total=False):
    #: Focal length of all photos over their longer side.
    focal: float
    no_exif: bool
    own_focal: bool
    #: "off", "k1" or "k1k2".
    distortion: str
    match_size: int
    #: "usual" or "fisheye".
    lens: str
    #: "equirectangular" or "pinhole".
    projection: str
    #: Degrees around straight down in panoramas that are left out.
    nadir: float
    #: A second look with a learned matcher.
    weak_pairs: bool


class _Placing(_Matching, total=False):
    #: Table with the positions of cameras.
    positions: Path
    #: Table with the ends of a bar of known length.
    scale_bar: Path
    no_gps: bool
    #: "level" or "keep".
    up: str


class CamerasOptions(_Placing, total=False):
    #: Folder of masks, or True for masks beside the photos.
    masks: Union[bool, Path]
    invert_masks: bool
    #: "skip": complete results stay as they are, what was begun goes on.
    if_complete: str
    frames: int
    compare: Path


class ReconstructOptions(_Placing, total=False):
    #: Folder of masks, or True for masks beside the photos.
    masks: Union[bool, Path]
    invert_masks: bool
    #: "unknown" or "empty".
    masked: str
    #: Photos that come with the program, in place of an empty list of photos.
    demo: bool
    #: "skip": complete results stay as they are, what was begun goes on.
    if_complete: str
    frames: int
    #: "listed", "none" or every so many.
    hold_out: Union[str, int]
    #: Level of scene.wsz that the end of the fit is trained for.
    compress: float
    keep_all: bool
    surfaces: bool
    no_html: bool
    live: bool
    #: Port of the page that follows; needs live.
    port: int


class FitOptions(_Matching, total=False):
    #: "skip": complete results stay as they are, what was begun goes on.
    if_complete: str
    least_steps: int
    init: Path
    resume: Path
    dry_run: bool
    save_every: float
    device: str
    long_side: int
    hold_out: Union[str, int]
    max_photos: int
    masks: bool
    invert_masks: bool
    #: "unknown" or "empty".
    masked: str
    undistort: bool
    background: Color
    exposure: bool
    cameras: str
    refine_cameras: bool
    refine_focal: bool
    sh: int
    antialiased: bool
    strategy: str
    also: Sequence[str]
    #: Level of scene.wsz that the end of the fit is trained for.
    compress: float
    keep_all: bool
    surfaces: bool
    no_html: bool
    live: bool
    #: Port of the page that follows; needs live.
    port: int
    lpips: Path
    config: Path
    #: Settings as "key=value".
    set: Sequence[str]


class InferOptions(_Matching, total=False):
    #: "skip": complete results stay as they are, what was begun goes on.
    if_complete: str
    frames: int
    size: Union[int, str]
    keep_aspect: bool
    geometry: bool
    bf16_products: bool
    cameras: Path
    masks: bool
    budget: float
    allocation: str
    refine: float
    refine_steps: int
    refine_size: int
    refine_in_place: bool
    light: Path
    to: Path
    light_steps: int
    device: str
    no_html: bool


class LiftOptions(_Shared, total=False):
    mask_dir: Path
    demo: Sequence[int]
    demo_gaussians: str
    run: Path
    passes: int
    conjugate: bool
    mu: float
    tikhonov: float
    least_alpha: float
    unit: bool
    block: int
    width: int
    height: int
    aggregate: Path
    smallest: int
    overlap: float
    dry_run: bool


class CompressOptions(_Shared, total=False):
    background: Color
    antialiased: bool
    near: float
    alpha_max: float
