"""URDF in and out: a strict reader on a hardened XML parser, and a writer that loses no digit.

The reader takes nothing on trust. Document types and entities are refused, size, depth and counts are limited, every
number has to be a finite number, and the links and joints have to form one tree. Each fault is a `UrdfError` that
names the source, the element and the reason; nothing is repaired in silence.

The format is described at http://wiki.ros.org/urdf/XML. Two points differ from it, both so that a gap in the file does
not turn into a stiff joint: a revolute or prismatic joint without a limit is taken as unlimited on that side, with a warning, and a
limit beyond 1e30 in size, which some exporters write for *none*, counts as none. Three habits of published files that say
nothing about the robot are let pass: blank lines before the XML header, an empty ``<texture/>``, and tags or attributes
of another program (``drake:acceleration``) whose prefix is not declared.
"""

from __future__ import annotations

import os
import re
import stat
import warnings
from math import atan2, cos, hypot, inf, isfinite, sin
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import ParseError
from xml.sax.saxutils import quoteattr

import numpy as np
from defusedxml import DefusedXmlException, DTDForbidden
from defusedxml.ElementTree import XMLParser
from numpy.typing import NDArray

from pieper.errors import DescriptionError, PieperWarning, UrdfError
from pieper.model.chain import Chain
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

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from pieper.model.package import PackageFolders

FloatArray = NDArray[np.float64]

MAX_BYTES = 16 * 1024 * 1024
MAX_DEPTH = 64
MAX_ELEMENTS = 100_000
MAX_ATTRIBUTES = 100

_LARGEST = 1e9  # metres or radians in an origin; beyond it sums lose the millimetre
_NO_LIMIT = 1e30  # a larger limit means none; exporters write 1e30, 3.4e38 or 1.8e308 for it
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)", re.IGNORECASE)
_XACRO = "{http://www.ros.org/wiki/xacro}"
_OUTSIDE_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")


def from_urdf(
    what: str | bytes | os.PathLike[str],
    *,
    packages: PackageFolders | None = None,
    source: str | None = None,
    beside: str | os.PathLike[str] | None = None,
) -> Description:
    """Read a URDF.

    Parameters
    ----------
    what : str, bytes or path
        URDF text (a str that starts with ``<``, with or without an encoding header), its bytes, or a file name.
    packages : mapping or iterable, optional
        Folders for ``package://``, see `pieper.model.package.find_package`.
    source : str, optional
        Name for messages; the file name or ``<string>``.
    beside : path, optional
        The file that text came from, so that its meshes are found; a file name as `what` implies it.

    Returns
    -------
    Description

    Raises
    ------
    UrdfError
        Anything malformed, hostile or too large, with source, element and reason.

    Warns
    -----
    PieperWarning
        Mesh files that were not found (kinematics needs none), and joints without limits.

    Examples
    --------
    >>> robot = from_urdf('''<?xml version="1.0" encoding="utf-8"?>
    ... <robot name="slider">
    ...   <link name="rail"/> <link name="cart"/>
    ...   <joint name="slide" type="prismatic">
    ...     <parent link="rail"/> <child link="cart"/>
    ...     <axis xyz="0 0 2"/> <limit lower="0" upper="0.5" effort="10" velocity="1"/>
    ...   </joint>
    ... </robot>''')
    >>> robot.joint("slide").axis
    array([0., 0., 1.])
    >>> robot.chain().limits
    array([[0. , 0.5]])
    """
    text, name, file = _text_of(what, source)
    if file is None and beside is not None:
        file = Path(beside)
    reader = _Reader(name, packages, file)
    description = reader.description(_parse(text, name))
    reader.warn()
    return description


# --------------------------------------------------------------------------------------------------------------------
# from the outside to elements


class _Element:
    """An element with its attributes and children; text is not kept, URDF has none."""

    __slots__ = ("attributes", "children", "tag")

    def __init__(self, tag: str, attributes: dict[str, str]) -> None:
        self.tag = tag
        self.attributes = attributes
        self.children: list[_Element] = []


class _Builder:
    """Receives the parser's events and stops at the limits."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.root: _Element | None = None
        self.open: list[_Element] = []
        self.count = 0

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.count += 1
        if self.count > MAX_ELEMENTS:
            raise UrdfError(self.source, "document", f"has more than {MAX_ELEMENTS} elements")
        if len(self.open) >= MAX_DEPTH:
            raise UrdfError(self.source, "document", f"is nested more than {MAX_DEPTH} elements deep")
        if len(attributes) > MAX_ATTRIBUTES:
            raise UrdfError(self.source, f"<{tag[:60]}>", f"has more than {MAX_ATTRIBUTES} attributes")
        element = _Element(tag, dict(attributes))
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)

    def end(self, tag: str) -> None:
        self.open.pop()

    def data(self, text: str) -> None:
        """Text between elements means nothing in a URDF."""

    def close(self) -> _Element | None:
        return self.root


def _text_of(what: object, source: str | None) -> tuple[str | bytes, str, Path | None]:
    """The XML text, the name for messages, and the file when there is one."""
    if isinstance(what, (bytes, bytearray, memoryview)):
        data = bytes(what)
        name = source or "<string>"
        _check_size(len(data), name)
        return data.lstrip(b" \t\r\n"), name, None
    if isinstance(what, str) and (what.lstrip("\ufeff \t\r\n")[:1] == "<" or not what.strip() or "\n" in what):
        name = source or "<string>"
        _check_size(len(what), name)
        return what.lstrip("\ufeff \t\r\n"), name, None
    if not isinstance(what, (str, os.PathLike)):
        raise UrdfError(
            source or "<string>", "document", f"must be URDF text or a file name, got {type(what).__name__}"
        )
    raw = os.fspath(what)
    file = Path(os.fsdecode(raw))
    shown = str(file) if len(str(file)) <= 200 else str(file)[:197] + "..."
    name = source or shown
    try:
        status = file.stat()
        if not stat.S_ISREG(status.st_mode):
            raise UrdfError(name, "file", "is not a regular file; give the URDF file itself")
        with file.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except UrdfError:
        raise
    except (OSError, ValueError) as cause:
        reason = getattr(cause, "strerror", None) or str(cause)
        raise UrdfError(
            name, "file", f"cannot be read: {reason}; give a URDF file, or URDF text that starts with <"
        ) from cause
    _check_size(len(data), name)
    return data.lstrip(b" \t\r\n"), name, file


def _check_size(size: int, source: str) -> None:
    if size > MAX_BYTES:
        raise UrdfError(
            source, "document", f"is larger than {MAX_BYTES // 2**20} MiB; a URDF holds no meshes, only names"
        )


def _parse(text: str | bytes, source: str) -> _Element:
    """The root element; the parser of defusedxml with document types forbidden."""
    if not text.strip():
        raise UrdfError(source, "document", "is empty; a URDF starts with <robot name=...>")
    try:
        try:
            root = _tree(text, source)
        except ParseError as cause:
            if "unbound prefix" not in str(cause):
                raise
            root = _tree(_with_prefixes(text), source)
    except UrdfError:
        raise
    except DTDForbidden as cause:
        raise UrdfError(source, "document type", "<!DOCTYPE> is refused, a URDF needs none; remove it") from cause
    except DefusedXmlException as cause:
        raise UrdfError(source, "document", "entities and external references are refused; remove them") from cause
    except ParseError as cause:
        hint = "; the file may be cut off" if "no element found" in str(cause) or "unclosed" in str(cause) else ""
        if "unbound prefix" in str(cause):
            hint = "; expand a xacro file first, or give it the name *.xacro"
        raise UrdfError(source, "document", f"is not well-formed XML: {cause}{hint}") from cause
    except (ValueError, LookupError, OverflowError) as cause:
        raise UrdfError(source, "document", f"cannot be decoded: {cause}") from cause
    if not isinstance(root, _Element):
        raise UrdfError(source, "document", "has no element; a URDF starts with <robot name=...>")
    return root


def _tree(text: str | bytes, source: str) -> object:
    parser = XMLParser(target=_Builder(source), forbid_dtd=True)
    parser.feed(text)
    return parser.close()


def _with_prefixes(text: str | bytes) -> str | bytes:
    """The same with the prefixes of foreign tags and attributes declared at the root; xacro's stays undeclared.

    Works on bytes of any encoding that has ASCII in it. Where it finds nothing the text stays as it is.
    """
    data = text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass")
    root = re.search(rb"<robot(?=[\s>])", data)
    foreign = set(re.findall(rb"[<\s]([A-Za-z_][\w.-]{0,60}):[A-Za-z_]", data))
    foreign = {prefix for prefix in foreign if prefix.lower() not in (b"xacro", b"xml", b"xmlns")}
    foreign -= set(re.findall(rb"xmlns:([A-Za-z_][\w.-]{0,60})", data))
    if root is None or not foreign or len(foreign) > MAX_ATTRIBUTES:
        return text
    declared = b"".join(b' xmlns:%b="undeclared:%b"' % (prefix, prefix) for prefix in sorted(foreign))
    data = data[: root.end()] + declared + data[root.end() :]
    return data if isinstance(text, bytes) else data.decode("utf-8", "surrogatepass")


# --------------------------------------------------------------------------------------------------------------------
# from elements to a description


class _Reader:
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

    def description(self, robot: _Element) -> Description:
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
            more = f" and {len(named) - 5} more" if len(named) > 5 else ""
            warnings.warn(
                f"{self.source}: mesh not found: {', '.join(named[:5])}{more}; kinematics works without it, to draw or "
                "simulate the robot give the folders of its packages, packages=[...], or set ROS_PACKAGE_PATH",
                PieperWarning,
                stacklevel=3,
            )
        if self.massive:
            named = [repr(name) for name in self.massive]
            more = f" and {len(named) - 8} more" if len(named) > 8 else ""
            warnings.warn(
                f"{self.source}: a mass without <inertia> in link {', '.join(named[:8])}{more}; its inertial is left out, "
                "kinematics works without it",
                PieperWarning,
                stacklevel=3,
            )
        if self.unlimited:
            named = [repr(name) for name in self.unlimited]
            more = f" and {len(named) - 8} more" if len(named) > 8 else ""
            warnings.warn(
                f"{self.source}: no lower or no upper limit for joint {', '.join(named[:8])}{more}; "
                "taken as unlimited on that side",
                PieperWarning,
                stacklevel=3,
            )

    # ---- elements and attributes

    def _fault(self, element: str, reason: str) -> UrdfError:
        return UrdfError(self.source, element, reason)

    def _local(self, element: _Element) -> str:
        """The tag without the namespace of the root; tags of other namespaces stay as they are."""
        tag = element.tag
        return tag[len(self.namespace) :] if self.namespace and tag.startswith(self.namespace) else tag

    def _all(self, parent: _Element, tag: str) -> Iterator[_Element]:
        return (child for child in parent.children if self._local(child) == tag)

    def _only(self, parent: _Element, tag: str, element: str) -> _Element | None:
        found = list(self._all(parent, tag))
        if len(found) > 1:
            raise self._fault(element, f"has {len(found)} <{tag}> elements, at most one is allowed")
        return found[0] if found else None

    def _needed(self, parent: _Element, tag: str, element: str) -> _Element:
        found = self._only(parent, tag, element)
        if found is None:
            raise self._fault(element, f"needs a <{tag}> element")
        return found

    def _name(self, element: _Element, shown: str) -> str:
        name = element.attributes.get("name", "")
        if not name.strip():
            raise self._fault(shown, "needs a name, name='...'")
        if len(name) > MAX_NAME:
            raise self._fault(shown, f"the name {_short(name)} is longer than {MAX_NAME} characters")
        return name

    def _link_or_joint(self, element: _Element, key: str, shown: str) -> str:
        """An attribute that names a link or a joint."""
        name = self._attribute(element, key, shown)
        if len(name) > MAX_NAME:
            raise self._fault(shown, f"{key} {_short(name)} is longer than {MAX_NAME} characters")
        return name

    def _attribute(self, element: _Element, key: str, shown: str) -> str:
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

    def _optional(self, element: _Element, key: str, shown: str, default: float, largest: float = inf) -> float:
        if key not in element.attributes:
            return default
        what = f"{key} of <{self._local(element)}>"
        return self._numbers(element.attributes[key], 1, shown, what, largest)[0]

    def _positive(self, element: _Element, key: str, shown: str) -> float:
        what = f"{key} of <{self._local(element)}>"
        value = self._numbers(self._attribute(element, key, shown), 1, shown, what)[0]
        if value < 0.0:
            raise self._fault(shown, f"{what} must not be negative, got {value}")
        return value

    def _origin(self, parent: _Element, shown: str) -> FloatArray:
        origin = self._only(parent, "origin", shown)
        T = np.eye(4)
        if origin is not None:
            if "xyz" in origin.attributes:
                T[:3, 3] = self._numbers(origin.attributes["xyz"], 3, shown, "xyz of <origin>", _LARGEST)
            if "rpy" in origin.attributes:
                rpy = self._numbers(origin.attributes["rpy"], 3, shown, "rpy of <origin>", _LARGEST)
                T[:3, :3] = _rotation_from_rpy(*rpy)
        return T

    # ---- joints

    def _joint(self, element: _Element) -> Joint:
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

    def _limits(self, element: _Element, kind: str, name: str) -> tuple[float, float, float, float]:
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

    def _mimic(self, element: _Element, shown: str) -> Mimic | None:
        mimic = self._only(element, "mimic", shown)
        if mimic is None:
            return None
        return Mimic(
            self._link_or_joint(mimic, "joint", shown),
            self._optional(mimic, "multiplier", shown, 1.0, _LARGEST),
            self._optional(mimic, "offset", shown, 0.0, _LARGEST),
        )

    # ---- links

    def _link(self, element: _Element) -> Link:
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

    def _visual(self, element: _Element, shown: str, link: str) -> Visual:
        material = self._only(element, "material", shown)
        return Visual(
            self._geometry(element, shown, link),
            self._origin(element, shown),
            None if material is None else self._material(material),
            element.attributes.get("name", ""),
        )

    def _collision(self, element: _Element, shown: str, link: str) -> Collision:
        return Collision(
            self._geometry(element, shown, link), self._origin(element, shown), element.attributes.get("name", "")
        )

    def _geometry(self, parent: _Element, shown: str, link: str) -> Geometry:
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

    def _material(self, element: _Element) -> Material:
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

    def _inertial(self, element: _Element, shown: str) -> Inertial:
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


# --------------------------------------------------------------------------------------------------------------------
# roll, pitch, yaw of one frame; plain floats, because a description has many and each is small


def _rotation_from_rpy(roll: float, pitch: float, yaw: float) -> FloatArray:
    """R = Rz(yaw) Ry(pitch) Rx(roll)."""
    sr, cr, sp, cp, sy, cy = sin(roll), cos(roll), sin(pitch), cos(pitch), sin(yaw), cos(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _rpy_from_rotation(R: FloatArray) -> tuple[float, float, float]:
    """Roll, pitch and yaw that give R back to rounding, also at a pitch of +-90 degrees.

    Near the lock the yaw that the first column yields is noise, but any yaw is good as long as the roll is then taken
    from Rz(yaw)^T R instead of from the last row.
    """
    cos_pitch = hypot(float(R[0, 0]), float(R[1, 0]))
    yaw = atan2(R[1, 0], R[0, 0]) if cos_pitch > 0.0 else 0.0
    pitch = atan2(-R[2, 0], cos_pitch)
    sy, cy = sin(yaw), cos(yaw)
    roll = atan2(sy * R[0, 2] - cy * R[1, 2], cy * R[1, 1] - sy * R[0, 1])
    return roll, pitch, yaw


# --------------------------------------------------------------------------------------------------------------------
# out


def as_urdf(robot: Chain | Description) -> str:
    """Write a URDF.

    Numbers are printed so that they read back as the same number; poses go through roll, pitch and yaw, which costs
    rounding only. A chain becomes the links of `Chain.frames`; coupled axes become mimic joints.

    Parameters
    ----------
    robot : Chain or Description

    Returns
    -------
    str

    Raises
    ------
    UrdfError
        The chain has an axis that depends on several joints, a name holds a character that XML cannot carry, or a
        number is so large that `from_urdf` would refuse it.

    Notes
    -----
    Consumers that ask for every limit (urdfdom) can read the result: an effort or velocity that is not limited is
    written as the largest float, which `from_urdf` reads as none.

    Examples
    --------
    >>> chain = Chain("turner", [[0, 0, 0, 0, 0, 1]], np.eye(4), [[-1, 1]], ("turn",), base="floor", tip="top")
    >>> print(as_urdf(chain))  # doctest: +ELLIPSIS
    <?xml version="1.0"?>
    <robot name="turner">
      <link name="floor"/>
    ...
      <joint name="turn" type="revolute">
    ...
    >>> from_urdf(as_urdf(chain)).chain("floor", "top").screws
    array([[0., 0., 0., 0., 0., 1.]])
    """
    if isinstance(robot, Chain):
        try:
            robot = Description.from_chain(robot)
        except UrdfError:
            raise
        except DescriptionError as fault:
            raise UrdfError(fault.source, fault.element, fault.reason) from None
    writer = _Writer(robot)
    return writer.text()


class _Writer:
    def __init__(self, description: Description) -> None:
        self.description = description
        self.lines: list[str] = []

    def text(self) -> str:
        description = self.description
        self.lines = ['<?xml version="1.0"?>', f"<robot name={self._quoted(description.name)}>"]
        for link in description.links:
            self._link(link)
        for joint in description.joints:
            self._joint(joint)
        self.lines.append("</robot>")
        return "\n".join(self.lines) + "\n"

    def _quoted(self, text: str) -> str:
        if _OUTSIDE_XML.search(text):
            raise UrdfError(self.description.source, f"name {text!r}", "holds a character that XML cannot carry")
        return quoteattr(text)

    def _add(self, indent: int, line: str) -> None:
        self.lines.append("  " * indent + line)

    def _check_size(self, values: Sequence[float] | FloatArray, element: str, what: str) -> None:
        largest = max(abs(float(value)) for value in values)
        if not largest <= _LARGEST:
            reason = f"{what} must be within +-{_LARGEST:g} to be written, got {largest:g}"
            raise UrdfError(self.description.source, element, reason)

    def _origin(self, indent: int, T: FloatArray) -> None:
        xyz, rpy = T[:3, 3], _rpy_from_rotation(T[:3, :3])
        if any(xyz) or any(rpy):
            self._add(indent, f'<origin xyz="{_printed(xyz)}" rpy="{_printed(rpy)}"/>')

    def _joint(self, joint: Joint) -> None:
        self._add(1, f'<joint name={self._quoted(joint.name)} type="{joint.type}">')
        self._add(2, f"<parent link={self._quoted(joint.parent)}/>")
        self._add(2, f"<child link={self._quoted(joint.child)}/>")
        self._check_size(joint.T_parent_joint[:3, 3], f"joint {joint.name!r}", "the origin")
        self._origin(2, joint.T_parent_joint)
        if joint.type not in ("fixed", "floating"):
            self._add(2, f'<axis xyz="{_printed(joint.axis)}"/>')
        if joint.type in ("revolute", "prismatic"):
            low, high = _printed([_finite(joint.lower)]), _printed([_finite(joint.upper)])
            self._add(2, f'<limit lower="{low}" upper="{high}" {self._speed_and_effort(joint)}/>')
        elif joint.type != "fixed" and (joint.velocity < inf or joint.effort < inf):
            self._add(2, f"<limit {self._speed_and_effort(joint)}/>")
        if joint.mimic is not None:
            self._check_size((joint.mimic.multiplier, joint.mimic.offset), f"joint {joint.name!r}", "the mimic")
            factor, offset = _printed([joint.mimic.multiplier]), _printed([joint.mimic.offset])
            self._add(2, f'<mimic joint={self._quoted(joint.mimic.joint)} multiplier="{factor}" offset="{offset}"/>')
        self._add(1, "</joint>")

    @staticmethod
    def _speed_and_effort(joint: Joint) -> str:
        return f'effort="{_printed([_finite(joint.effort)])}" velocity="{_printed([_finite(joint.velocity)])}"'

    def _link(self, link: Link) -> None:
        if not (link.visuals or link.collisions or link.inertial):
            self._add(1, f"<link name={self._quoted(link.name)}/>")
            return
        self._add(1, f"<link name={self._quoted(link.name)}>")
        if link.inertial is not None:
            self._add(2, "<inertial>")
            self._origin(3, link.inertial.T_link_inertial)
            self._add(3, f'<mass value="{_printed([link.inertial.mass])}"/>')
            keys = (("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1), ("iyz", 1, 2), ("izz", 2, 2))
            values = " ".join(f'{key}="{_printed([link.inertial.inertia[i, j]])}"' for key, i, j in keys)
            self._add(3, f"<inertia {values}/>")
            self._add(2, "</inertial>")
        for visual in link.visuals:
            self._shape("visual", visual)
        for collision in link.collisions:
            self._shape("collision", collision)
        self._add(1, "</link>")

    def _shape(self, tag: str, shape: Visual | Collision) -> None:
        self._add(2, f"<{tag} name={self._quoted(shape.name)}>" if shape.name else f"<{tag}>")
        self._origin(3, shape.T_link_shape)
        self._add(3, f"<geometry>{self._geometry(shape.geometry)}</geometry>")
        if isinstance(shape, Visual) and shape.material is not None:
            material = shape.material
            color = "" if material.rgba is None else f'<color rgba="{_printed(material.rgba)}"/>'
            texture = "" if material.texture is None else f"<texture filename={self._quoted(material.texture)}/>"
            self._add(3, f"<material name={self._quoted(material.name)}>{color}{texture}</material>")
        self._add(2, f"</{tag}>")

    def _geometry(self, geometry: Geometry) -> str:
        if isinstance(geometry, Box):
            return f'<box size="{_printed(geometry.size)}"/>'
        if isinstance(geometry, Sphere):
            return f'<sphere radius="{_printed([geometry.radius])}"/>'
        if isinstance(geometry, Mesh):
            scale = "" if np.array_equal(geometry.scale, np.ones(3)) else f' scale="{_printed(geometry.scale)}"'
            return f"<mesh filename={self._quoted(geometry.filename)}{scale}/>"
        tag = "cylinder" if isinstance(geometry, Cylinder) else "capsule"
        return f'<{tag} radius="{_printed([geometry.radius])}" length="{_printed([geometry.length])}"/>'


def _finite(value: float) -> float:
    largest = float(np.finfo(np.float64).max)
    return min(max(value, -largest), largest)


def _printed(values: Sequence[float] | FloatArray) -> str:
    """Numbers as text that reads back as the same numbers."""
    return " ".join(repr(float(value) + 0.0).removesuffix(".0") for value in values)
