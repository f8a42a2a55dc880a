"""Actions on every backend: the states of a goal, its result, feedback and cancelling."""

from __future__ import annotations

import pytest

from pieper.errors import RosError
from pieper.ros import messages
from pieper.ros.actions import MOST_FINISHED, MOST_WAITING, ActionClient, ActionServer, CancelCode, GoalStatus
from pieper.ros.fake import FakeNetwork
from pieper.ros.qos import LATCHED

FOLLOW = "control_msgs/action/FollowJointTrajectory"
GET_RESULT = f"{FOLLOW}_GetResult"
SEND_GOAL = f"{FOLLOW}_SendGoal"
CANCEL = "action_msgs/srv/CancelGoal"
JOINTS = {"trajectory": {"joint_names": ["elbow"]}}


class Taker:
    """A server that takes every goal and lets the test decide what becomes of it."""

    def __init__(self, bus, name="follow", **options):
        self.goals = []
        self.server = ActionServer(bus, name, FOLLOW, on_goal=self.take, **options)

    def take(self, goal):
        goal.accept()
        self.goals.append(goal)


def taken(network, **options):
    """A server, its client, and a goal that the server works on."""
    taker = Taker(network.join("server"), **options)
    client = ActionClient(network.join("client"), "follow", FOLLOW)
    assert network.until(lambda: client.ready)
    ended = []
    sent = client.send(JOINTS, on_done=ended.append)
    assert network.until(lambda: taker.goals and sent.accepted)
    return taker, client, sent, ended


def test_a_goal_is_carried_out_with_feedback_and_a_result(network):
    taker = Taker(network.join("server"))
    client = ActionClient(network.join("client"), "follow", FOLLOW)
    assert network.until(lambda: client.ready)
    heard = []
    sent = client.send(JOINTS, on_feedback=heard.append)
    assert network.until(lambda: sent.accepted)
    (goal,) = taker.goals
    assert list(goal.request.trajectory.joint_names) == ["elbow"]
    assert goal.id == sent.id
    assert sent.status is GoalStatus.executing
    goal.feedback(joint_names=["elbow"])
    assert network.until(lambda: bool(heard))
    assert list(heard[0].joint_names) == ["elbow"]
    network.rest(0.2)
    assert not sent.done  # the result is asked for at once, and given when it is there
    goal.succeed(error_string="there")
    assert network.until(lambda: sent.done)
    assert (sent.status, sent.result.error_string) == (GoalStatus.succeeded, "there")


def test_a_rejected_goal_has_ended(network):
    server = network.join("server")
    ActionServer(server, "follow", FOLLOW, on_goal=lambda goal: "the arm is not ready")
    client = ActionClient(network.join("client"), "follow", FOLLOW)
    assert network.until(lambda: client.ready)
    ended = []
    sent = client.send(JOINTS, on_done=ended.append)
    assert network.until(lambda: sent.done)
    assert (sent.accepted, sent.status, ended) == (False, GoalStatus.unknown, [sent])


def test_a_goal_that_the_client_gives_up_is_cancelled(network):
    taker, _, sent, _ = taken(network, on_cancel=lambda goal: True)
    codes = []
    sent.cancel(codes.append)
    assert network.until(lambda: bool(codes))
    assert codes == [CancelCode.none]
    assert taker.goals[0].status is GoalStatus.canceling
    taker.goals[0].cancel(error_string="given up")
    assert network.until(lambda: sent.done)
    assert (sent.status, sent.result.error_string) == (GoalStatus.canceled, "given up")


def test_a_goal_that_cannot_be_cancelled_goes_on(network):
    taker, _, sent, _ = taken(network, on_cancel=lambda goal: False)
    codes = []
    sent.cancel(codes.append)
    assert network.until(lambda: bool(codes))
    assert codes == [CancelCode.rejected]
    assert taker.goals[0].status is GoalStatus.executing
    taker.goals[0].abort()
    assert network.until(lambda: sent.done)
    assert sent.status is GoalStatus.aborted


def test_the_status_of_goals_is_latched(network):
    taker, _, sent, _ = taken(network)
    taker.goals[0].succeed()
    late, heard = network.join("late"), []
    late.subscribe("follow/_action/status", "action_msgs/msg/GoalStatusArray", heard.append, qos=LATCHED)
    assert network.until(lambda: bool(heard))
    (status,) = heard[-1].status_list
    assert bytes(status.goal_info.goal_id.uuid) == sent.id
    assert GoalStatus(status.status) is GoalStatus.succeeded


def test_without_a_server_the_wait_ends_with_a_sentence(network):
    client = ActionClient(network.join("client"), "follow", FOLLOW)
    with pytest.raises(TimeoutError, match=rf"no server for the action /follow \({FOLLOW}\) within 0.2 s"):
        client.run(JOINTS, timeout=0.2)


# What needs no network


@pytest.fixture
def pair():
    network = FakeNetwork()
    server, user = network.bus("server"), network.bus("user")
    yield network, server, user
    assert not server.errors
    assert not user.errors


def test_a_goal_that_does_not_end_in_time_is_cancelled(pair):
    _, server, user = pair
    seen = []

    def cancel(goal):
        seen.append(goal)
        goal.cancel()
        return True

    taker = Taker(server, on_cancel=cancel)
    with pytest.raises(TimeoutError, match=r"sent to /follow has not ended within 0.5 s; it is cancelled"):
        ActionClient(user, "follow", FOLLOW).run(JOINTS, timeout=0.5)
    user.network.settle()
    assert seen == taker.goals


def test_run_waits_for_the_end(pair):
    _, server, user = pair
    taker = Taker(server)
    server.timer(0.3, lambda: [taker.goals.pop().succeed() for _ in taker.goals])
    goal = ActionClient(user, "follow", FOLLOW).run(JOINTS, timeout=1.0)
    assert (goal.done, goal.status) == (True, GoalStatus.succeeded)


def call(network, user, name, type_name, **fields):
    answers = []
    user.client(name, type_name).send(answers.append, **fields)
    network.settle()
    return answers


def test_the_wire_is_that_of_the_ros_2_design(pair):
    """Another client's own requests, made of nothing but the services."""
    network, server, user = pair
    taker = Taker(server, "/cell/follow", on_cancel=lambda goal: True)
    uuid = list(range(16))
    (answer,) = call(network, user, "/cell/follow/_action/send_goal", SEND_GOAL, goal_id={"uuid": uuid}, goal=JOINTS)
    assert answer.accepted
    assert answer.stamp.sec == network.time // 10**9
    results = call(network, user, "/cell/follow/_action/get_result", GET_RESULT, goal_id={"uuid": uuid})
    assert results == []
    taker.goals[0].succeed(error_code=0)
    network.settle()
    assert [r.status for r in results] == [4]
    (late,) = call(network, user, "/cell/follow/_action/get_result", GET_RESULT, goal_id={"uuid": uuid})
    assert late.status == 4
    (other,) = call(network, user, "/cell/follow/_action/get_result", GET_RESULT, goal_id={"uuid": [7] * 16})
    assert other.status == 0


def test_a_goal_id_is_used_once(pair):
    network, server, user = pair
    Taker(server)
    first, second = (
        call(network, user, "follow/_action/send_goal", SEND_GOAL, goal_id={"uuid": [1] * 16})[0] for _ in range(2)
    )
    assert (first.accepted, second.accepted) == (True, False)
    assert "goal rejected: its id is that of a goal that was sent before" in server.lines[-1]


def test_cancelling_by_id_by_time_and_all(pair):
    network, server, user = pair
    cancelled = []

    def cancel(goal):
        cancelled.append(goal.id[0])
        goal.cancel()
        return True

    Taker(server, on_cancel=cancel)
    stamps = []
    for i in range(1, 6):
        call(network, user, "follow/_action/send_goal", SEND_GOAL, goal_id={"uuid": [i] * 16})
        stamps.append(messages.make("builtin_interfaces/msg/Time", user.stamp()))
        network.advance(1.0)

    def ask(number, stamp=None):
        info = {"goal_id": {"uuid": [number] * 16}, "stamp": stamp}
        info = {key: value for key, value in info.items() if value is not None}
        (answer,) = call(network, user, "follow/_action/cancel_goal", CANCEL, goal_info=info)
        return CancelCode(answer.return_code), [info.goal_id.uuid[0] for info in answer.goals_canceling]

    assert ask(4) == (CancelCode.none, [4])
    assert ask(4) == (CancelCode.goal_terminated, [])
    assert ask(99) == (CancelCode.unknown_goal, [])
    assert ask(5, stamps[0]) == (CancelCode.none, [1, 5])  # that one, and all up to then
    assert ask(0, stamps[1]) == (CancelCode.none, [2])
    assert ask(0) == (CancelCode.none, [3])
    assert ask(0) == (CancelCode.none, [])
    assert cancelled == [4, 1, 5, 2, 3]


def test_finished_goals_are_remembered_up_to_a_number(pair):
    network, server, user = pair
    taker = Taker(server)
    for i in range(MOST_FINISHED + 5):
        call(network, user, "follow/_action/send_goal", SEND_GOAL, goal_id={"uuid": [i + 1] * 16})
        taker.goals[i].succeed()

    def status(i):
        (answer,) = call(network, user, "follow/_action/get_result", GET_RESULT, goal_id={"uuid": [i + 1] * 16})
        return GoalStatus(answer.status)

    assert [status(i) for i in (0, 4, 5, MOST_FINISHED + 4)] == [
        GoalStatus.unknown,
        GoalStatus.unknown,
        GoalStatus.succeeded,
        GoalStatus.succeeded,
    ]


def test_a_server_that_raises_has_given_the_goal_up():
    network = FakeNetwork()
    server, user = network.bus("server"), network.bus("user")

    def take(goal):
        goal.accept()
        raise ValueError("wrench in the works")

    ActionServer(server, "follow", FOLLOW, on_goal=take)
    statuses = []
    user.subscribe(
        "follow/_action/status", "action_msgs/msg/GoalStatusArray", lambda m: statuses.append(m.status_list[0].status)
    )
    call(network, user, "follow/_action/send_goal", SEND_GOAL, goal_id={"uuid": [1] * 16})
    assert GoalStatus(statuses[-1]) is GoalStatus.aborted
    assert [str(error) for error in server.errors] == ["wrench in the works"]


def test_remapping_the_name_moves_the_whole_action():
    network = FakeNetwork()
    server = network.bus("server", ["--ros-args", "-r", "follow:=/arm_controller/follow_joint_trajectory"])
    taker = Taker(server)
    assert taker.server.name == "/arm_controller/follow_joint_trajectory"
    goal = ActionClient(network.bus("user"), "/arm_controller/follow_joint_trajectory", FOLLOW).send(JOINTS)
    network.settle()
    assert goal.accepted


def test_the_order_of_states_is_kept(pair):
    network, server, user = pair
    taker = Taker(server)
    ActionClient(user, "follow", FOLLOW).send(JOINTS)
    network.settle()
    (goal,) = taker.goals
    with pytest.raises(RosError, match="accepted once; this one is executing"):
        goal.accept()
    with pytest.raises(RosError, match="whose client asked for it is cancelled; this one is executing: abort it"):
        goal.cancel()
    goal.abort()
    with pytest.raises(RosError, match="only an active goal can end; this one is aborted"):
        goal.succeed()
    goal.feedback(joint_names=["elbow"])  # nothing is sent


def test_results_waited_for_are_bounded(pair):
    network, server, user = pair
    Taker(server)
    call(network, user, "follow/_action/send_goal", SEND_GOAL, goal_id={"uuid": [1] * 16})
    answers = []
    for _ in range(MOST_WAITING + 1):
        answers += call(network, user, "follow/_action/get_result", GET_RESULT, goal_id={"uuid": [1] * 16})
    assert [answer.status for answer in answers] == [0]
