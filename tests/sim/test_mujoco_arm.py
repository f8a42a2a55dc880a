"""An arm as a MuJoCo model: its poses, masses and drives, over every robot; truth from Pinocchio."""

from __future__ import annotations

import numpy as np
import pytest

import pieper
from pieper.model.description import Inertial
from tests import robots

pytest.importorskip("mujoco", reason="mujoco is not installed")

import mujoco

from pieper.sim.mujoco_arm import FORCE_RESERVE, axis_limits, axis_name, body_name, build_arm, is_possible

ROUNDING = 1e-9  # [m, -] what is asked; 5e-15 is measured
SAME_ARITHMETIC = 1e-9  # relative: two libraries add the same products in another order

HEAVY = """<robot name="heavy">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.1 0 0.05" rpy="0.2 0.1 0"/><mass value="4.0"/>
    <inertia ixx="0.05" ixy="0.002" ixz="0.001" iyy="0.06" iyz="0.003" izz="0.04"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.2 0.02 0"/><mass value="2.0"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
  <link name="hand"><inertial><origin xyz="0 0 0.03"/><mass value="0.5"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.0008"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.3" rpy="0.1 0 0.3"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2" effort="100"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><origin xyz="0.4 0 0" rpy="0 0.2 0"/>
    <axis xyz="0 0.6 0.8"/></joint>
  <joint name="slide" type="prismatic"><parent link="lower"/><child link="hand"/><origin xyz="0.3 0 0"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.4" velocity="0.5" effort="50"/></joint>
</robot>"""

GEARED = """<robot name="geared">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/>
  <joint name="lead" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/><origin xyz="0 0 0.2"/>
    <limit lower="-1" upper="1" velocity="2" effort="10"/></joint>
  <joint name="follow" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/><origin xyz="0.3 0 0"/>
    <limit lower="-3" upper="3" velocity="4" effort="10"/><mimic joint="lead" multiplier="-1.5"/></joint>
  <joint name="last" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/><origin xyz="0.25 0 0"/>
    <limit lower="-2" upper="2" velocity="2" effort="10"/></joint>
</robot>"""


def compiled(arm):
    spec, drives = build_arm(arm)
    model = spec.compile()
    return model, mujoco.MjData(model), drives


def random_joints(chain, rng, count):
    return rng.uniform(*np.clip(chain.limits, -6.0, 6.0).T, (count, chain.dof))


def place(arm, model, data, q):
    for axis, value in enumerate(arm.chain.coupling @ q):
        data.joint(axis_name(axis)).qpos[0] = value
    mujoco.mj_kinematics(model, data)


@pytest.mark.parametrize("name", robots.NAMES)
def test_poses_are_those_of_forward_kinematics(name):
    arm = pieper.load(name)
    model, data, _ = compiled(arm)
    axes = len(arm.chain.screws)
    for q in random_joints(arm.chain, np.random.default_rng(1), 20):
        place(arm, model, data, q)
        wanted = arm.fk_frames(q, frames=range(axes + 1))
        for link in range(axes + 1):
            body = data.body(body_name(link))
            np.testing.assert_allclose(body.xpos, wanted[link, :3, 3], atol=ROUNDING)
            np.testing.assert_allclose(body.xmat.reshape(3, 3), wanted[link, :3, :3], atol=ROUNDING)
        np.testing.assert_allclose(data.site("tip").xpos, arm.fk(q)[:3, 3], atol=ROUNDING)
        np.testing.assert_allclose(data.site("tip").xmat.reshape(3, 3), arm.fk(q)[:3, :3], atol=ROUNDING)


@pytest.mark.parametrize("text", [HEAVY, GEARED])
def test_sliding_continuous_and_mimic_joints(text):
    arm = pieper.load(text)
    model, data, _ = compiled(arm)
    for q in random_joints(arm.chain, np.random.default_rng(2), 20):
        place(arm, model, data, q)
        np.testing.assert_allclose(data.site("tip").xpos, arm.fk(q)[:3, 3], atol=ROUNDING)


def test_a_tool_and_a_base_move_the_model_too():
    T = np.eye(4)
    T[:3, 3] = [0.1, -0.2, 0.3]
    arm = pieper.load("ur5e").with_tool(T).with_base(T)
    model, data, _ = compiled(arm)
    q = np.array([0.3, -1.0, 1.0, 0.2, 0.5, 0.1])
    place(arm, model, data, q)
    np.testing.assert_allclose(data.site("tip").xpos, arm.fk(q)[:3, 3], atol=ROUNDING)


def test_described_masses_give_the_mass_matrix_of_pinocchio():
    import pinocchio as pin

    arm = pieper.load(HEAVY)
    model, data, _drives = compiled(arm)
    truth = pin.buildModelFromXML(HEAVY)
    rng = np.random.default_rng(3)
    full = np.zeros((3, 3))
    for q in random_joints(arm.chain, rng, 10):
        place(arm, model, data, q)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fullM(model, data, full)
        wanted = pin.crba(truth, truth.createData(), np.array([q[0], np.cos(q[1]), np.sin(q[1]), q[2]]))
        wanted = np.triu(wanted) + np.triu(wanted, 1).T + np.diag(model.dof_armature)
        np.testing.assert_allclose(full, wanted, rtol=SAME_ARITHMETIC, atol=SAME_ARITHMETIC)


@pytest.mark.parametrize("name", robots.NAMES)
def test_masses_and_drives_are_sensible(name):
    arm = pieper.load(name)
    model, _, drives = compiled(arm)
    from pieper.motion.limits import JointLimits

    length = np.linalg.norm(np.diff([f.home[:3, 3] for f in arm.chain.frames], axis=0), axis=1).sum()
    assert 1.0 < model.body_mass.sum() / length**3 < 500.0  # kg/m^3; wide: a wrong unit is off by a thousand
    assert (model.body_mass[1:] > 0.0).all()
    moments = np.sort(model.body_inertia[2:], axis=1)  # without the world and the base
    assert (moments[:, 0] > 0.0).all()
    assert (moments[:, 2] <= moments[:, :2].sum(axis=1) * (1.0 + 1e-9)).all()
    needed = FORCE_RESERVE * drives.inertia * (np.abs(arm.chain.coupling) @ JointLimits.of(arm.chain).acceleration)
    assert (drives.effort >= needed * (1.0 - 1e-9)).all()


def test_axis_ranges_follow_the_coupling():
    chain = pieper.load(GEARED).chain
    np.testing.assert_allclose(axis_limits(chain), [[-1.0, 1.0], [-1.5, 1.5], [-2.0, 2.0]])


@pytest.mark.parametrize(
    ("mass", "moments", "possible"),
    [
        (1.0, [1, 1, 1], True),
        (1.0, [1, 1, 2.5], False),
        (0.0, [1, 1, 1], False),
        (1.0, [0, 1, 1], False),
        (-1.0, [1, 1, 1], False),
    ],
)
def test_impossible_inertia_is_seen(mass, moments, possible):
    assert is_possible(Inertial(mass, np.eye(4), np.diag(np.array(moments, dtype=float)))) is possible


def test_impossible_inertia_is_replaced_by_that_of_the_solids():
    arm = pieper.load(HEAVY.replace('izz="0.02"', 'izz="0.2"'))
    model, _, _ = compiled(arm)
    assert (model.body_mass[1:] > 0.0).all()
    assert model.body(body_name(1)).mass[0] != 4.0
