"""How a target of some rows is made a question that a complete method answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pieper.ik.family import size_of
from pieper.ik.prepared import prepared
from pieper.ik.projection import axis_misfit
from pieper.ik.virtual_joint import CompleteMethod, complete_method, extended

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.ik.target import Target
    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray

    BoolArray = NDArray[np.bool_]

_COLLINEAR = 1e-9  # a tool axis this near to the last joint axis is that axis
_NEARLY_COLLINEAR = 1e-2  # and one this near makes for badly conditioned answers
_RANK = 1e-7  # singular values of the rows below this, in units of the largest, count as 0

# Virtual joints: directions in the tip frame at right angles to one another, along no axis that an arm is likely to have.
VIRTUAL_AXES = ((0.36, 0.48, 0.8), (0.8, -0.6, 0.0), (0.48, 0.64, -0.6))


@dataclass(frozen=True, eq=False)
class Plan:
    """How one arm is solved for one kind of target."""

    axis_tip: FloatArray | None
    method: CompleteMethod | None
    free_dimension: int
    free_joint: int | None
    words: str
    badly_conditioned: bool = False
    plane: FloatArray | None = None
    """The direction of all axes, of planar and SCARA arms."""

    @property
    def sampled(self) -> bool:
        return self.free_dimension > 0 and self.free_joint is None


def plan_of(chain: Chain, target: Target) -> Plan | None:
    """How to solve the rows of a target; None where they are not covered. Made once for an arm and a tool axis."""
    if target.axis is not None:
        wanted = (1.0,) * 6
    else:
        wanted = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
    if target.weights != wanted or chain.is_coupled or chain.dof not in (2, 3, 4, 5, 6):
        return None
    if target.axis is None:
        return prepared(chain, "plan", None, lambda: _plan_for_position(chain))
    axis = np.asarray(target.axis, dtype=np.float64)
    return prepared(chain, "plan", target.axis, lambda: _plan_for_axis(chain, axis))


def _plan_for_position(chain: Chain) -> Plan | None:
    n = chain.dof
    plane = _common_direction(chain)
    if plane is not None:
        return _plan_in_a_plane(chain, plane)
    if n < 3 or _rank(chain, None) < 3:
        return None
    method = complete_method(extended(chain, VIRTUAL_AXES[: 6 - n]))
    if method is None:
        return None
    kinds = ("isolated answers", "curves of answers", "surfaces of answers", "a three-dimensional set of answers")
    words = f"position only, {n} joints: {kinds[n - 3]}" + (", sampled" if n > 3 else "")
    return Plan(None, method, n - 3, None, words)


def _common_direction(chain: Chain) -> FloatArray | None:
    """(3,) the direction that all axes have, in the base frame; None where they have not."""
    turning = chain.is_revolute
    directions = np.where(turning[:, None], chain.screws[:, 3:], chain.screws[:, :3])
    parallel = np.linalg.norm(np.cross(directions, directions[0]), axis=1).max() < _COLLINEAR
    return np.asarray(directions[0]) if parallel and turning.any() else None


def _plan_in_a_plane(chain: Chain, direction: FloatArray) -> Plan | None:
    """Planar and SCARA arms: of the orientation there is one turn, which is virtual or sampled."""
    turning = int(chain.is_revolute.sum())
    if turning not in (2, 3):
        return None
    axis = tuple((chain.home[:3, :3].T @ direction).tolist())
    method = complete_method(extended(chain, [axis] if turning == 2 else []))
    if method is None:
        return None
    words = f"position only, {chain.dof} joints with parallel axes: " + (
        "isolated answers" if turning == 2 else "curves of answers, sampled"
    )
    return Plan(None, method, turning - 2, None, words, plane=direction)


def _plan_for_axis(chain: Chain, axis: FloatArray) -> Plan | None:
    n = chain.dof
    if n < 5:
        return None
    rank, misfit = _rank(chain, axis), axis_misfit(chain, axis)
    badly = misfit < _NEARLY_COLLINEAR
    last = chain.joint_names[-1]
    if n == 6:
        method = complete_method(chain)
        if rank < 5 or method is None:
            return None
        if misfit < _COLLINEAR:
            words = f"position and axis: joint {last!r} turns about the tool axis and is free; the others have isolated answers"
            return Plan(axis, method, 1, n - 1, words)
        return Plan(axis, method, 1, None, "position and axis, 6 joints: curves of answers, sampled")
    if misfit < _COLLINEAR:
        words = (
            f"position and axis: joint {last!r} turns about the tool axis and is free; the four others reach axes in the plane "
            "of the arm only"
        )
        return Plan(axis, complete_method(chain), 1, n - 1, words)
    method = complete_method(extended(chain, [axis.tolist()]))
    if (rank < 5 and not badly) or method is None:
        return None
    words = "position and axis, 5 joints: isolated answers"
    if badly:
        words += f"; the tool axis is {misfit:.1g} from the axis of joint {last!r}, so that they are badly conditioned"
    return Plan(axis, method, 0, None, words, badly)


def _rank(chain: Chain, axis: FloatArray | None) -> int:
    """Rank of the rows that count, at the best of some configurations."""
    q = np.random.default_rng(7).uniform(-np.pi, np.pi, (16, chain.dof))
    J = chain.native.jacobian(q)
    rows = J[:, :3] / size_of(chain)
    if axis is not None:
        pointing = chain.native.fk(q)[:, :3, :3] @ axis
        rows = np.concatenate([rows, np.cross(J[:, 3:], pointing[..., None], axis=1)], axis=1)
    values = np.linalg.svd(rows, compute_uv=False)
    return int((values > _RANK * values.max()).sum(axis=-1).max())
