"""Where a camera is on a robot: on its hand, or in its cell, from poses of the hand and the board that the camera saw from each.

With the camera on the hand, the board stands still; with the camera in the cell, the hand carries the board. Either way ::

    A_i X B_i = Y,    B_i = T_camera_target of pose i

on the hand     ``A = T_base_tcp``,       ``X = T_tcp_camera``,    ``Y = T_base_target``
in the cell     ``A = T_base_tcp^-1``,    ``X = T_base_camera``,   ``Y = T_tcp_target``

Closed forms begin (`pieper.perception.hand_eye_forms`). Poses that contradict the others are left out (`hand_eye_agreement`). The best beginning
is refined by nonlinear least squares, over poses, or over pixels where there are corners (`hand_eye_refinement`). What is refused before, and
which poses would help: `hand_eye_poses`.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import PieperWarning, VisionError
from pieper.perception.hand_eye_agreement import ODD, ROUNDS, Method, need_agreement, robust_start, turned_alike
from pieper.perception.hand_eye_doubts import board_scale, first_alike, other_size, repeats
from pieper.perception.hand_eye_poses import (
    ENOUGH_POSES,
    ENOUGH_TURN,
    LEAST_POSES,
    LEAST_TURN,
    CameraOn,
    checked_poses,
    missing_poses,
    need_turns,
    turns_of,
)
from pieper.perception.hand_eye_refinement import left_over, pixels_off, refine, refine_over_pixels, rms
from pieper.perception.opencv import opencv
from pieper.spatial import pose, rotation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from pieper.perception.board import Board
    from pieper.perception.board_views import BoardView
    from pieper.perception.camera import Camera
    from pieper.spatial._checks import FloatArray

__all__ = [
    "ENOUGH_POSES",
    "ENOUGH_TURN",
    "LEAST_POSES",
    "LEAST_TURN",
    "CameraOn",
    "HandEyeCalibration",
    "Method",
    "board_pose",
    "calibrate_hand_eye",
    "calibrate_hand_eye_from_views",
]

_NEVER_ODD_PIXELS = 0.3  # [px]


@dataclass(frozen=True, eq=False)
class HandEyeCalibration:
    """Where the camera is, and the evidence for it.

    Attributes
    ----------
    camera_on : "hand" or "cell"
    T_mount_camera : (4, 4) array
        ``T_tcp_camera`` or ``T_base_camera`` [m, -].
    T_holder_target : (4, 4) array
        ``T_base_target`` or ``T_tcp_target`` [m, -].
    names : tuple of str
        Of the poses.
    used : (n,) bool array
        False for those that were left out.
    position_residual, rotation_residual : (n,) arrays
        Of every pose: how far the board that was seen is from where it should be [m], [rad].
    covariance : (6, 6) array
        Of the camera's position [m], then rotation vector [rad], both in the axes of the mount, to first order.
    target_covariance : (6, 6) array
        The same of the board, in the axes of its holder.
    turns : (3,) array
        How much the hand turned about the axes about which it turned most, less, least: RMS over pairs of poses [rad].
    axes : (3, 3) array
        These axes as columns, in the frame of the tip for a camera on the hand, of the base for one in the cell.
    methods : tuple of Method
        The closed forms, the best first; it was where the refinement began.
    left_out : tuple of str
        Which poses were not used, and why.
    missing : tuple of str
        Which poses would help; empty when these are enough.
    pixel_rms : float or None
        Of the corners, where these were fitted [px].
    doubts : tuple of str
        What speaks against the input, as a board of another size; each is a `PieperWarning` too.
    """

    camera_on: CameraOn
    T_mount_camera: FloatArray
    T_holder_target: FloatArray
    names: tuple[str, ...]
    used: NDArray[np.bool_]
    position_residual: FloatArray
    rotation_residual: FloatArray
    covariance: FloatArray
    target_covariance: FloatArray
    turns: FloatArray
    axes: FloatArray
    methods: tuple[Method, ...]
    left_out: tuple[str, ...]
    missing: tuple[str, ...]
    pixel_rms: float | None = None
    doubts: tuple[str, ...] = ()

    @property
    def position_deviation(self) -> FloatArray:
        """Standard deviations of the camera's x, y, z, ``(3,)`` [m]."""
        return np.sqrt(np.diagonal(self.covariance)[:3])

    @property
    def rotation_deviation(self) -> FloatArray:
        """Standard deviations of the camera's rotation about x, y, z, ``(3,)`` [rad]."""
        return np.sqrt(np.diagonal(self.covariance)[3:])

    @property
    def mount(self) -> str:
        """Frame that the camera is fixed to: ``"tcp"`` or ``"base"``."""
        return "tcp" if self.camera_on == "hand" else "base"

    @property
    def holder(self) -> str:
        """Frame that the board was fixed to."""
        return "base" if self.camera_on == "hand" else "tcp"

    def T_base_camera(self, T_base_tcp: ArrayLike | None = None) -> FloatArray:
        """Return where the camera is, ``(..., 4, 4)``: for one on the hand, with the hand at `T_base_tcp`.

        Raises
        ------
        VisionError
            The camera is on the hand, and nobody said where that is.
        """
        if self.camera_on == "cell":
            return self.T_mount_camera
        if T_base_tcp is None:
            raise VisionError("the camera is on the hand: give T_base_tcp, where the hand is")
        return np.asarray(np.asarray(T_base_tcp, dtype=np.float64) @ self.T_mount_camera)

    def report(self) -> str:
        """Return the figures in lines for people."""
        p, r = 1e3 * self.T_mount_camera[:3, 3], np.degrees(rotation.as_rotation_vector(self.T_mount_camera[:3, :3]))
        dp, dr = 1e3 * self.position_deviation, np.degrees(self.rotation_deviation)
        lines = [
            f"camera in the frame of the {self.mount}",
            *(f"  {n}  {v:10.3f} +- {d:.2g} mm" for n, v, d in zip("xyz", p, dp, strict=True)),
            *(f"  r{n} {v:10.4f} +- {d:.2g} deg" for n, v, d in zip("xyz", r, dr, strict=True)),
            f"residual  {1e3 * rms(self.position_residual[self.used]):.3f} mm and "
            f"{np.degrees(rms(self.rotation_residual[self.used])):.4f} deg RMS over {int(self.used.sum())} poses"
            + ("" if self.pixel_rms is None else f", {self.pixel_rms:.3f} px RMS over their corners"),
            "turns     " + ", ".join(f"{np.degrees(t):.1f}" for t in self.turns) + " deg RMS about three axes",
        ]
        lines += [
            f"method    {m.name:<12s} {1e3 * m.position_rms:8.3f} mm {np.degrees(m.rotation_rms):8.4f} deg, "
            f"{1e3 * m.position_away:.3f} mm and {np.degrees(m.rotation_away):.4f} deg from the refined camera"
            for m in self.methods
        ]
        lines += [
            f"{1e3 * p:8.3f} mm  {np.degrees(r):8.4f} deg  {name}" + ("" if used else "  left out")
            for name, used, p, r in zip(
                self.names, self.used, self.position_residual, self.rotation_residual, strict=True
            )
        ]
        lines += [f"left out  {words}" for words in self.left_out]
        lines += [f"doubt     {words}" for words in self.doubts]
        return "\n".join(lines + [f"missing   {words}" for words in self.missing])


def calibrate_hand_eye(
    Ts_base_tcp: ArrayLike,
    Ts_camera_target: ArrayLike,
    *,
    camera_on: CameraOn = "hand",
    names: Sequence[str] | None = None,
) -> HandEyeCalibration:
    """Calibrate from poses of the hand and of the board.

    Parameters
    ----------
    Ts_base_tcp : (n, 4, 4) array
        Where the hand was, in the frame of the base [m, -].
    Ts_camera_target : (n, 4, 4) array
        Where the camera saw the board each time, in its own frame: x right, y down, z ahead.
    camera_on : "hand" or "cell"
    names : sequence of str, optional
        Of the poses, for messages; ``pose 1``, ... if not given.

    Returns
    -------
    HandEyeCalibration
        Where the camera and the board are, how far each view is off [m] and [rad], and the covariance.

    Raises
    ------
    VisionError
        Fewer than three poses, different numbers of both, something that is no pose, a board that is behind the camera; a hand that does not turn, or always about one axis; poses
        of which a third contradict each other.

    Notes
    -----
    The noise is taken to be that of the pose of the board, as large along all its axes, and its size is read from what remains: from few poses it is
    known badly, and so is `covariance`.

    Examples
    --------
    >>> turns = [[0, 0, 0], [0.4, 0, 0], [0, 0.5, 0], [0.3, -0.2, 0.4]]
    >>> Ts_base_tcp = pose.from_position_rotation(np.eye(4)[:, :3], rotation.from_rotation_vector(turns))
    >>> T_tcp_camera = pose.from_xyz_rpy([0.03, 0.0, 0.08], [0.0, 0.0, 1.5])
    >>> T_base_target = pose.from_xyz_rpy([0.2, 0.1, 1.0], [3.0, 0.0, 0.0])
    >>> Ts_camera_target = pose.inverse(Ts_base_tcp @ T_tcp_camera) @ T_base_target
    >>> found = calibrate_hand_eye(Ts_base_tcp, Ts_camera_target)
    >>> bool(abs(found.T_mount_camera - T_tcp_camera).max() < 1e-9)
    True
    """
    A, B, labels = checked_poses(Ts_base_tcp, Ts_camera_target, camera_on, names)
    turns, axes = turns_of(A)
    need_turns(turns, axes, camera_on)
    X, Y, used, left_out, methods = robust_start(A, B, labels, camera_on)
    X, Y, covariance = refine(X, Y, A[used], B[used])
    return _result(camera_on, X, Y, covariance, A, B, labels, used, left_out, methods)


def calibrate_hand_eye_from_views(
    Ts_base_tcp: ArrayLike,
    views: Sequence[BoardView],
    board: Board,
    camera: Camera,
    *,
    camera_on: CameraOn = "hand",
) -> HandEyeCalibration:
    """Calibrate from poses of the hand and the corners of a board in the image of each.

    Parameters
    ----------
    Ts_base_tcp : (n, 4, 4) array
        Where the hand was [m, -].
    views : sequence of BoardView
        What `pieper.perception.board.Board.find` found from there.
    board : Board
    camera : Camera
    camera_on : "hand" or "cell"

    Returns
    -------
    HandEyeCalibration
        Where the camera and the board are, how far each view is off [m] and [rad], and the covariance.

    Raises
    ------
    VisionError
        As for `calibrate_hand_eye`; and a view from which no pose follows.

    Notes
    -----
    What is minimised is the distance of the corners in the image. `covariance` is that of the jackknife over poses, to first order, unless the scatter
    of the corners alone makes it larger: errors of the robot, which move all corners of an image together, are in it. From n poses it is
    itself known as well as n samples tell. Single views of a chessboard that were taken upside down are turned; a ChArUco board has no such trouble.
    """
    seen = list(views)
    if len(seen) != len(np.atleast_1d(np.asarray(Ts_base_tcp, dtype=object))):
        raise VisionError(
            f"there must be a view for every pose, got {len(seen)} views and {len(np.asarray(Ts_base_tcp))} poses"
        )
    Ts_camera_target = np.array([board_pose(view, board, camera) for view in seen]).reshape(-1, 4, 4)
    A, B, labels = checked_poses(Ts_base_tcp, Ts_camera_target, camera_on, [view.name for view in seen])
    turns, axes = turns_of(A)
    need_turns(turns, axes, camera_on)
    if board.kind == "chessboard":
        B, turned = turned_alike(A, B, board)
        seen = [replace(view, ids=view.ids[::-1].copy()) if t else view for view, t in zip(seen, turned, strict=True)]
    X, Y, used, _, methods = robust_start(A, B, labels, camera_on, last_word=False)
    X, Y, _ = refine(X, Y, A[used], B[used])
    for _ in range(ROUNDS):  # poses from a single image scatter more than its corners do: those decide who is odd
        kept = [view for view, use in zip(seen, used, strict=True) if use]
        X, Y, covariance, rms = refine_over_pixels(X, Y, A[used], kept, board, camera)
        off = np.array([pixels_off(X, Y, *one, board, camera) for one in zip(A, seen, strict=True)])
        now = off <= max(ODD * float(np.median(off[used])), _NEVER_ODD_PIXELS)
        if (now == used).all() or now.sum() < LEAST_POSES or turns_of(A[now])[0][1] < LEAST_TURN:
            break
        used = now
    need_agreement(used, labels, camera_on)
    left_out = tuple(
        f"{labels[k]}: {off[k]:.2f} px RMS off, where the others have {np.median(off[used]):.2f}"
        for k in np.flatnonzero(~used)
    )
    found = _result(camera_on, X, Y, covariance, A, B, labels, used, left_out, methods)
    return replace(found, pixel_rms=rms)


def board_pose(view: BoardView, board: Board, camera: Camera) -> FloatArray:
    """Return ``T_camera_target``, ``(4, 4)``, of a board in an image.

    Raises
    ------
    VisionError
        The corners give none.
    """
    cv2 = opencv("the pose of a board")
    p = np.pad(board.corners[view.ids], ((0, 0), (0, 1)))
    try:
        done, turn, shift = cv2.solvePnP(p, view.uv, camera.matrix, camera.distortion, flags=cv2.SOLVEPNP_IPPE)
        if done:
            turn, shift = cv2.solvePnPRefineLM(p, view.uv, camera.matrix, camera.distortion, turn, shift)
    except cv2.error as error:
        raise VisionError(f"{view.name}: no pose of the board follows from its corners: {error.err}") from None
    if not done or not (np.isfinite(turn).all() and np.isfinite(shift).all()):
        raise VisionError(f"{view.name}: no pose of the board follows from its corners")
    return pose.from_position_rotation(np.ravel(shift), rotation.from_rotation_vector(np.ravel(turn)))


def _result(
    camera_on: CameraOn, X: FloatArray, Y: FloatArray, covariance: FloatArray, A: FloatArray, B: FloatArray, labels: tuple[str, ...],
    used: NDArray[np.bool_], left_out: tuple[str, ...], methods: tuple[Method, ...],
) -> HandEyeCalibration:  # fmt: skip
    p, w = left_over(X, Y, A, B)
    turns, axes = turns_of(A[used])
    arrays = [
        X, Y, used, np.linalg.norm(p, axis=1), np.linalg.norm(w, axis=1), covariance[:6, :6].copy(), covariance[6:, 6:].copy(), turns, axes,
    ]  # fmt: skip
    for array in arrays:
        array.setflags(write=False)
    X, Y, used, position, turn, of_camera, of_target, turns, axes = arrays
    first = first_alike(A[used])
    doubts = (
        *repeats(first, [name for name, use in zip(labels, used, strict=True) if use]),
        *other_size(board_scale(X, A[used], B[used])),
    )
    for words in doubts:
        warnings.warn(words, PieperWarning, stacklevel=3)
    return HandEyeCalibration(
        camera_on, X, Y, labels, used, position, turn, of_camera, of_target, turns, axes, methods, left_out,
        missing_poses(turns, axes, camera_on, len(np.unique(first))), doubts=doubts,
    )  # fmt: skip
