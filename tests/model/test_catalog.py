"""The built-in robots: what is on record, and that its numbers give the reference poses."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from pieper.errors import UnknownNameError
from pieper.model import catalog
from tests.reference.product_of_exponentials import fk
from tests.robots import NAMES, ROBOTS, chain

GOLDEN = Path(__file__).parents[1] / "golden"
SAME_POSE = 1e-12  # [m, -]: a dozen products of numbers of a few metres, rounded in double
HALF_TURN_Z = np.diag([-1.0, -1.0, 1.0, 1.0])


def pose_of_row(row: dict[str, str]) -> np.ndarray:
    x, y, z, w = (float(row[key]) for key in ("qx", "qy", "qz", "qw"))
    T = np.eye(4)
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    T[:3, 3] = [float(row[key]) for key in ("px", "py", "pz")]
    return T


def five_of_six(theta: np.ndarray) -> np.ndarray:
    """The six joints of the MH12 from the report's five angles: joint_4_r held, joint_5_b inverted."""
    return np.array([theta[0], theta[1], theta[2], 0.0, -theta[3], theta[4]])


def test_list_is_complete():
    assert catalog.names() == tuple(sorted(NAMES))


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_names_and_aliases(robot):
    assert chain(robot.name).dof == robot.dof
    for typed in (robot.name, robot.name.upper(), robot.name.replace("_", "-"), *robot.aliases):
        assert catalog.find(typed) == robot.name


def test_aliases_are_unambiguous():
    assert not set(catalog.ALIASES) & set(catalog.names())
    assert set(catalog.ALIASES) == {alias for robot in ROBOTS for alias in robot.aliases}


def test_unknown_name_lists_near_matches():
    with pytest.raises(UnknownNameError, match=r"no robot 'ur5x'; did you mean 'ur5' or .*robots are: .*yaskawa_mh12"):
        catalog.describe("ur5x")


@pytest.mark.parametrize("name", NAMES)
def test_record_tells_source_and_licence(name):
    record = catalog.record(name)
    assert record["name"] == name
    assert record["source"]["licence"]
    assert "document" in record["source"] or {"repository", "commit", "file"} <= record["source"].keys()
    record["source"]["licence"] = "changed"
    assert catalog.record(name)["source"]["licence"] != "changed"  # every call gives a fresh copy
    json.dumps(record, allow_nan=False)


def test_literal_and_nominal_angles():
    literal, nominal = chain("ur5e"), chain("ur5e", nominal=True)
    # the source prints 1.570796327 for the shoulder
    assert 1e-10 < np.abs(literal.screws - nominal.screws).max() < 1e-9
    w = nominal.screws[:, 3:]
    assert np.array_equal(w[1], w[2])
    assert np.array_equal(w[2], w[3])
    assert w[0] @ w[1] == 0.0


def test_limits_that_a_source_leaves_out_are_infinite():
    assert np.isinf(chain("kinova_gen3_7dof").limits[0]).all()
    assert np.isinf(chain("puma560").max_velocity).all()


def test_extra_facts_are_kept():
    assert catalog.record("puma560")["named_configurations"]["qn"][1] == np.pi / 4
    assert len(catalog.record("kr210")["scene"]["shelf_slots_xyz"]) == 9
    assert catalog.record("kr210")["gripper"]["right"]["axis"] == [0, 1, 0]
    assert catalog.record("youbot")["mounts"]["on_mobile_base"] == [0.143, 0.0, 0.046]
    assert catalog.record("mh12")["opw"]["signs"] == [1, 1, -1, -1, -1, -1]
    assert catalog.record("mh12")["extra_frames"]["base"]["xyz"] == [0.0, 0.0, 0.45]


@pytest.mark.parametrize("name", [name for name in NAMES if name != "mh12-report"])
def test_reference_poses(name):
    with (GOLDEN / "fk.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["robot"] == name]
    assert len(rows) == 21
    for row in rows:
        q = [float(row[f"q{i + 1}"]) for i in range(chain(name).dof)]
        assert np.abs(fk(chain(name), q) - pose_of_row(row)).max() < SAME_POSE


def test_row_b8_screws_equal_the_urdf_chain():
    """Row B8: five screws with exact points, joint_5_b inverted, tool axes turned by pi about z."""
    points = [(0, 0, 0.45), (0.155, 0, 0.45), (0.155, 0, 1.064), (0.795, 0, 1.264), (0.795, 0, 1.264)]
    axes = [(0, 0, 1), (0, 1, 0), (0, -1, 0), (0, 1, 0), (-1, 0, 0)]
    from pieper.model.poe import from_screws, revolute

    home = np.array([[0.0, 0.0, 1.0, 0.895], [0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 1.264], [0.0, 0.0, 0.0, 1.0]])
    exact = from_screws(revolute(axes, points), home)
    arm = chain("yaskawa_mh12", nominal=True)
    rng = np.random.default_rng(8)
    for theta in rng.uniform(-3.0, 3.0, (200, 5)):
        T = fk(arm, five_of_six(theta)) @ HALF_TURN_Z
        assert np.abs(fk(exact, theta) - T).max() < 5e-15  # a few units of rounding at 1.5 m
    golden = yaml.safe_load((GOLDEN / "mh12_seed.yaml").read_text())["five_joint_poe"]
    for case in golden:
        assert np.abs(fk(exact, case["theta"]) - case["T_exact_constants"]).max() < SAME_POSE
        T = fk(arm, case["urdf_joints"]) @ HALF_TURN_Z
        assert np.abs(T - case["T_exact_constants"]).max() < SAME_POSE


def test_row_m1_report_constants_and_what_they_cost():
    """Row M1: the report's constants reproduce its own poses, and miss the arm by 2.6e-4 m in the mean."""
    report, arm = chain("mh12-report"), chain("yaskawa_mh12", nominal=True)
    for case in yaml.safe_load((GOLDEN / "mh12_seed.yaml").read_text())["five_joint_poe"]:
        assert np.abs(fk(report, case["theta"]) - case["T_seed_constants"]).max() < SAME_POSE
    rng = np.random.default_rng(1)
    q = rng.uniform(report.limits[:, 0], report.limits[:, 1], (400, 5))
    errors, turns = [], []
    for theta in q:
        T, T_exact = fk(report, theta), fk(arm, five_of_six(theta)) @ HALF_TURN_Z
        errors.append(np.linalg.norm(T[:3, 3] - T_exact[:3, 3]))
        turns.append(np.linalg.norm(T[:3, :3] - T_exact[:3, :3]) / np.sqrt(2.0))
    assert 2.4e-4 < np.mean(errors) < 2.9e-4
    assert min(errors) > 1e-4
    assert max(errors) < 4.5e-4
    np.testing.assert_allclose(turns, 4.27e-4, rtol=2e-3)
    np.testing.assert_allclose(np.linalg.norm(report.home[:3, 3] - [0.895, 0.0, 1.264]), 3.19e-4, rtol=2e-3)


def test_row_m2_report_directions():
    """Row M2: s4 is the negative of joint_5_b, the other directions agree."""
    report, arm = chain("mh12-report").screws[:, 3:], chain("yaskawa_mh12", nominal=True).screws[[0, 1, 2, 4, 5], 3:]
    assert np.array_equal(report, arm * np.array([1.0, 1.0, 1.0, -1.0, 1.0])[:, None])


def test_dh_tables_on_record():
    assert set(catalog.dh_tables("kr210")) == {"report"}
    assert catalog.dh_tables("ur5e") == {}
    table = catalog.dh_tables("puma")["source"]
    assert table.limits[0].tolist() == pytest.approx([-2.792526803190927, 2.792526803190927])


def test_a_light_import():
    """Loading a built-in robot needs NumPy alone."""
    import subprocess
    import sys

    code = "import sys; from pieper.model import catalog; catalog.describe('ur5e').chain(); print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"scipy", "yaml", "sympy", "pinocchio"} & set(loaded)
