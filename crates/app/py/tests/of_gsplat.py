"""Runs gsplat's own tests on this package: python of_gsplat.py GSPLAT [ARGUMENTS OF PYTEST].

GSPLAT is the unpacked source of gsplat 1.5.3. Its `rasterization` is ours; its references in torch stay, with stand-ins below for
what they call of its CUDA library. Needs torch, pytest, rich, typing_extensions.
"""

import math
import sys
import tempfile
import types
from pathlib import Path

import pytest
import torch

import splatweaver

#: Tests of what calls `rasterization`; the others are of functions that are not there.
TESTS = ["test_rasterization.py", "test_strategy.py"]
#: Transmittance at which a pixel ends, and least alpha of a Gaussian.
END, LEAST = 1e-4, 1 / 255
#: Gaussians that are blended at once.
CHUNK = 16


def in_order(means2d, radii, depths, tile_size, tile_width, tile_height, **others):
    """In place of the lists of tiles: the Gaussians of each image from front to back, those that are not seen at the end."""
    unseen = (radii <= 0).any(-1)
    return None, None, depths.masked_fill(unseen, math.inf).argsort(-1)


def no_offsets(ids, images, tile_width, tile_height):
    return torch.zeros(images, tile_height, tile_width)


def blended(means2d, conics, colors, opacities, width, height, tile_size, offsets, order, backgrounds=None, batch_per_iter=100):
    """Blends all Gaussians at all pixels, image by image."""
    front = means2d.shape[:-2]
    flat = (means2d, conics, colors, opacities, order)
    flat = [array.reshape(-1, *array.shape[len(front) :]) for array in flat]
    rows, columns = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    pixels = torch.stack([columns, rows], -1).reshape(-1, 2)
    drawn = [one_blended(pixels, *image) for image in zip(*flat)]
    picture = torch.stack([picture for picture, _ in drawn]).reshape(*front, height, width, -1)
    alpha = 1 - torch.stack([left for _, left in drawn]).reshape(*front, height, width, 1)
    if backgrounds is not None:
        picture = picture + (1 - alpha) * backgrounds[..., None, None, :]
    return picture, alpha


def one_blended(pixels, means2d, conics, colors, opacities, order):
    """Colors and transmittances of the pixels."""
    left = torch.ones(len(pixels))
    picture = torch.zeros(len(pixels), colors.shape[-1])
    open_ones = torch.arange(len(pixels))
    for ids in order.split(CHUNK):
        off = pixels[open_ones, None] - means2d[ids]
        a, b, c = conics[ids].unbind(-1)
        power = 0.5 * (a * off[..., 0] ** 2 + c * off[..., 1] ** 2) + b * off[..., 0] * off[..., 1]
        alphas = (opacities[ids] * torch.exp(-power)).clamp(max=0.999)
        alphas = alphas.masked_fill((power < 0) | (alphas < LEAST) | ~torch.isfinite(alphas), 0)
        through = left[open_ones, None] * (1 - alphas).cumprod(-1)
        # The Gaussian that would end a pixel is not drawn, nor is any behind it.
        drawn = through > END
        before = torch.cat([left[open_ones, None], through[:, :-1]], -1)
        picture[open_ones] += torch.where(drawn, alphas * before, 0) @ colors[ids]
        left[open_ones] = torch.where(drawn, through, math.inf).amin(-1).minimum(left[open_ones])
        open_ones = open_ones[drawn.all(-1)]
        if len(open_ones) == 0:
            break
    return picture, left


def relocation(opacities, scales, ratios, binoms):
    """Opacities and scales of copies that look like the one Gaussian they are made from (3DGS-MCMC, equation 9)."""
    ratios = ratios.clamp(1, binoms.shape[0]).long()
    new = 1 - (1 - opacities) ** (1 / ratios)
    factors = []
    for opacity, copy, ratio in zip(opacities, new, ratios.tolist()):
        terms = (
            binoms[i - 1, k] * (-1) ** k / math.sqrt(k + 1) * copy ** (k + 1) for i in range(1, ratio + 1) for k in range(i)
        )
        factors.append(opacity / sum(terms))
    return new, scales * torch.stack(factors)[:, None]


def install(source):
    """Makes `gsplat` the package in this folder, over ours."""
    sys.path.insert(0, str(source))
    backend = types.ModuleType("gsplat.cuda._backend")
    backend._C = None
    sys.modules[backend.__name__] = backend
    import gsplat
    from gsplat.cuda import _torch_impl

    rendering = sys.modules["gsplat.rendering"]
    gsplat.rasterization = rendering.rasterization = splatweaver.rasterization
    rendering.isect_tiles, rendering.isect_offset_encode = in_order, no_offsets
    rendering.spherical_harmonics = lambda degree, dirs, coeffs, masks=None: _torch_impl._spherical_harmonics(
        degree, dirs, coeffs
    )
    _torch_impl._rasterize_to_pixels = blended
    ops = sys.modules["gsplat.strategy.ops"]
    ops.compute_relocation = relocation
    ops.quat_scale_to_covar_preci = _torch_impl._quat_scale_to_covar_preci


def main(source, *arguments):
    install(Path(source).resolve())
    with tempfile.TemporaryDirectory() as folder:
        for name in TESTS:
            text = (Path(source) / "tests" / name).read_text(encoding="utf-8")
            text = text.replace('"cuda:0"', '"cpu"').replace("not torch.cuda.is_available()", "False")
            Path(folder, name).write_text(text, encoding="utf-8")
        return pytest.main(["-q", "-p", "no:cacheprovider", "--rootdir", folder, *arguments, folder])


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
