"""The documents say what is so."""

import doctest
import importlib.util
import inspect
import re
from pathlib import Path

import capture
import numpy as np
import pytest
import reference

import splatweaver

ROOT = Path(__file__).parents[4]
PAGES = [ROOT / page for page in ("README.md", "docs/guide/python.md", "crates/app/py/README.md")]


def test_the_pages_are_those_of_the_docstrings():
    written = {path.name: path.read_text(encoding="utf-8") for path in reference.FOLDER.glob("*.md")}
    assert written == reference.pages(), "python crates/app/py/tests/reference.py"


def test_everything_public_has_a_page():
    named = set(reference.FUNCTIONS + reference.CLASSES + reference.ERRORS + ["__version__"])
    assert named == set(splatweaver.__all__)


def test_pages_of_functions_have_shapes_errors_and_examples():
    for name in reference.FUNCTIONS:
        function = getattr(splatweaver, name)
        parts = {">>> "}
        if inspect.signature(function).parameters:
            parts |= {"**Arguments**", "**Raises**"}
        if inspect.signature(function).return_annotation != "None":
            parts.add("**Returns**")
        missing = [part for part in sorted(parts) if part not in reference.function_page(name)[2]]
        assert not missing, (name, missing)


def test_every_parameter_is_explained():
    functions = {name: getattr(splatweaver, name) for name in reference.FUNCTIONS}
    for name in ("Scene", "Camera", "Cameras"):
        cls = getattr(splatweaver, name)
        functions[name] = cls
        functions.update({f"{name}.{member}": getattr(cls, member) for member in reference.members(cls, "method")})
    for name, function in functions.items():
        for parameter in inspect.signature(function).parameters.values():
            entry = rf"^ *(\*{{1,2}})?{parameter.name}: \S"
            assert parameter.name == "self" or re.search(entry, function.__doc__, re.M), (name, parameter.name)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """What examples name: a capture, photos, a scene, features."""
    folder = tmp_path_factory.mktemp("files")
    capture.write_capture(folder / "capture")
    capture.write_photos(folder / "photos")
    capture.random_scene(500).save(folder / "scene.ply")
    capture.around(2).save(folder / "transforms.json")
    (folder / "features").mkdir()
    for i in range(10):
        np.save(folder / f"features/{i:03}.npy", np.random.default_rng(i).random((6, 8, 4), np.float32))
    return folder


@pytest.mark.parametrize("module", ["_rasterization", "_scene", "_cameras", "_commands", "_runs"])
def test_examples_in_docstrings_run(module, files, monkeypatch):
    monkeypatch.chdir(files)
    found = doctest.testmod(importlib.import_module(f"splatweaver.{module}"))
    assert found.failed == 0 and found.attempted > 0


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_examples_of_pages_run(page, files, monkeypatch):
    monkeypatch.chdir(files)
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
    assert blocks
    for block in blocks:
        code = compile(block, str(page), "exec")
        # A reconstruction takes half a minute; its page has a shorter one.
        if "reconstruct(" not in block and ("torch" not in block or importlib.util.find_spec("torch")):
            exec(code, {})
