"""The tree of links and joints: what is refused, which chain is cut out, and that chains agree with each other."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from itertools import pairwise
from math import inf, nan, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pieper.errors import AmbiguousError, ArrayError, DescriptionError, UnknownNameError, UrdfError
from pieper.model.chain import Chain, Frame
from pieper.model.description import Description, Joint, Link, Mimic
from pieper.model.urdf import as_urdf, from_urdf
from tests.model.random_trees import urdf_trees
from tests.reference.product_of_exponentials import fk, fk_frame

COMPOSING = 1e-12  # rounding of at most a dozen 4x4 products of metre-sized poses is below 1e-13


def tree(text: str, **options) -> Description:
    """A description from lines ``parent type child``; r, c, p, f, F, P are the joint types, names are ``child_joint``."""
    kinds = {"r": "revolute", "c": "continuous", "p": "prismatic", "f": "fixed", "F": "floating", "P": "planar"}
    joints, links = [], {}
    for line in filter(None, (line.strip() for line in text.splitlines())):
        parent, kind, child = line.split()
        links.update({parent: None, child: None})
        T = np.eye(4)
        T[2, 3] = 0.1
        joints.append(Joint(f"{child}_joint", kinds[kind], parent, child, T, [0, 1, 0], lower=-1.0, upper=1.0))
    return Description("robot", tuple(Link(name) for name in links), tuple(joints), "robot.urdf", **options)


def arm(first: str, prefix: str, joints: int, then: str = "") -> str:
    """Lines of an arm behind a link: links <prefix>1, <prefix>2, ..., and more lines behind it."""
    names = [first, *(f"{prefix}{i + 1}" for i in range(joints))]
    return "\n".join(f"{a} r {b}" for a, b in pairwise(names)) + "\n" + then.format(last=names[-1])


# --- what is refused


def joint(name="j", kind="revolute", parent="a", child="b", **options) -> Joint:
    return Joint(name, kind, parent, child, **options)


A_AND_B = (Link("a"), Link("b"))
FAULTS = {
    "no links": ((), (), "has no links"),
    "link twice": ((Link("a"), Link("a")), (), "link 'a': the name is given twice"),
    "joint twice": (
        (Link("a"), Link("b"), Link("c")),
        (joint(), joint(child="c")),
        "joint 'j': the name is given twice",
    ),
    "no name": ((Link(" "),), (), "link number 1: needs a name"),
    "unknown parent": (A_AND_B, (joint(parent="x"),), "joint 'j': parent 'x' is not a link"),
    "unknown child": (A_AND_B, (joint(child="bb"),), "child 'bb' is not a link of the description; did you mean 'b'"),
    "itself": (A_AND_B, (joint(child="a"),), "parent and child are the same link"),
    "two parents": (
        (Link("a"), Link("b"), Link("c")),
        (joint("j", child="c"), joint("k", parent="b", child="c")),
        "joint 'k': link 'c' is already the child of joint 'j'",
    ),
    "cycle": (A_AND_B, (joint("j"), joint("k", parent="b", child="a")), "cycle"),
    "cycle beside a tree": (
        (Link("r"), Link("a"), Link("b")),
        (joint("j"), joint("k", parent="b", child="a")),
        "joint 'k': link 'a' is part of a cycle",
    ),
    "two roots": (A_AND_B, (), "has 2 roots ('a', 'b')"),
    "type": (A_AND_B, (joint(kind="hinge"),), "unknown type 'hinge'; types are: revolute, continuous"),
    "zero axis": (A_AND_B, (joint(axis=[0, 0, 0]),), "the axis is zero"),
    "nan axis": (A_AND_B, (joint(axis=[0, nan, 0]),), "the axis must be finite"),
    "infinite axis": (A_AND_B, (joint(axis=[0, inf, 0]),), "the axis must be finite"),
    "nan origin": (A_AND_B, (joint(T_parent_joint=np.full((4, 4), nan)),), "the origin must be finite"),
    "no rotation": (A_AND_B, (joint(T_parent_joint=2 * np.eye(4)),), "deviates from a rotation by 3"),
    "mirror": (A_AND_B, (joint(T_parent_joint=np.diag([1.0, 1, -1, 1])),), "the origin must be a pose"),
    "limits": (A_AND_B, (joint(lower=1, upper=-1),), "lower <= upper, got lower 1 and upper -1"),
    "nan limit": (A_AND_B, (joint(lower=nan),), "the lower limit must be a number"),
    "velocity": (A_AND_B, (joint(velocity=-1),), "the velocity limit must not be negative"),
    "mimic of nothing": (
        A_AND_B,
        (joint(mimic=Mimic("jj")),),
        "joint 'j': mimics 'jj', which is no joint; did you mean 'j'",
    ),
    "mimic of itself": (A_AND_B, (joint(mimic=Mimic("j")),), "joint 'j': mimics itself"),
    "mimic circle": (
        (Link("a"), Link("b"), Link("c")),
        (joint("j", mimic=Mimic("k")), joint("k", parent="b", child="c", mimic=Mimic("j"))),
        "mimics itself through 'j', 'k'",
    ),
    "mimic of fixed": (
        (Link("a"), Link("b"), Link("c")),
        (joint("j", kind="fixed"), joint("k", parent="b", child="c", mimic=Mimic("j"))),
        "joint 'k': mimics joint 'j', which is fixed",
    ),
    "mimic nan": (A_AND_B, (joint(mimic=Mimic("j", multiplier=nan)),), "the mimic multiplier must be finite"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_refused_by_name(fault):
    links, joints, message = FAULTS[fault]
    with pytest.raises(DescriptionError) as caught:
        Description("robot", links, joints, "robot.urdf")
    assert str(caught.value).startswith("robot.urdf: ")
    assert message in str(caught.value)


def test_unknown_default_ends_are_refused():
    with pytest.raises(DescriptionError, match="tip: 'c' is not a link"):
        Description("robot", A_AND_B, (joint(),), tip="c")


def test_shapes_are_checked():
    with pytest.raises(ArrayError, match=r"axis of joint 'j' must have shape \(3,\), got \(2,\)"):
        joint(axis=[1, 0])
    with pytest.raises(ArrayError, match="must be numbers"):
        joint(axis="xyz")


def test_axis_is_normalised_whatever_its_size():
    for size in (1e-300, 1e-3, 2.0, 1e200):
        assert joint(axis=[0, 0, size]).axis.tolist() == [0, 0, 1]
    assert joint(kind="fixed", axis=[0, 0, 0]).axis.tolist() == [0, 0, 0]  # exporters write it, and it means nothing
    Description("robot", A_AND_B, (joint(kind="fixed", axis=[0, 0, 0]),))


def test_frozen_means_frozen():
    T = np.eye(4)
    made = joint(T_parent_joint=T)
    T[0, 3] = 1.0
    assert made.T_parent_joint[0, 3] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        made.T_parent_joint[0, 3] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        made.name = "k"


def test_descriptions_can_be_pickled_and_copied():
    robot = tree("a r b\nb f c")
    assert robot.leaves == ("c",)
    for other in (pickle.loads(pickle.dumps(robot)), copy.deepcopy(robot)):
        assert np.array_equal(other.chain().home, robot.chain().home)


def test_lookup():
    robot = tree("a r b\na f c\nb f d")
    assert robot.root == "a"
    assert robot.leaves == ("c", "d")
    assert robot.joint("b_joint").child == "b"
    assert robot.link("d").name == "d"
    assert robot.joint_above("a") is None
    assert robot.joint_above("d").name == "d_joint"
    assert [j.name for j in robot.joints_below("a")] == ["b_joint", "c_joint"]
    assert [(s.joint.name, s.forward) for s in robot.path("c", "d")] == [
        ("c_joint", False),
        ("b_joint", True),
        ("d_joint", True),
    ]
    with pytest.raises(UnknownNameError, match=r"no joint 'b_joynt'.*did you mean 'b_joint'"):
        robot.joint("b_joynt")
    with pytest.raises(UnknownNameError, match="no link 'e' in description 'robot'; links are: a, b, c, d"):
        robot.chain(tip="e")


def test_twenty_thousand_links_take_no_recursion():
    n = 20_000
    links = tuple(Link(f"l{i}") for i in range(n))
    joints = tuple(joint(f"j{i}", "fixed", f"l{i}", f"l{i + 1}") for i in range(n - 1))
    robot = Description("long", links, joints)
    assert robot.chain(tip=f"l{n - 1}").dof == 0
    comb = tuple(joint(f"j{i}", "revolute", f"l{i // 2}", f"l{i + 1}") for i in range(n - 1))
    with pytest.raises(AmbiguousError, match=r"and [0-9]+ more"):
        Description("bush", links, comb).chain()


# --- the one sensible chain

HAND = "{last} f hand\nhand p left_finger\nhand p right_finger"
SENSIBLE = {
    "single leaf": (arm("base", "a", 6, "{last} f flange\nflange f sensor"), "base", "sensor", 6),
    "tool frame beside the base frame": (
        "base_link f base\n" + arm("base_link", "a", 6, "{last} f ft_frame\n{last} f flange\nflange f tool0"),
        "base_link",
        "tool0",
        6,
    ),
    "tool0 before ee_link": (arm("base", "a", 6, "{last} f ee_link\n{last} f tool0"), "base", "tool0", 6),
    "tcp of a hand": (arm("base", "a", 7, HAND + "\nhand f hand_tcp"), "base", "hand_tcp", 7),
    "hand without tcp": (arm("base", "a", 7, HAND), "base", "hand", 7),
    "tool0 beside the hand": (arm("base", "a", 6, "{last} f tool0\n" + HAND), "base", "tool0", 6),
    "one jaw after the tool frame": (
        arm("base", "a", 5, "{last} f gripper_frame_link\n{last} r jaw"),
        "base",
        "gripper_frame_link",
        5,
    ),
    "hand with long fingers": (
        arm("base", "a", 7, "{last} f palm\n" + "\n".join(arm("palm", f"finger{k}_", 4) for k in range(3))),
        "base",
        "palm",
        7,
    ),
    "hand with a longer thumb": (
        arm("base", "a", 7, "{last} f palm\n" + arm("palm", "finger", 2) + arm("palm", "thumb", 3)),
        "base",
        "palm",
        7,
    ),
    "wheels and arm": (
        "\n".join(f"base c wheel{k}" for k in range(4)) + "\n" + arm("base", "a", 5, HAND),
        "base",
        "hand",
        5,
    ),
    "casters and arm": (
        "\n".join(f"base c fork{k}\nfork{k} c wheel{k}" for k in range(4)) + "\n" + arm("base", "a", 5),
        "base",
        "a5",
        5,
    ),
    "torso, head and arm": ("base p torso\ntorso r pan\npan r tilt\n" + arm("torso", "a", 7), "base", "a7", 8),
    "cameras at the wrist": (arm("base", "a", 6, "{last} f color\n{last} f depth"), "base", "a6", 6),
    "camera on the way": (
        "b f base\n" + arm("base", "a", 3, "{last} f camera\n" + arm("{last}", "w", 3)),
        "b",
        "w3",
        6,
    ),
    "scara with a gripper": (arm("base", "a", 3, "{last} p left\n{last} p right"), "base", "a3", 3),
    "nothing moves": ("a f b\nb f c", "a", "c", 0),
}


@pytest.mark.parametrize("shape", SENSIBLE)
def test_the_sensible_chain(shape):
    text, base, tip, dof = SENSIBLE[shape]
    chain = tree(text).chain()
    assert (chain.base, chain.tip, chain.dof) == (base, tip, dof)


AMBIGUOUS = {
    "two arms": (
        "torso f base\n" + arm("torso", "left", 7) + arm("torso", "right", 7),
        ["torso -> left7 (7 joints)", "torso -> right7 (7 joints)"],
    ),
    "arms of unequal length": (arm("torso", "left", 7) + arm("torso", "right", 6), ["left7 (7 joints)", "right6 (6"]),
    "two arms with hands": (
        arm("b", "t", 2)
        + "\n".join(arm("t2", k, 7, HAND.replace("hand", f"hand_{k}").replace("_finger", f"_{k}")) for k in "lr"),
        ["b -> hand_l (9 joints)", "b -> hand_r (9 joints)"],
    ),
    "a gripper alone": ("palm p left\npalm p right", ["palm -> left (1 joints)", "palm -> right (1 joints)"]),
}


@pytest.mark.parametrize("shape", AMBIGUOUS)
def test_ambiguous_chains_are_listed(shape):
    text, listed = AMBIGUOUS[shape]
    with pytest.raises(AmbiguousError) as caught:
        tree(text).chain()
    assert "choose one with base= and tip=" in str(caught.value)
    for candidate in listed:
        assert candidate in str(caught.value)


def test_a_base_narrows_the_choice():
    robot = tree("torso f base\n" + arm("torso", "left", 7) + arm("torso", "right", 7))
    assert robot.chain(base="left1").tip == "left7"
    assert robot.chain(tip="right7").base == "torso"


def test_a_frame_beside_the_arm_can_be_the_base():
    robot = tree("base_link f base\n" + arm("base_link", "a", 6, "{last} f tool0"))
    chain = robot.chain(base="base")
    assert (chain.base, chain.tip, chain.dof) == ("base", "tool0", 6)


def test_ends_named_by_the_description():
    text = arm("root", "a", 6, "{last} f tool0")
    robot = tree(text, base="a1", tip="a5")
    assert repr(robot.chain()) == "Chain('robot', 4 joints, 'a1' -> 'a5')"
    assert robot.chain(tip="tool0").base == "a1"
    assert robot.chain(base="root").tip == "a5"
    assert robot.chain(base="a5").tip == "tool0"


# --- what a chain holds


@pytest.mark.parametrize("kind", ["F", "P"])
def test_floating_and_planar_joints_on_the_path_are_named(kind):
    robot = tree(f"world {kind} base\n" + arm("base", "a", 3))
    with pytest.raises(UrdfError) as caught:
        robot.chain()
    assert caught.value.element == "joint 'base_joint'"
    assert "unsupported in a serial chain" in caught.value.reason
    assert "base='base'" in caught.value.reason
    assert robot.chain(base="base").dof == 3  # off the path it does no harm


def test_limits_and_names():
    robot = Description(
        "robot",
        (Link("a"), Link("b"), Link("c"), Link("d")),
        (
            joint("turn", "revolute", "a", "b", lower=-1, upper=2, velocity=3, effort=4),
            joint("spin", "continuous", "b", "c", lower=-1, upper=2),
            joint("slide", "prismatic", "c", "d", axis=[0, 0, 3], upper=0.5),
        ),
    )
    chain = robot.chain()
    assert chain.joint_names == ("turn", "spin", "slide")
    assert chain.limits.tolist() == [[-1, 2], [-inf, inf], [-inf, 0.5]]
    assert chain.max_velocity.tolist() == [3, inf, inf]
    assert chain.max_effort.tolist() == [4, inf, inf]
    assert chain.screws[2].tolist() == [0, 0, 1, 0, 0, 0]
    assert [f.name for f in chain.frames] == ["a", "b", "c", "d"]
    assert [f.after for f in chain.frames] == [0, 1, 2, 3]


def test_mimic_joints_are_coupled():
    def along_z(height: float) -> np.ndarray:
        T = np.eye(4)
        T[2, 3] = height
        return T

    robot = Description(
        "robot",
        tuple(Link(name) for name in "abcde"),
        (
            joint("j", "revolute", "a", "b", axis=[0, 0, 1], lower=-1, upper=1),
            Joint("k", "revolute", "b", "c", along_z(1), [1, 0, 0], mimic=Mimic("j", 2.0, 0.25)),
            Joint("l", "prismatic", "c", "d", along_z(1), [0, 0, 1], mimic=Mimic("k", -0.5, 0.125)),
            joint("m", "revolute", "d", "e", axis=[0, 1, 0], mimic=Mimic("j", 0.0, 0.5)),
        ),
    )
    chain = robot.chain()
    assert chain.joint_names == ("j",)
    assert chain.coupling.tolist() == [[1.0], [2.0], [-1.0]]  # the one with multiplier 0 is part of the home pose
    q = 0.3
    Rz, Rx = np.eye(4), np.eye(4)
    Rz[:2, :2] = [[np.cos(q), -np.sin(q)], [np.sin(q), np.cos(q)]]
    k = 2 * q + 0.25
    Rx[1:3, 1:3] = [[np.cos(k), -np.sin(k)], [np.sin(k), np.cos(k)]]
    Ry = np.eye(4)
    Ry[0, 0] = Ry[2, 2] = np.cos(0.5)
    Ry[0, 2], Ry[2, 0] = np.sin(0.5), -np.sin(0.5)
    expected = Rz @ along_z(1) @ Rx @ along_z(1 - 0.5 * k + 0.125) @ Ry
    np.testing.assert_allclose(fk(chain, [q]), expected, rtol=0, atol=COMPOSING)
    # from c on, the master lies off the path and is a joint all the same
    tail = robot.chain(base="b")
    assert tail.joint_names == ("j",)
    assert tail.limits.tolist() == [[-1, 1]]
    np.testing.assert_allclose(fk(tail, [q]), np.linalg.inv(Rz) @ expected, rtol=0, atol=COMPOSING)


def test_mimic_that_overflows_is_refused():
    links = tuple(Link(f"l{i}") for i in range(42))
    joints = [joint("j0", "revolute", "l0", "l1")]
    joints += [joint(f"j{i}", "revolute", f"l{i}", f"l{i + 1}", mimic=Mimic(f"j{i - 1}", 1e9)) for i in range(1, 41)]
    robot = Description("robot", links, tuple(joints))
    with pytest.raises(DescriptionError, match="mimic"):
        robot.chain()


def joint_values(robot: Description, seed: int) -> dict[str, float]:
    rng = np.random.default_rng(seed)
    return {j.name: float(rng.uniform(-pi, pi)) for j in robot.joints}


def pose(chain: Chain, values: dict[str, float]) -> np.ndarray:
    return fk(chain, [values[name] for name in chain.joint_names])


@given(urdf_trees(), st.data(), st.integers(0, 2**31))
def test_chains_between_any_links_compose(text, data, seed):
    robot = from_urdf(text)
    values = joint_values(robot, seed)
    names = st.sampled_from([link.name for link in robot.links])
    a, b, c = data.draw(names), data.draw(names), data.draw(names)
    T_a_b, T_b_c, T_a_c, T_b_a = (pose(robot.chain(x, y), values) for x, y in ((a, b), (b, c), (a, c), (b, a)))
    np.testing.assert_allclose(T_a_b @ T_b_c, T_a_c, rtol=0, atol=COMPOSING * 10)
    np.testing.assert_allclose(T_a_b @ T_b_a, np.eye(4), rtol=0, atol=COMPOSING * 10)


@given(urdf_trees(), st.data(), st.integers(0, 2**31))
def test_every_frame_of_a_chain_is_the_chain_to_that_link(text, data, seed):
    robot = from_urdf(text)
    values = joint_values(robot, seed)
    names = st.sampled_from([link.name for link in robot.links])
    base, tip = data.draw(names), data.draw(names)
    chain = robot.chain(base, tip)
    q = [values[name] for name in chain.joint_names]
    assert [f.name for f in chain.frames][:: len(chain.frames) - 1 or 1] == [base, tip][: len(chain.frames)]
    for frame in chain.frames:
        expected = pose(robot.chain(base, frame.name), values)
        np.testing.assert_allclose(fk_frame(chain, q, frame), expected, rtol=0, atol=COMPOSING * 10)


# --- back from a chain


@given(urdf_trees(), st.data())
def test_a_chain_written_and_read_is_the_same_chain(text, data):
    robot = from_urdf(text)
    names = st.sampled_from([link.name for link in robot.links])
    chain = robot.chain(data.draw(names), data.draw(names))
    again = from_urdf(as_urdf(chain)).chain(chain.base, chain.tip)
    assert_same_chain(again, chain)
    assert_same_chain(from_urdf(as_urdf(again)).chain(chain.base, chain.tip), chain)


def assert_same_chain(chain: Chain, expected: Chain) -> None:
    assert chain.name == expected.name
    assert chain.joint_names == expected.joint_names
    assert (chain.base, chain.tip) == (expected.base, expected.tip)
    for key in ("screws", "home", "coupling"):
        np.testing.assert_allclose(getattr(chain, key), getattr(expected, key), rtol=0, atol=COMPOSING, err_msg=key)
    assert np.array_equal(chain.limits, expected.limits)
    assert np.array_equal(chain.max_velocity, expected.max_velocity)
    assert np.array_equal(chain.max_effort, expected.max_effort)
    homes = {frame.name: frame for frame in chain.frames}
    for frame in expected.frames:  # more frames may have come between
        assert homes[frame.name].after == frame.after
        np.testing.assert_allclose(homes[frame.name].home, frame.home, rtol=0, atol=COMPOSING)


def screw(axis, point) -> list[float]:
    return [*np.cross(point, axis), *axis]


def test_a_chain_from_screws_alone_becomes_a_description():
    home = np.eye(4)
    home[:3, 3] = [0.9, 0.1, 1.2]
    chain = Chain(
        "from_screws",
        [screw([0, 0, 1], [0, 0, 0]), screw([0, 1, 0], [0.15, 0, 0.4]), [0, 0, 1, 0, 0, 0]],
        home,
        [[-3, 3], [-inf, inf], [0, 0.2]],
        ("pan", "lift", "slide"),
    )
    robot = Description.from_chain(chain)
    assert [j.type for j in robot.joints if j.moves] == ["revolute", "continuous", "prismatic"]
    assert_same_chain(robot.chain(), chain)
    assert_same_chain(from_urdf(as_urdf(chain)).chain(), chain)


def test_a_frame_off_its_axis_gets_a_link_between():
    T = np.eye(4)
    T[:3, 3] = [1, 0, 0]
    chain = Chain(
        "c",
        [screw([0, 0, 1], [0.5, 0, 0])],
        T,
        [[-1, 1]],
        ("j",),
        frames=(Frame("base", 0, np.eye(4)), Frame("tip", 1, T)),
    )
    robot = Description.from_chain(chain)
    assert [link.name for link in robot.links] == ["base", "j_axis", "tip"]
    assert_same_chain(robot.chain(), chain)


def test_axes_that_share_a_joint_become_mimic_joints():
    chain = Chain(
        "c",
        [screw([0, 0, 1], [0, 0, 0]), screw([0, 0, 1], [1, 0, 0])],
        np.eye(4),
        [[-1, 2]],
        ("j",),
        coupling=[[1.0], [-2.0]],
    )
    robot = Description.from_chain(chain)
    mimic = robot.joints[1]
    assert (mimic.name, mimic.mimic) == ("j_mimic", Mimic("j", -2.0, 0.0))
    assert (mimic.lower, mimic.upper) == (-4.0, 2.0)
    assert_same_chain(from_urdf(as_urdf(chain)).chain(), chain)
    both = Chain("c", chain.screws, np.eye(4), [[-1, 2], [-1, 1]], ("j", "k"), coupling=[[1.0, 0.0], [1.0, 1.0]])
    with pytest.raises(UrdfError, match="c: axis 2: depends on 2 joints at once"):
        as_urdf(both)
