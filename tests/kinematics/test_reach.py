"""How far an arm reaches: known arms, every robot, and the same answer from another seed."""

import numpy as np
import pytest

from pieper.kinematics.fk import fk
from pieper.kinematics.reach import reach
from pieper.model.chain import Chain
from tests.robots import NAMES, chain

SAME_TOP = 1e-6  # [m] two searches that climb the same hill from different samples


@pytest.mark.parametrize("name", NAMES)
def test_answers_are_within_limits_and_true(name: str) -> None:
    arm = chain(name)
    found = reach(arm)
    for q in (found.q_from_base, found.q_from_first_axis):
        assert (q >= arm.limits[:, 0]).all()
        assert (q <= arm.limits[:, 1]).all()
    assert np.linalg.norm(fk(arm, found.q_from_base)[:3, 3]) == found.from_base
    assert reach(arm, seed=1).from_base == pytest.approx(found.from_base, abs=SAME_TOP)
    assert reach(arm, seed=1).from_first_axis == pytest.approx(found.from_first_axis, abs=SAME_TOP)


@pytest.mark.parametrize("name", NAMES)
def test_no_sample_is_farther(name: str) -> None:
    arm = chain(name)
    bounds = np.where(np.isfinite(arm.limits), arm.limits, [-np.pi, np.pi])
    q = np.random.default_rng(5).uniform(bounds[:, 0], bounds[:, 1], (20000, arm.dof))
    assert np.linalg.norm(fk(arm, q)[:, :3, 3], axis=-1).max() <= reach(arm).from_base + SAME_TOP


def test_sliding_first_joint_has_no_axis_to_measure_from() -> None:
    home = np.eye(4)
    home[0, 3] = 1.0
    slide = Chain("slide", [[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]], home, [[0.0, 2.0]], ("lift",))
    found = reach(slide)
    assert found.from_base == pytest.approx(np.sqrt(5.0), rel=1e-12)
    assert np.isnan(found.from_first_axis)


def test_endless_slide_reaches_everywhere() -> None:
    endless = Chain("slide", [[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]], np.eye(4), [[-np.inf, np.inf]], ("lift",))
    assert reach(endless).from_base == np.inf


def test_an_arm_without_joints_stands_still() -> None:
    home = np.eye(4)
    home[:3, 3] = [0.0, 3.0, 4.0]
    found = reach(Chain("still", [], home, [], ()))
    assert found.from_base == pytest.approx(5.0, rel=1e-15)
    assert np.isnan(found.from_first_axis)
    assert found.q_from_base.shape == (0,)


def test_limits_beyond_every_joint_value_are_none() -> None:
    home = np.eye(4)
    home[0, 3] = 1.0
    turn, slide = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    assert reach(Chain("turn", [turn], home, [[-1e20, 1e20]], ("turn",))).from_base == pytest.approx(1.0, rel=1e-15)
    assert reach(Chain("slide", [slide], home, [[0.0, 1e20]], ("slide",))).from_base == np.inf
