"""``pieper render``: files that are there and right, and what is said when they cannot be made."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import pieper
from pieper.errors import MissingExtraError, MissingLibraryError
from pieper.model import catalog
from pieper.model.dh import forward_kinematics
from pieper.motion import files
from pieper.motion.joint_move import joint_move
from pieper.sim import picture
from tests.robots import chain

COMPOSED = 1e-12  # [m, -] rounding of poses that are composed in another order
SIZE = ("--size", "320x240")


@pytest.fixture
def drawn(monkeypatch):
    """Every picture that a command makes, without drawing it."""
    made = []
    start = picture.Picture.__init__

    def noted(self, **settings):
        start(self, **settings)
        made.append(self)

    monkeypatch.setattr(picture.Picture, "__init__", noted)
    monkeypatch.setattr(picture.Picture, "save", lambda self, path, **settings: None)
    return made


@pytest.fixture(scope="module")
def can_draw():
    from pieper.sim import offscreen

    try:
        offscreen.import_mujoco()
        offscreen.gl_context(16, 16).free()
    except (MissingExtraError, MissingLibraryError) as reason:
        pytest.skip(str(reason))


def pixels(file):
    from PIL import Image

    with Image.open(file) as image:
        return np.array(image.convert("RGB")).astype(int)


@pytest.mark.usefixtures("can_draw")
def test_a_picture_with_frames(pieper_command, tmp_path):
    q = "0.3,0.25,-0.1,0.3,0.6,0"
    result = pieper_command("render", "mh12", "--q", q, "--frames", *SIZE, tmp_path / "arm.png")
    assert (result.code, result.err) == (0, "")
    assert result.out == f"wrote {tmp_path / 'arm.png'}  320 x 240 pixels\n"
    image = pixels(tmp_path / "arm.png")
    assert image.shape == (240, 320, 3)
    plain = picture.Picture(size=(320, 240))
    plain.add_arm(pieper.load("mh12"), [float(word) for word in q.split(",")], frames=True)
    np.testing.assert_array_equal(image, plain.image())


@pytest.mark.usefixtures("can_draw")
def test_a_film_of_reaching_a_target(pieper_command, tmp_path):
    size = ("--size", "160x120", "--fps", 6)
    result = pieper_command("render", "mh12", "--target", 0.3, 0.3, 0.3, *size, tmp_path / "arm.mp4")
    assert result.code == 0
    assert "160 x 120 pixels" in result.out
    assert "frames, motion" in result.out
    assert (tmp_path / "arm.mp4").read_bytes()[4:8] == b"ftyp"
    assert [path.name for path in tmp_path.iterdir()] == ["arm.mp4"]


@pytest.mark.usefixtures("can_draw")
@pytest.mark.parametrize("suffix", files.FORMATS)
def test_a_film_of_a_trajectory_file(pieper_command, tmp_path, suffix):
    arm = chain("ur5e")
    files.write(joint_move(arm, np.zeros(6), 0.5 * np.ones(6)), tmp_path / f"move{suffix}")
    result = pieper_command(
        "render", "ur5e", "--trajectory", tmp_path / f"move{suffix}", tmp_path / "arm.gif",
        "--size", "80x60", "--fps", 5, "--speed", 2, "--theme", "dark",
    )  # fmt: skip
    assert result.code == 0
    assert (tmp_path / "arm.gif").read_bytes()[:6] == b"GIF89a"


def test_degrees_only_where_they_are_marked(pieper_command, drawn):
    for options in (("--q", "90,0,0,0,0,0", "--deg"), ("--q", f"{np.pi / 2},0,0,0,0,0")):
        assert pieper_command("render", "mh12", *options, "arm.png").code == 0
    one, other = (made.stage.arms[0].joints(0.0) for made in drawn)
    np.testing.assert_allclose(one, other, atol=1e-15)


def test_a_picture_of_a_trajectory_shows_its_end_its_beginning_and_its_way(pieper_command, drawn, tmp_path):
    move = joint_move(chain("ur5e"), np.zeros(6), 0.5 * np.ones(6))
    files.write(move, tmp_path / "move.csv")
    assert pieper_command("render", "ur5e", "--trajectory", tmp_path / "move.csv", "arm.png").code == 0
    end, start = drawn[0].stage.arms
    np.testing.assert_allclose(end.joints(drawn[0].duration), 0.5)
    np.testing.assert_allclose(start.joints(drawn[0].duration), 0.0)
    assert end.trace
    assert start.opacity < 1.0


def test_a_target_is_drawn_and_the_nearest_pose_when_it_is_not_reached(pieper_command, drawn):
    result = pieper_command("render", "mh12", "--target", 3.0, 0.3, 0.3, "--rpy", 0, 90, 0, "--deg", "arm.png")
    assert result.code == 1
    assert "not reached  out of reach by" in result.out
    (target,) = drawn[0].stage.still_frames
    np.testing.assert_allclose(target.T_base_frame[:3, 3], [3.0, 0.3, 0.3])
    np.testing.assert_allclose(target.T_base_frame[:3, 2], [1.0, 0.0, 0.0], atol=1e-12)


def shown_frames(pieper_command, drawn, *options):
    assert pieper_command("render", *options, "arm.png").code == 0
    return {frame.label: frame.T_base_frame for frame in drawn[-1].frames()}


YOUBOT_Q = [0.4, 0.5, -0.6, 0.7, 0.8]


@pytest.mark.parametrize(
    ("row", "table", "prefix"), [("D7", "simplified", "arm5b_link_"), ("D10", "full", "arm5d_link_")]
)
def test_rows_d7_d10_the_frames_of_the_youbot_tables_are_drawn(pieper_command, drawn, row, table, prefix):
    """Rows D7 and D10: ``--dh`` draws the arm of the table with the frames that the report names."""
    q = ",".join(map(str, YOUBOT_Q))
    frames = shown_frames(pieper_command, drawn, "youbot", "--q", q, "--dh", table)
    assert set(frames) == {"base_link", *(f"{prefix}{i}" for i in range(1, 6))}, row
    rows = catalog.dh_tables("youbot")[table]
    for i in range(1, 6):
        wanted = forward_kinematics(rows, YOUBOT_Q, up_to_joint=i)
        np.testing.assert_allclose(frames[f"{prefix}{i}"], wanted, rtol=0, atol=COMPOSED)
    if table == "full":
        urdf = pieper.load("youbot").fk(YOUBOT_Q)
        np.testing.assert_allclose(frames["arm5d_link_5"], urdf, rtol=0, atol=COMPOSED)


@pytest.mark.usefixtures("can_draw")
@pytest.mark.parametrize("table", ["simplified", "full"])
def test_rows_d7_d10_in_a_picture(pieper_command, tmp_path, table):
    for name, options in {"with": ("--dh", table), "base": ("--no-meshes",)}.items():
        assert pieper_command("render", "youbot", *options, *SIZE, tmp_path / f"{name}.png").code == 0
    assert (np.abs(pixels(tmp_path / "with.png") - pixels(tmp_path / "base.png")).max(axis=-1) > 24).mean() > 0.005


def test_dh_frames_of_any_arm(pieper_command, drawn):
    frames = shown_frames(pieper_command, drawn, "ur5e", "--dh", "standard")
    assert [label for label in frames if label.startswith("dh_")] == [f"dh_{i}" for i in range(1, 7)]
    end = drawn[-1].stage.arms[0].chain.home
    np.testing.assert_allclose(end, pieper.load("ur5e").fk(np.zeros(6)), atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("ur5e", "arm.jpg"), "FILE must end in .png, .mp4 or .gif, got 'arm.jpg'"),
        (("ur5e", "arm.mp4"), "arm.mp4 is a film, which needs --target or --trajectory; a picture ends in .png"),
        (("ur5e", "arm.png", "--size", "big"), "--size must be width x height in pixels, such as 640x480, got 'big'"),
        (("ur5e", "arm.png", "--size", "9x9"), "size must be two whole numbers of pixels from 16 to 4096"),
        (("ur5e", "arm.png", "--seen-from", "up"), "no view 'up'; views are: corner,"),
        (("ur5e", "arm.png", "--seen-from", "0,95"), "the latter from -90 to 90, got '0,95'"),
        (("ur5e", "arm.png", "--seen-from", "nan,0"), "the latter from -90 to 90, got 'nan,0'"),
        (("ur5e", "arm.png", "--seen-from", "1,x"), "--seen-from must be a name, or AZIMUTH,ELEVATION in degrees"),
        (("ur5e", "arm.png", "--theme", "drk"), "no theme 'drk'; did you mean 'dark'?"),
        (("ur5e", "arm.png", "--q", "1,2"), "needs as many values, got 2"),
        (("ur5e", "arm.png", "--q", "1,x"), "--q must be numbers separated by commas, got '1,x'"),
        (
            ("ur5e", "arm.png", "--dh", "full"),
            "no table 'full' in robot 'ur5e'; tables are: standard, modified, hayati",
        ),
        (("ur5e", "arm.png", "--rpy", 0, 0, 0), "give --target X Y Z too"),
        (("ur5e", "arm.png", "--target", 0, 0, 0, "--trajectory", "m.csv"), "give one of them"),
        (("ur5e", "arm.mp4", "--trajectory", "m.csv"), "m.csv: No such file or directory"),
        (("ur5e", "arm.png", "--arm-color", "red"), "a colour must be written #rrggbb, got 'red'"),
        (("ur5e", "nowhere/arm.png"), "nowhere: no such folder"),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_words(pieper_command, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    result = pieper_command("render", *arguments)
    assert result.code == 2
    assert message in result.err
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("can_draw")
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGINT to send to another process")
def test_ctrl_c_leaves_nothing_half_written(tmp_path):
    """A process of its own is stopped in the middle of a film that would take minutes."""
    command = [sys.executable, "-m", "pieper", "render", "mh12", "--target", "0.3", "0.3", "0.3", "--speed", "0.001"]
    with subprocess.Popen(
        [*command, str(tmp_path / "arm.mp4")],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            for _ in range(600):
                if process.poll() is not None or list(tmp_path.iterdir()):
                    break
                time.sleep(0.1)
            assert [path.name.endswith(".unfinished.mp4") for path in tmp_path.iterdir()] == [True]
            process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 130
    assert "Traceback" not in said
    assert not list(tmp_path.iterdir())


def test_a_missing_library_has_its_own_exit_code(pieper_command, monkeypatch, tmp_path):
    from pieper.sim import offscreen

    def missing(name, width, height):
        raise ImportError("no such file")

    monkeypatch.setattr(offscreen, "_linux_context", missing)
    monkeypatch.setattr("sys.platform", "linux")
    result = pieper_command("render", "ur5e", tmp_path / "arm.png")
    assert result.code == 3
    assert "install Debian's packages libegl1 libopengl0 libgl1-mesa-dri, or libosmesa6" in result.err
    assert not list(tmp_path.iterdir())
