"""``camera.yaml`` and ``field.yaml``: read as written, and refused by file, line and field."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pieper.errors import VisionError
from pieper.perception.calibration_file import load_camera, load_field_size, load_view, save_camera, save_view
from pieper.perception.camera import Camera
from pieper.perception.field_lines import lines
from pieper.perception.field_view import FieldView
from pieper.perception.tags import load_tags
from pieper.yaml_file import write_yaml
from tests.perception.board_scene import overhead

CAMERA = Camera([[620, 0, 323.7], [0, 625, 236.2], [0, 0, 1]], [-0.28, 0.09, 0.0008, -0.0005, -0.01], (640, 480))
VIEW = FieldView(CAMERA, overhead(1.9, tilt=0.2, turn=-0.1))


def same(a: Camera, b: Camera) -> bool:
    return (a.matrix == b.matrix).all() and (a.distortion == b.distortion).all() and a.size == b.size


@pytest.mark.parametrize("count", [0, 4, 5, 8, 12])
def test_a_camera_is_read_as_it_was_written(tmp_path, count):
    d = np.random.default_rng(count).normal(0, 0.1, count)
    camera = Camera([[1 / 3 * 1e3, 0, np.pi], [0, 500, 0.1], [0, 0, 1]], d, (640, 480))
    save_camera(tmp_path / "c.yaml", camera, residual={"rms_px": 0.1}, provenance={"board": "x"})
    assert same(load_camera(tmp_path / "c.yaml"), camera)


@pytest.mark.parametrize("inline", [True, False])
def test_a_view_is_read_as_it_was_written(tmp_path, inline):
    (tmp_path / "cameras").mkdir()
    lens = tmp_path / "cameras" / "c.yaml"
    save_camera(lens, CAMERA)
    file = tmp_path / "f.yaml"
    save_view(file, VIEW, field=(1.5, 1.3), camera_file=None if inline else lens, residual={"rms_mm": 1.0})
    view = load_view(file)
    assert same(view.camera, CAMERA)
    np.testing.assert_allclose(view.T_camera_field, VIEW.T_camera_field, atol=1e-15)
    assert load_field_size(file) == (1.5, 1.3)
    assert ("cameras/c.yaml" in file.read_text()) == (not inline)


def test_a_field_without_size(tmp_path):
    save_view(tmp_path / "f.yaml", VIEW)
    assert load_field_size(tmp_path / "f.yaml") is None


def test_a_pose_that_was_typed_is_taken(tmp_path):
    save_camera(tmp_path / "c.yaml", CAMERA)
    write_yaml(tmp_path / "f.yaml", {"T_camera_field": VIEW.T_camera_field.round(8), "camera": "c.yaml"})
    np.testing.assert_allclose(load_view(tmp_path / "f.yaml").T_camera_field, VIEW.T_camera_field, atol=1e-7)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("size: [640, 480]", "size: [640]", r"c\.yaml, line 2, size: must be 2 numbers"),
        ("size: [640, 480]", "size: [640.5, 480]", r"c\.yaml, line 2, size: must be width and height in whole pixels"),
        ("size: [640, 480]", "", r"c\.yaml, line 3, size: is missing"),
        ("620.0", "wide", r"c\.yaml, line 3, matrix: must be a number, got 'wide'"),
        ("620.0", "-620.0", r"c\.yaml, line 3, matrix: focal lengths must be positive"),
        ("0.09, ", "", None),
        (
            "0.09, 0.0008, ",
            "",
            r"c\.yaml, line 4, distortion: distortion must be 0, 4, 5, 8 or 12 finite numbers, got 3",
        ),
        ("distortion:", "distortoin:", r"line 4, distortoin: no field 'distortoin'.*did you mean 'distortion'"),
        ("matrix: [[", "matrix: [[[", r"c\.yaml, line \d+"),
        ("0.09", ".nan", r"line 4, distortion: must be a finite number"),
    ],
)
def test_a_malformed_camera_names_file_line_and_field(tmp_path, old, new, words):
    file = tmp_path / "c.yaml"
    save_camera(file, CAMERA)
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    if words is None:
        assert load_camera(file).distortion.size == 4
        return
    with pytest.raises(VisionError, match=words):
        load_camera(file)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda t: t.replace("T_camera_field: [[", "T_camera_field: [[2"),
            r"f\.yaml, line 2, T_camera_field: is no pose",
        ),
        (lambda t: t[: t.index("camera:\n")], r"f\.yaml, line \d+, camera: is missing: the name of a camera\.yaml"),
        (lambda t: t[: t.index("camera:\n")] + "camera: lost.yaml\n", r"camera: there is no file .*lost\.yaml"),
        (lambda t: t.replace("size: [640, 480]", "size: []"), r"camera\.size: must be 2 numbers"),
        (lambda t: t + "heading: 1\n", r"heading: no field 'heading'"),
        (lambda t: "", r"f\.yaml, line 1: the file is empty"),
    ],
)
def test_a_malformed_field_names_file_line_and_field(tmp_path, change, words):
    file = tmp_path / "f.yaml"
    save_view(file, VIEW)
    file.write_text(change(file.read_text()))
    with pytest.raises(VisionError, match=words):
        load_view(file)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(FileNotFoundError):
        load_view(tmp_path / "no.yaml")


@given(st.binary(max_size=300))
def test_bytes_are_refused_and_do_not_crash(tmp_path_factory, raw):
    file = tmp_path_factory.mktemp("fuzz") / "f.yaml"
    file.write_bytes(raw)
    with pytest.raises(VisionError):
        load_view(file)


TAGS = "family: 36h11\nsize_mm: 120\ntags:\n- {id: 3, x: -0.6, y: 0.5}\n- {id: 7, x_mm: 600, y: 0.5, yaw_deg: 90, z: 0.01, size: 0.1}\n"
LINES = (
    "length: 2.0\nwidth: 1.0\nline_width: 0.01\nlines:\n- {name: a, from: [0, -0.5], to: [0, 0.5]}\n"
    "circles:\n- {centre: [0, 0], radius: 0.3, begin: 0, end: 3, height: 0.05}\n"
)


@pytest.mark.parametrize("kind", ["camera", "view", "tags", "lines"])
def test_a_damaged_file_is_read_or_refused(tmp_path, kind):
    """Pieces cut out, doubled and exchanged: what comes is a result or a `VisionError`, nothing else."""
    file = tmp_path / "f.yaml"
    readers = {"camera": load_camera, "view": load_view, "tags": load_tags, "lines": lines}
    save_camera(file, CAMERA) if kind == "camera" else save_view(file, VIEW)
    text = {"tags": TAGS, "lines": LINES}.get(kind, file.read_text())
    rng = np.random.default_rng(7)
    words = [
        "",
        "nan",
        "-1",
        "1e400",
        "[",
        "]]",
        "{}",
        ": ",
        "\n",
        "'",
        "\x00",
        "é",
        "null",
        "true",
        "- ",
        "1e-300",
        "&a",
        "*a",
        "!!x ",
    ]
    refused = []
    for _ in range(150):
        a, b = np.sort(rng.integers(0, len(text), 2))
        b = min(b, a + 12)
        file.write_text(text[:a] + str(rng.choice(words)) + text[b:], encoding="utf-8")
        try:
            readers[kind](file)
        except VisionError as error:
            refused.append(str(error))
    assert len(refused) > 50
    assert all(words.startswith(str(file)) for words in refused)
