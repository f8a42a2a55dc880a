"""What is counted in a chunk of voxels: from a question and the number of a chunk to arrays, always the same bits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pieper._native import kernels
from pieper.errors import MapError
from pieper.ik import redundancy
from pieper.ik.solve import solver
from pieper.ik.target import ignore_orientation, position_and_axis
from pieper.kinematics.manipulability import distance_to_singularity, manipulability
from pieper.workspace.survey import LINE, Survey

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.ik.solutions import IKSolutions
    from pieper.spatial._checks import FloatArray

QUANTITIES: dict[str, tuple[str, float]] = {
    "solutions": ("u4", 0),
    "most_solutions": ("u2", 0),
    "manipulability": ("f4", np.nan),
    "singularity": ("f4", np.nan),
    "limit_margin": ("f4", np.nan),
    "reached": ("u4", 0),
}
"""Arrays of a map, their type, and what they hold where nothing is reached. ``reached`` is the last: it is stored last.

============== ====================================================================================================
reached        poses of the voxel with an answer that counts: inside the limits and, if asked, touching nothing
solutions      answers of all these poses together; of seven joints, the branches
most_solutions the largest number of answers that one pose has
manipulability the greatest of all answers, Yoshikawa's measure of all six rows, of the linear three for positions
singularity    smallest singular value of the Jacobian there, its distance to a singularity [-]; of equals the best
limit_margin   the greatest distance, over all answers, of the joint nearest to one of its limits [rad or m]
============== ====================================================================================================
"""

_PLACES = 26_000
"""Places for answers that are worked on together: these arrays stay in the cache."""


_ALIKE = 1e-9
"""Answers whose measures differ by less, relatively, are equally good: mirror images often are, but for rounding."""


class Measurer:
    """An arm prepared for the chunks of one question.

    Parameters
    ----------
    survey : Survey

    Raises
    ------
    MapError
        The processor does not have the vector instructions that the map is made with.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> from pieper.workspace.survey import survey
    >>> asked = survey(catalog.describe("ur5e").chain(), voxel=0.1, orientations=50, box=[[0.3, 0, 0.2], [0.5, 0, 0.4]])
    >>> found = Measurer(asked).chunk(0)
    >>> found["reached"].shape, int(found["reached"].max()), int(found["most_solutions"].max())
    ((3, 1, 3), 50, 8)
    """

    def __init__(self, survey: Survey) -> None:
        if kernels.instruction_set() != survey.instructions:
            if survey.instructions not in kernels.instruction_sets():
                raise MapError(
                    f"the map is made with the instructions {survey.instructions!r}, which this processor does not have; "
                    f"it has: {', '.join(kernels.instruction_sets())}"
                )
            kernels.use_instruction_set(survey.instructions)
        self.survey = survey
        self.chain = survey.chain
        self.solver = solver(survey.chain)
        self._values = self._joint = self._free = None
        self._middle, self._half = _ranges(survey.chain.limits)
        self._rows = 3 if survey.kind == "position" else 6
        places = 8
        if survey.redundancy > 1 or survey.chain.dof == 7:
            held = redundancy.prepare(survey.chain)
            self._values, self._joint = held.samples(survey.redundancy), held.joint
            places = held.places * len(self._values)
        self._at_once = max(1, _PLACES // (places * survey.samples))  # voxels
        if survey.collision:
            self._free = _is_free(survey)
        if survey.kind in ("orientations", "turns"):
            self._T = np.zeros((self._at_once, survey.samples, 4, 4))
            self._T[..., :3, :3] = survey.rotations()
            self._T[..., 3, 3] = 1.0

    def chunk(self, number: int) -> dict[str, NDArray[Any]]:
        """The arrays of `QUANTITIES` over the voxels of one chunk."""
        grid = self.survey.grid
        centres = grid.centres(number)
        out = {name: np.full(len(centres), empty, dtype=kind) for name, (kind, empty) in QUANTITIES.items()}
        for start in range(0, len(centres), self._at_once):
            some = slice(start, start + self._at_once)
            self._measure(centres[some], {name: array[some] for name, array in out.items()})
        shape = grid.chunk_voxels(number)
        return {name: array.reshape(shape) for name, array in out.items()}

    def _measure(self, centres: FloatArray, out: dict[str, NDArray[Any]]) -> None:
        answers = self._answers(centres)
        n, places, m = self.chain.dof, answers.valid.shape[-1], self.survey.samples
        if not places:
            return
        at = np.flatnonzero(answers.within_limits)
        if not len(at):
            return
        q = np.take(answers.q.reshape(-1, n), at, axis=0)
        pose = at // places
        if self._free is not None:
            free = self._free(q)
            q, pose = q[free], pose[free]
            if not len(q):
                return
        counts = self._counts(q, pose, len(centres) * m).reshape(len(centres), m)
        out["reached"][:] = np.count_nonzero(counts, axis=1)
        out["solutions"][:] = counts.sum(axis=1)
        out["most_solutions"][:] = counts.max(axis=1)
        if self.survey.measures:
            self._best(q, pose // m, out)

    def _answers(self, centres: FloatArray) -> IKSolutions:
        survey = self.survey
        if survey.kind == "position":
            return self.solver.solve(ignore_orientation(centres))
        if survey.kind == "directions":
            p = np.repeat(centres, survey.samples, axis=0)
            directions = np.tile(survey.directions(), (len(centres), 1))
            return self.solver.solve(position_and_axis(p, directions, axis_tip=LINE))
        T = self._T[: len(centres)]
        T[..., :3, 3] = centres[:, None]
        return self.solver.solve(T.reshape(-1, 4, 4), redundancy=self._values)

    def _counts(self, q: FloatArray, pose: NDArray[np.int64], poses: int) -> NDArray[np.int64]:
        """(poses,) answers; of seven joints the largest number for one value of the joint that is held."""
        if self._values is None or self._joint is None or len(self._values) == 1:
            return np.bincount(pose, minlength=poses)
        held = np.abs(q[:, self._joint, None] - self._values).argmin(axis=1)
        k = len(self._values)
        return np.asarray(np.bincount(pose * k + held, minlength=poses * k).reshape(poses, k).max(axis=1))

    def _best(self, q: FloatArray, voxel: NDArray[np.int64], out: dict[str, NDArray[Any]]) -> None:
        """The best of all answers in each voxel; `voxel` (S,) rises."""
        first = np.flatnonzero(np.diff(voxel, prepend=-1))
        here = voxel[first]
        measure = self._manipulability(q)
        most = np.maximum.reduceat(measure, first)
        out["manipulability"][here] = most
        alike = np.flatnonzero(measure >= np.repeat(most * (1.0 - _ALIKE), np.diff(first, append=len(q))))
        distance = distance_to_singularity(self.chain.native.jacobian(q[alike])[:, : self._rows])
        out["singularity"][here] = np.maximum.reduceat(distance, np.flatnonzero(np.diff(voxel[alike], prepend=-1)))
        out["limit_margin"][here] = np.maximum.reduceat(self._margin(q), first)  # overwrites q

    def _margin(self, q: FloatArray) -> FloatArray:
        """(S,) distance of the joint nearest to one of its limits [rad or m]."""
        if self._middle is None or self._half is None:
            lower, upper = self.chain.limits.T
            return np.asarray(np.minimum(q - lower, upper - q).min(axis=1))
        q -= self._middle
        np.abs(q, out=q)
        np.subtract(self._half, q, out=q)
        margin = q[:, 0].copy()
        for column in q.T[1:]:
            np.minimum(margin, column, out=margin)
        return margin

    def _manipulability(self, q: FloatArray) -> FloatArray:
        if self._rows == 6:
            return self.chain.native.manipulability(q)
        return manipulability(self.chain.native.jacobian(q)[:, : self._rows])


def _ranges(limits: FloatArray) -> tuple[FloatArray | None, FloatArray | None]:
    """(n,) middle and half of each joint's range; None where one is bounded on one side only."""
    lower, upper = limits.T
    endless = np.isinf(lower) & np.isinf(upper)
    if (np.isinf(limits).any(axis=1) & ~endless).any():
        return None, None
    bounds = np.where(endless[:, None], 0.0, limits)
    return bounds.mean(axis=1), np.where(endless, np.inf, 0.5 * (bounds[:, 1] - bounds[:, 0]))


def _is_free(survey: Survey) -> Any:
    from pieper.arm import Arm
    from pieper.motion.collision import CollisionModel

    return CollisionModel(Arm(survey.chain, survey.description), margin=survey.margin).is_free
