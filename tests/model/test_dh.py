"""Denavit-Hartenberg tables: the tables of the reports, and the way from any arm to rows and back."""

from __future__ import annotations

import itertools
import json
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from pieper.errors import ArrayError, DhError, PieperWarning
from pieper.model import catalog
from pieper.model.chain import Chain
from pieper.model.description import Description
from pieper.model.dh import (
    CONVENTIONS,
    DhRow,
    DhTable,
    as_dh,
    as_record,
    forward_kinematics,
    from_dh,
    from_record,
    from_rows,
    hayati_dh,
    modified_dh,
    standard_dh,
)
from pieper.model.poe import from_screws, prismatic, revolute
from pieper.model.urdf import as_urdf, from_urdf
from tests.reference.product_of_exponentials import fk
from tests.robots import NAMES, chain

GOLDEN = Path(__file__).parents[1] / "golden"
EXACT = 1e-12  # [m, rad]: what issue and documentation promise for arms without nearly parallel axes
# per unit of amplification, in rad, and in m per m of reach: what as_dh documents; 24000 random arms came to a quarter of it
ROUNDING = 1e-14
HALF_TURN_Z_THEN_DOWN = np.array(
    [[0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)


def golden(name: str):
    return yaml.safe_load((GOLDEN / name).read_text())


def quiet_dh(arm: Chain, **options) -> DhTable:
    """A table without the warning about nearly parallel axes; tests of the warning call as_dh itself."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PieperWarning)
        return as_dh(arm, **options)


def reach(arm: Chain, q: np.ndarray | None = None) -> float:
    """A length [m] that no point of the arm leaves, at home or, what slides included, at q."""
    slid = 0.0 if q is None else float(np.abs(q[~arm.is_revolute]).sum())
    return 1.0 + float(np.abs(arm.screws).max(initial=0.0)) + float(np.abs(arm.home).max()) + slid


def difference(a: Chain, b: Chain) -> float:
    return max(float(np.abs(a.screws - b.screws).max(initial=0.0)), float(np.abs(a.home - b.home).max()))


# --------------------------------------------------------------------------------------------------------------------
# rows and tables of the reports


def test_row_d8_standard_dh_is_the_product_of_its_four_moves():
    rng = np.random.default_rng(0)
    for a, alpha, d, theta in rng.uniform(-3, 3, (50, 4)):

        def turn(angle, i, j):
            T = np.eye(4)
            T[i, i] = T[j, j] = np.cos(angle)
            T[j, i] = np.sin(angle)
            T[i, j] = -np.sin(angle)
            return T

        def move(length, i):
            T = np.eye(4)
            T[i, 3] = length
            return T

        Z, X = turn(theta, 0, 1) @ move(d, 2), move(a, 0) @ turn(alpha, 1, 2)
        np.testing.assert_allclose(standard_dh(a, alpha, d, theta), Z @ X, atol=EXACT)
        np.testing.assert_allclose(modified_dh(alpha, a, d, theta), X @ Z, atol=EXACT)
        tilt = turn(0.3, 2, 0)
        np.testing.assert_allclose(hayati_dh(a, alpha, 0.3, d, theta), Z @ X @ tilt, atol=EXACT)


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
def test_rows_take_any_leading_axes(shape):
    values = np.random.default_rng(1).uniform(-2, 2, (4, *shape))
    stack = standard_dh(*values)
    assert stack.shape == (*shape, 4, 4)
    for index in np.ndindex(shape):
        assert np.array_equal(stack[index], standard_dh(*values[(slice(None), *index)]))
    assert standard_dh(0.1, 0.0, np.zeros(shape), 0.2).shape == (*shape, 4, 4)


def test_quarter_turns_are_exact():
    for quarters in range(-6, 7):
        R = standard_dh(0.0, quarters * np.pi / 2, 0.0, quarters * np.pi / 2)[:3, :3]
        assert set(np.abs(R).ravel()) <= {0.0, 1.0}


@pytest.mark.parametrize("bad", [np.nan, np.inf, "x", None])
def test_row_functions_refuse_what_is_no_number(bad):
    with pytest.raises(ArrayError, match="alpha must be"):
        standard_dh(0.1, bad, 0.0, 0.0)
    with pytest.raises(ArrayError, match="must broadcast to one shape, got alpha \\(2,\\), a \\(3,\\)"):
        modified_dh([0.0, 0.0], [0.0, 0.0, 0.0], 0.0, 0.0)


def test_row_d8_up_to_joint():
    """Row D8: 0 gives the identity, 1 to n the frame of that row, inputs are checked."""
    table = catalog.dh_tables("youbot")["simplified"]
    q = [0.1, -0.2, 0.3, -0.4, 0.5]
    assert np.array_equal(forward_kinematics(table, q, up_to_joint=0), np.eye(4))
    T = np.eye(4)
    for k, (row, angle) in enumerate(zip(table.rows, q, strict=True), start=1):
        T = T @ standard_dh(row.a, row.alpha, row.d, row.theta + angle)
        np.testing.assert_allclose(forward_kinematics(table, q, up_to_joint=k), T, atol=EXACT)
    np.testing.assert_allclose(forward_kinematics(table, q), T, atol=EXACT)
    for bad in (-1, 6, 1.5, True):
        with pytest.raises(ArrayError, match="up_to_joint must be an integer from 0 to 5"):
            forward_kinematics(table, q, up_to_joint=bad)
    with pytest.raises(ArrayError, match=r"readings must have shape \(..., 5\), got \(4,\)"):
        forward_kinematics(table, q[:4])
    with pytest.raises(ArrayError, match="readings must be finite"):
        forward_kinematics(table, [0.0, np.nan, 0.0, 0.0, 0.0])
    with pytest.raises(ArrayError, match="readings must be numbers"):
        forward_kinematics(table, ["a"] * 5)


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
def test_forward_kinematics_takes_any_leading_axes(shape):
    table = catalog.dh_tables("kr210")["report"]
    q = np.random.default_rng(2).uniform(-3, 3, (*shape, 6))
    stack = forward_kinematics(table, q)
    assert stack.shape == (*shape, 4, 4)
    for index in np.ndindex(shape):
        assert np.array_equal(stack[index], forward_kinematics(table, q[index]))


def test_row_d10_y3_youbot_full_table_equals_the_urdf():
    """Rows D10 and Y3: with the fixed mount as row 0, the corrected table is the URDF chain to 1e-12."""
    arm, data = chain("kuka_youbot"), golden("youbot_dh.yaml")
    tables = catalog.dh_tables("youbot")
    for label, key in (("full", "z_up"), ("full_z_down", "z_down")):
        for row, given_row in zip(tables[label].rows, data["standard_dh_full"][key], strict=True):
            assert (row.a, row.alpha, row.d, row.theta) == tuple(given_row[k] for k in ("a", "alpha", "d", "offset"))
            assert row.sign == (given_row["sign"] or 1)
            assert (row.type == "fixed") == (given_row["sign"] == 0)
        assert difference(from_dh(tables[label]), arm) < EXACT
        assert tables[label].joint_names == arm.joint_names
        np.testing.assert_array_equal(tables[label].limits, arm.limits)
    for case in data["samples"]:
        T = forward_kinematics(tables["full"], case["q"])
        assert np.abs(T - case["T_base_to_arm_link_5"]).max() < EXACT
        assert np.abs(fk(arm, case["q"]) - case["T_base_to_arm_link_5"]).max() < EXACT
        for k, frame in enumerate(case["dh_frames_z_up_table"][1:], start=1):
            assert np.abs(forward_kinematics(tables["full"], case["q"], up_to_joint=k) - frame).max() < EXACT
    rng = np.random.default_rng(3)
    for q in rng.uniform(arm.limits[:, 0], arm.limits[:, 1], (500, 5)):
        assert np.abs(forward_kinematics(tables["full"], q) - fk(arm, q)).max() < EXACT


def test_row_y6_youbot_stands_upright_at_170_degrees():
    """Row Y6: the exact candle needs joint 1 at 170 degrees, not at half its range."""
    arm, candle = chain("kuka_youbot"), golden("youbot_dh.yaml")["candle"]
    q = np.radians([170.0, 65.0, -146.0, 102.5, 167.5])
    np.testing.assert_allclose(q, candle["q_for_exact_candle"], atol=EXACT)
    for T in (fk(arm, q), forward_kinematics(catalog.dh_tables("youbot")["full"], q)):
        assert np.abs(T - candle["T"]).max() < EXACT
    assert np.degrees(arm.limits[0, 1]) / 2 == pytest.approx(169.0)


def test_row_y2_youbot_simplified_table():
    """Row Y2: 75, 155, 135, 113 mm, straight up at zero; each length counts once."""
    table = catalog.dh_tables("youbot")["simplified"]
    data = golden("youbot_dh.yaml")
    for row, given_row in zip(table.rows, data["standard_dh_simplified_mm"]["rows"], strict=True):
        assert (1000 * row.a, row.alpha, 1000 * row.d, row.theta) == pytest.approx(
            tuple(given_row[k] for k in ("a", "alpha", "d", "offset")), abs=1e-12
        )
    millimetres = np.diag([1e-3, 1e-3, 1e-3])
    for case in data["simplified_samples_mm"]:
        T = forward_kinematics(table, case["q"])
        expected = np.array(case["T"])
        assert np.abs(T[:3, :3] - expected[:3, :3]).max() < EXACT
        assert np.abs(T[:3, 3] - millimetres @ expected[:3, 3]).max() < EXACT
    straight_up = forward_kinematics(table, np.zeros(5))
    np.testing.assert_allclose(straight_up[:3, 3], [0.0, 0.0, 0.478], atol=EXACT)
    # the report's rows hold each length twice; properly multiplied they give (478, -403, 75) mm instead
    twice = [(0, 0, 0, 0), (75, np.pi / 2, 75, 0), (155, 0, 155, 0), (135, 0, 135, 0), (113, np.pi / 2, 113, 0)]
    assert forward_kinematics(twice, np.zeros(5))[:3, 3] == pytest.approx([478.0, -403.0, 75.0])


def test_row_c2_kr210_modified_table_equals_the_urdf():
    """Row C2: the report's seven rows, then Rz(pi) Ry(-pi/2), are the URDF chain to 1.4e-15 per metre or so."""
    table, arm = catalog.dh_tables("kr210")["report"], chain("kuka_kr210_robond")
    assert [row.type for row in table.rows] == ["revolute"] * 6 + ["fixed"]
    Rz_pi = np.diag([-1.0, -1.0, 1.0, 1.0])
    Ry = np.array([[0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    assert np.array_equal(table.T_tool, Rz_pi @ Ry)  # R_corr
    assert np.array_equal(table.T_tool @ table.T_tool, np.eye(4))  # its own inverse, row K4
    assert difference(from_dh(table), arm) < EXACT
    rng = np.random.default_rng(4)
    for q in rng.uniform(arm.limits[:, 0], arm.limits[:, 1], (2000, 6)):
        T = np.eye(4)
        for row, angle in zip(table.rows, [*q, 0.0], strict=True):
            T = T @ modified_dh(row.alpha, row.a, row.d, row.theta + angle)
        assert np.abs(T @ table.T_tool - fk(arm, q)).max() < EXACT
    for case in golden("kr210_ik.yaml")["random"]:
        assert np.abs(forward_kinematics(table, case["q"]) - case["T"]).max() < EXACT


def test_row_c1_kr210_joint_table_and_limits():
    """Row C1: joint origins, totals and limits of the report."""
    record = catalog.record("kr210")
    origins = [joint["xyz"] for joint in record["joints"]]
    assert origins == [
        [0, 0, 0.33],
        [0.35, 0, 0.42],
        [0, 0, 1.25],
        [0.96, 0, -0.054],
        [0.54, 0, 0],
        [0.193, 0, 0],
        [0.11, 0, 0],
    ]
    assert chain("kuka_kr210_robond").home[:3, 3] == pytest.approx([2.153, 0.0, 1.946], abs=EXACT)
    printed = np.radians([[-185, 185], [-45, 85], [-210, 65], [-350, 350], [-125, 125], [-350, 350]])
    np.testing.assert_allclose(chain("kuka_kr210_robond").limits, printed, rtol=3e-8)  # source: deg = 0.017453293
    assert np.degrees(chain("kuka_kr210_robond").limits[2, 1]) == pytest.approx(65.0)  # row K2: 155 - 90


def test_row_k1_and_k3_kr210_lengths():
    """Rows K1 and K3: d1 = 0.75 is needed, and the wrist centre lies 0.303 before the gripper frame."""
    table = catalog.dh_tables("kr210")["report"]
    assert table.rows[0].d == 0.75
    assert table.rows[5].d + table.rows[6].d == pytest.approx(0.303)
    for case in golden("kr210_ik.yaml")["random"]:
        wrist = forward_kinematics(table, case["q"], up_to_joint=5)[:3, 3]
        T = forward_kinematics(table, case["q"])
        np.testing.assert_allclose(wrist, case["wrist_centre"], atol=EXACT)
        z_G = T[:3, :3] @ table.T_tool[:3, :3].T @ [0.0, 0.0, 1.0]
        np.testing.assert_allclose(T[:3, 3] - 0.303 * z_G, wrist, atol=EXACT)


def test_row_k4_kr210_wrist_rotation_is_not_an_euler_zyz():
    """Row K4: the angles of R3_6 come from its own entries, as in row C6."""
    table = catalog.dh_tables("kr210")["report"]
    rng = np.random.default_rng(5)
    for q in rng.uniform(-1.5, 1.5, (100, 6)):
        q[4] = abs(q[4]) + 0.01
        R = (np.linalg.inv(forward_kinematics(table, q, up_to_joint=3)) @ forward_kinematics(table, q, up_to_joint=6))[
            :3, :3
        ]
        wrist = [
            np.arctan2(R[2, 2], -R[0, 2]),
            np.arctan2(np.hypot(R[0, 2], R[2, 2]), R[1, 2]),
            np.arctan2(-R[1, 1], R[1, 0]),
        ]
        np.testing.assert_allclose(wrist, q[3:], atol=1e-10)  # arctan2 near theta_5 = 0 loses two digits


def test_puma_rows_are_reproduced():
    """The rows of the source come back from the screws as they were typed."""
    source = catalog.dh_tables("puma560")["source"]
    table = as_dh(from_dh(source))
    for row, typed in zip(table.rows, source.rows, strict=True):
        assert (row.a, row.alpha, row.d, row.theta) == pytest.approx(
            (typed.a, typed.alpha, typed.d, typed.theta), abs=1e-15
        )
    assert difference(from_dh(source), chain("puma560")) < EXACT


# --------------------------------------------------------------------------------------------------------------------
# from any arm to rows and back


@pytest.mark.parametrize("nominal", [False, True], ids=["literal", "nominal"])
@pytest.mark.parametrize("name", NAMES)
def test_round_trip_of_every_robot(name, nominal):
    """Screws -> DH -> MDH -> Hayati -> screws."""
    arm = back = chain(name, nominal)
    amplification = 0.0
    for convention in CONVENTIONS:
        table = quiet_dh(back, convention=convention)
        amplification = max(amplification, table.amplification.sum())
        back = from_dh(table)
        assert (back.name, back.joint_names, back.base, back.tip) == (arm.name, arm.joint_names, arm.base, arm.tip)
        np.testing.assert_array_equal(back.limits, arm.limits)
        np.testing.assert_array_equal(back.max_velocity, arm.max_velocity)
    allowed = max(EXACT, 2 * ROUNDING * reach(arm) * amplification)  # two of the three tables have common normals
    assert difference(arm, back) < allowed
    if nominal or name != "kinova_gen3_6dof":  # its literal 1.5708 leaves axes 7e-6 rad from parallel
        assert allowed == EXACT


@pytest.mark.parametrize("name", NAMES)
def test_round_trip_through_urdf(name):
    """URDF -> screws -> DH -> MDH -> URDF."""
    arm = chain(name, nominal=True)
    once = from_urdf(as_urdf(catalog.describe(name, nominal=True))).chain(arm.base, arm.tip)
    table = as_dh(from_dh(as_dh(once)), convention="modified")
    back = from_urdf(as_urdf(Description.from_chain(from_dh(table)))).chain(arm.base, arm.tip)
    assert back.joint_names == arm.joint_names
    assert difference(arm, back) < EXACT


@pytest.mark.parametrize("convention", CONVENTIONS)
@pytest.mark.parametrize(
    "name", ["ur5e", "yaskawa_mh12", "kuka_iiwa14", "franka_panda", "kuka_youbot", "kinova_gen3_7dof"]
)
def test_tables_equal_pinocchio(name, convention):
    pytest.importorskip("pinocchio", reason="Pinocchio is not installed")
    from tests.reference.pinocchio_model import PinocchioArm

    table, truth = as_dh(chain(name), convention=convention), PinocchioArm(name)
    for q in np.random.default_rng(6).uniform(-3, 3, (50, table.dof)):
        assert np.abs(forward_kinematics(table, q) - truth.fk(q)).max() < EXACT


STEPS = st.sampled_from(
    ["skew", "parallel", "antiparallel", "coincident", "intersecting", "perpendicular", "concurrent"]
)
SEEDS = st.integers(0, 2**32 - 1)


def random_arm(steps: list[tuple[str, bool]], seed: int, tilt: float = 0.0) -> Chain:
    """An arm whose neighbouring axes stand to each other as asked; `tilt` turns each axis a little away from that."""
    rng = np.random.default_rng(seed)
    z, p, rows = np.array([0.0, 0.0, 1.0]), np.zeros(3), []
    for kind, slides in steps:
        step = rng.normal(size=3) * 0.4
        if kind == "skew":
            z = rng.normal(size=3)
        elif kind == "antiparallel":
            z = -z
        elif kind == "perpendicular":
            z = np.cross(z, rng.normal(size=3))
        elif kind == "coincident":
            step = z * rng.normal()
        elif kind == "intersecting":
            step, z = z * rng.normal(), rng.normal(size=3)
        elif kind == "concurrent":
            step, z = np.zeros(3), rng.normal(size=3)
        z = z / np.linalg.norm(z) + tilt * rng.normal(size=3)
        z = z / np.linalg.norm(z)
        p = p + step
        rows.append(prismatic(z) if slides else revolute(z, p))
    home = hayati_dh(*rng.normal(size=5))
    home[:3, 3] += p
    return from_screws(rows, home)


def check_round_trip(arm: Chain, seed: int) -> None:
    q = np.random.default_rng(seed).uniform(-3, 3, arm.dof)
    for convention in CONVENTIONS:
        table = quiet_dh(arm, convention=convention)
        allowed = ROUNDING * reach(arm, q) * max(1.0, table.amplification.sum())
        back = from_dh(table)
        assert difference(arm, back) < allowed
        assert np.abs(forward_kinematics(table, q) - fk(arm, q)).max() < allowed
        assert np.abs(fk(back, q) - fk(arm, q)).max() < allowed
        if convention == "hayati":
            assert table.amplification.max(initial=1.0) <= 10.0


@settings(max_examples=1000, deadline=None)
@given(st.lists(st.tuples(STEPS, st.booleans()), min_size=0, max_size=8), SEEDS)
def test_round_trip_of_random_arms(steps, seed):
    """Exactly parallel, antiparallel, intersecting, coincident and concurrent neighbours, turning and sliding joints."""
    arm = random_arm(steps, seed)
    check_round_trip(arm, seed)
    skew = np.all([np.linalg.norm(np.cross(*pair)) > 1e-3 for pair in directions_in_pairs(arm) if not parallel(*pair)])
    if skew:
        back = arm
        for convention in CONVENTIONS:
            back = from_dh(quiet_dh(back, convention=convention))
        assert difference(arm, back) < EXACT * reach(arm)


def directions_in_pairs(arm: Chain):
    axes = [s[3:] if s[3:].any() else s[:3] for s in arm.screws]
    return itertools.pairwise(axes)


def parallel(a: np.ndarray, b: np.ndarray) -> bool:
    return float(np.linalg.norm(np.cross(a, b))) < 1e-15


@settings(max_examples=300, deadline=None)
@given(
    st.lists(st.tuples(STEPS, st.booleans()), min_size=2, max_size=7),
    SEEDS,
    st.floats(-16.0, -1.0).map(lambda exponent: 10.0**exponent),
)
def test_round_trip_of_nearly_degenerate_arms(steps, seed, tilt):
    """The error stays within the amplification that the table reports, and Hayati's rows need none."""
    check_round_trip(random_arm(steps, seed, tilt), seed)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(STEPS, st.booleans()), min_size=1, max_size=6), SEEDS, st.data())
def test_signs_may_be_chosen(steps, seed, data):
    arm = random_arm(steps, seed)
    signs = data.draw(st.lists(st.sampled_from([1, -1]), min_size=arm.dof, max_size=arm.dof))
    for convention in CONVENTIONS:
        table = quiet_dh(arm, convention=convention, signs=signs)
        assert [row.sign for row in table.rows] == signs
        assert difference(arm, from_dh(table)) < ROUNDING * reach(arm) * max(1.0, table.amplification.sum())


def nearly_parallel_arm(tilt: float) -> Chain:
    """Two axes 0.4 m apart, the second tilted towards the first so that the common normal is far away."""
    home = np.eye(4)
    home[:3, 3] = [0.7, 0.1, 0.2]
    axes = [[0, 0, 1], [np.sin(tilt), 0.0, np.cos(tilt)], [0, 1, 0]]
    return from_screws(revolute(axes, [[0, 0, 0], [0.4, 0, 0], [0.6, 0, 0.1]]), home, name="tilted")


@pytest.mark.parametrize("tilt", [1e-2, 1e-4, 1e-6])
def test_amplification_is_one_over_the_sine_of_the_twist(tilt):
    table = quiet_dh(nearly_parallel_arm(tilt))
    assert table.amplification[0] == pytest.approx(1.0 / np.sin(tilt), rel=1e-9)
    assert abs(table.rows[0].d) == pytest.approx(0.4 / np.tan(tilt), rel=1e-6)  # the common normal has run away
    assert table.amplification[1:].tolist() == pytest.approx([1.0, 1.0], rel=1e-3)


def test_amplification_is_bounded():
    """Below 4.5e-8 rad the row for parallel axes is the better one."""
    worst = max(quiet_dh(nearly_parallel_arm(tilt)).amplification[0] for tilt in 10.0 ** np.linspace(-15, -1, 200))
    assert 1e7 < worst < 2.3e7


def test_nearly_parallel_axes_are_announced():
    for convention, row in (("standard", 1), ("modified", 2)):
        text = (
            f"tilted: axes 1 and 2 are parallel but for 1e-06 rad; row {row} amplifies rounding 1e[+]06 times; .*hayati"
        )
        with pytest.warns(PieperWarning, match=text):
            as_dh(nearly_parallel_arm(1e-6), convention=convention)
    table = as_dh(nearly_parallel_arm(1e-6), convention="hayati")  # no warning
    assert table.rows[0].beta == pytest.approx(1e-6)
    assert table.rows[0].d == 0.0
    assert difference(from_dh(table), nearly_parallel_arm(1e-6)) < 1e-15


def test_a_hayati_row_uses_d_or_beta():
    for name in NAMES:
        for row in as_dh(chain(name), convention="hayati").rows:
            assert row.d == 0.0 or row.beta == 0.0


def test_youbot_z_up_signs():
    """The signs of the hand-made table give rows along the same axes."""
    arm = chain("kuka_youbot")
    table = as_dh(arm, signs=(-1, 1, 1, 1, -1))
    hand_made = catalog.dh_tables("youbot")["full"].rows[1:]
    for row, typed in zip(table.rows, hand_made, strict=True):
        assert abs(row.a) == pytest.approx(abs(typed.a), abs=1e-15)
        assert row.sign == typed.sign
    with pytest.raises(ArrayError, match=r"signs must be 5 numbers \+1 or -1, got \[1, 2\]"):
        as_dh(arm, signs=(1, 2))


def test_no_joints_and_coupled_joints():
    home = hayati_dh(0.1, 0.2, 0.3, 0.4, 0.5)
    still = from_screws(np.zeros((0, 6)), home)
    for convention in CONVENTIONS:
        assert np.abs(forward_kinematics(as_dh(still, convention=convention), []) - home).max() < EXACT
    arm = chain("ur5e", nominal=True)
    names = (*arm.joint_names[:3], *arm.joint_names[4:])
    coupled = replace(
        arm, joint_names=names, coupling=np.insert(np.eye(5), 3, [0.0, 0.5, -1.0, 0.0, 0.0], axis=0),
        limits=arm.limits[:5], max_velocity=arm.max_velocity[:5], max_effort=arm.max_effort[:5],
    )  # fmt: skip
    q = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    for convention in CONVENTIONS:
        table = as_dh(coupled, convention=convention)
        assert np.abs(forward_kinematics(table, q) - fk(coupled, q)).max() < EXACT
        assert np.abs(fk(from_dh(table), q) - fk(coupled, q)).max() < EXACT
    assert "0.5 shoulder_lift_joint + -1 elbow_joint" in str(table)


def test_frames_follow_the_rows():
    table = catalog.dh_tables("youbot")["full"]
    arm = from_dh(table)
    q = np.array([0.3, 0.2, -0.4, 0.6, 0.1])
    for k in range(1, 6):
        frame = arm.frame(k)
        T = fk(replace(arm, screws=arm.screws[:k], home=frame.home, limits=arm.limits[:k], frames=(),
                       joint_names=arm.joint_names[:k], max_velocity=arm.max_velocity[:k],
                       max_effort=arm.max_effort[:k], coupling=np.eye(k)), q[:k])  # fmt: skip
        assert np.abs(T - forward_kinematics(table, q, up_to_joint=k)).max() < EXACT


# --------------------------------------------------------------------------------------------------------------------
# what comes in


def test_rows_come_in_four_forms():
    typed = [(0.3, 0.1, 0.2, 0.4), (0.5, -0.2, 0.0, 0.1)]
    tables = [
        from_rows(typed),
        from_rows(np.array(typed)),
        from_rows([dict(zip(("a", "alpha", "d", "theta"), row, strict=True)) for row in typed]),
        from_rows([DhRow(*row) for row in typed]),
        DhTable(tuple(DhRow(*row) for row in typed)),
    ]
    assert len({tuple(table.rows) for table in tables}) == 1
    craig = from_rows([(0.1, 0.3, 0.2, 0.4)], convention="modified")
    assert (craig.rows[0].alpha, craig.rows[0].a) == (0.1, 0.3)
    q = [0.7]
    assert np.array_equal(forward_kinematics(craig, q), modified_dh(0.1, 0.3, 0.2, 1.1))
    slide = from_rows([{"type": "prismatic", "sign": -1, "d": 0.2, "alpha": 0.3}], limits=[[0, 1]])
    assert np.array_equal(forward_kinematics(slide, [0.5]), standard_dh(0.0, 0.3, 0.2 - 0.5, 0.0))
    assert from_dh(slide).screws.tolist() == [[0.0, 0.0, -1.0, 0.0, 0.0, 0.0]]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([(0, 0, 0, 0), (0, "x", 0, 0)], r"arm: row 2, column 'alpha': must be a finite number, got 'x'"),
        ([(0, 0, float("nan"), 0)], r"arm: row 1, column 'd': must be a finite number, got nan"),
        ([{"a": 0.1, "theta": None}], r"arm: row 1, column 'theta': must be a finite number, got None"),
        ([{"a": True}], r"column 'a': must be a finite number, got True"),
        ([(0, 0, 1j, 0)], r"column 'd': must be a finite number, got 1j"),
        ([(0, 0, 0)], r"arm: row 1: needs four numbers \(a, alpha, d, theta\), got \(0, 0, 0\)"),
        (["abcd"], r"arm: row 1: needs four numbers"),
        ([5], r"arm: row 1: needs four numbers"),
        ([{"a": 0.1, "tehta": 0.0}], r"arm: row 1: unknown column 'tehta'; columns are: a, alpha"),
        ([{"sign": 2}], r"row 1, column 'sign': must be \+1 or -1, got 2"),
        ([{"type": "screw"}], r"row 1, column 'type': must be one of revolute, prismatic, fixed, got 'screw'"),
        ([{"beta": 0.1}], r"row 1, column 'beta': must be 0 in a standard table, got 0.1"),
        ("rows", r"arm: rows: must be a sequence of rows, got 'rows'"),
        (5, r"arm: rows: must be a sequence of rows, got 5"),
    ],
)
def test_malformed_rows_are_named(rows, message):
    with pytest.raises(DhError, match=message):
        from_rows(rows)


def test_other_faults():
    with pytest.raises(DhError, match="convention: must be one of standard, modified, hayati, got 'craig'"):
        from_rows([(0, 0, 0, 0)], convention="craig")
    with pytest.raises(DhError, match="convention: must be one of standard, modified, hayati, got 'craig'"):
        as_dh(chain("ur5e"), convention="craig")
    with pytest.raises(DhError, match="the table has 1 joints, got 2 names"):
        from_rows([(0, 0, 0, 0)], joint_names=["a", "b"])
    with pytest.raises(ArrayError, match="T_tool must be a pose"):
        from_rows([(0, 0, 0, 0)], T_tool=2 * np.eye(4))
    with pytest.raises(ArrayError, match=r"limits must have shape \(1, 2\), got \(2, 2\)"):
        from_rows([(0, 0, 0, 0)], limits=[[0, 1], [0, 1]])
    with pytest.raises(ArrayError, match=r"a DhTable says all of it already; .* to change convention, name"):
        from_dh(from_rows([(0, 0, 0, 0)]), convention="standard", name="x")
    with pytest.raises(DhError, match="arm: rows: is missing"):
        from_record({"convention": "standard"})
    with pytest.raises(DhError, match="must be a mapping with 'convention' and 'rows', got list"):
        from_record([1])
    with pytest.raises(DhError, match="rows: must be a list of rows, got int"):
        from_record({"convention": "standard", "rows": 1})
    with pytest.raises(DhError, match="limits: must be a list of pairs of numbers or nulls, got 7"):
        from_record({"convention": "standard", "rows": [(0, 0, 0, 0)], "limits": 7})


JUNK = st.one_of(
    st.none(), st.booleans(), st.floats(), st.integers(), st.text(max_size=3), st.lists(st.floats(), max_size=5)
)


@settings(max_examples=200, deadline=None)
@given(
    st.one_of(
        JUNK,
        st.lists(
            st.one_of(JUNK, st.dictionaries(st.sampled_from(["a", "alpha", "d", "theta", "sign", "type", "x"]), JUNK)),
            max_size=4,
        ),
    )
)
def test_any_junk_is_a_table_or_a_dh_error(rows):
    try:
        table = from_rows(rows)
    except DhError:
        return
    assert all(np.isfinite([row.a, row.alpha, row.d, row.theta]).all() for row in table.rows)


@pytest.mark.parametrize("name", ["ur5e", "kuka_youbot", "kinova_gen3_7dof"])
def test_records_survive_json(name):
    for convention in CONVENTIONS:
        table = as_dh(chain(name), convention=convention)
        back = from_record(json.loads(json.dumps(as_record(table), allow_nan=False)))
        assert back.rows == table.rows
        for key in ("T_base", "T_tool", "limits", "max_velocity", "max_effort", "coupling", "amplification"):
            np.testing.assert_array_equal(getattr(back, key), getattr(table, key))
        assert (back.name, back.base, back.tip, back.joint_names) == (
            table.name,
            table.base,
            table.tip,
            table.joint_names,
        )


def test_tables_print():
    text = str(as_dh(chain("kuka_youbot")))
    assert "kuka_youbot, standard DH" in text
    assert "-12.5 + q" in text
    assert "T_base" in text
    assert "beta [deg]" in str(as_dh(chain("ur5e"), convention="hayati"))
    slide = from_rows([{"type": "prismatic", "sign": -1, "d": 0.2}, {"type": "fixed", "a": 0.1}])
    assert "0.2 - q" in str(slide)
    assert "fixed" in str(slide)
