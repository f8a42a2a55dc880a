"""Nothing that a command reads is ever written over."""

import pytest

from pieper.cli.outputs import keep_apart
from pieper.errors import PieperError


@pytest.fixture
def film(tmp_path):
    path = tmp_path / "film.mp4"
    path.write_bytes(b"precious")
    return path


@pytest.mark.parametrize(
    ("verb", "option"),
    [
        *(("learn-colour", option) for option in ("--out", "--save-rois", "--picture")),
        *((f"calibrate-{what}", option) for what in ("camera", "field") for option in ("--out", "--picture")),
    ],
)
def test_the_video_is_not_written_over(pieper_command, film, verb, option):
    named = film if option != "--picture" else film.with_suffix(".png")
    if named != film:
        named.hardlink_to(film)
    more = {"learn-colour": ["--roi", "red:0,1,1,9,9"], "calibrate-field": ["--corner", "1,1=0,0"]}.get(verb, [])
    result = pieper_command(verb, film, *more, option, named)
    assert result.code == 2
    assert f"{option} {named} is what is read; it would be lost" in result.err
    assert film.read_bytes() == b"precious"


def test_a_camera_is_not_written_over_by_its_field(pieper_command, film, tmp_path):
    camera = tmp_path / "camera.yaml"
    camera.write_text("kept")
    result = pieper_command("calibrate-field", film, "--camera", camera, "--corner", "1,1=0,0", "--out", camera)
    assert (result.code, camera.read_text()) == (2, "kept")


def test_links_and_other_spellings_are_the_same_file(film, tmp_path):
    link = tmp_path / "link.mp4"
    link.symlink_to(film)
    for name in (link, tmp_path / "." / "x" / ".." / "film.mp4"):
        (tmp_path / "x").mkdir(exist_ok=True)
        with pytest.raises(PieperError, match=r"--record .* is what is read"):
            keep_apart([film, "rtsp://nowhere", "0", None], {"--record": name})


def test_two_outputs_are_two_files(tmp_path):
    with pytest.raises(PieperError, match=r"--out and --picture both name"):
        keep_apart([], {"--out": tmp_path / "a", "--save-rois": None, "--picture": tmp_path / "b" / ".." / "a"})
    keep_apart(["a\0b"], {"--out": tmp_path / "a", "--picture": tmp_path / "b"})
