"""Poses at which a joint is free, limits that cut the free part, and seeds far away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pieper
from pieper.errors import PieperError
from pieper.ik import select, target
from pieper.ik.solutions import Status
from pieper.ik.solve import solve
from tests.judge import MEASURED, inside, joints, left
from tests.laws.test_families_of_answers import WRISTS
from tests.reference import product_of_exponentials as textbook
from tests.robots import chain

UR = ("ur3e", "ur5e", "ur10", "ur16e", "ur20")


def straight(arm, q):
    """The same joints with axes 4 and 6 in line."""
    w4, w5, w6 = arm.screws[3:, 3:]
    q = q.copy()
    q[4] = np.arctan2(-w4 @ np.cross(w5, w6), w4 @ np.cross(w5, np.cross(w5, w6)))
    return q


@pytest.mark.parametrize("name", WRISTS)
def test_a_straight_wrist_within_narrow_limits_is_reached_from_the_seed_and_without(name):
    arm = chain(name)
    for q in joints(arm, 10, seed=1):
        q = straight(arm, q)
        held = replace(arm, limits=np.stack([q - 0.5, q + 0.5], axis=1))
        T = textbook.fk(arm, q)
        for seed in (q, None):
            answers = solve(held, T, seed=seed)
            assert answers.reached, answers.reason
            assert not answers.complete
            assert inside(held, answers.q[0])
            assert max(left(textbook.fk(arm, answers.q[0]), T)) <= MEASURED


@pytest.mark.parametrize("name", WRISTS)
def test_a_straight_wrist_stays_where_the_arm_is(name):
    arm = chain(name)
    for q in joints(arm, 10, seed=2):
        q = straight(arm, q)
        q = np.clip(q, *arm.limits.T)
        T = textbook.fk(arm, q)
        assert np.abs(solve(arm, T, seed=q).q[0] - q).max() < 1e-3


def test_a_seed_outside_the_limits_of_a_free_joint_is_brought_inside():
    limits = np.array(chain("ur5e").limits)
    limits[5] = 1.0, 2.0
    arm = replace(chain("ur5e"), limits=limits)
    down = target.position_and_axis([0.4, 0.2, 0.3], [0.0, 0.0, -1.0])
    answers = solve(arm, down, seed=np.zeros(6))
    assert answers.reached
    assert inside(arm, answers.q[0])


@pytest.mark.parametrize("far", [1e2, 1e6, 1e12])
def test_a_seed_far_away_costs_no_accuracy(far):
    arm = replace(chain("ur5e"), limits=np.tile([-np.inf, np.inf], (6, 1)))
    q = joints(arm, 1, seed=3)[0]
    T = textbook.fk(arm, q)
    answers = solve(arm, T, seed=np.full(6, far))
    assert answers.count == 8
    for answer in answers.q[answers.valid]:
        assert max(left(textbook.fk(arm, answer), T)) <= MEASURED


def test_what_is_said_of_limits_does_not_depend_on_the_seed():
    arm = chain("yaskawa_mh12")
    T = textbook.fk(arm, [0.0, 3.0, 0.0, 0.0, 0.5, 0.0])
    alone = solve(arm, T)
    assert alone.status == Status.outside_limits
    assert solve(arm, T, seed=np.full(6, 40.0)).reason == alone.reason
    assert (
        select.within_limits(alone).reason
        == "reachable, but no answer is left: those that there were have been sorted out"
    )


def test_the_nearest_answer_is_one_inside_the_limits_if_there_is_one():
    arm = chain("yaskawa_mh12")
    answers = solve(arm, textbook.fk(arm, [0.313, -0.197, 1.756, 2.292, 2.306, 2.014]))
    assert inside(arm, select.nearest(answers, [-2.83, -0.29, 0.33, -1.49, 2.55, 1.2]))


def test_nearest_ik_takes_one_pose_and_says_why_there_is_none():
    panda, ur5e = pieper.load("panda"), pieper.load("ur5e")
    far = np.eye(4)
    far[0, 3] = 3.0
    for arm in (panda, ur5e):
        with pytest.raises(PieperError, match=r"no joint values of .* to take: out of reach by"):
            arm.nearest_ik(far, np.zeros(arm.dof))
        with pytest.raises(PieperError, match="nearest_ik takes one pose"):
            arm.nearest_ik(np.stack([far, far]), np.zeros(arm.dof))
        with pytest.raises(PieperError, match=rf"q must have shape \(..., {arm.dof}\)"):
            arm.nearest_ik(far, np.zeros(4))


def test_a_value_of_the_redundancy_is_refused_for_some_rows():
    arm = chain("franka_panda")
    with pytest.raises(PieperError, match="this target is of some rows"):
        solve(arm, target.ignore_orientation([0.4, 0.1, 0.4]), redundancy=0.5)


def test_a_held_joint_is_sampled_once():
    arm = chain("franka_panda")
    q = joints(arm, 1, seed=4)[0]
    answers = solve(replace(arm, limits=np.stack([q, q], axis=1)), textbook.fk(arm, q))
    assert answers.count <= 8
    np.testing.assert_allclose(answers.q[0], q, atol=1e-9)
