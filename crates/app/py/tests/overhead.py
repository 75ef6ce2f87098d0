"""Measures what a call through torch costs beside the same drawing in memory that is kept: python overhead.py [GAUSSIANS] [FRAMES].

Frames alternate, so that both see the same machine: `bench` is the compiled part with all memory of its own, as
`splatweaver bench raster` has it, `torch` is `rasterization` with `torch.autograd.backward`. Prints medians in milliseconds of
processor time and of the clock, and their ratios. With --loop, a step of a training loop instead, with an L1 loss and Adam.
With --write FILE, the workload for `splatweaver bench raster --workload FILE`.
"""

import argparse
import json
import statistics
import time

import numpy as np
import torch

from splatweaver import _splatweaver, rasterization, set_threads

WIDTH, HEIGHT = 640, 480


def workload(n, seed=3):
    """Gaussians that fill a view, and what arrives at its images, as the tensors of a workload file."""
    random = np.random.default_rng(seed)
    focal = 0.78 * WIDTH
    depth = random.uniform(1.5, 8, n)
    across = random.uniform(-0.55, 0.55, (2, n)) * [[WIDTH], [HEIGHT]] / focal * depth
    median = 0.005 * np.sqrt(1e6 / n)
    bands = np.repeat(0.5 ** np.arange(4), [1, 3, 5, 7])
    tensors = {
        "means": np.stack([*across, depth], -1),
        "quats": random.normal(size=(n, 4)),
        "scales": median * np.exp(0.6 * random.normal(size=(n, 3))),
        "opacities": 1 / (1 + np.exp(-1.5 * random.normal(size=n))),
        "sh": 0.5 * random.normal(size=(n, 16, 3)) * bands[:, None],
        "viewmat": np.eye(4),
        "K": np.array([[focal, 0, WIDTH / 2], [0, focal, HEIGHT / 2], [0, 0, 1]]),
        "background": np.zeros(3),
        "v_image": random.normal(size=(HEIGHT, WIDTH, 3)),
        "v_alpha": random.normal(size=(HEIGHT, WIDTH)),
    }
    return {name: values.astype(np.float32) for name, values in tensors.items()}


def write(path, tensors):
    """A safetensors file."""
    header, at = {"__metadata__": {"width": str(WIDTH), "height": str(HEIGHT)}}, 0
    for name, values in tensors.items():
        header[name] = {"dtype": "F32", "shape": values.shape, "data_offsets": [at, at + values.nbytes]}
        at += values.nbytes
    text = json.dumps(header).encode()
    with open(path, "wb") as file:
        file.write(len(text).to_bytes(8, "little") + text)
        for values in tensors.values():
            file.write(values.tobytes())


def bench(given):
    """A frame in memory that is there already."""
    none = np.zeros((len(given["means"]), 0), np.float32)
    names = ("means", "quats", "scales", "opacities", "sh", None, "viewmat", "K", "background")
    arrays = tuple(none if name is None else given[name] for name in names)
    arrays = (*arrays[:6], *(array[None] for array in arrays[6:]))
    planes = tuple(np.zeros((1, HEIGHT, WIDTH, channels), np.float32) for channels in (3, 1)) + (None, None)
    arriving = (given["v_image"][None], given["v_alpha"][None, ..., None], None, None)
    into = tuple(None if array is none else np.zeros_like(array) for array in arrays)
    rules = {"width": WIDTH, "height": HEIGHT, "near": 0.01, "far": 1e10, "eps2d": 0.3, "alpha_max": 0.99}
    rules.update(antialiased=False, radius_clip=None, degree=3)

    def frame():
        _splatweaver.rasterize(arrays, planes, rules).backward(arrays, arriving, into, False)

    return frame


def through_torch(given):
    """A frame of a training loop, without the loss and the optimizer."""
    tensors = {name: torch.from_numpy(values) for name, values in given.items()}
    inputs = [tensors[name].requires_grad_() for name in ("means", "quats", "scales", "opacities", "sh")]
    cameras = [tensors[name][None].clone().requires_grad_() for name in ("viewmat", "K", "background")]
    arriving = (tensors["v_image"][None], tensors["v_alpha"][None, ..., None])

    def frame():
        for tensor in (*inputs, *cameras):
            tensor.grad = None
        drawn = rasterization(*inputs, *cameras[:2], WIDTH, HEIGHT, sh_degree=3, backgrounds=cameras[2], alpha_max=0.99)
        torch.autograd.backward(drawn[:2], arriving)

    return frame


def training(given):
    """A step of a training loop with loss and optimizer."""
    tensors = {name: torch.from_numpy(values) for name, values in given.items()}
    inputs = [tensors[name].requires_grad_() for name in ("means", "quats", "scales", "opacities", "sh")]
    cameras = [tensors[name][None] for name in ("viewmat", "K")]
    optimizer = torch.optim.Adam(inputs, lr=1e-5)
    picture = torch.rand(1, HEIGHT, WIDTH, 3)

    def step():
        drawn, _, _ = rasterization(*inputs, *cameras, WIDTH, HEIGHT, sh_degree=3)
        optimizer.zero_grad()
        (drawn - picture).abs().mean().backward()
        optimizer.step()

    return step


def timed(frame):
    """Milliseconds of processor time and of the clock."""
    begin = time.process_time(), time.perf_counter()
    frame()
    return 1e3 * (time.process_time() - begin[0]), 1e3 * (time.perf_counter() - begin[1])


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument("gaussians", type=int, nargs="?", default=100_000)
    arguments.add_argument("frames", type=int, nargs="?", default=40)
    arguments.add_argument("--write", metavar="FILE")
    arguments.add_argument("--loop", action="store_true")
    arguments = arguments.parse_args()
    set_threads(2)
    given = workload(arguments.gaussians)
    if arguments.write:
        write(arguments.write, given)
    frames = {"step": training(given)} if arguments.loop else {"bench": bench(given), "torch": through_torch(given)}
    times = {name: [] for name in frames}
    for _ in range(3):
        for frame in frames.values():
            frame()
    for _ in range(arguments.frames):
        for name, frame in frames.items():
            times[name].append(timed(frame))
    medians = {name: [statistics.median(column) for column in zip(*rows)] for name, rows in times.items()}
    for name, (processor, clock) in medians.items():
        print(f"{name}: {processor:.2f} ms of processors, {clock:.2f} ms")
    if not arguments.loop:
        ratios = [a / b for a, b in zip(medians["torch"], medians["bench"])]
        print(f"ratio: {ratios[0]:.3f} of processors, {ratios[1]:.3f}")


if __name__ == "__main__":
    main()
