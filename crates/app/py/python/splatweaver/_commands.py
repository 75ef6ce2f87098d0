"""The commands of the command line as functions: the same work, defaults and bits."""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
from pathlib import Path as Folder
from typing import TYPE_CHECKING, Any, Dict, List, Mapping, Optional

from . import _splatweaver
from ._options import Path, Paths, words
from ._runs import Callback, Progress, Run

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._options import CamerasOptions, CompressOptions, FitOptions, InferOptions, LiftOptions, ReconstructOptions

logger = logging.getLogger("splatweaver")


def cameras(
    photos: Paths, out: Optional[Path] = None, *, callback: Optional[Callback] = None, **options: Unpack[CamerasOptions]
) -> Run:
    """Estimate the cameras of photos by matching them, as `splatweaver cameras`.

    Args:
        photos: Photos, folders of photos, or clips.
        out: Folder for the results; None is a temporary one, which lives as long as the result.
        callback: Called with a `Progress` for each step; an answer of False stops.
        **options: The other flags of the command, with underscores: `focal=1.2`, `distortion="k1"`.

    Returns:
        The folder: `.cameras`, `.summary`.

    Raises:
        InputError: Options that mean nothing.
        FileError: Photos that cannot be read, or a folder that cannot be written.
    """
    return _into_folder("cameras", _listed(photos), out, options, callback)


def reconstruct(
    photos: Paths,
    out: Optional[Path] = None,
    quality: str = "normal",
    *,
    minutes: Optional[float] = None,
    gaussians: Optional[int] = None,
    seed: int = 0,
    callback: Optional[Callback] = None,
    **options: Unpack[ReconstructOptions],
) -> Run:
    """Make a scene from photos or a video and nothing else, as `splatweaver reconstruct`.

    Args:
        photos: Photos, folders of photos, clips, or one capture.
        out: Folder for the results; None is a temporary one, which lives as long as the result.
        quality: "draft" (half a minute), "normal" (five) or "fine" (twenty).
        minutes: Time for all of it [default: the quality's].
        gaussians: The most Gaussians there may be [default: by the size of the photos].
        seed: Seed of everything that is drawn at random.
        callback: Called with a `Progress` for each step; an answer of False stops, and results are written.
        **options: The other flags of the command, with underscores.

    Returns:
        The folder: `.scene`, `.cameras`, `.summary`.

    Raises:
        InputError: Options that mean nothing.
        FileError: Photos that cannot be read, or a folder that cannot be written.
        MemoryPlanError: More memory than there is.
    """
    given = {"quality": quality, "minutes": minutes, "gaussians": gaussians, "seed": seed, **options}
    return _into_folder("reconstruct", _listed(photos), out, given, callback)


def fit(
    capture: Optional[Path] = None,
    out: Optional[Path] = None,
    *,
    minutes: Optional[float] = None,
    steps: Optional[int] = None,
    gaussians: Optional[int] = None,
    seed: Optional[int] = None,
    callback: Optional[Callback] = None,
    **options: Unpack[FitOptions],
) -> Run:
    """Fit Gaussians to the photos of a capture, as `splatweaver fit`.

    Args:
        capture: Folder (COLMAP, transforms.json, NeRF-synthetic, RealEstate10K) or a transforms.json; None with `resume`.
        out: Folder for the results; None is a temporary one, which lives as long as the result.
        minutes: Time for all of it [default: 2].
        steps: Steps, instead of a time: repeated, they give the same bits.
        gaussians: The most Gaussians there may be [default: by the size of the photos].
        seed: Seed of everything that is drawn at random [default: 0].
        callback: Called with a `Progress` for each step; an answer of False stops, and results are written.
        **options: The other flags of the command, with underscores: `refine_cameras=True`, `sh=2`, `resume=folder`.

    Returns:
        The folder: `.scene`, `.cameras`, `.summary`.

    Raises:
        InputError: Options that mean nothing.
        FileError: A capture that cannot be read, or a folder that cannot be written.
        MemoryPlanError: More memory than there is.
        NumericError: A loss that is not finite.
    """
    given: Dict[str, Any] = {"minutes": minutes, "steps": steps, "gaussians": gaussians, "seed": seed, **options}
    positional = [] if capture is None else [capture]
    if options.get("resume") is not None:
        return Run(os.fspath(options["resume"]), _run("fit", positional, given, callback))
    if options.get("dry_run"):
        return Run(out or "", _run("fit", positional, given, callback, json=False))
    return _into_folder("fit", positional, out, given, callback)


def infer(
    photos: Paths,
    out: Optional[Path] = None,
    *,
    run: Optional[Path] = None,
    weights: Optional[Path] = None,
    seed: Optional[int] = None,
    callback: Optional[Callback] = None,
    **options: Unpack[InferOptions],
) -> Run:
    """Turn a few photos into a scene by a network, as `splatweaver infer`.

    Args:
        photos: Photos, folders of photos, or clips; the camera of the first is the origin.
        out: Folder for the results; None is a temporary one, which lives as long as the result.
        run: Folder of a run of `splatweaver train` [default: the weights that come with the program].
        weights: A published checkpoint, or weights of a run.
        seed: Seed of the router's noise [default: 0].
        callback: Called with a `Progress` for each step, where the network tells of them.
        **options: The other flags of the command, with underscores: `budget=0.2`, `cameras="transforms.json"`.

    Returns:
        The folder: `.scene`, `.cameras`, `.summary`.

    Raises:
        InputError: Options that mean nothing.
        FileError: Photos or weights that cannot be read, or a folder that cannot be written.
        MemoryPlanError: More memory than there is.
    """
    return _into_folder("infer", _listed(photos), out, {"run": run, "weights": weights, "seed": seed, **options}, callback)


def lift(
    scene: Optional[Path] = None,
    out: Optional[Path] = None,
    *,
    cameras: Optional[Path] = None,
    features: Optional[Path] = None,
    solver: str = "exact",
    callback: Optional[Callback] = None,
    **options: Unpack[LiftOptions],
) -> Folder:
    """Lift features of photos to the Gaussians of a scene, as `splatweaver lift`.

    Args:
        scene: File of Gaussians.
        out: File for the features, .safetensors; pictures of them go into a folder beside it.
        cameras: A transforms.json, a folder with a COLMAP model, or a RealEstate10K file.
        features: Folder of features, one .npy or .safetensors for each camera.
        solver: "row-sum", "squared", "exact" or "damped".
        callback: Called with a `Progress` for each step; an answer of False stops.
        **options: The other flags of the command, with underscores: `aggregate="masks"`, `unit=True`.

    Returns:
        The file of the features.

    Raises:
        InputError: Options that mean nothing.
        FileError: Files that cannot be read, or do not belong together.
        MemoryPlanError: More memory than there is.
    """
    given = {"out": out, "cameras": cameras, "features": features, "solver": solver, **options}
    _run("lift", [] if scene is None else [scene], given, callback, json=False)
    return Folder(os.fspath(out)) if out is not None else Folder()


def compress(
    scene: Path,
    out: Path,
    *,
    psnr: float = 46.0,
    cameras: Optional[Path] = None,
    callback: Optional[Callback] = None,
    **options: Unpack[CompressOptions],
) -> Dict[str, Any]:
    """Compress a file of Gaussians to a wanted quality of its pictures, as `splatweaver compress`.

    Args:
        scene: File of Gaussians.
        out: File to write, .wsz; `Scene.load` reads it.
        psnr: Quality of pictures beside those of the scene, decibels.
        cameras: Cameras of the pictures [default: the transforms.json beside the scene, else an orbit].
        callback: Called with a `Progress` for each round; an answer of False stops.
        **options: The other flags of the command, with underscores: `background="black"`.

    Returns:
        Figures: `bytes`, `bytes_before`, `bits_per_gaussian`, `psnr`, `gaussians`, `pictures`.

    Raises:
        InputError: Options that mean nothing.
        FileError: A file that cannot be read or written.
    """
    given = {"out": out, "psnr": psnr, "cameras": cameras, **options}
    return Run("", _run("compress", [scene], given, callback)).summary


def _listed(paths: Paths) -> List[Path]:
    return [paths] if isinstance(paths, (str, os.PathLike)) else list(paths)


def _into_folder(
    command: str, positional: List[Path], out: Optional[Path], options: Mapping[str, Any], callback: Optional[Callback]
) -> Run:
    temporary = tempfile.mkdtemp(prefix="splatweaver-") if out is None else None
    folder = Folder(os.fspath(out)) if out is not None else Folder(temporary or "") / command
    # A comparison is not printed as JSON.
    json = options.get("compare") is None
    try:
        text = _run(command, positional, {"out": folder, **options}, callback, json)
    except BaseException:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)
        raise
    return Run(folder, text, temporary)


def _run(
    command: str, positional: List[Path], options: Mapping[str, Any], callback: Optional[Callback], json: bool = True
) -> str:
    """Runs a command line and returns what it prints."""
    flags = dict(_splatweaver.flags(command))
    given = dict(options)
    if "threads" in flags and given.get("threads") is None:
        given["threads"] = _splatweaver.threads()
    if json:
        given["json"] = True
    switches = [name for name, value in flags.items() if value is None]
    line = [command, *words(given, switches), "--", *positional]
    told = None if callback is None else (lambda *part: callback(Progress(*part)))
    return _splatweaver.run_command(line, _log, told)


def _log(line: str) -> None:
    if line.startswith("warning: "):
        logger.warning("%s", line[len("warning: ") :])
    else:
        logger.info("%s", line)
