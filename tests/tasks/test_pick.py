"""Pick and place by contact physics: the stages, recovery, the noise, what cannot be picked, other arms by numbers alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from pieper.errors import ArrayError, MotionError, PieperError, UnknownNameError
from pieper.model.description import Box, Cylinder

pytest.importorskip("mujoco", reason="mujoco is not installed")

from pieper.sim.gripper import GripperState
from pieper.sim.scene import SceneObject, at
from pieper.tasks import pick_tasks
from pieper.tasks.mover import DirectMover, timed
from pieper.tasks.pick import STAGES, PickAndPlace
from pieper.tasks.pick_log import PickLog

GOLDEN = Path(__file__).parents[1] / "golden"
PRINTED = 1e-9  # [m] of the poses on record
ON_LINE = 1e-6  # [m] between the solved poses of a line


def events(run):
    return [(stage.name, stage.outcome) for stage in run.stages]


@pytest.fixture(scope="module")
def kr210():
    return pick_tasks.task("kr210")


# --------------------------------------------------------------------------------------------------------------------
# the KR210 at its shelf


def test_C9_slots_and_drop_are_those_of_the_scene(kr210):
    wanted = yaml.safe_load((GOLDEN / "kr210_pick_place.yaml").read_text())
    reach = [row["gripper_position"] for row in wanted if row["kind"] == "reach"]
    before = [row["gripper_position"] for row in wanted if row["kind"] == "pre_grasp"]
    slots = [kr210.grasp_at(kr210.scene.object(name).T_world_object) for name in kr210.targets]
    np.testing.assert_allclose([T[:3, 3] for T in slots], reach, atol=PRINTED)
    np.testing.assert_allclose([kr210.back(T, kr210.approach)[:3, 3] for T in slots], before, atol=PRINTED)
    drop = next(row for row in wanted if row["kind"] == "drop")
    np.testing.assert_allclose(kr210.T_world_drop[:3, 3], drop["gripper_position"], atol=PRINTED)
    np.testing.assert_allclose(
        [T[:3, :3] for T in [*slots, kr210.T_world_drop]], np.broadcast_to(np.eye(3), (10, 3, 3)), atol=PRINTED
    )


def test_C10_stages_of_a_cycle_are_logged_and_wait_for_states(kr210):
    told = []
    run = PickAndPlace(kr210, seed=3, log=told.append)
    seen = []
    run.robot.observers.append(lambda: seen.append((run.robot.time, run.gripper.state)))
    (cycle,) = run.run(1)
    assert cycle.placed, cycle.reason
    assert events(run) == [(name, "SUCCEEDED") for name in STAGES]
    assert told == run.stages
    assert all(before.end == after.start for before, after in zip(run.stages, run.stages[1:], strict=False))
    # the arm draws back as soon as the gripper says that it holds, and not before
    closed = next(stage for stage in run.stages if stage.name == "close gripper")
    first = next(t for t, state in seen if t > closed.start and state is GripperState.HOLDING)
    assert abs(closed.end - first) < 2 * run.robot.timestep
    p = run.robot.pose("can 1")[:3, 3]
    assert ((kr210.bin_region[0] <= p) & (p <= kr210.bin_region[1])).all()
    assert "cycle 1" in str(told[0])
    assert "SUCCEEDED" in str(told[0])


@pytest.mark.slow
def test_C9_nine_slots_and_one_more(kr210):
    cycles = list(
        PickAndPlace(kr210, seed=1, planner="direct").run(10)
    )  # the one that costs less; the others of this file search
    assert [cycle.target for cycle in cycles] == [*kr210.targets, "can 1"]
    assert sum(cycle.placed for cycle in cycles) == 10, [cycle.reason for cycle in cycles]


def test_places_depend_on_seed_and_cycle_alone(kr210):
    def places(first, seed):
        run = PickAndPlace(kr210, seed=seed)
        run.fill_slots(first)
        return np.array([run.robot.pose(name) for name in kr210.targets])

    one = places(1, 0)
    np.testing.assert_array_equal(one, places(1, 0))
    assert not np.allclose(one, places(10, 0))
    assert not np.allclose(one, places(1, 1))
    slots = np.array([kr210.scene.object(name).T_world_object for name in kr210.targets])
    assert (np.abs(one[:, :2, 3] - slots[:, :2, 3]) <= kr210.position_noise + 1e-3).all()  # and what landing moves
    yaw = np.arctan2(one[:, 1, 0], one[:, 0, 0])
    assert (np.abs(yaw) <= kr210.yaw_noise + 1e-3).all()
    assert np.abs(yaw).max() > 0.3 * kr210.yaw_noise


def test_the_same_seed_gives_the_same_run_to_the_last_bit():
    task = pick_tasks.task("mh12")
    runs = [PickAndPlace(task, seed=6) for _ in range(2)]
    for run in runs:
        assert [cycle.placed for cycle in run.run(1)] == [True]
    assert runs[0].stages == runs[1].stages
    np.testing.assert_array_equal(runs[0].robot.data.qpos, runs[1].robot.data.qpos)


@pytest.mark.parametrize("name", [name for name in pick_tasks.names() if name != "kr210"])
def test_other_arms_by_configuration_only(name):
    run = PickAndPlace(pick_tasks.task(name), seed=2)
    (cycle,) = run.run(1)
    assert cycle.placed, cycle.reason


# --------------------------------------------------------------------------------------------------------------------
# when it goes wrong


def test_a_grasp_that_slips_is_seen_and_tried_again(kr210):
    run = PickAndPlace(kr210, seed=0)
    oiled = []

    def oil():  # once, while the first attempt closes its fingers; dry again when the arm draws back
        names = [stage.name for stage in run.stages]
        if "reach" in names and not oiled:
            oiled.append(run.robot.time)
            run.robot.set_friction("can 1", 0.0)
        elif "recover" in names and len(oiled) == 1:
            oiled.append(run.robot.time)
            run.robot.set_friction("can 1", 0.9)

    run.robot.observers.append(oil)
    (cycle,) = run.run(1)
    failed = next(stage for stage in run.stages if not stage.succeeded)
    assert failed.name in ("close gripper", "retract")
    assert "slipped" in failed.reason or "nothing" in failed.reason
    assert ("recover", "SUCCEEDED") in events(run)
    assert cycle.placed, cycle.reason
    assert cycle.attempts == 2


def test_what_can_not_be_held_is_left_with_the_reason(kr210):
    run = PickAndPlace(kr210, seed=0)
    run.robot.set_friction("can 1", 0.0)
    (cycle,) = run.run(1)
    assert not cycle.placed
    assert cycle.attempts == kr210.attempts or "fallen" in cycle.reason
    assert events(run)[-1] == ("next target", "FAILED")
    assert "can 1 is left" in run.stages[-1].reason
    assert not run.robot.is_moving


def with_target(task, thing):
    return replace(task, scene=task.scene.with_object(thing))


@pytest.mark.parametrize(
    ("solid", "words"),
    [
        (Box([0.1, 0.5, 0.2]), "can 1 is 0.500 m wide, too wide for fingers that open 0.160 m"),
        (Cylinder(0.002, 0.2), "can 1 is 0.004 m wide, too thin"),
    ],
)
def test_things_that_no_gripper_holds_are_refused_before_the_arm_moves(kr210, solid, words):
    T = kr210.scene.object("can 1").T_world_object
    run = PickAndPlace(with_target(kr210, SceneObject("can 1", solid, T, mass=0.5)))
    (cycle,) = run.run(1)
    assert not cycle.placed
    assert words in cycle.reason
    assert ("plan to pre-grasp", "FAILED") in events(run)
    assert "move" not in dict(events(run))


def test_a_thing_out_of_reach_is_refused_by_inverse_kinematics(kr210):
    far = SceneObject("can 1", Cylinder(0.05, 0.3), at(6.0, 0.0, 0.15), mass=0.5)
    run = PickAndPlace(with_target(kr210, far))
    (cycle,) = run.run(1)
    assert ("inverse kinematics", "FAILED") in events(run)
    assert "no joint values bring the tip to" in cycle.reason


@pytest.mark.parametrize(
    ("seen", "words"),
    [
        (None, "can 1 is not seen"),
        (np.full((4, 4), np.nan), r"must be a finite \(4, 4\) array"),
        (np.eye(3), r"must be a finite \(4, 4\) array"),
        (np.diag([1.0, -1.0, -1.0, 1.0]), "has fallen over"),
    ],
)
def test_what_the_camera_cannot_say_is_no_grasp(kr210, seen, words):
    import re

    run = PickAndPlace(kr210, look=lambda name: seen)
    (cycle,) = run.run(1)
    assert not cycle.placed
    assert re.search(words, cycle.reason)


def test_a_planner_that_finds_nothing_fails_its_stage_with_its_reason(kr210):
    class Nothing:
        def plan(self, q_start, T_goal, usable=None):
            raise MotionError("no path in 0.1 s")

        def line(self, q_start, T_goal):
            raise MotionError("no line")

    run = PickAndPlace(kr210, mover=Nothing())
    (cycle,) = run.run(1)
    assert cycle.reason == "no path in 0.1 s"
    assert ("inverse kinematics", "FAILED") in events(run)


@pytest.mark.parametrize("planner", ["direct", "rrt"])
def test_cancelled_at_any_moment_the_arm_rests_within_its_limits(planner):
    """The stage that runs says so, and no cycle follows; moments are spread over a cycle of about 6 s, the first before it begins."""
    if planner == "rrt":
        pytest.importorskip("ompl", reason="ompl is not installed")
    task = pick_tasks.task("mh12")
    lower, upper = task.arm.limits.T
    rng = np.random.default_rng(8)
    for moment in (0.0, *rng.uniform(0.0, 6.0, 4)):
        run = PickAndPlace(task, seed=1, planner=planner)

        def look(run=run, moment=moment):
            if run.robot.time >= moment and not run.cancelled:
                run.cancel()
            q = run.robot.reference.q
            assert ((lower <= q) & (q <= upper)).all()

        run.robot.observers.append(look)
        cycles = list(run.run(3))
        assert all(cycle.placed for cycle in cycles[:-1])
        assert run.robot.at_rest
        assert not run.robot.reference.dq.any()
        if cycles:
            assert (run.stages[-1].succeeded, run.stages[-1].reason) == (False, "cancelled")
            assert (cycles[-1].placed, cycles[-1].reason) == (False, "cancelled")
        assert list(run.run(3)) == []


def test_cancelled_while_it_plans(kr210):
    pytest.importorskip("ompl", reason="ompl is not installed")
    run = PickAndPlace(kr210, planner="rrt")
    planned = run.mover.model

    def model(margin, reaching):
        run.cancel()
        return planned(margin, reaching)

    run.mover.model = model
    (cycle,) = run.run(2)
    assert cycle.reason == "cancelled"
    assert events(run)[-1] == ("inverse kinematics", "FAILED")
    assert run.robot.at_rest


def test_slots_that_never_come_to_rest_are_an_error(kr210, monkeypatch):
    run = PickAndPlace(kr210)
    monkeypatch.setattr(run.robot, "speed", lambda name: 1.0)
    with pytest.raises(PieperError, match="the things in their slots do not come to rest, after 8 s"):
        list(run.run(1))


def test_things_that_begin_inside_each_other_are_an_error(kr210):
    first = kr210.scene.object("can 1")
    twice = replace(kr210, scene=kr210.scene.with_object(replace(first, name="can 2")))
    with pytest.raises(PieperError, match=r"can 1 begins \d+ mm inside can 2: they need places of their own"):
        next(PickAndPlace(twice).run(1))


def test_the_arm_stops_when_it_touches_what_it_should_not(kr210):
    class Blind(DirectMover):
        pass

    pillar = SceneObject("pillar", Box([0.3, 0.3, 3.0]), at(1.7, 1.6, 1.5))
    run = PickAndPlace(with_target(kr210, pillar))
    run.mover = Blind(kr210.arm)
    (cycle,) = run.run(1)
    assert not cycle.placed
    assert "pillar" in cycle.reason


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"approach": -0.1}, "approach must be from 0 to 100, got -0.1"),
        ({"lift": np.nan}, "lift must be from 0 to 100, got nan"),
        ({"targets": ("can 1", "can 2", "can 1")}, "target 'can 1' is named twice"),
        ({"speed": 0.0}, "speed must be above 0"),
        ({"attempts": 0}, "attempts must be 1 or more"),
        ({"targets": ()}, "must name at least one"),
        ({"targets": ("shelf/back",)}, "is fixed; give it a mass"),
        ({"T_world_drop": np.full((4, 4), np.nan)}, "T_world_drop must be finite"),
    ],
)
def test_tasks_that_are_none_are_refused(kr210, change, words):
    with pytest.raises(ArrayError, match=words):
        replace(kr210, **change)


def test_names_that_are_not_there(kr210):
    with pytest.raises(UnknownNameError, match="no object 'cup'"):
        replace(kr210, targets=("cup",))
    with pytest.raises(UnknownNameError, match=r"no pick task 'kr2100'.*did you mean 'kr210'"):
        pick_tasks.task("kr2100")


@pytest.mark.parametrize("cycles", [0, -1, 1.5, True])
def test_a_number_of_cycles_that_is_none(kr210, cycles):
    with pytest.raises(ArrayError, match="cycles must be a whole number of 1 or more"):
        list(PickAndPlace(kr210).run(cycles))


# --------------------------------------------------------------------------------------------------------------------
# the mover


def test_a_line_is_straight_turns_evenly_and_keeps_the_limits(kr210):
    mover = DirectMover(kr210.arm)
    T_goal = kr210.grasp_at(at(2.6, 0.4, 1.4, yaw=0.08))
    T_start = kr210.back(T_goal, 0.3)
    q = mover.answers(T_start, kr210.q_home)[0]
    move = mover.line(q, T_goal)
    sample = move.sample(np.linspace(0.0, move.duration, 500))
    Ts = kr210.arm.fk(sample.q)
    along = T_goal[:3, 3] - T_start[:3, 3]
    off = np.cross(Ts[:, :3, 3] - T_start[:3, 3], along / np.linalg.norm(along))
    assert np.linalg.norm(off, axis=1).max() < ON_LINE
    np.testing.assert_allclose(Ts[-1], T_goal, atol=1e-9)
    assert (np.abs(sample.dq) <= mover.velocity * (1.0 + 1e-6)).all()
    assert (np.abs(sample.ddq) <= mover.acceleration * (1.0 + 1e-6)).all()
    assert not sample.dq[[0, -1]].any()


def test_a_line_that_would_need_another_branch_says_where(kr210):
    mover = DirectMover(kr210.arm)
    q = mover.answers(kr210.grasp_at(at(2.2, 0.0, 1.6)), kr210.q_home)[0]
    with pytest.raises(
        MotionError, match=r"the straight line breaks: at \d.* of 4.4 m: joint .joint_2. is at its limit"
    ):
        mover.line(q, kr210.grasp_at(at(-2.2, 0.0, 1.6)))


def test_timing_touches_the_tightest_limit():
    way = np.linspace([0.0, 0.0], [1.0, 0.2], 12)
    move = timed(way, np.array([1.0, 1.0]), np.array([50.0, 50.0]), ("a", "b"))
    dq = move.sample(np.linspace(0.0, move.duration, 2001)).dq
    assert 0.95 < np.abs(dq).max() <= 1.0


# --------------------------------------------------------------------------------------------------------------------
# log and film


def test_a_log_goes_on_where_it_ends(kr210, tmp_path):
    file = tmp_path / "pick.jsonl"
    run = PickAndPlace(kr210, seed=5)
    (cycle,) = run.run(1)
    PickLog(file, "kr210", 5).add(cycle, run.stages)
    again = PickLog(file, "kr210", 5)
    assert again.done == [cycle]
    with pytest.raises(PieperError, match="with seed 5, not of 'kr210' with seed 6"):
        PickLog(file, "kr210", 6)
    with pytest.raises(PieperError, match="as it was before it was changed, or with another planner"):
        PickLog(file, "kr210", 5, version="another file")
    whole = file.read_text()
    file.write_text(whole + '{"cut')
    with pytest.raises(PieperError, match="line 2, the last one, is cut off; remove it"):
        PickLog(file, "kr210", 5)
    file.write_text(whole + "{}\n")
    with pytest.raises(PieperError, match="line 2 is not cycle 2 of a pick log"):
        PickLog(file, "kr210", 5)
    file.write_text(whole.rstrip("\n"))  # as some editors leave it
    PickLog(file, "kr210", 5).add(cycle._replace(number=2), [])
    assert [done.number for done in PickLog(file, "kr210", 5).done] == [1, 2]


def test_C14_a_run_can_be_filmed(kr210, can_draw, tmp_path, monkeypatch):
    from pieper.sim.scene_view import Recording

    run = PickAndPlace(kr210, seed=0)
    recording = Recording(run.robot, fps=5.0, speed=2.0)
    recording.caption = "KR210"
    (cycle,) = run.run(1)
    # frames, from the beginning on, while the slots are filled too
    assert abs(len(recording.moments) - run.robot.time / 0.4) <= 2
    told = []
    count = recording.save(tmp_path / "pick.gif", size=(160, 120), progress=lambda done, of: told.append((done, of)))
    assert count == len(recording.moments)
    assert told[-1] == (count, count)
    assert (tmp_path / "pick.gif").read_bytes()[:4] == b"GIF8"
    assert recording.moments[-1].caption == "KR210"
    with pytest.raises(ArrayError, match=r"a film must end in"):
        recording.save(tmp_path / "pick.avi")
    monkeypatch.setattr("pieper.sim.film.MOST_FRAMES", count + 1)
    assert not recording.is_full
    run.robot.step(1.0)
    assert len(recording.moments) == count + 1
    assert recording.is_full
    assert cycle.placed
