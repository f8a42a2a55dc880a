"""What a hand-eye calibration is given: poses that can be, and whether the hand turned enough to know the camera from them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from pieper.errors import VisionError, unknown_name
from pieper.spatial import pose, rotation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

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
_FARTHEST_HAND, _FARTHEST_BOARD = 100.0, 20.0  # [m] from base and camera: metres and millimetres are told apart by it


def checked_poses(
    Ts_base_tcp: ArrayLike, Ts_camera_target: ArrayLike, camera_on: str, names: Sequence[str] | None
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """A, (n, 4, 4), B, (n, 4, 4), and the names of the poses; refused where they are no poses, or cannot be a hand and a camera."""
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
        raise VisionError(f"{name} must be numbers of shape (n, 4, 4), got {str(values)[:80]}") from None
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


def turns_of(A: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How much was turned about which axes, RMS over pairs of poses, the most first; (3,) and (3, 3)."""
    i, j = np.triu_indices(len(A), 1)
    w = rotation.as_rotation_vector(np.swapaxes(A[i, :3, :3], -1, -2) @ A[j, :3, :3])
    values, vectors = np.linalg.eigh(w.T @ w / len(w))
    return np.sqrt(np.maximum(values[::-1], 0.0)), np.ascontiguousarray(vectors[:, ::-1])


def need_turns(turns: FloatArray, axes: FloatArray, camera_on: CameraOn) -> None:
    """Complain where the hand turned about fewer than two axes."""
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


def missing_poses(turns: FloatArray, axes: FloatArray, camera_on: CameraOn, count: int) -> tuple[str, ...]:
    """Which poses would help, in words; empty when there are enough."""
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
