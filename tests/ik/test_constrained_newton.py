"""Newton's method on the conditions of Lagrange: derivatives against finite differences, and minima that are known."""

from __future__ import annotations

import numpy as np
import pytest

from pieper.ik import constrained_newton as newton
from pieper.kinematics.fk import fk
from pieper.model.chain import Chain
from tests.robots import ROBOTS, chain

STEP = 1e-6
CLOSE = 1e-8  # of central differences: rounding 1e-16 / STEP, times a few units of length
AXIS = np.array([0.6, 0.0, 0.8])


def state_at(arm, q):
    return newton.State(q, arm.native.fk(q), arm.native.jacobian(q), arm.native.hessian(q), np.arange(len(q)))


def functions(arm, T):
    direction = T[:, :3, :3] @ AXIS
    across = np.linalg.svd(direction[:, None, :])[2][:, 1:]
    q = np.random.default_rng(1).normal(size=(len(T), arm.dof))
    position = lambda state: newton.position_rows(state, T[:, :3, 3], 0.5)  # noqa: E731
    return {
        "position": position,
        "axis rows": lambda state: newton.axis_rows(state, across, AXIS),
        "both": lambda state: newton.stacked(position(state), newton.axis_rows(state, across, AXIS)),
        "rotation": lambda state: newton.rotation_objective(state, T[:, :3, :3]),
        "axis": lambda state: newton.axis_objective(state, direction, AXIS),
        "distance": lambda state: newton.distance_objective(state, q),
    }


@pytest.mark.parametrize("name", [robot.name for robot in ROBOTS if robot.dof <= 6])
def test_derivatives_are_those_of_finite_differences(name):
    arm = chain(name)
    q, elsewhere = np.random.default_rng(0).normal(size=(2, 3, arm.dof))
    for what, function in functions(arm, fk(arm, elsewhere)).items():
        here = function(state_at(arm, q))
        for i in range(arm.dof):
            move = STEP * np.eye(arm.dof)[i]
            after, before = function(state_at(arm, q + move)), function(state_at(arm, q - move))
            first, second = ((a - b) / (2 * STEP) for a, b in zip(after[:2], before[:2], strict=True))
            np.testing.assert_allclose(here.first[..., i], first, atol=CLOSE, err_msg=what)
            np.testing.assert_allclose(here.second[..., i], second, atol=CLOSE, err_msg=what)


def test_values_of_the_objectives_are_cosines():
    arm = chain("ur5e")
    q, elsewhere = np.random.default_rng(0).normal(size=(2, 3, 6))
    T, target = fk(arm, q), fk(arm, elsewhere)
    values = {what: f(state_at(arm, q)) for what, f in functions(arm, target).items()}
    R = T[:, :3, :3].swapaxes(-1, -2) @ target[:, :3, :3]
    np.testing.assert_allclose(values["rotation"].value, 1.5 - 0.5 * np.trace(R, axis1=1, axis2=2), atol=1e-15)
    cosine = np.sum((T[:, :3, :3] @ AXIS) * (target[:, :3, :3] @ AXIS), axis=-1)
    np.testing.assert_allclose(values["axis"].value, 1.0 - cosine, atol=1e-15)


def planar() -> Chain:
    """Three joints of one metre in a plane."""
    home = np.eye(4)
    home[0, 3] = 3.0
    screws = [[0.0, -x, 0.0, 0.0, 0.0, 1.0] for x in (0.0, 1.0, 2.0)]
    return Chain("planar", screws, home, [[-9.0, 9.0]] * 3, ("a", "b", "c"))


def test_the_nearest_joint_values_to_a_seed_that_meets_the_rows_are_the_seed():
    arm = planar()
    seed = np.array([[0.3, -0.8, 1.1]])
    p = fk(arm, seed)[:, :3, 3]
    found = newton.minimise(
        arm,
        seed + 0.3,
        np.zeros(1, dtype=np.intp),
        lambda state: newton.position_rows(state, p, 1.0),
        lambda state: newton.distance_objective(state, seed),
    )
    assert found.minimum.all()
    np.testing.assert_allclose(found.q, seed, atol=1e-12)


def test_bounds_are_kept_and_reached():
    """The nearest to the seed would fold joint 2 beyond its bound; it stays there and the others make up for it."""
    arm = planar()
    seed = np.array([[0.3, -0.8, 1.1]])
    made_by = np.array([[0.1, -0.5, 1.0]])
    p = fk(arm, made_by)[:, :3, 3]
    rows = lambda state: newton.position_rows(state, p, 1.0)  # noqa: E731
    distance = lambda state: newton.distance_objective(state, seed)  # noqa: E731
    which = np.zeros(1, dtype=np.intp)
    free = newton.minimise(arm, seed, which, rows, distance)
    assert free.minimum.all()
    limits = np.array([[-np.inf, np.inf], [free.q[0, 1] + 0.1, 2.0], [-2.0, np.inf]])
    held = newton.minimise(arm, seed, which, rows, distance, limits=limits)
    assert held.minimum.all()
    assert held.q[0, 1] == limits[1, 0]
    np.testing.assert_allclose(fk(arm, held.q)[:, :3, 3], p, atol=1e-13)
    # the arm has one freedom, so with joint 2 at its bound the nearest is one of two places: scan the family
    turns = np.linspace(-np.pi, np.pi, 20001)
    wrist = p[0, :2] - np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    cosine = (np.sum(wrist**2, axis=-1) - 2.0) / 2.0
    best = np.inf
    for side in (1.0, -1.0):
        second = side * np.arccos(np.clip(cosine, -1.0, 1.0))
        first = np.arctan2(wrist[:, 1], wrist[:, 0]) - 0.5 * second
        q = np.stack([first, second, np.remainder(turns - first - second + np.pi, 2 * np.pi) - np.pi], axis=-1)
        allowed = (np.abs(cosine) <= 1.0) & ((q >= limits[:, 0]) & (q <= limits[:, 1])).all(axis=-1)
        best = min(best, np.linalg.norm(q[allowed] - seed, axis=-1).min(initial=np.inf))
    assert np.linalg.norm(held.q - seed) <= best + 1e-12
    assert np.linalg.norm(held.q - seed) > best - 1e-3  # the scan is as fine as that


def test_a_place_that_is_not_a_minimum_is_not_called_one():
    arm = planar()
    q = np.array([[0.3, -0.8, 1.1]])
    p = fk(arm, q)[:, :3, 3]
    seed = q + np.array([np.pi, 0.0, 0.0])  # half a turn of the whole: farther away along the family than beside it

    class Upside:
        def __call__(self, state):
            near = newton.distance_objective(state, seed)
            return newton.Objective(-near.value, -near.first, -near.second)

    found = newton.minimise(arm, q, np.zeros(1, dtype=np.intp), lambda s: newton.position_rows(s, p, 1.0), Upside())
    assert not (found.minimum & (np.abs(found.q - q).max(axis=-1) < 1e-9)).any()
