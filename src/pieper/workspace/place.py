"""Where to put the base of an arm so that it reaches the poses of a task, or which of several arms to take.

Every base pose of a grid is tried: the poses of the task are solved from there with all solutions. Base poses are compared by the
number of task poses that are reached within limits; of equals the one is better whose worst pose keeps farther from the joint limits,
each pose in its best solution. Collisions are not looked at.
"""

from __future__ import annotations

import csv
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.atomic_file import replacing
from pieper.errors import ArrayError, MapError
from pieper.ik import redundancy
from pieper.ik.solve import solver
from pieper.ik.target import ignore_orientation
from pieper.model.chain import Chain
from pieper.spatial._checks import poses as checked_poses
from pieper.spatial.rotation import from_quaternion, from_rpy
from pieper.workspace.grid import positive, whole
from pieper.workspace.run import Processes

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import ArrayLike, NDArray

    from pieper.arm import Arm
    from pieper.spatial._checks import FloatArray

COLUMNS = (("x", "y", "z", "qx", "qy", "qz", "qw"), ("x", "y", "z", "roll", "pitch", "yaw"), ("x", "y", "z"))
"""What a file of poses may have for columns [m, -] or [m, rad]; the last kind asks for positions alone."""

MOST_BASES = 2_000_000

_AT_ONCE = 4096  # poses
_VALUES = 16  # of the joint that is held, for seven joints
_FAR = 1e4  # [m]
_ALIKE = 9  # decimals of margins that count


@dataclass(frozen=True, eq=False)
class Placement:
    """The base poses that were tried for one arm, and what they are worth.

    Attributes
    ----------
    arm : str
        Name of the arm.
    bases : (k, 4) array
        x, y, z [m] and yaw [rad] of the base in the world frame.
    reached : (k,) int array
        Poses of the task that are reached within limits.
    margin : (k,) array
        How far the worst of these poses keeps from the nearest joint limit [rad or m]; NaN where none is reached.
    manipulability : (k,) array
        Yoshikawa's measure at the worst of these poses, each in its best solution; NaN where none is reached.
    poses : int
        Poses of the task.
    """

    arm: str
    bases: FloatArray
    reached: NDArray[np.int64]
    margin: FloatArray
    manipulability: FloatArray
    poses: int

    @property
    def order(self) -> NDArray[np.int64]:
        """(k,) the base poses from the best to the worst."""
        margin = np.where(np.isnan(self.margin), -np.inf, self.margin).round(_ALIKE)
        return np.lexsort((np.arange(len(margin)), -margin, -self.reached))

    @property
    def best(self) -> int:
        """Number of the best base pose."""
        return int(self.order[0])

    @property
    def score(self) -> tuple[int, float]:
        """Poses reached from the best base pose, and its margin: what arms are compared by."""
        margin = float(self.margin[self.best])
        return int(self.reached[self.best]), margin if margin == margin else -np.inf

    @property
    def T_world_base(self) -> FloatArray:
        """(4, 4) the best base pose [m, -]."""
        return np.asarray(base_poses(self.bases[self.best]))


def place(
    arm: Arm | Chain,
    Ts_world_target: ArrayLike,
    bases: ArrayLike,
    *,
    position_only: bool = False,
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Placement:
    """Try base poses for a task.

    Parameters
    ----------
    arm : Arm or Chain
    Ts_world_target : (m, 4, 4) array_like
        Poses of the task, of the tip in the world frame [m, -].
    bases : (k, 4) array_like
        x, y, z [m] and yaw [rad] of the base in the world frame, see `grid_of_bases`.
    position_only : bool
        Leave the orientation of the poses aside. Arms with fewer than six joints can hardly reach whole poses that were not made for them.
    workers : int
        Processes; the scores do not depend on it. A program that asks for more than one starts under
        ``if __name__ == "__main__":``.
    progress : callable, optional
        Told how many base poses are done, of how many.

    Returns
    -------
    Placement
        How many targets each base pose reaches, how well, and which is best.

    Raises
    ------
    ArrayError
        No pose, no base pose, a wrong shape, or no worker.
    MapError
        A worker died.

    Examples
    --------
    Two poses 1.6 m apart are reached from between them alone.

    >>> from pieper.model import catalog
    >>> arm = catalog.describe("ur5e").chain()
    >>> T = np.array([np.eye(4), np.eye(4)])
    >>> T[:, :3, 3] = [[-0.8, 0.0, 0.4], [0.8, 0.0, 0.4]]
    >>> tried = place(arm, T, grid_of_bases([-1.0, 1.0], [0.0, 0.0], [0.0, 0.0], step=0.25, yaws=1))
    >>> tried.bases[tried.best], int(tried.reached[tried.best])
    (array([0., 0., 0., 0.]), 2)
    """
    chain = arm if isinstance(arm, Chain) else arm.chain
    targets = checked_poses(Ts_world_target, "Ts_world_target")
    if targets.ndim != 3 or not len(targets):
        raise ArrayError(f"Ts_world_target must have shape (m, 4, 4) with at least one pose, got {targets.shape}")
    tried = np.asarray(bases, dtype=np.float64)
    if tried.ndim != 2 or tried.shape[1:] != (4,) or not len(tried) or not np.isfinite(tried).all():
        raise ArrayError(f"bases must be finite with shape (k, 4) and at least one row, got {np.shape(bases)}")
    m, k = len(targets), len(tried)
    count = whole(workers, "workers")
    at_once = max(1, _AT_ONCE // m)
    parts = np.split(tried, range(at_once, k, at_once))
    found = []
    for part in _in_order(partial(_try, chain, targets, position_only), parts, count):
        found.append(part)
        if progress is not None:
            progress(min(len(found) * at_once, k), k)
    reached, margin, measure = (np.concatenate(column) for column in zip(*found, strict=True))
    return Placement(chain.name, tried, reached, margin, measure, m)


_Scores = tuple["NDArray[np.int64]", "FloatArray", "FloatArray"]


def _in_order(work: Callable[[FloatArray], _Scores], parts: Sequence[FloatArray], workers: int) -> Iterator[_Scores]:
    """What each part gives, one after the other, computed here or by processes."""
    if workers == 1 or len(parts) == 1:
        yield from map(work, parts)
        return
    hands = Processes(min(workers, len(parts)))
    try:
        yield from hands.open().map(work, parts)
    except BrokenProcessPool as error:
        raise MapError("a worker died while it tried base poses; try fewer workers, each needs memory") from error
    finally:
        hands.close()


def _try(chain: Chain, targets: FloatArray, position_only: bool, bases: FloatArray) -> _Scores:
    """Scores of some base poses."""
    return _score(chain, np.linalg.inv(base_poses(bases))[:, None] @ targets, position_only=position_only)


def _score(chain: Chain, T: FloatArray, *, position_only: bool) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """Of poses (b, m, 4, 4) in the base frame: how many are reached, and the worst of the best margins and measures."""
    solve: Any = solver(chain).solve
    b, m = T.shape[:2]
    flat = np.ascontiguousarray(T.reshape(-1, 4, 4))
    if position_only:
        answers = solve(ignore_orientation(flat[:, :3, 3]))
    elif redundancy.fits(chain):
        answers = solve(flat, redundancy=redundancy.prepare(chain).samples(_VALUES))
    else:
        answers = solve(flat)
    inside = answers.within_limits
    if not inside.any():
        return np.zeros(b, dtype=np.int64), np.full(b, np.nan), np.full(b, np.nan)
    hit = inside.any(axis=1).reshape(b, m)
    margin = np.where(inside, answers.limit_margin, -np.inf).max(axis=1).reshape(b, m)
    measure = np.full(inside.shape, -np.inf)
    measure[inside] = chain.native.manipulability(answers.q[inside])
    measure = measure.max(axis=1).reshape(b, m)
    some = hit.any(axis=1)
    worst = [np.where(some, np.where(hit, each, np.inf).min(axis=1), np.nan) for each in (margin, measure)]
    return np.asarray(hit.sum(axis=1)), np.asarray(worst[0]), np.asarray(worst[1])


def grid_of_bases(
    x: Sequence[float], y: Sequence[float], z: Sequence[float], *, step: float = 0.1, yaws: int = 8
) -> FloatArray:
    """Base poses (k, 4) over a box: x, y, z from one value to another in steps [m], and evenly spread yaws [rad].

    Raises
    ------
    ArrayError
        A step or number that is not positive, a range that goes backwards, or more than `MOST_BASES` base poses.

    Examples
    --------
    >>> grid_of_bases([0.0, 0.2], [0.0, 0.0], [0.0, 0.0], step=0.1, yaws=2).shape
    (6, 4)
    """
    positive(step, "step")
    turned = whole(yaws, "yaws")
    axes = []
    for name, span in (("x", x), ("y", y), ("z", z)):
        low, high = (float(value) for value in span)
        if not (np.isfinite(low) and np.isfinite(high) and low <= high and max(abs(low), abs(high)) < _FAR):
            raise ArrayError(f"{name} must go from a finite value to one that is not less [m], got {low:g} to {high:g}")
        count = int(np.floor((high - low) / step + 1e-9)) + 1
        axes.append((low + step * np.arange(count)).round(12) + 0.0 if count <= MOST_BASES else np.empty(count, "u1"))
    total = int(np.prod([float(len(axis)) for axis in axes])) * turned
    if total > MOST_BASES:
        raise ArrayError(f"{total} base poses are too many (at most {MOST_BASES}); take a larger step or a smaller box")
    turns = np.arange(turned) * (2.0 * np.pi / turned)
    return np.stack(np.meshgrid(*axes, turns, indexing="ij"), axis=-1).reshape(-1, 4)


def base_poses(bases: ArrayLike) -> FloatArray:
    """(..., 4, 4) poses of bases (..., 4) given by x, y, z [m] and yaw [rad]."""
    given = np.asarray(bases, dtype=np.float64)
    T = np.zeros((*given.shape[:-1], 4, 4))
    c, s = np.cos(given[..., 3]), np.sin(given[..., 3])
    T[..., 0, 0], T[..., 0, 1], T[..., 1, 0], T[..., 1, 1] = c, -s, s, c
    T[..., 2, 2] = T[..., 3, 3] = 1.0
    T[..., :3, 3] = given[..., :3]
    return T


def read_poses(file: str | os.PathLike[str]) -> tuple[FloatArray, bool]:
    """The poses (m, 4, 4) of a CSV file [m, -], and whether they are positions alone.

    The first line names the columns: ``x,y,z`` [m] with ``qx,qy,qz,qw``, with ``roll,pitch,yaw`` [rad], or alone.

    Raises
    ------
    ArrayError
        Other columns, no rows, or a value that is no finite number; the message names file, line and column.
    OSError
        The file cannot be read.
    """
    path = Path(file)
    with path.open(encoding="utf-8-sig", newline="") as lines:
        try:
            rows = list(csv.reader(lines))
        except (csv.Error, UnicodeDecodeError) as error:
            raise ArrayError(f"{path}: is no CSV file: {error}") from None
    names = tuple(name.strip() for name in rows[0]) if rows else ()
    if names not in COLUMNS:
        kinds = "; ".join(",".join(columns) for columns in COLUMNS)
        raise ArrayError(f"{path}: line 1: expected the columns {kinds}, got {','.join(names) or 'nothing'}")
    values = []
    for number, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(names):
            raise ArrayError(f"{path}: line {number}: expected {len(names)} values ({','.join(names)}), got {len(row)}")
        values.append([_number(path, number, name, cell) for name, cell in zip(names, row, strict=True)])
    if not values:
        raise ArrayError(f"{path}: holds no poses")
    table = np.array(values)
    T = np.tile(np.eye(4), (len(table), 1, 1))
    T[:, :3, 3] = table[:, :3]
    if len(names) == 7:
        size = np.linalg.norm(table[:, 3:], axis=1)
        wrong = np.flatnonzero(np.abs(size - 1.0) > 1e-3)
        if len(wrong):
            raise ArrayError(f"{path}: pose {wrong[0] + 1}: qx,qy,qz,qw must have length 1, got {size[wrong[0]]:.4g}")
        T[:, :3, :3] = from_quaternion(table[:, 3:] / size[:, None])
    elif len(names) == 6:
        T[:, :3, :3] = from_rpy(table[:, 3:])
    return T, len(names) == 3


def _number(path: Path, line: int, name: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise ArrayError(f"{path}: line {line}: {name} must be a finite number, got {cell.strip()!r}")
    return value


def write_scores(placements: Sequence[Placement], file: str | os.PathLike[str]) -> Path:
    """Every base pose with its scores as CSV, the best of each arm first; the file is there whole, or not at all.

    Raises
    ------
    ArrayError
        The file does not end in ``.csv``.
    """
    path = Path(file)
    if path.suffix.lower() != ".csv":
        raise ArrayError(f"scores are written to a file that ends in .csv, got {str(file)!r}")
    with replacing(path) as unfinished, unfinished.open("w", encoding="utf-8", newline="") as out:
        out.write("arm,x,y,z,yaw,reached,poses,margin,manipulability\n")
        for each in placements:
            for i in each.order:
                place = ",".join(repr(float(value)) for value in each.bases[i])
                worth = ",".join(
                    "" if np.isnan(v) else repr(float(v)) for v in (each.margin[i], each.manipulability[i])
                )
                out.write(f"{each.arm},{place},{each.reached[i]},{each.poses},{worth}\n")
    return path
