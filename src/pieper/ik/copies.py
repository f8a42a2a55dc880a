"""The copies of an answer by whole turns, one at a time in the order of their distance."""

from __future__ import annotations

import heapq
import itertools
from typing import TYPE_CHECKING

import numpy as np

from pieper.kinematics.joints import as_joints, periodic_joints

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray

_TURN = 2.0 * np.pi
_ROUNDING = 1e-9  # [rad] what may be left outside a limit by rounding


def copies_of(chain: Chain, answers: FloatArray, seed: ArrayLike | None = None) -> Iterator[FloatArray]:
    """Every copy of some answers inside the limits, nearest to `seed` first.

    Parameters
    ----------
    chain : Chain
    answers : (k, n) array
        Joint values [rad or m].
    seed : (n,) array, optional
        Where to be near to; the middle of the limits when not given (0 where there is none).

    Yields
    ------
    (n,) array
        Joint values [rad or m].

    Notes
    -----
    Values of one joint are sorted by their distance; the cheapest combinations then follow from a heap, which holds as
    many entries as copies were taken, not as there are.
    """
    lower, upper = chain.limits.T
    if seed is None:
        here = np.where(np.isfinite(lower) & np.isfinite(upper), 0.5 * (lower + upper), 0.0)
    else:
        here = as_joints(chain, seed, name="seed")
    turns = periodic_joints(chain)
    choices = [
        [_values(x, lower[i], upper[i], here[i], bool(turns[i])) for i, x in enumerate(answer)] for answer in answers
    ]
    order = itertools.count()  # equal distances stay in the order of the answers
    heap = [
        (sum(v[0][0] for v in values), next(order), k, (0,) * chain.dof)
        for k, values in enumerate(choices)
        if all(values)
    ]
    heapq.heapify(heap)
    while heap:
        distance, _, k, picks = heapq.heappop(heap)
        values = choices[k]
        yield np.array([v[pick][1] for v, pick in zip(values, picks, strict=True)])
        # each combination is reached once: only joints from the last one that was moved on may move on
        last = max((i for i, pick in enumerate(picks) if pick), default=0)
        for i in range(last, chain.dof):
            pick = picks[i] + 1
            if pick < len(values[i]):
                further = distance - values[i][pick - 1][0] + values[i][pick][0]
                heapq.heappush(heap, (further, next(order), k, (*picks[:i], pick, *picks[i + 1 :])))


def _values(x: float, lower: float, upper: float, here: float, turns: bool) -> list[tuple[float, float]]:
    """(square of the distance, value) of each copy of a joint value inside its limits, nearest first."""
    if turns and np.isfinite(lower) and np.isfinite(upper):
        first, last = np.ceil((lower - _ROUNDING - x) / _TURN), np.floor((upper + _ROUNDING - x) / _TURN)
        values = [float(np.clip(x + _TURN * k, lower, upper)) for k in np.arange(first, last + 1.0)]
    else:
        value = x + _TURN * np.round((here - x) / _TURN) if turns else x
        if turns and value < lower - _ROUNDING:
            value += _TURN * np.ceil((lower - _ROUNDING - value) / _TURN)
        if turns and value > upper + _ROUNDING:
            value -= _TURN * np.ceil((value - upper - _ROUNDING) / _TURN)
        inside = lower - _ROUNDING <= value <= upper + _ROUNDING
        values = [float(np.clip(value, lower, upper))] if inside else []
    return sorted(((value - here) ** 2, value) for value in values)
