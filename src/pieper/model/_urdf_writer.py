"""A description as the text of a URDF, from which it can be read back to the last digit."""

from __future__ import annotations

import re
from math import inf
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np

from pieper.errors import UrdfError
from pieper.model._urdf_reader import LARGEST
from pieper.model.description import (
    Box,
    Collision,
    Cylinder,
    Description,
    Geometry,
    Joint,
    Link,
    Mesh,
    Sphere,
    Visual,
)
from pieper.spatial._rpy import rpy_from_rotation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pieper.model._arrays import FloatArray


_OUTSIDE_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")


class UrdfWriter:
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
        if not largest <= LARGEST:
            reason = f"{what} must be within +-{LARGEST:g} to be written, got {largest:g}"
            raise UrdfError(self.description.source, element, reason)

    def _origin(self, indent: int, T: FloatArray) -> None:
        xyz, rpy = T[:3, 3], rpy_from_rotation(T[:3, :3])
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
