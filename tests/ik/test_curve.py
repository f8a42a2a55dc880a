"""Curves of solutions: on them, closed, all of them, families at singular poses, limits, the nearest point, bad input."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from pieper.errors import ArrayError
from pieper.ik.curve import RESIDUAL, RESIDUAL_OF_FAMILIES, SolutionCurve, crossing, follow, limit_margins
from pieper.ik.target import components, ignore_orientation, pose, position_and_axis
from pieper.kinematics.fk import fk
from pieper.model.chain import Chain
from tests.reference import product_of_exponentials as reference
from tests.robots import ROBOTS, chain

SEVEN = tuple(robot.name for robot in ROBOTS if robot.dof == 7)
SIX = tuple(robot.name for robot in ROBOTS if robot.dof == 6)
STEP = 0.1
ON = 3.0 * RESIDUAL  # rows and the norms of their errors differ by less
PLACE = (
    2e-5  # rad: places come from a cubic through the samples; half a sample apart it is off by h^4 / 384 times a few
)
LIMIT = 1e-9  # rad: how well an end of an interval has to be known
REGULAR = [0.3, -0.6, 0.4, -1.1, 0.5, 0.9, -0.7]


def curve_of(name, q=REGULAR, **options):
    arm = chain(name)
    curve = follow(arm, fk(arm, q), q, **options)
    assert curve is not None
    return curve


def middle_of(arm):
    """The middle of the joint ranges, 0 for joints without limits."""
    return np.where(np.isfinite(arm.limits), arm.limits, 0.0).mean(axis=1)


def errors(curve, q):
    """Largest error of poses by the textbook product of exponentials, for whole poses."""
    T = curve.target.T_base_tip
    return max(np.abs(reference.fk(curve.chain, row) - T).max() for row in q)


@pytest.mark.parametrize("name", SEVEN)
def test_self_motion_closes_and_every_point_meets_the_pose(name):
    for seed in range(3):
        q = np.random.default_rng(seed).uniform(-2.5, 2.5, 7)
        curve = curve_of(name, q)
        assert curve.closed
        assert curve.ends == "closed"
        assert errors(curve, curve.q[:: len(curve.q) // 20]) < ON
        turns = (curve.q[-1] - curve.q[0]) / (2.0 * np.pi)
        assert np.abs(turns - turns.round()).max() < 1e-9
        assert np.linalg.norm(np.diff(curve.q, axis=0), axis=1).max() <= STEP * 1.05
        assert np.allclose(np.linalg.norm(curve.tangents, axis=1), 1.0)
        J = chain(name).native.jacobian(curve.q)
        assert np.abs(J @ curve.tangents[..., None]).max() < 1e-6
        # the tangent is the derivative, so neighbours are where it leads
        ahead = np.diff(curve.q, axis=0) - np.diff(curve.s)[:, None] * 0.5 * (curve.tangents[1:] + curve.tangents[:-1])
        assert np.abs(ahead).max() < 2e-3


@pytest.mark.parametrize("name", SEVEN)
def test_a_closed_curve_is_the_same_from_any_of_its_points(name):
    curve = curve_of(name)
    for s in np.linspace(0.0, curve.length, 4)[1:-1]:
        again = follow(curve.chain, curve.target, curve.at(s))
        assert again is not None
        assert again.closed
        assert again.length == pytest.approx(curve.length, rel=1e-5)
        assert curve.contains(again.q).all()
        assert again.contains(curve.q).all()


@pytest.mark.parametrize("name", SEVEN)
def test_places_along_a_curve(name):
    curve = curve_of(name)
    dense = np.linspace(0.0, curve.length, 4001)
    q = curve.at(dense)
    assert errors(curve, q[::500]) < ON
    chords = np.linalg.norm(np.diff(q, axis=0), axis=1)
    assert chords.sum() == pytest.approx(curve.length, rel=1e-5)
    assert np.abs(chords - dense[1]).max() < PLACE
    assert np.allclose(curve.at(curve.length + 0.3) - curve.at(0.3), curve.q[-1] - curve.q[0], atol=1e-9)
    assert curve.at(np.zeros((2, 1, 3))).shape == (2, 1, 3, 7)
    assert np.abs(curve.place(q[5:4000:399]) - dense[5:4000:399]).max() < 1e-9
    assert np.isnan(curve.place(q[:3] + 0.01)).all()
    assert curve.contains(q[::40] + 2.0 * np.pi).all()


def test_direction_says_which_way_to_go():
    curve = curve_of("franka_panda")
    back = curve_of("franka_panda", direction=-curve.free_direction)
    assert back.free_direction @ curve.free_direction == pytest.approx(-1.0)
    assert back.length == pytest.approx(curve.length, rel=1e-6)


# Families of six joints at singular poses.


@pytest.mark.parametrize("name", ["kuka_kr210_robond", "abb_irb120", "abb_irb2400", "puma560", "yaskawa_mh12"])
@pytest.mark.parametrize("turned", [0.0, np.pi])
def test_a_stretched_wrist_turns_joints_4_and_6_against_each_other(name, turned):
    arm = chain(name)
    w = arm.screws[:, 3:]
    q = np.array([0.1, 0.2, 0.3, 0.4, 0.0, 0.6])
    # axes 4 and 6 are parallel at some angle of joint 5
    across = np.cross(w[4], w[3])
    q[4] = np.arctan2(w[4] @ np.cross(w[5], w[3]), w[5] @ w[3] - (w[5] @ w[4]) * (w[3] @ w[4])) + turned
    assert np.linalg.norm(across) > 0.9
    curve = follow(arm, fk(arm, q), q)
    assert curve is not None
    assert curve.closed
    assert curve.length == pytest.approx(2.0 * np.pi * np.sqrt(2.0), rel=1e-9)
    a, b = arm.joint_names[3], arm.joint_names[5]
    assert curve.coupling in (f"{a} + {b} = const", f"{a} - {b} = const")
    assert np.ptp(curve.q[:, [0, 1, 2, 4]], axis=0).max() < 1e-9
    assert errors(curve, curve.q[::10]) < ON


@pytest.mark.parametrize("name", ["ur3e", "ur5e", "ur10"])
@pytest.mark.parametrize("wrist", [0.0, np.pi])
def test_parallel_axes_6_and_2_of_a_universal_robot_give_a_curve(name, wrist):
    # at pi the rounded right angles of the description leave 6e-10
    q = np.array([0.1, -1.2, 1.4, -1.7, wrist, 0.3])
    curve = follow(chain(name), fk(chain(name), q), q)
    assert curve is not None
    assert curve.closed
    assert np.ptp(curve.q[:, [0, 4]], axis=0).max() < 1e-6
    turned = curve.q[:, 1:4].sum(axis=1)
    assert min(np.ptp(turned + curve.q[:, 5]), np.ptp(turned - curve.q[:, 5])) < 1e-8
    assert errors(curve, curve.q[::10]) < 2.0 * RESIDUAL_OF_FAMILIES


@pytest.mark.parametrize("name", ["kuka_kr210_robond", "abb_irb2400", "abb_irb6640", "yaskawa_mh12"])
def test_a_wrist_over_axis_1_turns_joint_1_freely(name):
    arm = chain(name)
    w, v = arm.screws[:, 3:], arm.screws[:, :3]
    centre = np.linalg.lstsq(
        np.concatenate([np.eye(3) - np.outer(a, a) for a in w[3:]]),
        np.concatenate([np.cross(a, b) for a, b in zip(w[3:], v[3:], strict=True)]),
        rcond=None,
    )[0]

    def off(q2):
        T = reference.exponential(arm.screws[1], q2) @ reference.exponential(arm.screws[2], 0.4)
        return (T @ [*centre, 1.0])[0]

    grid = np.linspace(-3.0, 3.0, 60)
    signs = np.sign([off(x) for x in grid])
    i = int(np.flatnonzero(signs[1:] != signs[:-1])[0])
    q = np.array([0.1, brentq(off, grid[i], grid[i + 1], xtol=1e-15), 0.4, 0.5, 0.6, 0.7])
    curve = follow(arm, fk(arm, q), q)
    assert curve is not None
    assert curve.closed
    assert abs(curve.q[-1, 0] - curve.q[0, 0]) == pytest.approx(2.0 * np.pi)
    assert np.ptp(curve.q[:, [1, 2]], axis=0).max() < 1e-9
    assert errors(curve, curve.q[::10]) < ON


@pytest.mark.parametrize("name", SIX)
def test_regular_solutions_are_isolated(name):
    q = np.array([0.3, -0.8, 0.7, 0.5, 0.9, -0.4])
    assert follow(chain(name), fk(chain(name), q), q) is None


@pytest.mark.parametrize("distance", [1e-3, 1e-5, 1e-7, 1e-8])
def test_solutions_beside_a_stretched_wrist_are_isolated(distance):
    q = np.array([0.1, 0.2, 0.3, 0.4, distance, 0.6])
    assert follow(chain("kuka_kr210_robond"), fk(chain("kuka_kr210_robond"), q), q) is None


def test_a_double_solution_is_isolated():
    # a stretched elbow: both elbow branches coincide, and the null vector leads nowhere
    q = np.array([0.1, -1.2, 0.0, -1.7, 1.0, 0.3])
    assert follow(chain("ur5e"), fk(chain("ur5e"), q), q) is None


# Less than a pose.


@pytest.mark.parametrize("name", ["kuka_kr210_robond", "fanuc_crx10ia", "ur5e"])
def test_a_position_and_an_axis_leave_six_joints_a_curve(name):
    arm = chain(name)
    q = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    T = reference.fk(arm, q)
    tool = np.array([0.6, 0.0, 0.8])
    curve = follow(arm, position_and_axis(T[:3, 3], T[:3, :3] @ tool, axis_tip=tool), q)
    assert curve is not None
    assert curve.closed
    for row in curve.q[:: len(curve.q) // 15]:
        T_row = reference.fk(arm, row)
        assert np.abs(T_row[:3, 3] - T[:3, 3]).max() < ON
        assert np.abs(T_row[:3, :3] @ tool - T[:3, :3] @ tool).max() < ON
    assert np.ptp([reference.fk(arm, row)[0, 0] for row in curve.q]) > 0.1  # the tip does turn


def test_a_free_last_axis_is_named():
    arm = chain("ur5e")
    q = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    T = fk(arm, q)
    curve = follow(arm, position_and_axis(T[:3, 3], T[:3, 2]), q)
    assert curve is not None
    assert curve.coupling == "wrist_3_joint free"
    assert curve.length == pytest.approx(2.0 * np.pi)


@pytest.mark.parametrize("axes", ["base", "tool"])
@pytest.mark.parametrize("rows", ["x y z rx ry", "y z rx ry rz", "x y z ry rz"])
def test_five_components_leave_six_joints_a_curve(rows, axes):
    from pieper.spatial.rotation import as_rotation_vector

    arm = chain("fanuc_crx10ia")
    q = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    T = reference.fk(arm, q)
    curve = follow(arm, components(T, rows, position_axes=axes, rotation_axes=axes), q)
    assert curve is not None
    assert len(curve.q) > 20
    wanted = [("x", "y", "z", "rx", "ry", "rz").index(row) for row in rows.split()]
    A = T[:3, :3] if axes == "tool" else np.eye(3)
    for row in curve.q[:: len(curve.q) // 15]:
        now = reference.fk(arm, row)
        left = np.concatenate([A.T @ (T[:3, 3] - now[:3, 3]), A.T @ as_rotation_vector(T[:3, :3] @ now[:3, :3].T)])
        assert np.abs(left[wanted]).max() < ON
        rest = np.delete(left, wanted)
    assert np.abs(rest).max() >= 0.0


def test_a_position_leaves_four_joints_a_curve():
    arm = chain("ur5e").lock(wrist_2_joint=0.3, wrist_3_joint=0.1)
    q = np.array([0.1, -0.9, 1.1, 0.4])
    curve = follow(arm, ignore_orientation(fk(arm, q)[:3, 3]), q)
    assert curve is not None
    assert curve.closed


# Where curves cross, and where they are none.


@pytest.mark.parametrize("name", ["kuka_iiwa14", "franka_panda"])
def test_curves_go_straight_on_where_others_cross(name):
    # joint 2 at 0 aligns axes 1 and 3, which then turn against each other; other curves cross that one twice
    q = np.array([0.1, 0.0, 0.3, -0.9, 0.4, 0.5, 0.6])
    curve = curve_of(name, q)
    names = curve.chain.joint_names
    assert curve.closed
    assert curve.coupling == f"{names[0]} + {names[2]} = const"
    assert curve.length == pytest.approx(2.0 * np.pi * np.sqrt(2.0), rel=1e-6)
    assert len(curve.branch_points) == 2
    others = crossing(curve)
    assert len(others) == 4
    assert errors(curve, others) < ON
    strangers = others[~curve.contains(others)]
    assert len(strangers) == 2
    for start in strangers:
        other = follow(curve.chain, curve.target, start)
        assert other is not None
        assert other.closed
        assert len(other.branch_points) > 0


@pytest.mark.parametrize("distance", [1e-2, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("name", ["kuka_iiwa14", "franka_panda", "kinova_gen3_7dof"])
def test_curves_that_nearly_cross_are_not_mixed_up(name, distance):
    for joint in (1, 5):
        q = np.array([0.1, 0.4, 0.3, -0.9, 0.4, 0.5, 0.6])
        q[joint] = distance
        curve = curve_of(name, q)
        assert curve.closed
        for s in (0.3, 0.7):
            again = follow(curve.chain, curve.target, curve.at(s * curve.length), step=0.03)
            assert again is not None
            assert again.closed
            assert again.length == pytest.approx(curve.length, rel=1e-4)
            assert curve.contains(again.q[::7], tolerance=1e-5).all()


def test_a_straight_arm_turns_joints_3_and_5():
    curve = curve_of("kuka_iiwa14", [0.1, 0.2, 0.3, 0.0, 0.4, 0.5, 0.6])
    assert curve.closed
    assert curve.coupling == "lbr_A3 + lbr_A5 = const"
    assert errors(curve, curve.q[::10]) < ON


@pytest.mark.parametrize("name", ["kuka_iiwa14", "franka_panda", "kuka_iiwa14_ros_industrial"])
def test_surfaces_are_refused(name):
    with pytest.raises(ArrayError, match="form a surface, not a curve"):
        follow(chain(name), fk(chain(name), np.zeros(7)), np.zeros(7))


@pytest.mark.parametrize("name", SEVEN)
def test_following_is_bounded_at_right_angles(name):
    arm = chain(name)
    rng = np.random.default_rng(4)
    for _ in range(6):
        q = rng.integers(-1, 3, 7) * (np.pi / 2)
        try:
            curve = follow(arm, fk(arm, q), q, max_steps=400)
        except ArrayError:
            continue  # a surface
        if curve is not None:
            assert len(curve.q) <= 801
            assert errors(curve, curve.q[:: max(1, len(curve.q) // 10)]) < 2.0 * RESIDUAL_OF_FAMILIES


def test_steps_are_counted():
    curve = curve_of("franka_panda", max_steps=5)
    assert not curve.closed
    assert curve.ends == "5 steps"
    assert len(curve.q) == 11
    start, end = curve.at([0.0, curve.length])
    assert np.abs(start - curve.q[0]).max() < 1e-9
    assert np.abs(end - curve.q[-1]).max() < 1e-9


# Joint limits.


@pytest.mark.parametrize("name", SEVEN)
def test_intervals_within_limits(name):
    arm = chain(name)
    middle = middle_of(arm)
    some = 0
    for seed in range(4):
        q = middle + np.random.default_rng(seed).uniform(-0.8, 0.8, 7)
        curve = curve_of(name, q)
        s = np.linspace(0.0, curve.length, 3001)
        inside = (limit_margins(arm, curve.at(s)) >= 0.0).all(axis=-1)
        said = np.zeros_like(inside)
        for start, end in curve.intervals:
            assert start < end
            said |= ((s >= start) & (s <= end)) | (s + curve.length <= end)
            if end - start < curve.length:
                margins = limit_margins(arm, curve.at([start, end])).min(axis=-1)
                assert np.abs(margins).max() < LIMIT
        assert (inside == said).all()
        assert curve.within_limits.any() == inside.any() or not inside.any()
        some += len(curve.intervals)
    assert some > 0


def test_limits_hold_for_copies_by_whole_turns():
    arm = chain("kuka_iiwa14")
    curve = curve_of("kuka_iiwa14", [0.1, 0.6, 0.2, -1.2, 0.3, 0.9, 0.4])
    far = follow(arm, curve.target, curve.q[0] + 2.0 * np.pi * np.array([1, 0, -1, 0, 0, 0, 2]))
    assert far is not None
    assert np.allclose(np.sort(np.diff(far.intervals)), np.sort(np.diff(curve.intervals)), atol=1e-6)


def test_sliding_joints_end_at_their_limits():
    slide = Chain(
        "two slides along one line",
        [[1.0, 0, 0, 0, 0, 0], [1.0, 0, 0, 0, 0, 0]],
        np.eye(4),
        [[-1.0, 1.0], [-0.5, 0.5]],
        ["a", "b"],
    )
    curve = follow(slide, components(np.eye(4), "x y z"), [0.0, 0.0])
    assert curve is not None
    assert not curve.closed
    assert curve.coupling == "a + b = const"
    assert curve.ends == "beyond the limit of b"
    assert np.allclose(curve.at(curve.intervals[0])[:, 1], curve.q[[0, -1], 1].clip(-0.5, 0.5), atol=LIMIT)
    assert np.isfinite(curve.nearest([0.9, 0.0], within_limits=True).distance)


# The nearest point.


@pytest.mark.parametrize("name", SEVEN)
@pytest.mark.parametrize("within_limits", [False, True])
def test_the_nearest_point_is_that_of_the_curve(name, within_limits):
    arm = chain(name)
    lower, upper = arm.limits.T
    middle = middle_of(arm)
    rng = np.random.default_rng(8)
    found = 0
    for _ in range(3):
        curve = curve_of(name, middle + rng.uniform(-0.7, 0.7, 7))
        wanted = middle + rng.uniform(-1.5, 1.5, 7)
        point = curve.nearest(wanted, within_limits=within_limits)

        def distance(s, curve=curve, wanted=wanted):
            q = curve.at(s)
            copies = q + 2.0 * np.pi * np.arange(-3, 4)[:, None, None]
            apart = np.abs(copies - wanted)
            if within_limits:
                apart[(copies < lower - 1e-9) | (copies > upper + 1e-9)] = np.inf
            return np.linalg.norm(apart.min(axis=0), axis=-1)

        s = np.linspace(0.0, curve.length, 2001)
        d = distance(s)
        if not np.isfinite(d).any():
            assert np.isinf(point.distance) or (curve.intervals[:, 1] - curve.intervals[:, 0]).max() < 2.0 * s[1]
            continue
        found += 1
        assert point.distance <= d.min() + 1e-12
        i = int(np.argmin(d))
        if not within_limits:
            near = minimize_scalar(
                lambda x, distance=distance: float(distance(np.array([x]))[0]),
                bounds=(s[i] - s[1], s[i] + s[1]) if 0 < i < len(s) - 1 else (s[i], s[i] + 1e-9),
                method="bounded",
                options={"xatol": 1e-12},
            ).fun
            assert point.distance == pytest.approx(near, abs=1e-6)
        else:
            assert (point.q >= lower).all()
            assert (point.q <= upper).all()
        assert np.linalg.norm(point.q - wanted) == pytest.approx(point.distance, abs=1e-9)
        assert errors(curve, [point.q]) < ON
        assert curve.contains(point.q)
    assert found or within_limits


def test_a_point_of_the_curve_is_its_own_nearest():
    curve = curve_of("kinova_gen3_7dof")
    for s in (0.0, 1.234, curve.length - 1e-3):
        q = curve.at(s)
        point = curve.nearest(q + 2.0 * np.pi)
        assert point.distance < 1e-8
        assert np.abs(point.q - q - 2.0 * np.pi).max() < 1e-8
        assert min(abs(point.s - s), abs(point.s - s - curve.length)) < 1e-7


def test_no_point_within_limits():
    arm = chain("franka_panda")
    q = np.array([0.3, -0.6, 0.4, 1.1, 0.5, -0.9, -0.7])  # joint 4 is never positive on a Panda
    curve = follow(arm, fk(arm, q), q)
    assert curve is not None
    if len(curve.intervals) == 0:
        point = curve.nearest(q, within_limits=True)
        assert np.isinf(point.distance)
        assert np.isnan(point.q).all()


# What is refused.


def test_bad_input():
    arm = chain("franka_panda")
    T = fk(arm, REGULAR)
    curve = follow(arm, pose(T), REGULAR)
    assert isinstance(curve, SolutionCurve)
    assert "closed, length" in repr(curve)
    shifted = T.copy()
    shifted[0, 3] += 0.1
    with pytest.raises(ArrayError, match=r"misses by 0\.1"):
        follow(arm, shifted, REGULAR)
    with pytest.raises(ArrayError, match="a curve is that of one target"):
        follow(arm, np.stack([T, T]), REGULAR)
    with pytest.raises(ArrayError, match=r"q must have shape \(7,\)"):
        follow(arm, T, [REGULAR])
    with pytest.raises(ArrayError, match="q must be finite"):
        follow(arm, T, [np.nan] * 7)
    with pytest.raises(ArrayError, match=r"3 rows for 7 joints .* a set of 4 dimensions"):
        follow(arm, ignore_orientation(T[:3, 3]), REGULAR)
    with pytest.raises(ArrayError, match="step must be positive"):
        follow(arm, T, REGULAR, step=0.0)
    with pytest.raises(ArrayError, match=r"s must be finite, got (nan|inf)"):
        curve.at(np.nan)
    with pytest.raises(ArrayError, match=r"q must have shape \(7,\)"):
        curve.nearest([REGULAR])
    short = follow(arm, T, REGULAR, max_steps=2)
    assert short is not None
    with pytest.raises(ArrayError, match="the ends of this curve"):
        short.at(short.length + 0.1)
    turned = T.copy()
    turned[:3, :3] = T[:3, :3] @ np.diag([1.0, -1.0, -1.0])  # half a turn away, where antisymmetric parts vanish
    with pytest.raises(ArrayError, match="q must meet the target"):
        follow(arm, turned, REGULAR)
    six = chain("ur5e")
    T = fk(six, np.zeros(6))
    with pytest.raises(ArrayError, match="q must meet the target"):
        follow(six, position_and_axis(T[:3, 3], -T[:3, 2]), np.zeros(6))
