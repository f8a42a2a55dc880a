"""Shorter paths: corners cut where the straight way between two of their points is free.

Candidates are looked at coarsely, all at once, before the best of them is checked in full: most are blocked, and this tells most of those.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from pieper.model.chain import FloatArray
    from pieper.motion.edges import EdgeCheck

_CANDIDATES = 12  # cuts that are drawn in one round
_TRIED = 3  # of those that are not blocked coarsely
_ROUNDS = 6


def shorten(
    path: FloatArray, edges: EdgeCheck, *, weights: FloatArray, seed: int, stop: Callable[[], bool]
) -> FloatArray:
    """Shorten a free path.

    Parameters
    ----------
    path : (k, n) array
        Joint vectors; its edges are free.
    edges : EdgeCheck
    weights : (n,) array
        By which joints count in lengths.
    seed : int
    stop : callable
        Asked before every edge; when it says True, what there is so far is returned.

    Returns
    -------
    (m, n) array
        A free path with the same ends, not longer. First points are left out while any can be; then corners are cut at random places.
    """
    path = _leave_out(path, edges, weights, stop)
    random = np.random.default_rng(seed)
    for _ in range(_ROUNDS if len(path) > 2 else 0):
        lengths = np.linalg.norm(np.diff(path, axis=0) * weights, axis=1)
        at = np.concatenate([[0.0], np.cumsum(lengths)])
        ends = np.sort(random.random((_CANDIDATES, 2)), axis=1) * at[-1]
        segment = np.clip(np.searchsorted(at, ends, side="right") - 1, 0, len(lengths) - 1)
        share = (ends - at[segment]) / np.where(lengths[segment] > 0.0, lengths[segment], 1.0)
        points = path[segment] + share[..., None] * (path[segment + 1] - path[segment])
        saved = (ends[:, 1] - ends[:, 0]) - np.linalg.norm((points[:, 1] - points[:, 0]) * weights, axis=1)
        saved = np.where(segment[:, 0] < segment[:, 1], saved, 0.0)
        for k in _open(points[:, 0], points[:, 1], saved, edges, 1e-2 * at[-1])[:_TRIED]:
            if stop():
                return path
            if edges.free(points[k, 0], points[k, 1]):
                first, last = segment[k]
                path = np.vstack([path[: first + 1], points[k], path[last + 1 :]])
                break
    return _leave_out(path, edges, weights, stop)


def _leave_out(path: FloatArray, edges: EdgeCheck, weights: FloatArray, stop: Callable[[], bool]) -> FloatArray:
    """Leave out points while the way between any two that are not neighbours is free, the greatest saving first."""
    blocked: set[tuple[bytes, bytes]] = set()
    while len(path) > 2:
        at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0) * weights, axis=1))])
        pairs = np.array(
            [
                (i, j)
                for i in range(len(path))
                for j in range(i + 2, len(path))
                if (path[i].tobytes(), path[j].tobytes()) not in blocked
            ]
        )
        if not len(pairs):
            break
        i, j = pairs.T
        saved = at[j] - at[i] - np.linalg.norm((path[j] - path[i]) * weights, axis=1)
        ranked = _open(path[i], path[j], saved + 1e-6 * at[-1], edges, 0.0)
        blocked |= {(path[i[k]].tobytes(), path[j[k]].tobytes()) for k in set(range(len(pairs))) - set(ranked)}
        for k in ranked:
            if stop():
                return path
            if edges.free(path[i[k]], path[j[k]]):
                path = np.vstack([path[: i[k] + 1], path[j[k] :]])
                break
            blocked.add((path[i[k]].tobytes(), path[j[k]].tobytes()))
        else:
            break
    return path


def _open(starts: FloatArray, goals: FloatArray, saved: FloatArray, edges: EdgeCheck, least: float) -> list[int]:
    """Which cuts save more than `least` and are not blocked coarsely, the greatest saving first."""
    worth = np.flatnonzero(saved > least)
    if not len(worth):
        return []
    worth = worth[edges.screen(starts[worth], goals[worth])]
    return [int(k) for k in worth[np.argsort(-saved[worth], kind="stable")]]
