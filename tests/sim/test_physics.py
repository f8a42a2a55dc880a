"""The simulator with mass: the interface over every robot, rest, limits, contact, the gripper, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pieper
from pieper.errors import ArrayError, MotionError, UnknownNameError
from pieper.model.description import Box, Cylinder, Sphere
from pieper.motion.joint_move import joint_move
from pieper.motion.trajectory import Trajectory
from tests import robots

pytest.importorskip("mujoco", reason="mujoco is not installed")

from pieper.sim.gripper import GripperState, ParallelGripper
from pieper.sim.physics import MujocoSimulator
from pieper.sim.scene import Scene, SceneCamera, SceneObject, at, open_box, shelf, table

TRACKING = 2e-3  # [rad or m] of moves at full speed; the guide states it, 0.3e-3 is usual
SAG = 2e-4  # [rad or m] of an arm that rests, without load
LIMIT = 1e-3  # [rad or m] beyond a joint limit, as measured; the reference never leaves the limits
EMPTY = Scene(floor=None)
GRAVITY = 9.81


def random_joints(chain, rng):
    lower, upper = np.clip(chain.limits, -2.5, 2.5).T
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    return middle + rng.uniform(-0.8, 0.8, chain.dof) * half


@pytest.fixture
def still(monkeypatch):
    """Arms whose links do not touch each other: laws about drives are not about the shapes that chains are given."""
    from pieper.sim import mujoco_arm

    built = mujoco_arm.build_arm

    def without_contact(*arguments, **options):
        spec, drives = built(*arguments, **options)
        for geom in spec.geoms:
            geom.contype = geom.conaffinity = 0
        return spec, drives

    monkeypatch.setattr("pieper.sim.physics.build_arm", without_contact)


# --------------------------------------------------------------------------------------------------------------------
# the interface, over every robot


@pytest.mark.parametrize("name", robots.NAMES)
def test_a_move_is_tracked_and_the_arm_comes_to_rest(name, still):
    arm = pieper.load(name)
    rng = np.random.default_rng(5)
    start, goal = random_joints(arm.chain, rng), random_joints(arm.chain, rng)
    robot = MujocoSimulator(arm, q=start, scene=EMPTY)
    robot.follow(joint_move(arm.chain, start, goal))
    worst = 0.0
    while robot.is_moving:
        state = robot.step(robot.timestep)
        worst = max(worst, float(np.abs(state.q - robot.reference.q).max()))
    assert worst < TRACKING
    robot.settle()
    assert robot.at_rest
    np.testing.assert_allclose(robot.read().q, goal, atol=SAG)


@pytest.mark.parametrize("name", robots.NAMES)
def test_a_stop_at_any_moment_leaves_the_arm_at_rest_within_its_limits(name, still):
    arm = pieper.load(name)
    rng = np.random.default_rng(6)
    lower, upper = arm.limits.T
    for _ in range(3):
        start = random_joints(arm.chain, rng)
        goal = np.where(rng.random(arm.dof) < 0.5, np.clip(upper, -6.0, 6.0), np.clip(lower, -6.0, 6.0))
        robot = MujocoSimulator(arm, q=start, scene=EMPTY)
        move = joint_move(arm.chain, start, goal)
        robot.follow(move)
        robot.step(rng.uniform(0.05, 0.99) * move.duration)
        robot.stop()
        while robot.is_moving:
            robot.step(robot.timestep)
            q = robot.reference.q
            assert ((lower <= q) & (q <= upper)).all()
        robot.settle()
        assert robot.at_rest
        q = robot.read().q
        assert ((lower - LIMIT <= q) & (q <= upper + LIMIT)).all()
        robot.step(0.5)  # what the brake asked for does not go on pulling
        np.testing.assert_allclose(robot.read().q, robot.reference.q, atol=SAG)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_the_reference_keeps_position_velocity_and_acceleration_limits(seed):
    rng = np.random.default_rng(seed)
    arm = pieper.load(("ur5e", "youbot", "kr210")[seed % 3])
    robot = MujocoSimulator(arm, q=random_joints(arm.chain, rng), scene=EMPTY)
    limits, (lower, upper) = robot.limits, arm.limits.T
    before = robot.reference
    for _ in range(3):
        which = rng.integers(3)
        if which == 0:
            robot.command(random_joints(arm.chain, rng))
        elif which == 1:
            robot.command_velocity(rng.uniform(-1.0, 1.0, arm.dof) * limits.velocity)
        else:
            robot.stop()
        for _ in range(int(rng.integers(1, 150))):
            robot.step(robot.timestep)
            now = robot.reference
            assert ((lower <= now.q) & (now.q <= upper)).all()
            assert (np.abs(now.dq) <= limits.velocity * (1.0 + 1e-9)).all()
            rate = np.abs(now.dq - before.dq) / robot.timestep
            assert (rate <= limits.acceleration * (1.0 + 1e-6)).all()
            before = now


def test_a_joint_that_comes_to_its_limit_stops_there_softly():
    arm = pieper.load("kr210")
    robot = MujocoSimulator(arm, scene=EMPTY)
    robot.command_velocity({"joint_1": 1.5})
    robot.step(5.0)
    assert robot.reference.q[0] == arm.limits[0, 1]
    assert robot.reference.dq[0] == 0.0
    assert abs(robot.read().q[0] - arm.limits[0, 1]) < LIMIT


def test_a_command_during_a_move_halts_first_and_then_goes():
    arm = pieper.load("ur5e")
    robot = MujocoSimulator(arm, q=[0.0, -1.5, 1.5, 0.0, 0.0, 0.0], scene=EMPTY)
    robot.command([1.0, -1.5, 1.5, 0.0, 0.0, 0.0])
    robot.step(0.4)
    robot.command({"shoulder_pan_joint": -0.5})
    while robot.is_moving:
        robot.step(0.01)
    robot.settle()
    np.testing.assert_allclose(robot.read().q, [-0.5, -1.5, 1.5, 0.0, 0.0, 0.0], atol=SAG)


def test_the_same_calls_give_the_same_bits_in_steps_of_any_size():
    arm = pieper.load("ur5e")

    def ended(steps):
        robot = MujocoSimulator(arm, q=[0.0, -1.5, 1.5, 0.0, 0.0, 0.0])
        robot.command([0.5, -1.2, 1.2, 0.3, 0.4, -0.2])
        for _ in range(steps):
            robot.step(0.6 / steps)
        return robot.time, robot.read().q

    one, many = ended(1), ended(47)
    assert one[0] == many[0]
    np.testing.assert_array_equal(one[1], many[1])
    np.testing.assert_array_equal(one[1], ended(1)[1])


def test_joints_that_a_mimic_moves_follow_their_leader():
    from tests.sim.test_mujoco_arm import GEARED

    arm = pieper.load(GEARED)
    robot = MujocoSimulator(arm, scene=EMPTY)
    robot.command([0.8, 0.5])
    robot.step(3.0)
    axes = [float(robot.data.joint(f"axis/{k}").qpos[0]) for k in range(3)]
    np.testing.assert_allclose(axes, [0.8, -1.2, 0.5], atol=TRACKING)
    np.testing.assert_allclose(robot.read().q, [0.8, 0.5], atol=TRACKING)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda r: r.command([0.0] * 5), ArrayError, r"q must have shape \(\.\.\., 6\), got \(5,\)"),
        (lambda r: r.command([np.nan] * 6), ArrayError, "q must be finite"),
        (lambda r: r.command([9.0, 0, 0, 0, 0, 0]), MotionError, "outside its limits"),
        (lambda r: r.command({"elbw": 1.0}), UnknownNameError, "elbow_joint"),
        (lambda r: r.command_velocity([9.0, 0, 0, 0, 0, 0]), MotionError, "faster than its limit"),
        (
            lambda r: r.follow(Trajectory([0.0, 1.0], [[1.0] * 6, [0.0] * 6])),
            MotionError,
            "must begin where the arm is",
        ),
        (lambda r: r.step(-0.1), ArrayError, "dt must be from 0 to 3600 s"),
        (lambda r: r.step(float("nan")), ArrayError, "dt must be from 0 to 3600 s"),
        (lambda r: r.step("soon"), ArrayError, "number of seconds"),
        (lambda r: r.pose("cup"), UnknownNameError, "no object 'cup'"),
        (lambda r: r.put("block", np.full((4, 4), np.nan)), ArrayError, "finite"),
        (lambda r: r.put("plate", np.eye(4)), ArrayError, "'plate' is fixed"),
        (lambda r: r.set_friction("block", -1.0), ArrayError, "friction must be 0 or more"),
    ],
)
def test_what_is_refused_changes_nothing(call, error, words):
    things = (
        SceneObject("block", Box([0.1, 0.1, 0.1]), at(0.7, 0, 0.05), mass=1.0),
        SceneObject("plate", Box([0.1, 0.1, 0.01]), at(0, 1, 0.01)),
    )
    robot = MujocoSimulator(pieper.load("ur5e"), q=[0.0, -1.5, 1.5, 0.0, 0.0, 0.0], scene=Scene(things))
    before = robot.data.qpos.copy()
    with pytest.raises(error, match=words):
        call(robot)
    assert not robot.is_moving
    np.testing.assert_array_equal(robot.data.qpos, before)


# --------------------------------------------------------------------------------------------------------------------
# contact


def world(*things, gripper=None, q=(0.0, -2.2, 1.2, -0.57, -np.pi / 2, 0.0)):
    return MujocoSimulator(pieper.load("ur5e"), q=list(q), scene=Scene(things), gripper=gripper)


def test_physics_that_loses_its_way_says_so_and_leaves_no_file(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    arm = pieper.load("ur5e")
    robot = MujocoSimulator(arm, scene=EMPTY, gripper=ParallelGripper(stroke=0.09, force=1e9, reach=0.16))
    robot.gripper.close()
    with pytest.raises(MotionError, match=r"the physics lost its way at .* forces that are far too large"):
        robot.step(2.0)
    assert not list(tmp_path.iterdir())
    assert not capfd.readouterr().err


def test_a_thing_at_rest_stays():
    robot = world(SceneObject("can", Cylinder(0.03, 0.12), at(0.6, 0.4, 0.06), mass=0.3))
    robot.step(3.0)
    p = robot.pose("can")[:3, 3]
    np.testing.assert_allclose(p, [0.6, 0.4, 0.06], atol=1e-3)  # m: contacts give way by tenths of a millimetre
    assert robot.pose("can")[2, 2] > 1.0 - 1e-6
    assert robot.speed("can") < 1e-3


def test_a_dropped_thing_falls_as_it_must_and_lands():
    height, half = 0.5, 0.06
    robot = world(SceneObject("can", Cylinder(0.03, 2 * half), at(0.6, 0.4, height), mass=0.3))
    robot.step(0.2)
    assert (
        abs(height - robot.pose("can")[2, 3] - 0.5 * GRAVITY * 0.2**2) < 0.5 * GRAVITY * 0.2 * robot.timestep * 1.1
    )  # Euler's rule
    robot.step(3.0)
    assert abs(robot.pose("can")[2, 3] - half) < 2e-3
    assert robot.speed("can") < 1e-2


def test_a_ball_does_not_roll_for_ever():
    robot = world(SceneObject("ball", Sphere(0.05), at(0.6, 0.4, 0.05), mass=0.2))
    robot.data.joint("thing/ball").qvel[0] = 0.2
    robot.step(8.0)
    assert robot.speed("ball") < 0.02


HAND = ParallelGripper(stroke=0.09, force=40.0, reach=0.14)


def gripped(friction=0.9, mass=0.4):
    """A block in the hand of an arm that points down."""
    arm = pieper.load("ur5e")
    q = np.array([0.0, -1.6, 1.9, -1.87, -np.pi / 2, 0.0])
    T = arm.fk(q) @ HAND.T_tip_grasp
    block = SceneObject("block", Box([0.05, 0.05, 0.08]), T, mass=mass, friction=friction)
    stand = SceneObject("stand", Box([0.2, 0.2, 0.02]), at(*(T[:3, 3] - [0, 0, 0.0501])))
    robot = MujocoSimulator(arm, q=q, scene=Scene((block, stand)), gripper=HAND)
    robot.gripper.close()
    for _ in range(2000):
        robot.step(robot.timestep)
        if robot.gripper.state is not GripperState.CLOSING:
            break
    return robot


def test_the_gripper_closes_on_nothing_and_says_so():
    robot = world(gripper=HAND)
    assert robot.gripper.state is GripperState.OPEN
    robot.gripper.close()
    robot.step(0.1)
    assert robot.gripper.state is GripperState.CLOSING
    robot.step(1.5)
    assert robot.gripper.state is GripperState.EMPTY
    robot.gripper.open()
    robot.step(0.05)
    assert robot.gripper.state is GripperState.OPENING
    robot.step(1.5)
    assert robot.gripper.state is GripperState.OPEN
    assert abs(robot.gripper.width - HAND.stroke) < 2e-3


def test_a_grasp_holds_while_the_arm_moves_at_full_speed():
    robot = gripped()
    assert robot.gripper.state is GripperState.HOLDING
    assert robot.gripper.touching == {"block"}
    assert abs(robot.gripper.width - 0.05) < 3e-3
    T_tip_block = np.linalg.inv(robot.tip()) @ robot.pose("block")
    q = robot.reference.q.copy()
    for turn in (1.2, -1.2, 0.0):
        goal = q + np.array([turn, -0.4, 0.2, 0.0, 0.0, 2.0 * turn])
        robot.command(goal)
        while robot.is_moving:
            robot.step(robot.timestep)
        assert robot.gripper.state is GripperState.HOLDING
    moved = np.linalg.inv(robot.tip()) @ robot.pose("block")
    assert np.linalg.norm(moved[:3, 3] - T_tip_block[:3, 3]) < 5e-3


def test_without_friction_the_thing_stays_behind_and_the_gripper_knows():
    robot = gripped(friction=0.0)
    robot.command(robot.reference.q + np.array([0.0, -0.5, 0.0, 0.0, 0.0, 0.0]))
    while robot.is_moving:
        robot.step(robot.timestep)
    robot.step(1.0)
    assert robot.gripper.state is GripperState.EMPTY
    assert robot.pose("block")[2, 3] < robot.tip()[2, 3] - HAND.reach


def test_the_force_of_the_fingers_is_limited():
    robot = gripped()
    worst = max(abs(float(robot.data.actuator("finger").force[0])), 0.0)
    assert worst <= 2.0 * HAND.force + 1e-9


def test_what_would_be_touched_is_named():
    wall = SceneObject("wall", Box([0.02, 2.0, 2.0]), at(0.74, 0.0, 1.0))
    robot = world(wall, q=(np.pi, -1.5, 1.5, 0.0, 0.0, 0.0))
    assert robot.blocked(robot.reference.q) == ""
    assert "wall" in robot.blocked([0.0, -0.8, 0.8, 0.0, 0.0, 0.0])
    before = robot.data.qpos.copy()
    robot.blocked([0.0, -0.8, 0.8, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(robot.data.qpos, before)


# --------------------------------------------------------------------------------------------------------------------
# scenes


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: SceneObject("a", Box([0.1, 0.0, 0.1]), np.eye(4)), "sizes of 'a' must be above 0"),
        (lambda: SceneObject("a", Cylinder(np.nan, 0.1), np.eye(4)), "sizes of 'a' must be above 0"),
        (lambda: SceneObject("a", Sphere(0.1), np.eye(4), mass=0.0), "mass of 'a' must be above 0"),
        (lambda: SceneObject("a", Sphere(0.1), np.eye(4), friction=-1.0), "friction of 'a' must be 0 or more"),
        (lambda: SceneObject("a", Sphere(0.1), np.full((4, 4), np.nan)), "T_world_object of 'a' must be finite"),
        (lambda: SceneObject("a", Sphere(0.1), 2.0 * np.eye(4)), "no rotation"),
        (lambda: Scene((SceneObject("a", Sphere(0.1), np.eye(4)),) * 2), "'a' is given twice"),
        (lambda: Scene(floor=np.inf), "floor must be a height"),
        (lambda: SceneCamera.looking("c", [0, 0, 0], [0, 0, 0]), "different points"),
        (lambda: SceneCamera("c", np.eye(4), 4.0), "between 0 and pi"),
        (lambda: ParallelGripper(stroke=-1.0, force=1.0, reach=0.2), "stroke of a gripper must be above 0"),
        (lambda: ParallelGripper(stroke=0.1, force=1.0, reach=0.04), "longer than the pads"),
        (lambda: MujocoSimulator(pieper.load("ur5e"), timestep=1.0), "timestep must be from"),
    ],
)
def test_what_no_world_has_is_refused(make, words):
    with pytest.raises(ArrayError, match=words):
        make()


def test_furniture_stands_where_it_is_put():
    things = (
        *shelf("shelf", x=(0.5, 0.8), edges=(-0.3, 0.3), boards=(0.2,), top=0.6),
        *table("table", center=(0.0, 1.0), size=(0.6, 0.4), height=0.5),
        *open_box("bin", center=(0.0, -1.0), size=(0.4, 0.4, 0.3)),
        SceneObject("on shelf", Sphere(0.03), at(0.65, 0.0, 0.25), mass=0.1),
        SceneObject("on table", Sphere(0.03), at(0.0, 1.0, 0.55), mass=0.1),
        SceneObject("in bin", Sphere(0.03), at(0.0, -1.0, 0.5), mass=0.1),
    )
    robot = world(*things)
    robot.step(3.0)
    heights = [robot.pose(name)[2, 3] for name in ("on shelf", "on table", "in bin")]
    np.testing.assert_allclose(heights, [0.23, 0.53, 0.05], atol=2e-3)


def test_a_camera_sees_the_colour_and_the_distance_of_a_thing(can_draw):
    from pieper.sim.scene_view import SceneView

    eye = SceneCamera.looking("eye", [0.6, 0.4, 1.0], [0.6, 0.4, 0.0])
    robot = MujocoSimulator(
        pieper.load("ur5e"),
        q=[np.pi, -1.5, 1.5, 0.0, 0.0, 0.0],
        scene=Scene(
            (SceneObject("block", Box([0.2, 0.2, 0.2]), at(0.6, 0.4, 0.1), mass=1.0, color="#ff0000"),), (eye,)
        ),
    )
    with SceneView(robot, size=(160, 120)) as view:
        image, depth = view.image(), view.depth()
    assert image.shape == (120, 160, 3)
    red, green, blue = image[60, 80].astype(int)
    assert red > 2 * green
    assert red > 2 * blue
    assert abs(depth[60, 80] - 0.8) < 0.01
    assert abs(depth[5, 5] - 1.0) < 0.02  # the floor: depth is along the axis of the camera
