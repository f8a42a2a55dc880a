"""Pictures: what is told to be shown is there, where the camera says, and in its colour."""

from __future__ import annotations

import io
import subprocess
import sys
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import pieper
from pieper.errors import ArrayError, UnknownNameError
from pieper.model.chain import Frame
from pieper.motion.joint_move import joint_move
from pieper.sim import drawing, framing, labels
from pieper.sim.picture import Picture
from pieper.sim.stage import AXIS_COLORS, THEMES, VIEWS, rgb
from tests.robots import NAMES, chain

pytestmark = pytest.mark.usefixtures("can_draw")

SMALL = (320, 240)
NOTICED = 12  # of 255: more than rounding and smoothing change a pixel
UR_TYPES = ("ur3", "ur3e", "ur5", "ur5e", "ur10", "ur10e", "ur16e", "ur20")


def picture_of(arm, q=None, **shown):
    settings = {key: shown.pop(key) for key in ("theme", "view", "grid", "smooth", "size") if key in shown}
    picture = Picture(**{"size": SMALL, **settings})
    picture.add_arm(arm, np.zeros(arm.dof) if q is None else q, **shown)
    return picture


def camera_of(picture):
    scale, center, corners = drawing._extent(picture.stage)
    return framing.fitted_camera(corners, center, picture.stage.view, picture.stage.size), scale


def changed(one, other):
    """(h, w) which pixels differ."""
    return np.abs(one.astype(int) - other.astype(int)).max(axis=-1) > NOTICED


@pytest.mark.parametrize("name", NAMES)
def test_every_robot_is_drawn(name):
    picture = picture_of(chain(name), smooth=False)
    empty = Picture(size=SMALL, smooth=False, grid=False)
    background = 255.0 * rgb(THEMES["light"].background)
    image = picture_of(chain(name), smooth=False, grid=False).image()
    assert image.shape == (240, 320, 3)
    assert np.abs(empty.image() - background).max() <= 1.0
    share = (np.abs(image - background).max(axis=-1) > NOTICED).mean()
    assert 0.01 < share < 0.6  # it is there, and it is not too near
    assert changed(picture.image(), image).any()  # the floor


@pytest.mark.parametrize("ur_type", UR_TYPES)
def test_row_e1_every_ur_type_is_drawn_and_looks_its_own(ur_type):
    """Row E1: a picture of every type; no two are the same, though the camera stands where the size of the arm says."""
    picture = picture_of(pieper.load(ur_type), [0.3, -1.1, 1.3, -1.4, -1.57, 0.2], grid=False, frames=["tool0"])
    image = picture.image()
    assert [frame.label for frame in picture.frames()] == ["tool0"]
    others = [name for name in UR_TYPES if name != ur_type]
    other = others[UR_TYPES.index(ur_type) % len(others)]
    assert (
        changed(image, picture_of(pieper.load(other), [0.3, -1.1, 1.3, -1.4, -1.57, 0.2], grid=False).image()).mean()
        > 0.01
    )


def assert_colour_at_arrows(picture, image, *labels):
    """Half way along each arrow of a frame that is not foreshortened, the picture has the colour of that axis."""
    camera, scale = camera_of(picture)
    seen = 0
    for frame in picture.frames():
        if labels and frame.label not in labels:
            continue
        T = frame.T_base_frame
        for axis in range(3):
            start = T[:3, 3] * scale
            here, there = (np.array(camera.pixel(start + s * drawing._ARROW * T[:3, axis], SMALL)) for s in (0.0, 0.8))
            if np.linalg.norm(there - here) < 12.0:  # points at the eye
                continue
            x, y = np.rint(there).astype(int)
            around = image[max(y - 3, 0) : y + 4, max(x - 3, 0) : x + 4].reshape(-1, 3).astype(float)
            wanted = rgb(AXIS_COLORS[axis])
            pure = wanted - wanted.mean()
            likeness = (around - around.mean(axis=-1, keepdims=True)) @ pure
            assert likeness.max() > 25.0, f"no {'xyz'[axis]} arrow of {frame.label}"
            seen += 1
    assert seen >= 2


@pytest.mark.parametrize("name", ["yaskawa_mh12", "kuka_kr210_robond", "kuka_iiwa14"])
def test_row_b17_a_figure_with_all_frames(name):
    """Row B17, Figure 1 of the report: every frame of the arm is drawn where it is and has its name beside it."""
    arm = chain(name)
    q = 0.2 * np.arange(1, arm.dof + 1)
    picture = picture_of(arm, q, frames=True, smooth=True)
    assert [frame.label for frame in picture.frames()] == [frame.name for frame in arm.frames]
    np.testing.assert_allclose([f.T_base_frame for f in picture.frames()], pieper.Arm(arm).fk_frames(q), atol=1e-15)
    image = picture.image()
    ends = [frame.name for frame in (arm.frames[0], arm.frames[-1])]  # those between may cover each other
    without_names = picture_of(arm, q, frames=True, labels=False).image()
    assert_colour_at_arrows(picture, without_names, *ends)
    text = changed(image, without_names)
    assert text.sum() > 40 * len(arm.frames)  # pixels of letters
    assert not changed(picture_of(arm, q, frames=True).image(), image).any()


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("size", [(320, 240), (120, 300)])
def test_the_camera_sees_the_whole_arm_and_is_near(view, size):
    arm = chain("yaskawa_mh12")
    move = joint_move(arm, np.zeros(6), [1.0, 0.5, -0.5, 1.0, 1.0, 1.0])
    picture = picture_of(arm, move, view=view, size=size, frames=True)
    camera, scale = camera_of(picture)
    pixels = []
    for t in np.linspace(0.0, move.duration, 7):
        Ts = pieper.Arm(arm).fk_frames(picture.stage.arms[0].joints(t), frames=range(7))
        for body in picture.stage.arms[0].bodies:
            T = Ts[body.link]
            points = (body.mesh.vertices @ T[:3, :3].T + T[:3, 3]) * scale
            pixels += [camera.pixel(point, size) for point in points[::7]]
    low, high = np.min(pixels, axis=0), np.max(pixels, axis=0)
    assert (low >= 0.0).all()
    assert (high <= size).all()
    assert ((high - low) / size).max() > 0.55


@pytest.mark.parametrize("factor", [1e-3, 1e4])
def test_the_size_of_an_arm_does_not_change_its_picture(factor):
    arm = chain("ur5e")

    def scaled(T):
        return np.block([[T[:3, :3], factor * T[:3, 3:]], [T[3:]]])

    large = replace(
        arm,
        screws=arm.screws * ([factor] * 3 + [1.0] * 3),
        home=scaled(arm.home),
        frames=tuple(Frame(f.name, f.after, scaled(f.home)) for f in arm.frames),
    )
    one, other = (picture_of(a, 0.3 * np.ones(6), grid=False, frames=["tool0"]).image() for a in (arm, large))
    assert changed(one, other).mean() < 1e-3


def test_the_picture_shows_the_joint_values():
    arm = chain("yaskawa_mh12")
    images = [picture_of(arm, q, view=(0.3, 0.4), grid=False).image() for q in (np.zeros(6), [0, 0.4, 0, 0, 0, 0])]
    assert changed(*images).mean() > 0.02


def test_a_motion_is_shown_at_its_time():
    arm = chain("yaskawa_mh12")
    move = joint_move(arm, np.zeros(6), [0.5, 0.5, 0.0, 0.0, 1.0, 0.0])
    picture = picture_of(arm, move, trace=True, smooth=False)
    assert picture.duration == move.duration
    several = list(picture.images([0.0, 0.5 * move.duration, move.duration, 0.0]))
    assert changed(several[0], several[1]).any()
    np.testing.assert_array_equal(several[0], several[3])
    np.testing.assert_array_equal(several[2], picture.image(move.duration))
    camera, scale = camera_of(picture)
    for t in np.linspace(0.1, 0.9, 5) * move.duration:  # the way of the tip is there at all times
        x, y = np.rint(camera.pixel(pieper.Arm(arm).fk(move.sample(t).q)[:3, 3] * scale, SMALL)).astype(int)
        red, green, _ = several[0][y - 2 : y + 3, x - 2 : x + 3].reshape(-1, 3).astype(int).T
        assert (red - green).max() > 40


def test_axes_go_through_their_joints():
    arm = chain("yaskawa_mh12")
    q = [0.3, 0.2, -0.1, 0.4, 0.5, 0.0]
    picture = picture_of(arm, q, axes=True)
    assert changed(picture.image(), picture_of(arm, q).image()).sum() > 200
    for i, (name, point, direction) in enumerate(drawing.axes_at(picture.stage.arms[0], 0.0)):
        assert name == arm.joint_names[i]
        moved = np.array(q)
        moved[i] += 0.7
        for T_before, T_after in zip(
            pieper.Arm(arm).fk_frames(q, frames=[i + 1]), pieper.Arm(arm).fk_frames(moved, frames=[i + 1]), strict=True
        ):
            # turning joint i leaves the points of its axis where they are
            step = T_after @ np.linalg.inv(T_before)
            np.testing.assert_allclose(step[:3, :3] @ point + step[:3, 3], point, atol=1e-9)
            np.testing.assert_allclose(step[:3, :3] @ direction, direction, atol=1e-9)


def test_a_ghost_lets_through_what_is_behind_it():
    arm = chain("yaskawa_mh12")

    def image(opacity):
        picture = picture_of(arm, grid=False)
        picture.add_arm(arm, [0.0, 0.5, 0.3, 0.0, 0.0, 0.0], opacity=opacity, color="#2f7fd1")
        return picture.image().astype(float)

    solid, ghost = image(1.0), image(0.3)
    nothing = image(0.001)
    where = np.abs(solid - nothing).max(axis=-1) > 60.0
    share = np.abs(ghost - nothing).max(axis=-1)[where] / np.abs(solid - nothing).max(axis=-1)[where]
    assert 0.2 < np.median(share) < 0.4


def test_ghosts_may_come_in_any_order():
    arm = chain("ur5e")
    poses = [([0.0, -1.0, 1.0, 0.0, 0.0, 0.0], "#2f7fd1"), ([0.2, -1.2, 1.0, 0.0, 0.0, 0.0], "#3aa655")]
    images = []
    for order in (poses, poses[::-1]):
        picture = Picture(size=SMALL, view=(0.1, 0.2))
        for q, color in order:
            picture.add_arm(arm, q, opacity=0.4, color=color)
        images.append(picture.image())
    assert not changed(*images).any()


@pytest.mark.parametrize("theme", THEMES)
def test_the_background_is_that_of_the_theme(theme):
    image = picture_of(chain("ur5e"), theme=theme, grid=False).image()
    assert np.abs(image[0, 0] - 255.0 * rgb(THEMES[theme].background)).max() <= 1.0


def test_names_do_not_cover_each_other():
    """The three frames in the wrist of the MH12 are in one point: their names are not."""
    taken: list = []
    for _ in range(12):
        taken.append(labels._free_place(160.0, 120.0, 60.0, 9.0, taken, SMALL))
    for one, other in product(taken, taken):
        if one is not other:
            assert one[2] < other[0] or other[2] < one[0] or one[3] < other[1] or other[3] < one[1]
    for left, top, right, bottom in taken:
        assert 0.0 <= left < right <= SMALL[0]
        assert 0.0 <= top < bottom <= SMALL[1]


def test_frames_and_lines_of_ones_own():
    picture = picture_of(chain("ur5e"), grid=False)
    before = picture.image()
    T = np.eye(4)
    T[:3, 3] = [0.3, 0.3, 0.4]
    picture.add_frame(T)
    picture.add_line([[0.0, 0.0, 0.5], [0.5, 0.5, 0.5], [0.5, 0.5, 0.5]])
    image = picture.image()
    assert changed(before, image).sum() > 100
    assert_colour_at_arrows(picture, image, "")
    picture.add_frame(T, label="target")
    assert [frame.label for frame in picture.frames()] == ["", "target"]
    assert changed(picture.image(), image).sum() > 20


def test_solids_are_drawn_where_they_stand_and_seen_by_the_camera():
    from pieper.model.description import Box, Capsule, Cylinder, Sphere

    T = np.eye(4)
    T[:3, 3] = [1.5, 0.0, 0.3]
    picture = picture_of(pieper.load("mh12"), grid=False, smooth=False)
    before = picture.image()
    picture.add_solids([(Box([0.3, 0.3, 0.6]), T)], color="#00ff00")
    picture.add_solids([(solid, np.eye(4)) for solid in (Cylinder(0.1, 0.2), Capsule(0.1, 0.2), Sphere(0.1))])
    camera, scale = camera_of(picture)
    x, y = camera.pixel(T[:3, 3] * scale, SMALL)
    red, green, blue = map(int, picture.image()[int(y), int(x)])
    assert green > red + 50
    assert green > blue + 50
    assert not (picture.image() == before).all()
    picture.add_solids([])  # nothing to draw
    with pytest.raises(ArrayError, match="opacity must be above 0 and at most 1, got 2"):
        picture.add_solids([(Sphere(0.1), np.eye(4))], opacity=2.0)


def test_a_picture_becomes_a_png_file(tmp_path):
    from PIL import Image

    picture = picture_of(chain("ur5e"))
    picture.save(tmp_path / "arm.png")
    assert [path.name for path in tmp_path.iterdir()] == ["arm.png"]
    np.testing.assert_array_equal(np.array(Image.open(tmp_path / "arm.png")), picture.image())
    assert Image.open(io.BytesIO(picture.png())).size == SMALL


@pytest.mark.parametrize("width", [1e-3, 0.3, 2.3, 480.0])
def test_the_grid_is_round_and_fits(width):
    cell = framing.grid_width(width)
    assert 2.0 < width / cell < 13.0
    assert f"{cell:.0e}"[0] in "125"


@pytest.mark.parametrize("library", ["egl", "osmesa"])
def test_either_library_draws_the_same(library, tmp_path):
    """In a process of its own: a process has one OpenGL."""
    from pieper.sim.offscreen import _linux_context

    if library == "osmesa":
        import ctypes.util

        if ctypes.util.find_library("OSMesa") is None:
            pytest.skip("libosmesa6 is not installed")
    else:
        _linux_context("egl", 16, 16).free()
    code = (
        "import sys, pieper; from pieper.sim.picture import Picture; p = Picture(size=(320, 240)); "
        "p.add_arm(pieper.load('ur5e'), [0.1] * 6); p.save(sys.argv[1])"
    )
    import os

    from PIL import Image

    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, str(tmp_path / "arm.png")],
        env={**{k: v for k, v in os.environ.items() if k != "PYOPENGL_PLATFORM"}, "MUJOCO_GL": library, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    here = picture_of(chain("ur5e"), [0.1] * 6).image()
    assert changed(np.array(Image.open(tmp_path / "arm.png")), here).mean() < 0.01


REFUSED = {
    "size must be two whole numbers of pixels from 16 to 4096, got (8, 8)": lambda: Picture(size=(8, 8)),
    "size must be two whole numbers": lambda: Picture(size=(100.5, 80)),
    "no theme 'drak'; did you mean 'dark'?": lambda: Picture(theme="drak"),
    "no view 'up'; views are: corner, front": lambda: Picture(view="up"),
    "view must be azimuth and elevation [rad]": lambda: Picture(view=(0.0, 2.0)),
    "opacity must be above 0 and at most 1, got 0": lambda: picture_of(chain("ur5e"), opacity=0),
    "a colour must be written #rrggbb, got 'red'": lambda: picture_of(chain("ur5e"), color="red"),
    "no frame 'tool' in chain 'ur5e'": lambda: picture_of(chain("ur5e"), frames=["tool"]),
    "q must have shape (..., 6), got (2,)": lambda: picture_of(chain("ur5e"), [0.0, 1.0]),
    "q must have shape (6,), got (1, 6); add several arms one by one": lambda: picture_of(
        chain("ur5e"), np.zeros((1, 6))
    ),
    "T_base_frame must have shape (4, 4), got (1, 4, 4)": lambda: Picture().add_frame(np.eye(4)[None]),
    "points must have shape (k, 3) with two points or more": lambda: Picture().add_line([[0.0, 0.0, 0.0]]),
    "a picture must end in .png, got 'arm.jpg'": lambda: picture_of(chain("ur5e")).save("arm.jpg"),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_cannot_be_drawn_is_refused_in_words(message):
    import re

    with pytest.raises((ArrayError, UnknownNameError), match=re.escape(message)):
        REFUSED[message]()
