"""From where to look at a board so that a hand-eye calibration comes out well: poses that the arm reaches, chosen for what they tell.

Candidates are places of the board before the camera, whole in the image, tilted to all sides. Of those that the arm reaches, one after the
other is taken that lowers the uncertainty of the camera's pose the most (greedy A-optimal design: the trace of the inverse information),
beginning with what the poses that are already there tell. A rough idea of where the camera and the board are is enough.

References
----------
Pukelsheim, "Optimal design of experiments", SIAM 2006, chapter 6: criteria of information matrices.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, get_args

import numpy as np

from pieper.errors import VisionError, unknown_name
from pieper.perception.hand_eye import CameraOn
from pieper.perception.hand_eye_refinement import pose_slopes
from pieper.spatial import pose, rotation

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from pieper.arm import Arm
    from pieper.perception.board import Board
    from pieper.perception.camera import Camera
    from pieper.spatial._checks import FloatArray

CANDIDATES = 600
"""Places of the board before the camera that are tried."""

MOST_TILT = float(np.radians(50.0))
"""Of the board against the view; beyond it corners are found badly [rad]."""

POSITION_NOISE, ROTATION_NOISE = 1e-3, float(np.radians(0.2))
"""Of the pose of a board, for the choice and for what is foretold [m], [rad]."""

_SMALLEST, _LARGEST = 0.25, 0.75  # of the image's width, for the board's
_FINEST = 3.0  # pixels of the modules of a marker
_BORDER = 0.04  # of the image that the board keeps clear
_WEAK = 1e-6  # information that is there from the start, so that the first pose can be chosen
_FEWEST = 3


@dataclass(frozen=True, eq=False)
class CapturePlan:
    """Where to put the arm.

    Attributes
    ----------
    q : (k, n) array
        Joint values [rad or m], in an order in which the arm moves little.
    Ts_base_tcp : (k, 4, 4) array
        The hand there.
    Ts_camera_target : (k, 4, 4) array
        Where the board should be seen.
    position_deviation, rotation_deviation : float
        What is to be expected of the camera's pose with these [m], [rad]: standard deviations, root of the sum over the axes, with noise of
        `POSITION_NOISE` and `ROTATION_NOISE`.
    tried, reached : int
        How many places of the board were tried, and how many of them the arm reaches.
    """

    q: FloatArray
    Ts_base_tcp: FloatArray
    Ts_camera_target: FloatArray
    position_deviation: float
    rotation_deviation: float
    tried: int
    reached: int


def plan_captures(
    arm: Arm,
    camera: Camera,
    board: Board,
    *,
    camera_on: CameraOn,
    T_mount_camera: ArrayLike,
    T_holder_target: ArrayLike,
    count: int = 12,
    q_near: ArrayLike | None = None,
    have: ArrayLike | None = None,
    usable: Callable[[FloatArray], bool] | None = None,
    seed: int = 0,
) -> CapturePlan:
    """Propose arm poses from which the board is seen.

    Parameters
    ----------
    arm : Arm
    camera : Camera
    board : Board
    camera_on : "hand" or "cell"
    T_mount_camera : (4, 4) array
        About where the camera is: ``T_tcp_camera`` on the hand, ``T_base_camera`` in the cell.
    T_holder_target : (4, 4) array
        About where the board is: ``T_base_target``, or ``T_tcp_target`` when the hand carries it.
    count : int
        How many poses.
    q_near : (n,) array, optional
        Where the arm is; answers near it are preferred.
    have : (k, 4, 4) array, optional
        ``Ts_base_tcp`` that were captured already; the new ones add to them.
    usable : callable, optional
        Whether joint values (n,) may be taken: nothing in the way.
    seed : int
        Of the candidates.

    Returns
    -------
    CapturePlan
        Joint values and poses, in an order in which the arm moves little.

    Raises
    ------
    VisionError
        The arm reaches fewer poses than are asked for, or a count below 1.

    Notes
    -----
    The board has to be whole in the image and face the camera; that the arm itself may be between them only `usable` can tell.
    """
    if camera_on not in get_args(CameraOn):
        raise unknown_name("camera_on", str(camera_on), get_args(CameraOn))
    if isinstance(count, bool) or count < 1:
        raise VisionError(f"count must be 1 or more, got {count!r}")
    X, Y = (np.asarray(T, dtype=np.float64) for T in (T_mount_camera, T_holder_target))
    for name, T in (("T_mount_camera", X), ("T_holder_target", Y)):
        if T.shape != (4, 4) or not np.isfinite(T).all():
            raise VisionError(f"{name} must be a finite pose of shape (4, 4), got shape {T.shape}")
    B = _seen_places(camera, board, np.random.default_rng(seed))
    A = Y @ pose.inverse(B) @ pose.inverse(X)  # from A X B = Y
    hand = A if camera_on == "hand" else pose.inverse(A)
    near = np.clip(np.zeros(arm.dof), *arm.limits.T) if q_near is None else np.asarray(q_near, dtype=np.float64)
    reached, q = _reached(arm, hand, near, usable)
    if len(reached) < count:
        raise VisionError(
            f"the arm reaches {len(reached)} of {len(B)} places from which the board would be seen, and {count} poses are asked for; is "
            "the board where it can be seen, and is the camera about where it was said to be?"
        )
    before = np.zeros((12, 12))
    if have is not None and np.size(have):
        taken = np.asarray(have, dtype=np.float64).reshape(-1, 4, 4)
        before = _information(X, Y, taken if camera_on == "hand" else pose.inverse(taken)).sum(axis=0)
    rows, spread = _chosen(_information(X, Y, A[reached]), before, count, far=float(np.median(B[:, 2, 3])))
    rows = _in_short_order(q[rows], near, rows)
    return CapturePlan(
        q[rows], hand[reached[rows]], B[reached[rows]], float(np.sqrt(np.trace(spread[:3, :3]))), float(np.sqrt(np.trace(spread[3:6, 3:6]))),
        len(B), len(reached),
    )  # fmt: skip


def _seen_places(camera: Camera, board: Board, rng: np.random.Generator) -> FloatArray:
    """``T_camera_target``, (k, 4, 4), from which the whole board is in the image."""
    width, height = board.size
    outer = np.array([[0.0, 0.0, 0.0], [width, 0.0, 0.0], [width, height, 0.0], [0.0, height, 0.0]])
    middle = outer.mean(axis=0)
    size = np.array(camera.size, dtype=np.float64)
    focal = float(camera.matrix[0, 0])
    found = []
    for _ in range(CANDIDATES):
        share = rng.uniform(_SMALLEST, _LARGEST)
        distance = focal * max(width, height) / (share * float(size.min()))
        tilt, towards, roll = MOST_TILT * np.sqrt(rng.uniform()), rng.uniform(0, 2 * np.pi), rng.uniform(-np.pi, np.pi)
        R = rotation.from_rotation_vector(
            tilt * np.array([np.cos(towards), np.sin(towards), 0.0])
        ) @ rotation.from_rotation_vector(np.array([0.0, 0.0, roll]))
        ray = camera.directions(size * rng.uniform(0.2, 0.8, 2))
        T = pose.from_position_rotation(distance * ray - R @ middle, R)
        if board.module * focal * np.cos(tilt) / distance < _FINEST:
            continue
        uv = camera.project(outer @ R.T + T[:3, 3])
        if np.isfinite(uv).all() and (uv > _BORDER * size).all() and (uv < (1 - _BORDER) * size).all():
            found.append(T)
    if not found:
        raise VisionError(f"the board {board} is never whole in an image of {camera.size[0]} x {camera.size[1]} pixels")
    return np.array(found)


def _reached(
    arm: Arm, hand: FloatArray, near: FloatArray, usable: Callable[[FloatArray], bool] | None
) -> tuple[FloatArray, FloatArray]:
    """Which of the poses the arm reaches, and the joint values nearest to where it is."""
    rows: list[int] = []
    kept: list[FloatArray] = []
    for row, T in enumerate(hand):
        found = arm.ik(T, near)
        answers = np.asarray(found.q)[np.asarray(found.within_limits)]
        nearest_first = answers[np.argsort(np.abs(answers - near).max(axis=1, initial=0.0), kind="stable")]
        q = next((answer for answer in nearest_first if usable is None or usable(answer)), None)
        if q is not None:
            rows.append(row)
            kept.append(q)
    return np.array(rows, dtype=np.intp), np.array(kept).reshape(-1, arm.dof)


def _information(X: FloatArray, Y: FloatArray, A: FloatArray) -> FloatArray:
    """Of each pose about the twelve numbers of camera and board, (k, 12, 12)."""
    J = pose_slopes(X, Y, A, pose.inverse(A @ X) @ Y) / np.repeat([POSITION_NOISE, ROTATION_NOISE], 3)[:, None]
    return np.asarray(np.swapaxes(J, 1, 2) @ J)


def _chosen(information: FloatArray, before: FloatArray, count: int, *, far: float) -> tuple[list[int], FloatArray]:
    """Rows that together tell the most of the camera, and its covariance with them; turns weigh at the distance of the board."""
    total = before + _WEAK * np.diag([1.0 / POSITION_NOISE**2] * 3 + [1.0 / ROTATION_NOISE**2] * 3 + [1.0] * 6)
    weights = np.array([1.0] * 3 + [far**2] * 3)
    rows: list[int] = []
    for _ in range(count):
        spread = np.linalg.inv(total + information)
        worth = (np.diagonal(spread, axis1=1, axis2=2)[:, :6] * weights).sum(axis=1)
        worth[rows] = np.inf
        rows.append(int(np.argmin(worth)))
        total = total + information[rows[-1]]
    return rows, np.asarray(np.linalg.inv(total), dtype=np.float64)


def _in_short_order(q: FloatArray, near: FloatArray, rows: list[int]) -> list[int]:
    """From where the arm is, always on to the nearest."""
    left, at = list(range(len(rows))), near
    order: list[int] = []
    while left:
        k = min(left, key=lambda row: float(np.abs(q[row] - at).max()))
        left.remove(k)
        order.append(rows[k])
        at = q[k]
    return order
