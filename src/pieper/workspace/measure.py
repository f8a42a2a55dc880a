"""What is counted in a chunk of voxels: from a question and the number of a chunk to arrays, always the same bits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pieper._native import kernels
from pieper.errors import MapError
from pieper.ik import redundancy
from pieper.ik.solve import solver
from pieper.ik.target import ignore_orientation, position_and_axis
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


ALIKE = 1e-9
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
        m = self.survey.samples
        if not answers.valid.shape[-1]:
            return
        counted = np.ascontiguousarray(answers.within_limits)
        q = np.ascontiguousarray(answers.q)
        if self._free is not None:
            counted = counted.copy()
            counted[counted] = self._free(q[counted])
        measures = self.survey.measures
        found = self.chain.native.score_answers(q, counted, m, self._rows, ALIKE, measures, 1)
        names = ("reached", "solutions", "most_solutions", "manipulability", "singularity", "limit_margin")
        for name, values in zip(names[: 6 if measures else 3], found, strict=False):
            out[name][:] = values
        if self._values is not None and len(self._values) > 1:
            branches = self._branches(q, counted).reshape(len(centres), m)
            out["solutions"][:] = branches.sum(axis=1)
            out["most_solutions"][:] = branches.max(axis=1)

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

    def _branches(self, q: FloatArray, counted: NDArray[np.bool_]) -> NDArray[np.int64]:
        """(poses,) of seven joints, answers for the value of the joint that is held which has most."""
        assert self._values is not None
        held = np.abs(q[counted][:, self._joint, None] - self._values).argmin(axis=1)
        pose, k = np.nonzero(counted)[0], len(self._values)
        return np.asarray(np.bincount(pose * k + held, minlength=len(q) * k).reshape(len(q), k).max(axis=1))


def _is_free(survey: Survey) -> Any:
    from pieper.arm import Arm
    from pieper.motion.collision import CollisionModel

    return CollisionModel(Arm(survey.chain, survey.description), survey.world, margin=survey.margin).is_free
