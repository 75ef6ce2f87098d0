"""Scenes, cameras, and their files."""

import numpy as np
import pytest
from capture import around, random_scene

import splatweaver
from splatweaver import Camera, Cameras, FileError, InputError, Scene, formats, rasterization


def test_every_format_keeps_what_it_promises(tmp_path):
    scene = random_scene()
    written = 0
    for format in formats():
        # A scene of SOG may be a folder with this file.
        path = tmp_path / (f"scene{format.suffix}" if format.suffix.startswith(".") else format.suffix)
        try:
            scene.save(path)
        except FileError as error:
            # Formats that are read only say so.
            assert "written" in str(error) or "read" in str(error), error
            continue
        back = Scene.load(path)
        assert len(back) == len(scene), format
        # Formats may sort their Gaussians.
        np.testing.assert_allclose(np.sort(back.means[:, 0]), np.sort(scene.means[:, 0]), atol=0.02)
        written += 1
    assert written >= 7
    back = Scene.load(tmp_path / "scene.ply")
    for field in ("means", "log_scales", "quats", "opacity_logits", "sh"):
        np.testing.assert_array_equal(getattr(back, field), getattr(scene, field))


def test_stored_and_activated_forms_belong_together():
    scene = random_scene()
    np.testing.assert_allclose(scene.scales, np.exp(scene.log_scales), rtol=1e-6)
    np.testing.assert_allclose(scene.opacities, 1 / (1 + np.exp(-scene.opacity_logits)), rtol=1e-6)
    assert scene.means.dtype == np.float32 and scene.sh.shape == (200, 4, 3) and scene.degree == 1
    again = Scene(scene.means, scene.log_scales, scene.quats, scene.opacity_logits, scene.sh)
    np.testing.assert_array_equal(again.sh, scene.sh)


def test_a_picture_is_what_rasterization_draws():
    scene, cameras = random_scene(), around(2)
    pictures = scene.render(cameras, background=(0.2, 0.4, 0.6))
    drawn, _, _ = rasterization(
        scene.means,
        scene.quats,
        scene.scales,
        scene.opacities,
        scene.sh,
        cameras.viewmats.astype(np.float32),
        cameras.Ks.astype(np.float32),
        48,
        36,
        sh_degree=1,
        backgrounds=np.tile(np.float32([0.2, 0.4, 0.6]), (2, 1)),
        alpha_max=0.99,
    )
    np.testing.assert_array_equal(np.stack(pictures), drawn)
    np.testing.assert_array_equal(scene.render(cameras[0], background=(0.2, 0.4, 0.6)), drawn[0])


def test_a_turned_scene_looks_the_same_from_turned_cameras():
    scene, cameras = random_scene(degree=2), around(1)
    angle = 0.7
    rotation = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    translation, scale = np.array([1.0, -2, 0.5]), 1.7
    turned = scene.transform(scale, rotation, translation)
    viewmat = np.eye(4)
    viewmat[:3, :3] = cameras[0].viewmat[:3, :3] @ rotation.T
    viewmat[:3, 3] = scale * cameras[0].viewmat[:3, 3] - viewmat[:3, :3] @ translation
    moved = Camera(viewmat, cameras[0].K, 48, 36)
    np.testing.assert_allclose(turned.render(moved), scene.render(cameras[0]), atol=2e-3)


def test_scenes_are_cropped_merged_and_brought_to_other_degrees():
    scene = random_scene()
    left = scene.crop(min=(-9, -9, -9), max=(0, 9, 9))
    right = scene.crop(min=(0, -9, -9), max=(9, 9, 9))
    assert len(left) + len(right) == len(scene) and (left.means[:, 0] <= 0).all()
    assert len(left.merge(right)) == len(scene)
    near = scene.crop(center=(0, 0, 0), radius=0.5)
    assert (np.linalg.norm(near.means, axis=1) <= 0.5).all()
    assert scene.to(degree=0).sh.shape == (200, 1, 3) and scene.to(degree=3).sh.shape == (200, 16, 3)
    assert scene.to(degree=0).merge(scene).degree == 1


def test_cameras_survive_their_file(tmp_path):
    cameras = around(5)
    cameras.save(tmp_path / "transforms.json")
    back = Cameras.load(tmp_path / "transforms.json")
    np.testing.assert_allclose(back.viewmats, cameras.viewmats, atol=1e-12)
    np.testing.assert_allclose(back.Ks, cameras.Ks)
    assert [c.name for c in back] == [c.name for c in cameras] and len(back[1:3]) == 2
    assert not back[0].distorted and back[0].undistorted().width == 48
    half = back[0].resized(24, 18)
    np.testing.assert_allclose(half.K[:2], back[0].K[:2] / 2)


def test_a_scene_shows_itself(tmp_path):
    view = random_scene().show(around(2), height=300)
    frame = view._repr_html_()
    assert frame.startswith("<iframe srcdoc=") and "300px" in frame and frame.count('"') == 4
    view.save(tmp_path / "scene.html")
    assert (tmp_path / "scene.html").read_text(encoding="utf-8") == view.page and "<script" in view.page


def test_bad_input_is_named(tmp_path):
    scene = random_scene()
    with pytest.raises(FileError, match="nothing.ply"):
        Scene.load(tmp_path / "nothing.ply")
    with pytest.raises(OSError):
        Cameras.load(tmp_path / "nothing.json")
    (tmp_path / "bad.ply").write_bytes(b"ply\nformat nonsense\n")
    with pytest.raises(FileError, match="bad.ply: .*expected .*found"):
        Scene.load(tmp_path / "bad.ply")
    with pytest.raises(FileError, match="scene.xyz"):
        scene.save(tmp_path / "scene.xyz")
    with pytest.raises(FileError, match="expected a name that ends with .json"):
        around(1).save(tmp_path / "cameras.txt")
    with pytest.raises(InputError, match=r"log_scales: expected \[200, 3\], found \[200, 2\]"):
        Scene(scene.means, scene.log_scales[:, :2], scene.quats, scene.opacity_logits, scene.sh)
    with pytest.raises(InputError, match="sh: expected"):
        Scene(scene.means, scene.log_scales, scene.quats, scene.opacity_logits, scene.sh[:, :3])
    with pytest.raises(InputError, match="degree: expected 0 to 4, found 5"):
        scene.to(degree=5)
    with pytest.raises(InputError, match="rotation: expected an orthogonal matrix"):
        scene.transform(rotation=np.ones((3, 3)))
    with pytest.raises(InputError, match="scale: expected a positive number, found -1"):
        scene.transform(scale=-1)
    with pytest.raises(InputError, match="crop: expected"):
        scene.crop(min=(0, 0, 0), radius=1)
    with pytest.raises(InputError, match="viewmat"):
        Camera(2 * np.eye(4), np.eye(3), 4, 4)
    with pytest.raises(InputError, match=r"K: expected \[3, 3\], found \[4, 4\]"):
        Camera(np.eye(4), np.eye(4), 4, 4)
    with pytest.raises(InputError, match="K: expected positive focal lengths"):
        Camera(np.eye(4), -np.eye(3), 4, 4)
    with pytest.raises(InputError, match="width, height: expected 1 to 1048576 pixels, found 0 x 4"):
        Camera(np.eye(4), np.eye(3), 0, 4)
    with pytest.raises(InputError, match="background: expected three numbers, found 4"):
        scene.render(around(1)[0], background=(0, 0, 0, 0))
    with pytest.raises(FileError, match="expected a folder with"):
        splatweaver.open_run(tmp_path)


# Promise (servers): pictures that memory has no place for, and sizes beyond 2^20, are refused by Python's `render`,
# `Camera` and `resized`.
def test_pictures_without_place_are_refused():
    camera = around(1)[0]
    with pytest.raises(splatweaver.MemoryPlanError, match="memory: expected"):
        random_scene().render(camera.resized(1 << 20, 1 << 20))
    with pytest.raises(InputError, match="width, height: expected 1 to 1048576 pixels, found 1099511627776 x 4"):
        camera.resized(1 << 40, 4)
    with pytest.raises(InputError, match="width, height: expected 1 to 1048576 pixels"):
        Camera(camera.viewmat, camera.K, 1 << 40, 1 << 40)


@pytest.mark.parametrize(
    "rule, message",
    [
        ({"near": np.nan}, "near: expected a number, found NaN"),
        ({"alpha_max": np.nan}, "alpha_max: expected a number above 0 and at most 1, found NaN"),
        ({"alpha_max": 0}, "alpha_max: expected a number above 0 and at most 1, found 0"),
        ({"alpha_max": 7.5}, "alpha_max: expected a number above 0 and at most 1, found 7.5"),
    ],
)
# Promise (servers): rules of drawing that mean nothing are named.
def test_rules_that_mean_nothing_are_named(rule, message):
    with pytest.raises(InputError, match=message):
        random_scene().render(around(1)[0], **rule)


# Promise (servers): no step moves a scene out of all numbers.
def test_no_step_moves_a_scene_out_of_all_numbers():
    with pytest.raises(InputError, match="translation: expected finite numbers"):
        random_scene().transform(translation=(0, np.nan, 0))


# Promise (servers): a page replaces no file of another kind.
def test_a_page_replaces_no_file_of_another_kind(tmp_path):
    photo = tmp_path / "photo.jpg"
    photo.write_bytes(b"pixels")
    with pytest.raises(FileError, match="photo.jpg: expected a name that ends with .html"):
        random_scene().show().save(photo)
    assert photo.read_bytes() == b"pixels"
