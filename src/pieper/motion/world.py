"""What stands around an arm: named solids, from Python or from a YAML file.

A file lists obstacles; lengths in metres, angles in radians, places in the base frame of the arm:

.. code-block:: yaml

    obstacles:
      - {name: floor, box: [4.0, 4.0, 0.02], position: [0, 0, -0.02]}
      - name: can
        cylinder: {radius: 0.04, length: 0.3}
        position: [0.6, 0.2, 0.15]
        rpy: [0, 0, 0.5]            # or quaternion: [x, y, z, w]
        may_touch: [shelf]          # once it is grasped
      - {name: ball, sphere: 0.1, position: [0.4, 0, 0.9]}
      - {name: post, capsule: {radius: 0.05, length: 1.0}}
      - {name: part, mesh: {file: part.stl, scale: 0.001}}
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError, WorldError, unknown_name
from pieper.model.description import Box, Capsule, Cylinder, Geometry, Mesh, Sphere
from pieper.spatial import rotation
from pieper.spatial._checks import FloatArray, poses
from pieper.yaml_file import Section, read_yaml, write_yaml

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

SHAPES = ("box", "cylinder", "capsule", "sphere", "mesh")
"""What an obstacle in a file may be."""

LARGEST = 1e4
"""Metres; a solid that is larger, or farther away, is taken for a mistake of units."""


@dataclass(frozen=True, eq=False)
class Item:
    """A solid with a name and a place.

    Attributes
    ----------
    name : str
        By which collisions are told.
    solid : Box, Cylinder, Capsule, Sphere or Mesh
        A mesh of the world is its surface alone: what is wholly inside does not touch it.
    T : (4, 4) array
        Its pose in the base frame of the arm; of a tool or a grasped object in the frame of the tip [m, -].
    may_touch : tuple of str
        Names of links or other items whose contact with this one is no collision; they need not be there.

    Raises
    ------
    WorldError
        A size that is not positive and finite, a mesh file that is not there, or no name.
    ArrayError
        `T` is no pose.

    Examples
    --------
    >>> Item("floor", Box([4.0, 4.0, 0.0]))
    Traceback (most recent call last):
        ...
    pieper.errors.WorldError: box 'floor': size must be positive and finite [m], got [4.0, 4.0, 0.0]
    """

    name: str
    solid: Geometry
    T: FloatArray | None = None
    may_touch: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not str(self.name).strip():
            raise WorldError(f"an item needs a name, a word that is not empty, got {self.name!r}")
        if isinstance(self.may_touch, str):  # type: ignore[unreachable]  # a word is a sequence of words for Python alone
            raise WorldError(f"may_touch of {self.name!r} must be a list of names, got the word {self.may_touch!r}")
        T = poses(np.eye(4) if self.T is None else self.T, f"T of {self.name!r}")
        if T.ndim != 2:
            raise ArrayError(f"T of {self.name!r} must have shape (4, 4), got {T.shape}")
        if np.abs(T).max() > LARGEST:
            raise WorldError(f"{self.name!r} must be within {LARGEST:g} m of the origin, got {T[:3, 3].tolist()}")
        T = np.array(T)
        T.setflags(write=False)
        object.__setattr__(self, "T", T)
        object.__setattr__(self, "may_touch", tuple(self.may_touch))
        _check_solid(self.name, self.solid)

    @property
    def pose(self) -> FloatArray:
        """`T`, (4, 4), which is never None once the item is made."""
        assert self.T is not None
        return self.T


def _check_solid(name: str, solid: Geometry) -> None:
    if isinstance(solid, Box):
        sizes = {"size": solid.size}
    elif isinstance(solid, Cylinder | Capsule):
        sizes = {"radius": np.array([solid.radius]), "length": np.array([solid.length])}
    elif isinstance(solid, Sphere):
        sizes = {"radius": np.array([solid.radius])}
    elif isinstance(solid, Mesh):
        sizes = {"scale": solid.scale}
        if not Path(solid.path or solid.filename).is_file():
            raise WorldError(
                f"mesh {name!r}: no file {solid.path or solid.filename!s}; the folder of the world is looked in"
            )
    else:
        raise WorldError(
            f"{name!r} must be a Box, Cylinder, Capsule, Sphere or Mesh of pieper.model.description, got {type(solid).__name__}"
        )
    kind = type(solid).__name__.lower()
    for what, values in sizes.items():
        numbers = np.asarray(values, dtype=np.float64)
        if not ((numbers > 0.0) & (numbers <= LARGEST)).all():
            got = numbers.tolist() if numbers.size > 1 else float(numbers[0])
            bound = (
                "positive and finite"
                if not (numbers > LARGEST).any() or np.isinf(numbers).any()
                else f"at most {LARGEST:g}"
            )
            unit = "-" if what == "scale" else "m"
            raise WorldError(f"{kind} {name!r}: {what} must be {bound} [{unit}], got {got}")


@dataclass(frozen=True, eq=False)
class World:
    """Named solids that stand still. A change returns a new world.

    Attributes
    ----------
    items : tuple of Item
        Their names all different. They may overlap each other.

    Examples
    --------
    >>> floor = Item("floor", Box([4.0, 4.0, 0.02]))
    >>> World([floor]).names
    ('floor',)
    """

    items: tuple[Item, ...] = ()

    def __post_init__(self) -> None:
        items = tuple(self.items)
        for item in items:
            if not isinstance(item, Item):
                raise WorldError(f"a world is made of items, got {type(item).__name__}")
        object.__setattr__(self, "items", items)
        names = [item.name for item in items]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise WorldError(f"two items of the world are called {twice!r}; every name must be there once")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the items."""
        return tuple(item.name for item in self.items)

    def __getitem__(self, name: str) -> Item:
        for item in self.items:
            if item.name == name:
                return item
        raise unknown_name("item", name, self.names, "the world")

    def __iter__(self) -> Iterator[Item]:
        return iter(self.items)

    def __len__(self) -> int:
        return len(self.items)

    def with_items(self, items: Iterable[Item]) -> World:
        """A world with more items."""
        return World((*self.items, *items))

    def without(self, *names: str) -> World:
        """A world that lacks the named items."""
        for name in names:
            self[name]
        return World(tuple(item for item in self.items if item.name not in names))


def read_world(path: str | Path) -> World:
    """Read a world from a YAML file; the layout is at the top of this module.

    Parameters
    ----------
    path : str or Path
        Mesh files are looked for beside it.

    Returns
    -------
    World
        The things that stand around, in the frame of the base.

    Raises
    ------
    OSError
        The file cannot be read.
    WorldError
        It is malformed: the message names file, line and field.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "world.yaml"
    >>> _ = file.write_text("obstacles: [{name: ball, sphere: 0.1, position: [0.4, 0, 0.9]}]")
    >>> read_world(file)["ball"].solid
    Sphere(radius=0.1)
    """
    file = read_yaml(path, error=WorldError, extra="plan")
    file.only("obstacles", "comment")
    items: list[Item] = []
    lines: dict[str, int] = {}
    for section in file.sections("obstacles"):
        item = _read_item(section, Path(path).parent)
        if item.name in lines:
            raise section.error("name", f"{item.name!r} is the name of the obstacle in line {lines[item.name]} too")
        lines[item.name] = section.line
        items.append(item)
    return World(tuple(items))


def _read_item(section: Section, folder: Path) -> Item:
    section.only("name", *SHAPES, "position", "rpy", "quaternion", "may_touch", "comment")
    kinds = [kind for kind in SHAPES if kind in section]
    if len(kinds) != 1:
        got = " and ".join(kinds) or "none of them"
        raise section.error("", f"an obstacle needs one of {', '.join(SHAPES)}; got {got}")
    kind = kinds[0]
    name = section.text("name")
    try:
        return Item(
            name, _read_solid(section, kind, folder), _read_pose(section), tuple(section.texts("may_touch", []))
        )
    except WorldError as cause:
        if str(cause).startswith(section.file):
            raise
        raise section.error(kind, str(cause)) from None


def _read_solid(section: Section, kind: str, folder: Path) -> Geometry:
    if kind == "box":
        return Box(section.array("box", (3,)))
    if kind == "sphere":
        return Sphere(section.number("sphere"))
    fields = section.section(kind)
    if kind == "mesh":
        fields.only("file", "scale")
        file = fields.text("file")
        return Mesh(file, np.full(3, fields.number("scale", 1.0)), str(folder / file))
    fields.only("radius", "length")
    radius, length = fields.number("radius"), fields.number("length")
    return Cylinder(radius, length) if kind == "cylinder" else Capsule(radius, length)


def _read_pose(section: Section) -> FloatArray:
    T = np.eye(4)
    T[:3, 3] = section.array("position", (3,), np.zeros(3))
    if "rpy" in section and "quaternion" in section:
        raise section.error("quaternion", "rpy and quaternion both speak of the orientation; give one of them")
    if "rpy" in section:
        T[:3, :3] = rotation.from_rpy(section.array("rpy", (3,)))
    if "quaternion" in section:
        xyzw = section.array("quaternion", (4,))
        length = float(np.linalg.norm(xyzw))
        if abs(length - 1.0) > 1e-3:
            raise section.error("quaternion", f"must have length 1 (x, y, z, w), got {length:.6g}")
        T[:3, :3] = rotation.from_quaternion(xyzw / length)
    return T


def write_world(path: str | Path, world: World) -> None:
    """Write a world that `read_world` reads; names of mesh files stay as they are."""
    write_yaml(path, {"obstacles": [_as_fields(item) for item in world]}, extra="plan")


def _as_fields(item: Item) -> dict[str, Any]:
    solid = item.solid
    values: Any
    if isinstance(solid, Box):
        values = solid.size
    elif isinstance(solid, Sphere):
        values = solid.radius
    elif isinstance(solid, Mesh):
        if np.ptp(solid.scale) != 0.0:
            raise WorldError(f"mesh {item.name!r}: a file holds one scale for all axes, got {solid.scale.tolist()}")
        values = {"file": solid.filename, "scale": float(solid.scale[0])}
    else:
        values = {"radius": solid.radius, "length": solid.length}
    fields: dict[str, Any] = {
        "name": item.name,
        type(solid).__name__.lower(): values,
        "position": item.pose[:3, 3],
        "quaternion": rotation.as_quaternion(item.pose[:3, :3]),
    }
    if item.may_touch:
        fields["may_touch"] = list(item.may_touch)
    return fields
