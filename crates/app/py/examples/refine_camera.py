# %% [markdown]
# The camera of a photo found by descent through the rasterizer: python refine_camera.py, or cell by cell in a notebook.
#
# A camera that is off by some degrees and a tenth of the distance is turned and moved until it sees what the photo shows.

# %%
import numpy as np
import torch

from splatweaver import Camera, rasterization


# %% A motion of six numbers, which are zero at first.
def turned(viewmat, twist):
    """The camera after a small rotation and translation, `[6]`."""
    x, y, z = twist[:3]
    zero = torch.zeros_like(x)
    generator = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero]).reshape(3, 3)
    rotation = torch.linalg.matrix_exp(generator)
    top = torch.cat([rotation @ viewmat[:3, :3], (rotation @ viewmat[:3, 3] + twist[3:])[:, None]], 1)
    return torch.cat([top, viewmat[3:]])[None]


# %% A scene, its photo, a camera that is off, and Adam.
def main(steps=300, seed=0):
    random = np.random.default_rng(seed)
    n = 400
    scene = [
        torch.from_numpy(array.astype(np.float32))
        for array in (
            random.uniform(-1, 1, (n, 3)),
            random.normal(size=(n, 4)),
            random.uniform(0.05, 0.2, (n, 3)),
            random.uniform(0.4, 0.95, n),
            random.uniform(0, 1, (n, 3)),
        )
    ]
    truth = Camera.look_at((0, -0.5, -3), (0, 0, 0), 96, 72)
    start = Camera.look_at((0.25, -0.4, -2.9), (0.1, 0, 0.1), 96, 72)
    K = torch.tensor(truth.K, dtype=torch.float32)[None]

    def draw(viewmats):
        return rasterization(*scene, viewmats, K, 96, 72)[0]

    photo = draw(torch.tensor(truth.viewmat, dtype=torch.float32)[None])
    begin = torch.tensor(start.viewmat, dtype=torch.float32)
    twist = torch.zeros(6, requires_grad=True)
    optimizer = torch.optim.Adam([twist], lr=0.01)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for _ in range(steps):
        optimizer.zero_grad()
        (draw(turned(begin, twist)) - photo).abs().mean().backward()
        optimizer.step()
        schedule.step()
    found = turned(begin, twist.detach())[0].double().numpy()
    turn = found[:3, :3] @ truth.viewmat[:3, :3].T
    degrees = float(np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))))
    center = -found[:3, :3].T @ found[:3, 3]
    distance = float(np.linalg.norm(center - (0, -0.5, -3)))
    print(f"off by {degrees:.4f} degrees and {distance:.5f} of the scene's units")
    return degrees, distance


# %%
if __name__ == "__main__":
    main()
