"""Pick tasks in files: those of the package, one of one's own with a URDF beside it, and what is wrong with a bad one, by line and field."""

from __future__ import annotations

import numpy as np
import pytest

from pieper.errors import UnknownNameError, WorldError
from pieper.model.description import Capsule, Sphere

pytest.importorskip("mujoco", reason="mujoco is not installed")

from pieper.tasks import pick_tasks
from pieper.tasks.pick_file import AHEAD, DOWN, read_pick_task

TWO_JOINTS = """<robot name="two"><link name="a"/><link name="b"/><link name="c"/>
  <joint name="j1" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="10" velocity="1"/></joint>
  <joint name="j2" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0.5 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="10" velocity="1"/></joint></robot>"""
PLAIN = pick_tasks.task_file("mh12").decode()


def written(tmp_path, text):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", pick_tasks.names())
def test_the_tasks_of_the_package_are_whole(name):
    task = pick_tasks.task(name.upper())
    assert task.name == name
    assert len(task.targets) == 9
    assert len(task.scene.cameras) >= 1
    lower, upper = task.arm.limits.T
    for q in (task.q_home, *task.postures):
        assert ((lower <= q) & (q <= upper)).all()
    for target in task.targets:  # in reach, straight ahead of the approach too
        T = task.grasp_at(task.scene.object(target).T_world_object)
        if not task.spin_free:
            assert task.arm.ik(T).count
            assert task.arm.ik(task.back(T, task.approach)).count


def test_a_task_of_ones_own(tmp_path):
    text = PLAIN.replace("name: mh12", "name: mine").replace("floor: 0.0", "floor: null")
    text = text.replace(
        "  cameras:",
        "  things:\n"
        "    - {name: post, capsule: {radius: 0.05, length: 1.0}, position: [0.0, -1.0, 0.5], rpy: [0, 0, 0.3], color: '#123456'}\n"
        "    - {name: ball, sphere: 0.05, position: [0.5, 0.5, 0.05], mass: 0.2, friction: 0.3, quaternion: [0, 0, 0, 1]}\n"
        "  cameras:",
    )
    text = text[: text.index("targets:")] + "targets: [ball]\n" + text[text.index("grasp:") :]
    text += "speed: 0.5\nattempts: 2\nyaw_noise: 0.1\nposition_noise: 1e-3\npostures: [[0, 0, 0, 0, 0, 0]]\n"
    task = read_pick_task(written(tmp_path, text))
    assert (task.name, task.targets, task.speed, task.attempts, task.yaw_noise) == ("mine", ("ball",), 0.5, 2, 0.1)
    assert task.position_noise == 1e-3
    assert task.scene.floor is None
    post, ball = task.scene.object("post"), task.scene.object("ball")
    assert (post.solid, post.mass, post.color) == (Capsule(0.05, 1.0), None, "#123456")
    assert (ball.solid, ball.mass, ball.friction) == (Sphere(0.05), 0.2, 0.3)
    np.testing.assert_allclose(post.T_world_object[:2, :2], [[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    np.testing.assert_array_equal(task.T_object_grasp, AHEAD)
    np.testing.assert_array_equal(task.T_world_drop[:3, :3], DOWN[:3, :3])
    assert len(task.postures) == 1


def test_an_arm_from_a_urdf_beside_the_file(tmp_path):
    (tmp_path / "arm.urdf").write_text(TWO_JOINTS)
    text = PLAIN.replace("arm: mh12", "arm: arm.urdf")
    start = text.index("q_home:")
    text = text[:start] + "q_home: [0.1, 0.2]\n" + text[text.index("approach:") :]
    assert read_pick_task(written(tmp_path, text)).arm.dof == 2
    with pytest.raises(WorldError, match=r"mine.yaml, line 3, arm: .*other.urdf: .*No such file"):
        read_pick_task(written(tmp_path, text.replace("arm.urdf", "other.urdf")))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("name: mh12\n", "", r"line 2, name: is missing|name: is missing"),
        ("arm: mh12", "arm: mh13", r"line 3, arm: no robot 'mh13'"),
        ("stroke: 0.09", "stroke: -0.09", r"line 4, gripper: stroke of a gripper must be above 0 and finite, got -0.09"),
        ("stroke: 0.09", "strok: 0.09", r"line 4, gripper.strok: no field 'strok'"),
        ("reach: 0.16", "reach: 0.01", r"line 4, gripper: reach 0.01 m must be longer than the pads"),
        ("x: [1.05, 1.27]", "x: [1.27, 1.05]", r"line 8, scene.shelves\[0\].x: must be the front and the back"),
        ("edges: [-0.45, -0.15, 0.15, 0.45]", "edges: [0.45]", r"line 8, scene.shelves\[0\].edges: must be two or more"),
        ("size: [0.5, 0.45, 0.3]", "size: [0.5, 0.45]", r"line 10, scene.boxes\[0\].size: must be 3 numbers in lists, got 2"),
        ("size: [0.5, 0.45, 0.3]", "size: [0.5, 0.45, .nan]", r"line 10, scene.boxes\[0\].size: must be a finite number"),
        ("size: [0.5, 0.45, 0.3]", "size: [0.5, -0.45, 0.3]", r"line 10, scene.boxes\[0\]: the sizes of 'bin/floor' must be above 0"),
        ("cylinder: {radius", "cone: {radius", r"targets.cone: no field 'cone'"),
        ("cylinder: {radius: 0.025, length: 0.12}", "comment: none", "comment"),
        ("mass: 0.25", "mass: 0", r"line 14, targets: the mass of 'can 1' must be above 0 kg"),
        ("facing: ahead", "facing: left", r"grasp.facing: must be ahead or down, got 'left'"),
        ("facing: down", "facing: down, rpy: [0, 0, 0]", r"drop.facing: rpy and facing both speak of the orientation"),
        ("facing: down", "quaternion: [0, 0, 0, 2]", r"drop.quaternion: must have length 1"),
        ("[0.25, 1.025, 0.3]]", "[0.25, 1.025, -0.3]]", r"bin_region: must be the lower and the upper corner"),
        ("q_home: [0.0,", "q_home: [9.0,", r"q_home: joint 'joint_1_s' at 9 is outside its limits"),
        ("q_home: [0.0,", "q_home: [", r"q_home: must be 6 numbers in lists, got 5"),
        ("lift: 0.02", "lift: -0.02", r"lift must be from 0 to 100, got -0.02"),
        ("approach: 0.14", "approach: 1e308", r"approach must be from 0 to 100, got 1e\+308"),
        ("lift: 0.02", "attempts: 0", r"attempts: must be at least 1, got 0"),
        ("lift: 0.02", "spin_free: sometimes", r"spin_free: must be true or false"),
        ("name: can\n", "name: shelf/\n", "mine"),
        ("eye: [-1.6, -1.9, 1.5]", "eye: [0.4, 0.25, 0.4]", r"scene.cameras\[0\]: eye and target must be different points"),
    ],
)  # fmt: skip
def test_a_bad_file_is_refused_by_line_and_field(tmp_path, old, new, words):
    assert old in PLAIN
    path = written(tmp_path, PLAIN.replace(old, new, 1))
    if words == "mine":  # an odd name is a name
        assert read_pick_task(path).targets[0] == "shelf/ 1"
        return
    with pytest.raises(WorldError, match=words) as caught:
        read_pick_task(path)
    assert str(caught.value).startswith(f"{path}, line ")


def test_targets_that_are_not_there_or_do_not_move(tmp_path):
    start, end = PLAIN.index("targets:"), PLAIN.index("grasp:")
    for names, words in (
        ("[cup]", "no object 'cup'"),
        ("[shelf/back]", "is fixed; give it a mass"),
        ("[]", "at least one thing"),
    ):
        path = written(tmp_path, PLAIN[:start] + f"targets: {names}\n" + PLAIN[end:])
        with pytest.raises(WorldError, match=words):
            read_pick_task(path)


def test_files_of_the_package_by_name():
    with pytest.raises(UnknownNameError, match="no pick task 'pr2'"):
        pick_tasks.task_file("pr2")
