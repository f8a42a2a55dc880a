"""A lens from pictures of a board, against the lens that the pictures were made with."""

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pieper.errors import UnknownNameError, VisionError
from pieper.perception.board import Board
from pieper.perception.board_views import BoardView, BoardViews, find_views
from pieper.perception.calibration import calibrate_camera
from pieper.perception.calibration_file import load_camera
from pieper.perception.calibration_picture import camera_picture
from pieper.perception.camera import Camera
from tests.perception.board_scene import RayCaster, looking_at

CHARUCO = Board.parse("charuco:7x5:0.03:0.022")
CHESSBOARD = Board.parse("chessboard:8x6:0.025")
TRUE = Camera([[500, 0, 243.7], [0, 504, 176.2], [0, 0, 1]], [-0.28, 0.09, 0.0008, -0.0005, -0.01], (480, 360))

PASS_PX = 0.1  # the pass mark: pixels of the found lens against those of the true one
CORNER_PX = 0.05  # RMS of corners in pictures with noise 2 and blur 0.6, where 0.01 to 0.03 was measured
SAME_RAY = 2e-3  # px, of rays that are linear within a pixel
DEVIATIONS = 5  # a parameter may be this many of its own deviations off, since corners of one picture err alike


@pytest.fixture(scope="module")
def rays():
    return RayCaster(TRUE, sides=5)


def poses(board: Board, count: int, seed: int = 1):
    rng = np.random.default_rng(seed)
    reach = 0.45 if board.kind == "charuco" else 0.2
    for _ in range(count):
        at = np.array(board.size) * (0.5 + rng.uniform(-reach, reach, 2))
        near = rng.uniform(0.3, 0.42) * board.size[0] / 0.21
        tilt, turn, roll = rng.uniform(-0.6, 0.6, 3)
        yield looking_at(at, distance=near, tilt=tilt, turn=turn, roll=roll)


def pixels(board: Board, T, camera: Camera = TRUE):
    return camera.project(board.corners @ T[:3, :2].T + T[:3, 3])


@pytest.fixture(scope="module")
def folder(rays, tmp_path_factory):
    """Fourteen pictures of a ChArUco board, with noise and blur."""
    path = tmp_path_factory.mktemp("charuco")
    for i, T in enumerate(poses(CHARUCO, 14)):
        cv2.imwrite(str(path / f"{i:02}.png"), rays.image(T, CHARUCO.is_white, noise=2, blur=0.6, seed=i))
    return path


def lens_error(found: Camera, true: Camera, uv) -> float:
    """RMS of pixels [px] when a turn of the camera, which a board cannot tell from its own, is taken away."""
    rays = true.directions(uv)

    def miss(r):
        return (found.project(rays @ Rotation.from_rotvec(r).as_matrix().T) - uv).reshape(-1)

    return float(np.sqrt((least_squares(miss, np.zeros(3)).fun.reshape(-1, 2) ** 2).sum(axis=1).mean()))


def test_the_renderer_is_the_camera_of_opencv(rays):
    """Rays through the corners of pixels, projected by OpenCV, are those pixels; and linear within a pixel is enough."""
    uv = np.stack(np.meshgrid(np.arange(481) - 0.5, np.arange(361) - 0.5), axis=-1)
    p = np.concatenate([rays.rays, np.ones_like(rays.rays[..., :1])], axis=-1)
    back, _ = cv2.projectPoints(p.reshape(-1, 3), np.zeros(3), np.zeros(3), TRUE.matrix, TRUE.distortion)
    assert np.abs(back.reshape(uv.shape) - uv).max() < 1e-9
    middle = (rays.rays[:-1, :-1] + rays.rays[1:, 1:] + rays.rays[1:, :-1] + rays.rays[:-1, 1:]) / 4
    there = TRUE.project(np.concatenate([middle, np.ones_like(middle[..., :1])], axis=-1))
    assert np.abs(there - uv[:-1, :-1] - 0.5).max() < SAME_RAY


@pytest.mark.parametrize(
    "words", ["charuco:7x5:0.03:0.022", "charuco:6x4:0.03:0.02:5x5_100", "charuco:5x4:0.04:0.03:4x4_50:legacy"]
)
def test_what_is_printed_is_the_board_of_opencv(words):
    board = Board.parse(words)
    side = 48  # px of a square
    ours = board.draw(dpi=round(side * 0.0254 / board.square))
    scale = 0.0254 / round(side * 0.0254 / board.square)
    columns, rows = board.squares
    y, x = np.mgrid[: rows * side, : columns * side]
    exact = board.is_white((np.stack([x, y], axis=-1) + 0.5) * board.square / side)
    theirs = board._opencv_board(cv2).generateImage((columns * side, rows * side)) > 127
    assert (exact == theirs).mean() > 0.97  # they round modules to pixels, so edges differ by one
    assert ours.shape == (round((rows + 2) * board.square / scale), round((columns + 2) * board.square / scale))


@pytest.mark.parametrize("board", [CHARUCO, CHESSBOARD], ids=str)
def test_a_drawn_board_is_found_where_it_is(board):
    dpi = 150
    ids, uv = board.find(board.draw(dpi))
    expected = (board.corners[ids] + board.square) / (0.0254 / dpi) - 0.5  # a margin of one square
    if np.abs(uv - expected).max() > 5:
        expected = expected[::-1]  # a chessboard may be turned by half a turn
    assert len(ids) == len(board.corners)
    assert np.abs(uv - expected).max() < 0.5  # pixels of the drawing are black or white, nothing between


def test_a_drawing_carries_its_scale(tmp_path):
    CHARUCO.save_drawing(tmp_path / "b.png", dpi=300)
    raw = (tmp_path / "b.png").read_bytes()
    at = raw.index(b"pHYs")
    assert int.from_bytes(raw[at + 4 : at + 8], "big") == 11811  # dots per metre
    assert cv2.imread(str(tmp_path / "b.png")).shape[:2] == (2480, 3189)  # 210 x 270 mm


@pytest.mark.parametrize("board", [CHARUCO, CHESSBOARD], ids=str)
def test_corners_are_found_to_a_fraction_of_a_pixel(rays, board):
    for i, T in enumerate(poses(board, 4, seed=3)):
        found = board.find(rays.image(T, board.is_white, noise=2, blur=0.6, seed=i))
        assert found is not None
        ids, uv = found
        true = pixels(board, T)
        miss = min((uv - true[ids], uv - true[::-1][ids]), key=lambda m: np.abs(m).max())
        assert np.sqrt((miss**2).sum(axis=1).mean()) < CORNER_PX


def test_the_lens_is_found_from_pictures(folder, tmp_path):
    found = find_views([folder], CHARUCO)
    assert found.looked_at == 14
    assert len(found.views) == 14
    result = calibrate_camera(found, CHARUCO)
    # Against the truth, where the board was seen: the pass mark.
    seen = np.concatenate([view.uv for view in result.views])
    assert lens_error(result.camera, TRUE, seen) < PASS_PX / 2
    assert result.rms < CORNER_PX
    misses = []
    for view, T, pose in zip(result.views, poses(CHARUCO, 14), result.Ts_camera_board, strict=True):
        misses.append(pixels(CHARUCO, pose, result.camera)[view.ids] - pixels(CHARUCO, T)[view.ids])
    assert np.sqrt((np.concatenate(misses) ** 2).sum(axis=1).mean()) < PASS_PX / 2
    K, T = result.camera.matrix, TRUE.matrix
    for name, value, true in (
        ("fx", K[0, 0], T[0, 0]),
        ("fy", K[1, 1], T[1, 1]),
        ("cx", K[0, 2], T[0, 2]),
        ("cy", K[1, 2], T[1, 2]),
    ):
        assert abs(value - true) < max(DEVIATIONS * result.deviation[name], 0.3), name
    assert "corners" in result.report()
    result.save(tmp_path / "camera.yaml", sources=["pictures"])
    assert (load_camera(tmp_path / "camera.yaml").matrix == K).all()
    assert "charuco:7x5:0.03:0.022:4x4_50" in (tmp_path / "camera.yaml").read_text()


def test_the_lens_is_found_from_chessboards(rays, tmp_path):
    for i, T in enumerate(poses(CHESSBOARD, 10)):
        cv2.imwrite(str(tmp_path / f"{i:02}.png"), rays.image(T, CHESSBOARD.is_white, noise=2, blur=0.6, seed=i))
    result = calibrate_camera(find_views([tmp_path], CHESSBOARD), CHESSBOARD)
    seen = np.concatenate([view.uv for view in result.views])
    assert lens_error(result.camera, TRUE, seen) < PASS_PX
    assert result.rms < CORNER_PX


def test_a_video_gives_views_that_are_sharp_and_differ(rays, tmp_path):
    file = tmp_path / "board.avi"
    video = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"MJPG"), 10, TRUE.size)
    for T in poses(CHARUCO, 7):
        image = rays.image(T, CHARUCO.is_white, blur=0.6)
        for blur in (0.0, 0.0, 1.8):  # stands still, and is then torn away
            blurred = cv2.GaussianBlur(image, (0, 0), blur) if blur else image
            video.write(cv2.cvtColor(blurred, cv2.COLOR_GRAY2BGR))
    video.release()
    told = []
    found = find_views([file], CHARUCO, progress=lambda done, of: told.append((done, of)))
    assert found.looked_at == 21
    assert told[-1] == (21, 21)
    chosen = [int(view.name.split("#")[1]) for view in found.views]
    assert len({i // 3 for i in chosen}) == len(chosen) >= 6  # one of each pose
    assert all(i % 3 != 2 for i in chosen)  # none of the blurred
    assert any("not sharp" in words for words in found.left_out)
    assert calibrate_camera(found, CHARUCO).rms < 0.1  # JPEG


def exact_views(count: int = 12, camera: Camera = TRUE, noise: float = 0.05, tilted: bool = True):
    rng = np.random.default_rng(5)
    views = []
    for i, T in enumerate(poses(CHARUCO, count)):
        if not tilted:
            T = looking_at(np.array(CHARUCO.size) / 2, distance=0.4 + 0.01 * i, tilt=0, turn=0)
        uv = pixels(CHARUCO, T, camera)
        inside = ((uv > 0) & (uv < np.array(camera.size) - 1)).all(axis=1)
        views.append(BoardView(f"v{i}", np.flatnonzero(inside), uv[inside] + rng.normal(0, noise, (inside.sum(), 2))))
    return views


def test_a_bad_view_is_left_out_and_said():
    views = exact_views()
    views[4] = BoardView("bad", views[4].ids, views[4].uv + np.random.default_rng(0).normal(0, 3, views[4].uv.shape))
    result = calibrate_camera(BoardViews(tuple(views), TRUE.size, 12), CHARUCO)
    assert [view.name for view in result.views] == [f"v{i}" for i in range(12) if i != 4]
    assert len(result.left_out) == 1
    assert result.left_out[0].startswith("bad: ")
    assert result.rms < 0.1


def test_views_that_contradict_each_other_are_refused():
    rng = np.random.default_rng(0)
    views = [
        v if i % 2 else BoardView(v.name, v.ids, v.uv + rng.normal(0, 4 + i, v.uv.shape))
        for i, v in enumerate(exact_views(9))
    ]
    with pytest.raises(VisionError, match=r"contradict each other|no lens"):
        calibrate_camera(BoardViews(tuple(views), TRUE.size, 9), CHARUCO, coefficients=5)


def test_boards_from_one_side_leave_the_focal_length_open():
    views = exact_views(6, tilted=False)
    with pytest.raises(VisionError, match="seen from nearly the same side"):
        calibrate_camera(BoardViews(tuple(views), TRUE.size, 6), CHARUCO)


def test_few_corners_far_out_hold_k3():
    views = [
        BoardView(v.name, v.ids[near], v.uv[near])
        for v in exact_views(16)
        if (near := np.hypot(*(v.uv - (239.5, 179.5)).T) < 150).sum() > 8
    ]
    result = calibrate_camera(BoardViews(tuple(views), TRUE.size, 16), CHARUCO)
    assert result.camera.distortion.size == 4
    assert "too little for k3" in result.reason


def test_a_lens_that_needs_eight_coefficients_gets_them():
    wide = Camera(
        TRUE.matrix * [[0.45, 1, 1], [1, 0.45, 1], [1, 1, 1]], [0.9, 0.3, 0, 0, 0.02, 1.3, 0.6, 0.1], TRUE.size
    )
    rng = np.random.default_rng(2)
    views = []
    for i in range(16):
        at = np.array(CHARUCO.size) * rng.uniform(0.1, 0.9, 2)
        tilt, turn, roll = rng.uniform(-0.5, 0.5, 3)
        T = looking_at(at, distance=rng.uniform(0.07, 0.15), tilt=tilt, turn=turn, roll=roll)
        uv = pixels(CHARUCO, T, wide)
        inside = ((uv > 0) & (uv < np.array(wide.size) - 1)).all(axis=1)
        views.append(BoardView(f"v{i}", np.flatnonzero(inside), uv[inside] + rng.normal(0, 0.02, (inside.sum(), 2))))
    result = calibrate_camera(BoardViews(tuple(views), TRUE.size, 16), CHARUCO)
    assert result.camera.distortion.size == 8, result.reason
    assert result.rms < 0.05
    asked = calibrate_camera(BoardViews(tuple(views), TRUE.size, 16), CHARUCO, coefficients=8)
    assert asked.reason == "as asked for"
    assert asked.camera.distortion.size == 8


def test_deviations_tell_how_far_off_the_parameters_are():
    """Over many draws of noise, errors of the focal length over their deviations have a spread of about one."""
    ratios = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        views = [BoardView(v.name, v.ids, v.uv + rng.normal(0, 0.1, v.uv.shape)) for v in exact_views(8, noise=0.0)]
        result = calibrate_camera(BoardViews(tuple(views), TRUE.size, 8), CHARUCO, coefficients=5)
        ratios.append((result.camera.matrix[0, 0] - TRUE.matrix[0, 0]) / result.deviation["fx"])
    assert 0.4 < np.sqrt(np.mean(np.square(ratios))) < 2.0  # chi over 12 draws, 99.9 %


def test_the_picture_shows_coverage_and_misses():
    result = calibrate_camera(BoardViews(tuple(exact_views()), TRUE.size, 12), CHARUCO)
    picture = camera_picture(result)
    assert picture.shape[1] == 1000
    assert result.coverage.sum() == sum(len(v.ids) for v in result.views)
    red = (picture[..., 2].astype(int) - picture[..., 0] > 120).sum()
    assert red > 500  # arrows


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ("charuco:7x5", "is not understood; write charuco:COLUMNSxROWS:SQUARE:MARKER"),
        ("charuco:7x5:30:22", "between 0 and 10"),
        ("charuco:7x5:0.02:0.03", "a marker has to be smaller than its square"),
        ("charuco:60x60:0.03:0.02", "need 1800 markers, and 4x4_1000 has 1000"),
        ("chessboard:1x6:0.03", "needs 2 to 100 columns and rows"),
        ("asymmetric:4x5:0.03", "is not understood"),
    ],
)
def test_boards_that_are_none(words, error):
    with pytest.raises(VisionError, match=error):
        Board.parse(words)


def test_an_unknown_dictionary_lists_the_others():
    with pytest.raises(UnknownNameError, match="no dictionary '4x4_60'; did you mean '4x4_50'"):
        Board.parse("charuco:7x5:0.03:0.022:4x4_60")


def test_bad_folders(tmp_path, folder):
    blank = np.full((360, 480), 200, np.uint8)
    for i in range(5):
        cv2.imwrite(str(tmp_path / f"{i}.png"), blank)
    with pytest.raises(
        VisionError, match=r"was found in 0 of 5 images, and 4 are needed, better 15; is it the board that was printed"
    ):
        find_views([tmp_path], CHARUCO)
    with pytest.raises(VisionError, match="was found in 3 of 3 images"):
        find_views(sorted(folder.iterdir())[:3], CHARUCO)
    cv2.imwrite(str(tmp_path / "5.png"), blank[:-1])
    with pytest.raises(
        VisionError, match=r"5\.png is 480 x 359 pixels and 0\.png is 480 x 360; one lens at one resolution"
    ):
        find_views([tmp_path], CHARUCO)
    (tmp_path / "6.png").write_bytes(b"no image")
    with pytest.raises(VisionError, match=r"6\.png: is no image"):
        find_views([tmp_path / "6.png"], CHARUCO)
    (tmp_path / "x.mp4").write_bytes(b"no video")
    with pytest.raises(VisionError, match=r"x\.mp4: is no image and no video"):
        find_views([tmp_path / "x.mp4"], CHARUCO)
    (tmp_path / "empty").mkdir()
    with pytest.raises(VisionError, match="the folder has no images"):
        find_views([tmp_path / "empty"], CHARUCO)
    with pytest.raises(FileNotFoundError):
        find_views([tmp_path / "nowhere"], CHARUCO)
