"""The package inside a process: threads, forks, memory, import."""

import multiprocessing
import os
import subprocess
import sys
import threading

import numpy as np
import pytest
from conftest import scene

import splatweaver
from splatweaver import InputError, rasterization


def test_threads_do_not_change_bits():
    arguments = scene(0, n=300)
    expected = rasterization(**arguments)[0]
    for count in (1, 2, 3):
        splatweaver.set_threads(count)
        np.testing.assert_array_equal(rasterization(**arguments)[0], expected)
    splatweaver.set_threads(None)
    for count in (0, 2000):
        with pytest.raises(InputError, match="threads: expected 1 to 1024"):
            splatweaver.set_threads(count)


def test_two_threads_draw_at_once():
    expected = [rasterization(**scene(seed, n=100))[0] for seed in (1, 2)]
    wrong = []

    def draw(which):
        for _ in range(20):
            if not (rasterization(**scene(which + 1, n=100))[0] == expected[which]).all():
                wrong.append(which)

    threads = [threading.Thread(target=draw, args=(which,)) for which in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


#: Six threads ask one drawing for where its Gaussians are, which takes long enough that they meet.
ASKED_AT_ONCE = """
import faulthandler, sys, threading
sys.path.insert(0, sys.argv[1])
from conftest import scene
from splatweaver import rasterization

faulthandler.dump_traceback_later(60, exit=True)
arguments = scene(0, n=100_000, cameras=2)
for _ in range(3):
    meta = rasterization(**arguments)[2]
    threads = [threading.Thread(target=meta.__getitem__, args=("means2d",)) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
print(meta["means2d"].shape)
"""


# Promise (servers): threads that ask one drawing wait without the interpreter.
def test_threads_that_ask_one_drawing_do_not_wait_for_ever():
    line = [sys.executable, "-c", ASKED_AT_ONCE, os.path.dirname(os.path.abspath(__file__))]
    done = subprocess.run(line, capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "(2, 100000, 2)", done.stderr[-2000:]


def in_a_child(queue):
    queue.put(rasterization(**scene(3))[0])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="skipped: no fork")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("used", [False, True])
def test_a_forked_process_draws(used):
    if used:
        expected = rasterization(**scene(3))[0]
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=in_a_child, args=(queue,))
    child.start()
    found = queue.get(timeout=20)
    child.join(20)
    assert child.exitcode == 0
    if used:
        np.testing.assert_array_equal(found, expected)


def resident():
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="skipped: no /proc")
def test_a_thousand_calls_leak_nothing():
    arguments = scene(4, n=50)
    try:
        import torch
    except ImportError:
        torch = None

    def call():
        if torch is None:
            rasterization(**arguments)
            return
        given = {k: torch.from_numpy(v).requires_grad_() if isinstance(v, np.ndarray) else v for k, v in arguments.items()}
        rasterization(**given, absgrad=True)[0].sum().backward()

    for _ in range(200):
        call()
    before = resident()
    for _ in range(1000):
        call()
    # A leak of one picture a call would be 11 MB, one of the workspace far more.
    assert resident() - before < 4e6


def test_import_is_quick_and_leaves_torch_alone():
    code = (
        "import sys, time, numpy; begin = time.process_time(); import splatweaver; "
        "print(splatweaver.__version__, 'torch' in sys.modules, time.process_time() - begin)"
    )
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True) for _ in range(3)]
    found = [run.stdout.split() for run in runs]
    assert all(words[:2] == [splatweaver.__version__, "False"] for words in found)
    # Seconds of the processor beside numpy.
    assert min(float(words[2]) for words in found) < 0.1
