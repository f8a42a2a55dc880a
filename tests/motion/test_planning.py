"""Plans: free by MuJoCo's word, the same again for the same seed, and every way not to find one with its reason."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import pieper
from pieper.errors import ArrayError, MissingExtraError, MotionError, WorldError
from pieper.ik import target
from pieper.model.chain import Chain
from pieper.model.description import Box, Sphere
from pieper.motion.world import Item, World
from tests.motion.worlds import at, post, states
from tests.robots import NAMES, chain

pytest.importorskip("coal")
pytest.importorskip("ompl")

from pieper.motion.collision import CollisionModel
from pieper.motion.edges import EdgeCheck
from pieper.motion.planning import STATUSES, plan

REACHED = 1e-8  # [m, rad] the solver's own tolerance, and rounding
ENOUGH = 30.0  # [s] a hundred times what any search below takes, so that no test depends on the machine

UR5E = pieper.load("ur5e")
START = np.array([1.2, -1.2, 1.2, -1.6, -1.6, 0.0])
GOAL = np.array([-1.2, -1.2, 1.2, -1.6, -1.6, 0.0])  # on the other side of the post
NARROW = World((*post(), Item("behind", Box([0.1, 1.0, 2.0]), at(-0.45, 0.0, 0.5))))


def judged(model: CollisionModel, path: np.ndarray) -> int:
    """States along the path, 5 mm apart, that touch nothing by MuJoCo's kinematics and geometry."""
    pytest.importorskip("mujoco")
    from benchmarks.shelves import Judge, dense

    judge, rows = Judge(model), dense(path, model, 0.005)
    for row in rows:
        assert not judge.touches(row)
    return len(rows)


def test_straight_where_nothing_is_in_the_way() -> None:
    path = plan(UR5E, START, START + 0.4)
    assert (path.found, path.status, path.reason) == (True, "found", "")
    np.testing.assert_array_equal(path.q, [START, START + 0.4])
    assert path.edges == 1
    assert "path of 2 points" in str(path)


def test_around_an_obstacle_as_mujoco_sees_it() -> None:
    model = CollisionModel(UR5E, NARROW)
    path = plan(model, START, GOAL, timeout=ENOUGH)
    assert path.found
    assert len(path.q) > 2
    np.testing.assert_array_equal(path.q[[0, -1]], [START, GOAL])
    assert judged(model, path.q) > 100
    assert path.kept == pytest.approx(0.005)
    assert not path.q.flags.writeable


def test_the_judge_sees_what_the_straight_way_would_touch() -> None:
    pytest.importorskip("mujoco")
    from benchmarks.shelves import Judge, dense

    model = CollisionModel(UR5E, NARROW)
    judge, rows = Judge(model), dense(np.stack([START, GOAL]), model, 0.01)
    touching = np.array([bool(judge.touches(row)) for row in rows])
    np.testing.assert_array_equal(touching, ~model.with_margin(0.0).is_free(rows))
    assert 0 < touching.sum() < len(rows)


def test_the_same_seed_gives_the_same_path() -> None:
    first, second, other = (plan(UR5E, START, GOAL, world=NARROW, timeout=ENOUGH, seed=s) for s in (3, 3, 4))
    np.testing.assert_array_equal(first.q, second.q)
    assert (first.edges, first.states) == (second.edges, second.states)
    assert other.q.shape != first.q.shape or (other.q != first.q).any()


def test_a_path_is_shortened_and_stays_free() -> None:
    model = CollisionModel(UR5E, NARROW)
    for seed in range(3):
        long = plan(model, START, GOAL, timeout=ENOUGH, seed=seed, simplify=False)
        short = plan(model, START, GOAL, timeout=ENOUGH, seed=seed)
        assert short.length <= long.length + 1e-9
        assert EdgeCheck(model).path_is_free(short.q)


def test_a_pose_is_reached_by_a_free_answer() -> None:
    T = UR5E.fk(GOAL)
    path = plan(UR5E, START, T, world=NARROW, timeout=ENOUGH)
    assert path.found
    np.testing.assert_allclose(UR5E.fk(path.q[-1]), T, atol=REACHED)
    assert len(path.goals) > 1
    assert (path.q[-1] == path.goals[path.goal]).all()
    assert CollisionModel(UR5E, NARROW).is_free(path.goals).all()


def test_the_goal_is_approached_along_its_own_axis() -> None:
    T = at(0.4, -0.35, 0.3, (np.pi, 0.0, 0.0))
    path = plan(UR5E, START, T, world=NARROW, timeout=ENOUGH, approach=[0.0, 0.0, -0.1])
    assert path.found
    np.testing.assert_allclose(UR5E.fk(path.q[-1]), T, atol=REACHED)
    np.testing.assert_allclose(UR5E.fk(path.q[-2]), at(0.4, -0.35, 0.4, (np.pi, 0.0, 0.0)), atol=REACHED)
    s = np.linspace(0.0, 1.0, 50)[:, None]
    tips = UR5E.fk(path.q[-2] + s * (path.q[-1] - path.q[-2]))[:, :3, 3]
    assert np.linalg.norm(tips[:, :2] - T[:2, 3], axis=1).max() < 0.03  # nearly straight
    assert EdgeCheck(CollisionModel(UR5E, NARROW)).path_is_free(path.q)
    assert (path.q[-1] == path.goals[path.goal]).all()


def test_an_approach_that_is_blocked_or_out_of_reach_is_told() -> None:
    T = at(0.4, -0.35, 0.3, (np.pi, 0.0, 0.0))
    lid = World((Item("lid", Box([0.4, 0.4, 0.01]), at(0.4, -0.35, 0.0)), *NARROW))
    blocked = plan(UR5E, START, T, world=lid, approach=[0.0, 0.0, 0.3])
    assert blocked.status == "goal in collision"
    assert blocked.reason.startswith("the approach from 0.3 m before the goal is not free; on it ")
    assert blocked.blocking is not None
    far = plan(UR5E, START, T, world=NARROW, approach=[0.0, 0.0, -2.0])
    assert far.status == "goal out of reach"
    assert far.reason == "the approach from 2 m before the goal is out of reach"
    with pytest.raises(ArrayError, match="approach goes with a goal that is a pose"):
        plan(UR5E, START, GOAL, approach=[0.0, 0.0, -0.1])
    for wrong in ([0.0, 0.0, 0.0], [[0.0, 0.0, 1.0]]):
        with pytest.raises(ArrayError, match=r"approach must be one offset \(3,\)"):
            plan(UR5E, START, T, approach=wrong)


def test_a_target_without_orientation_is_reached() -> None:
    path = plan(UR5E, START, target.ignore_orientation([0.3, 0.4, 0.4]), world=post(), timeout=ENOUGH)
    assert path.found
    np.testing.assert_allclose(UR5E.fk(path.q[-1])[:3, 3], [0.3, 0.4, 0.4], atol=REACHED)


def test_of_several_goals_those_that_can_be_are_aimed_at() -> None:
    blocked = [0.0, -1.2, 1.2, 0.0, 0.0, 0.0]
    beyond = [7.0, -1.2, 1.2, 0.0, 0.0, 0.0]
    path = plan(UR5E, START, [blocked, beyond, START + 0.2], world=post())
    assert path.found
    np.testing.assert_array_equal(path.q[-1], START + 0.2)
    np.testing.assert_array_equal(path.goals, [START + 0.2])


def test_start_and_goal_the_same() -> None:
    path = plan(UR5E, START, START, world=post())
    assert path.found
    np.testing.assert_array_equal(path.q, [START])
    assert path.length == 0.0
    assert path.trajectory(UR5E.chain).duration == 0.0


def test_the_trajectory_stays_on_the_path_and_within_limits() -> None:
    model = CollisionModel(UR5E, NARROW)
    path = plan(model, START, GOAL, timeout=ENOUGH)
    move = path.trajectory(UR5E.chain, max_velocity=1.0, max_acceleration=2.0)
    sample = move.sample(np.linspace(0.0, move.duration, 500))
    assert np.abs(sample.dq).max() <= 1.0 + 1e-9
    assert np.abs(sample.ddq).max() <= 2.0 + 1e-9
    assert model.bounds(sample.q, 0.1).min() >= path.kept - 2e-5


@pytest.mark.parametrize("name", NAMES)
def test_every_robot_plans(name: str) -> None:
    model = CollisionModel(chain(name))
    q = states(chain(name), 60, seed=9)
    start = q[model.is_free(q)][0]
    lower, upper = chain(name).limits.T
    near = np.clip(start + 0.5 * np.random.default_rng(1).normal(size=(30, len(start))), lower, upper)
    goals = near[model.is_free(near)]
    path = plan(model, start, goals, timeout=ENOUGH)
    assert path.found
    assert (path.q[-1] == goals).all(axis=1).any()
    assert EdgeCheck(model).path_is_free(path.q)


# --- what is in the way


def test_start_in_collision_names_the_pair() -> None:
    path = plan(UR5E, [0.0, -1.2, 1.2, 0.0, 0.0, 0.0], START, world=post())
    assert (path.found, path.status) == (False, "start in collision")
    assert path.blocking is not None
    assert path.blocking.second == "post"
    assert path.reason.startswith("at the start ")
    assert path.reason.endswith(" mm inside post")
    assert str(path).startswith("start in collision: at the start")


def test_a_start_within_the_margin_says_so() -> None:
    model = CollisionModel(UR5E, post(), margin=0.0)
    near = next(q for q in states(UR5E.chain, 3000) if 0.001 < model.distance(q).distance < 0.009)
    path = plan(UR5E, near, START, world=post())
    assert path.status == "start in collision"
    assert "nearer than the margin of 10 mm" in path.reason


def test_goal_in_collision_names_the_pair() -> None:
    path = plan(UR5E, START, [0.0, -1.2, 1.2, 0.0, 0.0, 0.0], world=post())
    assert path.status == "goal in collision"
    assert path.blocking is not None
    assert path.blocking.second == "post"
    np.testing.assert_array_equal(path.q, [START])
    inside = plan(UR5E, START, at(0.55, 0.0, 0.4, (np.pi, 0.0, 0.0)), world=post())
    assert inside.status == "goal in collision"
    assert inside.reason.startswith("all ")


def test_out_of_limits_and_out_of_reach() -> None:
    assert plan(UR5E, START + np.array([7.0, 0, 0, 0, 0, 0]), START).status == "start out of limits"
    beyond = plan(UR5E, START, START + np.array([0, 0, 4.0, 0, 0, 0]))
    assert beyond.status == "goal out of limits"
    assert "'elbow_joint' at 5.2 is outside its limits" in beyond.reason
    far = plan(UR5E, START, at(3.0, 0.0, 0.0))
    assert far.status == "goal out of reach"
    assert "out of reach" in far.reason


def test_no_path_in_time_tells_the_best_approach_and_what_stops_it() -> None:
    """Joint 1 of a boom alone leads from one side of a wall to the other, and there is no way around."""
    boom = Chain(
        "boom", [[0, 0, 0, 0, 0, 1.0], [0, 0, -0.5, 0, 1.0, 0]], at(1.0, 0, 0), [[-3, 3], [-0.3, 0.3]], ("pan", "tilt")
    )
    wall = World((Item("wall", Box([1.0, 0.02, 3.0]), at(0.7, 0.0, 0.0)),))
    path = plan(boom, [-1.0, 0.0], [1.0, 0.1], world=wall, timeout=0.3)
    assert path.status == "no path in time"
    assert path.reason.startswith("no path in 0.3 s; the nearest approach is a state ")
    assert path.blocking is not None
    assert path.blocking.second == "wall"
    assert path.goal == 0
    np.testing.assert_array_equal(path.q[0], [-1.0, 0.0])
    assert path.q[-1, 0] > -1.0
    assert EdgeCheck(CollisionModel(boom, wall)).path_is_free(path.q)


def test_the_straight_way_alone() -> None:
    path = plan(UR5E, START, GOAL, world=NARROW, timeout=0.0)
    assert path.status == "no path in time"
    assert path.reason.startswith("no path in 0 s; the nearest approach is the start; straight on from there ")
    assert path.blocking is not None
    assert path.blocking.second in NARROW.names
    np.testing.assert_array_equal(path.q, [START])


def test_cancelled_in_the_middle_gives_the_way_so_far() -> None:
    asked = itertools.count()
    path = plan(UR5E, START, GOAL, world=NARROW, timeout=ENOUGH, cancelled=lambda: next(asked) > 12)
    assert path.status == "cancelled"
    assert path.reason.startswith("cancelled; the nearest approach is ")
    np.testing.assert_array_equal(path.q[0], START)
    assert EdgeCheck(CollisionModel(UR5E, NARROW)).path_is_free(path.q)
    assert plan(UR5E, START, GOAL, world=NARROW, cancelled=lambda: True).status == "cancelled"


def test_an_exception_of_a_callback_comes_through() -> None:
    asked = itertools.count()

    def interrupt() -> bool:
        if next(asked) > 8:
            raise KeyboardInterrupt
        return False

    with pytest.raises(KeyboardInterrupt):
        plan(UR5E, START, GOAL, world=NARROW, timeout=ENOUGH, cancelled=interrupt)


def test_progress_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    from pieper.motion import planning

    monkeypatch.setattr(planning, "_TOLD", 0.0)
    told: list[tuple[float, int]] = []
    plan(UR5E, START, GOAL, world=NARROW, timeout=ENOUGH, progress=lambda seconds, edges: told.append((seconds, edges)))
    assert len(told) > 5
    assert sorted(told) == told


def test_malformed_questions_raise() -> None:
    with pytest.raises(ArrayError, match="q_start must be finite"):
        plan(UR5E, START * np.nan, GOAL)
    with pytest.raises(ArrayError, match=r"q_start must have shape \(6,\), got \(1, 6\)"):
        plan(UR5E, START[None], GOAL)
    with pytest.raises(ArrayError, match=r"goal must have shape"):
        plan(UR5E, START, GOAL[:4])
    with pytest.raises(ArrayError, match="goal must have shape"):
        plan(UR5E, START, np.zeros((0, 6)))
    with pytest.raises(ArrayError, match="goal must be finite"):
        plan(UR5E, START, GOAL + np.inf)
    with pytest.raises(ArrayError, match="goal must have the last row"):
        plan(UR5E, START, np.ones((4, 4)))
    with pytest.raises(ArrayError, match=r"goal must be one pose \(4, 4\), got a batch"):
        plan(UR5E, START, np.stack([np.eye(4)] * 2))
    for seed in (-1, 0.5, True, 2**31):
        with pytest.raises(MotionError, match="seed must be a whole number"):
            plan(UR5E, START, GOAL, seed=seed)
    for timeout in (-1.0, np.nan, "soon"):
        with pytest.raises(MotionError, match="timeout must be a number of seconds"):
            plan(UR5E, START, GOAL, timeout=timeout)
    with pytest.raises(WorldError, match="margin"):
        plan(UR5E, START, GOAL, margin=-1.0)
    with pytest.raises(MotionError, match="belong to the collision model"):
        plan(CollisionModel(UR5E), START, GOAL, world=post())


def test_every_status_is_known() -> None:
    assert len(set(STATUSES)) == len(STATUSES)


def test_without_ompl_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "ompl.base", None)
    with pytest.raises(MissingExtraError, match=r"ompl is not installed.*pip install 'pieper\[plan\]'"):
        plan(UR5E, START, GOAL, world=NARROW)


def test_a_grasped_object_is_carried_around() -> None:
    held = Item("ball", Sphere(0.05), at(0.0, 0.0, 0.12))
    model = CollisionModel(UR5E, NARROW, attached=[held], allowed=[("ball", "wrist_3_link")])
    path = plan(model, START, GOAL, timeout=ENOUGH)
    assert path.found
    assert judged(model, path.q) > 100
