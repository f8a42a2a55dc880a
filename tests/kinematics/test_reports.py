"""What the source reports print about forward kinematics and Jacobians, row by row."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

import pieper
from pieper.model import catalog
from pieper.model.dh import forward_kinematics
from pieper.spatial import rotation

GOLDEN = Path(__file__).parents[1] / "golden"
STATED = 1e-9  # the tolerance stated with the vectors
SAME_POSE = 1e-12
UR = yaml.safe_load((GOLDEN / "ur_seed.yaml").read_text())
UR_Q = UR["tcp_at_given_q"]["q"]
UR_TYPES = tuple(UR["tcp_at_given_q"]["tool0"])


@pytest.mark.parametrize("ur_type", UR_TYPES)
def test_row_e1_every_universal_robot_loads_and_has_its_own_pose(ur_type):
    expected = UR["tcp_at_given_q"]["tool0"][ur_type]
    T = pieper.load(ur_type).fk(UR_Q)
    assert np.abs(T[:3, 3] - expected["position"]).max() < STATED
    assert np.abs(T[:3, :3] - rotation.from_quaternion(expected["quaternion_xyzw"])).max() < STATED


def test_row_e1_the_types_differ():
    positions = np.array([pieper.load(t).fk(UR_Q)[:3, 3] for t in UR_TYPES])
    assert set(UR_TYPES) >= {"ur3", "ur3e", "ur5", "ur5e", "ur10", "ur10e", "ur16e", "ur20"}
    gaps = np.linalg.norm(positions[:, None] - positions[None], axis=-1) + np.eye(len(positions))
    assert gaps.min() > 0.01


def test_row_e4_six_joint_names_in_order():
    assert pieper.load("ur5e").joint_names == (
        "shoulder_pan_joint",
        "shoulder_lift_joint",
        "elbow_joint",
        "wrist_1_joint",
        "wrist_2_joint",
        "wrist_3_joint",
    )


def test_row_e5_pose_at_the_given_configuration():
    T = pieper.load("ur5e").fk([-1.28, 4.41, 1.54, -1.16, -1.56, 0.0])
    assert T[:3, 3].round(9).tolist() == [0.224996413, -0.2831201, 0.589463254]
    assert rotation.as_quaternion(T[:3, :3]).round(9).tolist() == [0.144568002, -0.988719338, -0.039167378, 0.000283741]


def test_row_e6_jacobian_at_the_given_configuration():
    assert np.abs(pieper.load("ur5e").jacobian(UR_Q) - UR["ur5e_jacobian_at_q"]).max() < STATED


def test_row_u2_base_to_tip_is_not_tip_to_base():
    T = pieper.load("ur5e").fk(UR_Q)
    point, direction = np.array([0.1, 0.2, 0.3, 1.0]), np.array([0.0, 0.0, 1.0, 0.0])
    assert np.abs((T @ point)[:3] - (T[:3, :3] @ point[:3] + T[:3, 3])).max() < SAME_POSE
    assert np.abs((T @ direction)[:3] - T[:3, 2]).max() < SAME_POSE  # a free vector takes 0 and is not moved
    assert np.abs(np.linalg.inv(T) - T).max() > 0.1


def test_row_c3_poses_of_link_6_and_gripper():
    """The readout for link_6 and gripper_link, against the report's own modified DH table and R_corr."""
    arm, table = pieper.load("kr210"), catalog.dh_tables("kr210")["report"]
    assert {"link_6", "gripper_link"} <= set(arm.frame_names)
    rng = np.random.default_rng(3)
    for q in rng.uniform(arm.limits[:, 0], arm.limits[:, 1], (50, 6)):
        T_gripper, T_link_6 = arm.fk(q), arm.fk(q, up_to="link_6")
        assert np.abs(T_gripper - forward_kinematics(table, q)).max() < SAME_POSE
        # both frames share their axes; the gripper is 0.11 m further along x
        ahead = np.eye(4)
        ahead[0, 3] = 0.11
        assert np.abs(T_link_6 @ ahead - T_gripper).max() < SAME_POSE
    assert arm.fk([0.0] * 6)[:3, 3].round(6).tolist() == [2.153, 0.0, 1.946]


def test_row_d11_advice_on_representations_is_written():
    page = (Path(__file__).parents[2] / "docs" / "guides" / "rotations.md").read_text()
    for word in ("quaternion", "rotation vector", "memory", "phone", "SVD", "eigen"):
        assert word.lower() in page.lower()
