"""Fits a picture with Gaussians by torch's Adam: python fit_image.py [PICTURE.npy] [L1|L2].

The picture is an array [H, W, 3] of values from 0 to 1; without one, a pattern. Writes fit_image.ply, and prints the peak
signal-to-noise ratio. The same as `cargo run --release -p weaver-splat --example fit_image` in Rust.
"""

import math
import sys

import numpy as np
import torch

from splatweaver import Scene, rasterization

GAUSSIANS, STEPS = 2000, 400


def pattern(width=160, height=120):
    y, x = np.mgrid[:height, :width] / width
    rings = 0.5 + 0.5 * np.sin(40 * np.hypot(x - 0.5, y - 0.4))
    return np.stack([rings, x, 1 - y], -1).astype(np.float32)


def main(path=None, norm="L1", seed=0):
    picture = torch.from_numpy(np.load(path).astype(np.float32) if path else pattern())
    height, width, _ = picture.shape
    random = torch.Generator().manual_seed(seed)
    rows = torch.randint(height, (GAUSSIANS,), generator=random)
    columns = torch.randint(width, (GAUSSIANS,), generator=random)
    depth = 1 + 0.1 * torch.arange(GAUSSIANS) / GAUSSIANS
    means = torch.stack([(columns + 0.5 - width / 2) / width, (rows + 0.5 - height / 2) / width, depth], -1)
    size = 0.6 * math.sqrt(height / width / GAUSSIANS)
    parameters = {
        "means": (means, 0.3 / width),
        "quats": (torch.tensor([1.0, 0, 0, 0]).repeat(GAUSSIANS, 1), 0.01),
        "log_scales": (torch.full((GAUSSIANS, 3), math.log(size)), 0.02),
        "logits": (torch.zeros(GAUSSIANS), 0.03),
        "colors": (picture[rows, columns].clone(), 0.01),
    }
    own = {name: values.requires_grad_() for name, (values, _) in parameters.items()}
    groups = [{"params": [own[name]], "lr": rate} for name, (_, rate) in parameters.items()]
    optimizer = torch.optim.Adam(groups, betas=(0.9, 0.99), eps=1e-15)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
    K = torch.tensor([[[width, 0, width / 2], [0, width, height / 2], [0, 0, 1]]], dtype=torch.float32)
    psnr = 0.0
    for step in range(STEPS + 1):
        drawn, _, _ = rasterization(
            own["means"], own["quats"], own["log_scales"].exp(), own["logits"].sigmoid(), own["colors"],
            torch.eye(4)[None], K, width, height,
        )  # fmt: skip
        difference = drawn[0] - picture
        psnr = -10 * math.log10(difference.square().mean().item())
        if step % 100 == 0:
            print(f"step {step:3}: {psnr:.2f} dB")
        optimizer.zero_grad()
        (difference.abs() if norm == "L1" else difference.square()).mean().backward()
        optimizer.step()
        schedule.step()
    harmonics = ((own["colors"] - 0.5) / 0.28209479177387814)[:, None]
    scene = Scene.from_activated(own["means"], own["log_scales"].exp(), own["quats"], own["logits"].sigmoid(), harmonics)
    scene.save("fit_image.ply")
    return psnr


if __name__ == "__main__":
    main(*sys.argv[1:])
