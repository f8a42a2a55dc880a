"""``pieper synthesize`` and ``pieper evaluate``: a film, tracks of it, and how far they are from the truth."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from pieper.cli.main import main
from pieper.perception import truth as truths
from pieper.perception.estimate import Estimate
from pieper.perception.output import create_tracks
from pieper.perception.pass_marks import Mark

SMALL = ("--size", "160x120", "--count", "5")


@pytest.fixture
def film(tmp_path, capsys):
    assert main(["synthesize", "occlusion", "--out", str(tmp_path / "film"), *SMALL]) == 0
    assert "video.mp4 of 5 frames" in capsys.readouterr().out
    return tmp_path / "film"


def track(film, *, away=0.0, suffix=".csv"):
    """What a tracker would write that is off by so much."""
    to = film.parent / f"tracks{suffix}"
    writer = create_tracks(to, unit="m")
    for truth in truths.read(film / "truth.jsonl"):
        writer.write(truth.index, truth.time, [
            Estimate(1 + k, thing.kind, thing.name, truth.time, thing.position + np.array([away, 0]), thing.heading, thing.velocity,
                     thing.turn_rate, np.eye(6) * 1e-6, "seen", 0.0, truth.time)
            for k, thing in enumerate(truth.objects)
        ])  # fmt: skip
    writer.close()
    return to


def test_the_scenes_are_listed(capsys):
    assert main(["synthesize", "--list"]) == 0
    out = capsys.readouterr().out
    assert "light-ramp" in out
    assert "light 1 to 0.4" in out
    assert main(["synthesize", "--list", "--json"]) == 0
    assert {row["scene"] for row in json.loads(capsys.readouterr().out)["scenes"]} >= {"clean", "crossing", "report"}


def test_options_reach_the_scene(tmp_path, capsys):
    words = [
        "synthesize",
        "clean",
        *SMALL,
        "--fps",
        "10",
        "--seed",
        "3",
        "--noise",
        "9",
        "--light",
        "1",
        "0.5",
        "--lossless",
        "--json",
    ]
    assert main([*words, "--out", str(tmp_path / "a")]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["frames"], told["fps"], told["film"]) == (5, 10, "frames")
    assert truths.read(tmp_path / "a" / "truth.jsonl")[4].time == pytest.approx(0.4)
    assert main([*words[:-1], "--out", str(tmp_path / "b")]) == 0
    first, again = ((tmp_path / name / "frames" / "000003.png").read_bytes() for name in "ab")
    assert first == again


@pytest.mark.parametrize(("words", "said"), [
    (["nonsense"], "no scene 'nonsense'"),
    ([], "name a scene: clean"),
    (["clean", "--size", "big"], "--size must be width x height"),
    (["clean", "--size", "4x4"], "16 to 8192"),
    (["clean", "--count", "0"], "at least one frame"),
    (["clean", "--noise", "-1"], "noise is out of range: it must be from 0 to 255, got -1"),
    (["clean", "--seed", "-1"], "seed of a scene must be 0 or more"),
    (["clean", "--fps", "inf"], "a positive rate"),
    (["clean", "--cast", "0", "1.5"], "out of range"),
])  # fmt: skip
def test_what_cannot_be_drawn_is_said(tmp_path, capsys, words, said):
    assert main(["synthesize", *words, *(["--out", str(tmp_path / "x")] if words else [])]) == 2
    assert said in capsys.readouterr().err


def test_a_film_is_not_written_over(film, capsys):
    assert main(["synthesize", "occlusion", "--out", str(film), *SMALL]) == 2
    assert "--force" in capsys.readouterr().err
    assert main(["synthesize", "occlusion", "--out", str(film), *SMALL, "--force"]) == 0


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is another signal there")
def test_stopped_by_ctrl_c_the_files_are_whole(tmp_path):
    words = [
        sys.executable,
        "-m",
        "pieper",
        "synthesize",
        "clean",
        "--out",
        str(tmp_path),
        "--count",
        "5000",
        "--size",
        "160x120",
    ]
    process = subprocess.Popen(words, stderr=subprocess.PIPE, start_new_session=True)
    deadline = time.monotonic() + 60
    while not (tmp_path / "truth.jsonl").exists() or (tmp_path / "truth.jsonl").read_text().count("\n") < 10:
        assert time.monotonic() < deadline
        assert process.poll() is None
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    count = len(truths.read(tmp_path / "truth.jsonl"))
    import cv2

    video = cv2.VideoCapture(str(tmp_path / "video.mp4"))
    assert abs(int(video.get(cv2.CAP_PROP_FRAME_COUNT)) - count) <= 1
    assert count >= 9


def test_tracks_are_measured_against_the_truth(film, capsys):
    capsys.readouterr()
    for suffix in (".csv", ".jsonl"):
        assert main(["evaluate", str(track(film, away=0.003, suffix=suffix)), str(film / "truth.jsonl"), "--json"]) == 0
        data = json.loads(capsys.readouterr().out)
        assert data["position"]["rms"] == pytest.approx(0.003, abs=1e-8)
        assert data["heading"]["rms"] == pytest.approx(0, abs=1e-8)
        assert data["clear"]["mota"] == data["identity"]["idf1"] == data["named"] == 1
        assert data["nees"]["mean"] == pytest.approx(9 / 2, rel=1e-5)
    assert main(["evaluate", str(track(film, away=0.003)), str(film / "truth.jsonl")]) == 0
    out = capsys.readouterr().out
    assert "position, seen [mm]" in out
    assert "3.000" in out
    for word in ("precision", "recall", "MOTA", "IDF1", "HOTA", "identity switches", "NEES"):
        assert word in out


def test_a_smaller_reach_finds_less(film, capsys):
    capsys.readouterr()
    tracks = track(film, away=0.003)
    assert main(["evaluate", str(tracks), str(film / "truth.jsonl"), "--reach", "0.001", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["clear"]["recall"] == 0


@pytest.mark.parametrize(("words", "said"), [
    ([], "needs TRACKS and TRUTH, or --marks"),
    (["tracks.csv", "--marks"], "leave the files out"),
    (["none.csv", "none.jsonl"], "none"),
])  # fmt: skip
def test_what_cannot_be_compared_is_said(tmp_path, capsys, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    assert main(["evaluate", *words]) == 2
    assert said in capsys.readouterr().err


def test_a_mark_that_is_missed_is_the_exit_code(tmp_path, capsys, monkeypatch):
    from pieper.perception import pass_marks

    good, bad = Mark("centre", "px RMS", 0.01, 0.06, report=0.77), Mark("speed", "fps", 100.0, 500.0, at_least=True)
    for marks, code in (([good], 0), ([good, bad], 1)):
        monkeypatch.setattr(pass_marks, "measure", lambda marks=marks, **_: marks)
        assert main(["evaluate", "--marks", "--out", str(tmp_path / "marks.json")]) == code
        out = capsys.readouterr().out
        assert ("MISSED" in out) == bool(code)
        assert "0.77 px RMS" in out
        assert [row["reached"] for row in json.loads((tmp_path / "marks.json").read_text())] == [True, False][
            : len(marks)
        ]
