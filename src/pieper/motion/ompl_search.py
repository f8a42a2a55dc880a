"""RRT-Connect: the only file that knows OMPL (https://ompl.kavrakilab.org).

OMPL asks whether whole edges are free (its ``MotionValidator``), so that its own resolution, a fraction of the diagonal of the space, plays no
part, and one question covers many states.

References
----------
Kuffner and LaValle 2000, RRT-Connect: an efficient approach to single-query path planning, ICRA.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import MissingExtraError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from pieper.model.chain import FloatArray


def _ompl() -> tuple[Any, Any, Any]:
    try:
        return import_module("ompl.base"), import_module("ompl.geometric"), import_module("ompl.util")
    except ImportError as cause:
        raise MissingExtraError("ompl", "plan", "planning") from cause


@cache
def _whole_edges(ob: Any) -> type:
    """A motion validator that asks a callable; made once, since a class is not freed by counting references."""

    class WholeEdges(ob.MotionValidator):  # type: ignore[misc]
        def __init__(self, information: Any, is_free: Callable[[Any, Any], bool]) -> None:
            super().__init__(information)
            self._is_free = is_free

        def checkMotion(self, first: Any, second: Any, *_: Any) -> bool:
            return self._is_free(first, second)

    return WholeEdges


def search(
    start: FloatArray,
    goals: FloatArray,
    *,
    bounds: tuple[FloatArray, FloatArray],
    is_free: Callable[[FloatArray], bool],
    edge_is_free: Callable[[FloatArray, FloatArray], bool],
    stop: Callable[[], bool],
    seed: int,
    longest: float,
) -> FloatArray | None:
    """Find a path of straight edges from a start to the first of some goals that is met.

    Parameters
    ----------
    start : (n,) array
    goals : (k, n) array
    bounds : pair of (n,) arrays
        Between which states are drawn.
    is_free, edge_is_free : callable
        Of a state, and of two states.
    stop : callable
        Asked often; the search ends when it says True.
    seed : int
        Above 0.
    longest : float
        An edge of the tree is not longer, in the unit of the states.

    Returns
    -------
    (m, n) array or None
        From the start to a goal.

    Notes
    -----
    Random numbers of OMPL are seeded for the whole process whenever this is called.
    """
    ob, og, ou = _ompl()
    ou.setLogLevel(ou.LOG_NONE)  # it speaks of every search, and complains when it is seeded a second time, which works
    ou.RNG.setSeed(seed)
    n = len(start)
    trouble: list[BaseException] = []

    def halted() -> bool:
        return bool(trouble) or stop()

    def guarded(question: Callable[[], bool]) -> bool:
        """No exception may pass through OMPL: it is kept, ends the search, and is raised after."""
        if trouble:
            return False
        try:
            return question()
        except BaseException as raised:  # noqa: BLE001  raised again below
            trouble.append(raised)
            return False

    def values(state: Any) -> FloatArray:
        return np.array([state[i] for i in range(n)])

    space = ob.RealVectorStateSpace(n)
    box = ob.RealVectorBounds(n)
    for i in range(n):
        box.setLow(i, float(bounds[0][i]))
        box.setHigh(i, float(bounds[1][i]))
    space.setBounds(box)
    information = ob.SpaceInformation(space)
    information.setStateValidityChecker(lambda state: guarded(lambda: is_free(values(state))))
    information.setMotionValidator(
        _whole_edges(ob)(information, lambda a, b: guarded(lambda: edge_is_free(values(a), values(b))))
    )
    information.setup()

    def state_of(q: Sequence[float] | FloatArray) -> Any:
        state = space.allocState()
        for i in range(n):
            state[i] = float(q[i])
        return state

    problem = ob.ProblemDefinition(information)
    problem.addStartState(state_of(start))
    aims = ob.GoalStates(information)
    for goal in goals:
        aims.addState(state_of(goal))
    problem.setGoal(aims)
    planner = og.RRTConnect(information)
    planner.setRange(longest)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(ob.PlannerTerminationCondition(halted))
    path = None
    if problem.hasExactSolution() and not trouble:
        found = problem.getSolutionPath()
        path = np.array([values(state) for state in found.getStates()])
    if trouble:
        caught = trouble.pop()
        try:
            raise caught
        finally:
            del caught  # its frames hold the objects of OMPL, which would live as long as the process
    return path
