"""The configuration in which an arm shows itself."""

import numpy as np
import pytest

from pieper.kinematics.fk import fk_frames
from pieper.kinematics.jacobian import manipulability
from pieper.model.chain import Chain
from pieper.viewer.stance import stance
from tests.robots import NAMES, chain


@pytest.mark.parametrize("name", NAMES)
def test_it_is_within_limits_above_the_ground_and_far_from_singular(name):
    arm = chain(name)
    q = stance(arm)
    assert ((q >= arm.limits[:, 0]) & (q <= arm.limits[:, 1])).all()
    points = fk_frames(arm, q)[:, :3, 3]
    assert points[:, 2].min() > -0.02 * np.abs(points).max()
    assert points[-1, 0] > 0.0
    lower, upper = (np.clip(arm.limits[:, k], -np.pi, np.pi) for k in (0, 1))
    others = manipulability(arm, np.random.default_rng(1).uniform(lower, upper, (500, arm.dof)))
    assert manipulability(arm, q) > np.median(others)


def test_the_same_seed_gives_the_same_values_which_can_be_typed():
    q = stance(chain("ur5e"))
    np.testing.assert_array_equal(q, stance(chain("ur5e")))
    np.testing.assert_array_equal(q, q.round(2))
    assert (stance(chain("ur5e"), seed=1) != q).any()


def test_joints_without_limits_and_arms_without_joints():
    slide = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    turn = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    endless = Chain("endless", [slide, turn], np.eye(4), [[-np.inf, np.inf], [0.0, np.inf]], ("lift", "turn"))
    assert np.isfinite(stance(endless)).all()
    assert stance(endless)[1] >= 0.0
    assert stance(Chain("post", np.empty((0, 6)), np.eye(4), np.empty((0, 2)), ())).shape == (0,)
