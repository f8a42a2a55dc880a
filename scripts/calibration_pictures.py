"""Draw the pictures of docs/guides/perception_calibration.md and print the figures that stand there.

Run from a clone: ``PYTHONPATH=. python scripts/calibration_pictures.py``. Boards and fields are rendered with rays through an exact camera.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from pieper.perception import field, field_lines
from pieper.perception.board import Board
from pieper.perception.board_views import find_views
from pieper.perception.calibration import calibrate_camera
from pieper.perception.calibration_picture import camera_picture, save_picture
from pieper.perception.camera import Camera
from pieper.perception.field_view import FieldView
from tests.perception.board_scene import RayCaster, looking_at, overhead

IMAGES = Path(__file__).parents[1] / "docs" / "images"
TRUE = Camera([[620, 0, 323.7], [0, 625, 236.2], [0, 0, 1]], [-0.28, 0.09, 0.0008, -0.0005, -0.01], (640, 480))
VIEW = FieldView(TRUE, overhead(1.9, tilt=0.02, turn=0.03, yaw=0.05))
CORNERS = np.array([[-0.75, 0.65], [0.75, 0.65], [0.75, -0.65], [-0.75, -0.65]])
GRID = np.stack(np.meshgrid(np.linspace(-0.7, 0.7, 15), np.linspace(-0.6, 0.6, 13)), axis=-1).reshape(-1, 2)


def rms(away: np.ndarray) -> float:
    """Root of the mean of the squared lengths."""
    return float(np.sqrt((away**2).sum(axis=-1).mean()))


def lens(rays: RayCaster, board: Board, count: int, folder: Path) -> Camera:
    """A lens from rendered boards; prints how far its pixels are from the true ones."""
    rng = np.random.default_rng(1)
    truth = {}
    for i in range(count):
        reach = 0.5 if board.kind == "charuco" else 0.25
        at = np.array(board.size) * (0.5 + rng.uniform(-reach, reach, 2))
        tilt, turn, roll = rng.uniform(-0.6, 0.6, 3)
        T = looking_at(at, distance=rng.uniform(0.25, 0.45), tilt=tilt, turn=turn, roll=roll)
        truth[f"{i:02}.png"] = TRUE.project(board.corners @ T[:3, :2].T + T[:3, 3])
        cv2.imwrite(str(folder / f"{i:02}.png"), rays.image(T, board.is_white, noise=2, blur=0.6, seed=i))
    result = calibrate_camera(find_views([folder], board), board)
    misses = []
    for view, T in zip(result.views, result.Ts_camera_board, strict=True):
        p = board.corners[view.ids] @ T[:3, :2].T + T[:3, 3]
        both = (result.camera.project(p) - truth[view.name][order] for order in (view.ids, view.ids[::-1]))
        misses.append(min(both, key=rms))  # a chessboard may be turned by half a turn
    print(
        f"{board}: {len(result.views)} views, RMS {result.rms:.3f} px; reprojection against the truth {rms(np.concatenate(misses)):.3f} px"
    )
    if board.kind == "charuco":
        save_picture(IMAGES / "perception_lens.jpg", camera_picture(result))
        board_view = np.hstack([cv2.imread(str(folder / f"{i:02}.png")) for i in (0, 1, 5)])
        save_picture(
            IMAGES / "perception_boards.jpg", cv2.resize(board_view, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        )
    return result.camera


def fields(rays: RayCaster, found: Camera) -> None:
    """The field by each way, with the true lens, with the one that was found, and without."""
    model = field_lines.lines("vsss")
    image = rays.image(VIEW.T_camera_field, lambda p: 0.15 + 0.7 * model.is_white(p), blur=0.6, noise=3)
    rough = VIEW.to_image(CORNERS) + np.random.default_rng(0).normal(0, 0.5, (4, 2))

    def tell(words: str, result: field.FieldCalibration) -> None:
        on_floor, above = (
            rms(result.view.to_field(VIEW.to_image(GRID, height=h), height=h) - GRID) * 1e3 for h in (0.0, 0.15)
        )
        print(
            f"{words}: {on_floor:.2f} mm on the floor, {above:.2f} mm at 150 mm; its own residual {result.rms * 1e3:.2f} mm"
        )

    tell("four corners, true lens", field.from_points(rough, CORNERS, camera=TRUE))
    tell("four corners, found lens", field.from_points(rough, CORNERS, camera=found))
    tell("four corners, no lens", field.from_points(rough, CORNERS, image_size=TRUE.size, camera_height=1.9))
    tell("lines, true lens", field.from_lines(image, model, camera=TRUE))
    by_lines = field.from_lines(image, model, camera=found)
    tell("lines, found lens", by_lines)
    start = field.from_points(rough, CORNERS, image_size=TRUE.size, camera_height=1.9).view
    tell("lines, no lens", field.from_lines(image, model, start=start, camera_height=1.9, radial=2))
    save_picture(IMAGES / "perception_field.jpg", by_lines.picture(np.repeat(image[..., None], 3, axis=-1)))


def main() -> int:
    """Draw and print."""
    rays = RayCaster(TRUE)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "a").mkdir()
        (Path(folder) / "b").mkdir()
        found = lens(rays, Board.parse("charuco:7x5:0.03:0.022"), 20, Path(folder) / "a")
        lens(rays, Board.parse("chessboard:8x6:0.025"), 20, Path(folder) / "b")
    fields(rays, found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
