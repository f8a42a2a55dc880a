"""Targets that fix a part of a pose: what they ask for is met, what they leave out is free."""

from __future__ import annotations

import numpy as np
import pytest

from pieper.errors import ArrayError
from pieper.ik import target
from pieper.ik.solve import solve
from pieper.kinematics.fk import fk
from pieper.spatial import pose, rotation
from tests.robots import chain

MET = 2e-9  # [m, rad]: the tolerance of the solver, measured another way
ARM = chain("franka_panda")
Q = np.random.default_rng(3).uniform(*ARM.limits.T, (60, 7))
T = fk(ARM, Q)


def reached(answers):
    assert answers.reached.all(), answers.reasons[~answers.reached]
    assert answers.within_limits[..., 0].all()
    return fk(ARM, answers.q[..., 0, :])


def rotation_vector(wanted, got):
    """What is left to turn, in base axes."""
    return rotation.as_rotation_vector(wanted[..., :3, :3] @ np.swapaxes(got[..., :3, :3], -1, -2))


def test_ignore_orientation():
    got = reached(solve(ARM, target.ignore_orientation(T[:, :3, 3])))
    assert np.linalg.norm(got[:, :3, 3] - T[:, :3, 3], axis=1).max() < MET
    assert np.median(rotation.distance(got[:, :3, :3], T[:, :3, :3])) > 0.1  # it is free


def test_hold_orientation():
    start = Q[0]
    near = T[0, :3, 3] + [0.02, -0.01, 0.015]
    got = reached(solve(ARM, target.hold_orientation(near, chain=ARM, q=start), seed=start))
    np.testing.assert_allclose(got[:3, 3], near, atol=MET)
    np.testing.assert_allclose(got[:3, :3], T[0, :3, :3], atol=MET)
    both = target.hold_orientation([near, near], chain=ARM, q=start)
    assert both.T_base_tip.shape == (2, 4, 4)


def test_holding_refuses_what_ignoring_reaches():
    arm = chain("kuka_youbot")  # five joints: most positions cannot be had with another pose's orientation
    q = np.random.default_rng(0).uniform(*arm.limits.T, (40, 5))
    p = fk(arm, q)[:, :3, 3]
    held = solve(arm, target.hold_orientation(p[1:], chain=arm, q=q[0]))
    ignored = solve(arm, target.ignore_orientation(p[1:]))
    assert ignored.reached.all()
    assert held.reached.sum() < 5


def test_weight_orientation_decides_what_is_given_up():
    T_far = T.copy()
    T_far[:, :3, 3] *= 1.3
    errors = {}
    for weight in (0.01, 1.0, 100.0):
        answers = solve(ARM, target.weight_orientation(T_far, weight))
        missed = ~answers.reached
        errors[weight] = answers.nearest
    both = missed & ~np.isnan(errors[0.01].position_error)
    assert both.sum() > 20
    light, heavy = errors[0.01], errors[100.0]
    assert (light.position_error[both] <= heavy.position_error[both] + 1e-6).all()
    assert (light.rotation_error[both] >= heavy.rotation_error[both] - 1e-6).all()
    # with a light orientation the distance left is nearly that with a free orientation
    assert np.median(light.position_error[both] - light.out_of_reach[both]) < 1e-3


def test_a_weight_does_not_change_what_is_reached():
    got = reached(solve(ARM, target.weight_orientation(T, 0.01)))
    assert pose.distance(got, T)[0].max() < MET
    assert pose.distance(got, T)[1].max() < MET


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.0, 2.0, 0.0), (1.0, -2.0, 0.5)])
def test_position_and_axis(axis):
    wanted = T[:, :3, :3] @ np.array(axis)
    got = reached(solve(ARM, target.position_and_axis(T[:, :3, 3], wanted, axis_tip=axis)))
    unit = np.array(axis) / np.linalg.norm(axis)
    a, b = got[:, :3, :3] @ unit, T[:, :3, :3] @ unit
    angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1))
    assert angle.max() < MET
    assert np.linalg.norm(got[:, :3, 3] - T[:, :3, 3], axis=1).max() < MET
    assert np.median(rotation.distance(got[:, :3, :3], T[:, :3, :3])) > 0.1


def test_position_and_axis_with_five_joints():
    arm = chain("kuka_youbot")
    q = np.random.default_rng(0).uniform(*arm.limits.T, (50, 5))
    wanted = fk(arm, q)
    answers = solve(arm, target.position_and_axis(wanted[:, :3, 3], wanted[:, :3, 2]))
    assert answers.reached.all()


@pytest.mark.parametrize(
    "direction", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 1e-12, 0), (1e-9, 0, -1), (0.6, 0.0, -0.8)]
)
@pytest.mark.parametrize("axis", [(0, 0, 1), (1, 0, 0), (-0.6, 0.48, 0.64)])
def test_the_pose_behind_an_axis_target_is_a_pose(direction, axis):
    made = target.position_and_axis([0.1, 0.2, 0.3], direction, axis_tip=axis).T_base_tip
    assert float(rotation.deviation(made[:3, :3])) < 1e-14
    unit = np.array(direction, dtype=float) / np.linalg.norm(direction)
    np.testing.assert_allclose(made[:3, :3] @ (np.array(axis) / np.linalg.norm(axis)), unit, atol=1e-15)


@pytest.mark.parametrize("rows", ["x y z", "x y rz", "z", "x y z rx ry", "y rx ry rz", "rz", "rx ry rz", "z ry"])
@pytest.mark.parametrize("axes", ["base", "tool"])
def test_components(rows, axes):
    got = reached(solve(ARM, target.components(T, rows, position_axes=axes, rotation_axes=axes)))
    left = np.concatenate([T[:, :3, 3] - got[:, :3, 3], rotation_vector(T, got)], axis=1)
    if axes == "tool":
        R_tool_base = np.swapaxes(T[:, :3, :3], -1, -2)
        left = np.concatenate([(R_tool_base @ part[..., None])[..., 0] for part in (left[:, :3], left[:, 3:])], axis=1)
    names = ["x", "y", "z", "rx", "ry", "rz"]
    counted = [names.index(row) for row in rows.split()]
    others = [i for i in range(6) if i not in counted]
    assert np.abs(left[:, counted]).max() < MET
    assert np.median(np.abs(left[:, others])) > 1e-3  # what is not asked for is not kept


@pytest.mark.parametrize("rows", ["x y rz", "z rx ry", "rx ry", "y rx ry rz"])
def test_components_are_met_to_the_last_digits(rows):
    """The derivative of the rows is exact also while other components are far off, so the last step is a Newton step."""
    answers = solve(ARM, target.components(T, rows), position_tolerance=1e-6, rotation_tolerance=1e-6)
    assert answers.exact.mean() > 0.9


def test_components_in_mixed_axes():
    got = reached(solve(ARM, target.components(T, "x rz", position_axes="tool", rotation_axes="base")))
    along = np.einsum("ki,ki->k", T[:, :3, 0], T[:, :3, 3] - got[:, :3, 3])
    assert np.abs(along).max() < MET
    assert np.abs(rotation_vector(T, got)[:, 2]).max() < MET


def test_rotation_only_has_no_distance():
    arm = chain("kuka_youbot")
    answers = solve(arm, target.components(pose.from_xyz_rpy([0, 0, 0], [1.0, 0.5, 2.0]), "rx ry rz"))
    assert answers.reached or np.isnan(answers.nearest.out_of_reach)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: target.ignore_orientation([1.0, 2.0]), r"p_base must have shape \(..., 3\), got \(2,\)"),
        (lambda: target.weight_orientation(np.eye(4), 0.0), "use ignore_orientation"),
        (lambda: target.position_and_axis([0, 0, 1], [0, 0, 0]), "axis_base must have a direction"),
        (
            lambda: target.position_and_axis([0, 0, 1], [0, 0, 1], axis_tip=np.eye(3)),
            r"axis_tip must have shape \(3,\)",
        ),
        (lambda: target.components(np.eye(4), "x w"), "rows must be names out of x, y, z, rx, ry, rz"),
        (lambda: target.components(np.eye(4), "x x"), "each once"),
        (lambda: target.components(np.eye(4), ""), "rows must be names"),
        (lambda: target.components(np.eye(4), "x", position_axes="camera"), "position_axes must be 'base' or 'tool'"),
        (lambda: target.pose(2 * np.eye(4)), "T_base_tip must"),
    ],
)
def test_says_what_is_wrong(make, message):
    with pytest.raises(ArrayError, match=message):
        make()
