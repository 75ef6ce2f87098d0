"""Fits pictures by examples/fit_image.py and by its twin in Rust: python beside_rust.py [SEEDS].

Both begin at random places of their own; pictures are those that the twin reads, of eight bits. Needs torch and cargo.
"""

import re
import statistics
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from capture import around, random_scene, write_png
from test_examples import load

MANIFEST = Path(__file__).parents[4] / "Cargo.toml"
RUST = ["cargo", "run", "--quiet", "--release", "--locked", "--manifest-path", str(MANIFEST)]
RUST += ["-p", "weaver-splat", "--example", "fit_image", "--"]
EXAMPLE = load("fit_image")


def in_rust(picture, seed):
    """Decibels at the end."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "picture.png")
        write_png(path, picture)
        done = subprocess.run([*RUST, str(path), str(seed)], cwd=folder, capture_output=True, text=True, check=True)
    return float(re.findall(r"([\d.]+) dB", done.stdout)[-1])


def in_torch(picture, seed, norm):
    return EXAMPLE.fit(picture, norm, seed)[0]


def main(seeds=3):
    pictures = {"rings": EXAMPLE.pattern(), "Gaussians": random_scene(degree=0).render(around(1, 160, 120)[0])}
    ways = {"Rust, L2": in_rust, "torch, L2": partial(in_torch, norm="L2"), "torch, L1": partial(in_torch, norm="L1")}
    for name, picture in pictures.items():
        pixels = (np.clip(picture, 0, 1) * 255 + 0.5).astype(np.uint8)
        for way, fit in ways.items():
            found = [fit((pixels / 255).astype(np.float32), seed) for seed in range(int(seeds))]
            each = ", ".join(f"{psnr:.2f}" for psnr in found)
            print(f"{name}: {way}: {statistics.mean(found):.2f} dB ({each})", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
