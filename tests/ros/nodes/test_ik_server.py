"""Inverse kinematics as services: the report's list of poses, branches, and MoveIt's shapes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import pieper
from pieper.errors import RosError
from pieper.ik import select
from pieper.ros.fake import FakeNetwork
from pieper.ros.nodes import ik_server
from pieper.ros.nodes.ik_server import IkServer

CALCULATE_IK = "pieper_interfaces/srv/CalculateIK"
BRANCHES = "pieper_interfaces/srv/CalculateIKBranches"
POSITION_IK = "moveit_msgs/srv/GetPositionIK"
POSITION_FK = "moveit_msgs/srv/GetPositionFK"
GOLDEN = Path(__file__).parents[2] / "golden"

EXACT = 1e-9  # [m and rad] what the solver counts as reached
PRINTED = 2e-2  # [rad] angles and poses that the exercise prints with two decimals and five


def rows(name):
    return yaml.safe_load((GOLDEN / name).read_text(encoding="utf-8"))


def as_pose(T):
    """Fields of geometry_msgs/Pose."""
    quaternion = Rotation.from_matrix(T[:3, :3]).as_quat()
    return {
        "position": dict(zip("xyz", T[:3, 3], strict=True)),
        "orientation": dict(zip("xyzw", quaternion, strict=True)),
    }


def pose(position, quaternion=(0.0, 0.0, 0.0, 1.0)):
    return {
        "position": dict(zip("xyz", position, strict=True)),
        "orientation": dict(zip("xyzw", quaternion, strict=True)),
    }


def off(arm, q, T):
    """Largest difference of the poses' elements."""
    return np.abs(arm.fk(q) - T).max()


def same_turns(a, b):
    return np.abs((np.asarray(a) - b + np.pi) % (2 * np.pi) - np.pi).max()


class Served:
    """A server on a network of its own, and a user."""

    def __init__(self, arm="kuka_kr210_robond", *arguments):
        self.arm = pieper.load(arm)
        self.network = FakeNetwork()
        self.bus, self.user = self.network.bus("IK_server", arguments), self.network.bus("user")
        self.node = IkServer(self.bus, self.arm)
        self.clients = {
            name: self.user.client(name, type_name)
            for name, type_name in (
                ("calculate_ik", CALCULATE_IK),
                ("calculate_ik_branches", BRANCHES),
                ("compute_ik", POSITION_IK),
                ("compute_fk", POSITION_FK),
            )
        }
        self.states = self.user.publisher("joint_states", "sensor_msgs/msg/JointState")

    def ask(self, service, **fields):
        answers = []
        self.network.advance(1.0, step=1.0)  # so that no line is kept back
        self.clients[service].send(answers.append, **fields)
        self.network.settle()
        assert not self.bus.errors
        (answer,) = answers
        return answer

    def plan(self, Ts):
        return [point.positions for point in self.ask("calculate_ik", poses=[as_pose(T) for T in Ts]).points]

    def stands_at(self, q, names=None):
        self.states.send(name=list(names or self.arm.joint_names), position=q)
        self.network.settle()


@pytest.fixture(scope="module")
def kr210():
    return Served()


# The service of the report


def test_C7_the_lines_of_the_report(kr210):
    assert kr210.bus.lines[1] == "Ready to receive an IK request"
    kr210.bus.lines.clear()
    (point,) = kr210.ask("calculate_ik", poses=[pose([2.2, 0.9, 0.811])]).points
    assert kr210.bus.lines[:2] == ["Received 1 eef-poses from the plan", "length of Joint Trajectory List: 1"]
    assert point.positions.shape == (6,)
    for field in ("velocities", "accelerations", "effort"):
        assert not getattr(point, field).size


def test_C7_an_empty_request_is_refused(kr210):
    kr210.bus.lines.clear()
    assert kr210.ask("calculate_ik").points == []
    assert kr210.bus.lines == ["No valid poses received"]


def test_C7_a_path_is_followed_on_one_branch(kr210):
    """Of all branches the one of the point before is the nearest, so that no joint jumps."""
    arm = kr210.arm
    q = np.linspace([0.3, -0.2, 0.1, -0.4, 0.6, -0.5], [-0.9, 0.5, -0.8, 1.9, 1.2, 2.8], 200)
    kr210.stands_at(q[0])
    got = np.array(kr210.plan(arm.fk(q)))
    np.testing.assert_allclose(got, q, atol=1e-8)  # EXACT poses, at most 10 times less exact in the joints here


def test_C7_the_first_point_is_near_where_the_arm_is():
    served = Served()
    arm = served.arm
    T = arm.fk([0.3, -0.2, 0.1, -0.4, 0.6, -0.5])
    every = select.within_limits(arm.ik(T))
    for q in every.q[every.valid]:
        served.stands_at(q + 0.01)
        (got,) = served.plan([T])
        np.testing.assert_allclose(got, q, atol=1e-8)


def test_C7_whole_turns_are_not_lost():
    """Joint 6 turns by almost two turns: past pi an angle of an answer wraps, and a point near the one before does not."""
    served = Served("ur5e")
    q = np.tile([0.1, -1.2, 1.4, -1.7, -1.5, 0.0], (80, 1))
    q[:, 5] = np.linspace(-6.0, 6.0, 80)
    served.stands_at(q[0])
    np.testing.assert_allclose(np.array(served.plan(served.arm.fk(q))), q, atol=1e-8)


def test_seven_joints_follow_a_path_without_jumps():
    served = Served("iiwa14")
    arm = served.arm
    q = np.linspace([0.1, 0.4, -0.2, -1.2, 0.3, 0.9, 0.2], [0.5, 0.6, 0.1, -1.5, -0.2, 0.6, 0.2], 100)
    served.stands_at(q[0])
    got = np.array(served.plan(arm.fk(q)))
    np.testing.assert_allclose(got, q, atol=1e-8)  # joint 7 is the one that is held, and does not move here
    far = arm.fk(np.linspace(q[0], [-1.0, 0.4, -0.9, -1.9, 1.5, -0.9, 2.0], 30))
    assert off(arm, np.array(served.plan(far)), far) <= EXACT


ANGLES = st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6)


@settings(max_examples=25, deadline=None)
@given(st.lists(ANGLES, min_size=1, max_size=5))
def test_every_answer_reaches_its_pose_within_the_limits(kr210, fractions):
    arm = kr210.arm
    lower, upper = arm.limits.T
    q = (lower + upper) / 2 + np.array(fractions) * (upper - lower) / 2
    Ts = arm.fk(q)
    points = kr210.plan(Ts)
    assert len(points) == len(q)
    for T, got in zip(Ts, points, strict=True):
        assert off(arm, got, T) <= EXACT
        assert ((lower <= got) & (got <= upper)).all()


def test_poses_that_cannot_be_had_leave_the_others_alone():
    served = Served()
    good = pose([2.2, 0.9, 0.811])
    bad = [
        pose([9.0, 0.0, 0.0]),
        pose([np.nan, 0.0, 1.0]),
        pose([2.2, 0.9, 0.811], (0.0, 0.0, 0.0, 0.0)),
        pose([2.2, 0.9, 0.811], (0.0, 0.0, 0.0, np.inf)),
        pose([1e300, 0.0, 0.0]),
    ]
    points = served.ask("calculate_ik", poses=[bad[0], good, *bad[1:], good]).points
    assert [len(point.positions) for point in points] == [0, 6, 0, 0, 0, 0, 6]
    np.testing.assert_array_equal(points[1].positions, points[6].positions)
    (line,) = [line for line in served.bus.lines if "without a point" in line]
    assert line.startswith("poses without a point: 5 of 7: pose 0: out of reach by ")
    assert "pose 2: not a pose: a number is not finite; pose 3: not a pose: its quaternion is zero; and 2 more" in line


def test_quaternions_are_normalised(kr210):
    quaternion = np.array([0.1, -0.2, 0.3, 0.9])
    kr210.stands_at(np.zeros(6))
    one, other = (
        kr210.ask("calculate_ik", poses=[pose([1.9, 0.4, 1.7], k * quaternion)]).points[0].positions
        for k in (1.0, -7.0)
    )
    np.testing.assert_allclose(one, other, atol=1e-12)
    R = kr210.arm.fk(one)[:3, :3]
    np.testing.assert_allclose(R, Rotation.from_quat(quaternion).as_matrix(), atol=EXACT)


def test_requests_are_bounded():
    served = Served("ur5e", "--ros-args", "-p", "max_poses:=2")
    assert served.ask("calculate_ik", poses=[pose([0.4, 0.1, 0.3])] * 3).points == []
    assert served.bus.lines[-1] == "refused: 3 poses, and max_poses is 2"
    with pytest.raises(RosError, match="max_poses must be above 0, got 0"):
        Served("ur5e", "--ros-args", "-p", "max_poses:=0")


def test_K10_the_frame_of_a_request_is_stated_and_can_be_another():
    """The gripper is 0.11 m in front of link 6: a request for one is not one for the other."""
    gripper, link_6 = Served(), Served("kuka_kr210_robond", "--ros-args", "-p", "frame:=link_6")
    assert gripper.bus.lines[0].startswith("Poses are those of 'gripper_link' in 'base_link'; joints are: joint_1, ")
    assert link_6.bus.lines[0].startswith("Poses are those of 'link_6' in 'base_link'")
    arm = gripper.arm
    q = np.array([0.3, -0.2, 0.1, -0.4, 0.6, -0.5])
    for served, frame in ((gripper, "gripper_link"), (link_6, "link_6")):
        served.stands_at(q)
        (got,) = served.plan([arm.fk(q, up_to=frame)])
        np.testing.assert_allclose(got, q, atol=1e-8)
    (other,) = link_6.plan([arm.fk(q)])
    assert np.linalg.norm(arm.fk(other)[:3, 3] - arm.fk(q)[:3, 3]) > 0.1
    with pytest.raises(RosError, match="parameter frame: no frame 'link_3' in those fixed to the tip"):
        Served("kuka_kr210_robond", "--ros-args", "-p", "frame:=link_3")


@pytest.mark.parametrize("case", [1, 2, 3])
def test_C8_the_debug_cases_by_service(kr210, case):
    row = rows("kr210_debug_cases.yaml")["cases"][case]
    answer = kr210.ask("calculate_ik_branches", pose=pose(row["position"], row["quaternion_xyzw"]))
    listed = next(s for s in row["solutions"] if s["is_listed"])["q"]
    within = [s["q"] for s in row["solutions"] if s["in_limits_copies"]]
    got = [point.positions for point in answer.points]
    assert len(got) == len(answer.labels) == len(within)
    assert all(min(same_turns(q, wanted) for q in got) < 1e-6 for wanted in within)  # five decimals of the quaternion
    assert min(same_turns(q, row["listed_angles_2_decimals"]) for q in got) < PRINTED
    if case == 2:  # the branch that the method of the report cannot give
        best = min(range(len(got)), key=lambda i: same_turns(got[i], listed))
        assert answer.labels[best].startswith("back, elbow ")


def test_K5_branches_are_nearest_first():
    served = Served()
    q = np.array([-1.9258565095142068, 0.6879536456414692, 0.5364138256841162, -1.75, 1.729840807335571, -3.03])
    served.stands_at(q)
    answer = served.ask("calculate_ik_branches", pose=as_pose(served.arm.fk(q)))
    distances = [np.linalg.norm(point.positions - q) for point in answer.points]
    assert distances == sorted(distances)
    assert distances[0] < 1e-8
    assert answer.labels[0] == "front, elbow up, no flip"


@pytest.mark.parametrize("wrong", [pose([9.0, 0.0, 0.0]), pose([1.0, 0.0, 1.0], (0.0, 0.0, 0.0, 0.0))])
def test_branches_of_a_pose_that_cannot_be_had(kr210, wrong):
    answer = kr210.ask("calculate_ik_branches", pose=wrong)
    assert (answer.points, answer.labels) == ([], [])
    assert kr210.bus.lines[-1].startswith(
        ("calculate_ik_branches: out of reach by", "calculate_ik_branches: not a pose")
    )


def test_C9_the_shelf_and_the_drop_in_one_plan(kr210):
    slots = rows("kr210_pick_place.yaml")
    kr210.stands_at(np.zeros(6))
    got = kr210.ask("calculate_ik", poses=[pose(row["gripper_position"]) for row in slots]).points
    reached = sum(
        off(kr210.arm, p.positions[None], _at(row["gripper_position"])) <= EXACT
        for p, row in zip(got, slots, strict=True)
    )
    assert reached == len(slots) == 19


def _at(position):
    T = np.eye(4)
    T[:3, 3] = position
    return T


def test_C12_a_plan_of_a_thousand_poses(kr210):
    arm = kr210.arm
    q = np.linspace([0.3, -0.2, 0.1, -0.4, 0.6, -0.5], [-0.9, 0.5, -0.8, 1.9, 1.2, 2.8], 1000)
    kr210.stands_at(q[0])
    Ts = arm.fk(q)
    assert off(arm, np.array(kr210.plan(Ts)), Ts) <= EXACT
    assert re.fullmatch(r"Solved in \d+\.\d{3} ms, \d+\.\d us per pose", kr210.bus.lines[-1])


def test_joint_states_of_others_are_passed_over(kr210):
    q = np.array([0.3, -0.2, 0.1, -0.4, 0.6, -0.5])
    kr210.stands_at(q)
    kr210.stands_at([1.0, np.nan, 1e300], names=["finger", "joint_1", "joint_2"])
    kr210.stands_at([0.0, 0.0], names=["joint_1"])
    (got,) = kr210.plan([kr210.arm.fk(q)])
    np.testing.assert_allclose(got, q, atol=1e-8)


# MoveIt's


def in_frame(frame, fields):
    return {"header": {"frame_id": frame}, "pose": fields}


def test_compute_ik_is_nearest_to_the_seed(kr210):
    arm = kr210.arm
    T = arm.fk([0.3, -0.2, 0.1, -0.4, 0.6, -0.5])
    every = select.within_limits(arm.ik(T))
    names = list(reversed(arm.joint_names))
    for q in every.q[every.valid]:
        answer = kr210.ask(
            "compute_ik",
            ik_request={
                "group_name": "manipulator",
                "robot_state": {"joint_state": {"name": [*names, "finger"], "position": [*reversed(q + 0.01), 0.5]}},
                "pose_stamped": in_frame("base_link", as_pose(T)),
                "timeout": {"sec": 1},
            },
        )
        assert answer.error_code.val == ik_server.SUCCESS
        assert tuple(answer.solution.joint_state.name) == arm.joint_names
        assert answer.solution.joint_state.header.frame_id == "base_link"
        np.testing.assert_allclose(answer.solution.joint_state.position, q, atol=1e-8)


def test_compute_ik_of_another_link_and_another_header():
    served = Served("ur5e")
    arm = served.arm
    q = np.array([0.1, -1.2, 1.4, -1.7, -1.5, 0.3])
    T_inertia_flange = np.linalg.inv(arm.fk(q, up_to="base_link_inertia")) @ arm.fk(q, up_to="flange")
    served.stands_at(q)
    answer = served.ask(
        "compute_ik",
        ik_request={"ik_link_name": "flange", "pose_stamped": in_frame("base_link_inertia", as_pose(T_inertia_flange))},
    )
    assert answer.error_code.val == ik_server.SUCCESS
    np.testing.assert_allclose(answer.solution.joint_state.position, q, atol=1e-8)


REACHED = in_frame("base_link", pose([2.2, 0.9, 0.811]))
STATE = {"name": ["joint_1"], "position": [0.1]}


@pytest.mark.parametrize(
    ("request_", "code", "reason"),
    [
        ({"pose_stamped": in_frame("", pose([9, 0, 0]))}, -31, "out of reach by"),
        ({"pose_stamped": in_frame("", pose([1, 0, 1], [0] * 4))}, -31, "not a pose: its quaternion is zero"),
        (
            {"pose_stamped": in_frame("map", pose([1, 0, 1]))},
            -21,
            "no frame 'map' in those fixed to the base; frames are:",
        ),
        ({"ik_link_name": "link_3"}, -18, "no link 'link_3' in those fixed to the tip; did you mean"),
        ({"ik_link_names": ["link_6"]}, -18, "one link and one pose are solved at a time"),
        ({"avoid_collisions": True}, -22, "collisions cannot be checked here; ask with avoid_collisions false"),
        ({"constraints": {"joint_constraints": [{}]}}, -16, "constraints are not supported; leave them empty"),
        (
            {"robot_state": {"joint_state": {**STATE, "position": [0.1, 2.0]}}},
            -17,
            "got 1 names (1 different) and 2 pos",
        ),
        ({"robot_state": {"joint_state": {"name": ["a", "a"], "position": [1, 2]}}}, -17, "got 2 names (1 different)"),
        ({"robot_state": {"joint_state": {**STATE, "position": [np.nan]}}}, -17, "of the joint state is not finite"),
    ],
)
def test_compute_ik_says_what_it_cannot(kr210, request_, code, reason):
    answer = kr210.ask("compute_ik", ik_request={"pose_stamped": REACHED, **request_})
    assert answer.error_code.val == code
    assert reason in answer.error_code.message
    assert answer.error_code.source == "IK_server"
    assert not answer.solution.joint_state.name
    assert reason in kr210.bus.lines[-1]


def test_compute_ik_insists_on_its_group():
    served = Served("kuka_kr210_robond", "--ros-args", "-p", "group:=arm")
    for group, code in (("arm", 1), ("", 1), ("gripper", -15)):
        answer = served.ask("compute_ik", ik_request={"group_name": group, "pose_stamped": REACHED})
        assert answer.error_code.val == code


def test_compute_fk_of_every_link(kr210):
    arm = kr210.arm
    q = np.array([0.3, -0.2, 0.1, -0.4, 0.6, -0.5])
    state = {"joint_state": {"name": list(arm.joint_names), "position": q}}
    links = [frame.name for frame in arm.chain.frames]
    answer = kr210.ask("compute_fk", fk_link_names=links, robot_state=state)
    assert answer.error_code.val == ik_server.SUCCESS
    assert list(answer.fk_link_names) == links
    for stamped, link in zip(answer.pose_stamped, links, strict=True):
        T = arm.fk(q, up_to=link)
        p, o = stamped.pose.position, stamped.pose.orientation
        np.testing.assert_allclose([p.x, p.y, p.z], T[:3, 3], atol=1e-12)
        np.testing.assert_allclose(Rotation.from_quat([o.x, o.y, o.z, o.w]).as_matrix(), T[:3, :3], atol=1e-12)
        assert stamped.header.frame_id == "base_link"


def test_compute_fk_says_what_it_cannot():
    served = Served()
    for fields, code, reason in (
        ({"fk_link_names": ["elbow"]}, -18, "no link 'elbow' in kuka_kr210_robond"),
        ({"header": {"frame_id": "map"}}, -21, "no frame 'map'"),
        (
            {"robot_state": {"joint_state": STATE}},
            -17,
            "lacks joint_2, joint_3, joint_4, joint_5, joint_6, and no joint_st",
        ),
        ({"fk_link_names": ["link_1"] * 1001}, -18, "1001 links asked for; at most 1000"),
    ):
        answer = served.ask("compute_fk", **fields)
        assert answer.error_code.val == code
        assert reason in answer.error_code.message
    served.stands_at(np.full(6, 0.2))
    answer = served.ask("compute_fk", robot_state={"joint_state": STATE})
    p = answer.pose_stamped[0].pose.position
    np.testing.assert_allclose([p.x, p.y, p.z], served.arm.fk([0.1, *[0.2] * 5])[:3, 3], atol=1e-12)


def test_fk_and_ik_of_moveit_agree(kr210):
    """What one says of a state the other takes back, though neither knows of the other."""
    q = np.array([0.5, 0.1, -0.3, 1.0, -0.7, 0.2])
    state = {"joint_state": {"name": list(kr210.arm.joint_names), "position": q}}
    stamped = kr210.ask("compute_fk", robot_state=state).pose_stamped[0]
    answer = kr210.ask("compute_ik", ik_request={"pose_stamped": stamped, "robot_state": state})
    np.testing.assert_allclose(answer.solution.joint_state.position, q, atol=1e-8)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(width=64), min_size=7, max_size=7))
def test_any_numbers_get_an_answer(kr210, numbers):
    answer = kr210.ask("calculate_ik", poses=[pose(numbers[:3], numbers[3:])])
    assert len(answer.points) == 1
    assert len(answer.points[0].positions) in (0, 6)


def test_on_every_network(network):
    node = network.join("IK_server")
    IkServer(node, pieper.load("ur5e"))
    user, answers = network.join("user"), []
    client = user.client("calculate_ik", CALCULATE_IK)
    assert network.until(lambda: client.ready)
    client.send(answers.append, poses=[pose([0.4, 0.1, 0.3])])
    assert network.until(lambda: bool(answers))
    np.testing.assert_allclose(pieper.load("ur5e").fk(answers[0].points[0].positions), _at([0.4, 0.1, 0.3]), atol=EXACT)
