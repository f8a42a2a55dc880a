"""What a dragged target means for an arm, without a browser."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pieper
from pieper.errors import ArrayError, UnknownNameError
from pieper.spatial import rotation
from pieper.viewer.solve import KINDS, Solving

MET = 1e-8  # [m and rad]: the solvers' tolerance of 1e-9 a row, and rounding
ARMS = ("ur5e", "mh12", "kr210", "crx10ia", "panda", "kuka_iiwa14", "gen3", "puma", "youbot", "so101")
START = [0.1, -1.2, 1.4, -1.7, -1.5, 0.3]

arm_of = {name: pieper.load(name) for name in ARMS}


def inside(arm, rng, share=0.8):
    lower, upper = np.clip(arm.limits, -3.0, 3.0).T
    return 0.5 * (lower + upper) + share * 0.5 * (upper - lower) * rng.uniform(-1.0, 1.0, arm.dof)


def meets(solved, arm, q, axis="z"):
    """Whether joint values meet the target of a `Solved`, by forward kinematics alone."""
    T, wanted = arm.fk(q), solved.T_base_target
    near = np.abs(T[:3, 3] - wanted[:3, 3]).max() < MET
    if solved.kind == "position":
        return near
    k = "xyz".index(axis)
    if solved.kind == "axis":
        return near and np.abs(T[:3, k] - wanted[:3, k]).max() < MET
    return near and np.abs(T - wanted).max() < MET


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ARMS)
def test_every_solution_shown_meets_the_target_and_says_whether_it_is_within_limits(name, kind):
    arm, rng = arm_of[name], np.random.default_rng(5)
    shown = 0
    for _ in range(4):
        q = inside(arm, rng)
        solving = Solving(arm, q, kind=kind)
        p, dragged = arm.fk(q)[:3, 3], False
        for solved in (solving.solved, solving.move_to(p + 0.004), solving.move_to(p + 0.008, dragging=True)):
            assert len(solved.q) == len(solved.labels) == len(solved.inside) <= solving.most
            for answer, within in zip(solved.q, solved.inside, strict=True):
                assert meets(solved, arm, answer)
                margin = np.minimum(answer - arm.limits[:, 0], arm.limits[:, 1] - answer).min()
                assert within == (margin >= -1e-9)
            shown += len(solved.q)
            assert (solved.chosen is None) == (solved.q_shown is None or solved.nearest is not None)
            dragged |= solved.reached
        assert dragged
    assert shown > 4


@pytest.mark.parametrize("name", ARMS)
def test_putting_the_arm_somewhere_takes_the_solution_where_it_is(name):
    arm, rng = arm_of[name], np.random.default_rng(8)
    for kind in KINDS:
        solving = Solving(arm, kind=kind)
        for _ in range(5):
            q = inside(arm, rng, 0.95)
            solved = solving.put(q)
            assert solved.reached, solved.sentence
            np.testing.assert_allclose(solved.q_shown, q, atol=1e-6)


def test_a_ur5e_shows_all_eight_with_their_labels():
    solving = Solving(arm_of["ur5e"], START)
    solved = solving.solved
    assert len(solved.q) == 8
    assert len(solved.ghosts) == 7
    assert len(set(solved.labels)) == 8
    assert solved.labels[solved.chosen] == "front, elbow up, flip"
    np.testing.assert_allclose(solved.q[solved.chosen], START, atol=1e-9)
    assert "solution 2 of 8: front, elbow up, flip" in solved.sentence


def test_steps_go_round_all_branches_and_back():
    solving = Solving(arm_of["ur5e"], START)
    first = solving.solved.chosen
    seen = [solving.step().chosen for _ in range(8)]
    assert sorted(seen) == list(range(8))
    assert seen[-1] == first
    assert solving.step(-1).chosen == seen[-2]
    assert solving.choose(3).labels[3] == solving.solved.labels[solving.solved.chosen]


def test_the_branch_is_kept_while_the_target_moves():
    arm = arm_of["ur5e"]
    for number in range(8):
        solving = Solving(arm, START)
        label = solving.choose(number).labels[number]
        p = solving.solved.T_base_target[:3, 3]
        for k in range(1, 40):
            before = solving.q
            solved = solving.move_to(p + np.array([-0.002, 0.001, 0.002]) * k, dragging=True)
            assert solved.labels[solved.chosen] == label
            assert np.abs(solving.q - before).max() < 0.2


def test_a_branch_that_ends_is_left_for_the_nearest_with_a_word():
    """A wrist solution of the KR210 that runs into its limit gives way to the other one."""
    arm = arm_of["kr210"]
    rng = np.random.default_rng(2)
    told = 0
    for _ in range(20):
        solving = Solving(arm, inside(arm, rng))
        p = solving.solved.T_base_target[:3, 3]
        direction = rng.standard_normal(3)
        direction /= np.linalg.norm(direction)
        for k in range(60):
            label = solving._label
            solved = solving.move_to(p + 0.03 * k * direction, dragging=True)
            if not solved.reached:
                break
            if solved.labels[solved.chosen] != label:
                assert f"The branch {label!r} ends here" in solved.notice
                told += 1
            else:
                assert "ends here" not in solved.notice
    assert told > 0


def test_out_of_reach_is_told_with_the_nearest_pose():
    arm = arm_of["ur5e"]
    solving = Solving(arm, START)
    q = solving.q
    solved = solving.move_to([2.0, 0.0, 0.3])
    assert not solved.reached
    assert solved.chosen is None
    assert len(solved.q) == 0
    assert solved.reason.startswith("out of reach by 1.04 m")
    T = arm.fk(solved.nearest)
    assert np.linalg.norm(T[:3, 3] - [2.0, 0.0, 0.3]) == pytest.approx(solved.position_error, abs=1e-9)
    assert (solved.nearest >= arm.limits[:, 0]).all()
    assert (solved.nearest <= arm.limits[:, 1]).all()
    np.testing.assert_array_equal(solved.q_shown, solved.nearest)
    np.testing.assert_array_equal(solving.q, q)  # where it goes on from when the target comes back
    back = solving.move_to(arm.fk(START)[:3, 3], dragging=True)
    np.testing.assert_allclose(back.q_shown, START, atol=1e-9)


def test_outside_limits_is_told_and_can_be_looked_at():
    arm = arm_of["mh12"]
    solving = Solving(arm)
    T = arm.fk([0.0, 3.0, 0.0, 0.0, 0.5, 0.0])  # joint 2 ends at 2.7 rad
    solved = solving.move_to(T[:3, 3], xyzw=rotation.as_quaternion(T[:3, :3]))
    assert not solved.reached
    assert not solved.inside.any()
    assert len(solved.q)
    assert "every solution violates" in solved.reason
    assert solved.nearest is not None
    looked = solving.step()
    assert looked.chosen == 0
    assert not looked.reached
    assert "outside the joint limits" in looked.sentence
    assert meets(looked, arm, looked.q_shown)
    assert solving.step(-1).chosen == len(looked.q) - 1


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_an_axis_target_points_that_axis(axis):
    arm = arm_of["ur5e"]
    solving = Solving(arm, START, kind="axis", axis=axis)
    p = arm.fk(START)[:3, 3]
    solved = solving.move_to(p, [0.3, -0.2, 0.9])
    k = "xyz".index(axis)
    wanted = rotation.from_rpy([0.3, -0.2, 0.9])[:, k]
    assert len(solved.q) > 1
    for q in solved.q:
        np.testing.assert_allclose(arm.fk(q)[:3, k], wanted, atol=MET)
    turned = [arm.fk(q)[:3, (k + 1) % 3] for q in solved.q]
    assert np.ptp(turned, axis=0).max() > 0.1  # the rest is free, or all would be alike


@pytest.mark.parametrize("name", ["panda", "kuka_iiwa14", "gen3"])
def test_an_arm_with_seven_joints_slides_along_its_curve_within_limits(name):
    arm, rng = arm_of[name], np.random.default_rng(4)
    moved = 0.0
    for _ in range(5):
        solving = Solving(arm, inside(arm, rng, 0.6))
        T = solving.solved.T_base_target
        start, end, here = solving.span()
        assert start <= here <= end
        for place in np.linspace(start, end, 9):
            before = solving.q
            solved = solving.slide(float(place))
            assert meets(solved, arm, solved.q_shown)
            assert solved.reached
            np.testing.assert_array_equal(solved.T_base_target, T)
            again = solving.span()
            np.testing.assert_allclose(again[:2], (start, end), atol=1e-6)
            assert np.isclose(again[2], place, atol=1e-5) or np.isclose(abs(again[2] - place), end - start, atol=1e-5)
            moved = max(moved, np.abs(solving.q - before).max())
    assert moved > 0.1


def test_six_joints_slide_where_a_row_is_free_and_stay_where_none_is():
    arm = arm_of["kr210"]
    solving = Solving(arm, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    assert solving.curve is None
    assert solving.span() is None
    assert "no joint can move" in solving.slide(0.0).notice
    solving.ask_for("axis")
    start, end, _ = solving.span()
    for place in (start, 0.5 * (start + end), end):
        solved = solving.slide(place)
        assert meets(solved, arm, solved.q_shown)
        assert solved.reached
    solving.ask_for("pose")  # the target is what it was, not where the tip has turned to
    assert meets(solving.solved, arm, solving.q)
    straight = Solving(arm, [0.1, 0.2, 0.3, 0.4, 0.0, 0.6])
    assert straight.curve.coupling == "joint_4 + joint_6 = const"


WRONG = [np.nan, np.inf, -np.inf, 1e30]


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("name", ["ur5e", "panda", "so101"])
def test_malformed_numbers_change_nothing_and_are_told(name, wrong):
    arm = arm_of[name]
    solving = Solving(arm)
    before = solving.solved
    q = np.zeros(arm.dof)
    q[1] = wrong
    for call, said in (
        (lambda: solving.move_to([0.1, wrong, 0.2]), "a position is three finite numbers [m], got (0.1, "),
        (lambda: solving.move_to([0.1, 0.1, 0.1], [wrong, 0.0, 0.0]), "an orientation is three finite angles"),
        (lambda: solving.put(q), f"takes {arm.dof} finite joint values, got ("),
        (lambda: solving.put(q[1:]), f"takes {arm.dof} finite joint values, got ("),
    ):
        solved = call()
        assert said in solved.notice
        assert said in solved.sentence
        np.testing.assert_array_equal(solved.T_base_target, before.T_base_target)
        np.testing.assert_array_equal(solved.q, before.q)
        assert solved.chosen == before.chosen
    if not np.isfinite(wrong):
        assert "quaternion" in solving.move_to([0.0, 0.0, 0.0], xyzw=[wrong, 0.0, 0.0, 0.0]).notice
        assert solving.slide(wrong).notice
    assert "quaternion" in solving.move_to([0.0, 0.0, 0.0], xyzw=[0.0, 0.0, 0.0, 0.0]).notice
    assert solving.move_to(before.T_base_target[:3, 3]).notice == ""


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(ARMS), st.sampled_from(KINDS), st.lists(st.floats(), min_size=6, max_size=6), st.booleans())
def test_no_numbers_make_it_fail(name, kind, numbers, dragging):
    arm = arm_of[name]
    solving = Solving(arm, kind=kind)
    for solved in (solving.move_to(numbers[:3], numbers[3:], dragging=dragging), solving.step(), solving.step(-1)):
        assert solved.sentence
        assert np.isfinite(solved.T_base_target).all()
        shown = solved.q_shown
        assert shown is None or np.isfinite(shown).all()
    solving.slide(numbers[0])


def test_many_samples_are_thinned_out_and_stay_apart():
    solving = Solving(arm_of["kr210"], [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], kind="position", most=8)
    solved = solving.solved
    assert solved.count > 30
    assert len(solved.q) == 8
    apart = np.abs(solved.q[:, None] - solved.q).max(axis=-1) + 9.0 * np.eye(8)
    assert apart.min() > 0.5
    assert f"of 8 shown, {solved.count} found" in solved.sentence


def test_dragged_samples_move_along():
    arm = arm_of["ur5e"]
    solving = Solving(arm, START, kind="position")
    p = arm.fk(START)[:3, 3]
    for k in range(1, 30):
        before = solving.solved.q
        solved = solving.move_to(p - 0.002 * k, dragging=True)
        assert len(solved.q) == len(before) == 16
        assert np.abs(solved.q - before).max() < 0.3


def test_unknown_words():
    with pytest.raises(UnknownNameError, match="no kind of target 'speed'"):
        Solving(arm_of["ur5e"], kind="speed")
    with pytest.raises(UnknownNameError, match="no tool axis 'w'"):
        Solving(arm_of["ur5e"], axis="w")
    with pytest.raises(ArrayError, match="takes 6 finite joint values, got \\(0, 0"):
        Solving(arm_of["ur5e"], [0.0] * 5)
