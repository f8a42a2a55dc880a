"""``pieper calibrate-camera`` and ``pieper calibrate-field``: one command each, and what they say when it does not work."""

import numpy as np
import pytest

from pieper.perception.board import Board
from pieper.perception.calibration_file import load_camera, load_field_size, load_view, save_camera
from pieper.perception.camera import Camera
from pieper.perception.field_view import FieldView
from tests.perception.board_scene import RayCaster, looking_at, overhead

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed")

BOARD = Board.parse("charuco:5x4:0.04:0.03")
TRUE = Camera([[330, 0, 161.7], [0, 332, 118.2], [0, 0, 1]], [-0.2, 0.05, 0, 0], (320, 240))
VIEW = FieldView(TRUE, overhead(2.2, tilt=0.05, turn=0.02))
CORNERS = np.array([[-0.75, 0.65], [0.75, 0.65], [0.75, -0.65], [-0.75, -0.65]])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path, rays = tmp_path_factory.mktemp("board"), RayCaster(TRUE, sides=4)
    rng = np.random.default_rng(0)
    for i in range(6):
        tilt, turn, roll = rng.uniform(-0.5, 0.5, 3)
        at = np.array(BOARD.size) * rng.uniform(0.2, 0.8, 2)
        T = looking_at(at, distance=0.28, tilt=tilt, turn=turn, roll=roll)
        cv2.imwrite(str(path / f"{i}.png"), rays.image(T, BOARD.is_white, blur=0.5, noise=1, seed=i))
    return path


def corners(places=CORNERS, uv=None):
    uv = VIEW.to_image(CORNERS) if uv is None else uv
    return [
        word for (u, v), (x, y) in zip(uv, places, strict=True) for word in ("--corner", f"{u:.3f},{v:.3f}={x},{y}")
    ]


@pytest.fixture
def scene(tmp_path):
    cv2.imwrite(str(tmp_path / "scene.png"), np.full((240, 320, 3), 80, np.uint8))
    save_camera(tmp_path / "camera.yaml", TRUE)
    return tmp_path / "scene.png"


def test_a_board_is_drawn_and_a_lens_is_found(pieper_command, folder, tmp_path):
    drawn = pieper_command("calibrate-camera", "--board", BOARD, "--draw", tmp_path / "board.png")
    assert drawn.code == 0
    assert "280 x 240 mm with its margin, 300 dots per inch" in drawn.out
    out, picture = tmp_path / "camera.yaml", tmp_path / "residuals.png"
    result = pieper_command("calibrate-camera", folder, "--board", BOARD, "--out", out, "--picture", picture)
    assert result.code == 0, result.err
    assert "board found in 6 views that are used, of 6 images" in result.out
    assert abs(load_camera(out).matrix[0, 0] - 330) < 3  # six small views; the pass mark has its own test
    assert cv2.imread(str(picture)).shape[1] == 1000


def test_a_camera_that_cannot_be_calibrated(pieper_command, folder, tmp_path):
    for arguments, words in (
        ([folder, "--board", "charuco:9x9:0.04:0.03:6x6_250"], "was found in 0 of 6 images, and 4 are needed"),
        ([folder, "--board", "charuco:5x4"], "the board 'charuco:5x4' is not understood; write charuco:COLUMNSxROWS"),
        ([tmp_path / "no.mp4"], "no such file or folder"),
        ([], "give images, a folder or a video that show the board; --draw FILE makes a board to print"),
        ([folder, "--board", BOARD, "--distortion", "3"], "0, 4, 5 or 8 coefficients, got 3"),
        ([folder, "--board", BOARD, "--picture", "x.gif"], "--picture must end in .png or .jpg"),
        (["--draw", "board.pdf"], "--draw writes a .png"),
    ):
        result = pieper_command("calibrate-camera", *arguments, "--out", tmp_path / "camera.yaml")
        assert result.code == 2
        assert words in result.err
        assert not (tmp_path / "camera.yaml").exists()


def test_a_field_from_corners(pieper_command, scene, tmp_path):
    out, picture = tmp_path / "field.yaml", tmp_path / "field.png"
    lens = ["--camera", tmp_path / "camera.yaml"]
    result = pieper_command(
        "calibrate-field", scene, *lens, *corners(), "--field-size", "1.5x1.3", "--out", out, "--picture", picture
    )
    assert result.code == 0, result.err
    assert "residual  RMS 0.00 mm" in result.out
    np.testing.assert_allclose(
        load_view(out).to_field(VIEW.to_image([0.3, 0.2], height=0.1), height=0.1), [0.3, 0.2], atol=1e-4
    )
    assert load_field_size(out) == (1.5, 1.3)
    assert cv2.imread(str(picture)) is not None


def test_a_field_from_lines_of_a_video_without_a_camera(pieper_command, tmp_path):
    from pieper.perception.field_lines import lines

    model = lines("vsss")
    pinhole = Camera([[900, 0, 319.5], [0, 900, 239.5], [0, 0, 1]], [], (640, 480))
    true = FieldView(pinhole, overhead(2.8, tilt=0.05, yaw=0.05))
    image = RayCaster(pinhole, sides=3).image(true.T_camera_field, lambda p: 0.1 + 0.8 * model.is_white(p), blur=0.6)
    video = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10, (640, 480))
    for i in range(5):
        frame = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        cv2.circle(frame, (150 + 80 * i, 200), 30, (255, 255, 255), -1)  # what moves is not in the median
        video.write(frame)
    video.release()
    found = corners(uv=true.to_image(CORNERS) + 3)
    out = tmp_path / "field.yaml"
    result = pieper_command(
        "calibrate-field",
        tmp_path / "v.avi",
        "--lines",
        "vsss",
        *found,
        "--radial",
        0,
        "--camera-height",
        2.8,
        "--out",
        out,
    )
    assert result.code == 0, result.err
    assert "assumed  the focal length follows from the height of the camera, 2.8 m" in result.out
    p = np.array([[0.5, 0.4], [-0.5, 0.4], [0.0, -0.5]])
    away = load_view(out).to_field(true.to_image(p)) - p
    assert np.hypot(*away.T).max() < 2e-3  # the pass mark


def test_a_field_that_cannot_be_found(pieper_command, scene, tmp_path):
    lens = ["--camera", tmp_path / "camera.yaml"]
    (tmp_path / "bad.yaml").write_text("size: [320, 240]\nmatrix: 3\n")
    save_camera(tmp_path / "other.yaml", Camera(TRUE.matrix, [], (640, 480)))
    (tmp_path / "tags.yaml").write_text("size: 0.1\ntags:\n- {id: 1, x: 0, y: 0}\n")
    straight = [[10, 10], [20, 20], [30, 30], [40, 40]]
    for arguments, words in (
        ([], "say how to find the field: --corner u,v=x,y four times, --lines vsss, or --tags tags.yaml"),
        ([*lens, *corners()[:6]], "four points are needed, got 3"),
        ([*lens, *corners(uv=straight)], "the pixels lie on one line"),
        ([*lens, *corners(CORNERS * (1, -1))], "mirrored order"),
        ([*lens, "--corner", "1,2,3"], "--corner must be u,v=x,y in pixels and metres"),
        ([*lens, *corners(), "--field-size", "big"], "--field-size must be length x width"),
        ([*lens, *corners(), "--camera-height", "2"], "--camera tells the lens"),
        ([*lens, "--lines", "vsss", "--tags", "t.yaml"], "give one of them"),
        ([*lens, "--lines", "vss"], "no field 'vss'; did you mean 'vsss'"),
        ([*lens, "--tags", tmp_path / "tags.yaml"], "none of the tags [1] was found"),
        (["--camera", tmp_path / "bad.yaml", *corners()], "bad.yaml, line 2, matrix: must be"),
        (
            ["--camera", tmp_path / "other.yaml", *corners()],
            "the image is 320 x 240 pixels and the camera is calibrated for 640 x 480",
        ),
        ([*lens, *corners(), "--frame", "3"], "an image has no frame 3"),
    ):
        result = pieper_command("calibrate-field", scene, *arguments, "--out", tmp_path / "field.yaml")
        assert result.code == 2, words
        assert words in result.err
        assert not (tmp_path / "field.yaml").exists()
