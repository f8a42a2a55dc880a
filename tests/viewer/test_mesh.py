"""What is drawn of a description: its meshes and shapes, or the shape of the chain and a warning that names the file."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import pieper
from pieper.errors import PieperWarning
from pieper.viewer import mesh as module
from pieper.viewer.mesh import bodies

trimesh = pytest.importorskip("trimesh", reason="the viewer's extra is not installed")

URDF = """<robot name="two">
  <link name="base"><visual><geometry><cylinder radius="0.1" length="0.2"/></geometry>
    <material name="m"><color rgba="1 0 0 1"/></material></visual></link>
  <link name="upper"><visual><origin xyz="0 0 0.5"/><geometry><mesh filename="{upper}" scale="{scale}"/></geometry></visual></link>
  <link name="tool0"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="b" type="revolute"><parent link="upper"/><child link="tool0"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
</robot>"""


@pytest.fixture
def described(tmp_path):
    """An arm of two joints, a metre long, whose upper link is a mesh."""

    def describe(upper, scale="1 1 1", content=None):
        file = tmp_path / "two.urdf"
        file.write_text(URDF.format(upper=upper, scale=scale), encoding="utf-8")
        if content is not None:
            (tmp_path / upper).write_bytes(content)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PieperWarning)  # reading a description tells of missing meshes too
            return pieper.load(file)

    return describe


def bar(extent=(0.1, 0.1, 1.0), fineness=0):
    part = trimesh.creation.box(extents=extent)
    for _ in range(fineness):
        part = part.subdivide()
    return part


def extent(body):
    corners = np.concatenate([surface.vertices for surface in body.surfaces])
    return corners.min(axis=0), corners.max(axis=0)


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "dae", "glb", "off"])
def test_meshes_are_drawn_where_the_description_puts_them(described, kind):
    if kind == "dae":
        pytest.importorskip("collada", reason="pycollada is not installed")
    arm = described(f"upper.{kind}", content=_exported(bar(), kind))
    with warnings.catch_warnings():
        warnings.simplefilter("error", PieperWarning)
        base, upper, tool = bodies(arm)
    assert (base.after, upper.after, tool.after) == (0, 1, 2)
    assert base.surfaces[0].color == (255, 0, 0)
    low, high = extent(upper)
    assert low == pytest.approx([-0.05, -0.05, 0.0], abs=1e-6)
    assert high == pytest.approx([0.05, 0.05, 1.0], abs=1e-6)


def _exported(part, kind):
    data = part.export(file_type=kind)
    return data.encode() if isinstance(data, str) else data


def test_the_scale_of_the_description_counts_and_a_mirror_turns_no_surface_inside_out(described):
    arm = described("upper.stl", scale="0.001 -0.001 0.001", content=_exported(bar((100, 100, 1000)), "stl"))
    upper = bodies(arm)[1].surfaces[0]
    assert extent(bodies(arm)[1])[1] == pytest.approx([0.05, 0.05, 1.0], abs=1e-6)
    solid = trimesh.Trimesh(upper.vertices, upper.faces)
    assert solid.volume == pytest.approx(0.01, rel=1e-5)


def test_a_missing_mesh_is_named_and_a_shape_drawn_instead(described):
    arm = described("package://nowhere/upper.stl")
    with pytest.warns(
        PieperWarning, match=r"package://nowhere/upper\.stl: there is no such file; a shape made from the joints"
    ):
        drawn = bodies(arm)
    assert [body.after for body in drawn] == [0, 1, 2]
    assert drawn[0].surfaces[0].color == (255, 0, 0)  # what can be drawn is
    assert len(drawn[1].surfaces[0].faces) > 100


@pytest.mark.parametrize(
    "content", [b"", b"solid nothing", b"\x00" * 83, b"<?xml version='1.0'?><nothing/>", b"\xff" * 4000]
)
@pytest.mark.parametrize("kind", ["stl", "dae", "obj", "glb"])
def test_a_broken_mesh_is_named_and_a_shape_drawn_instead(described, kind, content):
    arm = described(f"upper.{kind}", content=content)
    with pytest.warns(PieperWarning, match=rf"upper\.{kind}: .*; a shape made from the joints is drawn instead"):
        drawn = bodies(arm)
    assert [body.after for body in drawn] == [0, 1, 2]


def test_triangles_with_numbers_that_are_none_are_left_out(described):
    part = bar()
    part.vertices[3] = np.nan
    arm = described("upper.ply", content=trimesh.exchange.ply.export_ply(part))
    upper = bodies(arm)[1].surfaces[0]
    assert 0 < len(upper.faces) < 12
    assert np.isfinite(upper.vertices[upper.faces]).all()


def test_several_faults_are_one_warning(described):
    arm = described('gone.stl"/></geometry></visual><visual><geometry><mesh filename="away.stl')
    with pytest.warns(PieperWarning, match=r"gone\.stl: there is no such file \(and 1 more\)") as told:
        bodies(arm)
    assert len(told) == 1


def test_a_mesh_in_millimetres_is_recognised_and_said(described):
    arm = described("upper.stl", content=_exported(bar((100.0, 100.0, 1000.0)), "stl"))
    with pytest.warns(
        PieperWarning, match=r"upper\.stl: 500 m is too large for an arm of 1 m; taken to be in millimetres"
    ):
        drawn = bodies(arm)
    assert extent(drawn[1])[1] == pytest.approx([0.05, 0.05, 1.0], abs=1e-5)


def test_a_mesh_that_is_too_large_in_any_unit_is_not_drawn(described):
    arm = described("upper.stl", content=_exported(bar((100.0, 100.0, 1e6)), "stl"))
    with pytest.warns(
        PieperWarning, match=r"upper\.stl: 5e\+05 m is too large for an arm of 1 m, even in millimetres; a shape"
    ):
        bodies(arm)


def test_a_mesh_with_very_many_triangles_is_thinned_out_and_said(described):
    part = bar(fineness=7)
    assert len(part.faces) > 4 * module.MOST_TRIANGLES
    arm = described("upper.stl", content=_exported(part, "stl"))
    with pytest.warns(
        PieperWarning, match=rf"upper\.stl: {len(part.faces)} triangles are thinned out to {module.MOST_TRIANGLES}"
    ):
        upper = bodies(arm)[1]
    assert 100 < sum(len(surface.faces) for surface in upper.surfaces) <= module.MOST_TRIANGLES
    low, high = extent(upper)
    assert low == pytest.approx([-0.05, -0.05, 0.0], abs=0.01)  # within a cell of the grid
    assert high == pytest.approx([0.05, 0.05, 1.0], abs=0.01)


def test_a_huge_mesh_is_refused_with_its_size(described, monkeypatch):
    monkeypatch.setattr(module, "LARGEST_FILE", 500.0)
    arm = described("upper.stl", content=_exported(bar(), "stl"))
    with pytest.warns(PieperWarning, match=r"upper\.stl: 0 MB are more than the 0 MB that are read"):
        bodies(arm)
    monkeypatch.setattr(module, "LARGEST_FILE", 1e6)
    monkeypatch.setattr(module, "MOST_TRIANGLES_READ", 5)
    with pytest.warns(PieperWarning, match=r"upper\.stl: 12 triangles are more than the 5"):
        bodies(arm)


def test_meshes_can_be_left_alone(described):
    arm = described("gone.stl")
    with warnings.catch_warnings():
        warnings.simplefilter("error", PieperWarning)
        drawn = bodies(arm, meshes=False)
    assert all(surface.color != (255, 0, 0) for body in drawn for surface in body.surfaces)


def test_links_beside_the_chain_stand_still_with_the_link_that_carries_them(tmp_path):
    finger = (
        '<link name="finger"><visual><geometry><sphere radius="0.02"/></geometry></visual></link>'
        '<joint name="f" type="prismatic"><parent link="tool0"/><child link="finger"/><origin xyz="0 0.3 0"/>'
        '<axis xyz="0 1 0"/><limit lower="0.1" upper="0.2" velocity="1" effort="1"/></joint></robot>'
    )
    text = URDF.format(upper="none", scale="1 1 1").replace("</robot>", finger)
    text = text.replace('<mesh filename="none" scale="1 1 1"/>', '<sphere radius="0.1"/>')
    file = tmp_path / "two.urdf"
    file.write_text(text, encoding="utf-8")
    arm = pieper.load(file, tip="tool0")
    tool = bodies(arm)[-1]
    assert tool.frame == "tool0"
    assert extent(tool)[1][1] == pytest.approx(0.42, abs=1e-3)  # 0.3, the limit nearest 0, and the radius
