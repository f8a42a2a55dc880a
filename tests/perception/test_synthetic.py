"""The renderer against what a camera would see, and its truth against its pictures."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pieper.errors import ArrayError, PieperError, VisionError
from pieper.perception import scene as scenes
from pieper.perception import scene_presets
from pieper.perception import truth as truths
from pieper.perception.scene import COLORS, Ball, Bar, Circle, Effects, Marker, Model, Robot, Scene, Straight, Sway
from pieper.perception.scene_presets import PRESETS
from pieper.perception.synthetic import Renderer

CENTRE = 0.005  # px; what 8 bits leave of the centre of a disc of 11 px
DISC = Model("disc", (Marker("red", 0.0, 0.0, 0.033),), radius=0.05, height=0.05)


def alone(x=0.0, y=0.0, *, model=DISC, view=None, **changes):
    """One robot that stands still, and nothing else in its way."""
    view = view or scenes.overhead()
    motion = Straight((x, y), heading=0.4)
    return Scene("one", view, (Robot("it", model, motion),), frames=3).but(**changes)


def weight(image, paint, around):
    """How much of each pixel shows a paint that lies on another one: from the colours themselves."""
    paint, around = np.array(paint), np.array(around)
    along = paint - around
    return np.clip((image.astype(float) - around) @ along / (along @ along), 0, 1)


def centroid(image, centre, reach=16):
    u, v = np.rint(centre).astype(int)
    part = image[v - reach : v + reach + 1, u - reach : u + reach + 1]
    share = weight(part, COLORS["red"], DISC.paint)
    rows, columns = np.mgrid[v - reach : v + reach + 1, u - reach : u + reach + 1]
    inside = np.hypot(rows - centre[1], columns - centre[0]) < 13.5
    share = share * inside
    return np.array([(share * columns).sum(), (share * rows).sum()]) / share.sum()


@settings(max_examples=25, deadline=None)
@given(st.floats(-0.5, 0.5), st.floats(-0.4, 0.4))
def test_the_centre_in_the_picture_is_the_true_one(x, y):
    frame, truth = Renderer(alone(x, y))[0]
    image = truth.objects[0].markers[0].image
    assert centroid(frame.image, image) == pytest.approx(image, abs=CENTRE)


def test_motion_blur_leaves_the_centre_where_it_is_in_mid_exposure():
    motion = Straight((-0.2, 0.1), velocity=(1.5, -0.7))
    scene = alone().but(things=(Robot("it", DISC, motion),), frames=12, exposure=1 / 200)
    frame, truth = Renderer(scene)[10]
    image = truth.objects[0].markers[0].image
    assert truth.objects[0].position == pytest.approx([-0.2 + 1.5 / 6, 0.1 - 0.7 / 6])
    sharp = Renderer(scene.but(exposure=0.0))[10][0].image
    assert np.abs(frame.image.astype(int) - sharp).max() > 40
    assert centroid(frame.image, image) == pytest.approx(image, abs=4 * CENTRE)  # eight steps, each rounded by pixels


def test_the_truth_is_the_projection_of_the_marker_through_lens_and_perspective():
    import cv2

    scene = scene_presets.preset("lens")
    view = scene.view
    truth = Renderer(scene).truth(40)
    for thing, known in zip(truth.objects, scene.things, strict=True):
        if isinstance(known, Ball):
            continue
        c, s = np.cos(thing.heading), np.sin(thing.heading)
        local = np.array([[m.x, m.y] for m in known.model.markers])
        places = local @ np.array([[c, s], [-s, c]]) + thing.position
        points = np.column_stack([places, np.full(len(places), known.model.height)])
        rotation, shift = cv2.Rodrigues(view.T_camera_field[:3, :3])[0], view.T_camera_field[:3, 3]
        pixels, _ = cv2.projectPoints(points, rotation, shift, view.camera.matrix, view.camera.distortion)
        assert np.array([m.image for m in thing.markers]) == pytest.approx(pixels[:, 0], abs=1e-8)


def test_a_robot_is_drawn_where_its_height_puts_it():
    tall = Model("tall", DISC.markers, radius=0.05, height=0.3)
    for model in (DISC, tall):
        frame, truth = Renderer(alone(0.5, 0.0, model=model))[0]
        image = truth.objects[0].markers[0].image
        assert image == pytest.approx([319.5 + 0.5 * (2 / 0.003) / (2 - model.height), 239.5])
        assert frame.image[240, round(image[0])] == pytest.approx(
            np.array(COLORS["red"]), abs=6
        )  # the carpet has no say


@pytest.mark.parametrize("motion", [
    Straight((0.1, 0.2), heading=3.0, velocity=(0.3, -0.2), turn_rate=2.0),
    Circle((0.1, 0.0), 0.3, -1.7, 0.4),
    Sway((0.0, 0.1), (0.3, 0.2), (2.0, 3.0), (0.1, 0.7), 1.0, 0.5),
])  # fmt: skip
def test_velocities_are_the_derivatives_of_places(motion):
    h = 1e-6
    for t in (0.0, 0.37, 5.1):
        before, now, after = motion(t - h), motion(t), motion(t + h)
        assert (after.x - before.x) / (2 * h) == pytest.approx(now.vx, abs=1e-8)
        assert (after.y - before.y) / (2 * h) == pytest.approx(now.vy, abs=1e-8)
        assert (after.heading - before.heading) / (2 * h) == pytest.approx(now.turn_rate, abs=1e-8)


def test_the_same_scene_gives_the_same_pixels_in_any_order():
    scene = scene_presets.preset("noise").but(frames=4)
    forwards = [frame.image for frame, _ in Renderer(scene)]
    renderer = Renderer(scene)
    for index in (3, 0, 2):
        assert np.array_equal(renderer[index][0].image, forwards[index])
    assert not np.array_equal(Renderer(scene.but(seed=2))[0][0].image, forwards[0])


def test_noise_has_the_deviation_that_was_asked_for():
    clean, noisy = (Renderer(alone(noise=sigma))[1][0].image.astype(float) for sigma in (0.0, 6.0))
    assert (noisy - clean).std() == pytest.approx(6.0, rel=0.01)  # 900 000 samples; rounding adds 0.3 %


def test_light_goes_evenly_from_first_to_last_frame_and_the_cast_with_it():
    things = scene_presets.preset("clean").but(frames=3, light=(1.0, 0.4), cast=(0.0, 0.15))
    first, middle, last = (frame.image.reshape(-1, 3).mean(axis=0) for frame, _ in Renderer(things))
    plain = Renderer(things.but(light=(1.0, 1.0), cast=(0.0, 0.0)))
    for mean, light, cast, k in ((first, 1.0, 0.0, 0), (middle, 0.7, 0.075, 1), (last, 0.4, 0.15, 2)):
        white = plain[k][0].image.reshape(-1, 3).mean(axis=0)
        assert mean / white == pytest.approx(
            light * np.array([1 - cast, 1, 1 + cast]), rel=0.02
        )  # 8 bits of a dark carpet


def test_shadow_gradient_and_compression_change_the_picture():
    plain = Renderer(alone())[0][0].image.astype(int)
    dark = Renderer(alone(shadow=0.5))[0][0].image
    assert dark[:, 600].mean() == pytest.approx(plain[:, 600].mean() / 2, rel=0.1)
    assert dark[:, 60].mean() == pytest.approx(plain[:, 60].mean(), rel=0.02)
    lit = Renderer(alone(gradient=0.4))[0][0].image
    assert lit[:, 600].mean() / plain[:, 600].mean() > 1.1 > 0.9 > lit[:, 40].mean() / plain[:, 40].mean()
    packed = Renderer(alone(quality=40))[0][0].image
    assert 0 < np.abs(packed.astype(int) - plain).mean() < 10


def test_a_bar_hides_the_robot_for_half_a_second():
    scene = scene_presets.preset("occlusion")
    renderer = Renderer(scene)
    shares = np.array([renderer.truth(k).objects[0].visible for k in range(len(scene))])
    assert shares[0] == shares[-1] == 1
    hidden = np.flatnonzero(shares == 0)
    assert 0.5 <= len(hidden) / scene.fps < 0.65
    assert np.array_equal(hidden, np.arange(hidden[0], hidden[-1] + 1))


def test_a_bar_comes_and_goes():
    bar = Bar(Straight((0.0, 0.0)), (0.3, 0.3), interval=(0.5, 1.5))
    scene = alone(bars=(bar,), frames=3, fps=1.0)
    assert [Renderer(scene).truth(k).objects[0].visible for k in range(3)] == [1, 0, 1]


def test_what_leaves_the_image_is_not_seen():
    half = Renderer(alone(320 * 0.003 * (1 - 0.05 / 2), 0.0)).truth(0).objects[0]
    assert half.visible == pytest.approx(0.5, abs=0.01)
    assert Renderer(alone(2.0, 0.0)).truth(0).objects[0].visible == 0


def test_no_motion_of_a_preset_lets_robots_collide():
    for name in PRESETS:
        scene = scene_presets.preset(name)
        if name == "lens":
            continue
        sizes = {r.name: max(r.model.radius, r.model.side / np.sqrt(2)) for r in scene.robots}
        for k in range(0, len(scene), 4):
            now = [(r.name, r.motion(k / scene.fps)) for r in scene.robots]
            for i, (a, p) in enumerate(now):
                for b, q in now[:i]:
                    assert np.hypot(p.x - q.x, p.y - q.y) > sizes[a] + sizes[b] - 0.005, (name, a, b, k)


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_every_preset_shows_its_robots(name):
    renderer = Renderer(scene_presets.preset(name, (320, 240)))
    frame, truth = renderer[0]
    assert frame.size == (320, 240)
    assert [thing.visible for thing in truth.objects] == pytest.approx([1.0] * len(truth.objects))
    for thing in truth.objects:
        for marker in thing.markers:
            assert 0 <= marker.image[0] < 320
            assert 0 <= marker.image[1] < 240


def test_a_preset_that_is_not_there_is_named():
    with pytest.raises(PieperError, match="no scene 'nois'; did you mean 'noise'"):
        scene_presets.preset("nois")


def test_effects_out_of_range_are_refused():
    for wrong in (
        {"noise": -1},
        {"shadow": 2},
        {"quality": 101},
        {"light": (1, -1)},
        {"cast": (0, 1)},
        {"gradient": 2},
        {"light": (1, float("nan"))},
        {"exposure": float("inf")},
    ):
        with pytest.raises(ArrayError, match=rf"{next(iter(wrong))} is out of range: it must be from"):
            Effects(**wrong)


def test_two_things_of_one_name_are_refused():
    robot = Robot("it", DISC, Straight((0, 0)))
    with pytest.raises(ArrayError, match="distinct names"):
        Scene("two", scenes.overhead(), (robot, robot))
    with pytest.raises(ArrayError, match="at least one frame"):
        alone(frames=0)
    with pytest.raises(IndexError, match="frames 0 to 2, got 3"):
        Renderer(alone())[3]


def test_a_truth_file_gives_everything_back(tmp_path):
    renderer = Renderer(scene_presets.preset("occlusion").but(frames=70))
    written = [renderer.truth(k) for k in range(0, 70, 10)]
    assert truths.write(tmp_path / "truth.jsonl", written) == 7
    for was, now in zip(written, truths.read(tmp_path / "truth.jsonl"), strict=True):
        assert (was.index, was.time) == (now.index, now.time)
        for a, b in zip(was.objects, now.objects, strict=True):
            assert (a.name, a.kind, a.heading, a.turn_rate) == (b.name, b.kind, b.heading, b.turn_rate)
            assert np.array_equal(a.position, b.position)
            assert np.array_equal(a.velocity, b.velocity)
            assert a.visible == pytest.approx(b.visible, abs=1e-6)
            assert all(np.array_equal(m.image, n.image) for m, n in zip(a.markers, b.markers, strict=True))


def test_a_truth_file_that_was_cut_off_is_good_up_to_there(tmp_path):
    path = tmp_path / "truth.jsonl"
    renderer = Renderer(alone())
    truths.write(path, [renderer.truth(0), renderer.truth(1)])
    path.write_text(path.read_text()[:-30])
    assert [truth.index for truth in truths.read(path)] == [0]


@pytest.mark.parametrize(("text", "words"), [
    ('{"format": "other"}\n', "line 1 .* format is 'other'"),
    ('{"format": "pieper truth 1"}\n{"frame": 1}\n', "line 2 .* lacks 'time'"),
    ('{"format": "pieper truth 1"}\nnonsense\n', "line 2"),
    ("[]\n", "line 1"),
])  # fmt: skip
def test_what_is_no_truth_file_is_refused_with_its_line(tmp_path, text, words):
    path = tmp_path / "truth.jsonl"
    path.write_text(text)
    with pytest.raises(VisionError, match=words):
        truths.read(path)
