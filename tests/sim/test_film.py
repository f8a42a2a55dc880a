"""Films: as long as the motion, read back by another program; an interrupted one leaves nothing behind."""

from __future__ import annotations

import re
import subprocess
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import pieper
from pieper.errors import ArrayError, PieperError
from pieper.ik import target
from pieper.motion.joint_move import joint_move
from pieper.motion.trajectory import Trajectory
from pieper.sim import film
from pieper.sim.picture import Picture

SIZE = (320, 240)
NOTICED = 24  # of 255: more than the compression changes a pixel


class Film(NamedTuple):
    """What FFmpeg finds in a file; `frames` (k, h, w, 3)."""

    codec: str
    pixels: str
    size: tuple[int, int]
    fps: float
    duration: float
    frames: np.ndarray


def read(file):
    import imageio_ffmpeg

    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(file), "-f", "rawvideo", "-pix_fmt", "rgb24", "pipe:1"]
    done = subprocess.run(command, capture_output=True, check=True, timeout=60)
    words = done.stderr.decode()
    hours, minutes, seconds = map(float, re.search(r"Duration: (\d+):(\d+):([\d.]+)", words).groups())
    codec, pixels, width, height, fps = re.search(
        r"Video: (\w+).*?, (\w+)[(,].*?, (\d+)x(\d+).*?([\d.]+) fps", words
    ).groups()
    frames = np.frombuffer(done.stdout, dtype=np.uint8).reshape(-1, int(height), int(width), 3)
    size = (int(width), int(height))
    return Film(codec, pixels, size, float(fps), 3600 * hours + 60 * minutes + seconds, frames)


def difference(one, other):
    return (np.abs(one.astype(int) - other.astype(int)).max(axis=-1) > NOTICED).mean()


@pytest.fixture(scope="module")
def mh12_move():
    """From zero to (0.3, 0.3, 0.3), in about a second."""
    arm = pieper.load("mh12")
    answers = arm.ik(target.ignore_orientation((0.3, 0.3, 0.3)), np.zeros(6))
    return arm, joint_move(arm.chain, np.zeros(6), answers.q[0])


@pytest.mark.usefixtures("can_draw")
def test_a_film_of_the_mh12_going_to_its_target(mh12_move, tmp_path):
    """The film that the issue asks for, made without a screen: MH12 to (0.3, 0.3, 0.3)."""
    arm, move = mh12_move
    np.testing.assert_allclose(arm.fk(move.q[-1])[:3, 3], [0.3, 0.3, 0.3], atol=1e-9)
    picture = Picture(size=SIZE, smooth=False)
    picture.add_arm(arm, move, trace=True)
    told = []
    count = film.save(picture, tmp_path / "mh12.mp4", fps=12, progress=lambda done, of: told.append((done, of)))
    assert count == int(np.ceil(move.duration * 12 - 1e-9)) + 1
    assert told == [(k, count) for k in range(count + 1)]
    assert [path.name for path in tmp_path.iterdir()] == ["mh12.mp4"]

    found = read(tmp_path / "mh12.mp4")
    frames = found.frames
    assert (found.codec, found.pixels, found.size, found.fps) == ("h264", "yuv420p", SIZE, 12.0)
    assert len(frames) == count
    assert move.duration <= found.duration <= move.duration + 2.0 / 12.0
    for frame in frames:
        assert frame.std() > 5.0  # not blank
    assert difference(frames[0], frames[-1]) > 0.03
    assert sum(difference(a, b) > 0.001 for a, b in pairwise(frames)) > 0.7 * count
    for k in (0, count // 2, count - 1):  # and each shows the arm as it is then
        assert difference(frames[k], picture.image(min(k / 12.0, move.duration))) < 0.02


@pytest.mark.usefixtures("can_draw")
def test_a_gif_lasts_as_long_as_the_motion(mh12_move, tmp_path):
    from PIL import Image, ImageSequence

    arm, move = mh12_move
    picture = Picture(size=(161, 121), smooth=False)
    picture.add_arm(arm, move)
    count = film.save(picture, tmp_path / "mh12.gif", fps=15, hold=0.4)
    with Image.open(tmp_path / "mh12.gif") as gif:
        shown = [(frame.info["duration"], np.array(frame.convert("RGB"))) for frame in ImageSequence.Iterator(gif)]
        assert gif.info["loop"] == 0
    assert sum(lasting for lasting, _ in shown) == pytest.approx(1000.0 * count / 15.0, abs=10.0)
    assert len(shown) <= count  # equal ones are joined
    assert difference(shown[0][1], picture.image(0.0)) < 0.02
    assert difference(shown[-1][1], picture.image(move.duration)) < 0.02


@pytest.mark.usefixtures("can_draw")
def test_an_odd_size_is_filled_up(mh12_move, tmp_path):
    arm, move = mh12_move
    picture = Picture(size=(161, 121), smooth=False)
    picture.add_arm(arm, move)
    film.save(picture, tmp_path / "odd.mp4", fps=4)
    assert read(tmp_path / "odd.mp4").size == (162, 122)


@pytest.mark.usefixtures("can_draw")
@pytest.mark.parametrize("suffix", film.FORMATS)
def test_an_interrupted_film_leaves_what_was_there(mh12_move, tmp_path, suffix):
    arm, move = mh12_move
    picture = Picture(size=(160, 120), smooth=False)
    picture.add_arm(arm, move)
    file = tmp_path / f"mh12{suffix}"
    file.write_text("old")

    def stop(done, of):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        film.save(picture, file, fps=10, progress=stop)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {file.name: "old"}


@pytest.mark.usefixtures("can_draw")
def test_two_arms_move_each_in_its_own_time(tmp_path):
    arm = pieper.load("ur5e")
    picture = Picture(size=(160, 120), smooth=False)
    picture.add_arm(arm, Trajectory([5.0, 6.0], [np.zeros(6), np.ones(6)]))
    picture.add_arm(arm, Trajectory([0.0, 2.0], [np.ones(6), np.zeros(6)]), opacity=0.5)
    assert picture.duration == 2.0
    np.testing.assert_allclose(picture.stage.arms[0].joints(0.5), 0.5)
    np.testing.assert_allclose(picture.stage.arms[0].joints(1.5), 1.0)
    assert film.save(picture, tmp_path / "two.mp4", fps=2) == 5


@given(st.floats(1e-3, 50.0), st.floats(1.0, 60.0), st.floats(0.1, 10.0), st.floats(0.0, 2.0))
@example(duration=0.10000000000000002, fps=1.0, speed=0.1, hold=0.0)
def test_times_of_frames(duration, fps, speed, hold):
    times = film.frame_times(duration, fps=fps, speed=speed, hold=hold)
    assert times[0] == 0.0
    assert times[-1] == duration
    assert (np.diff(times) >= 0.0).all()
    np.testing.assert_allclose(np.diff(times)[times[1:] < duration], speed / fps, rtol=1e-9)
    wanted = duration / speed + hold
    assert wanted - 0.5 / fps - 1e-6 <= len(times) / fps <= wanted + 2.5 / fps


@pytest.mark.usefixtures("can_draw")
def test_what_ffmpeg_cannot_write_is_said(mh12_move, tmp_path, monkeypatch):
    arm, move = mh12_move
    picture = Picture(size=(160, 120), smooth=False)
    picture.add_arm(arm, move)
    monkeypatch.setattr(film, "_CODEC", "no_such_codec")
    with pytest.raises(PieperError, match=r"FFmpeg stopped with exit code \d+: .*Unknown encoder 'no_such_codec'"):
        film.save(picture, tmp_path / "mh12.mp4", fps=4)
    assert not list(tmp_path.iterdir())


def moving():
    picture = Picture(size=(160, 120))
    picture.add_arm(pieper.load("ur5e"), Trajectory([0.0, 1.0], np.zeros((2, 6))))
    return picture


def still():
    picture = Picture(size=(160, 120))
    picture.add_arm(pieper.load("ur5e"), np.zeros(6))
    return picture


REFUSED = {
    "a film must end in .mp4 or .gif, got 'arm.avi'": lambda: film.save(moving(), "arm.avi"),
    "a film needs an arm with a trajectory that takes time": lambda: film.save(still(), "arm.mp4"),
    "fps must be a positive number, got 0": lambda: film.save(moving(), "arm.mp4", fps=0),
    "speed must be a positive number, got nan": lambda: film.save(moving(), "arm.mp4", speed=float("nan")),
    "hold must be a time of 0 s or more, got -1": lambda: film.save(moving(), "arm.mp4", hold=-1),
    "a film may have 100000 frames, but 1 s at 1e+06 frames per second would be 1000001": lambda: film.save(
        moving(), "arm.mp4", fps=1e6
    ),
    "a GIF film shows at most 50 frames per second, got fps = 60": lambda: film.save(moving(), "arm.gif", fps=60),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_is_no_film_is_refused_in_words(message):
    with pytest.raises(ArrayError, match=re.escape(message)):
        REFUSED[message]()
