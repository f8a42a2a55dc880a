"""A millimetre beyond the boundary of the workspace, and a micrometre inside it, with the orientation kept.

The boundary is found by walking outwards from a pose of the arm; the true distance by SciPy, from many starts.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pieper.ik.solutions import Status
from pieper.ik.solve import solve
from pieper.model.chain import Chain
from tests.reference import product_of_exponentials as textbook
from tests.robots import ROBOTS, chain

NAMES = tuple(robot.name for robot in ROBOTS if robot.dof == 6)
FOUND_TO = (
    1e-8  # [m] how well the boundary is located: where two answers become one, an error of 1e-16 moves them by 1e-8 rad
)


def without_limits(arm):
    return Chain(arm.name, arm.screws, arm.home, [[-np.inf, np.inf]] * arm.dof, arm.joint_names)


def beyond(T, direction, distance):
    moved = T.copy()
    moved[:3, 3] += distance * direction
    return moved


def boundary(arm, T, direction):
    """How far the arm reaches along a direction without turning its tip."""
    steps = np.linspace(0.0, 10.0, 501)
    reached = solve(arm, np.stack([beyond(T, direction, s) for s in steps])).reached
    last = int(np.flatnonzero(reached)[-1])
    near, far = steps[last], steps[last + 1]
    while far - near > 0.1 * FOUND_TO:
        middle = 0.5 * (near + far)
        near, far = (middle, far) if solve(arm, beyond(T, direction, middle)).reached else (near, middle)
    return near


def left(arm, q, T):
    """Position [m] and rotation vector [rad] that are left."""
    here = textbook.fk(arm, q)
    return np.concatenate([here[:3, 3] - T[:3, 3], Rotation.from_matrix(here[:3, :3].T @ T[:3, :3]).as_rotvec()])


@pytest.mark.parametrize("name", NAMES)
def test_distance_and_detection_at_the_boundary(name):
    arm = without_limits(chain(name))
    rng = np.random.default_rng(20)
    for _ in range(2 if name in ("ur5e", "fanuc_crx10ia", "kuka_kr210_robond") else 1):
        T = textbook.fk(arm, rng.uniform(-np.pi, np.pi, arm.dof))
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        edge = boundary(arm, T, direction)

        inside = solve(arm, beyond(T, direction, edge - 1e-6))
        assert inside.reached, "a micrometre inside is found"

        outside = solve(arm, beyond(T, direction, edge + 1e-3))
        assert outside.status == Status.unreachable
        assert not outside.valid.any()
        wanted = beyond(T, direction, edge + 1e-3)
        starts = [*inside.q[inside.valid], *rng.uniform(-np.pi, np.pi, (5, arm.dof))]
        truth = min(
            np.linalg.norm(
                least_squares(lambda q, T: left(arm, q, T), q, args=(wanted,), xtol=1e-12, ftol=1e-14, gtol=1e-14).fun
            )
            for q in starts
        )
        assert 0.0 < truth <= 1e-3 + FOUND_TO
        said = np.hypot(outside.nearest.position_error, outside.nearest.rotation_error)
        assert abs(said - truth) <= 0.1 * truth
