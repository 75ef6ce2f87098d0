# %% [markdown]
# A picture fitted with Gaussians by torch's Adam: python fit_image.py, or cell by cell in a notebook.
#
# The Gaussians stand near a plane in front of one camera, as in `cargo run --release -p weaver-splat --example fit_image`, which is
# the same in Rust: start, rates, schedule and number of steps.

# %%
import math

import numpy as np
import torch

from splatweaver import Scene, rasterization

GAUSSIANS, STEPS = 2000, 400


# %% A picture [H, W, 3] of values from 0 to 1; any other is as good.
def pattern(width=160, height=120):
    y, x = np.mgrid[:height, :width] / width
    rings = 0.5 + 0.5 * np.sin(40 * np.hypot(x - 0.5, y - 0.4))
    return np.stack([rings, x, 1 - y], -1).astype(np.float32)


# %% Gaussians at random places, colored like the picture there, and Adam.
def fit(picture, norm="L1", seed=0):
    picture = torch.from_numpy(picture)
    height, width, _ = picture.shape
    random = torch.Generator().manual_seed(seed)
    rows = torch.randint(height, (GAUSSIANS,), generator=random)
    columns = torch.randint(width, (GAUSSIANS,), generator=random)
    depth = 1 + 0.1 * torch.arange(GAUSSIANS) / GAUSSIANS
    means = torch.stack([(columns + 0.5 - width / 2) / width, (rows + 0.5 - height / 2) / width, depth], -1)
    size = 0.6 * math.sqrt(height / width / GAUSSIANS)
    start = {
        "means": (means, 0.3 / width),
        "quats": (torch.tensor([1.0, 0, 0, 0]).repeat(GAUSSIANS, 1), 0.01),
        "log_scales": (torch.full((GAUSSIANS, 3), math.log(size)), 0.02),
        "logits": (torch.zeros(GAUSSIANS), 0.03),
        "colors": (picture[rows, columns], 0.01),
    }
    own = {name: values.requires_grad_() for name, (values, _) in start.items()}
    groups = [{"params": [own[name]], "lr": rate} for name, (_, rate) in start.items()]
    optimizer = torch.optim.Adam(groups, betas=(0.9, 0.99), eps=1e-15)
    # Half a cosine down to a twentieth.
    schedule = torch.optim.lr_scheduler.LambdaLR(
        optimizer, lambda step: 0.05 + 0.95 * (1 + math.cos(math.pi * min(step / STEPS, 1))) / 2
    )
    camera = torch.eye(4)[None], torch.tensor([[[width, 0, width / 2], [0, width, height / 2], [0, 0, 1]]])
    for step in range(STEPS + 1):
        drawn, _, _ = rasterization(
            own["means"], own["quats"], own["log_scales"].exp(), own["logits"].sigmoid(), own["colors"], *camera, width, height
        )
        difference = drawn[0] - picture
        psnr = -10 * math.log10(difference.square().mean().item())
        if step % 100 == 0:
            print(f"step {step:3}: {psnr:.2f} dB")
        optimizer.zero_grad()
        (difference.abs() if norm == "L1" else difference.square()).mean().backward()
        optimizer.step()
        schedule.step()
    harmonics = ((own["colors"] - 0.5) / 0.28209479177387814)[:, None]
    return psnr, Scene.from_activated(
        own["means"], own["log_scales"].exp(), own["quats"], own["logits"].sigmoid(), harmonics
    )


# %%
if __name__ == "__main__":
    psnr, scene = fit(pattern())
    scene.save("fit_image.ply")
