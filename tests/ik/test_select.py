"""Choosing among answers: copies by whole turns, limits, and nearness."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pieper.errors import ArrayError, PieperError
from pieper.ik import select
from pieper.ik.solutions import IKSolutions, Nearest, Status
from pieper.ik.solve import solve
from pieper.kinematics.fk import fk
from pieper.model.chain import Chain
from tests.robots import chain

TURN = 2 * np.pi


def arm_with(limits, slides=()):
    """Joints about or along z; the geometry does not matter here."""
    n = len(limits)
    screws = [[0, 0, 1, 0, 0, 0] if i in slides else [0, -i, 0, 0, 0, 1] for i in range(n)]
    return Chain("arm", screws, np.eye(4), limits, [f"j{i}" for i in range(n)])


def answers_with(arm, q, valid=None):
    """Made-up answers (..., k, n)."""
    q = np.asarray(q, dtype=float)
    valid = np.ones(q.shape[:-1], bool) if valid is None else np.asarray(valid)
    none = np.full(q.shape[:-2], np.nan)
    return IKSolutions(
        chain=arm,
        q=np.where(valid[..., None], q, np.nan),
        valid=valid,
        position_error=np.where(valid, 1e-12, np.nan),
        rotation_error=np.where(valid, 1e-12, np.nan),
        within_limits=valid,
        branch=np.full(valid.shape, -1, np.int8),
        status=np.where(valid.any(axis=-1), Status.reached, Status.unreachable).astype(np.int8),
        complete=np.ones(q.shape[:-2], bool),
        find_nearest=lambda _: Nearest(np.full((*q.shape[:-2], q.shape[-1]), np.nan), none, none, none),
        position_tolerance=1e-9,
        rotation_tolerance=1e-9,
    )


def test_within_limits_takes_the_copy_inside():
    arm = arm_with([[-4.0, -1.0], [-1.0, 1.0]])
    answers = select.within_limits(answers_with(arm, [[3.0, 0.5], [3.0, 2.0], [-0.5, 0.0]]), arm)
    assert answers.valid.tolist() == [True, False, False]
    assert answers.within_limits.tolist() == [True, False, False]
    np.testing.assert_allclose(answers.q[0], [3.0 - TURN, 0.5])
    assert np.isnan(answers.q[1:]).all()
    assert np.isnan(answers.position_error[1:]).all()
    assert answers.position_error[0] == 1e-12


def test_within_limits_leaves_good_answers_where_they_are():
    arm = arm_with([[-10.0, 10.0], [-np.inf, np.inf]])
    q = [[9.0, 50.0], [-9.9, -3.0]]
    np.testing.assert_array_equal(select.within_limits(answers_with(arm, q)).q, q)


def test_slides_have_no_copies():
    arm = arm_with([[-1.0, 1.0]], slides=[0])
    answers = answers_with(arm, [[0.5 + TURN]])
    assert not select.within_limits(answers).valid.any()
    np.testing.assert_allclose(select.nearest(answers, [0.0]), [0.5 + TURN])


def test_nothing_left_is_said():
    arm = arm_with([[-1.0, 1.0]])
    answers = select.within_limits(answers_with(arm, [[2.0]]))
    assert not answers.reached
    assert "no answer is left" in answers.reason


def brute_force_nearest(arm, answers, q):
    best, distance = None, np.inf
    for found in answers.q[answers.valid]:
        for turns in product(range(-4, 5), repeat=len(q)):
            copy = found + TURN * np.array(turns)
            inside = np.all((copy >= arm.limits[:, 0]) & (copy <= arm.limits[:, 1]))
            if inside and np.linalg.norm(copy - q) < distance:
                best, distance = copy, np.linalg.norm(copy - q)
    return best, distance


ANGLE = st.floats(-3.1, 3.1)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(ANGLE, ANGLE), min_size=1, max_size=4), st.tuples(st.floats(-8, 8), st.floats(-8, 8)))
def test_nearest_is_the_nearest_copy_of_all(found, q):
    arm = arm_with([[-7.0, 7.0], [-4.0, 9.0]])
    answers = select.within_limits(answers_with(arm, found), arm)
    chosen = select.nearest(answers, q)
    if not answers.reached:
        assert np.isnan(chosen).all()
        return
    _, distance = brute_force_nearest(arm, answers, np.array(q))
    assert np.linalg.norm(chosen - q) == pytest.approx(distance, abs=1e-12)
    assert np.all((chosen >= arm.limits[:, 0]) & (chosen <= arm.limits[:, 1]))


def test_weights_change_the_choice():
    arm = arm_with([[-3.0, 3.0]] * 2)
    answers = answers_with(arm, [[1.0, 0.0], [0.0, 1.5]])
    np.testing.assert_array_equal(select.nearest(answers, [0.0, 0.0]), [1.0, 0.0])
    np.testing.assert_array_equal(select.nearest(answers, [0.0, 0.0], weights=[10.0, 1.0]), [0.0, 1.5])


def test_batches_and_missing_answers():
    arm = arm_with([[-3.0, 3.0]])
    answers = answers_with(arm, [[[1.0], [2.0]], [[1.0], [2.0]]], valid=[[True, True], [False, False]])
    chosen = select.nearest(answers, [1.9])
    np.testing.assert_array_equal(chosen, [[2.0], [np.nan]])
    assert select.nearest(replace(answers, q=answers.q[:, :0], valid=answers.valid[:, :0]), [0.0]).shape == (2, 1)


def test_all_of_a_real_arm():
    arm = chain("ur5e")
    q = np.array([0.1, -1.2, 1.4, -1.7, -1.5, 0.3])
    answers = solve(arm, fk(arm, q), count=8)
    now = q + np.array([0.02, 0.01, -0.02, 0.01, 0.0, 0.3 - TURN])
    chosen = select.nearest(select.within_limits(answers, arm), now)
    np.testing.assert_allclose(chosen, q - np.array([0, 0, 0, 0, 0, TURN]), atol=1e-7)


@pytest.mark.parametrize(
    ("q", "options", "message"),
    [
        ([0.0], {}, r"q must have shape \(..., 2\), got \(1,\)"),
        (np.zeros((3, 2)), {}, r"q must have leading axes that broadcast to \(\), got shape \(3, 2\)"),
        ([0.0, 0.0], {"weights": [1.0]}, r"weights must have shape \(..., 2\)"),
        ([0.0, np.nan], {}, "q must be finite"),
    ],
)
def test_says_what_is_wrong(q, options, message):
    with pytest.raises(ArrayError, match=message):
        select.nearest(answers_with(arm_with([[-1.0, 1.0]] * 2), [[0.0, 0.0]]), q, **options)


def test_by_branch_keeps_what_the_words_say():
    arm = chain("ur5e")
    answers = solve(arm, fk(arm, [[0.1, -1.2, 1.4, -1.7, -1.5, 0.3], [0.4, -1.0, 1.1, -0.7, 1.5, 0.3]]))
    back = select.by_branch(answers, "back")
    assert back.valid.sum(axis=1).tolist() == [4, 4]
    one = select.by_branch(back, "no flip, elbow down")
    assert one.valid.sum(axis=1).tolist() == [1, 1]
    for k in range(2):
        (label,) = one.labels[k][one.valid[k]]
        assert label == "back, elbow down, no flip"
        assert np.isnan(one.q[k][~one.valid[k]]).all()
    assert not select.by_branch(back, "front").valid.any()


def test_by_branch_names_what_it_does_not_know():
    arm = chain("ur5e")
    answers = solve(arm, fk(arm, [0.1, -1.2, 1.4, -1.7, -1.5, 0.3]))
    with pytest.raises(PieperError, match=r"no label 'left' in the answers of 'ur5e'.*back"):
        select.by_branch(answers, "left")
    general = chain("fanuc_crx10ia")
    with pytest.raises(PieperError, match="no label 'front'"):
        select.by_branch(solve(general, fk(general, [0.1] * 6)), "front")


def found_among(answers, q):
    """Whether a joint vector is one of these answers but for whole turns."""
    apart = (answers.q[answers.valid] - q + np.pi) % TURN - np.pi
    return (np.abs(apart).max(axis=1) < 1e-12).any()


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.lists(st.tuples(ANGLE, ANGLE, st.booleans()), min_size=3, max_size=3), min_size=1, max_size=6),
    st.tuples(st.floats(-8, 8), st.floats(-8, 8)),
)
def test_along_takes_the_nearest_to_the_one_before(rows, q):
    arm = arm_with([[-7.0, 7.0], [-np.inf, 9.0]])
    found = np.array([[answer[:2] for answer in row] for row in rows])
    answers = answers_with(arm, found, valid=[[answer[2] for answer in row] for row in rows])
    here = np.array(q)
    for i, chosen in enumerate(select.along(answers, q)):
        one = answers_with(arm, found[i], valid=answers.valid[i])
        nearest = select.nearest(one, here)
        assert np.isnan(chosen).any() == np.isnan(nearest).any()
        if not np.isnan(chosen).any():  # of two that are as near, either
            assert np.linalg.norm(chosen - here) == pytest.approx(np.linalg.norm(nearest - here), abs=1e-12)
            assert found_among(one, chosen)
            here = chosen


def test_along_takes_answers_outside_where_none_is_inside():
    arm = arm_with([[-1.0, 1.0], [-0.5, 0.5]], slides=[1])
    answers = answers_with(arm, [[[3.0, 0.7]], [[0.5, 0.2]]])
    np.testing.assert_allclose(select.along(answers, [-3.0, 0.0]), [[3.0 - TURN, 0.7], [0.5, 0.2]], atol=1e-15)
    left = select.within_limits(answers, arm)
    np.testing.assert_array_equal(select.along(left, [-3.0, 0.0]), [[np.nan, np.nan], [0.5, 0.2]])


def test_along_is_for_a_sequence():
    arm = chain("ur5e")
    with pytest.raises(ArrayError, match=r"a sequence of targets \(m, 4, 4\) and one joint vector \(6,\)"):
        select.along(solve(arm, fk(arm, np.zeros(6))), np.zeros(6))


def test_a_copy_that_ends_on_a_limit_is_inside_it():
    arm = chain("kuka_kr210_robond")
    lower, upper = arm.limits.T
    q = (lower + upper) / 2
    q[0] = lower[0]  # -185 deg, whose copy within half a turn is 175 deg
    answers = solve(arm, fk(arm, np.array([q])))
    for chosen in (select.along(answers, q)[0], select.nearest(answers, q)[0]):
        assert chosen[0] == lower[0]
        np.testing.assert_allclose(fk(arm, chosen), fk(arm, q), atol=1e-9)
        assert ((lower <= chosen) & (chosen <= upper)).all()
