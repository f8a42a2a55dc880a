"""The arm in the scene stands where forward kinematics says it is; every robot can be drawn."""

from __future__ import annotations

import math
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

import pieper
from pieper.errors import ArrayError
from pieper.model import catalog
from pieper.model.dh import from_dh
from pieper.spatial import rotation
from pieper.viewer.arm_view import ArmView, GhostsView
from pieper.viewer.mesh import bodies
from tests.robots import NAMES

ROUNDING = 1e-9  # of poses that are composed of a few others
SMALL = 2e-5  # viser leaves out what moves less than a hundred-thousandth, see numpy.allclose


class Scene:
    """The nodes of a scene by name, as viser would keep them."""

    def __init__(self):
        self.nodes = {}

    def add(self, name, *arguments, **options):
        node = SimpleNamespace(
            name=name, arguments=arguments, visible=True, position=np.zeros(3), wxyz=np.array([1.0, 0, 0, 0])
        )
        node.__dict__.update(options)
        node.remove = lambda: [
            self.nodes.pop(other) for other in list(self.nodes) if f"{other}/".startswith(f"{name}/")
        ]
        self.nodes[name] = node
        return node

    add_frame = add_mesh_simple = add_batched_meshes_simple = add_label = add_arrows = add

    def pose(self, name):
        T = np.eye(4)
        while name:
            node = self.nodes[name]
            here = np.eye(4)
            here[:3, :3] = rotation.from_quaternion(np.roll(node.wxyz, -1))
            here[:3, 3] = node.position
            T = here @ T
            name = name.rpartition("/")[0]
        return T


@pytest.fixture
def server():
    return SimpleNamespace(scene=Scene(), atomic=nullcontext)


def random_q(arm, seed=0):
    rng = np.random.default_rng(seed)
    return np.clip(rng.uniform(-1.5, 1.5, arm.dof), *arm.limits.T)


def arms():
    for name in NAMES:
        yield pytest.param(lambda name=name: pieper.load(name), id=name)
    for kind in ("simplified", "full"):
        yield pytest.param(
            lambda kind=kind: pieper.Arm(from_dh(catalog.dh_tables("youbot")[kind])), id=f"youbot-{kind}"
        )


@pytest.mark.parametrize("make", list(arms()))
def test_bodies_and_frames_are_where_forward_kinematics_says(make, server):
    arm = make()
    view = ArmView(server, "arm", arm)
    view.show_frames(True)
    q = random_q(arm)
    view.update(q)
    for number, frame in enumerate(arm.chain.frames):
        pose = server.scene.pose(f"/arm/{frame.after}/frame_{number}")
        np.testing.assert_allclose(pose, arm.fk(q, up_to=frame.name), rtol=0.0, atol=ROUNDING)
    assert any(len(body.surfaces[0].faces) > 10 for body in bodies(arm))


@pytest.mark.parametrize("kind", ["simplified", "full"], ids=["D7", "D10"])
def test_D7_D10_frames_of_the_youbot_tables_are_shown(kind, server):
    """Rows D7 and D10: one frame for each link, where the product of the rows of the table puts it."""
    table = catalog.dh_tables("youbot")[kind]
    arm = pieper.Arm(from_dh(table))
    view = ArmView(server, "youbot", arm)
    view.show_frames(True)
    q = random_q(arm, seed=3)
    view.update(q)
    shown = {
        frame.name: server.scene.pose(f"/youbot/{frame.after}/frame_{k}") for k, frame in enumerate(arm.chain.frames)
    }
    assert list(shown) == list(arm.frame_names)
    assert len(shown) >= 6
    for name, pose in shown.items():
        np.testing.assert_allclose(pose, arm.fk(q, up_to=name), rtol=0.0, atol=ROUNDING)
    labels = [node.arguments[0] for path, node in server.scene.nodes.items() if path.endswith("/name")]
    assert labels == list(arm.frame_names)


@pytest.mark.parametrize("name", ["mh12", "panda", "youbot", "kuka_kr210_robond"])
def test_axes_are_drawn_along_the_screws(name, server):
    arm = pieper.load(name)
    view = ArmView(server, "arm", arm)
    view.show_axes(True)
    q = random_q(arm, seed=1)
    view.update(q)
    J = arm.jacobian_space(q)
    arrows = [node for path, node in server.scene.nodes.items() if "axis_" in path and not path.endswith("/name")]
    assert len(arrows) == len(arm.chain.screws)
    for axis, node in enumerate(arrows):
        T = server.scene.pose(node.name)
        start, end = np.asarray(node.arguments[0], dtype=np.float64)[0] @ T[:3, :3].T + T[:3, 3]
        direction = (end - start) / np.linalg.norm(end - start)
        v, w = J[:3, axis], J[3:, axis]
        if not w.any():
            np.testing.assert_allclose(direction, v, atol=1e-6)
            continue
        np.testing.assert_allclose(direction, w, rtol=0.0, atol=1e-6)  # of single precision
        np.testing.assert_allclose(np.cross(start, w), v, rtol=0.0, atol=1e-5)


def test_an_arm_that_is_placed_elsewhere_moves_there_as_a_whole(server):
    arm = pieper.load("ur5e")
    T = np.eye(4)
    T[:3, :3] = rotation.from_rpy([0.3, 0.2, 0.1])
    T[:3, 3] = [1.0, 2.0, 3.0]
    view = ArmView(server, "arm", arm, T_world_base=T)
    view.show_frames(True)
    last = len(arm.chain.frames) - 1
    pose = server.scene.pose(f"/arm/{arm.chain.frames[last].after}/frame_{last}")
    np.testing.assert_allclose(pose, T @ arm.fk(view.q), rtol=0.0, atol=ROUNDING)


@pytest.mark.parametrize(
    "wrong", [[0.0] * 5, [math.nan] + [0.0] * 5, [math.inf] + [0.0] * 5, np.zeros((2, 6)), "abcdef", None]
)
def test_what_is_no_joint_vector_leaves_the_arm_as_it_was(wrong, server):
    view = ArmView(server, "arm", pieper.load("ur5e"))
    before = view.q
    with pytest.raises(ArrayError, match=r"q must|finite|shape"):
        view.update(wrong)
    assert view.q is before


def test_looks_can_be_changed_and_taken_back(server):
    view = ArmView(server, "arm", pieper.load("ur5e"), color=(1, 2, 3), opacity=0.5)
    meshes = [node for node in server.scene.nodes.values() if "flat_shading" in node.__dict__]
    assert {node.color for node in meshes} == {(1, 2, 3)}
    assert {node.opacity for node in meshes} == {0.5}
    view.color, view.opacity = None, 1.0
    assert len({node.color for node in meshes}) > 1
    assert {node.opacity for node in meshes} == {None}
    view.visible = False
    assert not server.scene.nodes["/arm"].visible
    view.show_frames(True)
    view.show_frames(False)
    assert not any(node.visible for path, node in server.scene.nodes.items() if "frame_" in path)
    view.remove()
    assert server.scene.nodes == {}


def test_ghosts_stand_where_the_solutions_are(server):
    arm = pieper.load("ur5e")
    answers = arm.ik(arm.fk([0.1, -1.2, 1.4, -1.7, -1.5, 0.3])).q
    ghosts = GhostsView(server, "ghosts", arm)
    rows = np.vstack([answers, np.full((1, 6), np.nan)])
    ghosts.update(rows, colors=[(k, 0, 0) for k in range(len(rows))])
    assert ghosts.count == len(answers) == 8
    for body, node in zip(
        [b for b in bodies(arm) if b.after > 0 for _ in b.surfaces],
        [n for p, n in server.scene.nodes.items() if p != "/ghosts"],
        strict=True,
    ):
        for k, q in enumerate(answers):
            T = arm.fk(q, up_to=body.frame)
            np.testing.assert_allclose(node.batched_positions[k], T[:3, 3], atol=1e-6)
            R = rotation.from_quaternion(np.roll(np.asarray(node.batched_wxyzs[k], dtype=np.float64), -1))
            np.testing.assert_allclose(R, T[:3, :3], atol=1e-6)
        assert node.batched_colors.tolist() == [[k, 0, 0] for k in range(8)]
    ghosts.update(np.empty((0, 6)))
    assert ghosts.count == 0
