"""Folders of results, and progress on the way to them."""

from __future__ import annotations

import json
import os
import shutil
import weakref
from pathlib import Path as Folder
from typing import Any, Callable, Dict, NamedTuple, Optional

from ._cameras import Cameras, Path
from ._errors import FileError
from ._scene import Scene


class Progress(NamedTuple):
    """State of a command under way, which callbacks are given.

    Fields:
        label: Name of the part of the work, as "fit" or "clip".
        done: Steps that are done.
        total: Steps of the whole, as far as it is known.
        note: Remark, as "21.34 dB, 5000 Gaussians".
    """

    label: str
    done: int
    total: int
    note: str


#: Called with each step that is done; an answer of False stops the work, whose results are written.
Callback = Callable[[Progress], Optional[bool]]


class Run:
    """A folder of results, of `reconstruct`, `fit`, `infer`, `cameras`, or of the command line.

    `.folder` is its path, `.text` what the command printed. Files that the command did not write raise FileError when they are asked for.
    """

    def __init__(self, folder: Path, text: str = "", temporary: Optional[str] = None) -> None:
        #: The folder.
        self.folder = Folder(os.fspath(folder))
        #: What the command printed.
        self.text = text
        # A temporary folder lives as long as its run.
        if temporary is not None:
            weakref.finalize(self, shutil.rmtree, temporary, ignore_errors=True)

    @property
    def scene(self) -> Scene:
        """The scene, read anew each time."""
        return Scene.load(self.folder / "scene.ply")

    @property
    def cameras(self) -> Cameras:
        """The cameras of the photos."""
        return Cameras.load(self.folder / "transforms.json")

    @property
    def summary(self) -> Dict[str, Any]:
        """The figures, as `--json` prints them, or those of summary.json."""
        if self.text.lstrip().startswith("{"):
            summary: Dict[str, Any] = json.loads(self.text)
            return summary
        path = self.folder / "summary.json"
        try:
            summary = json.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise FileError(f"{path}: {error.strerror}") from error
        except ValueError as error:
            raise FileError(f"{path}: expected JSON, found {error}") from error
        return summary

    def __repr__(self) -> str:
        return f"Run({str(self.folder)!r})"


def open_run(folder: Path) -> Run:
    """The results in a folder that `reconstruct`, `fit`, `infer` or `cameras` wrote, here or from the command line.

    Args:
        folder: The folder.

    Returns:
        The folder: `.scene`, `.cameras`, `.summary`, as far as they were written.

    Raises:
        FileError: A folder without results.

    >>> from splatweaver import open_run
    >>> run = open_run("capture")
    >>> len(run.cameras)
    10
    """
    run = Run(folder)
    if not any((run.folder / name).exists() for name in ("scene.ply", "transforms.json", "summary.json")):
        found = "another folder" if run.folder.is_dir() else "nothing"
        raise FileError(f"{run.folder}: expected a folder with scene.ply, transforms.json or summary.json, found {found}")
    return run
