"""The commands of the command line as functions: the same work, defaults and bits."""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
from pathlib import Path as Folder
from typing import TYPE_CHECKING, Any, Dict, Mapping, Optional

from . import _splatweaver
from ._options import Path, Paths
from ._runs import Callback, Progress, Run

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._options import CamerasOptions, CompressOptions, FitOptions, InferOptions, LiftOptions, ReconstructOptions

logger = logging.getLogger("splatweaver")


def set_threads(count: Optional[int]) -> None:
    """Set the number of threads that everything is computed on. Results do not depend on it.

    Args:
        count: 1 to 1024; None is one per core, as at first.

    Raises:
        InputError: Another number.

    >>> import splatweaver
    >>> splatweaver.set_threads(2)
    >>> splatweaver.set_threads(None)
    """
    _splatweaver.set_threads(count)


def cameras(
    photos: Paths, out: Optional[Path] = None, *, callback: Optional[Callback] = None, **options: Unpack[CamerasOptions]
) -> Run:
    """Estimate the cameras of photos by matching them, as `splatweaver cameras`.

    Args:
        photos: Photos, folders of photos, or clips.
        out: Folder for the results; None is a temporary one, which lives as long as the result.
        callback: Called with a `Progress` for each frame of clips, and once cameras are found, before they are written; an answer of
            False stops.
        **options: The other flags of the command, with underscores: `focal=1.2`, `distortion="k1"`.

    Returns:
        The folder: `.cameras`, `.summary`.

    Raises:
        InputError: Options that mean nothing.
        FileError: Photos that cannot be read, or a folder that cannot be written.

    >>> import splatweaver
    >>> run = splatweaver.cameras("photos", match_size=320)
    >>> len(run.cameras), run.cameras[0].K.shape
    (5, (3, 3))
    """
    return _into_folder("cameras", {"photos": photos, **options}, out, callback)


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
        quality: "draft" (half a minute for some 50 photos), "normal" (five minutes), "fine" (twenty) or "best" (as long as
            held-out photos gain).
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

    >>> import splatweaver
    >>> run = splatweaver.reconstruct("capture", quality="draft", minutes=0.05, gaussians=200)
    >>> run.scene.save("draft.spz"), len(run.cameras)
    (None, 10)
    """
    given = {"photos": photos, "quality": quality, "minutes": minutes, "gaussians": gaussians, "seed": seed, **options}
    return _into_folder("reconstruct", given, out, callback)


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

    >>> import splatweaver
    >>> run = splatweaver.fit("capture", steps=20, gaussians=200, callback=lambda progress: progress.done < 10)
    >>> run.summary["steps"], len(run.scene) <= 200
    (10, True)
    """
    given: Dict[str, Any] = {
        "capture": capture,
        "minutes": minutes,
        "steps": steps,
        "gaussians": gaussians,
        "seed": seed,
        **options,
    }
    if options.get("resume") is not None:
        return Run(os.fspath(options["resume"]), _run("fit", {**given, "json": True}, callback))
    if options.get("dry_run"):
        return Run(out or "", _run("fit", given, callback))
    return _into_folder("fit", given, out, callback)


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

    >>> import splatweaver
    >>> run = splatweaver.infer(["photos/000.png", "photos/001.png"], cameras="predicted", no_html=True)
    >>> run.summary["gaussians"] == len(run.scene)
    True
    """
    given = {"photos": photos, "run": run, "weights": weights, "seed": seed, **options}
    return _into_folder("infer", given, out, callback)


def lift(
    scene: Optional[Path] = None,
    out: Optional[Path] = None,
    *,
    cameras: Optional[Path] = None,
    features: Optional[Path] = None,
    solver: str = "exact",
    callback: Optional[Callback] = None,
    **options: Unpack[LiftOptions],
) -> Optional[Folder]:
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
        The file of the features, None without one. What the command prints is logged.

    Raises:
        InputError: Options that mean nothing.
        FileError: Files that cannot be read, or do not belong together.
        MemoryPlanError: More memory than there is.

    >>> import splatweaver
    >>> splatweaver.lift("scene.ply", "lifted.safetensors", cameras="capture/transforms.json", features="features").name
    'lifted.safetensors'
    """
    given = {"scene": scene, "out": out, "cameras": cameras, "features": features, "solver": solver, **options}
    for line in _run("lift", given, callback).splitlines():
        _log(line)
    return None if out is None else Folder(os.fspath(out))


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

    >>> import splatweaver
    >>> figures = splatweaver.compress("scene.ply", "scene.wsz", psnr=40, cameras="capture/transforms.json")
    >>> figures["psnr"] >= 40, figures["bytes"] < figures["bytes_before"]
    (True, True)
    """
    given = {"scene": scene, "out": out, "psnr": psnr, "cameras": cameras, "json": True, **options}
    return Run("", _run("compress", given, callback)).summary


def _into_folder(
    command: str, settings: Mapping[str, Any], out: Optional[Path], callback: Optional[Callback]
) -> Run:
    temporary = tempfile.mkdtemp(prefix="splatweaver-") if out is None else None
    folder = Folder(os.fspath(out)) if out is not None else Folder(temporary or "") / command
    # A comparison is not printed as JSON.
    json = settings.get("compare") is None
    try:
        text = _run(command, {"out": folder, "json": json, **settings}, callback)
    except BaseException:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)
        raise
    return Run(folder, text, temporary)


def _run(command: str, settings: Mapping[str, Any], callback: Optional[Callback]) -> str:
    """Runs a command and returns what it prints."""
    told = None if callback is None else (lambda *part: callback(Progress(*part)))
    return _splatweaver.run_command(command, {"threads": _splatweaver.threads(), **settings}, _log, told)


def _log(line: str) -> None:
    if line.startswith("warning: "):
        logger.warning("%s", line[len("warning: ") :])
    else:
        logger.info("%s", line)
