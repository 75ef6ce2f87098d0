"""The examples do what they say."""

import importlib.util
import runpy
from pathlib import Path

import pytest
from capture import write_capture

EXAMPLES = Path(__file__).parent.parent / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_they_are_notebooks():
    for path in EXAMPLES.glob("*.py"):
        text = path.read_text(encoding="utf-8")
        # Arguments of Jupyter's own would be taken for theirs.
        assert text.startswith("# %% [markdown]\n") and "sys.argv" not in text, path


def test_a_picture_is_fitted():
    pytest.importorskip("torch", reason="skipped: no torch")
    example = load("fit_image")
    example.STEPS, example.GAUSSIANS = 30, 500
    psnr, scene = example.fit(example.pattern())
    assert psnr > 17 and len(scene) == 500


def test_a_camera_is_found():
    pytest.importorskip("torch", reason="skipped: no torch")
    degrees, distance = load("refine_camera").main()
    assert degrees < 0.05 and distance < 0.005


def test_a_fit_is_followed_and_looked_at(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run, curve = load("follow_fit").follow(write_capture(tmp_path / "turn"), "scene", minutes=None, steps=20, gaussians=200)
    assert len(curve) == 20 and (run.folder / "curve.svg").read_text(encoding="utf-8") == curve._repr_svg_()
    shown = runpy.run_path(str(EXAMPLES / "notebook.py"))
    assert "<iframe" in shown["view"]._repr_html_() and (tmp_path / "near.spz").exists()
