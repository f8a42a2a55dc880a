"""Capsules in boxes, which MuJoCo may not see: the same verdict as Coal's distances, for single solids and for arms among thin boards."""

from __future__ import annotations

import numpy as np
import pytest

import pieper
from pieper.model.description import Box
from pieper.spatial import rotation

pytest.importorskip("mujoco", reason="mujoco is not installed")

import mujoco

from pieper.sim.physics import MARGIN, MujocoSimulator
from pieper.sim.pierced import CapsulesAndBoxes
from pieper.sim.scene import Scene, SceneObject

EDGE = 1e-6  # [m] nearer than this to the margin, rounding decides; Coal iterates to about that


def random_pose(rng, reach):
    T = np.eye(4)
    T[:3, :3] = rotation.from_rotation_vector(rng.normal(size=3) * 2.0)
    T[:3, 3] = rng.uniform(-reach, reach, 3)
    return T


def coal_gap(coal, model, data, capsule, box):
    def placed(geom):
        return coal.Transform3s(data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom])

    radius, half, _ = model.geom_size[capsule]
    shapes = coal.Capsule(float(radius), 2.0 * float(half)), coal.Box(*map(float, 2.0 * model.geom_size[box]))
    result = coal.DistanceResult()
    return coal.distance(shapes[0], placed(capsule), shapes[1], placed(box), coal.DistanceRequest(), result)


@pytest.mark.parametrize("thin", [0.0005, 0.02, 0.3])
def test_near_pairs_are_those_that_coal_measures(thin):
    coal = pytest.importorskip("coal", reason="coal is not installed")
    rng = np.random.default_rng(int(1e4 * thin))
    spec = mujoco.MjSpec()
    for k in range(4):
        body = spec.worldbody.add_body(name=f"capsule{k}")
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[rng.uniform(0.02, 0.1), rng.uniform(0.05, 0.5), 0.0])
    for _ in range(12):
        T = random_pose(rng, 0.7)
        quat = rotation.as_quaternion(T[:3, :3])[[3, 0, 1, 2]]
        spec.worldbody.add_body(pos=T[:3, 3], quat=quat).add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, size=[*rng.uniform(0.05, 0.5, 2), thin]
        )
    model = spec.compile()
    data = mujoco.MjData(model)
    pairs = CapsulesAndBoxes(model)
    met = missed = 0
    for _ in range(80):
        for k in range(4):
            T = random_pose(rng, 0.7)
            data.qpos[7 * k : 7 * k + 7] = [*T[:3, 3], *rotation.as_quaternion(T[:3, :3])[[3, 0, 1, 2]]]
        mujoco.mj_forward(model, data)
        said = {tuple(pair) for pair in pairs.near(data, MARGIN).tolist()}
        contacts = {tuple(sorted(pair)) for pair in model.geom_bodyid[data.contact.geom].tolist()}
        for capsule in range(4):
            for box in range(4, 16):
                gap = coal_gap(coal, model, data, capsule, box)
                bodies = int(model.geom_bodyid[capsule]), int(model.geom_bodyid[box])
                if abs(gap - MARGIN) > EDGE:
                    assert (bodies in said) == (gap < MARGIN), gap
                met += gap < 0.0
                missed += gap < 0.0 and tuple(sorted(bodies)) not in contacts
    assert met > 100
    assert missed > 0 or thin > 0.1  # what MuJoCo does not see is there to be found


def test_a_board_right_through_the_forearm_is_seen():
    arm = pieper.load("ur5e")
    q = np.array([0.3, -1.2, 1.0, 0.0, 0.0, 0.0])
    robot = MujocoSimulator(arm, q=q)
    model, data = robot.model, robot.data
    capsules = [g for g in range(model.ngeom) if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_CAPSULE]
    longest = max(capsules, key=lambda g: model.geom_size[g, 1])
    T = np.eye(4)  # a board square to the capsule, at its middle
    T[:3, :3], T[:3, 3] = data.geom_xmat[longest].reshape(3, 3), data.geom_xpos[longest]
    board = SceneObject("board", Box(np.array([0.3, 0.3, 0.004])), T)
    pierced = MujocoSimulator(arm, q=q, scene=Scene((board,), floor=None))
    assert "would touch board" in pierced.blocked(q)
    assert any("board" in pair for pair in pierced.collisions())
    away = q + np.pi * np.eye(6)[0]
    assert not pierced.blocked(away)
