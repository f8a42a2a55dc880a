"""The result: arrays over voxels by name, whole or piece by piece."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError, unknown_name
from pieper.workspace.grid import Grid, axis_number
from pieper.workspace.measure import QUANTITIES

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from pieper.spatial._checks import FloatArray

DERIVED = ("dexterity", "mean_solutions")
"""What follows from the arrays that are kept."""

UNITS = {
    "dexterity": "share of orientations",
    "mean_solutions": "solutions a pose",
    "solutions": "solutions",
    "most_solutions": "solutions of one pose",
    "manipulability": "manipulability",
    "singularity": "smallest singular value",
    "limit_margin": "distance to a limit [rad or m]",
    "reached": "poses",
}
"""What to write beside a scale."""

Region = tuple[slice, slice, slice]


@dataclass(frozen=True)
class Summary:
    """A map in a few numbers.

    Attributes
    ----------
    voxels, finished : int
        Voxels of the grid, and those that have been computed.
    reachable : float
        Volume in which at least one pose of the voxel is reached [m^3]; of a single layer its area [m^2].
    dexterous : float
        The same where every pose is reached.
    mean_dexterity : float
        Share of the poses that are reached, over the reachable voxels.
    most_solutions : int
    manipulability : float
        The greatest.
    box : (2, 3) nested tuple
        Least and greatest x, y and z of the reachable voxels, with their sides [m]; NaN where none is.
    """

    voxels: int
    finished: int
    reachable: float
    dexterous: float
    mean_dexterity: float
    most_solutions: int
    manipulability: float
    box: tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True, eq=False)
class WorkspaceMap:
    """What was found in each voxel.

    Attributes
    ----------
    grid : Grid
    record : mapping
        The question, as `pieper.workspace.survey.Survey.record` writes it.
    arrays : mapping of str to array
        The arrays of `pieper.workspace.measure.QUANTITIES` over the voxels; in memory, or on disk and read where they are
        looked at.
    missing : frozenset of int
        Chunks that have not been computed.
    """

    grid: Grid
    record: Mapping[str, Any]
    arrays: Mapping[str, Any]
    missing: frozenset[int] = frozenset()

    @property
    def names(self) -> tuple[str, ...]:
        """What `array` takes."""
        return (*QUANTITIES, *DERIVED)

    @property
    def samples(self) -> int:
        """Poses asked in each voxel."""
        return int(self.record["samples"])

    def array(self, name: str, region: Region | None = None) -> NDArray[Any]:
        """One quantity over the voxels, (nx, ny, nz), or over some of them.

        ``dexterity`` is the share of the poses of a voxel that are reached; ``mean_solutions`` the solutions of those that
        are, NaN where none is. For the others see `pieper.workspace.measure.QUANTITIES`.
        """
        where = region if region is not None else tuple(slice(0, n) for n in self.grid.shape)
        if name == "dexterity":
            return np.asarray(self._read("reached", where) / np.float64(self.samples))
        if name == "mean_solutions":
            reached = self._read("reached", where)
            with np.errstate(invalid="ignore"):
                return np.where(reached > 0, self._read("solutions", where) / np.maximum(reached, 1), np.nan)
        if name not in QUANTITIES:
            raise unknown_name("quantity", name, self.names, "a workspace map")
        return self._read(name, where)

    def _read(self, name: str, where: Any) -> NDArray[Any]:
        return np.asarray(self.arrays[name][where])

    def layer(self, name: str, axis: str, value: float) -> NDArray[Any]:
        """One layer of voxels across an axis, the one that holds a coordinate [m]: (n1, n2), in the order of the other two axes."""
        i, k = axis_number(axis), self.grid.layer(axis, value)
        where = [slice(0, n) for n in self.grid.shape]
        where[i] = slice(k, k + 1)
        a, b, c = where
        return np.asarray(self.array(name, (a, b, c)).squeeze(axis=i))

    def pieces(self, *names: str) -> Iterator[tuple[Region, FloatArray, list[NDArray[Any]]]]:
        """The map in pieces that fit into memory: where, the centres (k, 3) [m], and each quantity (k,)."""
        axes = [self.grid.axis(name) for name in "xyz"]
        for region in self.grid.pieces():
            some = [axis[part] for axis, part in zip(axes, region, strict=True)]
            centres = np.stack(np.meshgrid(*some, indexing="ij"), axis=-1).reshape(-1, 3)
            yield region, centres, [self.array(name, region).reshape(-1) for name in names]

    def points(
        self, name: str = "dexterity", *, at_least: float | None = None, most: int | None = None
    ) -> tuple[FloatArray, NDArray[Any]]:
        """Centres (k, 3) of the reachable voxels [m] and one quantity (k,).

        Parameters
        ----------
        name : str
        at_least : float, optional
            Only where the quantity is at least this.
        most : int, optional
            Of a grid with more voxels only every second, third ... along each axis is taken.

        Returns
        -------
        (k, 3) array
            Centres [m].
        (k,) array
            The quantity there.
        """
        step = 1 if most is None else int(np.ceil((self.grid.voxels / most) ** (1.0 / 3.0)))
        where, values = [], []
        for region, centres, (found, reached) in self.pieces(name, "reached"):
            keep = reached > 0
            if at_least is not None:
                keep &= found >= at_least
            if step > 1:
                taken = [np.arange(part.start, part.stop) % step == 0 for part in region]
                keep &= (taken[0][:, None, None] & taken[1][:, None] & taken[2]).reshape(-1)
            where.append(centres[keep])
            values.append(found[keep])
        return np.concatenate(where), np.concatenate(values)

    def summary(self) -> Summary:
        """The map in a few numbers, read piece by piece."""
        grid = self.grid
        flat = sum(n == 1 for n in grid.shape)
        unit = grid.voxel ** (3 - flat) if flat < 3 else 1.0
        some = full = most = total = 0
        best = float("nan")
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for _, centres, (reached, solutions, measure) in self.pieces("reached", "most_solutions", "manipulability"):
            here = reached > 0
            if not here.any():
                continue
            some += int(here.sum())
            full += int((reached == self.samples).sum())
            total += int(reached.sum(dtype=np.int64))
            most = max(most, int(solutions.max()))
            best = float(np.fmax(best, np.fmax.reduce(measure)))
            low, high = np.minimum(low, centres[here].min(axis=0)), np.maximum(high, centres[here].max(axis=0))
        half = 0.5 * grid.voxel
        box = np.array([low - half, high + half]) if some else np.full((2, 3), np.nan)
        (a, b, c), (d, e, f) = box.tolist()
        unfinished = sum(int(np.prod(grid.chunk_voxels(k))) for k in self.missing)
        return Summary(
            voxels=grid.voxels,
            finished=grid.voxels - unfinished,
            reachable=some * unit,
            dexterous=full * unit,
            mean_dexterity=total / (some * self.samples) if some else 0.0,
            most_solutions=most,
            manipulability=best,
            box=((a, b, c), (d, e, f)),
        )

    def require_complete(self, purpose: str) -> None:
        """Raises ArrayError where chunks are missing."""
        if self.missing:
            raise ArrayError(
                f"{purpose} needs the whole map, and {len(self.missing)} of {self.grid.chunks} chunks are not computed yet: finish it with --resume"
            )


def grid_of(record: Mapping[str, Any]) -> Grid:
    """The grid that a record describes."""
    (x, y, z), (a, b, c) = record["origin"], record["shape"]
    return Grid((float(x), float(y), float(z)), float(record["voxel"]), (int(a), int(b), int(c)), int(record["chunk"]))
