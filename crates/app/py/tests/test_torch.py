"""Drawing tensors: gradients of every input, and what training does with them."""

import threading

import numpy as np
import pytest
from conftest import FIXTURES, read_tensors, scene

torch = pytest.importorskip("torch", reason="skipped: no torch")

from splatweaver import InputError, rasterization  # noqa: E402

INPUTS = ("means", "quats", "scales", "opacities", "colors", "viewmats", "Ks", "backgrounds")


def tensors(arguments, wanted=INPUTS):
    return {
        name: torch.from_numpy(value.copy()).requires_grad_(name in wanted) if isinstance(value, np.ndarray) else value
        for name, value in arguments.items()
    }


def gradcheck(arguments, mode="RGB+D", **settings):
    given = tensors(arguments)
    names = [name for name in INPUTS if name in given]

    def draw(*inputs):
        picture, alpha, _ = rasterization(**{**given, **dict(zip(names, inputs))}, render_mode=mode, **settings)
        return picture, alpha

    # Rows that are not read have gradients of zero on both sides.
    return torch.autograd.gradcheck(draw, [given[name] for name in names], eps=1e-6, atol=2e-5, rtol=1e-3, nondet_tol=0.0)


@pytest.mark.parametrize("mode", ["classic", "antialiased"])
@pytest.mark.parametrize("seed, n, degree", [(0, 1, None), (1, 4, 1), (2, 9, None), (3, 6, 3), (4, 50, None)])
def test_gradients_of_every_input(seed, n, degree, mode):
    arguments = scene(seed, n=n, degree=degree, cameras=1 if n == 50 else 2)
    if n == 50:
        # Thin enough that no pixel ends early, which is a step.
        arguments["opacities"] = arguments["opacities"] * 0.1
        arguments["width"], arguments["height"] = 8, 6
    # No Gaussian begins or ends within the picture.
    arguments["scales"] = arguments["scales"] + 1.5
    assert gradcheck(arguments, rasterize_mode=mode)


@pytest.mark.parametrize("mode", ["RGB", "D", "ED", "RGB+ED"])
def test_gradients_of_every_mode(mode):
    arguments = scene(5, n=4)
    arguments["scales"] = arguments["scales"] + 1.5
    if "RGB" not in mode:
        arguments["colors"] = arguments["colors"]
        given = tensors(arguments, ("means", "quats", "scales", "opacities", "viewmats", "Ks"))
        picture, alpha, _ = rasterization(**given, render_mode=mode)
        picture.square().sum().backward()
        assert given["means"].grad.abs().sum() > 0
    else:
        assert gradcheck(arguments, mode)


def test_gradients_of_features_and_of_colors_of_cameras():
    arguments = scene(6, n=4, channels=5)
    arguments["scales"] = arguments["scales"] + 1.5
    assert gradcheck(arguments)
    own = scene(7, n=4)
    own["scales"] = own["scales"] + 1.5
    own["colors"] = np.stack([own["colors"], 1 - own["colors"]])
    assert gradcheck(own)


@pytest.mark.parametrize("path", sorted(FIXTURES.glob("*.safetensors")), ids=lambda path: path.stem)
def test_gradients_are_those_of_the_stored_reference(path):
    stored = read_tensors(path)
    degree = {1: 0, 4: 1, 9: 2, 16: 3}[stored["in.sh"].shape[1]] if "in.sh" in stored else None
    color = "colors" if degree is None else "sh"
    names = ["means", "quats", "scales", "opacities", color, "viewmat", "K", "background"]
    given = {name: torch.from_numpy(stored[f"in.{name}"].astype(np.float64)).requires_grad_() for name in names}
    height, width = stored["out.image"].shape[:2]
    picture, alpha, _ = rasterization(
        *(given[name] for name in names[:5]),
        given["viewmat"].reshape(1, 4, 4),
        given["K"].reshape(1, 3, 3),
        width,
        height,
        sh_degree=degree,
        backgrounds=given["background"].reshape(1, 3),
        render_mode="RGB+D",
        rasterize_mode="antialiased" if "antialiased" in path.stem or "aa" in path.stem.split("_") else "classic",
        alpha_max=0.99,
    )
    cotangents = {name: torch.from_numpy(stored[f"cot.{name}"].astype(np.float64)) for name in ("image", "alpha", "depth")}
    loss = (picture[0, ..., :3] * cotangents["image"].reshape(height, width, 3)).sum()
    loss = loss + (alpha[0, ..., 0] * cotangents["alpha"].reshape(height, width)).sum()
    loss = loss + (picture[0, ..., 3] * cotangents["depth"].reshape(height, width)).sum()
    loss.backward()
    compared = 0
    for name in names:
        if f"grad.{name}" in stored:
            expected = torch.from_numpy(stored[f"grad.{name}"].astype(np.float64)).reshape(given[name].shape)
            found = given[name].grad
            if name == "viewmat":
                expected, found = expected.reshape(4, 4)[:3], found.reshape(4, 4)[:3]
            if name == "K":
                places = ([0, 1, 0, 1], [0, 1, 2, 2])
                expected, found = expected.reshape(3, 3)[places], found.reshape(3, 3)[places]
            assert torch.linalg.norm(found - expected) < 1e-6 * max(torch.linalg.norm(expected).item(), 1e-3), name
            compared += 1
    assert compared >= 7


def test_single_precision_is_near_double():
    arguments = scene(8, degree=2)
    found = {}
    for kind in (np.float32, np.float64):
        given = tensors({k: v.astype(kind) if isinstance(v, np.ndarray) else v for k, v in arguments.items()})
        picture, _, _ = rasterization(**given)
        assert picture.dtype == given["means"].dtype
        picture.square().sum().backward()
        found[kind] = {name: given[name].grad.double() for name in INPUTS}
    for name in INPUTS:
        off = (found[np.float32][name] - found[np.float64][name]).norm() / found[np.float64][name].norm()
        assert off < 1e-4, (name, off)


@pytest.mark.parametrize("shared", [True, False])
def test_screen_gradients_arrive_in_meta(shared):
    arguments = scene(9, n=6)
    if not shared:
        arguments["colors"] = np.stack([arguments["colors"]] * 2)
    given = tensors(arguments)
    picture, _, meta = rasterization(**given, absgrad=True)
    means2d = meta["means2d"]
    means2d.retain_grad()
    weights = torch.linspace(-1, 1, picture.numel(), dtype=torch.float64).reshape(picture.shape)
    (picture * weights).sum().backward()
    assert means2d.grad.shape == means2d.absgrad.shape == (2, 6, 2)
    assert (means2d.absgrad >= means2d.grad.abs() - 1e-12).all() and means2d.absgrad.sum() > 0
    # Moving all means on the image by a pixel is moving the principal point.
    moved = torch.stack([given["Ks"].grad[:, 0, 2], given["Ks"].grad[:, 1, 2]], -1)
    torch.testing.assert_close(means2d.grad.sum(1), moved)
    # Arrays of numpy hold the same numbers.
    plain = rasterization(**arguments)[2]
    for key in ("means2d", "depths", "radii"):
        np.testing.assert_array_equal(meta[key].detach().numpy(), plain[key])


@pytest.mark.parametrize("shared", [True, False])
def test_screen_gradients_are_there_whenever_they_are_asked_for(shared):
    def passes(ask):
        arguments = scene(14, n=5)
        if not shared:
            arguments["colors"] = np.stack([arguments["colors"], 1 - arguments["colors"]])
        picture, _, meta = rasterization(**tensors(arguments))
        for step in range(3):
            if ask == step:
                meta["means2d"]
            (picture[step % 2] ** (step + 1)).sum().backward(retain_graph=True)
        return meta["means2d"].grad

    expected = passes(0)
    assert expected.abs().sum() > 0
    for ask in (1, 2, 3):
        torch.testing.assert_close(passes(ask), expected)


def test_several_scenes_at_once_have_gradients():
    scenes = [scene(seed, n=3) for seed in (20, 21)]
    stacked = {k: np.stack([s[k] for s in scenes]) for k, v in scenes[0].items() if isinstance(v, np.ndarray)}
    given = tensors({**scenes[0], **stacked})
    picture, _, meta = rasterization(**given, absgrad=True)
    picture.square().sum().backward()
    for b, one in enumerate(scenes):
        alone = tensors(one)
        drawn, _, own = rasterization(**alone, absgrad=True)
        drawn.square().sum().backward()
        torch.testing.assert_close(given["means"].grad[b], alone["means"].grad)
        torch.testing.assert_close(meta["means2d"].grad[b], own["means2d"].grad)
        torch.testing.assert_close(meta["means2d"].absgrad[b], own["means2d"].absgrad)


def test_several_backward_passes_add_up_and_numbers_must_not_change_in_between():
    given = tensors(scene(10))
    picture, _, meta = rasterization(**given, absgrad=True)
    picture.sum().backward(retain_graph=True)
    first, absolute = given["means"].grad.clone(), meta["means2d"].absgrad.clone()
    picture.sum().backward(retain_graph=True)
    torch.testing.assert_close(given["means"].grad, 2 * first)
    torch.testing.assert_close(meta["means2d"].absgrad, 2 * absolute)
    with torch.no_grad():
        given["means"] += 1
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        picture.sum().backward()


def test_nothing_is_kept_where_nothing_is_differentiated():
    given = tensors(scene(11), ())
    picture, alpha, meta = rasterization(**given)
    assert not picture.requires_grad and not meta["means2d"].requires_grad
    with torch.no_grad():
        assert not rasterization(**tensors(scene(11)))[0].requires_grad
    np.testing.assert_array_equal(picture.numpy(), rasterization(**scene(11))[0])


def test_bad_tensors_are_named():
    given = tensors(scene(12))
    with pytest.raises(InputError, match="means: expected float32 or float64, found float16"):
        rasterization(**{**given, "means": given["means"].half()})
    with pytest.raises(InputError, match="quats: expected float64, the number type of means, found float32"):
        rasterization(**{**given, "quats": given["quats"].float()})
    with pytest.raises(InputError, match=r"means: expected a tensor on the CPU, found one on meta"):
        rasterization(**{**given, "means": given["means"].to("meta")})
    with pytest.raises(InputError, match=r"scales: expected \[12, 3\], found \[12\]"):
        rasterization(**{**given, "scales": given["scales"][:, 0]})
    picture = rasterization(**given)[0]
    (gradient,) = torch.autograd.grad(picture.square().sum(), given["means"], create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        gradient.sum().backward()


def test_strided_tensors_are_copied():
    arguments = scene(13)
    given = tensors(arguments)
    turned = given["means"].detach().T.contiguous().T.requires_grad_()
    assert not turned.is_contiguous()
    rasterization(**given)[0].sum().backward()
    rasterization(**{**given, "means": turned})[0].sum().backward()
    torch.testing.assert_close(turned.grad, given["means"].grad)


def test_no_gaussians_have_gradients_all_the_same():
    given = tensors(scene(15, n=0))
    picture, _, meta = rasterization(**given)
    picture.sum().backward()
    assert given["means"].grad.shape == (0, 3) and meta["means2d"].grad.shape == (2, 0, 2)
    assert (given["backgrounds"].grad == 120).all() and (given["viewmats"].grad == 0).all()


def test_two_threads_differentiate_at_once():
    def gradient(seed):
        given = tensors(scene(seed, n=50))
        rasterization(**given)[0].square().sum().backward()
        return given["means"].grad

    expected = [gradient(seed) for seed in (16, 17)]
    wrong = []

    def work(which):
        for _ in range(10):
            if not torch.equal(gradient(16 + which), expected[which]):
                wrong.append(which)

    threads = [threading.Thread(target=work, args=(which,)) for which in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
