"""Where a camera is on a robot: on its hand, or in its cell, from poses of the hand and the board that the camera saw from each.

With the camera on the hand, the board stands still; with the camera in the cell, the hand carries the board. Either way ::

    A_i X B_i = Y,    B_i = T_camera_target of pose i

on the hand     ``A = T_base_tcp``,       ``X = T_tcp_camera``,    ``Y = T_base_target``
in the cell     ``A = T_base_tcp^-1``,    ``X = T_base_camera``,   ``Y = T_tcp_target``

Closed forms begin: two of our own, and those of OpenCV where it has them (its Python package 5.0.0 has not). Poses that contradict the others
are found by least median of squares over small subsets and left out. The best beginning is refined by nonlinear least squares, over poses, or
over pixels where there are corners. OpenCV's solvers answer without a word when nothing can be known (zeros, NaN, or a number); here the turns
of the hand are looked at first.

References
----------
Park, Martin, "Robot sensor calibration: solving AX = XB on the Euclidean group", IEEE Trans. Robotics and Automation 1994, eq. (19), (22).

Shah, "Solving the robot-world/hand-eye calibration problem using the Kronecker product", J. Mechanisms and Robotics 2013, section 3.

Barfoot, "State estimation for robotics", Cambridge 2017, section 7.1.5: derivatives on rotations.

Rousseeuw, "Least median of squares regression", J. American Statistical Association 1984.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np

from pieper.errors import VisionError, unknown_name
from pieper.perception.opencv import opencv
from pieper.spatial import pose, rotation

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from pieper.perception.board import Board
    from pieper.perception.calibration import BoardView
    from pieper.perception.camera import Camera
    from pieper.spatial._checks import FloatArray

CameraOn = Literal["hand", "cell"]
"""What carries the camera. The other one carries the board."""

LEAST_POSES = 3
"""With two, every pair of turns leaves a freedom."""

LEAST_TURN = float(np.radians(0.5))
"""About a second axis, root mean square over all pairs of poses; with less, nothing is known [rad]."""

ENOUGH_TURN = float(np.radians(15.0))
"""The same, below which more is asked for [rad]."""

ENOUGH_POSES = 10
"""Fewer are used, and more asked for."""

_ODD = 3.0  # medians: for six Gaussian numbers, far beyond one in a million
_NEVER_ODD_PIXELS = 0.3  # [px]
_NEVER_ODD = 1e-7  # [m], with turns at the distance of the board; and below it nothing is odd
_FARTHEST_HAND, _FARTHEST_BOARD = 100.0, 20.0  # [m] from base and camera: metres and millimetres are told apart by it
_PLAIN = 0.01  # of the distance of the board: with less, nobody has to ask what was meant
_FAR_OFF = 0.1  # of the distance of the board: more is no noise
_SUBSETS, _SUBSET = 80, 4
_ROUNDS = 12
_STEP = 1e-6  # of the differences that make derivatives [m], [rad]
_STEPS, _HALVINGS = 30, 12  # of Gauss and Newton
_NO_STEP, _NO_GAIN = 1e-13, 1e-14
_FLOOR = 1e-10  # [m], [rad] noise below which rounding decides


class Method(NamedTuple):
    """A closed form, and what it left over: `name`, RMS of position [m] and of rotation [rad], and how far its camera is from the refined one."""

    name: str
    position_rms: float
    rotation_rms: float
    position_away: float
    rotation_away: float


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
            f"residual  {1e3 * _rms(self.position_residual[self.used]):.3f} mm and "
            f"{np.degrees(_rms(self.rotation_residual[self.used])):.4f} deg RMS over {int(self.used.sum())} poses"
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
    A, B, labels = _checked(Ts_base_tcp, Ts_camera_target, camera_on, names)
    turns, axes = _turns(A)
    _observable(turns, axes, camera_on)
    X, Y, used, left_out, methods = _robust(A, B, labels, camera_on)
    X, Y, covariance = _refined(X, Y, A[used], B[used])
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
    A, B, labels = _checked(Ts_base_tcp, Ts_camera_target, camera_on, [view.name for view in seen])
    turns, axes = _turns(A)
    _observable(turns, axes, camera_on)
    if board.kind == "chessboard":
        B, turned = _turned_alike(A, B, board)
        seen = [replace(view, ids=view.ids[::-1].copy()) if t else view for view, t in zip(seen, turned, strict=True)]
    X, Y, used, _, methods = _robust(A, B, labels, camera_on, last_word=False)
    X, Y, _ = _refined(X, Y, A[used], B[used])
    for _ in range(_ROUNDS):  # poses from a single image scatter more than its corners do: those decide who is odd
        kept = [view for view, use in zip(seen, used, strict=True) if use]
        X, Y, covariance, rms = _refined_over_pixels(X, Y, A[used], kept, board, camera)
        off = np.array([_pixels_off(X, Y, *one, board, camera) for one in zip(A, seen, strict=True)])
        now = off <= max(_ODD * float(np.median(off[used])), _NEVER_ODD_PIXELS)
        if (now == used).all() or now.sum() < LEAST_POSES or _turns(A[now])[0][1] < LEAST_TURN:
            break
        used = now
    _mostly_agree(used, labels, camera_on)
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


# --------------------------------------------------------------------------------------------------------------------
# what comes in


def _checked(
    Ts_base_tcp: ArrayLike, Ts_camera_target: ArrayLike, camera_on: str, names: Sequence[str] | None
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    if camera_on not in get_args(CameraOn):
        raise unknown_name("camera_on", str(camera_on), get_args(CameraOn))
    hand, seen = _poses(Ts_base_tcp, "Ts_base_tcp"), _poses(Ts_camera_target, "Ts_camera_target")
    if len(hand) != len(seen):
        raise VisionError(
            f"there must be one Ts_camera_target for each of Ts_base_tcp, got {len(seen)} and {len(hand)}; leave out the poses from which "
            "the board was not seen"
        )
    labels = tuple(f"pose {k + 1}" for k in range(len(hand))) if names is None else tuple(map(str, names))
    if len(labels) != len(hand):
        raise VisionError(f"there must be a name for every pose, got {len(labels)} names and {len(hand)} poses")
    if len(hand) < LEAST_POSES:
        raise VisionError(f"{LEAST_POSES} poses are needed, better {ENOUGH_POSES}, got {len(hand)}")
    _plausible(hand, seen)
    return (hand if camera_on == "hand" else pose.inverse(hand)), seen, labels


def _plausible(hand: FloatArray, seen: FloatArray) -> None:
    """What fits together, and is still no hand and no camera: other units, and other conventions."""
    for name, what, Ts, most in (
        ("Ts_base_tcp", "hand", hand, _FARTHEST_HAND),
        ("Ts_camera_target", "board", seen, _FARTHEST_BOARD),
    ):
        far = float(np.median(np.linalg.norm(Ts[:, :3, 3], axis=1)))
        if far > most:
            raise VisionError(
                f"{name}: the {what} is {far:.4g} m away; positions are metres, so divide by 1000 if these are millimetres"
            )
    behind = int((seen[:, 2, 3] < 0.0).sum())
    if 2 * behind > len(seen):
        raise VisionError(
            f"Ts_camera_target: the board is behind the camera in {behind} of {len(seen)} poses, and cannot be seen there; the camera has z ahead, "
            "x right and y down, as in OpenCV (OpenGL's y and z are the other way round), and T_camera_target takes coordinates of the board "
            "into its frame, not back"
        )


def _poses(values: ArrayLike, name: str) -> FloatArray:
    try:
        Ts = np.array(values, dtype=np.float64)
    except (ValueError, TypeError):
        raise VisionError(f"{name} must be numbers of shape (n, 4, 4)") from None
    if Ts.ndim != 3 or Ts.shape[1:] != (4, 4):
        raise VisionError(f"{name} must have shape (n, 4, 4), got {Ts.shape}")
    for k, T in enumerate(Ts):
        if not np.isfinite(T).all():
            raise VisionError(f"{name}[{k}] must be finite, got NaN or infinity")
        away = float(abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max())
        if away <= 1e-4 and np.linalg.det(T[:3, :3]) < 0:
            raise VisionError(
                f"{name}[{k}] is no pose: its axes are left-handed, as in a mirror; turn one of them round"
            )
        if away > 1e-4 or abs(T[3] - (0, 0, 0, 1)).max() > 1e-9:
            raise VisionError(
                f"{name}[{k}] is no pose: its 3x3 block is {away:.2g} from a rotation, or its last row is not 0 0 0 1"
            )
    Ts[:, :3, :3] = rotation.nearest(Ts[:, :3, :3])
    return Ts


def _turns(A: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How much was turned about which axes, RMS over pairs of poses, the most first; (3,) and (3, 3)."""
    i, j = np.triu_indices(len(A), 1)
    w = rotation.as_rotation_vector(np.swapaxes(A[i, :3, :3], -1, -2) @ A[j, :3, :3])
    values, vectors = np.linalg.eigh(w.T @ w / len(w))
    return np.sqrt(np.maximum(values[::-1], 0.0)), np.ascontiguousarray(vectors[:, ::-1])


def _observable(turns: FloatArray, axes: FloatArray, camera_on: CameraOn) -> None:
    frame = "tip" if camera_on == "hand" else "base"
    if turns[0] < LEAST_TURN:
        raise VisionError(
            f"the hand does not turn between the poses ({np.degrees(turns[0]):.2g} deg), and shifts alone say nothing of where the camera is; "
            "turn it by 20 deg and more, about two axes at least"
        )
    if turns[1] < LEAST_TURN:
        raise VisionError(
            f"all turns of the hand are about one axis, {_axis(axes[:, 0])} in the frame of the {frame}: where the camera is along it, and "
            f"the board with it, cannot be known; add poses that are turned by 20 deg and more about {_axis(axes[:, 1])}"
        )


def _missing(turns: FloatArray, axes: FloatArray, camera_on: CameraOn, count: int) -> tuple[str, ...]:
    words = []
    frame = "tip" if camera_on == "hand" else "base"
    if turns[1] < ENOUGH_TURN:
        which = axes[:, 1] if turns[0] >= ENOUGH_TURN else axes[:, 0]
        words.append(
            f"the hand turns by {np.degrees(turns[1]):.1f} deg RMS about its second axis, and {np.degrees(ENOUGH_TURN):.0f} and more are better: "
            f"add poses turned by 20 to 40 deg about {_axis(which)} and {_axis(axes[:, 2])} in the frame of the {frame}"
        )
    if count < ENOUGH_POSES:
        words.append(f"{count} poses say little of how far they can be trusted: {ENOUGH_POSES - count} more")
    return tuple(words)


def _axis(vector: FloatArray) -> str:
    v = vector * (1.0 if vector[int(np.argmax(np.abs(vector)))] > 0 else -1.0)
    return "(" + ", ".join(f"{part + 0.0:.2f}" for part in np.round(v, 2)) + ")"


# --------------------------------------------------------------------------------------------------------------------
# closed forms


def _by_pairs(A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Park and Martin: for all pairs ``A_ij X = X B_ij``; axes of turns are matched, then positions are linear."""
    i, j = np.array(list(combinations(range(len(A)), 2))).T
    A_ij, B_ij = pose.inverse(A[j]) @ A[i], B[j] @ pose.inverse(B[i])
    a, b = rotation.as_rotation_vector(A_ij[:, :3, :3]), rotation.as_rotation_vector(B_ij[:, :3, :3])
    plain = np.linalg.norm(a, axis=1) < 3.0  # an axis of a half turn has two signs
    if plain.sum() >= 3:
        a, b, A_ij, B_ij = a[plain], b[plain], A_ij[plain], B_ij[plain]
    X = np.eye(4)
    X[:3, :3] = _turn_onto(b, a)
    rows = (A_ij[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    X[:3, 3] = np.linalg.lstsq(rows, (B_ij[:, :3, 3] @ X[:3, :3].T - A_ij[:, :3, 3]).reshape(-1), rcond=None)[0]
    return X, _mean_target(X, A, B)


def _by_product(A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shah: ``vec(R_A R_X R_B) = (R_A kron R_B^T) vec(R_X)``; both rotations from one singular pair, then positions are linear."""
    R_A, R_B = A[:, :3, :3], B[:, :3, :3]
    K = np.einsum("nij,nlk->ikjl", R_A, R_B).reshape(9, 9)
    U, _, V = np.linalg.svd(K)
    R_X, R_Y = V[0].reshape(3, 3), U[:, 0].reshape(3, 3)
    if np.linalg.det(R_X) < 0:
        R_X, R_Y = -R_X, -R_Y
    R_X, R_Y = _nearest(R_X), _nearest(R_Y)
    n = len(A)
    rows = np.concatenate([R_A, np.tile(-np.eye(3), (n, 1, 1))], axis=2).reshape(-1, 6)
    known = -(A[:, :3, 3] + np.einsum("nij,jk,nk->ni", R_A, R_X, B[:, :3, 3])).reshape(-1)
    t = np.linalg.lstsq(rows, known, rcond=None)[0]
    return pose.from_position_rotation(t[:3], R_X), pose.from_position_rotation(t[3:], R_Y)


def _opencv_methods() -> dict[str, Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]]:
    """OpenCV's solvers by name: none where its Python package lacks them."""
    cv2 = opencv("a hand-eye calibration")

    def hand_eye(number: int) -> Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
        def solve(A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
            R, t = cv2.calibrateHandEye(*_split(A), *_split(B), method=number)
            X = _assembled(R, t)
            return X, _mean_target(X, A, B)

        return solve

    def robot_world(number: int) -> Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
        def solve(A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
            # OpenCV's "world" is the board and its "gripper" what A leads from: it returns the inverses of Y and X
            R_Y, t_Y, R_X, t_X = cv2.calibrateRobotWorldHandEye(*_split(B), *_split(pose.inverse(A)), method=number)
            return pose.inverse(_assembled(R_X, t_X)), pose.inverse(_assembled(R_Y, t_Y))

        return solve

    found: dict[str, Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]] = {}
    if hasattr(cv2, "calibrateHandEye"):
        for name in ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS"):
            found[f"OpenCV {name.title()}"] = hand_eye(getattr(cv2, f"CALIB_HAND_EYE_{name}"))
    if hasattr(cv2, "calibrateRobotWorldHandEye"):
        for name in ("SHAH", "LI"):
            found[f"OpenCV {name.title()}"] = robot_world(getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name}"))
    return found


def _split(Ts: FloatArray) -> tuple[list[FloatArray], list[FloatArray]]:
    return [T[:3, :3].copy() for T in Ts], [T[:3, 3].copy() for T in Ts]


def _assembled(R: Any, t: Any) -> FloatArray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, np.ravel(t)
    return T


def _turn_onto(b: FloatArray, a: FloatArray) -> FloatArray:
    """The rotation that brings vectors b, (n, 3), nearest to a."""
    U, _, V = np.linalg.svd(a.T @ b)
    return np.asarray(U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ V))]) @ V)


def _nearest(M: FloatArray) -> FloatArray:
    U, _, V = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ V))]) @ V)


def _mean_target(X: FloatArray, A: FloatArray, B: FloatArray) -> FloatArray:
    Ys = A @ X @ B
    return pose.from_position_rotation(Ys[:, :3, 3].mean(axis=0), _nearest(Ys[:, :3, :3].sum(axis=0)))


# --------------------------------------------------------------------------------------------------------------------
# who contradicts


def _left_over(X: FloatArray, Y: FloatArray, A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Position (n, 3) [m] and rotation vector (n, 3) [rad] of the board that was seen, in the board that should be."""
    E = pose.inverse(Y) @ A @ X @ B
    return E[:, :3, 3], rotation.as_rotation_vector(E[:, :3, :3])


def _distance(X: FloatArray, Y: FloatArray, A: FloatArray, B: FloatArray) -> FloatArray:
    """One number for each pose [m]: position, and rotation at the distance of the board."""
    p, w = _left_over(X, Y, A, B)
    far = float(np.median(np.linalg.norm(B[:, :3, 3], axis=1)))
    return np.asarray(np.hypot(np.linalg.norm(p, axis=1), far * np.linalg.norm(w, axis=1)))


def _robust(
    A: FloatArray, B: FloatArray, labels: tuple[str, ...], camera_on: CameraOn, *, last_word: bool = True
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_], tuple[str, ...], tuple[Method, ...]]:
    """The best closed form of those that agree, who they are, who is left out, and all closed forms compared.

    Without the `last_word` it is no error when many are left out: somebody judges them again.
    """
    d, used = _agreeing(A, B)
    far = float(np.median(np.linalg.norm(B[:, :3, 3], axis=1)))
    usual = float(np.median(d[used]))
    meant = "" if usual < _PLAIN * far and used.all() else _otherwise(A, B, camera_on, usual)
    if usual > _FAR_OFF * far or meant:
        raise VisionError(
            f"the poses do not belong together: half of them are off by {usual:.2g} m and more, with the board {far:.2g} m away; "
            f"{meant or f'is the camera on the {camera_on}, as was said, and is the tip of the arm the one whose poses were given?'}"
        )
    if last_word or used.sum() < LEAST_POSES:
        _mostly_agree(used, labels, camera_on)
    turns, axes = _turns(A[used])
    _observable(turns, axes, camera_on)
    forms = {"pairs": _by_pairs, "product": _by_product, **_opencv_methods()}
    solved: list[tuple[float, str, FloatArray, FloatArray]] = []
    for name, form in forms.items():
        try:
            X, Y = form(A[used], B[used])
        except Exception:  # noqa: BLE001  OpenCV gives up in ways of its own; the others go on
            continue
        if np.isfinite(X).all() and np.isfinite(Y).all() and rotation.deviation(X[:3, :3]).max() < 1e-6:
            solved.append((_rms(_distance(X, Y, A[used], B[used])), name, X, Y))
    solved.sort(key=lambda row: row[0])
    _, _, X, Y = solved[0]
    refined, _, _ = _refined(X, Y, A[used], B[used])
    methods = []
    for _, name, X_form, Y_form in solved:
        p, w = _left_over(X_form, Y_form, A[used], B[used])
        away = pose.distance(X_form, refined)
        methods.append(
            Method(
                name, _rms(np.linalg.norm(p, axis=1)), _rms(np.linalg.norm(w, axis=1)), float(away[0]), float(away[1])
            )
        )
    X_far = _left_over(refined, _mean_target(refined, A[used], B[used]), A, B)
    left_out = tuple(
        f"{labels[k]}: {1e3 * np.linalg.norm(X_far[0][k]):.3g} mm and {np.degrees(np.linalg.norm(X_far[1][k])):.3g} deg off, "
        f"where the others have {1e3 * usual:.3g} mm together"
        for k in np.flatnonzero(~used)
    )
    return X, Y, used, left_out, tuple(methods)


def _mostly_agree(used: NDArray[np.bool_], labels: tuple[str, ...], camera_on: CameraOn) -> None:
    out = len(used) - int(used.sum())
    if out > max(1, len(used) // 4) or used.sum() < LEAST_POSES:
        odd = ", ".join(labels[k] for k in np.flatnonzero(~used))
        raise VisionError(
            f"the poses contradict each other: {out} of {len(used)} would have to be left out ({odd}); did the board or the camera move, or "
            f"did the arm not stand still, is the size of the board right, and is the camera on the {camera_on}, as was said?"
        )


def _agreeing(A: FloatArray, B: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """How far each pose is off [m], and which agree."""
    n = len(A)
    X, Y = _by_product(A, B)
    best = _distance(X, Y, A, B)
    everyone = np.ones(n, dtype=np.bool_)
    if n < _SUBSET + 1:
        return best, everyone
    rng = np.random.default_rng(0)
    every = list(combinations(range(n), _SUBSET))
    chosen = (
        every if len(every) <= _SUBSETS else [sorted(rng.choice(n, _SUBSET, replace=False)) for _ in range(_SUBSETS)]
    )
    for rows in chosen:
        some = np.array(rows)
        if _turns(A[some])[0][1] < LEAST_TURN:
            continue
        d = _distance(*_by_product(A[some], B[some]), A, B)
        if np.median(d) < np.median(best):
            best = d
    used = best <= max(_ODD * float(np.median(best)), _NEVER_ODD)
    for _ in range(_ROUNDS):
        if used.sum() < LEAST_POSES or _turns(A[used])[0][1] < LEAST_TURN:
            break
        X, Y, _ = _refined(*_by_product(A[used], B[used]), A[used], B[used])
        best = _distance(X, Y, A, B)
        now = best <= max(_ODD * float(np.median(best[used])), _NEVER_ODD)
        if (now == used).all():
            break
        used = now
    return best, used


def _otherwise(A: FloatArray, B: FloatArray, camera_on: CameraOn, usual: float) -> str:
    """What would make the poses agree ten times better, in words; empty when nothing."""
    other = "cell" if camera_on == "hand" else "hand"
    d, used = _agreeing(pose.inverse(A), B)  # the same equation as with B the other way round, X and Y changing places
    if used.all() and np.median(d) < 0.1 * usual:
        return f"with camera_on='{other}', or with the inverse of Ts_camera_target, they agree"
    return ""


def _turned_alike(A: FloatArray, B: FloatArray, board: Board) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Poses of a chessboard, those that contradict the others turned by half a turn where that makes them agree; and which."""
    half = np.diag([-1.0, -1.0, 1.0, 1.0])
    half[:2, 3] = board.size
    _, used = _agreeing(A, B)
    X, Y, _ = _refined(*_by_product(A[used], B[used]), A[used], B[used])
    turned = B @ half
    better = ~used & (_distance(X, Y, A, turned) < _distance(X, Y, A, B))
    return np.where(better[:, None, None], turned, B), better


# --------------------------------------------------------------------------------------------------------------------
# refinement


def _moved(T: FloatArray, by: FloatArray) -> FloatArray:
    """Shifted and turned in the axes of the mount: position [m], then rotation vector [rad]; (..., 6)."""
    out = np.array(np.broadcast_to(T, (*by.shape[:-1], 4, 4)))
    out[..., :3, 3] += by[..., :3]
    out[..., :3, :3] = rotation.from_rotation_vector(by[..., 3:]) @ T[:3, :3]
    return out


def _slopes(of: Callable[[FloatArray, FloatArray], FloatArray], X: FloatArray, Y: FloatArray) -> FloatArray:
    """Derivatives of residuals by the twelve numbers, (m, 12), by central differences."""
    columns = []
    for k in range(12):
        step = np.zeros(12)
        step[k] = _STEP
        ahead = of(_moved(X, step[:6]), _moved(Y, step[6:]))
        columns.append((ahead - of(_moved(X, -step[:6]), _moved(Y, -step[6:]))) / (2 * _STEP))
    return np.stack(columns, axis=-1)


def _least_squares(
    of: Callable[[FloatArray, FloatArray], FloatArray],
    slopes: Callable[[FloatArray, FloatArray], FloatArray],
    X: FloatArray,
    Y: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Gauss and Newton on the poses themselves: a step is a shift and a turn from where they are, halved while it does not help."""
    r = of(X, Y)
    cost = float(r @ r)
    for _ in range(_STEPS):
        step: FloatArray = np.asarray(np.linalg.lstsq(slopes(X, Y), -r, rcond=None)[0], dtype=np.float64)
        for _ in range(_HALVINGS):
            X_next, Y_next = _moved(X, step[:6]), _moved(Y, step[6:])
            r_next = of(X_next, Y_next)
            if float(r_next @ r_next) <= cost:
                break
            step = step / 2
        else:
            break
        gained = cost - float(r_next @ r_next)
        X, Y, r, cost = X_next, Y_next, r_next, float(r_next @ r_next)
        if np.abs(step).max() < _NO_STEP or gained <= _NO_GAIN * cost:
            break
    return X, Y


def _pose_slopes(X: FloatArray, Y: FloatArray, A: FloatArray, B: FloatArray) -> FloatArray:
    """Derivatives of `_left_over` by the twelve numbers, (n, 6, 12)."""
    n = len(A)
    R_A, R_X, R_Y, R_B = A[:, :3, :3], X[:3, :3], Y[:3, :3], B[:, :3, :3]
    arm = B[:, :3, 3] @ R_X.T  # from the camera to the board, in the axes of the mount
    reach = np.einsum("nij,nj->ni", R_A, arm + X[:3, 3]) + A[:, :3, 3] - Y[:3, 3]
    to_target = R_Y.T @ R_A
    _, w = _left_over(X, Y, A, B)
    out = np.zeros((n, 6, 12))
    out[:, :3, :3] = to_target
    out[:, :3, 3:6] = -to_target @ _cross(arm)
    out[:, :3, 6:9] = -R_Y.T
    out[:, :3, 9:] = R_Y.T @ _cross(reach)
    out[:, 3:, 3:6] = _inverse_right_jacobian(w) @ np.swapaxes(R_X @ R_B, 1, 2)
    out[:, 3:, 9:] = -_inverse_right_jacobian(w) @ np.swapaxes(R_A @ R_X @ R_B, 1, 2)
    return out


def _cross(v: FloatArray) -> FloatArray:
    """The matrices of ``v x``, (n, 3, 3)."""
    M = np.zeros((len(v), 3, 3))
    M[:, 0, 1], M[:, 0, 2], M[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return M - np.swapaxes(M, 1, 2)


def _inverse_right_jacobian(w: FloatArray) -> FloatArray:
    """Of the exponential map of rotations: ``log(exp(w) exp(d)) = w + J^-1 d`` (Barfoot 2017, eq. 7.77), (n, 3, 3)."""
    angle = np.linalg.norm(w, axis=1)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    share = np.where(small, 1.0 / 12.0, 1.0 / safe**2 - (1.0 + np.cos(safe)) / (2.0 * safe * np.sin(safe)))
    M = _cross(w)
    return np.asarray(np.eye(3) + 0.5 * M + share[:, None, None] * (M @ M))


def _refined(X: FloatArray, Y: FloatArray, A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Least squares over poses; position and rotation weigh by their own noise, which is read from what is left. Returns (12, 12) covariance too."""
    far = float(np.median(np.linalg.norm(B[:, :3, 3], axis=1)))
    weights = np.array([1.0, 1.0, 1.0, *[max(far, 1e-6)] * 3])
    free = 3 * len(A) - 6

    def of(X: FloatArray, Y: FloatArray) -> FloatArray:
        return np.asarray((np.concatenate(_left_over(X, Y, A, B), axis=1) * weights).reshape(-1))

    def slopes(X: FloatArray, Y: FloatArray) -> FloatArray:
        return np.asarray((_pose_slopes(X, Y, A, B) * weights[:, None]).reshape(-1, 12))

    for _ in range(3):
        X, Y = _least_squares(of, slopes, X, Y)
        noise = [max(float(np.sqrt((part**2).sum() / free)), _FLOOR) for part in _left_over(X, Y, A, B)]
        weights = 1.0 / np.repeat(noise, 3)
    J = slopes(X, Y)
    return X, Y, np.asarray(np.linalg.inv(J.T @ J), dtype=np.float64)


def _refined_over_pixels(
    X: FloatArray, Y: FloatArray, A: FloatArray, views: Sequence[BoardView], board: Board, camera: Camera
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    points = [np.pad(board.corners[view.ids], ((0, 0), (0, 1)), constant_values=0.0) for view in views]
    uv = np.concatenate([view.uv for view in views])
    inverse_A = pose.inverse(A)
    rows = np.cumsum([0, *(2 * len(p) for p in points)])

    def of(X: FloatArray, Y: FloatArray) -> FloatArray:
        Ts = pose.inverse(X) @ inverse_A @ Y
        p = np.concatenate([q @ T[:3, :3].T + T[:3, 3] for q, T in zip(points, Ts, strict=True)])
        return np.asarray(
            np.nan_to_num(camera.project(p) - uv, nan=1e3).reshape(-1)
        )  # beyond the reach of the lens: far off

    X, Y = _least_squares(of, lambda X, Y: _slopes(of, X, Y), X, Y)
    r, J = of(X, Y), _slopes(of, X, Y)
    bread = np.linalg.inv(J.T @ J)
    n = len(views)
    whole = np.linalg.inv(bread)
    spread = np.zeros((12, 12))
    for start, end in pairwise(rows):
        S, pull = J[start:end].T @ J[start:end], J[start:end].T @ r[start:end]
        moved = np.linalg.lstsq(whole - S, pull, rcond=None)[0]  # how far all is moved when this pose is left out
        spread += np.outer(moved, moved)
    clustered = spread * ((n - 1) / n)
    alone = bread * float(r @ r) / max(len(r) - 12, 1)
    covariance = clustered if np.trace(clustered[:6, :6]) > np.trace(alone[:6, :6]) else alone
    return X, Y, covariance, float(np.sqrt((r @ r) / (len(r) / 2)))


def _pixels_off(X: FloatArray, Y: FloatArray, A: FloatArray, view: BoardView, board: Board, camera: Camera) -> float:
    """RMS distance of the corners of a view from where they should be [px]."""
    T = pose.inverse(A @ X) @ Y
    uv = camera.project(board.corners[view.ids] @ T[:3, :2].T + T[:3, 3])
    return float(np.sqrt(np.square(np.nan_to_num(uv - view.uv, nan=1e3)).sum(axis=1).mean()))


def _result(
    camera_on: CameraOn, X: FloatArray, Y: FloatArray, covariance: FloatArray, A: FloatArray, B: FloatArray, labels: tuple[str, ...],
    used: NDArray[np.bool_], left_out: tuple[str, ...], methods: tuple[Method, ...],
) -> HandEyeCalibration:  # fmt: skip
    p, w = _left_over(X, Y, A, B)
    turns, axes = _turns(A[used])
    arrays = [
        X, Y, used, np.linalg.norm(p, axis=1), np.linalg.norm(w, axis=1), covariance[:6, :6].copy(), covariance[6:, 6:].copy(), turns, axes,
    ]  # fmt: skip
    for array in arrays:
        array.setflags(write=False)
    X, Y, used, position, turn, of_camera, of_target, turns, axes = arrays
    return HandEyeCalibration(
        camera_on, X, Y, labels, used, position, turn, of_camera, of_target, turns, axes, methods, left_out,
        _missing(turns, axes, camera_on, int(used.sum())),
    )  # fmt: skip


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
