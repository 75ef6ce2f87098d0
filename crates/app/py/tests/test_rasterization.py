"""Drawing numpy arrays: values, modes, shapes and bad input."""

import warnings

import numpy as np
import pytest
from conftest import FIXTURES, read_tensors, scene

import splatweaver
from splatweaver import InputError, rasterization

FILES = sorted(FIXTURES.glob("*.safetensors"))


def test_a_ball_is_red_in_the_middle(lone):
    picture, alpha, meta = rasterization(**lone)
    assert picture.shape == (1, 3, 3, 3) and alpha.shape == (1, 3, 3, 1)
    np.testing.assert_allclose(picture[0, 1, 1], [0.8, 0.4, 0], atol=1e-12)
    np.testing.assert_allclose(meta["means2d"], [[[1.5, 1.5]]])
    assert meta["depths"].tolist() == [[2.0]] and (meta["width"], meta["height"], meta["n_cameras"]) == (3, 3, 1)
    assert meta["n_batches"] == 1 and meta["gaussian_ids"] is None and dict(meta).keys() == set(meta)
    # 3 sqrt(2.5^2 + 0.3), rounded up.
    assert meta["radii"].tolist() == [[[8, 8]]] and meta["radii"].dtype == np.int32


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_pictures_are_those_of_the_stored_reference(path, kind):
    tensors = read_tensors(path)
    degree = {1: 0, 4: 1, 9: 2, 16: 3}[tensors["in.sh"].shape[1]] if "in.sh" in tensors else None
    height, width = tensors["out.image"].shape[:2]
    picture, alpha, _ = rasterization(
        *(tensors[f"in.{name}"].astype(kind) for name in ("means", "quats", "scales", "opacities")),
        tensors["in.colors" if degree is None else "in.sh"].astype(kind),
        tensors["in.viewmat"].astype(kind).reshape(1, 4, 4),
        tensors["in.K"].astype(kind).reshape(1, 3, 3),
        width,
        height,
        sh_degree=degree,
        backgrounds=tensors["in.background"].astype(kind).reshape(1, 3),
        render_mode="RGB+D",
        rasterize_mode="antialiased" if "antialiased" in path.stem or "aa" in path.stem.split("_") else "classic",
        alpha_max=0.99,
    )
    safe = tensors["safe"].astype(bool).reshape(height, width)
    bar = 1e-6 if kind is np.float64 else 3e-5
    for name, found in (("image", picture[0, ..., :3]), ("alpha", alpha[0, ..., 0]), ("depth", picture[0, ..., 3])):
        expected = tensors[f"out.{name}"].reshape(found.shape)[safe]
        off = np.linalg.norm(found[safe] - expected) / max(np.linalg.norm(expected), 1e-3)
        assert off < bar, (name, off)


def test_the_reference_is_there():
    assert FILES


@pytest.mark.parametrize("degree", [None, 0, 1, 2, 3, 4])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_modes_are_parts_of_one_another(degree, kind):
    arguments = scene(1, degree=degree, kind=kind)
    drawn = {mode: rasterization(**arguments, render_mode=mode)[0] for mode in ("RGB", "D", "ED", "RGB+D", "RGB+ED")}
    alpha = rasterization(**arguments)[1]
    assert drawn["RGB"].dtype == kind
    np.testing.assert_array_equal(drawn["RGB+D"], np.concatenate([drawn["RGB"], drawn["D"]], -1))
    np.testing.assert_array_equal(drawn["RGB+ED"], np.concatenate([drawn["RGB"], drawn["ED"]], -1))
    np.testing.assert_allclose(drawn["ED"] * alpha, drawn["D"], rtol=1e-5)


@pytest.mark.parametrize("channels", [1, 2, 5, 17])
def test_colors_of_any_number_of_channels(channels):
    arguments = scene(2, channels=3)
    colors = np.random.default_rng(0).uniform(size=(12, channels))
    black = np.zeros((2, channels))
    picture, alpha, _ = rasterization(**{**arguments, "colors": colors, "backgrounds": black + 0.5})
    assert picture.shape == (2, 10, 12, channels)
    # Three channels are blended by the same weights.
    repeated = np.repeat(colors[:, :1], 3, 1)
    expected = rasterization(**{**arguments, "colors": repeated, "backgrounds": np.full((2, 3), 0.5)})[0]
    np.testing.assert_allclose(picture[..., 0], expected[..., 0], atol=1e-12)


def test_cameras_may_have_colors_of_their_own():
    arguments = scene(3)
    own = np.stack([arguments["colors"], 1 - arguments["colors"]])
    picture, alpha, meta = rasterization(**{**arguments, "colors": own})
    for c in range(2):
        one = {**arguments, "colors": own[c], **{k: arguments[k][c : c + 1] for k in ("viewmats", "Ks", "backgrounds")}}
        alone, alone_alpha, alone_meta = rasterization(**one)
        np.testing.assert_array_equal(picture[c], alone[0])
        np.testing.assert_array_equal(alpha[c], alone_alpha[0])
        for key in ("radii", "means2d", "depths"):
            np.testing.assert_array_equal(meta[key][c], alone_meta[key][0])


@pytest.mark.parametrize("batch", [(2,), (1, 3)])
def test_several_scenes_at_once(batch):
    count = int(np.prod(batch))
    scenes = [scene(seed) for seed in range(count)]
    arrays = {k: np.stack([s[k] for s in scenes]).reshape(*batch, *v.shape) for k, v in scenes[0].items() if hasattr(v, "shape")}
    picture, alpha, meta = rasterization(**arrays, width=12, height=10)
    assert picture.shape == (*batch, 2, 10, 12, 3) and meta["radii"].shape == (*batch, 2, 12, 2)
    for b, one in enumerate(scenes):
        alone = rasterization(**one)
        np.testing.assert_array_equal(picture.reshape(count, 2, 10, 12, 3)[b], alone[0])
        np.testing.assert_array_equal(meta["means2d"].reshape(count, 2, 12, 2)[b], alone[2]["means2d"])


def test_harmonics_beyond_the_degree_are_not_used():
    arguments = scene(4, degree=3)
    picture = rasterization(**{**arguments, "sh_degree": 1})[0]
    cut = rasterization(**{**arguments, "colors": arguments["colors"][:, :4], "sh_degree": 1})[0]
    np.testing.assert_array_equal(picture, cut)


def test_no_gaussians_leave_the_background():
    picture, alpha, meta = rasterization(**scene(5, n=0))
    assert (alpha == 0).all() and meta["radii"].shape == (2, 0, 2)
    np.testing.assert_array_equal(picture[1, 0, 0], scene(5, n=0)["backgrounds"][1])


def test_gaussians_with_numbers_that_are_not_finite_are_left_out():
    arguments = scene(6)
    arguments["means"][3, 1] = np.nan
    picture, _, meta = rasterization(**arguments)
    kept = np.arange(12) != 3
    parts = {name: arguments[name][kept] for name in ("means", "quats", "scales", "opacities", "colors")}
    np.testing.assert_array_equal(picture, rasterization(**{**arguments, **parts})[0])
    assert (meta["radii"][:, 3] == 0).all()


def test_arrays_may_be_strided_and_lists_integer():
    arguments = scene(7)
    strided = {**arguments, "means": np.asfortranarray(arguments["means"]), "colors": arguments["colors"][::-1][::-1]}
    np.testing.assert_array_equal(rasterization(**arguments)[0], rasterization(**strided)[0])
    listed = {**arguments, "viewmats": [[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]] * 2}
    assert rasterization(**listed)[0].shape == (2, 10, 12, 3)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"means": np.zeros((12, 2))}, r"means: expected \[12, 3\], found \[12, 2\]"),
        ({"quats": np.zeros((11, 4))}, r"quats: expected \[12, 4\], found \[11, 4\]"),
        ({"scales": np.zeros(12)}, r"scales: expected \[12, 3\], found \[12\]"),
        ({"opacities": np.zeros((12, 1))}, r"opacities: expected \[12\], found \[12, 1\]"),
        ({"colors": np.zeros((5, 3))}, r"colors: expected \[12, D\] or \[2, 12, D\], found \[5, 3\]"),
        ({"colors": np.zeros((12, 0))}, r"colors: expected"),
        ({"colors": np.zeros((12, 3, 3)), "sh_degree": 1}, r"colors: expected .*K of at least 4, 3\], found \[12, 3, 3\]"),
        ({"sh_degree": 5}, "sh_degree: expected 0 to 4, found 5"),
        ({"viewmats": np.zeros((0, 4, 4))}, "viewmats: expected .* at least one camera"),
        ({"viewmats": np.zeros((2, 3, 4))}, r"viewmats: expected \[2, 4, 4\], found \[2, 3, 4\]"),
        ({"Ks": np.zeros((1, 3, 3))}, r"Ks: expected \[2, 3, 3\], found \[1, 3, 3\]"),
        ({"backgrounds": np.zeros((2, 4))}, r"backgrounds: expected \[2, 3\], found \[2, 4\]"),
        ({"backgrounds": np.full((2, 3), np.nan)}, "background holds a number that is not finite"),
        ({"means": np.zeros((12, 3), np.float16)}, "means: expected float32 or float64, found float16"),
        ({"scales": np.zeros((12, 3), np.float32)}, "scales: expected float64, the number type of means, found float32"),
        ({"width": 0}, "width: expected 1 to 1048576 pixels, found 0"),
        ({"height": "x"}, "height: expected a number of pixels, found 'x'"),
        ({"width": 1 << 20, "height": 1 << 20}, "memory: expected"),
        ({"render_mode": "RGBD"}, "render_mode: expected one of"),
        ({"rasterize_mode": "fast"}, "rasterize_mode: expected"),
        ({"means": np.float64(3)}, "means: expected"),
        ({"near_plane": np.nan}, "near: expected a number, found NaN"),
        ({"far_plane": np.nan}, "far: expected a number, or infinity, found NaN"),
        ({"eps2d": -1}, "eps2d: expected a number of at least 0, found -1"),
        ({"alpha_max": 2}, "alpha_max: expected a number above 0 and at most 1, found 2"),
    ],
)
# Promise of `test_rules_that_mean_nothing_are_named`.
def test_bad_input_is_named(change, message):
    with pytest.raises(splatweaver.Error, match=message) as caught:
        rasterization(**{**scene(8), **change})
    assert isinstance(caught.value, (InputError, splatweaver.MemoryPlanError))


def test_arguments_that_are_not_there_are_named():
    for name, value in {"camera_model": "fisheye", "covars": 1, "with_ut": True, "sparse_grad": True}.items():
        with pytest.raises(NotImplementedError, match=name):
            rasterization(**scene(9), **{name: value})
    with pytest.raises(TypeError, match="nonsense"):
        rasterization(**scene(9), nonsense=1)
    # Values that ask for nothing.
    rasterization(**scene(9), camera_model="pinhole", covars=None, with_ut=False, segmented=False)


def test_arguments_without_a_meaning_are_ignored_with_one_warning():
    with pytest.warns(UserWarning, match="ignored: packed, tile_size"):
        rasterization(**scene(10), packed=True, tile_size=8)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rasterization(**scene(10), packed=True, tile_size=8)
