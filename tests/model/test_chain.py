"""The chain as data: what it refuses, and that every change returns a new one."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import pieper
from pieper.arm import Arm
from pieper.errors import ArrayError, UnknownNameError
from pieper.model.chain import Chain, Frame
from pieper.spatial import pose
from tests.reference import product_of_exponentials as textbook
from tests.robots import NAMES, chain

SAME_POSE = 1e-12  # [m, -]: a dozen products of numbers of a few metres, rounded in double

ELBOW = {
    "name": "elbow",
    "screws": [[0, 0, 0, 0, 0, 1], [0, -1, 0, 0, 0, 1]],
    "home": np.eye(4) + 2 * np.eye(4, k=3),
    "limits": [[-1, 1], [-2, 2]],
    "joint_names": ("shoulder", "elbow"),
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"screws": [[0] * 6] * 3}, r"screws must have shape \(2, 6\), got \(3, 6\)"),
        ({"screws": [[0, 0, 0, 0, 0, 2], [0, 0, 1, 0, 0, 0]]}, r"screw 0 needs \|w\| = 1 .* got \|w\| = 2"),
        (
            {"screws": [[0, 0, 0, 0, 0, 1], [0, 0, 3, 0, 0, 0]]},
            r"screw 1 is prismatic .* needs \|v\| = 1, got \|v\| = 3",
        ),
        ({"screws": [[0, 0, 0.5, 0, 0, 1], [0, 0, 1, 0, 0, 0]]}, "screw 0 has pitch 0.5 m/rad"),
        ({"screws": [[0, 0, np.nan, 0, 0, 1]] * 2}, "screws must be finite"),
        ({"screws": [[0, 0], [1]]}, "rows of different lengths"),
        ({"screws": "screws"}, "must be real numbers"),
        ({"home": np.eye(3)}, r"home must have shape \(4, 4\), got \(3, 3\)"),
        ({"home": 2 * np.eye(4)}, "deviates from a rotation by 3"),
        ({"home": np.diag([1, 1, -1, 1])}, "determinant -1"),
        ({"home": np.eye(4) + np.eye(4, k=-3)}, "last row 0 0 0 1"),
        ({"limits": [[1, -1], [0, 0]]}, "limits of joint 'shoulder' must be lower <= upper"),
        ({"limits": [[np.nan, 0], [0, 0]]}, "limits must be finite"),
        ({"limits": [[-1, 1]]}, r"limits must have shape \(2, 2\), got \(1, 2\)"),
        ({"joint_names": ("a", "a")}, "joint names must be unique"),
        ({"max_velocity": [1.0]}, r"max_velocity must have shape \(2,\)"),
        ({"coupling": 3.0}, r"coupling must have shape \(m, 2\), got \(\)"),
        ({"coupling": [[1.0, 0.0, 0.0]]}, r"coupling must have shape \(m, 2\)"),
        ({"coupling": [[1j, 0.0], [0.0, 1.0]]}, "got dtype complex128"),
    ],
)
def test_malformed_chains_are_refused(change, message):
    with pytest.raises(ArrayError, match=message):
        Chain(**{**ELBOW, **change})


def test_arrays_are_copied_and_read_only():
    screws = np.array(ELBOW["screws"], dtype=float)
    arm = Chain(**{**ELBOW, "screws": screws})
    screws[0, 0] = 7.0
    assert arm.screws[0, 0] == 0.0
    for array in (arm.screws, arm.home, arm.limits, arm.coupling, arm.max_velocity, arm.frames[1].home):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


def test_frames_are_made_when_none_are_given():
    arm = Chain(**ELBOW)
    assert [(f.name, f.after) for f in arm.frames] == [("base", 0), ("base_1", 1), ("base_2", 2), ("tip", 2)]
    assert np.allclose(arm.frame("base_2").home[:3, 3], [1, 0, 0])
    assert np.allclose(arm.frame(2).home[:3, 2], [0, 0, 1])


def test_no_joints_at_all():
    arm = Chain(name="post", screws=[], home=np.eye(4), limits=[], joint_names=())
    assert arm.dof == 0
    assert np.array_equal(pieper.Arm(arm).fk([]), np.eye(4))
    assert pieper.Arm(arm).jacobian(np.empty((3, 0))).shape == (3, 6, 0)


@pytest.mark.parametrize("name", NAMES)
def test_tool_and_base_multiply_the_pose(name):
    arm, rng = chain(name), np.random.default_rng(1)
    tool, base = (
        pose.from_xyz_rpy(rng.normal(size=3), rng.normal(size=3)),
        pose.from_xyz_rpy([1, 2, 3], [0.4, 0.5, 0.6]),
    )
    changed = arm.with_tool(tool, name="welder").with_base(base, name="cell")
    q = rng.uniform(-1, 1, arm.dof)
    assert np.abs(textbook.fk(changed, q) - base @ textbook.fk(arm, q) @ tool).max() < SAME_POSE
    assert (changed.base, changed.tip) == ("cell", "welder")
    for frame in arm.frames:
        moved = base @ textbook.fk_frame(arm, q, frame)
        assert np.abs(textbook.fk_frame(changed, q, changed.frame(frame.name)) - moved).max() < SAME_POSE


@pytest.mark.parametrize("name", NAMES)
def test_a_locked_arm_moves_like_the_arm_with_that_joint_held(name):
    arm, rng = chain(name), np.random.default_rng(2)
    for joint in arm.joint_names:
        value = float(rng.uniform(-2, 2))
        locked = arm.lock(**{joint: value})
        assert locked.dof == arm.dof - 1
        assert joint not in locked.joint_names
        q = rng.uniform(-1, 1, arm.dof)
        q[arm.joint_index(joint)] = value
        rest = np.delete(q, arm.joint_index(joint))
        assert np.abs(textbook.fk(locked, rest) - textbook.fk(arm, q)).max() < SAME_POSE
        for before, after in zip(arm.frames, locked.frames, strict=True):
            assert np.abs(textbook.fk_frame(locked, rest, after) - textbook.fk_frame(arm, q, before)).max() < SAME_POSE


def test_locking_a_master_holds_its_mimics():
    arm = Chain(**{**ELBOW, "coupling": [[1.0, 0.0], [-0.5, 0.0]]})
    locked = arm.lock(shoulder=0.8)
    assert locked.joint_names == ("elbow",)
    assert np.abs(textbook.fk(locked, [0.3]) - textbook.fk(arm, [0.8, 0.3])).max() < SAME_POSE


def test_a_joint_may_have_any_name():
    arm = Chain(**{**ELBOW, "joint_names": ("self", "joints")})
    assert arm.lock(self=0.8).joint_names == ("joints",)
    assert Arm(arm).lock(self=0.8, joints=0.1).dof == Arm(arm).lock({"self": 0.8, "joints": 0.1}).dof == 0


@pytest.mark.parametrize("which", [-1, 3, 1.5, float("nan"), True, (1,), [1], None, 10**30])
def test_what_is_no_joint_count_is_refused(which):
    with pytest.raises(ArrayError, match="up_to must be a frame name or a joint count from 0 to 2"):
        Chain(**ELBOW).frame(which)


def test_unknown_joints_are_named_with_near_matches():
    with pytest.raises(UnknownNameError, match=r"no joint 'elbw' in chain 'elbow'; did you mean 'elbow'\?"):
        Chain(**ELBOW).lock(elbw=0.0)
    with pytest.raises(ArrayError, match="locked at a finite value"):
        Chain(**ELBOW).lock(elbow=float("nan"))


def test_names_that_are_taken_get_a_number():
    arm = Chain(**ELBOW).with_tool(np.eye(4)).with_tool(np.eye(4))
    assert arm.tip == "tool_2"


def test_chains_survive_pickling_and_keep_their_numbers():
    arm = chain("panda")
    _ = arm.native
    copy = pickle.loads(pickle.dumps(arm))
    assert np.array_equal(copy.screws, arm.screws)
    assert np.array_equal(pieper.Arm(copy).fk([0.1] * 7), pieper.Arm(arm).fk([0.1] * 7))
    assert not copy.screws.flags.writeable


def test_named_joints_become_a_vector():
    arm = chain("yaskawa_mh12")
    assert arm.named({"joint_3_u": 0.5}).tolist() == [0, 0, 0.5, 0, 0, 0]


def test_a_frame_refuses_what_is_no_pose():
    with pytest.raises(ArrayError, match="home of frame 'x' must be a pose"):
        Frame("x", 0, 3 * np.eye(4))
