"""Distances of segments, against Coal and a minimiser."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from pieper.motion.clearance import segment_to_box, segment_to_segment

coal = pytest.importorskip("coal")

AS_COAL = 2e-6  # [m] GJK stops there; for boxes and capsules Coal is exact
ROUNDING = 1e-7  # [m] the square root of double precision, of nearly parallel segments


def segments(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    a, b = random.uniform(-2.0, 2.0, (2, count, 3))
    b[: count // 4] = a[: count // 4] + 1e-9 * random.normal(size=(count // 4, 3))  # nearly points
    along = count // 2
    b[count // 4 : along, 1:] = a[count // 4 : along, 1:]  # along an edge of the box
    b[along : along + 5] = a[along : along + 5]  # points
    return a, b


def test_segment_to_box_as_minimised() -> None:
    a, b = segments(400, 0)
    half = np.random.default_rng(1).uniform(0.0, 1.0, (400, 3))
    half[::7] = 0.0
    got = segment_to_box(a, b, half)

    def distance(t: float, k: int) -> float:
        p = a[k] + t * (b[k] - a[k])
        return float(np.linalg.norm(np.maximum(np.abs(p) - half[k], 0.0)))

    for k in range(400):
        best = minimize_scalar(distance, bounds=(0.0, 1.0), args=(k,), method="bounded", options={"xatol": 1e-10})
        least = min(best.fun, distance(0.0, k), distance(1.0, k))
        assert got[k] == pytest.approx(least, abs=ROUNDING)


def test_segment_to_box_as_coal() -> None:
    a, b = segments(400, 2)
    half = np.random.default_rng(3).uniform(0.05, 1.0, (400, 3))
    request, radius = coal.DistanceRequest(), 0.03
    for k, got in enumerate(segment_to_box(a, b, half)):
        length = float(np.linalg.norm(b[k] - a[k]))
        z = (b[k] - a[k]) / length if length > 1e-12 else np.array([0.0, 0.0, 1.0])
        x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        x /= np.linalg.norm(x)
        R = np.column_stack([x, np.cross(z, x), z])
        result = coal.DistanceResult()
        true = coal.distance(
            coal.Capsule(radius, max(length, 1e-12)),
            coal.Transform3s(R, 0.5 * (a[k] + b[k])),
            coal.Box(*(2.0 * half[k])),
            coal.Transform3s(np.eye(3), np.zeros(3)),
            request,
            result,
        )
        if got > 0.0:
            assert got - radius == pytest.approx(true, abs=AS_COAL)
        else:
            assert true < 0.0


def test_segment_to_segment_as_sampled() -> None:
    a, b = segments(300, 4)
    c, d = segments(300, 5)
    d[:30] = c[:30] + (b[:30] - a[:30])  # parallel
    c[30:40], d[30:40] = a[30:40], b[30:40]  # the same
    got = segment_to_segment(a, b, c, d)
    assert (got[30:40] <= ROUNDING).all()
    for k in range(300):

        def along(s: float, k: int = k) -> float:
            p = a[k] + s * (b[k] - a[k])
            v = d[k] - c[k]
            t = np.clip(v @ (p - c[k]) / max(v @ v, 1e-300), 0.0, 1.0)
            return float(np.linalg.norm(p - c[k] - t * v))

        best = minimize_scalar(along, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-10})
        assert got[k] == pytest.approx(min(best.fun, along(0.0), along(1.0)), abs=ROUNDING)


def test_a_segment_through_a_box_has_no_distance() -> None:
    a = np.array([[-3.0, 0.1, 0.2], [0.0, 0.0, 0.0]])
    b = np.array([[3.0, -0.1, 0.1], [0.1, 0.0, 0.0]])
    assert not segment_to_box(a, b, np.ones((2, 3))).any()
