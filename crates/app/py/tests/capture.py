"""A small capture: photos of a scene that is drawn, with their cameras."""

import struct
import zlib
from pathlib import Path

import numpy as np

from splatweaver import Camera, Cameras, Scene


def write_png(path: Path, picture: np.ndarray) -> None:
    """Writes a picture `[H, W, 3]` of values from 0 to 1."""
    pixels = (np.clip(picture, 0, 1) * 255 + 0.5).astype(np.uint8)
    height, width, _ = pixels.shape
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def random_scene(n: int = 200, degree: int = 1, seed: int = 0) -> Scene:
    random = np.random.default_rng(seed)
    sh = 0.5 * random.normal(size=(n, (degree + 1) ** 2, 3))
    return Scene.from_activated(
        means=random.uniform(-1, 1, (n, 3)),
        scales=random.uniform(0.05, 0.25, (n, 3)),
        quats=random.normal(size=(n, 4)),
        opacities=random.uniform(0.3, 0.95, n),
        sh=sh,
    )


def around(count: int, width: int = 48, height: int = 36) -> Cameras:
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    places = [(3 * np.cos(a), 0.4 * np.sin(3 * a) - 0.5, 3 * np.sin(a)) for a in angles]
    return Cameras(
        Camera.look_at(place, (0, 0, 0), width, height, name=f"images/{i:03}.png") for i, place in enumerate(places)
    )


def write_capture(folder: Path, count: int = 10) -> Path:
    scene, cameras = random_scene(), around(count)
    (folder / "images").mkdir(parents=True)
    for camera, picture in zip(cameras, scene.render(cameras)):
        write_png(folder / camera.name, picture)
    cameras.save(folder / "transforms.json")
    return folder


def write_photos(folder: Path, count: int = 5) -> Path:
    """Photos of a ball of small bright Gaussians, from places near one another, that can be matched."""
    random = np.random.default_rng(0)
    n = 3000
    means = random.normal(size=(n, 3))
    ball = Scene.from_activated(
        means=means / np.linalg.norm(means, axis=1, keepdims=True) * random.uniform(0.8, 1.2, (n, 1)),
        scales=random.uniform(0.01, 0.05, (n, 3)),
        quats=random.normal(size=(n, 4)),
        opacities=np.full(n, 0.95),
        sh=1.5 * random.normal(size=(n, 1, 3)),
    )
    folder.mkdir()
    for i in range(count):
        angle = 0.12 * i
        place = (3 * np.sin(angle), -0.3 * np.sin(2 * angle), -3 * np.cos(angle))
        write_png(folder / f"{i:03}.png", ball.render(Camera.look_at(place, (0, 0, 0), 320, 240)))
    return folder
