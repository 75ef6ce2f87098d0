"""The program `splatweaver` that the package brings: the command line in a process of Python."""

import os
import signal
import subprocess
import sys
import time

import pytest
from capture import random_scene, write_capture

import splatweaver


def program(*words, **options):
    line = [sys.executable, "-m", "splatweaver", *map(str, words)]
    return subprocess.run(line, capture_output=True, text=True, timeout=120, **options)


# Promise (options): the Python package brings the whole command line, with its exit codes.
def test_the_program_has_the_exit_codes_of_the_command_line(tmp_path):
    done = program("--version")
    assert (done.returncode, done.stdout, done.stderr) == (0, f"splatweaver {splatweaver.__version__}\n", "")
    wrong = program("trian")
    assert wrong.returncode == 2 and "trian" in wrong.stderr and not wrong.stdout
    missing = program("info", tmp_path / "no.ply")
    assert missing.returncode == 1 and missing.stderr.startswith("error: ") and "no.ply" in missing.stderr
    assert "Traceback" not in wrong.stderr + missing.stderr


def test_an_installed_package_names_the_program():
    metadata = pytest.importorskip("importlib.metadata")
    try:
        entries = metadata.distribution("splatweaver").entry_points
    except metadata.PackageNotFoundError:
        pytest.skip("skipped: not installed")
    named = [entry for entry in entries if entry.group == "console_scripts"]
    assert [(entry.name, entry.value) for entry in named] == [("splatweaver", "splatweaver._program:main")]
    assert callable(named[0].load())


# Promise (files): without a home, or with one that is read-only, the program works.
@pytest.mark.parametrize("home", [None, "/nonexistent", "/proc"])
def test_no_home_is_needed(home, tmp_path):
    random_scene(20).save(tmp_path / "scene.ply")
    environment = {name: value for name, value in os.environ.items() if name != "HOME"}
    if home:
        environment["HOME"] = home
    done = program("convert", "scene.ply", "scene.spz", env=environment, cwd=tmp_path)
    assert done.returncode == 0 and (tmp_path / "scene.spz").stat().st_size > 0, done.stderr


# Promise (files): bytes of names that are no text pass through Python to the program.
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="skipped: names are text here")
def test_names_of_any_bytes_pass(tmp_path):
    random_scene(20).save(tmp_path / "scene.ply")
    name = os.fsencode(tmp_path) + b"/\xff.ply"
    os.rename(tmp_path / "scene.ply", name)
    line = [os.fsencode(sys.executable), b"-m", b"splatweaver", b"info", name]
    done = subprocess.run(line, capture_output=True, timeout=120)
    assert done.returncode == 0 and b"20" in done.stdout, done.stderr


# Promise (results): a processor without AVX2 is served, by portable code.
def test_portable_code_draws(tmp_path):
    random_scene(20).save(tmp_path / "scene.ply")
    environment = dict(os.environ, WEAVER_SIMD="portable")
    line = ("render", "scene.ply", "--orbit", 1, "--width", 32, "--height", 24, "-o", "turn")
    done = program(*line, env=environment, cwd=tmp_path)
    assert done.returncode == 0 and (tmp_path / "turn/0000.png").is_file(), done.stderr


@pytest.mark.skipif(os.name == "nt", reason="skipped: no signals")
def test_an_interrupted_fit_leaves_its_results(tmp_path):
    write_capture(tmp_path / "capture")
    line = [sys.executable, "-m", "splatweaver", "fit", "capture", "-o", "run", "--steps", "100000", "--gaussians", "200"]
    child = subprocess.Popen(line, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    # Saved at some steps: the fit is on its way.
    while not (tmp_path / "run/metrics.jsonl").exists() and child.poll() is None:
        time.sleep(0.02)
    child.send_signal(signal.SIGINT)
    _, stderr = child.communicate(timeout=120)
    assert child.returncode == 0 and "stopping" in stderr and "Traceback" not in stderr, stderr
    assert (tmp_path / "run/scene.ply").is_file() and (tmp_path / "run/summary.json").is_file()
