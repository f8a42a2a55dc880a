"""Well-formed URDFs: what is read, that it moves as Pinocchio says, and that written URDFs read as the same robot."""

from __future__ import annotations

import warnings
from math import inf, pi
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pieper.errors import PieperWarning, UrdfError
from pieper.model.chain import Chain
from pieper.model.description import (
    Box,
    Capsule,
    Collision,
    Cylinder,
    Description,
    Inertial,
    Joint,
    Link,
    Material,
    Mesh,
    Mimic,
    Sphere,
    Visual,
)
from pieper.model.urdf import as_urdf, from_urdf
from pieper.spatial._rpy import rotation_from_rpy, rpy_from_rotation
from tests.model.random_trees import ANGLE, urdf_trees
from tests.reference.product_of_exponentials import fk

POSE = 1e-12  # the agreement asked for; rounding over ten metre-sized joints stays below 1e-13
TURN = 4e-15  # a rotation through roll, pitch, yaw and back: a dozen roundings of numbers up to 1

ARM = """
<robot name="two">
  <material name="steel"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="base"><visual><geometry><box size="1 2 3"/></geometry><material name="steel"/></visual></link>
  <link name="upper"/>
  <link name="tool0"/>
  <joint name="shoulder" type="revolute">
    <origin xyz="0 0 0.5" rpy="0 0 1.5707963267948966"/>
    <parent link="base"/> <child link="upper"/>
    <axis xyz="0 0 2"/>
    <limit lower="-1" upper="2" effort="10" velocity="3"/>
  </joint>
  <joint name="elbow" type="continuous">
    <parent link="upper"/> <child link="tool0"/> <origin xyz="1 0 0"/> <axis xyz="0 1 0"/>
  </joint>
  <gazebo reference="base"><joint name="not_a_joint"/></gazebo>
  <transmission name="t"><joint name="shoulder"/></transmission>
</robot>
"""


def test_joints_are_read():
    robot = from_urdf(ARM)
    assert (robot.name, robot.root, robot.leaves, robot.source) == ("two", "base", ("tool0",), "<string>")
    shoulder = robot.joint("shoulder")
    assert (shoulder.lower, shoulder.upper, shoulder.velocity, shoulder.effort) == (-1, 2, 3, 10)
    assert shoulder.axis.tolist() == [0, 0, 1]
    elbow = robot.joint("elbow")
    assert (elbow.lower, elbow.upper, elbow.velocity, elbow.effort) == (-inf, inf, inf, inf)
    chain = robot.chain()
    np.testing.assert_allclose(chain.home[:3, 3], [0, 1, 0.5], atol=POSE)
    np.testing.assert_allclose(chain.screws[1], [0, -0.5, 1, -1, 0, 0], atol=POSE)


HEADERS = {
    "none": ARM,
    "plain": '<?xml version="1.0"?>' + ARM,
    "utf-8": '<?xml version="1.0" encoding="utf-8"?>' + ARM,
    "UTF-8 standalone": '<?xml version="1.0" encoding="UTF-8" standalone="yes"?>' + ARM,
    "another encoding": '<?xml version="1.0" encoding="ISO-8859-1"?>' + ARM.replace("tool0", "Grüße"),
    "utf-16 in a str": '<?xml version="1.0" encoding="utf-16"?>' + ARM,
    "space before it": '\n  <?xml version="1.0" encoding="utf-8"?>' + ARM,
    "byte order mark": "\ufeff" + '<?xml version="1.0" encoding="utf-8"?>' + ARM,
}


@pytest.mark.parametrize("header", HEADERS)
def test_row_e4_text_with_an_encoding_header(header):
    robot = from_urdf(HEADERS[header])
    assert robot.chain().joint_names == ("shoulder", "elbow")
    assert robot.leaves == (("Grüße",) if header == "another encoding" else ("tool0",))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "iso-8859-1"])
def test_bytes_in_their_encoding(encoding):
    text = f'<?xml version="1.0" encoding="{encoding.removesuffix("-sig")}"?>' + ARM.replace("tool0", "Grüße")
    assert from_urdf(text.encode(encoding)).leaves == ("Grüße",)


def test_files(tmp_path):
    file = tmp_path / "two.urdf"
    file.write_text(ARM)
    for what in (file, str(file)):
        robot = from_urdf(what)
        assert robot.source == str(file)
    with pytest.raises(UrdfError, match="cannot be read: No such file") as caught:
        from_urdf(str(tmp_path / "three.urdf"))
    assert caught.value.source == str(tmp_path / "three.urdf")
    with pytest.raises(UrdfError, match="not a regular file") as caught:
        from_urdf(tmp_path)
    assert str(caught.value) == f"{tmp_path}: file: is not a regular file; give the URDF file itself"


def test_a_default_namespace_is_read_over():
    assert from_urdf(ARM.replace("<robot ", '<robot xmlns="http://www.ros.org" ')).leaves == ("tool0",)


def test_fixed_joint_with_a_zero_axis_is_fine():
    text = """<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="fixed">
    <parent link="a"/><child link="b"/><axis xyz="0 0 0"/></joint></robot>"""
    assert from_urdf(text).chain().dof == 0


def joint_with(inside: str, kind: str = "revolute") -> str:
    return f"""<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="{kind}">
    <parent link="a"/><child link="b"/>{inside}</joint></robot>"""


@pytest.mark.parametrize("inside", ["", '<limit effort="1" velocity="1"/>', '<limit upper="1"/>'])
@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_missing_limits_are_unlimited_with_a_warning(inside, kind):
    with pytest.warns(PieperWarning, match="no lower or no upper limit for joint 'j'; taken as unlimited on that side"):
        robot = from_urdf(joint_with(inside, kind))
    assert robot.joint("j").lower == -inf


@pytest.mark.parametrize("none", ["1e30", "3.4028234663852886e+38", "1.7976931348623157e+308"])
def test_what_exporters_write_for_no_limit(none):
    limit = f'<limit lower="-{none}" upper="{none}" velocity="{none}" effort="{none}"/>'
    joint = from_urdf(joint_with(limit)).joint("j")
    assert (joint.lower, joint.upper, joint.velocity, joint.effort) == (-inf, inf, inf, inf)


SHAPES = """
<robot name="shapes">
  <material name="red"><color rgba="1 0 0 1"/></material>
  <link name="body">
    <inertial>
      <origin xyz="0 0 0.1" rpy="0 0 0"/><mass value="2.5"/>
      <inertia ixx="1" ixy="0.1" ixz="0.2" iyy="2" iyz="0.3" izz="3"/>
    </inertial>
    <visual name="shell">
      <origin xyz="1 2 3"/><geometry><mesh filename="shell.stl" scale="0.001 0.001 0.001"/></geometry>
      <material name="red"/>
    </visual>
    <visual><geometry><sphere radius="0.5"/></geometry><material name="wood"><texture filename="wood.png"/></material></visual>
    <collision><geometry><cylinder radius="0.1" length="2"/></geometry></collision>
    <collision><geometry><capsule radius="0.1" length="2"/></geometry></collision>
    <collision name="box"><geometry><box size="1 2 3"/></geometry></collision>
  </link>
</robot>
"""


def check_shapes(robot: Description) -> None:
    link = robot.link("body")
    assert isinstance(link.inertial, Inertial)
    assert link.inertial.mass == 2.5
    assert link.inertial.inertia.tolist() == [[1, 0.1, 0.2], [0.1, 2, 0.3], [0.2, 0.3, 3]]
    assert link.inertial.T_link_inertial[2, 3] == 0.1
    shell, ball = link.visuals
    assert isinstance(shell.geometry, Mesh)
    assert (shell.name, shell.geometry.filename) == ("shell", "shell.stl")
    assert shell.geometry.scale.tolist() == [0.001] * 3
    assert shell.T_link_shape[:3, 3].tolist() == [1, 2, 3]
    assert shell.material == Material("red", (1, 0, 0, 1))
    assert ball.geometry == Sphere(0.5)
    assert ball.material == Material("wood", None, "wood.png")
    cylinder, capsule, box = link.collisions
    assert (cylinder.geometry, capsule.geometry, box.name) == (Cylinder(0.1, 2.0), Capsule(0.1, 2.0), "box")
    assert isinstance(box.geometry, Box)
    assert box.geometry.size.tolist() == [1, 2, 3]


def test_shapes_and_inertia_are_read_and_written(tmp_path):
    (tmp_path / "shell.stl").write_text("solid")
    file = tmp_path / "shapes.urdf"
    file.write_text(SHAPES)
    robot = from_urdf(file)
    assert robot.link("body").visuals[0].geometry.path == str(tmp_path / "shell.stl")
    check_shapes(robot)
    check_shapes(from_urdf(as_urdf(robot), beside=file))


def test_missing_meshes_give_one_warning():
    with pytest.warns(
        PieperWarning, match="<string>: mesh not found: 'shell.stl' of link 'body'; kinematics works"
    ) as caught:
        robot = from_urdf(SHAPES)
    assert len(caught) == 1
    assert robot.link("body").visuals[0].geometry.path is None
    check_shapes(robot)
    many = SHAPES.replace(
        "<collision><geometry><cylinder",
        "".join(f'<collision><geometry><mesh filename="{i}.stl"/></geometry></collision>' for i in range(7))
        + "<collision><geometry><cylinder",
    )
    with pytest.warns(PieperWarning, match="and 3 more; kinematics works without it") as caught:
        from_urdf(many)
    assert len(caught) == 1


def test_packages_of_meshes(tmp_path):
    mesh = tmp_path / "my_robot" / "meshes" / "shell.stl"
    mesh.parent.mkdir(parents=True)
    mesh.write_text("solid")
    text = SHAPES.replace("shell.stl", "package://my_robot/meshes/shell.stl")
    for packages in (tmp_path, [str(tmp_path)], {"my_robot": tmp_path / "my_robot"}, iter([tmp_path])):
        assert from_urdf(text, packages=packages).link("body").visuals[0].geometry.path == str(mesh)


# --- Pinocchio as the judge


def pinocchio_pose(text: str, base: str, tip: str, values: dict[str, float]) -> np.ndarray:
    pin = pytest.importorskip("pinocchio", reason="Pinocchio (pip install pin) is the judge of these poses")
    model = pin.buildModelFromXML(text)
    q = pin.neutral(model)
    for i in range(1, model.njoints):
        joint, value = model.joints[i], values[model.names[i]]
        q[joint.idx_q : joint.idx_q + joint.nq] = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    poses = [data.oMf[model.getFrameId(link, pin.FrameType.BODY)].homogeneous for link in (base, tip)]
    return np.linalg.inv(poses[0]) @ poses[1]


@settings(max_examples=200)
@given(urdf_trees(), st.data(), st.integers(0, 2**31))
def test_poses_equal_pinocchio(text, data, seed):
    robot = from_urdf(text)
    rng = np.random.default_rng(seed)
    values = {j.name: float(rng.uniform(-pi, pi)) for j in robot.joints}
    for j in robot.joints:  # masters come before the joints that follow them
        if j.mimic is not None:
            values[j.name] = j.mimic.multiplier * values[j.mimic.joint] + j.mimic.offset
    links = st.sampled_from([link.name for link in robot.links])
    base, tip = data.draw(links), data.draw(links)
    chain = robot.chain(base, tip)
    T = fk(chain, [values[name] for name in chain.joint_names])
    np.testing.assert_allclose(T, pinocchio_pose(text, base, tip, values), rtol=0, atol=POSE)


@given(urdf_trees(max_links=6), st.integers(0, 2**31))
def test_what_is_written_moves_the_same_in_pinocchio(text, seed):
    robot = from_urdf(text)
    tip = robot.links[-1].name
    rng = np.random.default_rng(seed)
    values = {j.name: float(rng.uniform(-pi, pi)) for j in robot.joints}
    for j in robot.joints:
        if j.mimic is not None:
            values[j.name] = j.mimic.multiplier * values[j.mimic.joint] + j.mimic.offset
    expected = pinocchio_pose(text, "l0", tip, values)
    np.testing.assert_allclose(pinocchio_pose(as_urdf(robot), "l0", tip, values), expected, rtol=0, atol=POSE)


# --- out and in again


@given(st.tuples(ANGLE, ANGLE, ANGLE))
@example((0.3, pi / 2, -0.7))
@example((0.3, -pi / 2, -0.7))
@example((0.3, pi / 2 - 1e-9, -0.7))
@example((3.0, -pi / 2 + 1e-16, 2.0))
@example((pi, pi / 2, pi))
def test_rotations_survive_roll_pitch_yaw_also_at_the_lock(rpy):
    R = rotation_from_rpy(*rpy)
    again = rotation_from_rpy(*rpy_from_rotation(R))
    np.testing.assert_allclose(again, R, rtol=0, atol=TURN)


@given(urdf_trees())
def test_a_description_written_and_read_is_the_same(text):
    robot = from_urdf(text)
    again = from_urdf(as_urdf(robot))
    assert [link.name for link in again.links] == [link.name for link in robot.links]
    for joint, expected in zip(again.joints, robot.joints, strict=True):
        for key in ("name", "type", "parent", "child", "lower", "upper", "velocity", "effort", "mimic"):
            assert getattr(joint, key) == getattr(expected, key)
        np.testing.assert_allclose(joint.T_parent_joint, expected.T_parent_joint, rtol=0, atol=TURN)
        if joint.type != "fixed":
            np.testing.assert_allclose(joint.axis, expected.axis, rtol=0, atol=TURN)


def test_limits_written_and_read():
    joints = (
        Joint("one_sided", "revolute", "a", "b", lower=0.0, velocity=0.1),
        Joint("endless", "prismatic", "b", "c", effort=5.0),
        Joint("spin", "continuous", "c", "d", velocity=2.0),
        Joint("follower", "revolute", "d", "e", lower=-1, upper=1, mimic=Mimic("one_sided", -1.0, 0.1)),
        Joint("loose", "floating", "e", "f"),
    )
    robot = Description("r", tuple(Link(name) for name in "abcdef"), joints)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the limits are written, so nothing is missing
        again = from_urdf(as_urdf(robot))
    for joint, expected in zip(again.joints, joints, strict=True):
        for key in ("type", "lower", "upper", "velocity", "effort", "mimic"):
            assert getattr(joint, key) == getattr(expected, key)


def test_names_are_escaped():
    name = "a <b> & \"c\" 'd'\n\t\u00e4"
    robot = Description(name, (Link(name),), ())
    again = from_urdf(as_urdf(robot))
    assert (again.name, again.root) == (name, name)
    with pytest.raises(UrdfError, match="holds a character that XML cannot carry"):
        as_urdf(Description("r", (Link("a\x00b"),), ()))


def test_what_the_reader_would_refuse_is_not_written():
    T = np.eye(4)
    T[0, 3] = 1.5e9
    with pytest.raises(
        UrdfError, match=r"joint 'base-tip': the origin must be within \+-1e\+09 to be written, got 1.5e\+09"
    ):
        as_urdf(Chain("far", np.zeros((0, 6)), T, np.zeros((0, 2)), ()))
    chain = Chain("c", np.eye(6)[[5, 5]], np.eye(4), [[-1, 1]], ("j",), coupling=[[1.0], [1e10]])
    with pytest.raises(UrdfError, match="joint 'j_mimic': the mimic must be within"):
        as_urdf(chain)


def test_written_chains_satisfy_urdfdom():
    pin = pytest.importorskip("pinocchio", reason="Pinocchio reads URDF through urdfdom")
    chain = Chain("c", [[0, 0, 0, 0, 0, 1], [1, 0, 0, 0, 0, 0]], np.eye(4), [[-1, 1], [-inf, inf]], ("turn", "slide"))
    model = pin.buildModelFromXML(as_urdf(chain))
    assert list(model.names) == ["universe", "turn", "slide"]


def test_visual_and_collision_are_kept_apart():
    robot = from_urdf(ARM)
    base = robot.link("base")
    assert isinstance(base.visuals[0], Visual)
    assert not any(isinstance(shape, Collision) for shape in base.visuals)
    assert base.visuals[0].material == Material("steel", (0.5, 0.5, 0.5, 1.0))


def test_relative_names_stay_relative_to_the_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("two.urdf").write_text(ARM)
    assert from_urdf("two.urdf").source == "two.urdf"


def test_a_joint_far_along_its_own_axis():
    """Rounding of p x w grows with the distance; the screw must still have no pitch (found by fuzzing)."""
    text = """<robot name="far"><link name="a"/><link name="b"/>
      <joint name="j" type="continuous"><parent link="a"/><child link="b"/>
        <origin xyz="3.1e8 2.7e8 1.9e8"/><axis xyz="3.1 2.7 1.9"/></joint></robot>"""
    screw = from_urdf(text).chain().screws[0]
    assert abs(screw[:3] @ screw[3:]) < 1e-9
