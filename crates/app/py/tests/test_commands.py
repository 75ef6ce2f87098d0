"""Commands as functions."""

import inspect
import logging
import signal
import subprocess
import sys
import textwrap
from typing import get_type_hints

import numpy as np
import pytest
from capture import around, random_scene, write_capture, write_photos, write_png

import splatweaver
from splatweaver import FileError, InputError, NumericError, Scene, _options, _splatweaver, open_run

#: Parameters that are no flags, and flags that are always given.
POSITIONAL = {"photos", "capture", "scene", "callback", "options"}
IMPLIED = {"json"}
COMMANDS = ["cameras", "reconstruct", "fit", "infer", "lift", "compress"]


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    return write_capture(tmp_path_factory.mktemp("capture") / "turn")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_flag_is_a_parameter(command):
    parameters = inspect.signature(getattr(splatweaver, command)).parameters
    further = get_type_hints(getattr(_options, f"{command.capitalize()}Options"))
    flags = {name.replace("-", "_"): rest for name, *rest in _splatweaver.flags(command)}
    assert (set(parameters) - POSITIONAL) | set(further) == set(flags) - IMPLIED
    for name, kind in further.items():
        assert (kind is bool) == (flags[name][0] in (None, "BOOL", "true|false")), name


@pytest.mark.parametrize("command", COMMANDS)
def test_defaults_are_those_of_the_command_line(command):
    parameters = inspect.signature(getattr(splatweaver, command)).parameters
    for name, _, default in _splatweaver.flags(command):
        own = parameters.get(name.replace("-", "_"))
        if own is not None and own.default is not inspect.Parameter.empty:
            known = default if own.default is None or default is None else type(own.default)(default)
            assert own.default == known, name


def test_a_fit_has_the_same_bits_every_time(capture, tmp_path):
    settings = {"steps": 30, "gaussians": 300, "seed": 3, "sh": 1, "no_html": True}
    first = splatweaver.fit(capture, tmp_path / "one", **settings)
    assert first.summary["steps"] == 30 and first.summary["train"]["psnr"] > 5
    assert len(first.scene) <= 300 and len(first.cameras) == 10
    splatweaver.set_threads(1)
    try:
        second = splatweaver.fit(capture, **settings)
    finally:
        splatweaver.set_threads(None)
    assert (second.folder / "scene.ply").read_bytes() == (first.folder / "scene.ply").read_bytes()
    folder = second.folder
    del second
    assert not folder.exists(), "a temporary folder lives as long as its run"
    opened = open_run(tmp_path / "one")
    assert opened.summary["gaussians"] == len(opened.scene)


def test_a_callback_is_told_of_every_step_and_may_stop(capture, tmp_path):
    told = []

    def watch(progress):
        told.append(progress)
        return progress.done < 7

    run = splatweaver.fit(capture, tmp_path / "run", steps=50, gaussians=200, callback=watch, no_html=True)
    fits = [progress.done for progress in told if progress.label == "fit"]
    assert fits == list(range(1, 8)) and told[-1].total == 50 and "Gaussians" in told[-1].note
    assert run.summary["steps"] == 7 and len(run.scene) > 0
    resumed = splatweaver.fit(resume=tmp_path / "run")
    assert resumed.summary["steps"] == 50


def test_what_a_callback_raises_is_raised(capture, tmp_path):
    def fail(progress):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        splatweaver.fit(capture, tmp_path / "run", steps=50, gaussians=200, callback=fail, no_html=True)
    # The fit ended in order.
    assert open_run(tmp_path / "run").summary["steps"] == 1


def test_ctrl_c_writes_results_and_is_raised(capture, tmp_path):
    script = textwrap.dedent(
        """
        import os, signal, sys
        import splatweaver

        # Processes in the background of a shell ignore it.
        signal.signal(signal.SIGINT, signal.default_int_handler)

        def interrupt(progress):
            if progress.done == 3:
                os.kill(os.getpid(), signal.SIGINT)

        try:
            splatweaver.fit(sys.argv[1], sys.argv[2], steps=100000, gaussians=200, callback=interrupt, no_html=True)
        except KeyboardInterrupt:
            print("interrupted", splatweaver.open_run(sys.argv[2]).summary["steps"])
        """
    )
    line = [sys.executable, "-c", script, str(capture), str(tmp_path / "run")]
    done = subprocess.run(line, capture_output=True, text=True, timeout=60)
    assert done.stdout.startswith("interrupted ") and int(done.stdout.split()[1]) >= 3, done.stderr


def test_notes_are_logged(capture, tmp_path, caplog):
    with caplog.at_level(logging.INFO, "splatweaver"):
        splatweaver.fit(capture, tmp_path / "run", steps=2, gaussians=50, no_html=True)
    assert any("photos, 2 held out" in record.message or "held out" in record.message for record in caplog.records)
    warned = [record for record in caplog.records if record.levelno == logging.WARNING]
    assert all(not record.message.startswith("warning") for record in warned)


# Promise (servers): photos that are not there are a failure of a file.
def test_failures_have_their_kinds(capture, tmp_path):
    with pytest.raises(FileError, match="nowhere"):
        splatweaver.fit(tmp_path / "nowhere", tmp_path / "a")
    with pytest.raises(FileError, match="nowhere: no such file or folder"):
        splatweaver.cameras(tmp_path / "nowhere")
    with pytest.raises(InputError, match="--gaussians"):
        splatweaver.fit(capture, tmp_path / "b", gaussians=0)
    with pytest.raises(InputError, match="unexpected argument '--nonsense'"):
        splatweaver.fit(capture, tmp_path / "c", nonsense=1)
    with pytest.raises(InputError, match="--quality"):
        splatweaver.reconstruct(capture, tmp_path / "d", quality="perfect")
    with pytest.raises(InputError, match="one\\.wsy|--out"):
        splatweaver.compress(tmp_path / "scene.ply", tmp_path / "one.wsy")
    with pytest.raises(NumericError, match="the loss is NaN"):
        splatweaver.fit(capture, tmp_path / "e", steps=3, gaussians=50, set=["rates.sh=1e20"], no_html=True)
    splatweaver.fit(capture, tmp_path / "run", steps=1, gaussians=50, no_html=True)
    with pytest.raises(InputError, match="run: a run exists there already"):
        splatweaver.fit(capture, tmp_path / "run", steps=1)
    flat = tmp_path / "flat"
    flat.mkdir()
    for i in range(3):
        write_png(flat / f"{i}.png", np.full((40, 60, 3), 0.5))
    with pytest.raises(splatweaver.Error, match="expected photos that overlap, found none"):
        splatweaver.cameras(flat)


#: Cameras are stopped while photos are matched; then the process waits for longer than matching takes.
STOPPED = """
import pathlib, signal, sys, time
import splatweaver

def stop(*_):
    raise TimeoutError

signal.signal(signal.SIGALRM, stop)
photos, out = sys.argv[1:]
begun = time.monotonic()
splatweaver.cameras(photos, out + "-whole", match_size=320, callback=lambda progress: print(progress.label, progress.total))
took = time.monotonic() - begun
signal.setitimer(signal.ITIMER_REAL, took / 4)
try:
    splatweaver.cameras(photos, out, match_size=320)
except TimeoutError:
    time.sleep(2 * took)
    print("stopped", pathlib.Path(out, "transforms.json").exists())
"""


# Promise (servers): cameras that were stopped are not written afterwards, and a callback runs before they are.
@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="skipped: no timers")
def test_cameras_that_were_stopped_are_not_written(tmp_path):
    photos = write_photos(tmp_path / "photos")
    line = [sys.executable, "-c", STOPPED, str(photos), str(tmp_path / "out")]
    done = subprocess.run(line, capture_output=True, text=True, timeout=120)
    assert done.stdout.split() == ["cameras", "5", "stopped", "False"], done.stderr


def test_a_dry_run_says_what_it_would_take(capture):
    assert "rasterizer" in splatweaver.fit(capture, gaussians=100, dry_run=True).text


def test_scenes_are_compressed(tmp_path):
    random_scene(500).save(tmp_path / "scene.ply")
    around(4).save(tmp_path / "transforms.json")
    rounds = []
    figures = splatweaver.compress(tmp_path / "scene.ply", tmp_path / "scene.wsz", psnr=40, callback=rounds.append)
    assert figures["chosen_by"]["psnr"] >= 40 and figures["bytes"] < figures["bytes_before"] and rounds
    assert 30 <= figures["psnr"]
    assert len(Scene.load(tmp_path / "scene.wsz")) == 500
    before = (tmp_path / "scene.wsz").read_bytes()
    with pytest.raises(splatweaver.Error, match="stopped before there was anything to write"):
        splatweaver.compress(tmp_path / "scene.ply", tmp_path / "scene.wsz", callback=lambda progress: False)
    assert (tmp_path / "scene.wsz").read_bytes() == before
