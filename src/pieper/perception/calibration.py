"""A lens, from pictures of a board: matrix, distortion, how well both are known, and what remains in the images.

Zhang's method (A flexible new technique for camera calibration, 2000) as OpenCV solves it, with views chosen before and judged after.

How many coefficients of distortion: five (k1, k2, p1, p2, k3), unless

- the corners stay within 60 % of the way from the centre to the corner of the image: then four, since k3 would be free where nothing was seen;
- eight (the rational model) agree with views that contradict five, or lower the error in views that were not fitted by more than 10 %: then eight;
- the polynomial folds inside the image: then the next simpler one, for a fold is no lens.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper._version import __version__
from pieper.errors import VisionError
from pieper.perception.board_views import LEAST_VIEWS, BoardView, BoardViews, find_views
from pieper.perception.calibration_file import COEFFICIENTS, save_camera
from pieper.perception.camera import Camera
from pieper.perception.opencv import opencv

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from pieper.perception.board import Board
    from pieper.spatial._checks import FloatArray

__all__ = ["LEAST_VIEWS", "BoardView", "BoardViews", "CameraCalibration", "calibrate_camera", "find_views"]

_ODD, _NEVER_ODD = 3.0, 0.15  # a view is left out above 3 medians, and above 0.15 px
_SEEN = 0.6  # of the way to the corner of the image
_WORTH = 0.9  # error of the larger model in views that were not fitted, over that of the smaller
_CELLS = (8, 6)
_SAME_SIDE = np.radians(10.0)


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """A lens, and the evidence for it.

    Attributes
    ----------
    camera : Camera
    deviation : dict of str to float
        Standard deviations of ``fx, fy, cx, cy`` [px] and of the coefficients, to first order from the residuals.
    views : tuple of BoardView
        Those that were used.
    residuals : tuple of (n, 2) arrays
        Of each view: seen minus projected [px].
    Ts_camera_board : (views, 4, 4) array
        Poses of the board.
    left_out : tuple of str
        Which views were not used, and why.
    reason : str
        Why the distortion has as many coefficients as it has.
    board : Board
    """

    camera: Camera
    deviation: dict[str, float]
    views: tuple[BoardView, ...]
    residuals: tuple[FloatArray, ...]
    Ts_camera_board: FloatArray
    left_out: tuple[str, ...]
    reason: str
    board: Board

    @property
    def view_rms(self) -> FloatArray:
        """RMS distance of each view, (k,) [px]."""
        return np.array([_rms(r) for r in self.residuals])

    @property
    def rms(self) -> float:
        """RMS distance of all corners [px]."""
        return _rms(np.concatenate(self.residuals))

    @property
    def worst(self) -> tuple[float, str]:
        """Largest distance [px], and the view that has it."""
        sizes = [float(np.hypot(*r.T).max()) for r in self.residuals]
        return max(sizes), self.views[int(np.argmax(sizes))].name

    @property
    def coverage(self) -> NDArray[np.int64]:
        """Corners seen in each cell of the image, ``(6, 8)``."""
        uv = np.concatenate([view.uv for view in self.views])
        edges = [np.linspace(-0.5, n - 0.5, cells + 1) for n, cells in zip(self.camera.size, _CELLS, strict=True)]
        return np.asarray(np.histogram2d(uv[:, 1], uv[:, 0], bins=[edges[1], edges[0]])[0], dtype=np.int64)

    def report(self) -> str:
        """Return the figures in lines for people."""
        K, d = self.camera.matrix, self.camera.distortion
        values = dict(
            zip(("fx", "fy", "cx", "cy", *COEFFICIENTS), [K[0, 0], K[1, 1], K[0, 2], K[1, 2], *d], strict=False)
        )
        worst, where = self.worst
        used = (self.coverage > 0).mean()
        lines = [f"{name:>3}  {value:.6g} +- {self.deviation.get(name, 0.0):.2g}" for name, value in values.items()]
        lines += [
            f"residual  RMS {self.rms:.3f} px over {sum(map(len, self.residuals))} corners, worst {worst:.3f} px in {where}",
            f"coverage  corners in {used:.0%} of the image's {_CELLS[0]} x {_CELLS[1]} cells",
            f"distortion  {self.reason}",
        ]
        lines += [
            f"{rms:.3f} px  {len(v.ids)} corners  {v.name}" for rms, v in zip(self.view_rms, self.views, strict=True)
        ]
        return "\n".join(lines + [f"left out  {words}" for words in self.left_out])

    def save(self, path: str | Path, *, sources: Iterable[str] = ()) -> None:
        """Write ``camera.yaml``, with deviations, residuals and provenance."""
        worst, where = self.worst
        save_camera(
            path,
            self.camera,
            model={"coefficients": int(self.camera.distortion.size), "reason": self.reason},
            deviation={name: _short(value) for name, value in self.deviation.items()},
            residual={
                "rms_px": _short(self.rms),
                "worst_px": _short(worst),
                "worst_view": where,
                "corners": sum(map(len, self.residuals)),
                "cells_covered": _short(float((self.coverage > 0).mean())),
                "views": [
                    {"name": view.name, "rms_px": _short(float(rms)), "corners": len(view.ids)}
                    for view, rms in zip(self.views, self.view_rms, strict=True)
                ],
                "left_out": list(self.left_out),
            },
            provenance={
                "board": str(self.board),
                "sources": [str(s) for s in sources],
                "made": datetime.now(timezone.utc).isoformat(timespec="seconds"),
                "by": f"pieper {__version__}, OpenCV {opencv('a calibration').__version__}",
            },
        )


def calibrate_camera(found: BoardViews, board: Board, *, coefficients: int | None = None) -> CameraCalibration:
    """Calibrate a lens.

    Parameters
    ----------
    found : BoardViews
    board : Board
    coefficients : 0, 4, 5 or 8, optional
        Of distortion; by the rule above if not given.

    Returns
    -------
    CameraCalibration
        The lens, and how far each view is off [px].

    Raises
    ------
    VisionError
        Too few views, views that contradict each other, or boards that are all seen from one side.
    """
    if coefficients not in (None, 0, 4, 5, 8):
        raise VisionError(f"the distortion can have 0, 4, 5 or 8 coefficients, got {coefficients}")
    if len(found.views) < LEAST_VIEWS:
        raise VisionError(f"{LEAST_VIEWS} views are needed, better 15, got {len(found.views)}")
    number, reason = coefficients, "as asked for"
    if number is None:
        number, reason = _by_reach(found)
    if coefficients is None and number == 5:
        number, reason = _five_or_eight(found, board)
    views, left_out, solution = _without_odd(found, board, number)
    if coefficients is None:
        while number and _folds(solution.camera):
            simpler = {8: 5, 5: 4, 4: 0}[number]
            reason = f"{simpler}: with {number} the polynomial folds inside the image"
            number = simpler
            views, left_out, solution = _without_odd(found, board, number)
    normals = solution.poses[:, :3, 2]
    if np.arccos(np.clip(normals @ normals.T, -1, 1)).max() < _SAME_SIDE:
        raise VisionError(
            "every board is seen from nearly the same side (within 10 deg), which leaves the focal length open; tilt it by 30 deg and more, "
            "to all sides"
        )
    return CameraCalibration(
        solution.camera,
        solution.deviation,
        tuple(views),
        tuple(solution.residuals),
        solution.poses,
        (*found.left_out, *left_out),
        reason,
        board,
    )


@dataclass(frozen=True, eq=False)
class _Solution:
    camera: Camera
    deviation: dict[str, float]
    poses: FloatArray
    residuals: list[FloatArray]


def _solve(views: Sequence[BoardView], board: Board, size: tuple[int, int], number: int) -> _Solution:
    cv2 = opencv("a calibration")
    flags = {
        0: cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3,
        4: cv2.CALIB_FIX_K3,
        5: 0,
        8: cv2.CALIB_RATIONAL_MODEL,
    }[number]
    objects = [np.pad(board.corners[v.ids], ((0, 0), (0, 1))).astype(np.float32).reshape(-1, 1, 3) for v in views]
    pixels = [v.uv.astype(np.float32).reshape(-1, 1, 2) for v in views]
    until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-12)
    try:
        _, K, d, rotations, shifts, deviation, _, _ = cv2.calibrateCameraExtended(
            objects, pixels, size, None, None, flags=flags, criteria=until
        )
    except cv2.error as error:
        raise VisionError(f"OpenCV finds no lens for these views: {error.err}") from None
    K[0, 1] = 0.0
    try:
        camera = Camera(K, np.ravel(d)[:number], size)
    except ValueError as error:
        raise VisionError(f"these views give no lens ({error}); more views that differ more may") from None
    poses = np.array([_pose(cv2, r, t) for r, t in zip(rotations, shifts, strict=True)])
    residuals = [_residual(view, board, camera, T) for view, T in zip(views, poses, strict=True)]
    names = ("fx", "fy", "cx", "cy", *COEFFICIENTS)
    deviations = {name: float(s) for name, s in zip(names, np.ravel(deviation)[: 4 + number], strict=False)}
    return _Solution(camera, deviations, poses, residuals)


def _pose(cv2: Any, rotation: Any, shift: Any) -> FloatArray:
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.asarray(rotation, dtype=np.float64))[0]
    T[:3, 3] = np.ravel(shift)
    return T


def _residual(view: BoardView, board: Board, camera: Camera, T: FloatArray) -> FloatArray:
    p = board.corners[view.ids] @ T[:3, :2].T + T[:3, 3]
    return np.asarray(np.nan_to_num(view.uv - camera.project(p), nan=1e3))  # beyond the reach of the lens: far off


def _short(number: float) -> float:
    """Four digits, for people."""
    return float(f"{number:.4g}")


def _rms(residual: FloatArray) -> float:
    return float(np.sqrt((residual**2).sum(axis=-1).mean()))


def _without_odd(found: BoardViews, board: Board, number: int) -> tuple[list[BoardView], list[str], _Solution]:
    """Leave out the worst view and solve again, until none stands out."""
    views = list(found.views)
    left_out: list[str] = []
    while True:
        solution = _solve(views, board, found.size, number)
        rms = np.array([_rms(r) for r in solution.residuals])
        limit = max(_ODD * float(np.median(rms)), _NEVER_ODD)
        worst = int(rms.argmax())
        if rms[worst] <= limit:
            return views, left_out, solution
        if len(views) <= max(LEAST_VIEWS, 2 * len(found.views) // 3):
            names = ", ".join(left_out) or views[worst].name
            raise VisionError(
                f"the views contradict each other: a third of {len(found.views)} would have to be left out ({names}); "
                "is the board flat, and its size as given?"
            )
        left_out.append(f"{views[worst].name}: {rms[worst]:.2f} px RMS, where the others have {np.median(rms):.2f}")
        del views[worst]


def _five_or_eight(found: BoardViews, board: Board) -> tuple[int, str]:
    """The larger model where fewer views contradict it, or where it foretells views that were not fitted better."""
    five, eight = _agreeing(found, board, 5), _agreeing(found, board, 8)
    if eight is None:
        return 5, "5, the default: the views contradict a lens with 8"
    if five is None or len(eight) > len(five):
        return 8, "8: views that contradict a lens with 5 agree with one with 8"
    ratio = _held_out(five, board, found.size, 8) / max(_held_out(five, board, found.size, 5), 1e-9)
    if ratio < _WORTH:
        return 8, f"8: the error in views that were not fitted is {ratio:.2f} of that with 5"
    return 5, "5, the default: 8 do no better in views that were not fitted"


def _agreeing(found: BoardViews, board: Board, number: int) -> list[BoardView] | None:
    try:
        return _without_odd(found, board, number)[0]
    except VisionError:
        return None


def _by_reach(found: BoardViews) -> tuple[int, str]:
    centre = (np.array(found.size) - 1) / 2
    away = np.concatenate([np.hypot(*(view.uv - centre).T) for view in found.views])
    share = float(np.quantile(away, 0.99) / np.hypot(*centre))
    if share < _SEEN:
        return 4, f"4: corners reach {share:.0%} of the way to the corner of the image, too little for k3"
    return 5, "5, the default"


def _held_out(views: Sequence[BoardView], board: Board, size: tuple[int, int], number: int) -> float:
    """RMS [px] in the views of either half, with the lens of the other and poses of their own."""
    cv2 = opencv("a calibration")
    if len(views) < 2 * LEAST_VIEWS:
        return 1.0  # too few to tell: the ratio is then 1
    missed = []
    for half in (0, 1):
        try:
            camera = _solve(views[1 - half :: 2], board, size, number).camera
        except VisionError:
            return np.inf
        for view in views[half::2]:
            p = np.pad(board.corners[view.ids], ((0, 0), (0, 1)))
            done, rotation, shift = cv2.solvePnP(p, view.uv, camera.matrix, camera.distortion)
            missed.append(_residual(view, board, camera, _pose(cv2, rotation, shift)) if done else np.full((1, 2), 1e3))
    return _rms(np.concatenate(missed))


def _folds(camera: Camera) -> bool:
    """Whether a pixel at the edge of the image has no direction."""
    width, height = camera.size
    u, v = np.linspace(0, width - 1, 17), np.linspace(0, height - 1, 17)
    edge = np.concatenate([np.stack(np.broadcast_arrays(u, y), -1) for y in (0, height - 1)])
    side = np.concatenate([np.stack(np.broadcast_arrays(x, v), -1) for x in (0, width - 1)])
    return not np.isfinite(camera.directions(np.concatenate([edge, side]))).all()
