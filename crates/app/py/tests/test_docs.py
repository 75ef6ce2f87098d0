"""The documents say what is so."""

import doctest
import importlib
import re
from pathlib import Path

import capture
import numpy as np
import pytest
import reference

import splatweaver

ROOT = Path(__file__).parents[4]
PAGES = [ROOT / "docs/python.md", ROOT / "crates/app/py/README.md"]


def test_the_pages_are_those_of_the_docstrings():
    written = {path.name: path.read_text(encoding="utf-8") for path in reference.FOLDER.glob("*.md")}
    assert written == reference.pages(), "python crates/app/py/tests/reference.py"


def test_everything_public_has_a_page():
    named = set(reference.FUNCTIONS + reference.CLASSES + reference.ERRORS + ["__version__"])
    assert named == set(splatweaver.__all__)


def test_pages_of_functions_have_shapes_errors_and_examples():
    pages = reference.pages()
    for name in reference.FUNCTIONS[:8]:
        for part in ("**Arguments**", "**Returns**", "**Raises**", ">>> "):
            assert part in pages[f"{name}.md"], (name, part)


@pytest.fixture
def files(tmp_path, monkeypatch):
    """What examples name: a capture, photos, a scene, features."""
    capture.write_capture(tmp_path / "capture")
    capture.write_photos(tmp_path / "photos")
    capture.random_scene(500).save(tmp_path / "scene.ply")
    (tmp_path / "features").mkdir()
    for i in range(10):
        np.save(tmp_path / f"features/{i:03}.npy", np.random.default_rng(i).random((6, 8, 4), np.float32))
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("module", ["_rasterization", "_scene", "_cameras", "_commands", "_runs"])
def test_examples_in_docstrings_run(module, files):
    found = doctest.testmod(importlib.import_module(f"splatweaver.{module}"))
    assert found.failed == 0 and found.attempted > 0


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_examples_of_pages_compile(page):
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
    assert blocks
    for block in blocks:
        compile(block, str(page), "exec")
