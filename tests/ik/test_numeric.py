"""The numeric solver: arms whose answers are known by hand, seeds, several answers, targets out of reach, bad input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from pieper.errors import ArrayError
from pieper.ik import target
from pieper.ik.numeric import solve_numeric
from pieper.ik.solutions import Status
from pieper.kinematics.fk import fk
from pieper.model.chain import Chain
from pieper.spatial import pose, rotation
from tests.reference import product_of_exponentials as textbook
from tests.robots import chain

GOLDEN = Path(__file__).parents[1] / "golden"
TOLERANCE = 1e-9  # [m, rad]: the default of the solver
RESTED = 1e-6  # [m]: how well the nearest pose is found; the solver stops once a step gains 1e-10 of the squared error

T_SAMPLE = fk(chain("ur5e"), [0.1, -1.2, 1.4, -1.7, -1.5, 0.3])


def planar(*links, limits=(-3.0, 3.0)):
    """Joints about z, links along x."""
    places = np.concatenate([[0.0], np.cumsum(links)])
    screws = [[0.0, -x, 0.0, 0.0, 0.0, 1.0] for x in places[:-1]]
    home = np.eye(4)
    home[0, 3] = places[-1]
    n = len(links)
    return Chain("planar", screws, home, [limits] * n, [f"j{i}" for i in range(n)])


def gantry():
    """Three slides along x, y, z with different limits."""
    screws = np.hstack([np.eye(3), np.zeros((3, 3))])
    return Chain("gantry", screws, np.eye(4), [[-1.0, 1.0], [0.0, 2.0], [-0.5, np.inf]], ["x", "y", "z"])


def at(x, y, z=0.0):
    return pose.from_position_rotation([x, y, z], np.eye(3))


# --- known by hand


def test_planar_two_links_both_elbows():
    arm = planar(1.0, 0.5)
    answers = solve_numeric(arm, target.ignore_orientation([1.0, 0.6, 0.0]), count=2)
    assert answers.valid.all()
    cosine = (1.0 + 0.36 - 1.0 - 0.25) / (2 * 1.0 * 0.5)
    elbows = np.sort(answers.q[:, 1])
    np.testing.assert_allclose(elbows, [-np.arccos(cosine), np.arccos(cosine)], atol=1e-8)
    assert not answers.complete


def test_gantry_is_exact():
    answers = solve_numeric(gantry(), at(0.3, 1.9, 7.0))
    np.testing.assert_allclose(answers.q[0], [0.3, 1.9, 7.0], atol=1e-9)
    assert answers.reason.startswith("reached")


def test_slide_and_turn():
    screws = [[0, 0, 0, 0, 0, 1], [1, 0, 0, 0, 0, 0]]
    arm = Chain("polar", screws, np.eye(4), [[-np.inf, np.inf], [0.2, 2.0]], ["turn", "slide"])
    answers = solve_numeric(arm, target.ignore_orientation([-0.6, 0.8, 0.0]))
    np.testing.assert_allclose(answers.q[0], [np.arctan2(0.8, -0.6), 1.0], atol=1e-9)


def test_mimic_joints():
    free = planar(1.0, 0.7, 0.4)
    coupling = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, -0.5]])  # the third axis turns back half as far as the second
    arm = Chain("mimic", free.screws, free.home, [[-3.0, 3.0]] * 2, ["a", "b"], coupling=coupling)
    q = np.array([0.4, 1.1])
    answers = solve_numeric(arm, target.ignore_orientation(fk(arm, q)[:3, 3]), count=2)
    assert answers.valid.any()
    for found in answers.q[answers.valid]:
        assert np.linalg.norm((textbook.fk(arm, found) - fk(arm, q))[:3, 3]) < TOLERANCE
    assert np.abs(answers.q[answers.valid] - q).max(axis=1).min() < 1e-7


def test_b16_figure_2():
    """Five joints and a printed pose: both published solutions, to the last printed digit."""
    figure = yaml.safe_load((GOLDEN / "mh12_seed.yaml").read_text())["figure_2"]
    T = pose.from_position_rotation(
        figure["printed_position"], rotation.from_quaternion(figure["printed_quaternion_xyzw"])
    )
    arm = chain("mh12-report")
    answers = solve_numeric(arm, T, position_tolerance=1e-6, rotation_tolerance=1e-6, count=4)
    assert answers.within_limits[answers.valid].all()
    for published in figure["solutions_seed_constants"]:
        away = np.abs(answers.q[answers.valid] - published["theta"]).max(axis=1)
        assert away.min() < 2e-6
    assert not answers.exact.any()  # a printed pose is met to its digits only
    residual = np.hypot(answers.position_error, answers.rotation_error)[answers.valid]
    assert residual.min() == pytest.approx(5.3e-7, abs=3e-7)


# --- out of reach


def test_out_of_reach_by_hand():
    answers = solve_numeric(planar(1.0, 0.5), target.ignore_orientation([0.0, 3.0, 0.0]))
    assert answers.status == Status.unreachable
    assert not answers.valid.any()
    assert np.isnan(answers.q).all()
    assert answers.nearest.position_error == pytest.approx(1.5, abs=RESTED)
    assert answers.nearest.out_of_reach == pytest.approx(1.5, abs=RESTED)
    np.testing.assert_allclose(answers.nearest.q, [np.pi / 2, 0.0], atol=1e-3)
    assert answers.reason == "out of reach by 1.5 m; the nearest pose found leaves 1.5 m"


def test_too_near_the_base():
    answers = solve_numeric(planar(1.0, 0.5, limits=(-4.0, 4.0)), target.ignore_orientation([0.2, 0.0, 0.0]))
    assert answers.nearest.out_of_reach == pytest.approx(0.3, abs=RESTED)


def test_limits_bound_the_reach():
    answers = solve_numeric(gantry(), at(2.0, -0.5, -0.6))
    np.testing.assert_allclose(answers.nearest.q, [1.0, 0.0, -0.5], atol=1e-9)
    assert answers.nearest.position_error == pytest.approx(np.sqrt(1.0 + 0.25 + 0.01), abs=1e-9)


def test_orientation_out_of_reach_is_told_apart():
    T = at(0.5, 1.0)
    T[:3, :3] = rotation.from_rpy([0.4, 0.0, 0.0])
    answers = solve_numeric(gantry(), T)
    assert answers.nearest.position_error == pytest.approx(0.5, abs=1e-9) or answers.nearest.out_of_reach == 0.0
    assert answers.nearest.rotation_error == pytest.approx(0.4, abs=1e-9)
    assert "within reach, but not with this orientation" in answers.reason


def test_reachable_and_not_in_one_batch():
    far = T_SAMPLE.copy()
    far[:3, 3] *= 10.0
    answers = solve_numeric(chain("ur5e"), np.stack([T_SAMPLE, far, T_SAMPLE]))
    assert answers.status.tolist() == [0, 1, 0]
    assert answers.reached.tolist() == [True, False, True]
    assert answers.count.tolist() == [1, 0, 1]
    np.testing.assert_array_equal(np.isnan(answers.nearest.q).all(axis=1), [True, False, True])
    assert [r.split(":")[0].split(" by")[0] for r in answers.reasons] == ["reached", "out of reach", "reached"]
    assert str(answers) == "2 of 3 targets reached"
    with pytest.raises(ArrayError, match="use reasons"):
        _ = answers.reason


@pytest.mark.parametrize("far", [1e9, 1e100, 1e300])
def test_absurd_targets_are_missed_and_no_more(far):
    T = T_SAMPLE.copy()
    T[:3, 3] = far
    answers = solve_numeric(chain("ur5e"), T)
    assert not answers.reached
    assert answers.nearest.position_error == pytest.approx(np.sqrt(3.0) * far)
    assert np.isfinite(answers.nearest.q).all()


def test_limits_that_bound_nothing():
    for far in (1e9, 1e300):
        screws = [[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]]
        arm = Chain("slides", screws, np.eye(4), [[-far, far], [-1.0, far]], ["a", "b"])
        np.testing.assert_allclose(solve_numeric(arm, at(5.0, 20.0)).q[0], [5.0, 20.0], atol=1e-9)


@pytest.mark.parametrize("far", [1e3, 2e6])
def test_limits_many_turns_away(far):
    arm = planar(1.0, limits=(far, far + 1.0))
    T = fk(arm, [far + 0.5])
    np.testing.assert_allclose(solve_numeric(arm, T).q[0], [far + 0.5], atol=1e-9)


@pytest.mark.parametrize("axis", [(0, 0, 1), (1, 0, 0), (0, -1, 0), (0.6, 0, 0.8), (-0.48, 0.6, 0.64)])
def test_half_a_turn_away_exactly(axis):
    """Every cross product of the axes vanishes there; it must not pass for having arrived."""
    arm = Chain("one", [[0, 0, 0, *axis]], np.eye(4), [[-4.0, 4.0]], ["turn"])
    T = np.eye(4)
    T[:3, :3] = 2.0 * np.outer(axis, axis) - np.eye(3)
    answers = solve_numeric(arm, T, seed=[0.0], restarts=1)
    assert answers.reached
    assert abs(answers.q[0, 0]) == pytest.approx(np.pi, abs=1e-9)
    across = np.cross(axis, (0.3, 0.9, -0.5))
    turned = solve_numeric(arm, target.position_and_axis([0, 0, 0], -across, axis_tip=across), seed=[0.0], restarts=1)
    assert turned.reached


@pytest.mark.parametrize(
    "eighths", [(2, 1, 0, 0, 0, 2, 3), (2, -2, 0, 0, 0, -2, -3), (-1, -2, 0, 0, 0, 2, -3), (-2, 2, 0, 0, 0, -2, -3)]
)
def test_poses_that_are_singular_in_several_ways(eighths):
    """Arm stretched and wrist aligned: the error is flat along bent valleys."""
    arm = chain("kinova_gen3_7dof", nominal=True)
    assert solve_numeric(arm, fk(arm, np.array(eighths) * np.pi / 4)).reached


def test_too_few_steps_is_not_called_unreachable():
    answers = solve_numeric(chain("ur5e"), T_SAMPLE, iterations=1, restarts=1)
    assert answers.status in (Status.reached, Status.not_converged)  # settling may still get there


# --- seeds


def test_the_answer_near_the_seed_wins():
    arm = chain("ur5e")
    rng = np.random.default_rng(0)
    q = rng.uniform(-3.0, 3.0, (200, 6))
    q[:, 2] = np.sign(q[:, 2]) * (0.4 + 0.7 * np.abs(q[:, 2]))  # away from the stretched and folded elbow
    q[:, 4] = np.sign(q[:, 4]) * (0.4 + 0.7 * np.abs(q[:, 4]))  # and from the wrist singularity
    answers = solve_numeric(arm, fk(arm, q), seed=q + rng.uniform(-0.02, 0.02, q.shape))
    same = np.abs(answers.q[:, 0] - q).max(axis=1) < 1e-6
    assert same.mean() > 0.97  # the rest is near the shoulder singularity
    cold = solve_numeric(arm, fk(arm, q))
    assert (np.abs(cold.q[:, 0] - q).max(axis=1) < 1e-6).mean() < 0.5


@pytest.mark.parametrize("wrist", [0.3, 0.3 - 2 * np.pi, 5.9, -5.9])
def test_turning_joints_stay_by_the_seed(wrist):
    arm = chain("ur5e")
    q = np.array([0.1, -1.2, 1.4, -1.7, -1.5, wrist])
    np.testing.assert_allclose(solve_numeric(arm, fk(arm, q), seed=q + 0.01).q[0], q, atol=1e-8)
    assert np.abs(solve_numeric(arm, fk(arm, q)).q[0]).max() <= np.pi  # cold: the copy in the middle of the limits


def test_a_hopeless_seed_does_no_harm():
    arm = chain("franka_panda")
    T = fk(arm, [0.1, 0.2, -0.3, -1.5, 0.2, 1.7, 0.4])
    assert solve_numeric(arm, T, seed=np.full(7, 50.0)).reached


def test_one_seed_for_many_targets():
    q = np.array([0.1, -1.2, 1.4, -1.7, -1.5, 0.3])
    arm = chain("ur5e")
    targets = fk(arm, q + np.linspace(0, 0.05, 6).reshape(3, 2, 1))
    answers = solve_numeric(arm, targets, seed=q.tolist())
    assert answers.q.shape == (3, 2, 1, 6)
    np.testing.assert_array_equal(answers.q[2, 1], solve_numeric(arm, targets[2, 1], seed=q).q)


@pytest.mark.parametrize("far", [1e3, 1e9, 1e14])
def test_a_seed_far_away_costs_no_digits(far):
    arm = chain("kinova_gen3_7dof")  # every other joint turns without limits
    answers = solve_numeric(arm, fk(arm, [0.1] * 7), seed=[far] * 7)
    assert answers.reached
    assert answers.position_error[0] < TOLERANCE


# --- several answers


def test_several_answers_are_distinct_and_all_good():
    arm = chain("ur5e")
    answers = solve_numeric(arm, T_SAMPLE, count=12)
    found = answers.q[answers.valid]
    assert len(found) == 8  # an arm of this family has up to eight, and has all eight here
    for i, a in enumerate(found):
        np.testing.assert_allclose(textbook.fk(arm, a), T_SAMPLE, atol=2e-9)
        for b in found[:i]:
            assert np.abs(np.mod(a - b + np.pi, 2 * np.pi) - np.pi).max() > 1e-3
    assert np.isnan(answers.q[~answers.valid]).all()
    assert np.isnan(answers.position_error[~answers.valid]).all()


def test_a_loose_tolerance_still_gives_what_it_can():
    answers = solve_numeric(chain("ur5e"), T_SAMPLE, position_tolerance=1e-3, rotation_tolerance=1e-3)
    assert answers.position_error[0] < 1e-3
    assert answers.position_tolerance == 1e-3


# --- shapes and bad input


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2), (0,)])
def test_leading_axes(shape):
    answers = solve_numeric(chain("ur5e"), np.broadcast_to(T_SAMPLE, (*shape, 4, 4)), count=2)
    assert answers.q.shape == (*shape, 2, 6)
    for array in (answers.valid, answers.position_error, answers.rotation_error, answers.within_limits, answers.exact):
        assert array.shape == (*shape, 2)
    for array in (answers.status, answers.reached, answers.nearest.position_error, answers.nearest.out_of_reach):
        assert array.shape == shape
    assert answers.nearest.q.shape == (*shape, 6)


def test_other_number_types():
    exact = solve_numeric(gantry(), at(0.0, 1.0, 2.0))
    for T in (
        at(0, 1, 2).tolist(),
        at(0, 1, 2).astype(np.int64),
        np.asfortranarray(at(0, 1, 2)),
        at(0, 1, 2).astype(np.float32),
    ):
        np.testing.assert_array_equal(solve_numeric(gantry(), T).q, exact.q)


def tilted():
    T = T_SAMPLE.copy()
    T[:3, :3] *= 1.001
    return T


def batch_with(bad):
    return np.stack([T_SAMPLE, T_SAMPLE, bad])


@pytest.mark.parametrize(
    ("T", "message"),
    [
        (np.eye(3), r"T_base_tip must have shape \(..., 4, 4\), got \(3, 3\)"),
        (np.full((4, 4), np.nan), "T_base_tip must be finite, got nan"),
        (batch_with(np.full((4, 4), np.inf)), r"T_base_tip must be finite, got inf at index \(2, 0, 0\)"),
        (tilted(), "R R\\^T deviates from the identity by 0.002"),
        (batch_with(tilted()), r"deviates from the identity by 0.002 at index \(2,\)"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "determinant is -1"),
        (np.diag([1.0, 1.0, 1.0, 2.0]), "last row 0 0 0 1"),
        ("here", "must be an array of real numbers"),
        (None, r"T_base_tip must have shape \(..., 4, 4\), got \(\)"),
    ],
)
def test_malformed_targets(T, message):
    with pytest.raises(ArrayError, match=message):
        solve_numeric(chain("ur5e"), T)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"seed": [0.0] * 5},
            r"seed must have shape \(..., 6\), got \(5,\); the joints of 'ur5e' are: shoulder_pan_joint",
        ),
        ({"seed": [0.0] * 5 + [np.nan]}, r"seed must be finite, got seed\[5\] = nan"),
        ({"seed": np.zeros((2, 6))}, r"leading axes that broadcast to \(\), got \(2, 6\)"),
        ({"position_tolerance": 0.0}, "tolerances must be positive"),
        ({"rotation_tolerance": np.nan}, "tolerances must be positive"),
        ({"position_tolerance": "1"}, "tolerances must be positive numbers .* got '1'"),
        ({"count": 2**40}, "count must be at most 1024"),
        ({"restarts": 0}, "restarts must be a whole number of at least 1, got 0"),
        ({"iterations": -1}, "iterations must be a whole number"),
        ({"count": 1.5}, "count must be a whole number of at least 1, got 1.5"),
        ({"threads": 0}, "threads must be a whole number"),
    ],
)
def test_malformed_options(options, message):
    with pytest.raises(ArrayError, match=message):
        solve_numeric(chain("ur5e"), T_SAMPLE, **options)


def test_chains_that_are_too_short_or_too_long():
    bare = Chain("bare", np.zeros((0, 6)), np.eye(4), np.zeros((0, 2)), ())
    with pytest.raises(ArrayError, match="1 to 32 axes, 'bare' has 0"):
        solve_numeric(bare, np.eye(4))
    with pytest.raises(ArrayError, match="1 to 32 axes, 'planar' has 33"):
        solve_numeric(planar(*[0.1] * 33), np.eye(4))
    assert solve_numeric(planar(*[0.1] * 32), target.ignore_orientation([1.0, 1.0, 0.0])).reached


@pytest.mark.parametrize("limit", [np.inf, 1100.0])
def test_an_arm_on_a_long_rail_goes_far(limit):
    arm = chain("ur5e")
    rail = Chain(
        "rail",
        np.vstack([[0, 1, 0, 0, 0, 0], arm.screws]),
        arm.home,
        np.vstack([[-limit, limit], arm.limits]),
        ("rail", *arm.joint_names),
    )
    rng = np.random.default_rng(7)
    far = min(limit, 60.0)
    q = np.column_stack([rng.uniform(-far, far, 200), rng.uniform(-3, 3, (200, 6))])
    answers = solve_numeric(rail, fk(rail, q))
    assert answers.reached.all()
    assert answers.position_error.max() < 1e-9
