"""``pieper track``: a video and colours in, tables, a video and a summary out; stopped, resumed, and told what is wrong."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from pieper.cli.main import main
from pieper.perception.output import read_tracks
from pieper.perception.source import open_source
from tests.perception.disc_clip import FPS, HIDDEN, RADIUS, disc_clip, disc_colors, picture, places

COUNT = 40
CENTRE = 0.35  # px; discs drawn by OpenCV at sixteenths of a pixel, compressed, with a line of soft edge


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """A folder with a clip of discs, and colours learnt from it."""
    folder = tmp_path_factory.mktemp("discs")
    disc_clip(folder, COUNT)
    disc_colors(folder)
    return folder


@pytest.fixture
def run(room, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    def run(*words, source=room / "discs.avi"):
        arguments = ["track", str(source), "--colors", str(room / "colors.yaml"), *map(str, words)]
        code = main(arguments)
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


def test_A1_a_video_is_tracked_in_pixels_without_calibration(run):
    code, out, err = run("--out", "t.csv", "--record", "t.mp4")
    assert (code, err) == (0, "")
    assert re.match(r"40 frames in [\d.]+ s, \d+ fps; 0 dropped; 4 tracks\n", out)
    assert "wrote t.csv  in pixels" in out
    assert "wrote t.mp4" in out
    table = read_tracks("t.csv")
    assert table.unit == "px"
    assert [f.index for f in table.frames] == list(range(COUNT))
    seen = 0
    for frame in table.frames:
        assert frame.time == pytest.approx(frame.index / FPS)
        for row in frame.rows:
            if row.state == "seen" and frame.index > 10:
                true = np.array(places(frame.index)[row.name])
                assert np.hypot(*(true - [row.x, row.y]).T).min() < CENTRE
                seen += 1
    assert seen >= 4 * (COUNT - 11) - len(HIDDEN) - 4
    with open_source("t.mp4") as film:
        assert sum(1 for _ in film) == COUNT


def test_A14_a_hidden_disc_keeps_its_track(run):
    run("--out", "t.jsonl")
    red = [(f.index, r) for f in read_tracks("t.jsonl").frames for r in f.rows if r.name == "Red"]
    assert len({row.track for _, row in red}) == 1
    for index, row in red:
        assert row.state == ("hidden" if index in HIDDEN else "seen")
        if index in HIDDEN:
            assert np.hypot(row.x - places(index)["Red"][0][0], row.y - 40.0) < 5  # px, after a quarter of a second
    assert [index for index, _ in red][-1] == COUNT - 1


def test_P4_what_was_detected_before_is_not_reported_again(run):
    _, out, _ = run("--verbose")
    frames = [int(n) for n in re.findall(r"^frame (\d+)  Red ", out, re.MULTILINE)]
    assert not set(frames) & set(HIDDEN)
    assert set(frames) == set(range(COUNT)) - set(HIDDEN)


def test_A12_P4_the_radius_is_printed_per_detection(run):
    code, out, _ = run("--verbose", "--stop", 12)
    assert code == 0
    found = re.findall(r"^frame (\d+)  (\w+)  radius ([\d.]+) px  at ([\d.]+), ([\d.]+)$", out, re.MULTILINE)
    assert len(found) == 12 * 4  # one red, one blue, both greens
    for index, name, radius, x, y in found:
        assert float(radius) == pytest.approx(RADIUS, abs=1.0)  # of the rim half is the ground's colour
        assert np.hypot(*(np.array(places(int(index))[name]) - [float(x), float(y)]).T).min() < CENTRE


def test_the_largest_of_a_colour(run):
    run("--out", "t.csv", "--largest", "Green")
    names = [row.name for row in read_tracks("t.csv").frames[-1].rows]
    assert names.count("Green") <= 2
    _, _, err = run("--largest", "Gren")
    assert "no colour 'Gren'" in err
    assert "did you mean 'Green'?" in err


def test_a_part_of_a_video(run):
    code, out, _ = run("--out", "t.csv", "--start", 10, "--stop", 15)
    assert code == 0
    assert out.startswith("5 frames in ")
    assert [f.index for f in read_tracks("t.csv").frames] == [10, 11, 12, 13, 14]


def test_only_a_part_of_the_image_is_looked_at(run):
    run("--out", "t.csv", "--within", "0,0,200,60")
    assert {row.name for frame in read_tracks("t.csv").frames for row in frame.rows} == {"Red"}


def test_the_method_of_the_report_runs_beside_ours(run, room, tmp_path):
    code, out, err = run("--method", "report", "--out", "t.csv", "--record", "t.mp4")
    assert (code, err) == (0, "")
    assert out.count("Media HSV:") == 3 * 3  # two captures and the model of each of three colours
    frames = read_tracks("t.csv").frames
    assert len(frames) == COUNT
    for frame in frames:
        (blue,) = [row for row in frame.rows if row.name == "Blue"]
        assert blue.state == "seen"
        assert (blue.x, blue.y) == (int(blue.x), int(blue.y))  # cut to whole pixels
        assert np.hypot(blue.x - places(frame.index)["Blue"][0][0], blue.y - 80.0) < 3.0
        assert sum(row.name == "Green" for row in frame.rows) == 2

    (tmp_path / "colors.yaml").write_bytes((room / "colors.yaml").read_bytes())
    (tmp_path / "other.avi").write_bytes((room / "discs.avi").read_bytes())
    code, _, err = run("--method", "report", "--colors", "colors.yaml", source="other.avi")
    assert code == 2
    assert "and their video discs.avi is not there" in " ".join(err.split())


# --- bad input


def test_P1_options_are_read_by_their_names(run):
    code, _, err = run("--outt", "t.csv")
    assert code == 2
    assert "No such option" in err
    assert "pieper track --help" in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--out", "t.txt"], "a table of tracks must end in .csv, .jsonl, .parquet"),
        (["--size", "640x480"], "--size is for raw frames on standard input, named -; "),
        (["--record", "t.gif"], "an annotated video must end in .mp4, .avi"),
        (["--out", "none/t.csv"], "none: no such folder"),
        (["--method", "reprt"], "no method 'reprt'; did you mean 'report'"),
        (["--resume"], "--resume goes on with a table; name it by --out"),
        (["--start", "40"], "Error: Not valid frame number: 40; discs.avi has 40 frames, 0 to 39"),
        (["--start", "-1"], "start must be 0 or more"),
        (["--size", "640"], "--size must be width x height in pixels, such as 640x480"),
        (["--method", "report", "--patterns", "ssl"], "the report's method knows no field and no patterns"),
        (["--patterns", "vsss"], "which were not learnt"),
        (["--within", "1,2,3"], "--within must be X0,Y0,X1,Y1 with X0 < X1 and Y0 < Y1, got '1,2,3'"),
        (["--fps", "0"], "fps must be a positive number"),
        (["--patience", "nan"], "patience must be 0 seconds or more, got nan"),
        (["--out", "t.csv", "--resume", "--warm-up", "nan"], "--warm-up must be 0 seconds or more, got nan"),
    ],
)
def test_what_cannot_be_is_refused(run, words, message):
    code, _, err = run(*words)
    assert code == 2
    assert message in " ".join(err.split())
    assert not list(Path().iterdir())


@pytest.mark.parametrize("content", [None, b"", b"no video" * 99])
def test_A1_a_missing_or_unreadable_video_is_said_and_fails(run, tmp_path, content):
    broken = tmp_path / "broken.mp4"
    if content is not None:
        broken.write_bytes(content)
    code, out, err = run(source=broken)
    assert (code, out) == (2, "")
    assert err.startswith(f"pieper: {broken}")
    assert ("no such file or folder" if content is None else "cannot be read as a video") in err


def test_the_video_that_is_tracked_is_not_written_over(run, room, monkeypatch):
    before = (room / "discs.avi").read_bytes()
    monkeypatch.chdir(room)
    code, _, err = run("--record", "discs.avi")
    assert code == 2
    assert "is what is read; it would be lost" in err
    assert (room / "discs.avi").read_bytes() == before


def test_a_truncated_video_is_tracked_as_far_as_it_goes(run, room, tmp_path):
    whole = (room / "discs.avi").read_bytes()
    cut = tmp_path / "cut.avi"
    cut.write_bytes(whole[: len(whole) // 2])
    code, out, err = run("--out", "t.csv", source=cut)
    assert code == 0
    assert "cut.avi is cut off or damaged: it claims 40 frames, and ended after" in " ".join(err.split())
    assert len(read_tracks("t.csv").frames) == int(out.split()[0])


def test_a_size_that_changes_keeps_what_came_before(run, tmp_path):
    import cv2

    folder = tmp_path / "images"
    folder.mkdir()
    for n in range(6):
        cv2.imwrite(str(folder / f"{n}.png"), picture(n) if n < 5 else picture(n)[:50])
    code, out, err = run("--out", "t.csv", "--record", "t.mp4", "--fps", FPS, source=folder)
    assert code == 2
    assert "frame 5 of images is 200 x 50, those before were 200 x 150" in " ".join(err.split())
    assert out.startswith("5 frames in ")
    assert len(read_tracks("t.csv").frames) == 5
    with open_source("t.mp4") as film:
        assert sum(1 for _ in film) == 5


# --- resuming


@pytest.fixture(scope="module")
def whole(room):
    """What an uninterrupted run writes."""
    for suffix in ("csv", "jsonl", "parquet"):
        assert main(["track", str(room / "discs.avi"), "--colors", str(room / "colors.yaml"), "--out", str(room / f"whole.{suffix}")]) == 0  # fmt: skip
    return room


@pytest.mark.parametrize(("suffix", "end"), [("csv", 1), ("csv", 23), ("jsonl", 23), ("parquet", 23)])
def test_resumed_after_a_warm_up_on_everything_the_file_is_that_of_an_uninterrupted_run(run, whole, suffix, end):
    out = Path(f"t.{suffix}")
    run("--out", out, "--stop", end)
    code, said, _ = run("--out", out, "--resume", "--warm-up", 1e6)
    assert code == 0
    expected = whole / f"whole.{suffix}"
    assert read_tracks(out) == read_tracks(expected)
    if suffix != "parquet":
        assert out.read_bytes() == expected.read_bytes()
    assert int(said.split()[0]) == COUNT - end + (suffix == "csv")  # of CSV the last frame is tracked again


def test_however_it_ended_the_resumed_file_is_the_same(run):
    files = []
    for damage in (0, 40):
        run("--out", "t.csv", "--stop", 30)
        path = Path("t.csv")
        path.write_bytes(path.read_bytes()[: -damage or None])
        run("--out", "t.csv", "--resume", "--warm-up", 0.6)
        files.append(path.read_bytes())
    assert all(file == files[0] for file in files)


def test_resumed_after_a_short_warm_up_tracks_go_on_under_their_numbers(run, whole):
    run("--out", "t.csv", "--stop", 34)
    kept = read_tracks("t.csv").frames[:33]
    run("--out", "t.csv", "--resume", "--warm-up", 0.4)
    resumed, expected = read_tracks("t.csv"), read_tracks(whole / "whole.csv")
    assert resumed.frames[:33] == kept
    assert [f.index for f in resumed.frames] == list(range(COUNT))
    for ours, theirs in zip(resumed.frames[33:], expected.frames[33:], strict=True):
        assert [(r.track, r.name, r.state) for r in ours.rows] == [(r.track, r.name, r.state) for r in theirs.rows]
        away = np.array([[r.x, r.y] for r in ours.rows]) - [[r.x, r.y] for r in theirs.rows]
        assert np.abs(away).max() < CENTRE


def test_a_finished_table_resumed_stays_as_it_is(run, whole):
    Path("t.jsonl").write_bytes((whole / "whole.jsonl").read_bytes())
    code, _, _ = run("--out", "t.jsonl", "--resume")
    assert code == 0
    assert Path("t.jsonl").read_bytes() == (whole / "whole.jsonl").read_bytes()


def test_the_video_of_a_resumed_run_stands_beside_the_first(run):
    run("--out", "t.csv", "--record", "t.mp4", "--stop", 10)
    _, out, _ = run("--out", "t.csv", "--record", "t.mp4", "--resume")
    assert "wrote t.from000009.mp4" in out
    with open_source("t.from000009.mp4") as film:
        assert sum(1 for _ in film) == COUNT - 9


def test_what_is_no_table_is_not_resumed(run):
    Path("t.csv").write_text("mine\n")
    code, _, err = run("--out", "t.csv", "--resume")
    assert code == 2
    assert "does not say that this is a 'pieper tracks 1' file" in " ".join(err.split())
    assert Path("t.csv").read_text() == "mine\n"


# --- a process of its own


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT for one process")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_leaves_valid_files(room, tmp_path, number):
    command = [sys.executable, "-m", "pieper", "track", "-", "--colors", str(room / "colors.yaml"), "--size", "200x150"]
    files = ["--out", "t.csv", "--record", "t.mp4"] if number == signal.SIGINT else ["--out", "t.parquet"]
    process = subprocess.Popen(
        [*command, *files, "--verbose"], cwd=tmp_path, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=False,
        env={name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"},
    )  # fmt: skip
    never = threading.Timer(60.0, process.kill)  # what says nothing would be waited for
    never.start()
    assert process.stdin is not None
    assert process.stdout is not None
    sent = 12
    feed = threading.Thread(
        target=lambda: [process.stdin.write(picture(n).tobytes()) for n in range(sent)] and process.stdin.flush()
    )
    feed.start()
    said = b""
    while b"frame 11 " not in said and process.poll() is None:
        said += process.stdout.readline()
    time.sleep(0.1)  # the other discs of that frame are printed, and it waits for the next one
    process.send_signal(number)
    feed.join()
    never.cancel()
    _, err = process.communicate(timeout=20)
    assert process.returncode == 130, err
    assert b"interrupted" in err
    assert [f.index for f in read_tracks(tmp_path / files[1]).frames] == list(range(sent))
    if "t.mp4" in files:
        with open_source(tmp_path / "t.mp4") as film:
            assert sum(1 for _ in film) == sent
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(f for f in files if f.startswith("t."))
