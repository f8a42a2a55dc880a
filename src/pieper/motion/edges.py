"""Whether the straight way between two joint vectors is free, all along.

A fraction of a joint's range says little: the same angle moves a wrist by a centimetre and a hand at arm's length by a metre. So an edge is
divided by how far points of the arm move. Between two states in which a link is c0 and c1 away from the world, and between which no point of
it moves by more than d, it stays at least ``(c0 + c1 - d) / 2`` away; and so do two links from each other, d being how far one moves as seen
from the other. An interval is left alone once this is enough for every link and every two, and halved otherwise; so the far part of an edge costs a few states, and the near part is looked at in steps.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.errors import MotionError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from pieper.model.chain import FloatArray
    from pieper.motion.collision import CollisionModel

_FIRST = 0.1  # how far points may move between the first states that are looked at, as a fraction of the reach
_SCREENED = 8
_MOST = 4096  # states of one edge; more are a mistake of units


class EdgeResult(NamedTuple):
    """Whether an edge is free, and the first share of it (0 to 1) found not to be; NaN when it is."""

    free: bool
    blocked_at: float


class EdgeCheck:
    """Whether straight ways in joint space are free.

    Parameters
    ----------
    model : CollisionModel
    step : float, optional
        Metres. The states that are looked at keep the margin of the model, and everything between them at least the margin less half a
        step. Default: the margin, so that half of it is kept everywhere; 1 mm where the margin is less.

    Raises
    ------
    MotionError
        A step that is not positive, or more than twice the margin, between whose states something could be touched.

    Examples
    --------
    >>> import pieper
    >>> from pieper.motion.collision import CollisionModel
    >>> edges = EdgeCheck(CollisionModel(pieper.load("ur5e"), margin=0.005))
    >>> edges.check([0.0, -1.5, 1.0, 0.0, 0.0, 0.0], [1.0, -1.0, 1.2, 0.0, 0.0, 0.0]).free
    True
    >>> edges.check([0.0, -1.5, 1.0, 0.0, 0.0, 0.0], [0.0, -1.5, 3.1, 0.0, 0.0, 0.0]).free  # the arm folds into itself
    False
    """

    def __init__(self, model: CollisionModel, *, step: float | None = None) -> None:
        self.model = model
        margin = model.margin
        self.step = max(margin, 1e-3) if step is None else float(step)
        if not 0.0 < self.step < np.inf:
            raise MotionError(f"step must be a positive distance [m], got {step!r}")
        if step is not None and self.step > 2.0 * margin:
            raise MotionError(
                f"step must be at most twice the margin of {margin:g} m, so that nothing is touched between two states; "
                f"got {self.step:g} m"
            )
        self.kept = margin - 0.5 * self.step
        self.states = 0
        """States looked at so far."""
        self.edges = 0
        """Edges looked at so far."""
        if not np.isfinite(model.lever).all():
            raise MotionError(
                f"{model.chain.name!r} has a joint that slides without limits, so that its points could move any distance; "
                "give it limits"
            )

    def check(self, start: FloatArray, goal: FloatArray, *, stop: Callable[[], bool] | None = None) -> EdgeResult:
        """Look at one edge; ends (n,) included.

        Parameters
        ----------
        start, goal : (n,) arrays
            Joint values [rad or m].
        stop : callable, optional
            Asked between batches; when it says True the edge counts as blocked.

        Returns
        -------
        EdgeResult
            Whether it is free, and where not.
        """
        q0, dq = np.asarray(start, dtype=np.float64), np.asarray(goal, dtype=np.float64) - np.asarray(start)
        moved = self.model.approach(dq)  # (columns,) [m] along the whole edge
        self.edges += 1
        far = float(moved.max(initial=0.0))
        parts = 1 << max(0, int(np.ceil(np.log2(max(far, 1e-12) / (_FIRST * max(self.model.reach_bound, 1e-9))))))
        parts = min(parts, _MOST)
        s = np.arange(parts + 1) / parts
        clear = self._look(q0, dq, s, moved / parts)
        width = 1.0 / parts
        blocked = self._first_blocked(s, clear)
        if blocked is not None:
            return EdgeResult(False, blocked)
        left, c_left, c_right = s[:-1], clear[:-1], clear[1:]
        while True:
            open_ones = (c_left + c_right < moved * width + 2.0 * self.kept).any(axis=1)
            if moved.max(initial=0.0) * width <= self.step or not open_ones.any():
                return EdgeResult(True, float("nan"))
            if stop is not None and stop():
                return EdgeResult(False, float(left[open_ones][0]))
            left, c_left, c_right = left[open_ones], c_left[open_ones], c_right[open_ones]
            width *= 0.5
            middle = left + width
            c_middle = self._look(q0, dq, middle, moved * width)
            blocked = self._first_blocked(middle, c_middle)
            if blocked is not None:
                return EdgeResult(False, blocked)
            left = np.concatenate([left, middle])
            c_left, c_right = np.concatenate([c_left, c_middle]), np.concatenate([c_middle, c_right])
            order = np.argsort(left, kind="stable")
            left, c_left, c_right = left[order], c_left[order], c_right[order]

    def screen(self, starts: FloatArray, goals: FloatArray) -> NDArray[np.bool_]:
        """Which of several edges (k, n) are not blocked at any of nine states, looked at together; a quick no, never a yes."""
        s = (np.arange(_SCREENED + 1) / _SCREENED)[:, None, None]
        states = np.asarray(starts) + s * (np.asarray(goals) - np.asarray(starts))
        self.states += states.shape[0] * states.shape[1]
        return np.asarray(self.model.is_free(states).all(axis=0))

    def free(self, start: FloatArray, goal: FloatArray) -> bool:
        """Whether one edge, between joint values (n,) [rad or m], is free."""
        return self.check(start, goal).free

    def path_is_free(self, q: FloatArray) -> bool:
        """Whether the way through joint vectors (k, n) is free."""
        if len(q) == 1:
            return bool(self.model.is_free(q[0]))
        return all(self.free(a, b) for a, b in itertools.pairwise(q))

    def _look(self, q0: FloatArray, dq: FloatArray, s: FloatArray, moved: FloatArray) -> FloatArray:
        """Clearances at shares of the edge, sharp as far as they matter where things approach by `moved` between two of them."""
        self.states += len(s)
        enough = np.maximum(0.5 * moved + self.kept, self.model.margin)
        return self.model.bounds(q0 + s[:, None] * dq, enough)

    def _first_blocked(self, s: FloatArray, clear: FloatArray) -> float | None:
        bad = (clear < self.model.margin).any(axis=1)
        return float(s[bad].min()) if bad.any() else None
