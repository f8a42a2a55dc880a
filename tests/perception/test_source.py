"""Frames of files, folders, cameras, pipes and lists; what is wrong with them is said, and nothing is lost without a word."""

from __future__ import annotations

import io
import os
import socket
import struct
import threading
import time
import warnings
import zlib
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np
import pytest

from pieper.errors import PieperWarning, VisionError
from pieper.perception import pipe_reader
from pieper.perception.frame import Frame
from pieper.perception.image_file import read_image
from pieper.perception.live_reader import LiveReader
from pieper.perception.source import open_source, probe, read_frame, read_frames
from tests.perception.clips import SIZE, ffmpeg, number_in, numbered, numbered_clip

COUNT = 40
TICK = 1e-3  # s; containers count time in such ticks or finer


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return numbered_clip(tmp_path_factory.mktemp("clips") / "clip.mp4", COUNT)


@pytest.fixture(autouse=True)
def _no_thread_is_left():
    yield
    assert not [t.name for t in threading.enumerate() if t.name == "pieper-frames"]


def take_all(source, into):
    """Take frames until there is an error, and keep those before it."""
    for frame in source:
        into.append(frame)


def frames_of(what, **options):
    with open_source(what, **options) as source:
        return list(source)


# --- videos


def test_A1_a_video_is_opened(clip):
    frames = frames_of(str(clip))
    assert [number_in(f.image) for f in frames] == list(range(COUNT))
    assert [f.index for f in frames] == list(range(COUNT))
    assert np.allclose([f.time for f in frames], np.arange(COUNT) / 10, atol=TICK)
    assert all(f.size == SIZE and f.image.dtype == np.uint8 for f in frames)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("missing.mp4", None, "missing.mp4: no such file or folder"),
        ("empty.mp4", b"", "cannot be read as a video"),
        ("text.mp4", b"not a video at all " * 99, "cannot be read as a video: .* codec is not known"),
        ("pretended.avi", b"RIFF\x00\x01\x00\x00AVI LIST" + bytes(range(256)), "cannot be read as a video"),
    ],
)
def test_A1_what_is_no_video_is_refused(tmp_path, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    for opened in (open_source, probe, lambda p: read_frame(p, 0)):
        with pytest.raises(VisionError, match=words):
            opened(tmp_path / name)


def test_an_unknown_codec_is_refused(clip, tmp_path):
    odd = tmp_path / "odd.mp4"
    odd.write_bytes(clip.read_bytes().replace(b"mp4v", b"zzzz").replace(b"esds", b"free"))
    with pytest.raises(VisionError, match=r"odd\.mp4 (cannot be read as a video|holds no frames)"):
        frames_of(odd)


def test_a_part_of_a_video(clip):
    assert [f.index for f in frames_of(clip, start=7, stop=12)] == [7, 8, 9, 10, 11]
    assert [number_in(f.image) for f in frames_of(clip, start=7, stop=12)] == [7, 8, 9, 10, 11]
    with pytest.raises(VisionError, match=r"Error: Not valid frame number: 40; clip.mp4 has 40 frames, 0 to 39"):
        frames_of(clip, start=COUNT)
    with pytest.raises(VisionError, match=r"start must be 0 or more and before stop, got start 5, stop 5"):
        open_source(clip, start=5, stop=5)


def test_A3_every_frame_is_the_one_asked_for(tmp_path):
    # B frames and rare key frames: where jumping by CAP_PROP_POS_FRAMES is known to land beside the frame
    plain = numbered_clip(tmp_path / "plain.avi", COUNT, code="MJPG")
    hard = tmp_path / "hard.mp4"
    ffmpeg("-i", plain, "-c:v", "libx264", "-bf", 3, "-g", 30, "-qp", 10, hard)
    wanted = [39, 0, 17, 17, 31, 5]
    assert [number_in(f.image) for f in read_frames(hard, wanted)] == wanted
    assert [f.index for f in read_frames(hard, wanted)] == wanted
    assert read_frames(hard, []) == []


@pytest.mark.parametrize("number", [-1, COUNT, 10**9])
def test_A3_P2_a_number_of_no_frame_is_rejected(clip, number):
    with pytest.raises(
        VisionError, match=rf"^Error: Not valid frame number: {number}; clip.mp4 has 40 frames, 0 to 39$"
    ):
        read_frame(clip, number)


@pytest.mark.parametrize("number", ["7", 2.0, None, True])
def test_A3_P2_a_number_must_be_whole(clip, number):
    with pytest.raises(VisionError, match=r"^Error: Not valid frame number: "):
        read_frame(clip, number)


def test_A3_an_unreadable_frame_is_reported(tmp_path):
    cv2.imwrite(str(tmp_path / "0.png"), numbered(0))
    (tmp_path / "1.png").write_bytes(b"no image")
    with pytest.raises(VisionError, match=r"frame 1, 1.png, cannot be read as an image"):
        read_frame(tmp_path, 1)
    with pytest.raises(VisionError, match=r"Error: Not valid frame number: 2; .* has 2 frames, 0 to 1"):
        read_frame(tmp_path, 2)
    assert number_in(read_frame(tmp_path, 0).image) == 0


def test_a_truncated_video_keeps_what_was_read(tmp_path):
    whole = numbered_clip(tmp_path / "whole.avi", COUNT, code="MJPG").read_bytes()
    cut = tmp_path / "cut.avi"
    cut.write_bytes(whole[: len(whole) // 2])
    with pytest.warns(
        PieperWarning, match=r"cut.avi is cut off or damaged: it claims 40 frames, and ended after .*kept"
    ):
        frames = frames_of(cut)
    assert 5 <= len(frames) < COUNT
    assert [number_in(f.image) for f in frames[:-1]] == list(range(len(frames) - 1))


def test_a_video_without_frames_is_refused(tmp_path):
    path = tmp_path / "none.mkv"
    ffmpeg("-f", "lavfi", "-i", "color=size=32x32:rate=10:duration=1", "-frames:v", 0, "-c:v", "mpeg4", path)
    with pytest.raises(VisionError, match=r"none\.mkv (holds no frames that can be decoded|cannot be read as a video)"):
        frames_of(path)


@pytest.fixture(scope="module")
def variable(tmp_path_factory):
    """Frames 0 to 9 at 10 per second, then every third."""
    folder = tmp_path_factory.mktemp("variable")
    plain = numbered_clip(folder / "plain.avi", 31, code="MJPG")
    for suffix in ("mp4", "mkv"):
        keep = "select='lt(n,10)+not(mod(n,3))'"
        ffmpeg(
            "-i", plain, "-vf", keep, "-fps_mode", "vfr", "-c:v", "libx264", "-qp", 10, folder / f"variable.{suffix}"
        )
    return folder


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_a_variable_frame_rate_keeps_its_times(variable, suffix):
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the count that mkv claims is no reason to call it cut off
        frames = frames_of(variable / f"variable.{suffix}")
    shown = [*range(10), *range(12, 31, 3)]
    assert [number_in(f.image) for f in frames] == shown
    assert np.allclose([f.time for f in frames], np.array(shown) / 10, atol=2 * TICK)


def test_time_stamps_that_go_back_are_put_right(tmp_path):
    parts = b""
    for k in range(2):
        plain = numbered_clip(tmp_path / f"{k}.avi", 20, code="MJPG")
        ffmpeg("-i", plain, "-c:v", "mpeg2video", "-bf", 0, "-f", "mpegts", tmp_path / f"{k}.ts")
        parts += (tmp_path / f"{k}.ts").read_bytes()
    joined = tmp_path / "joined.ts"
    joined.write_bytes(parts)
    with pytest.warns(PieperWarning, match=r"joined.ts: the time stamp of frame \d+ does not go forward"):
        times = [f.time for f in frames_of(joined)]
    assert len(times) > 30
    steps = np.diff(times)
    assert steps.min() > 0
    assert np.allclose(steps, 0.1, atol=0.05 + TICK)  # at the joint half a frame may be missing


def test_probe_tells_what_the_file_claims(clip, tmp_path):
    info = probe(clip)
    assert (info.size, info.fps, info.frames, info.kind, info.live) == (SIZE, 10.0, COUNT, "video", False)
    cv2.imwrite(str(tmp_path / "a.png"), numbered(3))
    assert (probe(tmp_path).kind, probe(tmp_path).frames) == ("images", 1)


# --- the thread


def test_reading_ahead_is_bounded_and_ends_with_the_source(clip):
    source = open_source(clip, queue=3)
    frames = iter(source)
    assert next(frames).index == 0
    source.close()
    assert list(frames) == []
    source.close()


def test_a_forgotten_source_ends_its_thread(clip):
    source = open_source(clip, queue=2)
    next(iter(source))
    del source


def test_a_source_can_be_stopped_between_frames(clip):
    with open_source(clip) as source:
        for frame in source:
            if frame.index == 4:
                source.stop()
        assert source.taken == 5


def test_no_frame_of_a_file_is_dropped_however_slow_one_is(clip):
    with open_source(clip, queue=1) as source:
        taken = []
        for frame in source:
            time.sleep(0.001)
            taken.append(frame.index)
        assert taken == list(range(COUNT))
        assert source.dropped == 0


# --- folders


def test_images_come_in_natural_order(tmp_path):
    for n in (0, 1, 2, 10, 11):
        cv2.imwrite(str(tmp_path / f"frame{n}.png"), numbered(n))
    (tmp_path / "notes.txt").write_text("not an image")
    frames = frames_of(tmp_path, fps=5)
    assert [number_in(f.image) for f in frames] == [0, 1, 2, 10, 11]
    assert [f.time for f in frames] == [0.0, 0.2, 0.4, 0.6, 0.8]


def test_a_folder_without_images_is_refused(tmp_path):
    with pytest.raises(VisionError, match=r"holds no images; they end in .bmp"):
        open_source(tmp_path)
    (tmp_path / "a.png").write_bytes(b"")
    with (
        pytest.raises(VisionError, match=r"holds no image that can be read"),
        pytest.warns(PieperWarning, match=r"left out"),
    ):
        frames_of(tmp_path)


def test_an_unreadable_image_is_left_out_and_said(tmp_path):
    for n in range(3):
        cv2.imwrite(str(tmp_path / f"{n}.png"), numbered(n))
    (tmp_path / "1.png").write_bytes(b"broken")
    with pytest.warns(PieperWarning, match=r"frame 1, 1.png, cannot be read as an image; it is left out"):
        assert [f.index for f in frames_of(tmp_path)] == [0, 2]


def test_grey_and_16_bit_images_are_converted_and_said(tmp_path):
    colour = numbered(5)
    cv2.imwrite(str(tmp_path / "0.png"), colour[..., 0])
    cv2.imwrite(str(tmp_path / "1.png"), colour.astype(np.uint16) * 256 + 17)
    cv2.imwrite(str(tmp_path / "2.png"), colour[..., 0].astype(np.uint16) * 256)
    with pytest.warns(PieperWarning) as said:
        frames = frames_of(tmp_path)
    assert all((f.image == colour).all() for f in frames)
    texts = [str(w.message) for w in said]
    assert any("0.png is grey, taken as three equal channels" in text for text in texts)
    assert any("1.png is 16 bits, of which the upper 8 are kept" in text for text in texts)


def test_numbers_that_are_no_pixels_are_refused():
    with pytest.raises(VisionError, match=r"frame 0 of frames must be of 8 bits .uint8., got float64"):
        frames_of([np.zeros((4, 4, 3))])
    with pytest.raises(VisionError, match=r"must have shape \(height, width, 3\), got \(4, 4, 2\)"):
        frames_of([np.zeros((4, 4, 2), np.uint8)])
    with pytest.raises(VisionError, match=r"frames holds no frames"):
        frames_of([])
    with pytest.raises(VisionError, match=r"a source must be a path, a camera number, an address"):
        open_source(object())


def test_a_size_that_changes_ends_it_after_the_frames_before(tmp_path):
    for n in range(4):
        cv2.imwrite(str(tmp_path / f"{n}.png"), numbered(n, SIZE if n < 3 else (48, 32)))
    taken = []
    words = "frame 3 of .* is 48 x 32, those before were 96 x 32"
    with open_source(tmp_path) as source, pytest.raises(VisionError, match=words):
        take_all(source, taken)
    assert [f.index for f in taken] == [0, 1, 2]


# --- lists


def test_frames_and_times_of_ones_own():
    image = numbered(1)
    assert [f.time for f in frames_of([(image, 5.0), (image, 5.25)])] == [5.0, 5.25]
    frames = [Frame(image, 3, 1.0), Frame(image, 7, 2.0)]
    assert [(f.index, f.time) for f in frames_of(iter(frames))] == [(3, 1.0), (7, 2.0)]


def test_times_of_ones_own_that_jump_or_go_back_are_said():
    image = numbered(1)
    with pytest.warns(PieperWarning, match=r"the time stamp of frame 2 does not go forward"):
        times = [f.time for f in frames_of([(image, 0.0), (image, 0.1), (image, 0.05), (image, 0.2)], fps=10)]
    assert np.allclose(times, [0.0, 0.1, 0.2, 0.3])
    with pytest.warns(PieperWarning, match=r"the time stamps jump by 60.000 s at frame 1; they are kept"):
        assert [f.time for f in frames_of([(image, 0.0), (image, 60.0)])] == [0.0, 60.0]
    with pytest.warns(PieperWarning, match=r"does not go forward"):
        assert np.isfinite([f.time for f in frames_of([(image, 0.0), (image, float("nan"))])]).all()


# --- pipes


def test_raw_frames_of_a_pipe():
    data = b"".join(numbered(n).tobytes() for n in range(5))
    frames = frames_of(io.BytesIO(data), size=SIZE, fps=50)
    assert [number_in(f.image) for f in frames] == list(range(5))
    assert [f.time for f in frames] == [0.0, 0.02, 0.04, 0.06, 0.08]
    with pytest.warns(PieperWarning, match=r"ended within a frame; the 100 bytes of it are left out"):
        assert len(frames_of(io.BytesIO(data + bytes(100)), size=SIZE)) == 5


def test_a_pipe_that_says_nothing_of_itself_is_refused():
    with pytest.raises(VisionError, match=r"holds neither Y4M nor MJPEG; for raw BGR frames say --size WIDTHxHEIGHT"):
        frames_of(io.BytesIO(bytes(1000)))
    with pytest.raises(VisionError, match=r"holds no frames"):
        frames_of(io.BytesIO(b""))
    with pytest.raises(VisionError, match=r"size must be a positive width and height, got 0 x 5"):
        open_source(io.BytesIO(b""), size=(0, 5))


def test_motion_jpeg_of_a_pipe():
    pictures = [cv2.imencode(".jpg", numbered(n))[1].tobytes() for n in range(6)]
    assert [number_in(f.image) for f in frames_of(io.BytesIO(b"".join(pictures)))] == list(range(6))
    broken = pictures[0] + b"\xff\xd8 damaged \xff\xd9" + pictures[2]
    with pytest.warns(PieperWarning, match=r"a JPEG of .* cannot be decoded and is left out"):
        assert [number_in(f.image) for f in frames_of(io.BytesIO(broken))] == [0, 2]


def test_motion_jpeg_without_an_end_does_not_fill_the_memory(monkeypatch):
    monkeypatch.setattr(pipe_reader, "_LARGEST_JPEG", 100_000)

    class Endless(io.BytesIO):
        given = 0

        def read(self, count):
            self.given += count
            return (b"\xff\xd8" if self.given == count else b"") + bytes(count) if self.given < 2_000_000 else b""

    held = []
    take = pipe_reader._Pipe.take
    monkeypatch.setattr(
        pipe_reader._Pipe, "take", lambda self, count: held.append(len(self._held)) or take(self, count)
    )
    with (
        pytest.warns(PieperWarning, match=r"a JPEG of \d+ bytes cannot be decoded"),
        pytest.raises(VisionError, match="holds no frames"),
    ):
        frames_of(Endless())
    assert max(held) < 300_000


def test_an_image_that_claims_more_pixels_than_there_is_memory_is_left_out(tmp_path):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    size = struct.pack(">IIBBBBB", 60000, 60000, 8, 2, 0, 0, 0)
    bomb = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", size) + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")
    (tmp_path / "0.png").write_bytes(bomb)
    cv2.imwrite(str(tmp_path / "1.png"), numbered(7))
    with pytest.warns(PieperWarning, match=r"frame 0, 0\.png, cannot be read as an image; it is left out"):
        assert [number_in(f.image) for f in frames_of(tmp_path)] == [7]
    with pytest.raises(VisionError, match=r"0\.png: is no image that OpenCV can read"):
        read_image(tmp_path / "0.png")


@pytest.mark.parametrize("pixels", ["yuv420p", "yuv422p", "yuv444p", "gray"])
def test_y4m_of_a_pipe(tmp_path, pixels):
    plain, y4m = numbered_clip(tmp_path / "plain.avi", 5, code="MJPG", fps=20), tmp_path / "clip.y4m"
    ffmpeg("-i", plain, "-pix_fmt", pixels, y4m)
    frames = frames_of(io.BytesIO(y4m.read_bytes()))
    assert [number_in(f.image) for f in frames] == list(range(5))
    assert [f.time for f in frames] == [0.0, 0.05, 0.1, 0.15, 0.2]
    with pytest.warns(PieperWarning, match=r"ended within a frame"):
        assert len(frames_of(io.BytesIO(y4m.read_bytes()[:-10]))) == 4


def test_y4m_keeps_colours():
    red = (40, 40, 200)
    y, cr, cb = cv2.cvtColor(np.full((1, 1, 3), red, np.uint8), cv2.COLOR_BGR2YCrCb)[0, 0]
    planes = bytes([y]) * 24 + bytes([cb]) * 6 + bytes([cr]) * 6
    (frame,) = frames_of(io.BytesIO(b"YUV4MPEG2 W6 H4 F30:1 C420jpeg\nFRAME\n" + planes))
    assert np.abs(frame.image.astype(int) - red).max() <= 2  # rounding there and back


@pytest.mark.parametrize("header", [b"YUV4MPEG2 W6\n", b"YUV4MPEG2 W6 H4 C420p10\n", b"YUV4MPEG2 W999999 H4\n"])
def test_y4m_that_cannot_be_is_refused(header):
    with pytest.raises(VisionError, match=r"Y4M"):
        frames_of(io.BytesIO(header))


@pytest.mark.skipif(os.name == "nt", reason="pipes of Windows cannot be waited for")
def test_a_silent_pipe_does_not_hold_the_end_up():
    end, other = os.pipe()
    with os.fdopen(end, "rb") as stream, os.fdopen(other, "wb"):
        source = open_source(stream, size=SIZE)
        time.sleep(0.05)
        source.close()


# --- cameras


class FakeCamera:
    """Gives the images of a script; None stands for an unplugged cable, which opening again repairs."""

    def __init__(self, script, *, pause=0.0):
        self.script, self.pause = list(script), pause
        self.connections = 0
        self.absent = 0
        self.open = False

    def __call__(self):
        self.connections += 1
        self.open = self.absent == 0
        self.absent = max(0, self.absent - 1)
        return self

    def isOpened(self):
        return self.open

    def read(self):
        time.sleep(self.pause)
        if not self.script:
            self.open = False
            return False, None
        item = self.script.pop(0)
        if item is None:
            self.absent = 2
            self.open = False
            return False, None
        return True, item

    def release(self):
        self.open = False


def test_a_camera_that_is_unplugged_is_opened_again():
    camera = FakeCamera([numbered(0), numbered(1), None, numbered(2), numbered(3)], pause=0.001)
    reader = LiveReader("camera 0", camera, first_wait=0.01, longest_wait=0.02, patience=0.3)
    taken, said = [], []
    with open_source(reader, queue=10) as source, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with pytest.raises(VisionError, match=r"camera 0 gave no image for \d+ s; given up"):
            take_all(source, taken)
        said = [str(w.message) for w in caught]
    assert [number_in(f.image) for f in taken] == [0, 1, 2, 3]
    assert [f.index for f in taken] == [0, 1, 2, 3]
    assert (np.diff([f.time for f in taken]) > 0).all()
    assert abs(taken[0].time - time.time()) < 60
    assert said[0] == "camera 0 gives no images; trying to open it again"
    assert "camera 0 is back after" in said[1]
    assert camera.connections > 4  # once at first, twice in vain, once with success, and again at the end


def test_the_pauses_between_attempts_grow(monkeypatch):
    pauses = []
    monkeypatch.setattr("pieper.perception.live_reader._pause", lambda seconds, stopped: pauses.append(seconds))
    reader = LiveReader("camera 0", FakeCamera([numbered(0)]), first_wait=0.5, longest_wait=4.0, patience=0.05)
    with open_source(reader) as source, pytest.warns(PieperWarning), pytest.raises(VisionError, match=r"given up"):
        list(source)
    assert pauses[:5] == [0.5, 1.0, 2.0, 4.0, 4.0]


def test_a_camera_that_is_not_there_is_refused():
    camera = FakeCamera([])
    camera.absent = 1
    with pytest.raises(VisionError, match=r"camera 3 cannot be opened; is it plugged in, free, and readable"):
        LiveReader("camera 3", camera)
    with pytest.raises(VisionError, match=r"camera 97 cannot be opened"):
        open_source("/dev/video97")
    with pytest.raises(VisionError, match=r"camera 97 cannot be opened"):
        open_source(97)


def test_late_frames_of_a_camera_are_dropped_and_counted():
    camera = FakeCamera([numbered(n) for n in range(30)])
    reader = LiveReader("camera 0", camera, patience=0.05, first_wait=0.01)
    with open_source(reader, queue=4) as source, warnings.catch_warnings():
        warnings.simplefilter("ignore", PieperWarning)
        time.sleep(0.2)  # nobody takes a frame
        frames = []
        with pytest.raises(VisionError, match=r"given up"):
            take_all(source, frames)
        assert [f.index for f in frames] == [26, 27, 28, 29]  # the newest
        assert source.dropped == 26


def test_a_stream_that_does_not_answer_is_refused_without_its_password():
    with pytest.raises(VisionError) as error:
        open_source("rtsp://user:secret@127.0.0.1:9/none")
    assert "rtsp://...@127.0.0.1:9/none cannot be opened" in str(error.value)
    assert "secret" not in str(error.value)


def test_a_video_of_a_server_has_an_end(clip):
    class Quiet(SimpleHTTPRequestHandler):
        def __init__(self, *arguments):
            super().__init__(*arguments, directory=str(clip.parent))

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Quiet) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            frames = frames_of(f"http://127.0.0.1:{server.server_port}/{clip.name}")
        finally:
            server.shutdown()
            thread.join()
    assert [number_in(f.image) for f in frames] == list(range(COUNT))


def test_a_stream_of_the_network_that_ends_is_asked_for_again(tmp_path):
    plain = numbered_clip(tmp_path / "plain.avi", 20, code="MJPG")
    ffmpeg("-i", plain, "-c:v", "mpeg2video", "-qscale:v", 2, "-bf", 0, "-f", "mpegts", tmp_path / "sent.ts")
    with socket.create_server(("127.0.0.1", 0)) as server:

        def send():
            connection, _ = server.accept()
            with connection:
                connection.sendall((tmp_path / "sent.ts").read_bytes())
            server.close()

        thread = threading.Thread(target=send)
        thread.start()
        taken = []
        with open_source(f"tcp://127.0.0.1:{server.getsockname()[1]}", patience=0.3, queue=50) as source:
            assert (source.info.kind, source.info.live) == ("stream", True)
            with pytest.warns(PieperWarning, match="gives no images"), pytest.raises(VisionError, match="given up"):
                take_all(source, taken)
        thread.join()
    assert [number_in(f.image) for f in taken][:15] == list(range(15))
    assert (np.diff([f.time for f in taken]) > 0).all()


def test_a_file_name_is_never_an_address(tmp_path):
    # FFmpeg would take such names for protocols and playlists of other files
    for name in ("concat:a.mp4|b.mp4", "subfile,,start,0,end,9,,:a.mp4", str(tmp_path / "img_%03d.png")):
        with pytest.raises(VisionError, match=r"no such file or folder"):
            open_source(name)


def test_transparency_of_a_png_is_left_out_and_said(tmp_path):
    clear = np.zeros((8, 8, 4), np.uint8)
    clear[..., 2] = 200
    cv2.imwrite(str(tmp_path / "0.png"), clear)
    cv2.imwrite(str(tmp_path / "1.png"), clear[..., :3])
    notes: list[str] = []
    with open_source(tmp_path) as source, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        frames = list(source)
    notes = [str(warning.message) for warning in caught]
    assert [frame.image[0, 0].tolist() for frame in frames] == [[0, 0, 200]] * 2
    assert [note for note in notes if "transparency" in note] == [f"{tmp_path.name}: 0.png is transparency left out"]
