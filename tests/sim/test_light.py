"""Light in a scene: what it does to a picture, and that it leaves the motion alone."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="mujoco is not installed")

import pieper
from pieper.errors import ArrayError
from pieper.model.description import Box, Cylinder
from pieper.sim.light import SceneLight
from pieper.sim.physics import MujocoSimulator
from pieper.sim.scene import Scene, SceneCamera, SceneObject, at
from pieper.sim.scene_view import SceneView


@pytest.fixture(scope="module")
def robot():
    things = (SceneObject("post", Cylinder(0.1, 0.8), at(4.0, 0.0, 0.4)),)
    return MujocoSimulator(
        pieper.load("ur5e"), scene=Scene(things, (SceneCamera.looking("eye", [4.0, -1.0, 3.0], [4.0, 0.0, 0.0]),))
    )


def picture(robot, **light):
    SceneLight(**light).shine(robot)
    with SceneView(robot, size=(160, 120)) as view:
        return view.image().astype(float)


@pytest.mark.usefixtures("can_draw")
def test_stronger_and_coloured_light_is_seen(robot):
    dim, bright = (picture(robot, strength=s, ambient=0.2, shadows=False) for s in (0.1, 0.4))
    assert bright.mean() > 1.3 * dim.mean()
    red = picture(robot, strength=0.3, ambient=0.2, tint=[1.0, 0.5, 0.5])
    assert red[..., 0].mean() > 1.5 * red[..., 2].mean()


@pytest.mark.usefixtures("can_draw")
def test_shadows_fall_away_from_the_lamp(robot):
    east, west, none = (
        picture(robot, direction=[x, 0.0, -1.0], strength=0.5, ambient=0.2, shadows=shadows)
        for x, shadows in ((0.8, True), (-0.8, True), (0.8, False))
    )
    dark = none - east
    assert dark[:, 90:].mean() > 5 * abs(dark[:, :60].mean())
    assert (none - west)[:, :70].mean() > 5 * abs((none - west)[:, 100:].mean())


def test_random_light_repeats_and_stays_within_what_is_said():
    lights = [SceneLight.random(np.random.default_rng(k)) for k in range(200)]
    again = SceneLight.random(np.random.default_rng(7))
    assert again.strength == lights[7].strength
    assert np.array_equal(again.tint, lights[7].tint)
    lean = np.degrees([np.arccos(-light.direction[2]) for light in lights])
    assert 40.0 < lean.max() <= 50.0
    strength, ambient = np.array([(light.strength, light.ambient) for light in lights]).T
    assert (strength.min() >= 0.25) & (strength.max() <= 0.8) & (ambient.min() >= 0.25) & (ambient.max() <= 0.6)
    assert abs(np.array([light.tint for light in lights]) - 1.0).max() <= 0.15
    assert 100 < sum(light.shadows for light in lights) < 200


def test_bad_light():
    with pytest.raises(ArrayError, match="direction must be three numbers that are not all 0"):
        SceneLight(direction=[0.0, 0.0, 0.0])
    with pytest.raises(ArrayError, match="tint must be three numbers of 0 or more"):
        SceneLight(tint=[1.0, -1.0, 1.0])
    with pytest.raises(ArrayError, match="strength must be 0 or more and finite, got nan"):
        SceneLight(strength=np.nan)


@pytest.mark.usefixtures("can_draw")
def test_a_picture_is_printed_on_the_upper_side_of_a_box():
    """Rows from +y, columns from -x: red at the corner -x +y, green at +x +y, blue at -x -y."""
    picture = np.zeros((64, 96, 3), np.uint8)
    picture[:32, :48, 0], picture[:32, 48:, 1], picture[32:, :48, 2] = 255, 255, 255
    card = SceneObject("card", Box(np.array([0.9, 0.6, 0.02])), at(3.0, 0.0, 0.5), picture=picture)
    above = SceneCamera("eye", np.array([[1.0, 0, 0, 3.0], [0, -1, 0, 0], [0, 0, -1, 2.0], [0, 0, 0, 1]]))
    robot = MujocoSimulator(pieper.load("ur5e"), scene=Scene((card,), (above,)))
    with SceneView(robot, size=(160, 120)) as view:
        image = view.image()
    assert image[45, 55].argmax() == 0
    assert image[45, 105].argmax() == 1
    assert image[75, 55].argmax() == 2
    assert image[75, 105].max() < 60
    with pytest.raises(
        ArrayError, match=r"the picture of 'can' must be a \(rows, columns, 3\) array of uint8 on a box"
    ):
        SceneObject("can", Cylinder(0.1, 0.2), at(0, 0, 0), picture=picture)
    with pytest.raises(ArrayError, match="on a box, got"):
        SceneObject("card", card.solid, at(0, 0, 0), picture=picture / 255.0)


def test_positions_to_be_drawn_leave_the_robot_where_it_is():
    can = SceneObject("can", Cylinder(0.05, 0.1), at(1.0, 0.0, 0.05), mass=0.5)
    robot = MujocoSimulator(pieper.load("ur5e"), scene=Scene((can,)))
    before = np.array(robot.data.qpos)
    T = at(0.3, 0.4, 0.5, yaw=0.7)
    positions = robot.positions([0.1, -0.2, 0.3, -0.4, 0.5, -0.6], {"can": T})
    assert np.array_equal(robot.data.qpos, before)
    robot.data.qpos[:] = positions
    assert np.allclose(robot.read().q, [0.1, -0.2, 0.3, -0.4, 0.5, -0.6])
    assert np.allclose(robot.pose("can"), T)
