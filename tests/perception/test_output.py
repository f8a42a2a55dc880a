"""Tables and videos come back as they were written, whole or cut off; and a stream reaches all who listen."""

from __future__ import annotations

import csv
import json
import sys
import threading
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pieper.errors import MissingExtraError, PieperWarning, VisionError
from pieper.perception import output, video_file
from pieper.perception.estimate import Estimate
from pieper.perception.output import COLUMNS, continue_tracks, create_tracks, read_tracks
from pieper.perception.source import probe
from pieper.perception.stream import Stream
from pieper.perception.video_file import VideoFile

FORMATS = ["csv", "jsonl", "parquet"]
NINE_DIGITS = 1e-8  # relative


def estimate(track=1, *, time=0.0, heading=None, state="seen", name="red", seed=0) -> Estimate:
    draw = np.random.default_rng(seed + 100 * track)
    n = 4 if heading is None else 6
    half = draw.normal(size=(n, n))
    return Estimate(
        track,
        "marker" if heading is None else "robot",
        name,
        time,
        draw.normal(size=2) * 300,
        heading,
        draw.normal(size=2) * 50,
        None if heading is None else 0.25,
        half @ half.T,
        state,
        0.0,
        1.0,
    )


SCRIPT = [
    [],
    [estimate(1, time=0.04)],
    [estimate(1, time=0.08, state="hidden"), estimate(2, time=0.08, heading=-1.5, name=None)],
    [],
    [estimate(2, time=0.16, heading=3.0, name='odd, "name"'), estimate(3, time=0.16, state="lost")],
]


def write(path, script=SCRIPT, *, first=0, writer=None):
    writer = writer or create_tracks(path, unit="m", source="clip.mp4")
    for k, estimates in enumerate(script):
        writer.write(first + k, 0.04 * (first + k), estimates)
    writer.close()


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_table_comes_back(tmp_path, suffix):
    path = tmp_path / f"tracks.{suffix}"
    write(path)
    table = read_tracks(path)
    assert (table.unit, table.source) == ("m", "clip.mp4")
    assert [f.index for f in table.frames] == [0, 1, 2, 3, 4]
    assert [len(f.rows) for f in table.frames] == [0, 1, 2, 0, 2]
    for frame, estimates in zip(table.frames, SCRIPT, strict=True):
        assert frame.time == 0.04 * frame.index
        for row, e in zip(frame.rows, estimates, strict=True):
            assert (row.track, row.kind, row.name, row.state) == (e.track, e.kind, e.name, e.state)
            P = e.covariance
            wanted = [*e.position, *e.velocity, P[0, 0], P[0, 1], P[1, 1]]
            assert np.allclose([row.x, row.y, row.vx, row.vy, row.xx, row.xy, row.yy], wanted, rtol=NINE_DIGITS, atol=0)
            if e.heading is None:
                assert (row.heading, row.turn_rate, row.hh) == (None, None, None)
            else:
                assert np.allclose(
                    [row.heading, row.turn_rate, row.hh], [e.heading, e.turn_rate, P[2, 2]], rtol=NINE_DIGITS
                )
    assert sorted(p.name for p in tmp_path.iterdir()) == [path.name]


def test_others_can_read_the_tables(tmp_path):
    for suffix in FORMATS:
        write(tmp_path / f"t.{suffix}")
    with (tmp_path / "t.csv").open(newline="") as file:
        assert json.loads(file.readline().lstrip("# "))["unit"] == "m"
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert [row["track"] for row in rows] == ["", "1", "1", "2", "", "2", "3"]
    lines = [json.loads(line) for line in (tmp_path / "t.jsonl").read_text().splitlines()]
    assert lines[0] == {"format": "pieper tracks 1", "unit": "m", "source": "clip.mp4"}
    assert [len(line["tracks"]) for line in lines[1:]] == [0, 1, 2, 0, 2]
    table = pytest.importorskip("pyarrow.parquet").read_table(tmp_path / "t.parquet")
    assert tuple(table.column_names) == COLUMNS
    assert table.column("track").to_pylist() == [None, 1, 1, 2, None, 2, 3]
    assert json.loads(table.schema.metadata[b"pieper"])["unit"] == "m"


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60, deadline=None)
@given(suffix=st.sampled_from(["csv", "jsonl"]), cut=st.integers(0, 10_000))
def test_a_table_cut_anywhere_is_good_up_to_there_and_continued_is_whole(tmp_path, suffix, cut):
    path = tmp_path / f"t.{suffix}"
    write(path)
    whole = path.read_bytes()
    cut = min(cut, len(whole))
    path.write_bytes(whole[:cut])
    head = whole.index(b"\n", 80 if suffix == "csv" else 0)
    if cut <= head:  # not even the head is there
        with pytest.raises(VisionError):
            continue_tracks(path, unit="m", source="clip.mp4")
        return
    writer, kept = continue_tracks(path, unit="m", source="clip.mp4")
    count = len(kept.frames)
    assert [f.index for f in kept.frames] == list(range(count))
    assert whole[:cut].count(b"\n") >= count
    write(path, SCRIPT[count:], first=count, writer=writer)
    assert path.read_bytes() == whole


def test_parquet_is_continued(tmp_path):
    path = tmp_path / "t.parquet"
    write(path, SCRIPT[:2])
    writer, kept = continue_tracks(path, unit="m", source="clip.mp4")
    write(path, SCRIPT[len(kept.frames) :], first=len(kept.frames), writer=writer)
    write(tmp_path / "whole.parquet")
    assert read_tracks(path) == read_tracks(tmp_path / "whole.parquet")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.csv", b"", "a.csv: line 1 does not say that this is a 'pieper tracks 1' file"),
        ("a.csv", b"x,y\n1,2\n", "a.csv: line 1 does not say"),
        (
            "a.csv",
            b'# {"format": "pieper tracks 1", "unit": "m", "source": ""}\nframe,time\n',
            "line 2 must name the columns",
        ),
        ("a.jsonl", b'{"format": "pieper truth 1"}\n', "a.jsonl: line 1 does not say"),
        (
            "a.jsonl",
            b'{"format": "pieper tracks 1", "unit": "m", "source": ""}\n{"frame": 1}\n',
            "a.jsonl: line 2 is not of a",
        ),
        ("a.parquet", b"PAR1 not", "a.parquet is not a Parquet file"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(VisionError, match=words):
        read_tracks(tmp_path / name)


@pytest.mark.parametrize("cell", ["x", "1.5"])
def test_a_cell_that_is_no_number_names_its_line(tmp_path, cell):
    write(tmp_path / "t.csv")
    (tmp_path / "t.csv").write_bytes(
        (tmp_path / "t.csv").read_bytes().replace(b"\n1,0.04,1,", f"\n1,0.04,{cell},".encode())
    )
    with pytest.raises(VisionError, match=r"t.csv: line 4 is not of a 'pieper tracks 1' file: invalid literal"):
        read_tracks(tmp_path / "t.csv")


def test_a_table_is_not_continued_with_something_else(tmp_path):
    write(tmp_path / "t.csv")
    with pytest.raises(VisionError, match=r"has the unit 'm', and now it is 'px'"):
        continue_tracks(tmp_path / "t.csv", unit="px", source="clip.mp4")
    with pytest.raises(VisionError, match=r"has the source 'clip.mp4', and now it is 'other.mp4'"):
        continue_tracks(tmp_path / "t.csv", unit="m", source="other.mp4")


def test_names_of_tables_and_videos(tmp_path):
    with pytest.raises(VisionError, match=r"a table of tracks must end in .csv, .jsonl, .parquet, got 'a.txt'"):
        create_tracks("a.txt", unit="m")
    with pytest.raises(VisionError, match=r"an annotated video must end in .mp4, .avi"):
        VideoFile("a.gif", fps=10)
    with pytest.raises(FileNotFoundError):
        create_tracks(tmp_path / "none" / "a.csv", unit="m")
    (tmp_path / "b.csv").mkdir()
    with pytest.raises(IsADirectoryError):
        create_tracks(tmp_path / "b.csv", unit="m")


def test_without_pyarrow_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'pieper\[parquet\]'"):
        create_tracks(tmp_path / "a.parquet", unit="m")
    assert list(tmp_path.iterdir()) == []


# --- video


@pytest.mark.parametrize("suffix", video_file.VIDEOS)
def test_an_annotated_video_plays(tmp_path, suffix):
    path = tmp_path / f"out{suffix}"
    film = VideoFile(path, fps=12.5)
    for n in range(10):
        film.write(np.full((48, 64, 3), 20 * n, np.uint8))
        assert not path.exists()  # nothing half written under its name
    film.close()
    film.close()
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(12.5)
    means = []
    while (found := capture.read())[0]:
        means.append(found[1].mean())
    assert np.allclose(means, 20 * np.arange(10), atol=4)  # of lossy compression
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_a_video_without_frames_leaves_nothing(tmp_path):
    VideoFile(tmp_path / "out.mp4", fps=10).close()
    assert list(tmp_path.iterdir()) == []


# --- stream


def test_a_stream_reaches_all_who_listen():
    stream, heard = Stream(), defaultdict(list)
    leave = stream.subscribe(heard["a"].append)
    stream.subscribe(heard["b"].append)
    stream.publish(1)
    leave()
    leave()
    stream.publish(2)
    assert heard == {"a": [1], "b": [1, 2]}


def test_a_listener_that_fails_does_not_stop_the_others():
    stream, heard = Stream(), []
    stream.subscribe(lambda value: 1 / 0)
    stream.subscribe(heard.append)
    with pytest.warns(PieperWarning, match=r"a listener of the stream failed and hears no more: ZeroDivisionError"):
        stream.publish(1)
    stream.publish(2)
    assert heard == [1, 2]


def test_a_stream_is_iterated_in_another_thread():
    stream, heard = Stream(), []
    values = stream.listen(queue=100)
    thread = threading.Thread(target=lambda: heard.extend(values))
    thread.start()
    for n in range(50):
        stream.publish(n)
    stream.close()
    thread.join(5)
    assert heard == list(range(50))
    assert list(stream.listen()) == []


def test_who_is_slow_misses_the_oldest():
    stream = Stream()
    values = stream.listen(queue=2)
    for n in range(5):
        stream.publish(n)
    stream.close()
    assert list(values) == [3, 4]


class FullDisk:
    """OpenCV's writer, on a disk that holds only the first bytes; like it, it says nothing."""

    def __init__(self, path, *_):
        self._path = path

    def isOpened(self):
        return True

    def write(self, image):
        pass

    def release(self):
        Path(self._path).write_bytes(b"\0\0\0\x20ftypisom")


def test_a_video_that_did_not_fit_on_the_disk_is_an_error_and_no_file(tmp_path, monkeypatch):
    film = VideoFile(tmp_path / "a.mp4", fps=30)
    monkeypatch.setattr(cv2, "VideoWriter", type("Writer", (FullDisk,), {}))
    monkeypatch.setattr(cv2, "VideoWriter_fourcc", lambda *_: 0, raising=False)
    for _ in range(3):
        film.write(np.zeros((48, 64, 3), np.uint8))
    with pytest.raises(VisionError, match=r"a\.mp4 cannot be written: 0 of 3 frames are in the file; is the disk full"):
        film.close()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".mp4", ".avi"])
@pytest.mark.parametrize(("count", "fps"), [(1, 30.0), (7, 0.5), (50, 29.97), (40, 240.0)])
def test_every_frame_of_a_video_is_in_its_file(tmp_path, suffix, count, fps):
    film = VideoFile(tmp_path / f"a{suffix}", fps=fps)
    for n in range(count):
        film.write(np.full((32, 48, 3), n, np.uint8))
    film.close()
    assert probe(film.path).frames == count


def test_a_disk_that_is_full_is_said_with_the_name_of_the_table(tmp_path):
    table = create_tracks(tmp_path / "a.csv", unit="px")

    class Full:
        def write(self, raw):
            raise OSError(28, "No space left on device")

        def close(self):
            pass

    table._file.close()
    table._file = Full()
    with pytest.raises(OSError, match="No space left") as caught:
        table.write(0, 0.0, ())
    assert caught.value.filename == str(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": float("nan")}, "x must be a finite number, got nan"),
        ({"vy": float("inf")}, "vy must be a finite number"),
        ({"yy": -1.0}, "yy is a variance and must not be negative"),
        ({"state": "asleep"}, "state must be one of seen, hidden, lost, got 'asleep'"),
        ({"kind": "dog"}, "kind must be one of robot, ball, marker"),
    ],
)
@pytest.mark.parametrize("suffix", FORMATS)
def test_what_no_tracker_writes_is_not_read(tmp_path, monkeypatch, suffix, change, message):
    row = replace(output.TrackRow.of(3, estimate(heading=0.5)), **change)
    monkeypatch.setattr(output.TrackRow, "of", lambda *_: row)
    monkeypatch.setattr(output.json, "dumps", lambda record, **_: json.JSONEncoder().encode(record))
    table = create_tracks(tmp_path / f"a.{suffix}", unit="m")
    table.write(3, 0.1, [estimate(heading=0.5)])
    table.close()
    with pytest.raises(VisionError, match=message):
        read_tracks(tmp_path / f"a.{suffix}")


@pytest.mark.parametrize("suffix", FORMATS)
def test_frames_that_go_back_are_not_read(tmp_path, suffix):
    table = create_tracks(tmp_path / f"a.{suffix}", unit="m")
    for index in (3, 4, 2):
        table.write(index, 0.1 * index, [estimate(heading=0.5)])
    table.close()
    with pytest.raises(VisionError, match="frame 2 comes after frame 4; frames must go forward"):
        read_tracks(tmp_path / f"a.{suffix}")
