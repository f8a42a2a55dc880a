"""Each safeguard of the general solver, on a kind of arm and pose at which solutions were lost without it.

The numbers in the docstrings are losses that were measured while the safeguard was missing; the derivation page has the
reasons.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from pieper._native import kernels
from pieper.ik.general_6r import Flag, prepare, solve_general_6r
from pieper.kinematics.fk import fk
from pieper.kinematics.jacobian import jacobian
from pieper.model.chain import Chain
from pieper.spatial.rotation import from_rotation_vector
from tests.ik.test_general_6r import apart, arm_of, oracle_arm, random_arm
from tests.robots import chain

ACCURACY = 1e-9  # [m, rad] of every answer
SAME = 1e-6  # rad, at random poses
SAME_SINGULAR = 1e-5  # rad: what rounding leaves of the joints next to singular poses
# forms by their number: the remaining joint of those that hold the target on the right
FORM = {"q3": 0, "q1": 1, "q2": 2, "q4": 3, "q6": 4, "q5": 5}


def link(theta, d, a, alpha):
    """A link after Denavit and Hartenberg, (4, 4)."""
    (ct, ca), (st, sa) = np.cos([theta, alpha]), np.sin([theta, alpha])
    return np.array([[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]])


def jaco2():
    """Kinova JACO2 with the curved wrist: three axes 60 degrees apart that do not meet."""
    d1, d2, d3, d4, d5, d6, e2, half = 0.2755, 0.41, 0.2073, 0.0741, 0.0741, 0.16, 0.0098, np.pi / 6
    part = np.sin(half) / np.sin(2 * half)
    rows = [
        (d1, 0, np.pi / 2),
        (0, d2, np.pi),
        (-e2, 0, np.pi / 2),
        (-(d3 + part * d4), 0, 2 * half),
        (-part * (d4 + d5), 0, 2 * half),
        (-(part * d5 + d6), 0, np.pi),
    ]
    return arm_of([link(0, *row) for row in rows], name="jaco2")


def piper():
    """AgileX PiPER as its URDF has it: a wrist whose axes miss each other by 0.09 mm, right angles of five digits."""
    origins = [
        ([0, 0, 0], 1.5708, -0.1359, -3.1416),
        ([0.28503, 0, 0], 0, 0, -1.7939),
        ([-0.021984, -0.25075, 0], 1.5708, 0, 0),
        ([0, 0, 0], -1.5708, 0, 0),
        ([8.8259e-05, -0.091, 0], 1.5708, 0, 0),
    ]
    links = [np.eye(4) for _ in range(6)]
    for step, (xyz, roll, pitch, yaw) in zip(links, origins, strict=False):
        turns = [from_rotation_vector(v) for v in ([0, 0, yaw], [0, pitch, 0], [roll, 0, 0])]
        step[:3, :3], step[:3, 3] = turns[0] @ turns[1] @ turns[2], xyz
    return arm_of(links, name="piper")


def sixteen():
    """The arm of Manocha and Zhu (1994) that has sixteen answers."""
    right, one = np.pi / 2, np.pi / 180
    rows = [(0, 0.3, right), (0, 1, one), (0.2, 0, right), (0, 1.5, one), (0, 0, right), (0, 0, one)]
    return arm_of([link(0, *row) for row in rows], name="sixteen")


def displaced(name, size, seed):
    """A built-in arm with every axis moved and turned by random amounts [m, rad] of a size, as calibration leaves them."""
    arm = chain(name)
    screws = arm.screws + size * np.random.default_rng(seed).normal(size=(6, 6))
    w = screws[:, 3:] / np.linalg.norm(screws[:, 3:], axis=1, keepdims=True)
    v = screws[:, :3] - w * (w * screws[:, :3]).sum(axis=1, keepdims=True)
    return Chain(f"{name}, off by {size}", np.hstack([v, w]), arm.home, arm.limits, arm.joint_names)


@cache
def arm_named(name):
    made = {"jaco2": jaco2, "piper": piper, "sixteen": sixteen, "hc10": lambda: oracle_arm("a169")}
    if name.startswith("random"):
        return random_arm(int(name.split()[1]))
    return made[name]() if name in made else chain(name)


def random_joints(count, seed=1):
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, 6))


def by_one_form(arm, form, T):
    q, position, rotation, _, flags = prepare(arm).native.solve_one_form(form, T)
    assert np.nanmax(position, initial=0.0) < ACCURACY
    assert np.nanmax(rotation, initial=0.0) < ACCURACY
    return q, flags


def lost_by(answers_q, q, within=SAME):
    return apart(answers_q, q[:, None]).min(axis=1) > within


def least_singular_values(arm, q):
    return np.linalg.svd(jacobian(arm, q), compute_uv=False)[..., -1]


def singular_joints(arm, count, seed):
    """Joints at which the Jacobian's determinant changes its sign, by bisection in one joint."""
    rng = np.random.default_rng(seed)
    out = []
    while len(out) < count:
        q, joint = rng.uniform(-np.pi, np.pi, 6), rng.integers(1, 5)
        grid = np.tile(q, (60, 1))
        grid[:, joint] = np.linspace(-np.pi, np.pi, 60)
        values = np.linalg.det(jacobian(arm, grid))
        changes = np.flatnonzero(values[:-1] * values[1:] < 0)
        if not len(changes):
            continue
        k = rng.choice(changes)
        low, high = grid[k, joint], grid[k + 1, joint]
        for _ in range(52):
            q[joint] = 0.5 * (low + high)
            if np.linalg.det(jacobian(arm, q)) * values[k] > 0:
                low = q[joint]
            else:
                high = q[joint]
        out.append(q)
    return np.array(out)


# The polynomial and its roots


@pytest.mark.parametrize(
    ("name", "joint"),
    [("jaco2", "q2"), ("piper", "q2"), ("hc10", "q2"), ("fanuc_crx10ia", "q2"), ("ufactory_xarm6", "q2")],
)
def test_noise_is_part_of_every_decision(name, joint):
    """One form alone, whose determinant spans 1e10 and more: without noise in "no root", 85 of 20 000 poses of JACO2 were
    lost; without fresh samples of the determinant, 410 of PiPER, 50 of HC10, 22 of CRX."""
    arm = arm_named(name)
    q = random_joints(3000)
    answers, _ = by_one_form(arm, FORM[joint], fk(arm, q))
    assert lost_by(answers, q).sum() <= 1


def test_structural_double_roots_are_sampled_again():
    """Every root of Puma's q2 is double; from the polynomial alone 123 of 20 000 poses lost a solution."""
    arm = arm_named("puma560")
    q = random_joints(3000)
    answers, flags = by_one_form(arm, FORM["q2"], fk(arm, q))
    asked = (flags & Flag.request) != 0
    assert 0.2 < asked.mean() < 0.8
    assert not lost_by(answers, q).any()


def test_quadruple_roots_are_complete():
    """Puma and KR 210 by q5: four solutions at every root, and doubts at every pose, but nothing is lost."""
    for name in ("puma560", "kuka_kr210_robond"):
        arm = arm_named(name)
        q = random_joints(300)
        answers, flags = by_one_form(arm, FORM["q5"], fk(arm, q))
        assert ((flags & Flag.third) != 0).mean() > 0.5
        assert lost_by(answers, q).mean() <= 0.01


def test_harmonics_that_are_not_there_count_as_noise():
    """A form whose determinant vanishes has nothing but noise, says so, and is not chosen for what its polish finds."""
    for name in ("ur5e", "puma560", "fanuc_crx10ia", "jaco2", "hc10"):
        arm = arm_named(name)
        reports = prepare(arm).native.reports
        vanishing = [form for form, report in enumerate(reports) if report.median_tail > 1e-3]
        assert vanishing
        assert all(reports[form].rank == -1 for form in vanishing)
        q = random_joints(20)
        _, flags = by_one_form(arm, vanishing[0], fk(arm, q))
        assert ((flags & Flag.noise) != 0).all()


def test_forms_that_nearly_vanish_are_not_preferred():
    """PiPER's q4 is one: its noise is a thousand times that of the form that is used first."""
    reports = prepare(arm_named("piper")).native.reports
    first = next(report for report in reports if report.rank == 0)
    assert first.median_tail < 1e-14
    assert reports[FORM["q4"]].median_tail > 100 * first.median_tail


def test_fewer_harmonics_are_seen_and_used():
    """KR 210 by q6 has the even ones up to 4, the arm with sixteen answers the even ones up to 8 by q3."""
    by_q6 = prepare(arm_named("kuka_kr210_robond")).native.reports[FORM["q6"]]
    assert by_q6.even
    assert by_q6.harmonics == 2
    by_q3 = prepare(arm_named("sixteen")).native.reports[FORM["q3"]]
    assert by_q3.even
    assert by_q3.harmonics == 4


@pytest.mark.parametrize("end", [0.618, 0.618 - np.pi])
def test_half_angles_at_their_ends(end):
    """Joint 4 of the loop where its half angle is 0 or infinite: the reduced matrix does not see the solution there, and
    three of four poses were lost by that form (and left to the next one, if the arm has it)."""
    for name, form, joint in (("random 0", "q3", 3), ("random 1", "q3", 3), ("ur5e", "q2", 2)):
        arm = arm_named(name)
        for off in (0.0, 1e-15, 1e-12, 1e-9, 1e-6, 1e-3):
            q = random_joints(100, 3)
            q[:, joint] = end + off
            q[50:, joint + 1] = np.pi - 1.118 - off  # that of joint 5 does no harm
            answers, _ = by_one_form(arm, FORM[form], fk(arm, q))
            assert not lost_by(answers, q).any(), (name, off)


def test_sixteen_answers():
    """All of them are found, and never more."""
    arm = arm_named("sixteen")
    q = random_joints(3000)
    answers = solve_general_6r(arm, fk(arm, q), mode="fast")
    assert answers.count.max() == 16
    assert not lost_by(answers.q, q).any()


# Null spaces


def test_two_null_vectors_are_split():
    """Spherical wrists: two solutions at every angle, split where joint 4 is common; and eigenvectors elsewhere."""
    for name in ("puma560", "abb_irb120", "kuka_kr210_robond"):
        arm = arm_named(name)
        q = random_joints(300)
        answers, flags = by_one_form(arm, FORM["q2"], fk(arm, q))
        assert ((flags & Flag.twins) != 0).mean() > 0.5
        assert not lost_by(answers, q).any()


@pytest.mark.parametrize("name", ["kuka_kr210_robond", "puma560", "fanuc_crx10ia", "hc10"])
def test_a_third_null_vector_sends_to_another_form(name):
    """Targets of right angles: without the third singular value a quarter of the regular solutions was lost."""
    arm = arm_named(name)
    q = np.random.default_rng(5).integers(-2, 3, (400, 6)) * np.pi / 2
    answers = solve_general_6r(arm, fk(arm, q), mode="fast")
    assert ((answers.flags & Flag.third) != 0).any() or ((answers.flags & Flag.third_form) != 0).any()
    regular = least_singular_values(arm, q) > 1e-3
    assert not lost_by(answers.q, q, SAME_SINGULAR)[regular].any()
    assert answers.valid.any(axis=1).all()


# Polish, acceptance, merging


def test_half_a_turn_is_not_a_solution():
    """R - R^T vanishes for half a turn as for none; answers are judged by the whole rotation here."""
    for name in ("puma560", "ur5e", "fanuc_crx10ia", "random 1"):
        arm = arm_named(name)
        T = fk(arm, random_joints(200))
        for axis in np.eye(3):
            turned = T.copy()
            turned[:, :3, :3] = T[:, :3, :3] @ from_rotation_vector(np.pi * axis)
            answers = solve_general_6r(arm, turned, mode="fast")
            off = fk(arm, answers.q[answers.valid]) - np.repeat(turned, answers.count, axis=0)
            assert np.abs(off).max(initial=0.0) < ACCURACY


@pytest.mark.parametrize("apart_by", [1e-2, 1e-3, 1e-4, 2e-5])
def test_two_solutions_that_have_nearly_met_are_both_found(apart_by):
    """Next to a stretched elbow the two are so far apart; merged too boldly, or with both starts on one side, one is lost."""
    for name, joint, stretched in (("ur5e", 2, 0.0), ("ufactory_xarm6", 2, None), ("random 0", None, None)):
        arm = arm_named(name)
        if stretched is None:
            q = singular_joints(arm, 40, 4)
            directions = np.linalg.svd(jacobian(arm, q))[2][:, -1]
            q = q + 0.5 * apart_by * directions
        else:
            q = random_joints(40)
            q[:, joint] = stretched + 0.5 * apart_by
        answers = solve_general_6r(arm, fk(arm, q))
        near = (apart(answers.q, q[:, None]) < 4 * apart_by).sum(axis=1)
        assert not lost_by(answers.q, q, SAME_SINGULAR).any(), name
        assert (near >= 2).mean() > 0.9, name


def test_a_fold_that_was_passed_by_newton():
    """CRX-10iA/L, 1e-5 rad from a fold: both starts of the first form came to rest in the middle of two solutions."""
    arm = arm_named("fanuc_crx10ia_l")
    q = np.array([2.014127196, 0.230344725, 1.532580658, 2.890187141, 3.097608904, -1.517777888])
    direction = np.linalg.svd(jacobian(arm, q))[2][-1]
    for off in np.linspace(-5e-6, 5e-6, 41):
        near = q + off * direction
        assert apart(solve_general_6r(arm, fk(arm, near)).q, near).min() < SAME_SINGULAR
        assert apart(solve_general_6r(arm, fk(arm, near), mode="fast").q, near).min() < SAME_SINGULAR


def test_more_than_sixteen_are_thinned_to_the_most_regular():
    """Four parallel axes: solutions form curves at every pose, of which sixteen members come back, and a doubt."""
    links = [link(0.2, 0.1, 0.3, 0.0)] * 3 + [link(0.0, 0.1, 0.2, 1.0)] * 3
    arm = arm_of(links, name="parallel")
    answers = solve_general_6r(arm, fk(arm, random_joints(20)))
    assert answers.count.max() <= 16
    assert answers.valid.any(axis=1).all()
    # stretched wrists: the solutions on other branches stay among the members of the curve
    arm = arm_named("puma560")
    q = random_joints(50)
    q[:, 4] = 0.0
    answers = solve_general_6r(arm, fk(arm, q))
    assert ((answers.flags & Flag.doubtful) != 0).all()
    regular = least_singular_values(arm, np.nan_to_num(answers.q)) > 1e-3
    assert ((regular & answers.valid).sum(axis=1) >= 2).mean() > 0.9


# The choice of forms, and the last resort


def test_the_choice_counts_work_not_time():
    """Two preparations of an arm, and preparations with other vectors, choose alike."""
    name = "fanuc_crx10ia"
    before = kernels.instruction_set()
    chosen = []
    for instructions in kernels.instruction_sets():
        kernels.use_instruction_set(instructions)
        arm = chain(name)
        copy = Chain(arm.name, arm.screws, arm.home, arm.limits, arm.joint_names)
        chosen.append(prepare(copy).remaining_joints)
    kernels.use_instruction_set(before)
    assert len(set(chosen)) == 1


def test_forms_with_the_target_on_the_left_serve_where_the_others_fail():
    """Spherical wrists have one good joint to eliminate towards; written the other way it makes a second form."""
    for name in ("puma560", "kuka_kr210_robond"):
        reports = prepare(arm_named(name)).native.reports
        good = [report for report in reports if report.rank >= 0 and report.flagged < 0.2]
        assert len(good) >= 2
        assert (
            good[-1].median_work < 150
        )  # 60 to 117, with the fewest numbers at once the most; the quadruple one takes 300
    arm = arm_named("puma560")
    q = random_joints(500)
    left = [k for k, report in enumerate(prepare(arm).native.reports) if k >= 6 and report.rank >= 0]
    answers, _ = by_one_form(arm, left[0], fk(arm, q))
    assert not lost_by(answers, q).any()


@pytest.mark.parametrize("name", ["fanuc_crx10ia", "hc10", "kuka_kr210_robond", "jaco2", "piper", "sixteen", "ur5e"])
def test_targets_nearby_help_where_every_form_fails(name):
    """Right angles: up to a tenth of the targets was left empty before neighbours were solved and followed back."""
    arm = arm_named(name)
    helped = 0
    for step in (np.pi / 2, np.pi / 4):
        for disturbance in (0.0, 1e-12, 1e-8, 1e-4):
            rng = np.random.default_rng(6)
            q = rng.integers(-4, 5, (50, 6)) * step + disturbance * rng.normal(size=(50, 6))
            answers = solve_general_6r(arm, fk(arm, q), mode="fast")
            assert answers.valid.any(axis=1).all()
            regular = least_singular_values(arm, q) > 1e-3
            assert not lost_by(answers.q, q, SAME_SINGULAR)[regular].any()
            helped += ((answers.flags & Flag.last_resort) != 0).sum()
    assert helped > 0


def hostile_arm(seed, *, slide=-1):
    """Coincident, parallel, zero-length and nearly equal axes, 1e-12 to 1e-3 from each other."""
    rng = np.random.default_rng(seed)
    near = 10.0 ** rng.uniform(-12, -3)
    links = []
    for kind in rng.integers(0, 5, 6):
        theta, d = rng.choice([0, np.pi / 2, 0.7]), rng.choice([0, 0, 0.2])
        a, alpha = rng.choice([0, 0, 0.3, 0.5]), rng.choice([0, np.pi / 2, -np.pi / 2, np.pi])
        if kind == 0:
            d = a = alpha = 0.0
        elif kind == 1:
            alpha += near
        elif kind == 2:
            a, alpha = rng.uniform(-0.5, 0.5), rng.uniform(-np.pi, np.pi)
        elif kind == 3:
            a += near
        links.append(link(theta, d, a, alpha))
    arm = arm_of(links, name=f"hostile {seed}")
    if slide < 0:
        return arm
    screws = arm.screws.copy()
    screws[slide] = [*screws[slide, 3:], 0, 0, 0]
    return Chain(arm.name, screws, arm.home, [(-1.0, 1.0)] * 6, arm.joint_names)


def test_no_reachable_target_of_a_degenerate_arm_is_left_empty():
    """166 of 12 000 were: lengths of 1e-8 m that stood for 1, and valleys too long for damped steps."""
    for seed in (2, 81, 95, 130, 137, 139, 227, 275, 334, 352, 1188, 1376, 2018, 2108, *range(60)):
        arm = hostile_arm(seed)
        q = random_joints(6, seed)
        T = fk(arm, q)
        answers = solve_general_6r(arm, T)
        assert answers.valid.any(axis=1).all(), seed
        off = fk(arm, answers.q[answers.valid]) - np.repeat(T, answers.count, axis=0)
        assert np.abs(off).max() < ACCURACY
        regular = least_singular_values(arm, q) > 1e-3
        lost = lost_by(answers.q, q, SAME_SINGULAR)
        assert ((answers.flags[lost & regular] & Flag.doubtful) != 0).all(), seed


def test_a_form_that_nearly_vanishes_cannot_say_that_there_is_nothing():
    """An arm that all but moves in a plane: the only root at a singular target was lifted off zero, and no flag was set."""
    arm = hostile_arm(47, slide=5)
    assert max(report.median_tail for report in prepare(arm).native.reports if report.rank == 0) > 1e-13
    q = np.tile(np.array([-1, 1, -2, -2, 2, 0]) * np.pi / 2, (402, 1))
    q[:, 5] = [*np.linspace(0.85, 1.0, 400), 0.9088093656219374, 0.966442323400732]
    q[1::2, 4] *= -1
    assert solve_general_6r(arm, fk(arm, q)).valid.any(axis=1).all()


# Calibrated arms, folds and boundaries


@pytest.mark.parametrize("name", ["kuka_kr210_robond", "puma560"])
@pytest.mark.parametrize("size", [1e-9, 1e-6, 1e-5, 1e-4, 1e-3])
def test_calibrated_spherical_wrists_lose_nothing(name, size):
    """Nearly quadruple roots and nearly vanishing forms everywhere."""
    arm = displaced(name, size, 5)
    q = random_joints(1500)
    for mode in ("fast", "checked"):
        answers = solve_general_6r(arm, fk(arm, q), mode=mode)
        assert not lost_by(answers.q, q, SAME_SINGULAR).any()
        assert np.nanmax(answers.position_error) < ACCURACY


@pytest.mark.parametrize(
    "name", ["random 0", "random 3", "jaco2", "fanuc_crx10ia", "ufactory_xarm6", "hc10", "sixteen"]
)
def test_a_micrometre_inside_the_boundary_is_found(name):
    """At a singular pose the reachable set has an edge; a micrometre (and a microradian) to its inner side two solutions are
    about a milliradian from the singular one, and as far to its outer side there are none."""
    arm = arm_named(name)
    q = singular_joints(arm, 60, 7)
    J = jacobian(arm, q)
    U, s, V = np.linalg.svd(J)
    across, along = U[:, :, -1], V[:, -1]
    T = fk(arm, q)
    # the edge bends towards the side where the poses of q +- h along lie
    h = 1e-3
    bend = 0.0
    for side in (h, -h):
        ahead = fk(arm, q + side * along)
        change = np.concatenate([ahead[:, :3, 3] - T[:, :3, 3], _turn(T, ahead)], axis=1)
        bend = bend + np.einsum("ki,ki->k", across, change) / h**2
    clear = (np.abs(bend) > 0.02) & (s[:, -2] > 0.03)
    assert clear.sum() > 10
    for side, wanted in ((1.0, 2), (-1.0, 0)):
        twist = side * np.sign(bend)[:, None] * 1e-6 * across
        moved = T.copy()
        moved[:, :3, 3] += twist[:, :3]
        moved[:, :3, :3] = from_rotation_vector(twist[:, 3:]) @ T[:, :3, :3]
        answers = solve_general_6r(arm, moved)
        # along the fold: q + x with x^2 bend / 2 = 1e-6
        reach = 3.0 * np.sqrt(2e-6 / np.maximum(np.abs(bend), 1e-3)) + 1e-3
        near = (apart(answers.q, q[:, None]) < reach[:, None]).sum(axis=1)
        assert (near[clear] == wanted).all(), (side, near[clear])


def _turn(T, ahead):
    """Small rotations from T to `ahead`, in the base frame."""
    R = ahead[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2)
    return 0.5 * np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)


@pytest.mark.parametrize(
    "name", ["fanuc_crx10ia", "jaco2", "piper", "puma560", "kuka_kr210_robond", "ur5e", "random 0"]
)
def test_what_is_lost_next_to_singular_poses_is_said(name):
    """From any singularity of the arm, at any small distance: an answer, and the joints themselves or a doubt."""
    arm = arm_named(name)
    singular = singular_joints(arm, 40, 1)
    for distance in (0.0, 1e-12, 1e-8, 1e-6, 1e-4, 1e-2):
        q = singular + distance * np.random.default_rng(2).normal(size=singular.shape)
        answers = solve_general_6r(arm, fk(arm, q))
        assert answers.valid.any(axis=1).all()
        assert np.nanmax(answers.position_error) < ACCURACY
        lost = lost_by(answers.q, q, SAME_SINGULAR)
        assert ((answers.flags[lost] & Flag.doubtful) != 0).all(), distance
        if distance >= 1e-5:
            assert not lost.any()
