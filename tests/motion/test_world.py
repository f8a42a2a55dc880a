"""Worlds of obstacles: what a file may say, and what it is told when it may not."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pieper.errors import ArrayError, UnknownNameError, WorldError
from pieper.model.description import Box, Capsule, Cylinder, Mesh, Sphere
from pieper.motion.world import Item, World, read_world, write_world
from pieper.spatial import rotation

AS_WRITTEN = 1e-12  # a quaternion goes through text, and is normalised


def read(tmp_path: Path, text: str) -> World:
    file = tmp_path / "world.yaml"
    file.write_text(text)
    return read_world(file)


def test_every_shape_is_read(tmp_path: Path) -> None:
    (tmp_path / "part.stl").write_text("solid x\nendsolid x\n")
    world = read(
        tmp_path,
        """
obstacles:
  - {name: a, box: [1, 2, 3], position: [1, 2, 3], rpy: [0, 0, 1.5]}
  - {name: b, cylinder: {radius: 0.1, length: 1e-1}}
  - {name: c, capsule: {radius: 0.1, length: 2}, quaternion: [0, 0, 0.6, 0.8]}
  - {name: d, sphere: 0.5, may_touch: [a, b]}
  - {name: e, mesh: {file: part.stl, scale: 0.001}}
""",
    )
    assert world.names == ("a", "b", "c", "d", "e")
    assert isinstance(world["a"].solid, Box)
    np.testing.assert_allclose(world["a"].pose[:3, :3], rotation.from_rpy([0.0, 0.0, 1.5]))
    assert world["b"].solid == Cylinder(0.1, 0.1)
    assert world["c"].solid == Capsule(0.1, 2.0)
    assert world["d"].may_touch == ("a", "b")
    mesh = world["e"].solid
    assert isinstance(mesh, Mesh)
    assert mesh.path == str(tmp_path / "part.stl")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("{name: x, cone: 1}", r"line 1, obstacles\[0\].cone: no field 'cone'.*box, cylinder, capsule, sphere, mesh"),
        ("{name: x}", "an obstacle needs one of box, cylinder, capsule, sphere, mesh; got none"),
        ("{name: x, box: [1, 1, 1], sphere: 1}", "got box and sphere"),
        ("{box: [1, 1, 1]}", "name: is missing"),
        ("{name: '', box: [1, 1, 1]}", "needs a name"),
        ("{name: x, box: [1, 1]}", "must be 3 numbers in lists, got 2"),
        ("{name: x, box: [1, -1, 1]}", r"box 'x': size must be positive and finite \[m\], got \[1.0, -1.0, 1.0\]"),
        ("{name: x, sphere: 0}", r"sphere 'x': radius must be positive and finite \[m\], got 0.0"),
        ("{name: x, sphere: .nan}", "must be a finite number"),
        ("{name: x, sphere: 1e9}", "radius must be at most 10000"),
        ("{name: x, cylinder: 3}", "must be a section"),
        ("{name: x, cylinder: {radius: 1}}", "cylinder.length: is missing"),
        ("{name: x, cylinder: {radius: 1, length: 1, height: 1}}", "no field 'height'"),
        ("{name: x, mesh: {file: nowhere.stl}}", "mesh 'x': no file .*nowhere.stl"),
        ("{name: x, sphere: 1, position: [0, 0, .inf]}", "must be a finite number"),
        ("{name: x, sphere: 1, quaternion: [0, 0, 0, 0]}", "must have length 1"),
        ("{name: x, sphere: 1, quaternion: [0, 0, 0, 1], rpy: [0, 0, 0]}", "both speak of the orientation"),
        ("{name: x, sphere: 1, position: [0, 0, 1e6]}", "must be within 10000 m"),
        ("{name: x, sphere: 1}, {name: x, sphere: 2}", "'x' is the name of the obstacle in line 1 too"),
    ],
)
def test_a_malformed_world_says_where_and_why(tmp_path: Path, line: str, message: str) -> None:
    with pytest.raises(WorldError, match=message) as caught:
        read(tmp_path, f"obstacles: [{line}]")
    assert "world.yaml, line 1" in str(caught.value)


def test_a_file_that_is_no_world(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match="the file is empty"):
        read(tmp_path, "")
    with pytest.raises(WorldError, match=r"no field 'things'.*obstacles"):
        read(tmp_path, "things: []")
    with pytest.raises(WorldError, match="obstacles: is missing"):
        read(tmp_path, "{}")
    with pytest.raises(FileNotFoundError):
        read_world(tmp_path / "none.yaml")
    assert len(read(tmp_path, "obstacles: []")) == 0


@pytest.mark.parametrize("solid", [Sphere(math.nan), Sphere(-1.0), Capsule(1.0, 0.0), Box([1.0, 1.0, math.inf])])
def test_sizes_are_checked_in_python_too(solid) -> None:
    with pytest.raises(WorldError, match="must be positive and finite"):
        Item("x", solid)


def test_items_are_checked() -> None:
    with pytest.raises(WorldError, match=r"must be a Box.*got str"):
        Item("x", "box")  # type: ignore[arg-type]
    with pytest.raises(ArrayError, match="rotation block of T of 'x'"):
        Item("x", Sphere(1.0), np.diag([2.0, 1.0, 1.0, 1.0]))
    with pytest.raises(WorldError, match="may_touch of 'x' must be a list of names"):
        Item("x", Sphere(1.0), may_touch="table")  # type: ignore[arg-type]
    with pytest.raises(WorldError, match="two items of the world are called 'x'"):
        World((Item("x", Sphere(1.0)), Item("x", Sphere(2.0))))
    with pytest.raises(UnknownNameError, match="no item 'bal' in the world; did you mean 'ball'"):
        World((Item("ball", Sphere(1.0)),)).without("bal")


sizes = st.floats(1e-3, 10.0)
solids = st.one_of(
    st.builds(Sphere, sizes),
    st.builds(Cylinder, sizes, sizes),
    st.builds(Capsule, sizes, sizes),
    st.tuples(sizes, sizes, sizes).map(Box),
)


@given(st.lists(st.tuples(solids, st.tuples(*[st.floats(-3.0, 3.0)] * 6)), max_size=5))
def test_what_is_written_is_read_again(tmp_path_factory, parts) -> None:
    items = []
    for k, (solid, numbers) in enumerate(parts):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = rotation.from_rpy(numbers[:3]), numbers[3:]
        items.append(Item(f"item {k}", solid, T, ("item 0",)))
    file = tmp_path_factory.mktemp("world") / "w.yaml"
    write_world(file, World(tuple(items)))
    again = read_world(file)
    assert again.names == tuple(item.name for item in items)
    for item, other in zip(items, again, strict=True):
        assert type(other.solid) is type(item.solid)
        assert other.may_touch == item.may_touch
        np.testing.assert_allclose(other.pose, item.pose, atol=AS_WRITTEN)
        if isinstance(item.solid, Box):
            np.testing.assert_array_equal(other.solid.size, item.solid.size)
        else:
            assert other.solid == item.solid
