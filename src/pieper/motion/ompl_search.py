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
    from collections.abc import Callable

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
    asked = _Questions(stop)
    information = _information(ob, bounds, asked, is_free, edge_is_free)
    problem = _problem(ob, information, start, goals)
    planner = og.RRTConnect(information)
    planner.setRange(longest)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(ob.PlannerTerminationCondition(asked.halted))
    path = None
    if problem.hasExactSolution() and not asked.trouble:
        path = np.array([_values(state, len(start)) for state in problem.getSolutionPath().getStates()])
    asked.raise_trouble()
    return path


class _Questions:
    """What OMPL asks. No exception may pass through it: the first is kept, ends the search, and is raised after."""

    def __init__(self, stop: Callable[[], bool]) -> None:
        self._stop = stop
        self.trouble: list[BaseException] = []

    def halted(self) -> bool:
        return bool(self.trouble) or self._stop()

    def answer(self, question: Callable[[], bool]) -> bool:
        if self.trouble:
            return False
        try:
            return question()
        except BaseException as raised:  # noqa: BLE001  raised again below
            self.trouble.append(raised)
            return False

    def raise_trouble(self) -> None:
        if self.trouble:
            caught = self.trouble.pop()
            try:
                raise caught
            finally:
                del caught  # its frames hold the objects of OMPL, which would live as long as the process


def _values(state: Any, n: int) -> FloatArray:
    return np.array([state[i] for i in range(n)])


def _information(
    ob: Any,
    bounds: tuple[FloatArray, FloatArray],
    asked: _Questions,
    is_free: Callable[[FloatArray], bool],
    edge_is_free: Callable[[FloatArray, FloatArray], bool],
) -> Any:
    """The space between the bounds, and who says what is free in it."""
    n = len(bounds[0])
    space = ob.RealVectorStateSpace(n)
    box = ob.RealVectorBounds(n)
    for i in range(n):
        box.setLow(i, float(bounds[0][i]))
        box.setHigh(i, float(bounds[1][i]))
    space.setBounds(box)
    information = ob.SpaceInformation(space)
    information.setStateValidityChecker(lambda state: asked.answer(lambda: is_free(_values(state, n))))
    information.setMotionValidator(
        _whole_edges(ob)(information, lambda a, b: asked.answer(lambda: edge_is_free(_values(a, n), _values(b, n))))
    )
    information.setup()
    return information


def _problem(ob: Any, information: Any, start: FloatArray, goals: FloatArray) -> Any:
    """From the start to any of the goals."""
    space = information.getStateSpace()

    def state_of(q: FloatArray) -> Any:
        state = space.allocState()
        for i, value in enumerate(q.tolist()):
            state[i] = value
        return state

    problem = ob.ProblemDefinition(information)
    problem.addStartState(state_of(start))
    aims = ob.GoalStates(information)
    for goal in goals:
        aims.addState(state_of(goal))
    problem.setGoal(aims)
    return problem
