"""Two models of one arm compared, without a browser."""

from __future__ import annotations

import numpy as np
import pytest

import pieper
from pieper.errors import ArrayError, PieperWarning
from pieper.model import catalog
from pieper.model.dh import from_dh
from pieper.viewer.compare import Comparison

ROUNDING = 5e-15  # [m and rad] two products of some matrices at 3 m


def test_row_b17_and_m1_mh12_against_the_screws_of_the_report():
    """Rows B17 and M1: mean 2.64e-4 m, at most 4.46e-4 m and 4.27e-4 rad over 20000 poses within limits."""
    both = Comparison(pieper.load("mh12", nominal=True), pieper.load("mh12-report"))
    assert both.rules == (
        "joints belong together by name",
        "joint_4_r stays at 0: mh12-report has no such joint",
        "joint_5_b_inverted = -joint_5_b: their axes are opposite",
        "tool is turned by 180 deg about (0 0 1) to lie like tool0",
    )
    spread = both.spread(20000)
    assert spread.samples == 20000
    assert spread.mean_distance == pytest.approx(2.64e-4, abs=0.01e-4)
    assert 4.40e-4 < spread.largest_distance < 4.47e-4  # the last hundredth depends on the sample
    assert spread.largest_angle == pytest.approx(4.27e-4, abs=0.005e-4)
    at_zero = both.difference(np.zeros(6))
    assert float(at_zero.distance) == pytest.approx(3.19e-4, abs=0.005e-4)
    worst = both.difference(spread.q)
    assert float(worst.distance) == spread.largest_distance
    assert spread.q[3] == 0.0


def test_row_b17_ik_of_both_models():
    """Row B17, inverse kinematics: joint values of the report's model miss the arm by what the models differ."""
    both = Comparison(pieper.load("mh12", nominal=True), pieper.load("mh12-report"))
    q = np.array([0.3, 0.2, -0.1, 0.0, 0.5, 0.4])
    found = both.solve(both.arm.fk(q), q)
    np.testing.assert_allclose(found.q, q, atol=1e-9)
    assert 1e-4 < np.abs(found.q - found.q_other).max() < 2e-3
    assert 1e-4 < float(found.missed.distance) < 5e-4
    same = Comparison(both.arm, both.arm)
    assert float(same.solve(both.arm.fk(q), q).missed.distance) < 1e-12


def test_kr210_by_dh_rows_and_by_urdf_are_one():
    both = Comparison(pieper.load("kr210"), pieper.Arm(from_dh(catalog.dh_tables("kr210")["report"])))
    spread = both.spread(2000)
    assert spread.largest_distance < ROUNDING
    assert spread.largest_angle < ROUNDING


def test_joint_values_there_and_back():
    both = Comparison(pieper.load("mh12"), pieper.load("mh12-report"))
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (7, 6))
    np.testing.assert_array_equal(both.from_other(both.as_other(q)), both.common(q))
    assert (both.common(q)[:, 3] == 0.0).all()
    np.testing.assert_array_equal(both.as_other([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), [1.0, 2.0, 3.0, -5.0, 6.0])


def test_the_other_way_round_the_distances_are_the_same():
    one, two = pieper.load("mh12"), pieper.load("mh12-report")
    there, back = Comparison(one, two), Comparison(two, one)
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 6))
    np.testing.assert_allclose(there.difference(q).distance, back.difference(there.as_other(q)).distance, atol=ROUNDING)
    assert "joint_4_r of yaskawa_mh12 stays at 0: mh12-report has no such joint" in back.rules


def test_without_names_in_common_joints_go_by_order():
    both = Comparison(pieper.load("panda"), pieper.load("fr3"))
    assert both.rules == ("joints belong together in their order",)
    assert both.spread(500).largest_distance < ROUNDING
    with pytest.raises(ArrayError, match=r"no joint name in common and 6 and 7 joints; rename the joints of one"):
        Comparison(pieper.load("ur5e"), pieper.load("panda"))


def test_a_tip_that_lies_otherwise_is_turned_or_left():
    kr210, l150 = pieper.load("kr210"), pieper.load("kr210_l150")
    turned, left = Comparison(kr210, l150), Comparison(kr210, l150, turn_tip=False)
    assert float(turned.difference(np.zeros(6)).angle) < ROUNDING
    assert float(left.difference(np.zeros(6)).angle) == pytest.approx(np.pi / 2)
    assert any("is turned by 90 deg" in rule for rule in turned.rules)
    assert len(left.rules) == 1


def test_signs_can_be_given():
    arm = pieper.load("ur5e")
    with pytest.warns(PieperWarning, match="do not look like models of one arm"):
        flipped = Comparison(arm, arm, signs=[1, 1, -1, 1, 1, 1])
    assert "elbow_joint = -elbow_joint: as given" in flipped.rules
    assert float(flipped.difference([0.0, 0.0, 0.5, 0.0, 0.0, 0.0]).distance) > 0.1
    with pytest.raises(ArrayError, match="signs must be 6 numbers 1 or -1"):
        Comparison(arm, arm, signs=[1, 2, 1, 1, 1, 1])
    with pytest.raises(ArrayError, match="count must be at least 1"):
        flipped.spread(0)


@pytest.mark.parametrize(("one", "two"), [("mh12", "ur5e"), ("ur5e", "ur10e"), ("mh12", "kr210")])
def test_two_arms_are_not_taken_for_one_without_a_word(one, two):
    said = f"{one}.* and .* do not look like models of one arm: .* tips are mostly more than"
    with pytest.warns(PieperWarning, match=said.replace("mh12", ".*mh12").replace("kr210", "")):
        both = Comparison(pieper.load(one), pieper.load(two))
    assert "do not look like models of one arm" in both.rules[-1]


def test_random_joints_keep_the_limits_of_both():
    both = Comparison(pieper.load("kr210"), pieper.load("kr210_l150"))
    for lower, upper, mine, its in zip(
        both.limits[:, 0], both.limits[:, 1], both.arm.limits, both.other.limits, strict=True
    ):
        assert mine[0] <= lower <= upper <= mine[1]
        assert its[0] <= lower <= upper <= its[1]
    free = Comparison(pieper.load("gen3"), pieper.load("gen3"))  # joints without limits
    assert np.isfinite(free.limits).all()
    assert np.ptp(free.limits, axis=1).max() == pytest.approx(2.0 * np.pi)


def test_a_pose_out_of_reach_is_told():
    both = Comparison(pieper.load("kr210"), pieper.load("kr210_l150"))
    T = both.arm.fk(np.zeros(6)).copy()
    T[0, 3] = 9.0
    found = both.solve(T, np.zeros(6))
    assert found.reason.startswith("kuka_kr210_robond: out of reach")
    assert "kuka_kr210_l150: out of reach" in found.reason
    assert np.isfinite(found.q).all()
    assert np.isfinite(found.q_other).all()
    assert float(found.missed.distance) > 1.0
