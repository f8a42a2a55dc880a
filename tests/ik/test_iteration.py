"""The teaching method against the published runs: same angles, same number of steps, same table of errors."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import yaml

from pieper.errors import ArrayError
from pieper.ik.iteration import iterate, run
from pieper.kinematics.fk import fk
from pieper.spatial import rotation
from tests.robots import chain

GOLDEN = Path(__file__).parents[1] / "golden"
MH12 = yaml.safe_load((GOLDEN / "mh12_seed.yaml").read_text())["position_ik_replay"]
UR = yaml.safe_load((GOLDEN / "ur_seed.yaml").read_text())
START = np.array(UR["tcp_at_given_q"]["q"])
TARGET = UR["ur5e_to_target"]["target"]

REPLAY = (
    1e-9  # [rad, m]: what the golden files ask for; hundreds of steps do not add up, since each one corrects the last
)
REPORT_OFFSET = (0.0003, 0.0003, 0.0004)  # [m]: the correction that the MH12 report adds to its targets


def exact_mh12():
    """The public model with joint 4 held, as the report holds it."""
    return chain("yaskawa_mh12", nominal=True).lock(joint_4_r=0.0)


@pytest.mark.parametrize("case", MH12, ids=lambda c: str(c["target"]))
def test_b13_replay_of_the_report(case):
    steps = list(
        iterate(
            chain("mh12-report"), case["target"], np.zeros(5), alpha=0.06, iterations=255, target_offset=REPORT_OFFSET
        )
    )
    wanted = case["seed_rule"]
    assert len(steps) == 256
    np.testing.assert_allclose(steps[-1].q, wanted["theta_after_255"], rtol=0, atol=REPLAY)
    np.testing.assert_allclose(steps[-1].T[:3, 3], wanted["position"], rtol=0, atol=REPLAY)
    assert steps[254].norm == pytest.approx(wanted["error_norm_last"], rel=1e-6)  # printed before the last update
    assert np.linalg.norm(steps[-1].T[:3, 3] - case["target"]) == pytest.approx(
        wanted["distance_to_requested"], rel=1e-6
    )


@pytest.mark.parametrize("case", MH12, ids=lambda c: str(c["target"]))
def test_b13_replay_with_exact_constants(case):
    last = run(exact_mh12(), case["target"], np.zeros(5), alpha=0.06, iterations=255)
    wanted = case["exact_constants_no_offset"]
    theta = last.q * [1, 1, 1, -1, 1]  # the report turns joint_5_b the other way round
    np.testing.assert_allclose(theta, wanted["theta_after_255"], rtol=0, atol=REPLAY)
    assert last.norm == pytest.approx(wanted["distance_to_requested"], rel=1e-6)


def test_b13_error_table():
    steps = list(
        iterate(
            chain("mh12-report"), [0.3, 0.3, 0.3], np.zeros(5), alpha=0.06, iterations=255, target_offset=REPORT_OFFSET
        )
    )
    # (printed line, error): line k shows the error before update k
    for line, error in ((1, 1.171), (50, 0.0562), (100, 2.54e-3), (150, 1.15e-4), (200, 5.2e-6), (255, 1.7e-7)):
        assert steps[line - 1].norm == pytest.approx(error, rel=0.03)
    ratios = np.array([steps[k + 1].norm / steps[k].norm for k in range(100, 254)])
    np.testing.assert_allclose(ratios, 0.94, atol=1e-3)
    # the report rounds its last angle, which belongs to an error of 6e-8 m
    np.testing.assert_allclose(steps[255].q, [0.785398, 0.215964, -1.418371, 0.141938, -6.2e-5], atol=1e-6)


def test_b13_warm_start_goes_on():
    arm = chain("mh12-report")
    whole = run(arm, [0.3, 0.3, 0.3], np.zeros(5), alpha=0.06, iterations=60)
    half = run(arm, [0.3, 0.3, 0.3], np.zeros(5), alpha=0.06, iterations=30)
    np.testing.assert_array_equal(run(arm, [0.3, 0.3, 0.3], half.q, alpha=0.06, iterations=30).q, whole.q)


def reachable_mh12(count):
    """Tip positions of the report's arm for random angles within limits."""
    arm = exact_mh12()
    q = np.random.default_rng(12).uniform(*arm.limits.T, (count, 5))
    return fk(arm, q)[:, :3, 3]


def test_m5_offsets_make_it_worse():
    exact = exact_mh12()
    with_offset, without, true = [], [], []
    for target in reachable_mh12(30):
        for offset, found in ((REPORT_OFFSET, with_offset), (None, without)):
            theta = run(chain("mh12-report"), target, np.zeros(5), alpha=0.06, iterations=255, target_offset=offset).q
            real = fk(exact, theta * [1, 1, 1, -1, 1])[:3, 3]
            found.append(np.linalg.norm(real - target))
        true.append(run(exact, target, np.zeros(5), alpha=0.06, iterations=255).norm)
    assert np.median(with_offset) == pytest.approx(0.81e-3, rel=0.25)
    assert np.median(without) == pytest.approx(0.33e-3, rel=0.25)
    assert np.median(true) < 4e-7


def test_m5_at_the_example_target():
    theta = run(chain("mh12-report"), [0.3] * 3, np.zeros(5), alpha=0.06, iterations=255, target_offset=REPORT_OFFSET).q
    real = fk(exact_mh12(), theta * [1, 1, 1, -1, 1])[:3, 3]
    assert np.linalg.norm(real - 0.3) == pytest.approx(0.97e-3, rel=0.02)


def test_m5_a_zero_coordinate_gets_no_offset():
    last = run(exact_mh12(), [0.9, 0.0, -0.1], np.zeros(5), iterations=60, target_offset=REPORT_OFFSET)
    np.testing.assert_allclose(last.T[:3, 3], [0.9003, 0.0, -0.1004], atol=1e-9)


def test_m7_the_method_leaves_the_limits():
    arm = exact_mh12()
    outside = 0
    for target in reachable_mh12(60):
        q = run(arm, target, np.zeros(5), alpha=0.06, iterations=255).q
        outside += bool(np.any((q < arm.limits[:, 0]) | (q > arm.limits[:, 1])))
    assert 2 <= outside <= 15  # 32 of 300 in the published count


@pytest.mark.parametrize("case", UR["ur5e_to_target"]["runs"], ids=lambda c: c["run"])
def test_e6_runs(case):
    name = case["run"]
    last = run(
        chain("ur5e"),
        TARGET,
        START,
        orientation="ignore" if "three_rows" in name else "hold",
        k1=float(name.rsplit("_", 1)[1]),
        damping=0.1 if "damped" in name else 0.0,
        position_stop=1e-3,
    )
    assert last.iteration == case["iterations"]
    np.testing.assert_allclose(last.q, case["q_final"], rtol=0, atol=REPLAY)
    np.testing.assert_allclose(last.T[:3, 3], case["position"], rtol=0, atol=REPLAY)
    assert np.linalg.norm(last.error[:3]) == pytest.approx(case["residual"], abs=REPLAY)
    turned = rotation.distance(last.T[:3, :3], fk(chain("ur5e"), START)[:3, :3])
    assert float(turned) == pytest.approx(case["orientation_change_rad"], abs=1e-8)


def test_e6_ends_when_the_callback_says_so():
    seen = []

    def ok(step):
        seen.append(step.iteration)
        return step.iteration < 7

    last = run(chain("ur5e"), TARGET, START, k1=0.1, position_stop=1e-3, callback=ok)
    assert last.iteration == 7
    assert seen == list(range(8))


def deviation_from_line(points):
    """Greatest distance of a path from the straight line between start and target [m]."""
    along = np.asarray(TARGET) - points[0]
    along = along / np.linalg.norm(along)
    offset = points - points[0]
    return np.linalg.norm(offset - np.outer(offset @ along, along), axis=1).max()


def test_e7_path():
    with (GOLDEN / "ur5e_path_k1_0.1.csv").open() as file:
        golden = np.array([[float(row[k]) for k in "xyz"] for row in csv.DictReader(file)])
    steps = list(iterate(chain("ur5e"), TARGET, START, orientation="hold", k1=0.1, position_stop=1e-3))
    path = np.array([step.T[:3, 3] for step in steps])
    np.testing.assert_allclose(path, golden, rtol=0, atol=REPLAY)
    assert deviation_from_line(path) == pytest.approx(0.0101, abs=5e-5)
    fast = iterate(chain("ur5e"), TARGET, START, orientation="hold", k1=1.0, position_stop=1e-3)
    assert deviation_from_line(np.array([step.T[:3, 3] for step in fast])) == pytest.approx(0.327, abs=5e-4)


def test_e8_position_and_orientation():
    arm = chain("ur5e")
    goal = fk(arm, START + np.array([0.3, -0.2, 0.25, 0.2, -0.3, 0.4]))
    last = run(arm, goal, START, orientation="reach", k1=0.1, k2=0.1, position_stop=1e-6, rotation_stop=1e-6)
    assert last.error.shape == (6,)
    assert np.linalg.norm(last.T[:3, 3] - goal[:3, 3]) < 1e-6
    assert float(rotation.distance(last.T[:3, :3], goal[:3, :3])) < 1e-6


def test_e8_rotation_error_is_the_axis_angle_of_what_is_left_in_base_axes():
    arm = chain("ur5e")
    here = fk(arm, START)
    axis, angle = np.array([0.48, -0.6, 0.64]), 0.7
    goal = here.copy()
    goal[:3, :3] = rotation.from_axis_angle(axis, angle) @ here[:3, :3]
    first = next(iterate(arm, goal, START, orientation="reach", iterations=1))
    np.testing.assert_allclose(first.error, [0, 0, 0, *(angle * axis)], atol=1e-12)


def test_e8_gains_are_apart():
    arm = chain("ur5e")
    goal = fk(arm, START + 0.02)
    _, after = iterate(arm, goal, START, orientation="reach", k1=1.0, k2=1e-9, iterations=1)
    before, _ = iterate(arm, goal, START, orientation="reach", iterations=1)
    assert np.linalg.norm(after.error[:3]) < 0.05 * np.linalg.norm(before.error[:3])
    assert np.linalg.norm(after.error[3:]) == pytest.approx(np.linalg.norm(before.error[3:]), rel=0.05)


def test_u1_holding_is_not_ignoring():
    arm = chain("ur5e")
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (300, 6))
    reached = {"hold": 0, "ignore": 0}
    for target in fk(arm, q)[:, :3, 3]:
        for orientation in reached:
            last = run(arm, target, START, orientation=orientation, k1=0.1, iterations=500, position_stop=1e-3)
            reached[orientation] += bool(np.linalg.norm(last.error[:3]) < 1e-3)
    assert reached["ignore"] == 300
    assert 240 <= reached["hold"] <= 280  # 260 in the published count, over other positions


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"target": [0.3, 0.3]}, r"target must have shape \(3,\) or \(4, 4\) to ignore the orientation, got \(2,\)"),
        ({"orientation": "reach"}, r"target must have shape \(4, 4\) to reach the orientation, got \(3,\)"),
        ({"orientation": "keep"}, "'ignore', 'hold' or 'reach', got 'keep'"),
        ({"target": [0.3, np.nan, 0.3]}, "target must be finite"),
        ({"q_start": [0.0] * 5}, r"q_start must have shape \(..., 6\), got \(5,\)"),
        ({"q_start": np.zeros((2, 6))}, "one start at a time"),
        ({"alpha": 0.0}, "alpha must be a positive number"),
        ({"damping": -1.0}, "damping must be"),
        ({"iterations": None}, "nothing else ends the run"),
        ({"iterations": -1}, "iterations must be at least 0"),
        ({"position_stop": 0.0}, "position_stop must be a positive number"),
        ({"rotation_stop": 1e-3}, "rotation_stop needs orientation 'reach'"),
    ],
)
def test_says_what_is_wrong(change, message):
    arguments = {"target": [0.3, 0.3, 0.3], "q_start": np.zeros(6), "iterations": 3, **change}
    with pytest.raises(ArrayError, match=message):
        run(chain("ur5e"), **arguments)
