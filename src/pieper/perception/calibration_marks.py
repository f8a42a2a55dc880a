"""How well a lens and a field are calibrated, against the camera that made the pictures."""

from __future__ import annotations

import tempfile
from dataclasses import asdict
from pathlib import Path

import numpy as np

from pieper.perception.board import Board
from pieper.perception.board_views import find_views
from pieper.perception.calibration import calibrate_camera
from pieper.perception.field import from_lines
from pieper.perception.field_lines import lines
from pieper.perception.metrics import spread
from pieper.perception.opencv import opencv
from pieper.perception.pass_mark import Mark
from pieper.perception.scene_presets import preset
from pieper.perception.synthetic import Renderer
from pieper.perception.synthetic_board import BoardCamera, board_poses


def calibration_marks(quick: bool) -> list[Mark]:
    """A lens from pictures of a ChArUco board, and the field from its lines with that lens: both against the camera that made them."""
    true = preset("lens")
    lens = true.view.camera
    board = Board.parse("charuco:9x6:0.04:0.03")
    with tempfile.TemporaryDirectory() as folder:
        eye = BoardCamera(lens, board)
        for k, pose in enumerate(board_poses(board, 8 if quick else 16)):
            _, data = opencv("writing a picture").imencode(".png", eye.picture(pose, seed=k))
            Path(folder, f"{k:02d}.png").write_bytes(data.tobytes())
        found = calibrate_camera(find_views([Path(folder)], board), board)
    still = true.but(things=(), noise=3.0)
    image = Renderer(still)[0][0].image
    field_found = from_lines(image, lines("vsss"), camera=found.camera)
    half = np.array([true.pitch.length, true.pitch.width]) / 2
    grid = np.stack(np.meshgrid(*(np.linspace(-h, h, 15) for h in half)), axis=-1).reshape(-1, 2)
    away = field_found.view.to_field(true.view.to_image(grid)) - grid
    if np.hypot(*away.T).mean() > half.min():  # the lines look the same turned round
        away = -field_found.view.to_field(true.view.to_image(grid)) - grid
    error = spread(away)
    pixels = np.stack(np.meshgrid(np.linspace(0, 639, 17), np.linspace(0, 479, 13)), axis=-1).reshape(-1, 2)
    rays, found_rays = lens.directions(pixels)[:, :2], found.camera.directions(pixels)[:, :2]
    lens_error = spread((found_rays - rays) * lens.matrix[0, 0])
    details = {
        "views": len(found.views),
        "pixels_against_the_true_lens": asdict(lens_error),
        "field_mm": 1e3 * error.largest,
    }
    return [
        Mark("calibration of the lens, synthetic boards", "px RMS", found.rms, 0.1, details=details),
        Mark(
            "calibration of the field, by its lines", "mm RMS", 1e3 * error.rms, 2.0, details={"largest": error.largest}
        ),
    ]
