"""Which poses of a hand-eye calibration agree: those that contradict the others are found by least median of squares over small subsets.

References
----------
Rousseeuw, "Least median of squares regression", J. American Statistical Association 1984.
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.errors import VisionError
from pieper.perception.hand_eye_forms import by_pairs, by_product, mean_target, opencv_methods
from pieper.perception.hand_eye_poses import LEAST_POSES, LEAST_TURN, CameraOn, need_turns, turns_of
from pieper.perception.hand_eye_refinement import left_over, refine, rms
from pieper.spatial import pose, rotation

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.perception.board import Board
    from pieper.spatial._checks import FloatArray

ODD = 3.0  # medians: for six Gaussian numbers, far beyond one in a million
_NEVER_ODD = 1e-7  # [m], with turns at the distance of the board; and below it nothing is odd
_PLAIN = 0.01  # of the distance of the board: with less, nobody has to ask what was meant
_FAR_OFF = 0.1  # of the distance of the board: more is no noise
_SUBSETS, _SUBSET = 80, 4
ROUNDS = 12


class Method(NamedTuple):
    """A closed form, and what it left over: `name`, RMS of position [m] and of rotation [rad], and how far its camera is from the refined one."""

    name: str
    position_rms: float
    rotation_rms: float
    position_away: float
    rotation_away: float


def _distance(X: FloatArray, Y: FloatArray, A: FloatArray, B: FloatArray) -> FloatArray:
    """One number for each pose [m]: position, and rotation at the distance of the board."""
    p, w = left_over(X, Y, A, B)
    far = float(np.median(np.linalg.norm(B[:, :3, 3], axis=1)))
    return np.asarray(np.hypot(np.linalg.norm(p, axis=1), far * np.linalg.norm(w, axis=1)))


def robust_start(
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
        need_agreement(used, labels, camera_on)
    turns, axes = turns_of(A[used])
    need_turns(turns, axes, camera_on)
    forms = {"pairs": by_pairs, "product": by_product, **opencv_methods()}
    solved: list[tuple[float, str, FloatArray, FloatArray]] = []
    for name, form in forms.items():
        try:
            X, Y = form(A[used], B[used])
        except Exception:  # noqa: BLE001  OpenCV gives up in ways of its own; the others go on
            continue
        if np.isfinite(X).all() and np.isfinite(Y).all() and rotation.deviation(X[:3, :3]).max() < 1e-6:
            solved.append((rms(_distance(X, Y, A[used], B[used])), name, X, Y))
    solved.sort(key=lambda row: row[0])
    _, _, X, Y = solved[0]
    refined, _, _ = refine(X, Y, A[used], B[used])
    methods = []
    for _, name, X_form, Y_form in solved:
        p, w = left_over(X_form, Y_form, A[used], B[used])
        away = pose.distance(X_form, refined)
        methods.append(
            Method(name, rms(np.linalg.norm(p, axis=1)), rms(np.linalg.norm(w, axis=1)), float(away[0]), float(away[1]))
        )
    X_far = left_over(refined, mean_target(refined, A[used], B[used]), A, B)
    left_out = tuple(
        f"{labels[k]}: {1e3 * np.linalg.norm(X_far[0][k]):.3g} mm and {np.degrees(np.linalg.norm(X_far[1][k])):.3g} deg off, "
        f"where the others have {1e3 * usual:.3g} mm together"
        for k in np.flatnonzero(~used)
    )
    return X, Y, used, left_out, tuple(methods)


def need_agreement(used: NDArray[np.bool_], labels: tuple[str, ...], camera_on: CameraOn) -> None:
    """Complain where so many poses contradict the others that nobody knows who is right."""
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
    X, Y = by_product(A, B)
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
        if turns_of(A[some])[0][1] < LEAST_TURN:
            continue
        d = _distance(*by_product(A[some], B[some]), A, B)
        if np.median(d) < np.median(best):
            best = d
    used = best <= max(ODD * float(np.median(best)), _NEVER_ODD)
    for _ in range(ROUNDS):
        if used.sum() < LEAST_POSES or turns_of(A[used])[0][1] < LEAST_TURN:
            break
        X, Y, _ = refine(*by_product(A[used], B[used]), A[used], B[used])
        best = _distance(X, Y, A, B)
        now = best <= max(ODD * float(np.median(best[used])), _NEVER_ODD)
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


def turned_alike(A: FloatArray, B: FloatArray, board: Board) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Poses of a chessboard, those that contradict the others turned by half a turn where that makes them agree; and which."""
    half = np.diag([-1.0, -1.0, 1.0, 1.0])
    half[:2, 3] = board.size
    _, used = _agreeing(A, B)
    X, Y, _ = refine(*by_product(A[used], B[used]), A[used], B[used])
    turned = B @ half
    better = ~used & (_distance(X, Y, A, turned) < _distance(X, Y, A, B))
    return np.where(better[:, None, None], turned, B), better
