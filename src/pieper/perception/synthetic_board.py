"""Pictures of a printed board, as a lens would take them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.perception.opencv import opencv
from pieper.spatial import rotation

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pieper.perception.board import Board
    from pieper.perception.camera import Camera
    from pieper.perception.frame import Image
    from pieper.spatial._checks import FloatArray

_SIDES = 4  # rays through a pixel, each way
_SOFT = 1.0  # px; what a lens makes of an edge


def board_poses(board: Board, count: int) -> Iterator[FloatArray]:
    """Poses of a board before the camera, near and far, to all sides, tilted by up to half a right angle."""
    middle = np.array([*(np.array(board.squares) * board.square / 2), 0.0])
    random = np.random.default_rng(11)
    for k in range(count):
        T = np.eye(4)
        tilt = random.uniform(0.15, 0.7) * np.array([np.cos(2.4 * k), np.sin(2.4 * k), 0.0])
        T[:3, :3] = rotation.from_rotation_vector(tilt)
        distance = random.uniform(0.45, 0.8)
        aside = np.array([np.cos(2.4 * k + 1), 0.7 * np.sin(2.4 * k + 1)]) * distance * 0.22
        T[:3, 3] = np.array([*aside, distance]) - T[:3, :3] @ middle
        yield T


class BoardCamera:
    """Takes pictures of a printed board through a lens: each pixel is the mean of sixteen rays, softened by the lens by a pixel.

    Parameters
    ----------
    camera : Camera
    board : Board
    """

    def __init__(self, camera: Camera, board: Board) -> None:
        width, height = camera.size
        self._rays = camera.directions(
            np.stack(np.meshgrid(np.arange(width + 1), np.arange(height + 1)), axis=-1) - 0.5
        )
        self._board = board

    def picture(self, T_camera_board: FloatArray, *, noise: float = 2.0, seed: int = 0) -> Image:
        """Return what the camera sees of the board at a pose."""
        T = np.linalg.inv(T_camera_board)
        along = self._rays @ T[:3, :3].T  # through the corners of the pixels
        four = along[:-1, :-1], along[:-1, 1:], along[1:, :-1], along[1:, 1:]
        white = np.zeros(along.shape[:2])[1:, 1:]
        for i in range(_SIDES):
            for j in range(_SIDES):  # no two in one row or column, so that no edge meets four at once
                s, t = (i + (j + 0.5) / _SIDES) / _SIDES, (j + (i + 0.5) / _SIDES) / _SIDES
                ray = (1 - s) * (1 - t) * four[0] + s * (1 - t) * four[1] + (1 - s) * t * four[2] + s * t * four[3]
                white += self._board.is_white(T[:2, 3] - ray[..., :2] * (T[2, 3] / ray[..., 2])[..., None])
        gray = opencv("drawing a board").GaussianBlur(30 + 190 * white / _SIDES**2, (0, 0), _SOFT)
        gray += np.random.default_rng(seed).normal(0, noise, gray.shape)
        image: Image = np.repeat(np.clip(np.rint(gray), 0, 255).astype(np.uint8)[..., None], 3, axis=2)
        return image
