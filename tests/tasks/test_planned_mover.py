"""The mover that plans: ways that touch nothing by MuJoCo's own account, straight lines, limits of jerk, and what it cannot do, in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pieper.errors import MotionError, UnknownNameError
from pieper.model.description import Box

pytest.importorskip("mujoco", reason="mujoco is not installed")
pytest.importorskip("coal", reason="coal is not installed")
pytest.importorskip("ompl", reason="ompl is not installed")
pytest.importorskip("ruckig", reason="ruckig is not installed")

import mujoco

from pieper.motion.limits import JointLimits
from pieper.motion.timing import usage
from pieper.sim.mujoco_arm import axis_name
from pieper.sim.scene import Scene, SceneObject, at
from pieper.tasks import pick_tasks
from pieper.tasks.mover import DirectMover
from pieper.tasks.pick import PickAndPlace, chosen_planner

ON_LINE = 2e-6  # [m] between poses that are 5 mm apart
LIMITS = 1.0 + 1e-6  # of velocity, acceleration and jerk
SAME_PLACE = 1e-6  # [m]; MuJoCo keeps orientations of fixed bodies in single steps of rounding


@pytest.fixture(scope="module")
def runs():
    return {name: PickAndPlace(pick_tasks.task(name), planner="rrt") for name in ("kr210", "ur10e", "youbot")}


def touched(robot, q):
    """What the arm touches at joint values, as MuJoCo sees it; things stay."""
    for axis, value in enumerate(robot.chain.coupling @ q):
        robot.data.joint(axis_name(axis)).qpos = value
    mujoco.mj_forward(robot.model, robot.data)
    return robot.collisions()


def walled(task, *walls):
    return replace(task, scene=Scene((*task.scene.objects, *walls), task.scene.cameras, floor=task.scene.floor))


@pytest.mark.parametrize("name", ["kr210", "ur10e", "youbot"])
def test_ways_touch_nothing_and_keep_every_limit(runs, name):
    run = runs[name]
    task, mover = run.task, run.mover
    limits = JointLimits.of(task.arm.chain)
    for target in task.targets[::4]:
        T_grasp = task.grasp_at(task.scene.object(target).T_world_object)
        way = mover.plan(task.q_home, task.back(T_grasp, task.approach + task.clearance))
        on = mover.plan(way.q[-1], task.back(T_grasp, task.approach))
        for move in (way, on):
            assert max(usage(move, limits)[:3]) <= LIMITS
            assert not move.dq[[0, -1]].any()
            for q in move.sample(np.linspace(0.0, move.duration, 60)).q:
                assert not touched(run.robot, q), target
    T_tip = task.arm.fk(on.q[-1])
    np.testing.assert_allclose(T_tip[:3, 3], task.back(T_grasp, task.approach)[:3, 3], atol=1e-9)


@pytest.mark.parametrize("name", ["kr210", "youbot"])
def test_a_line_is_straight_and_keeps_every_limit(runs, name):
    run = runs[name]
    task = run.task
    run._target = task.targets[0]  # what it reaches for is left out
    T_grasp = task.grasp_at(task.scene.object(task.targets[0]).T_world_object)
    T_pre = task.back(T_grasp, task.approach)
    start = run.mover.plan(task.q_home, T_pre).q[-1]
    line = run.mover.line(start, T_grasp)
    Ts = task.arm.fk(line.sample(np.linspace(0.0, line.duration, 300)).q)
    along = (T_grasp - T_pre)[:3, 3] / np.linalg.norm((T_grasp - T_pre)[:3, 3])
    off = Ts[:, :3, 3] - T_pre[:3, 3]
    assert np.linalg.norm(off - (off @ along)[:, None] * along, axis=1).max() < ON_LINE
    np.testing.assert_allclose(Ts[-1][:3, 3], T_grasp[:3, 3], atol=1e-9)
    ahead = task.gripper.T_tip_grasp[:3, 2]
    np.testing.assert_allclose(Ts[-1][:3, :3] @ ahead, T_grasp[:3, :3] @ ahead, atol=1e-9)
    assert max(usage(line, JointLimits.of(task.arm.chain))[:3]) <= LIMITS
    still = run.mover.line(start, task.arm.fk(start))
    assert still.duration == 0.0


def test_the_gripper_of_the_plan_is_that_of_the_physics(runs):
    run = runs["kr210"]
    robot, task = run.robot, run.task
    q = np.array([0.3, -0.2, 0.1, 0.4, -0.5, 0.6])
    touched(robot, q)
    planned = {name: (solid, T) for name, solid, T in run.collision_model(0.01).solids(q)}
    for name in task.gripper.solids():
        geom = robot.data.geom(name)
        solid, T = planned[f"gripper/{name}"]
        np.testing.assert_allclose(geom.xpos, T[:3, 3], atol=SAME_PLACE)
        np.testing.assert_allclose(geom.xmat.reshape(3, 3), T[:3, :3], atol=SAME_PLACE)
        size = robot.model.geom(name).size
        wanted = 0.5 * solid.size if isinstance(solid, Box) else [solid.radius, 0.5 * solid.length, 0.0]
        np.testing.assert_allclose(size, wanted, atol=1e-12)


def test_where_straight_ways_are_blocked_it_searches_and_finds_the_same_way_again(runs):
    task = runs["kr210"].task
    wall = SceneObject("wall", Box([1.5, 0.1, 2.6]), at(1.9, 1.1, 1.3))
    task = walled(replace(task, postures=()), wall)
    goal = task.drop_of("can 5")
    q = np.array([0.0, 0.0, 0.0, 0.0, -0.6, 0.0])
    ways = []
    for _ in range(2):
        run = PickAndPlace(task, planner="rrt", seed=3)
        plain = DirectMover(task.arm, blocked=run.blocked)
        with pytest.raises(MotionError, match=r"no free way to .* answers, straight or by way of 0 postures"):
            plain.plan(q, goal)
        ways.append(run.mover.plan(q, goal))
    np.testing.assert_array_equal(ways[0].q, ways[1].q)
    np.testing.assert_array_equal(ways[0].t, ways[1].t)
    for state in ways[0].sample(np.linspace(0.0, ways[0].duration, 200)).q:
        assert not touched(run.robot, state)


def test_what_can_not_be_planned_says_why(runs):
    run = runs["kr210"]
    task, mover = run.task, run.mover
    run._target = "can 1"
    inside = np.array(task.grasp_at(task.scene.object("can 1").T_world_object))
    inside[2, 3] = 0.66  # into the board
    with pytest.raises(MotionError, match=r"none of \d+ answers at the goal is free: .* inside (shelf|can)"):
        mover.plan(task.q_home, inside)
    with pytest.raises(MotionError, match="no joint values bring the tip to"):
        mover.plan(task.q_home, at(9.0, 0.0, 0.5))
    free = task.back(task.grasp_at(task.scene.object("can 5").T_world_object), 0.7)
    with pytest.raises(MotionError, match="the motion cannot go on from any of the joint values"):
        mover.plan(task.q_home, free, lambda q: False)
    run._target = "can 5"
    start = mover.plan(task.q_home, task.back(task.grasp_at(task.scene.object("can 5").T_world_object), 0.2)).q[-1]
    into = np.array(task.arm.fk(start))
    into[2, 3] -= 0.4  # down, into the board below
    into[0, 3] += 0.2
    with pytest.raises(MotionError, match=r"the straight line is not free after 0\.\d+ of .* m: .* shelf/board"):
        mover.line(start, into)
    away = np.array(task.arm.fk(start))
    away[0, 3] += 3.0
    with pytest.raises(MotionError, match="the straight line breaks"):
        mover.line(start, away)


def test_a_search_can_be_cancelled(runs):
    task = walled(replace(runs["kr210"].task), SceneObject("wall", Box([1.5, 0.1, 2.6]), at(1.9, 1.1, 1.3)))
    run = PickAndPlace(task, planner="rrt")
    asked = []

    def enough():
        asked.append(1)
        return len(asked) > 10

    run.mover.cancelled = enough
    with pytest.raises(MotionError, match="cancelled"):
        run.mover.plan(np.array([0.0, 0.0, 0.0, 0.0, -0.6, 0.0]), task.drop_of("can 5"))
    assert len(asked) < 30


def test_planners_by_name():
    assert chosen_planner() == "rrt"
    with pytest.raises(UnknownNameError, match="no planner 'rrtt'; did you mean 'rrt'"):
        chosen_planner("rrtt")
