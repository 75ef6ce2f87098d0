"""Gaussian splats on the CPU.

`rasterization` draws Gaussians with gradients for every input, from numpy arrays or torch tensors. `Scene`, `Camera` and `Cameras` are
files and what can be done with them. `cameras`, `reconstruct`, `fit`, `infer`, `lift` and `compress` are the commands of the command
line as functions.
"""

from __future__ import annotations

from ._cameras import Camera, Cameras
from ._commands import cameras, compress, fit, infer, lift, reconstruct, set_threads
from ._errors import Error, FileError, InputError, MemoryPlanError, NumericError
from ._rasterization import Meta, rasterization
from ._runs import Progress, Run, open_run
from ._scene import Scene, formats
from ._splatweaver import __version__

__all__ = [
    "Camera",
    "Cameras",
    "Error",
    "FileError",
    "InputError",
    "MemoryPlanError",
    "Meta",
    "NumericError",
    "Progress",
    "Run",
    "Scene",
    "__version__",
    "cameras",
    "compress",
    "fit",
    "formats",
    "infer",
    "lift",
    "open_run",
    "rasterization",
    "reconstruct",
    "set_threads",
]
