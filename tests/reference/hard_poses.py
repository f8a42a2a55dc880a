"""Joint values near singularities, folds and the edge of the workspace of any arm whose joints turn."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

Forward = Callable[[np.ndarray], np.ndarray]
"""(m, n) joint values to (m, 4, 4) poses."""
Jacobian = Callable[[np.ndarray], np.ndarray]
"""(..., n) joint values to (..., 6, n)."""

EXACT = 1e-11  # least singular value that counts as none
LEADS = 1e-3  # rad: the step by which joints are tried
WIDTH = 36  # cells of a turn


def least(jacobian: Jacobian, q: np.ndarray) -> np.ndarray:
    """Least singular value of the Jacobian (m and rad mixed)."""
    return np.linalg.svd(jacobian(q), compute_uv=False)[..., -1]


def singular(
    jacobian: Jacobian, dof: int, count: int, rng: np.random.Generator
) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Kinds of singular configurations: words, joint values (m, n), and the joint that leads away fastest (m,).

    The least singular value is minimised along one joint after another. Kinds are told apart by the joints that lead away:
    joint 5 alone is the wrist of common arms, joint 3 alone the elbow, several joints together the shoulder.
    """
    found, angles = [], np.linspace(-np.pi, np.pi, WIDTH + 1)[:-1]
    for joint in range(1, dof - 1):
        q = rng.uniform(-np.pi, np.pi, (count, dof))
        swept = np.repeat(q[:, None], WIDTH, axis=1)
        swept[..., joint] = angles
        values = least(jacobian, swept)
        low = (values < np.roll(values, 1, axis=1)) & (values < np.roll(values, -1, axis=1))
        rows, columns = np.nonzero(low)
        start = q[rows]
        start[:, joint] = angles[columns]
        found.append(_lowest(jacobian, start, joint, angles[1] - angles[0]))
    q = np.concatenate(found)
    q = rng.permutation(q[least(jacobian, q) < EXACT])
    away = np.stack([least(jacobian, q + LEADS * e) for e in np.eye(dof)], axis=1)
    leads = away > 1e-6
    fastest = away.argmax(axis=1)
    alone = leads.sum(axis=1) == 1
    kinds = {f"joint {k + 1} alone": alone & leads[:, k] for k in range(dof)}
    kinds["several joints"] = leads.sum(axis=1) > 1
    for words, which in kinds.items():
        if which.any():
            yield words, q[which][:count], fastest[which][:count]


def _lowest(jacobian: Jacobian, q: np.ndarray, joint: int, width: float) -> np.ndarray:
    """Golden section on the least singular value along one joint; it falls to zero in straight lines."""
    ratio = (np.sqrt(5.0) - 1.0) / 2.0
    low, high = q.copy(), q.copy()
    low[:, joint] -= width
    high[:, joint] += width
    for _ in range(85):
        a, b = high - ratio * (high - low), low + ratio * (high - low)
        left = (least(jacobian, a) < least(jacobian, b))[:, None]
        low, high = np.where(left, low, a), np.where(left, b, high)
    return 0.5 * (low + high)


def farthest(forward: Forward, dof: int, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Joint values whose tip is farthest in some directions, and the directions: (count, n), (count, 3).

    The way of the tip in a direction is a sine wave of every joint, so each joint in turn is put at its crest.
    """
    starts = 24
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    q = rng.uniform(-np.pi, np.pi, (count, starts, dof))

    def way(at: np.ndarray) -> np.ndarray:
        tips = forward(at.reshape(-1, dof))[:, :3, 3].reshape(count, starts, 3)
        return (tips * directions[:, None]).sum(axis=-1)

    before = np.full((count, starts), -np.inf)
    for _ in range(400):
        for joint in range(dof):
            values = []
            for angle in (0.0, np.pi / 2, np.pi):
                q[..., joint] = angle
                values.append(way(q))
            mean = (values[0] + values[2]) / 2
            q[..., joint] = np.arctan2(values[1] - mean, values[0] - mean)
        now = way(q)
        if (now - before).max() < 1e-15:
            break
        before = now
    return q[np.arange(count), way(q).argmax(axis=1)], directions


def inside_edge(
    forward: Forward, q: np.ndarray, directions: np.ndarray, depth: float, rng: np.random.Generator
) -> np.ndarray:
    """Joint values nearby whose tip is short of the farthest by `depth` [m]."""

    def short(at: np.ndarray) -> np.ndarray:
        return ((forward(q) - forward(at))[:, :3, 3] * directions).sum(axis=1)

    step = rng.normal(size=q.shape)
    low, high = np.zeros((len(q), 1)), np.full((len(q), 1), 0.3)
    for _ in range(60):
        middle = 0.5 * (low + high)
        less = short(q + middle * step)[:, None] < depth
        low, high = np.where(less, middle, low), np.where(less, high, middle)
    return q + low * step


def inside_fold(jacobian: Jacobian, q: np.ndarray, depth: float) -> np.ndarray:
    """Joint values beside those singular ones where two answers meet, so far that the pose is `depth` within [m, rad]."""
    step = 1e-4
    U, _, Vt = np.linalg.svd(jacobian(q), full_matrices=False)
    u, n = U[..., :, -1], Vt[..., -1, :]
    bend = np.einsum("mi,mij,mj->m", u, (jacobian(q + step * n) - jacobian(q - step * n)) / (2 * step), n)
    fold = np.abs(bend) > 1e-2
    return q[fold] + n[fold] * np.sqrt(2 * depth / np.abs(bend[fold]))[:, None]
