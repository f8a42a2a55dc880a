"""`pieper learn-colour`, and the rows of the perception report that it answers."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pieper.perception.color import ColorModel
from tests.perception.color_scenes import PAINT, box, frame

COUNT = 4


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Frames as PNG, which keep every pixel."""
    path = tmp_path_factory.mktemp("frames")
    for n in range(COUNT):
        assert cv2.imwrite(str(path / f"{n:03d}.png"), frame(seed=n))
    return path


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    path = tmp_path_factory.mktemp("video") / "markers.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 30, (180, 100))
    for n in range(COUNT):
        writer.write(frame(seed=n, noise=0))
    writer.release()
    return path


def roi(name, which=0, number=0):
    return f"--roi={name}:{number},{box(name, which).box}"


def bare(name, which=0, number=0):
    return f"--roi={number},{box(name, which).box}"


ALL = [roi(name, which, which) for name in PAINT for which in (0, 1)]


def test_A1_A2_A3_A4_colours_are_learned_from_a_video_on_the_command_line(pieper_command, video, tmp_path):
    out = tmp_path / "c.yaml"
    result = pieper_command("learn-colour", video, *ALL, "--out", out)
    assert result.code == 0, result.err
    model = ColorModel.load(out)
    assert model.names == tuple(PAINT)
    assert {r["frame"] for r in model.notes["regions"]} == {0, 1}
    assert model.notes["learned"]["source"] == "markers.mp4"
    labels = model.table().classify(frame(noise=0))
    assert [labels[30, 30], labels[30, 90], labels[30, 150]] == [1, 2, 3]


def test_the_other_spelling_is_the_same_command(pieper_command, folder, tmp_path):
    assert pieper_command("learn-color", folder, *ALL, "--out", tmp_path / "c.yaml").code == 0


def test_A5_A6_means_and_covariances_are_printed_as_the_report_prints_them(pieper_command, folder, tmp_path):
    out = pieper_command("learn-colour", folder, *ALL, "--out", tmp_path / "c.yaml").out
    assert out.count("Media HSV: [") == out.count("Covarianza HSV: [[") == 9  # six captures, and three colours together
    for name in PAINT:
        assert f"{name}, capture 2 of 2: frame 1" in out
        assert f"{name}, 2 captures together, within and between" in out
    lines = out.splitlines()
    red = next(line for line in lines if "Media HSV" in line)
    hsv = cv2.cvtColor(np.uint8([[PAINT["red"]]]), cv2.COLOR_BGR2HSV)[0, 0]
    printed = np.array(red.split("[")[1].rstrip("]").split(), float)
    away = printed - hsv
    away[0] = (away[0] + 90) % 180 - 90
    assert np.abs(away).max() < 2.0  # noise of three grey levels
    assert "threshold: Mahalanobis distance 4, within which 99.89%" in out
    assert "held out" in out
    assert "share of each frame that each colour explains" in out


def test_A3_captures_without_names_go_to_the_colours_in_their_order(pieper_command, folder, tmp_path):
    boxes = [bare("red", 0, 0), bare("red", 1, 3), bare("blue", 0, 0), bare("blue", 1, 2)]
    command = [
        "learn-colour",
        folder,
        "--color=Rojo=#ff0000",
        "--color=Azul",
        "--captures=2",
        "--out",
        tmp_path / "c.yaml",
    ]
    assert pieper_command(*command, *boxes).code == 0
    regions = ColorModel.load(tmp_path / "c.yaml").notes["regions"]
    assert [(r["color"], r["frame"]) for r in regions] == [("Rojo", 0), ("Rojo", 3), ("Azul", 0), ("Azul", 2)]
    result = pieper_command(*command, *boxes[:3])
    assert result.code == 2
    assert "2 colours with 2 captures each need 4 regions without a name, got 3" in result.err


def test_A3_each_colour_has_to_have_its_captures(pieper_command, folder, tmp_path):
    result = pieper_command("learn-colour", folder, *ALL[:-1], "--captures=2", "--out", tmp_path / "c.yaml")
    assert (result.code, result.err) == (2, "pieper: colour 'green' needs 2 captures, got 1\n")
    result = pieper_command(
        "learn-colour", folder, roi("red"), "--color=red", "--color=blue", "--out", tmp_path / "c.yaml"
    )
    assert "colour 'blue' needs one capture at least, got 0" in result.err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("number", ["99", "-1", "two", "1.5", ""])
def test_A3_P2_frame_numbers_that_are_none_are_refused(pieper_command, folder, video, number, tmp_path):
    for source in (folder, video):
        result = pieper_command("learn-colour", source, f"--roi=red:{number},25,25,9,9", "--out", tmp_path / "c.yaml")
        assert result.code == 2
        assert "not valid frame number" in result.err.lower()
    assert not list(tmp_path.iterdir())


def test_A3_P2_a_frame_that_cannot_be_read_is_named(pieper_command, folder, tmp_path):
    for n in range(COUNT):
        (tmp_path / f"{n}.png").write_bytes((folder / f"{n:03d}.png").read_bytes())
    (tmp_path / "2.png").write_bytes(b"no picture")
    result = pieper_command("learn-colour", tmp_path, "--roi=red:2,25,25,9,9", "--out", tmp_path / "c.yaml")
    assert result.code == 2
    assert "2" in result.err
    assert "Traceback" not in result.err


@pytest.mark.parametrize("name", ["none.mp4", "text.mp4"])
def test_A1_a_file_that_is_missing_or_no_video_is_a_clear_error(pieper_command, tmp_path, name):
    (tmp_path / "text.mp4").write_text("this is no video")
    result = pieper_command("learn-colour", tmp_path / name, roi("red"), "--out", tmp_path / "c.yaml")
    assert result.code == 2
    assert name in result.err
    assert len(result.err.splitlines()) == 1
    assert not (tmp_path / "c.yaml").exists()


def test_P1_A4_an_empty_region_is_an_error_and_no_crash(pieper_command, folder, tmp_path):
    result = pieper_command("learn-colour", folder, "--roi=red:0,25,25,0,0", "--out", tmp_path / "c.yaml")
    assert result.code == 2
    assert "is empty; width and height must be at least 1" in result.err


def test_A4_boxes_come_from_a_file_and_go_to_one(pieper_command, folder, tmp_path):
    first, second, kept = tmp_path / "a.yaml", tmp_path / "b.yaml", tmp_path / "rois.yaml"
    assert pieper_command("learn-colour", folder, *ALL, "--out", first, "--save-rois", kept).code == 0
    assert pieper_command("learn-colour", folder, "--rois", kept, "--out", second).code == 0
    a, b = ColorModel.load(first), ColorModel.load(second)
    np.testing.assert_array_equal(a.means, b.means)
    assert a.notes["regions"] == b.notes["regions"]


def test_what_is_wrong_with_the_words_is_said(pieper_command, folder, tmp_path):
    for words, message in (
        ([], "no boxes are given"),
        (["--roi=0,1,2,3,4"], "whose colour is the region '0,1,2,3,4'"),
        (["--color=red=nocolour", roi("red")], "a draw colour must be #rrggbb"),
        (["--color=red", "--color=red", roi("red")], "--color needs a name that was not there before"),
        (["--color=rde", roi("red")], "no colour 'red' in --color; did you mean 'rde'?"),
        ([roi("red"), "--space=lab"], "no space 'lab'"),
        ([roi("red"), "--threshold=0"], "threshold must be from 0.1"),
    ):
        result = pieper_command("learn-colour", folder, *words, "--out", tmp_path / "c.yaml")
        assert result.code == 2, words
        assert message in result.err


def test_a_preview_shows_frame_and_findings(pieper_command, folder, tmp_path):
    path = tmp_path / "p.png"
    assert pieper_command("learn-colour", folder, *ALL, "--out", tmp_path / "c.yaml", "--picture", path).code == 0
    assert cv2.imread(str(path)).shape == (100, 360, 3)


def test_remarks_are_printed(pieper_command, folder, tmp_path):
    result = pieper_command(
        "learn-colour", folder, roi("red"), roi("red").replace("red:", "crimson:"), "--out", tmp_path / "c.yaml"
    )
    assert result.code == 0
    assert "note: colours 'red' and 'crimson' overlap" in result.out
