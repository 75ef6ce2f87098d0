"""Scenes that tests share."""

import json
from pathlib import Path
from typing import Dict

import numpy as np
import pytest

FIXTURES = Path(__file__).parents[4] / "tests" / "fixtures" / "raster"
KINDS = {"F32": np.float32, "F64": np.float64, "U8": np.uint8, "BOOL": np.uint8, "I64": np.int64, "I32": np.int32}


def read_tensors(path: Path) -> Dict[str, np.ndarray]:
    """The tensors of a safetensors file."""
    data = path.read_bytes()
    length = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + length])
    found = {}
    for name, entry in header.items():
        if name != "__metadata__":
            begin, end = (8 + length + at for at in entry["data_offsets"])
            found[name] = np.frombuffer(data[begin:end], KINDS[entry["dtype"]]).reshape(entry["shape"])
    return found


def scene(seed: int, n: int = 12, cameras: int = 2, kind=np.float64, degree=None, channels: int = 3):
    """Gaussians in front of cameras that are a little apart, as arguments of `rasterization`."""
    random = np.random.default_rng(seed)
    viewmats = np.tile(np.eye(4), (cameras, 1, 1))
    for c in range(cameras):
        angle = 0.1 * random.normal()
        viewmats[c, 0, 0] = viewmats[c, 2, 2] = np.cos(angle)
        viewmats[c, 0, 2], viewmats[c, 2, 0] = np.sin(angle), -np.sin(angle)
        viewmats[c, :3, 3] = 0.1 * random.normal(size=3)
    shape = (n, channels) if degree is None else (n, (degree + 1) ** 2, 3)
    arguments = {
        "means": random.uniform([-1, -0.8, 2.5], [1, 0.8, 4], (n, 3)),
        "quats": random.normal(size=(n, 4)),
        "scales": random.uniform(0.3, 0.7, (n, 3)),
        "opacities": random.uniform(0.2, 0.6, n),
        "colors": random.uniform(0.2, 0.9, shape) if degree is None else 0.2 * random.normal(size=shape),
        "viewmats": viewmats,
        "Ks": np.tile([[9.0, 0, 6.1], [0, 9.5, 4.9], [0, 0, 1]], (cameras, 1, 1)),
        "backgrounds": random.uniform(0, 1, (cameras, channels)),
    }
    return {**{name: value.astype(kind) for name, value in arguments.items()}, "width": 12, "height": 10, "sh_degree": degree}


@pytest.fixture
def lone():
    """One red ball before one camera."""
    return {
        "means": np.array([[0, 0, 2.0]]),
        "quats": np.array([[1.0, 0, 0, 0]]),
        "scales": np.full((1, 3), 0.5),
        "opacities": np.array([0.8]),
        "colors": np.array([[1, 0.5, 0]]),
        "viewmats": np.eye(4)[None],
        "Ks": np.array([[[10, 0, 1.5], [0, 10, 1.5], [0, 0, 1.0]]]),
        "width": 3,
        "height": 3,
    }
