"""Meshes of a description: drawn when they can be read, replaced with a warning that names the file when not."""

from __future__ import annotations

import struct
import warnings

import numpy as np
import pytest

import pieper
from pieper.errors import PieperWarning
from pieper.model import shape
from pieper.model.description import Box
from pieper.sim import meshes
from pieper.sim.picture import Picture

pytestmark = pytest.mark.usefixtures("can_draw")

SINGLE = 1e-6  # [relative] STL files hold single precision


def as_stl(mesh, factor=1.0):
    records = [struct.pack("<12fH", 0, 0, 0, *(factor * mesh.vertices[face]).ravel(), 0) for face in mesh.faces]
    return bytes(80) + struct.pack("<I", len(records)) + b"".join(records)


def as_obj(mesh):
    lines = [f"v {x} {y} {z}" for x, y, z in mesh.vertices] + ["f {} {} {}".format(*(face + 1)) for face in mesh.faces]
    return "\n".join(lines).encode()


BLOCK = shape.as_mesh(Box(np.array([0.3, 0.1, 0.2])))
URDF = """<robot name="two"><link name="base"><visual><geometry><box size="0.2 0.2 0.1"/></geometry></visual></link>
<link name="arm"><visual><origin xyz="0.2 0 0.1"/><geometry><mesh filename="FILE" scale="SCALE"/></geometry>
<material name="m"><color rgba="1 0 0 1"/></material></visual></link><link name="tip"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.1"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
<joint name="end" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="0.4 0 0"/></joint></robot>"""


def arm_with(tmp_path, name, content, scale="1 1 1"):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    (tmp_path / "two.urdf").write_text(URDF.replace("FILE", name).replace("SCALE", scale))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PieperWarning)  # reading the description says that a file is missing, too
        return pieper.load(tmp_path / "two.urdf")


def surfaces(arm):
    picture = Picture(size=(64, 64))
    picture.add_arm(arm, [0.0])
    return picture.stage.arms[0].bodies


@pytest.mark.parametrize(
    ("name", "content"), [("block.stl", as_stl(BLOCK)), ("block.obj", as_obj(BLOCK)), ("B.STL", as_stl(BLOCK))]
)
def test_a_mesh_is_where_the_description_puts_it(tmp_path, name, content):
    arm = arm_with(tmp_path, name, content)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        base, block = surfaces(arm)
    assert (base.link, block.link) == (0, 1)
    assert block.color == "#ff0000"
    low, high = block.mesh.vertices.min(axis=0), block.mesh.vertices.max(axis=0)
    np.testing.assert_allclose([low, high], [[0.05, -0.05, 0.0], [0.35, 0.05, 0.2]], atol=SINGLE)
    a, b, c = (block.mesh.vertices[block.mesh.faces[:, k]] for k in range(3))
    center = np.array([0.2, 0.0, 0.1])
    assert np.einsum("ij,ij->", a - center, np.cross(b - center, c - center)) / 6.0 == pytest.approx(0.006, rel=1e-5)
    picture = Picture(size=(160, 120), grid=False)
    picture.add_arm(arm, [0.3])
    red, green, blue = (picture.image()[..., k].astype(int) for k in range(3))
    assert ((red - np.maximum(green, blue)) > 60).mean() > 0.02


def test_a_mirrored_mesh_is_not_turned_inside_out(tmp_path):
    block = surfaces(arm_with(tmp_path, "block.stl", as_stl(BLOCK), scale="1 -1 1"))[1]
    a, b, c = (block.mesh.vertices[block.mesh.faces[:, k]] - [0.2, 0.0, 0.1] for k in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0.0


def test_a_mesh_in_millimetres_is_recognised_and_said(tmp_path):
    arm = arm_with(tmp_path, "block.stl", as_stl(BLOCK, 1000.0))
    with pytest.warns(PieperWarning, match=r"block\.stl of link 'arm' is 300 m large .* taken to be in millimetres"):
        block = surfaces(arm)[1]
    assert np.ptp(block.mesh.vertices, axis=0).max() == pytest.approx(0.3, rel=1e-5)


BROKEN = {
    "missing.stl": (None, r"missing\.stl"),
    "empty.stl": (b"", r"empty\.stl of link 'arm' cannot be read"),
    "cut.stl": (as_stl(BLOCK)[:-30], r"cut\.stl of link 'arm' cannot be read"),
    "nonsense.obj": (b"v 1 2\nf 9 9 9\n", r"nonsense\.obj of link 'arm' cannot be read"),
    "scene.dae": (
        b"<COLLADA/>",
        r"scene\.dae of link 'arm' cannot be read: \.dae is not drawn here, only \.stl, \.obj",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_mesh_that_cannot_be_read_is_named_and_a_shape_drawn_instead(tmp_path, name):
    content, message = BROKEN[name]
    with pytest.warns(PieperWarning, match=message + r".*; a shape made from the chain is drawn instead"):
        bodies = surfaces(arm_with(tmp_path, name, content))
    assert {body.link for body in bodies} == {0, 1}
    assert len(bodies) > 2


def test_a_huge_mesh_is_refused_with_its_size(tmp_path, monkeypatch):
    monkeypatch.setattr(meshes, "LARGEST_MESH", 100)
    with pytest.warns(PieperWarning, match="it has 0 MB, more than 0 MB"):
        surfaces(arm_with(tmp_path, "huge.stl", as_stl(BLOCK)))


def test_the_shape_can_be_asked_for(tmp_path):
    picture = Picture(size=(64, 64))
    picture.add_arm(arm_with(tmp_path, "block.stl", as_stl(BLOCK)), [0.0], meshes=False)
    assert len(picture.stage.arms[0].bodies) > 2


def test_a_description_without_shapes_is_drawn_by_its_chain():
    assert meshes.bodies_of_description(pieper.load("mh12").description, pieper.load("mh12").chain, "#ffffff") is None
