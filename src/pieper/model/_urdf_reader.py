"""From the elements of a URDF to links and joints."""

from __future__ import annotations

import os
import re
import warnings
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import DescriptionError, PieperWarning, UrdfError
from pieper.model._tree_checks import first_of
from pieper.model.description import (
    JOINT_TYPES,
    MAX_NAME,
    Box,
    Capsule,
    Collision,
    Cylinder,
    Description,
    Geometry,
    Inertial,
    Joint,
    Link,
    Material,
    Mesh,
    Mimic,
    Sphere,
    Visual,
)
from pieper.model.package import find_package, resolve
from pieper.spatial._rpy import rotation_from_rpy

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from pieper.model._arrays import FloatArray
    from pieper.model._urdf_xml import Element
    from pieper.model.package import PackageFolders

LARGEST = 1e9  # metres or radians in an origin; beyond it sums lose the millimetre

_NO_LIMIT = 1e30  # a larger limit means none; exporters write 1e30, 3.4e38 or 1.8e308 for it

_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")

_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)", re.IGNORECASE)

_XACRO = "{http://www.ros.org/wiki/xacro}"


class UrdfReader:
    """Turns elements into links and joints; every message names the element that holds the fault."""

    def __init__(self, source: str, packages: PackageFolders | None, file: Path | None) -> None:
        self.source = source
        self.packages = packages if packages is None or hasattr(packages, "keys") else _listed_folders(packages)
        self.file = file
        self.namespace = ""
        self.materials: dict[str, Material] = {}
        self.meshes: dict[str, str | None] = {}
        self.folders: dict[str, str | None] = {}  # package name -> folder
        self.missing: dict[str, str] = {}  # mesh name -> the first link that needs it
        self.unlimited: list[str] = []
        self.massive: list[str] = []

    def description(self, robot: Element) -> Description:
        self.namespace = robot.tag[: robot.tag.index("}") + 1] if robot.tag.startswith("{") else ""
        if self._local(robot) != "robot":
            raise self._fault(f"<{robot.tag[:60]}>", "the root element must be <robot>")
        name = self._name(robot, "<robot>")
        for child in robot.children:
            if child.tag.startswith(_XACRO):
                tag = child.tag[len(_XACRO) :]
                raise self._fault(
                    f"<xacro:{tag[:60]}>", "is not expanded; save the file as *.xacro, or expand it first"
                )
        for element in self._all(robot, "material"):
            material = self._material(element)
            self.materials.setdefault(material.name, material)
        links = tuple(self._link(element) for element in self._all(robot, "link"))
        joints = tuple(self._joint(element) for element in self._all(robot, "joint"))
        try:
            return Description(name, links, joints, self.source)
        except UrdfError:
            raise
        except DescriptionError as fault:
            raise UrdfError(fault.source, fault.element, fault.reason) from None

    def warn(self) -> None:
        if self.missing:
            named = [f"{_short(mesh)} of link {link!r}" for mesh, link in self.missing.items()]
            warnings.warn(
                f"{self.source}: mesh not found: {first_of(named, 5)}; kinematics works without it, to draw or "
                "simulate the robot give the folders of its packages, packages=[...], or set ROS_PACKAGE_PATH",
                PieperWarning,
                stacklevel=3,
            )
        if self.massive:
            warnings.warn(
                f"{self.source}: a mass without <inertia> in link {first_of([repr(name) for name in self.massive], 8)}; its inertial is left out, "
                "kinematics works without it",
                PieperWarning,
                stacklevel=3,
            )
        if self.unlimited:
            warnings.warn(
                f"{self.source}: no lower or no upper limit for joint {first_of([repr(name) for name in self.unlimited], 8)}; "
                "taken as unlimited on that side",
                PieperWarning,
                stacklevel=3,
            )

    # ---- elements and attributes

    def _fault(self, element: str, reason: str) -> UrdfError:
        return UrdfError(self.source, element, reason)

    def _local(self, element: Element) -> str:
        """The tag without the namespace of the root; tags of other namespaces stay as they are."""
        tag = element.tag
        return tag[len(self.namespace) :] if self.namespace and tag.startswith(self.namespace) else tag

    def _all(self, parent: Element, tag: str) -> Iterator[Element]:
        return (child for child in parent.children if self._local(child) == tag)

    def _only(self, parent: Element, tag: str, element: str) -> Element | None:
        found = list(self._all(parent, tag))
        if len(found) > 1:
            raise self._fault(element, f"has {len(found)} <{tag}> elements, at most one is allowed")
        return found[0] if found else None

    def _needed(self, parent: Element, tag: str, element: str) -> Element:
        found = self._only(parent, tag, element)
        if found is None:
            raise self._fault(element, f"needs a <{tag}> element")
        return found

    def _name(self, element: Element, shown: str) -> str:
        name = element.attributes.get("name", "")
        if not name.strip():
            raise self._fault(shown, "needs a name, name='...'")
        if len(name) > MAX_NAME:
            raise self._fault(shown, f"the name {_short(name)} is longer than {MAX_NAME} characters")
        return name

    def _link_or_joint(self, element: Element, key: str, shown: str) -> str:
        """An attribute that names a link or a joint."""
        name = self._attribute(element, key, shown)
        if len(name) > MAX_NAME:
            raise self._fault(shown, f"{key} {_short(name)} is longer than {MAX_NAME} characters")
        return name

    def _attribute(self, element: Element, key: str, shown: str) -> str:
        if key not in element.attributes:
            raise self._fault(shown, f"<{self._local(element)}> needs the attribute {key!r}")
        return element.attributes[key]

    def _numbers(self, text: str, count: int, shown: str, what: str, largest: float = inf) -> list[float]:
        words = text.split(None, count)
        if len(words) != count:
            given = str(len(words)) if len(words) < count else f"more than {count}"
            raise self._fault(
                shown, f"{what} needs {count} number{'s' if count > 1 else ''}, got {given}: {_short(text)}"
            )
        return [self._number(word, shown, what, largest) for word in words]

    def _number(self, word: str, shown: str, what: str, largest: float = inf) -> float:
        if len(word) > 400 or not _NUMBER.fullmatch(word):
            if _NOT_FINITE.fullmatch(word):
                raise self._fault(shown, f"{what} must be finite, got {word!r}")
            hint = "; expand the xacro file first" if "$" in word else ""
            raise self._fault(shown, f"{what} must be a number, got {_short(word)}{hint}")
        value = float(word)
        if not isfinite(value):
            raise self._fault(shown, f"{what} must be finite, got {_short(word)}, which is too large for a number")
        if abs(value) > largest:
            raise self._fault(shown, f"{what} must be within +-{largest:g}, got {_short(word)}")
        return value

    def _optional(self, element: Element, key: str, shown: str, default: float, largest: float = inf) -> float:
        if key not in element.attributes:
            return default
        what = f"{key} of <{self._local(element)}>"
        return self._numbers(element.attributes[key], 1, shown, what, largest)[0]

    def _positive(self, element: Element, key: str, shown: str) -> float:
        what = f"{key} of <{self._local(element)}>"
        value = self._numbers(self._attribute(element, key, shown), 1, shown, what)[0]
        if value < 0.0:
            raise self._fault(shown, f"{what} must not be negative, got {value}")
        return value

    def _origin(self, parent: Element, shown: str) -> FloatArray:
        origin = self._only(parent, "origin", shown)
        T = np.eye(4)
        if origin is not None:
            if "xyz" in origin.attributes:
                T[:3, 3] = self._numbers(origin.attributes["xyz"], 3, shown, "xyz of <origin>", LARGEST)
            if "rpy" in origin.attributes:
                rpy = self._numbers(origin.attributes["rpy"], 3, shown, "rpy of <origin>", LARGEST)
                T[:3, :3] = rotation_from_rpy(*rpy)
        return T

    # ---- joints

    def _joint(self, element: Element) -> Joint:
        name = self._name(element, "<joint>")
        shown = f"joint {name!r}"
        kind = self._attribute(element, "type", shown)
        if kind not in JOINT_TYPES:
            raise self._fault(shown, f"unknown type {_short(kind)}; types are: {', '.join(JOINT_TYPES)}")
        parent = self._link_or_joint(self._needed(element, "parent", shown), "link", shown)
        child = self._link_or_joint(self._needed(element, "child", shown), "link", shown)
        T_parent_joint = self._origin(element, shown)
        axis = [1.0, 0.0, 0.0]
        axis_element = self._only(element, "axis", shown)
        if axis_element is not None:
            axis = self._numbers(self._attribute(axis_element, "xyz", shown), 3, shown, "xyz of <axis>")
        lower, upper, velocity, effort = self._limits(element, kind, name)
        mimic = self._mimic(element, shown)
        return Joint(name, kind, parent, child, T_parent_joint, np.array(axis), lower, upper, velocity, effort, mimic)

    def _limits(self, element: Element, kind: str, name: str) -> tuple[float, float, float, float]:
        shown = f"joint {name!r}"
        lower, upper, velocity, effort = -inf, inf, inf, inf
        limit = self._only(element, "limit", shown)
        if limit is not None:
            lower = self._optional(limit, "lower", shown, -inf)
            upper = self._optional(limit, "upper", shown, inf)
            velocity = self._optional(limit, "velocity", shown, inf)
            effort = self._optional(limit, "effort", shown, inf)
        if kind in ("revolute", "prismatic"):
            if lower == -inf or upper == inf:
                self.unlimited.append(name)
        else:
            lower, upper = -inf, inf
        lower = -inf if lower <= -_NO_LIMIT else lower
        upper = inf if upper >= _NO_LIMIT else upper
        return lower, upper, inf if velocity >= _NO_LIMIT else velocity, inf if effort >= _NO_LIMIT else effort

    def _mimic(self, element: Element, shown: str) -> Mimic | None:
        mimic = self._only(element, "mimic", shown)
        if mimic is None:
            return None
        return Mimic(
            self._link_or_joint(mimic, "joint", shown),
            self._optional(mimic, "multiplier", shown, 1.0, LARGEST),
            self._optional(mimic, "offset", shown, 0.0, LARGEST),
        )

    # ---- links

    def _link(self, element: Element) -> Link:
        name = self._name(element, "<link>")
        shown = f"link {name!r}"
        visuals = tuple(self._visual(child, shown, name) for child in self._all(element, "visual"))
        collisions = tuple(self._collision(child, shown, name) for child in self._all(element, "collision"))
        inertial = self._only(element, "inertial", shown)
        if inertial is not None and self._only(inertial, "inertia", shown) is None:
            self._positive(self._needed(inertial, "mass", shown), "value", shown)
            self.massive.append(name)
            inertial = None
        return Link(name, visuals, collisions, None if inertial is None else self._inertial(inertial, shown))

    def _visual(self, element: Element, shown: str, link: str) -> Visual:
        material = self._only(element, "material", shown)
        return Visual(
            self._geometry(element, shown, link),
            self._origin(element, shown),
            None if material is None else self._material(material),
            element.attributes.get("name", ""),
        )

    def _collision(self, element: Element, shown: str, link: str) -> Collision:
        return Collision(
            self._geometry(element, shown, link), self._origin(element, shown), element.attributes.get("name", "")
        )

    def _geometry(self, parent: Element, shown: str, link: str) -> Geometry:
        geometry = self._needed(parent, "geometry", shown)
        shapes = [c for c in geometry.children if self._local(c) in ("box", "cylinder", "capsule", "sphere", "mesh")]
        if len(shapes) != 1:
            raise self._fault(shown, f"<geometry> needs one box, cylinder, capsule, sphere or mesh, got {len(shapes)}")
        shape = shapes[0]
        kind = self._local(shape)
        if kind == "box":
            size = self._numbers(self._attribute(shape, "size", shown), 3, shown, "size of <box>")
            if min(size) < 0.0:
                raise self._fault(shown, f"size of <box> must not be negative, got {size}")
            return Box(np.array(size))
        if kind == "cylinder":
            return Cylinder(self._positive(shape, "radius", shown), self._positive(shape, "length", shown))
        if kind == "capsule":
            return Capsule(self._positive(shape, "radius", shown), self._positive(shape, "length", shown))
        if kind == "sphere":
            return Sphere(self._positive(shape, "radius", shown))
        filename = self._attribute(shape, "filename", shown)
        scale = self._numbers(shape.attributes.get("scale", "1 1 1"), 3, shown, "scale of <mesh>")
        return Mesh(filename, np.array(scale), self._mesh_path(filename, link))

    def _mesh_path(self, filename: str, link: str) -> str | None:
        if filename not in self.meshes:
            self.meshes[filename] = self._resolved(filename)
        if self.meshes[filename] is None:
            self.missing.setdefault(filename, link)
        return self.meshes[filename]

    def _resolved(self, filename: str) -> str | None:
        """The file of a mesh; each package is searched for once, which matters where there are thousands of meshes."""
        if not filename.startswith("package://"):
            return resolve(filename, beside=self.file)
        name = filename.removeprefix("package://").partition("/")[0]
        if name not in self.folders:
            self.folders[name] = find_package(name, packages=self.packages, beside=self.file)
        folder = self.folders[name]
        return None if folder is None else resolve(filename, packages={name: folder})

    def _material(self, element: Element) -> Material:
        name = element.attributes.get("name", "")
        shown = f"material {_short(name)}"
        color = self._only(element, "color", shown)
        texture = self._only(element, "texture", shown)
        if color is None and texture is None:
            return self.materials.get(name, Material(name))
        rgba = None
        if color is not None:
            r, g, b, a = self._numbers(self._attribute(color, "rgba", shown), 4, shown, "rgba of <color>")
            rgba = (r, g, b, a)
        return Material(name, rgba, None if texture is None else texture.attributes.get("filename"))

    def _inertial(self, element: Element, shown: str) -> Inertial:
        mass = self._positive(self._needed(element, "mass", shown), "value", shown)
        given = self._needed(element, "inertia", shown)
        keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        xx, xy, xz, yy, yz, zz = (
            self._numbers(self._attribute(given, key, shown), 1, shown, f"{key} of <inertia>")[0] for key in keys
        )
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return Inertial(mass, self._origin(element, shown), inertia)


def _listed_folders(packages: Any) -> list[Any]:
    return [packages] if isinstance(packages, (str, os.PathLike)) else list(packages)


def _short(text: str) -> str:
    return repr(text if len(text) <= 60 else text[:57] + "...")
