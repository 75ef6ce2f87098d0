"""The examples do what they say."""

import importlib.util
import runpy
import sys
from pathlib import Path

import pytest
from capture import write_capture

EXAMPLES = Path(__file__).parent.parent / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_picture_is_fitted(tmp_path, monkeypatch):
    pytest.importorskip("torch", reason="skipped: no torch")
    monkeypatch.chdir(tmp_path)
    example = load("fit_image")
    example.STEPS, example.GAUSSIANS = 30, 500
    assert example.main() > 17
    assert (tmp_path / "fit_image.ply").exists()


def test_a_camera_is_found():
    pytest.importorskip("torch", reason="skipped: no torch")
    degrees, distance = load("refine_camera").main()
    assert degrees < 0.05 and distance < 0.005


def test_a_fit_is_followed_and_looked_at(tmp_path, monkeypatch):
    capture = write_capture(tmp_path / "turn")
    run = load("follow_fit").main(capture, tmp_path / "run", minutes=None, steps=20, gaussians=200)
    assert "polyline" in (tmp_path / "run/curve.svg").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["notebook.py", str(run.folder)])
    shown = runpy.run_path(str(EXAMPLES / "notebook.py"))
    assert "<iframe" in shown["view"]._repr_html_() and (tmp_path / "near.spz").exists()
