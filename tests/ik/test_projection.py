"""The nearest poses of arms with five joints: exact ones are those of the closed form, the others are constrained minima.

Truth from outside: the textbook's product of exponentials, and minima by SciPy from many starts.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares, minimize

from pieper.errors import ArrayError
from pieper.ik.closed_form import solve_closed_form
from pieper.ik.family import find_family
from pieper.ik.projection import MOST_PROJECTIONS, Projections, project
from pieper.ik.target import components, ignore_orientation, position_and_axis
from pieper.kinematics.fk import fk
from pieper.model.chain import Chain
from pieper.spatial.rotation import from_rotation_vector
from pieper.spatial.twist import exp
from tests.reference import product_of_exponentials as textbook
from tests.robots import chain

ACCURACY = 1e-10  # [m]: "exactly", for arms of about a metre; rounding leaves 1e-15
SAME = 1e-6  # [rad], joint values of one answer
NEARLY_FREE = 1e-6  # [rad], see the printed angles of the MH12
FLAT = 1e-6  # [rad]: SciPy stops at a change of 1e-12 of a squared angle


@cache
def arm_of(name: str) -> Chain:
    if name == "mh12 locked":
        return chain("yaskawa_mh12").lock(joint_4_r=0.0)
    if name == "mh12 locked, exact numbers":
        return chain("yaskawa_mh12", nominal=True).lock(joint_4_r=0.0)
    if name == "so101 with a bent tool":
        return chain("so101").with_tool(exp([0.03, 0.05, 0.1, 0.3, 0.4, 0.5]))
    if name == "mh12 locked askew":
        return chain("yaskawa_mh12").lock(joint_4_r=0.5)
    if name == "ur5e with a stiff elbow":
        return chain("ur5e").lock(elbow_joint=0.4)
    return chain(name)


PARALLEL = (
    "kuka_youbot",
    "mh12-report",
    "so100",
    "so101",
    "mh12 locked",
    "mh12 locked, exact numbers",
    "so101 with a bent tool",
)
OTHERS = ("mh12 locked askew", "ur5e with a stiff elbow")
ARMS = (*PARALLEL, *OTHERS)


def apart(a, b):
    return np.abs(np.remainder(np.asarray(a) - b + np.pi, 2 * np.pi) - np.pi).max(axis=-1)


def angle_left(R, target):
    difference = R.swapaxes(-1, -2) @ target
    sine = [difference[..., i, j] - difference[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0))]
    return np.arctan2(np.linalg.norm(sine, axis=0), np.trace(difference, axis1=-2, axis2=-1) - 1.0)


def nearly(arm: Chain, count: int, amount: float, seed: int) -> np.ndarray:
    """Poses that the arm can take, turned by about `amount` [rad]."""
    rng = np.random.default_rng(seed)
    T = fk(arm, rng.uniform(-np.pi, np.pi, (count, 5)))
    T[:, :3, :3] = T[:, :3, :3] @ from_rotation_vector(amount * rng.normal(size=(count, 3)))
    return T


def check(arm: Chain, T: np.ndarray, found: Projections) -> None:
    """Errors are what the textbook measures; the nearest comes first; empty places are NaN."""
    for i, j in zip(*np.nonzero(found.valid), strict=True):
        pose = textbook.fk(arm, found.q[i, j])
        assert np.abs(pose - found.T_base_tip[i, j]).max() < 1e-13
        assert np.linalg.norm(pose[:3, 3] - T[i, :3, 3]) < ACCURACY
        assert abs(angle_left(pose[:3, :3], T[i, :3, :3]) - found.rotation_error[i, j]) < 1e-9
    with np.errstate(invalid="ignore"):
        falls = np.diff(found.rotation_error, axis=-1) < -1e-9
    assert not falls.any()
    for part in (found.q, found.T_base_tip, found.rotation_error, found.position_error):
        assert np.isnan(part[~found.valid]).all()
        assert not np.isnan(part[found.valid]).any()


# Poses that the arm can take


@pytest.mark.parametrize("name", ARMS)
def test_a_pose_the_arm_can_take_is_taken(name):
    arm = arm_of(name)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (30, 5))
    found = project(arm, fk(arm, q))
    assert (found.rotation_error[:, 0] < 1e-9).all()
    assert (found.out_of_reach == 0.0).all()
    recalled = found.valid & (apart(found.q, q[:, None]) < SAME)
    assert recalled.any(axis=-1).all()
    assert (found.rotation_error[recalled] < 1e-9).all()


@pytest.mark.parametrize("name", PARALLEL)
def test_exact_answers_are_those_of_the_closed_form(name):
    arm = arm_of(name)
    T = fk(arm, np.random.default_rng(1).uniform(-np.pi, np.pi, (300, 5)))
    closed, found = solve_closed_form(arm, find_family(arm), T), project(arm, T)
    exact = found.valid & (found.rotation_error < 1e-9)
    assert (exact.sum(axis=-1) == closed.valid.sum(axis=-1)).all()
    for one in range(len(T)):
        for q in closed.q[one][closed.valid[one]]:
            assert apart(found.q[one][exact[one]], q).min() < SAME


@pytest.mark.parametrize("name", PARALLEL)
def test_geometry_alone_finds_what_the_closed_form_finds(name, monkeypatch):
    arm = arm_of(name)
    q = np.random.default_rng(2).uniform(-np.pi, np.pi, (200, 5))
    far = fk(arm, q) + 100.0 * np.eye(4, k=3)  # no answers
    monkeypatch.setattr(
        "pieper.ik.projection.solve_closed_form", lambda *_: solve_closed_form(arm, find_family(arm), far)
    )
    found = project(arm, fk(arm, q))
    assert (apart(np.where(found.valid[..., None], found.q, 9.0), q[:, None]).min(axis=-1) < SAME).all()


# Poses that it cannot take


@pytest.mark.parametrize("amount", [1e-6, 1e-3, 0.3, 2.0])
@pytest.mark.parametrize("name", ARMS)
def test_errors_are_measured(name, amount):
    arm = arm_of(name)
    T = nearly(arm, 8, amount, seed=3)
    found = project(arm, T)
    assert found.valid[:, 0].all()
    check(arm, T, found)


@pytest.mark.parametrize("amount", [1e-6, 1e-3, 0.3])
@pytest.mark.parametrize("name", ARMS)
def test_no_farther_than_the_pose_that_was_turned(name, amount):
    arm = arm_of(name)
    rng = np.random.default_rng(4)
    T = fk(arm, rng.uniform(-np.pi, np.pi, (12, 5)))
    turned = T.copy()
    turned[:, :3, :3] = T[:, :3, :3] @ from_rotation_vector(amount * rng.normal(size=(12, 3)))
    found = project(arm, turned)
    assert (found.rotation_error[:, 0] <= angle_left(T[:, :3, :3], turned[:, :3, :3]) + 1e-12).all()


@pytest.mark.parametrize("name", ARMS)
def test_scipy_finds_nothing_nearer(name):
    arm = arm_of(name)
    rng = np.random.default_rng(5)
    for T in nearly(arm, 2, 0.4, seed=6):
        found = project(arm, T)
        best = np.inf
        for start in rng.uniform(-np.pi, np.pi, (10, 5)):
            result = minimize(
                lambda q, T=T: 3.0 - np.trace(fk(arm, q)[:3, :3].T @ T[:3, :3]),
                start,
                jac=lambda q, T=T: 2.0 * arm.native.jacobian(q)[3:].T @ antisymmetric(fk(arm, q)[:3, :3] @ T[:3, :3].T),
                constraints={
                    "type": "eq",
                    "fun": lambda q, T=T: fk(arm, q)[:3, 3] - T[:3, 3],
                    "jac": lambda q: arm.native.jacobian(q)[:3],
                },
                method="SLSQP",
                options={"ftol": 1e-14, "maxiter": 300},
            )
            if np.abs(fk(arm, result.x)[:3, 3] - T[:3, 3]).max() < 1e-8:
                best = min(best, float(angle_left(fk(arm, result.x)[:3, :3], T[:3, :3])))
        assert np.isfinite(best)
        assert found.rotation_error[0] <= best + FLAT


def antisymmetric(E):
    return 0.5 * np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])


@pytest.mark.parametrize("name", ARMS)
def test_small_moves_of_an_answer_that_keep_the_position_go_away_from_the_target(name):
    arm = arm_of(name)
    T = nearly(arm, 6, 0.4, seed=7)
    found = project(arm, T)
    rng = np.random.default_rng(8)
    for i, j in zip(*np.nonzero(found.valid), strict=True):
        q = np.repeat(found.q[i, j][None], 40, axis=0) + 1e-3 * rng.normal(size=(40, 5))
        for _ in range(6):  # back to the position, by the shortest way
            J = arm.native.jacobian(q)[:, :3]
            q += (np.linalg.pinv(J, rcond=1e-6) @ (T[i, :3, 3] - fk(arm, q)[:, :3, 3])[..., None])[..., 0]
        kept = np.abs(fk(arm, q)[:, :3, 3] - T[i, :3, 3]).max(axis=-1) < 1e-12
        # where the position Jacobian loses rank the way back is long
        kept &= apart(q, found.q[i, j]) < 1e-2
        assert (angle_left(fk(arm, q[kept])[:, :3, :3], T[i, :3, :3]) > found.rotation_error[i, j] - 1e-9).all()


@pytest.mark.parametrize("name", PARALLEL)
def test_every_least_value_is_found_on_arms_with_three_parallel_axes(name):
    """Descent from many random starts, by steps of its own, ends in listed answers only."""
    arm = arm_of(name)
    T = nearly(arm, 4, 0.4, seed=9)
    found = project(arm, T)
    assert found.complete
    q = np.random.default_rng(10).uniform(-np.pi, np.pi, (4, 60, 5))
    for _ in range(400):
        J, here = arm.native.jacobian(q), fk(arm, q)
        inverse = np.linalg.pinv(J[..., :3, :], rcond=1e-3)
        back = (inverse @ (T[:, None, :3, 3] - here[..., :3, 3])[..., None])[..., 0]
        E = here[..., :3, :3] @ T[:, None, :3, :3].swapaxes(-1, -2)
        e = np.stack([E[..., 2, 1] - E[..., 1, 2], E[..., 0, 2] - E[..., 2, 0], E[..., 1, 0] - E[..., 0, 1]], axis=-1)
        slope = np.einsum("...ci,...c->...i", J[..., 3:, :], 0.5 * e)
        along = slope - (inverse @ (J[..., :3, :] @ slope[..., None]))[..., 0]
        step = back - 0.25 * along
        q = q + step * np.minimum(1.0, 0.3 / np.maximum(np.abs(step).max(axis=-1, keepdims=True), 1e-12))
    rested = (np.abs(step).max(axis=-1) < 1e-9) & (
        np.linalg.norm(fk(arm, q)[..., :3, 3] - T[:, None, :3, 3], axis=-1) < 1e-9
    )
    assert rested.sum() > 10  # long valleys are left out
    listed = found.valid.sum(axis=-1) < MOST_PROJECTIONS  # where there are more, the farthest are left out
    assert listed.sum() >= 3
    distance = apart(np.where(found.valid[:, None, :, None], found.q[:, None], 9.0), q[:, :, None]).min(axis=-1)
    # saddles attract along one line only, so random starts do not end there
    assert (distance[rested & listed[:, None]] < 1e-4).all()


def test_pointing_out_of_the_plane_of_the_arm_leaves_that_angle():
    """The approach direction is projected into the plane of the arm: youBot, tip on the last axis."""
    arm = chain("kuka_youbot")
    for angle in (1e-9, 1e-4, 0.1, 0.7):
        T = fk(arm, [2.0, 1.3, -1.9, 2.4, 1.0])
        normal = textbook.fk(arm, [2.0, 0, 0, 0, 0])[:3, :3] @ arm.home[:3, :3].T @ arm.screws[1, 3:]
        upwards = np.cross(normal, T[:3, 2])
        turned = T.copy()
        turned[:3, :3] = from_rotation_vector(angle * upwards) @ T[:3, :3]
        found = project(arm, turned)
        assert abs(found.rotation_error[0] - angle) < 1e-12
        assert apart(found.q[:2], [2.0, 1.3, -1.9, 2.4, 1.0]).min() < 1e-9


def test_b16_figure_2_to_the_digits_printed():
    """Printed position and quaternion of the course report: both answers within limits, and what the print's rounding leaves."""
    arm = chain("mh12-report")
    from pieper.spatial.pose import from_position_rotation
    from pieper.spatial.rotation import from_quaternion

    T = from_position_rotation(
        [-1.028302, 0.050718, 1.086594], from_quaternion([-0.169987, -0.064662, 0.900415, 0.395191])
    )
    found = project(arm, T)
    for theta in (
        [-0.049253, -1.282161, 0.975023, 0.320916, -2.363734],
        [-0.049253, -0.975636, 1.562056, 0.601424, -2.363734],
    ):
        nearest = apart(np.where(found.valid[:, None], found.q, 9.0), theta)
        assert nearest.min() < 5e-6
        assert found.rotation_error[nearest.argmin()] < 2e-6


# Singular places


@pytest.mark.parametrize("name", ["kuka_youbot", "mh12 locked, exact numbers"])
def test_over_the_first_axis_every_orientation_is_reached(name):
    """There joint 1 turns the tip without moving it: three axes in all, so any orientation, if the elbow allows."""
    arm = arm_of(name)
    rng = np.random.default_rng(11)
    q = rng.uniform(-np.pi, np.pi, (2000, 5))
    v, w = arm.screws[0, :3], arm.screws[0, 3:]
    point = np.cross(w, v)
    T = fk(arm, q)[:40]
    T[:, :3, 3] = point + np.array([0.0, 0.0, 0.4 if name == "kuka_youbot" else 1.5]) - point * [0, 0, 1]
    found = project(arm, T)
    assert found.valid[:, 0].all()
    check(arm, T, found)
    assert (found.rotation_error[:, 0] < 1e-9).sum() >= 10
    nudged = T.copy()
    nudged[:, 0, 3] += 1e-6
    check(arm, nudged, project(arm, nudged))


@pytest.mark.parametrize("name", PARALLEL)
def test_stretched_folded_and_right_angled_arms(name):
    arm = arm_of(name)
    rng = np.random.default_rng(12)
    q = rng.integers(-1, 3, (60, 5)) * (np.pi / 2)
    T = fk(arm, q)
    found = project(arm, T)
    assert (found.rotation_error[:, 0] < 1e-9).all()
    check(arm, T, found)


def test_the_angle_changes_no_faster_than_the_target_turns():
    arm = arm_of("so101")
    T = nearly(arm, 1, 0.4, seed=13)[0]
    turns = np.linspace(0.0, 0.5, 101)
    path = np.repeat(T[None], 101, axis=0)
    path[:, :3, :3] = from_rotation_vector(turns[:, None] * np.array([0.48, 0.6, 0.64])) @ T[:3, :3]
    left = project(arm, path).rotation_error[:, 0]
    assert np.abs(np.diff(left)).max() <= 0.5 / 100 + 1e-9


# Axes


@pytest.mark.parametrize("name", ARMS)
def test_an_axis_is_pointed_as_well_as_can_be(name):
    arm = arm_of(name)
    T = nearly(arm, 10, 0.4, seed=14)
    whole = project(arm, T)
    for axis in ([0.0, 0.0, 1.0], [0.6, 0.8, 0.0]):
        found = project(arm, position_and_axis(T[:, :3, 3], T[:, :3, :3] @ axis, axis_tip=axis))
        assert found.valid[:, 0].all()
        # an axis that turns with the last joint by 3e-7 rad hardly tells where that joint should be
        assert (found.rotation_error[:, 0] <= whole.rotation_error[:, 0] + NEARLY_FREE).all()
        for i, j in zip(*np.nonzero(found.valid), strict=True):
            pose = textbook.fk(arm, found.q[i, j])
            cosine = np.clip((pose[:3, :3] @ axis) @ T[i, :3, :3] @ axis, -1.0, 1.0)
            assert np.linalg.norm(pose[:3, 3] - T[i, :3, 3]) < ACCURACY
            assert abs(np.cos(found.rotation_error[i, j]) - cosine) < 1e-12


# Out of reach


@pytest.mark.parametrize("name", ARMS)
def test_out_of_reach_says_by_how_much(name):
    arm = arm_of(name)
    T = nearly(arm, 2, 0.1, seed=15)
    T[:, :3, 3] *= np.array([[3.0], [5.0]]) / np.linalg.norm(T[:, :3, 3], axis=-1, keepdims=True)
    found = project(arm, T)
    assert not found.valid.any()
    assert np.isnan(found.q).all()
    rng = np.random.default_rng(16)
    for one, distance in zip(T, found.out_of_reach, strict=True):
        starts = rng.uniform(-np.pi, np.pi, (6, 5))
        least = min(
            np.linalg.norm(least_squares(lambda q, p=one[:3, 3]: fk(arm, q)[:3, 3] - p, start).fun) for start in starts
        )
        assert (1.0 - 1e-4) * least < distance < (1.0 + 1e-5) * least  # the last digits are flat


@pytest.mark.parametrize("beyond", [1e-3, 1e-6])
def test_a_little_out_of_reach(beyond):
    """A youBot stretched out level with its shoulder, from its printed lengths [m]."""
    arm = chain("kuka_youbot")
    reach = 0.033 + 0.155 + 0.135 + np.hypot(0.130, 0.002)
    T = np.eye(4)
    T[:3, 3] = [0.024 + reach + beyond, 0.0, 0.096 + 0.019]
    assert abs(project(arm, T).out_of_reach - beyond) < 0.1 * beyond
    T[0, 3] -= 2 * beyond
    assert project(arm, T).valid.any()


# Shapes and input


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2), (0,)])
@pytest.mark.parametrize("name", ["kuka_youbot", "mh12 locked askew"])
def test_batch_shapes(name, shape):
    arm = arm_of(name)
    T = nearly(arm, max(1, int(np.prod(shape))), 0.2, seed=17)[: int(np.prod(shape))].reshape(*shape, 4, 4)
    found = project(arm, T)
    assert found.q.shape == (*shape, MOST_PROJECTIONS, 5)
    assert found.T_base_tip.shape == (*shape, MOST_PROJECTIONS, 4, 4)
    assert found.valid.shape == found.rotation_error.shape == found.position_error.shape == (*shape, MOST_PROJECTIONS)
    assert found.out_of_reach.shape == shape


@pytest.mark.parametrize("name", ["so101", "mh12 locked askew"])
def test_a_batch_equals_its_parts(name):
    arm = arm_of(name)
    T = nearly(arm, 5, 0.2, seed=18)
    T[2, :3, 3] += 9.0
    together = project(arm, T)
    for one in range(5):
        alone = project(arm, T[one])
        np.testing.assert_allclose(alone.q, together.q[one], atol=1e-9)
        np.testing.assert_allclose(alone.out_of_reach, together.out_of_reach[one], rtol=1e-9)


def test_bad_input():
    with pytest.raises(ArrayError, match=r"projection is for arms with 5 joints, 'ur5e' has 6"):
        project(chain("ur5e"), np.eye(4))
    with pytest.raises(ArrayError, match=r"T_base_tip must have shape \(\.\.\., 4, 4\), got \(3, 4\)"):
        project(chain("so101"), np.zeros((3, 4)))
    with pytest.raises(ArrayError, match="deviates from the identity by"):
        project(chain("so101"), 2.0 * np.diag([1, 1, 1, 0.5]))
    with pytest.raises(ArrayError, match="all rows of weight 1, got weights"):
        project(chain("so101"), ignore_orientation([0.1, 0.1, 0.1]))
    with pytest.raises(ArrayError, match="all rows of weight 1"):
        project(chain("so101"), components(np.eye(4), "x y z rz"))
