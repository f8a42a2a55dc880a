"""The solids that an arm collides with: those of its description where it has them, otherwise those made from the chain."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from pieper.errors import PieperWarning
from pieper.model import shape
from pieper.model.description import Box, Capsule, Cylinder, Geometry, Mesh, Sphere

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pieper.model.chain import Chain, FloatArray
    from pieper.model.description import Description, Joint


class ArmLike(Protocol):
    """What has a chain and perhaps a description, as `pieper.Arm` has."""

    chain: Chain
    description: Description | None


@dataclass(frozen=True, eq=False)
class LinkSolid:
    """A solid that moves with a link.

    Attributes
    ----------
    link : int
        Number of axes that move it, 0 for the base.
    name : str
        The link, as collisions are told.
    solid : Box, Cylinder, Capsule, Sphere or Mesh
    T_link_solid : (4, 4) array
        In the frame ``chain.frame(link)`` [m, -].
    """

    link: int
    name: str
    solid: Geometry
    T_link_solid: FloatArray


def solids_of_description(chain: Chain, description: Description) -> tuple[LinkSolid, ...] | None:
    """The collision geometry that a description gives the links of a chain.

    With that of links which hang on them beside the chain, such as fingers, whose joints are held at 0 or the limit nearest to it. Some links
    have none by right, such as frames between two axes that cross. Where one that moves is drawn and has none, or where all links from a joint to
    the tip have none, it would pass through everything unseen; a warning names them.

    Parameters
    ----------
    chain : Chain
    description : Description
        The chain is cut from it.

    Returns
    -------
    tuple of LinkSolid, or None
        None where it gives no link of the chain any, and where a mesh file is not at hand, which a warning says.
    """
    described = tuple(_described(chain, description))
    missing = [each.solid.filename for each in described if isinstance(each.solid, Mesh) and each.solid.path is None]
    if missing:
        warnings.warn(
            f"collision mesh {missing[0]!r} of {chain.name!r} was not found, of {len(missing)} missing; "
            "capsules and cylinders made from the chain are used instead",
            PieperWarning,
            stacklevel=2,
        )
        return None
    unseen = _unseen(chain, description, {each.link for each in described}) if described else []
    if unseen:
        warnings.warn(
            f"no collision geometry for {', '.join(unseen)} of {chain.name!r}: nothing notices what {'it touches' if len(unseen) == 1 else 'they touch'}; "
            "give <collision> in the description, or take the solids made from the joints, CollisionModel(arm.chain)",
            PieperWarning,
            stacklevel=2,
        )
    return described or None


def solids_of_chain(chain: Chain) -> tuple[LinkSolid, ...]:
    """Solids made from the chain alone, see `pieper.model.shape`.

    Capsules for tapered bars, with the larger of the two radii; cylinders for drums, without their rounded rims; the mark on the flange is left
    out. So every solid holds the part that is drawn.
    """
    return tuple(
        LinkSolid(part.link, chain.frame(part.link).name, _plain(part.solid), part.T_link_part)
        for part in shape.from_chain(chain).parts
        if part.role != "mark"
    )


def _plain(solid: shape.Solid) -> Geometry:
    """The solid itself, or one of the plain kinds that holds it."""
    if isinstance(solid, shape.Taper):
        return Capsule(max(solid.radius, solid.end_radius), solid.length)
    if isinstance(solid, shape.Drum):
        return Cylinder(solid.radius, solid.length)
    return solid


def _described(chain: Chain, description: Description) -> Iterator[LinkSolid]:
    for name, link, T_first_link in _placed(chain, description):
        for collision in description.link(name).collisions:
            yield LinkSolid(link, name, collision.geometry, T_first_link @ collision.T_link_shape)


def _unseen(chain: Chain, description: Description, solid: set[int]) -> list[str]:
    """Links that move, and to which no solid is fixed although they are drawn, or although nothing solid comes after them."""
    return [
        name
        for name, link, _ in _placed(chain, description)
        if link not in solid and link > 0 and (description.link(name).visuals or link > max(solid))
    ]


def _placed(chain: Chain, description: Description) -> Iterator[tuple[str, int, FloatArray]]:
    """Each link of the chain, and each that hangs on it: its name, how many axes move it, and where it lies among them."""
    known = {link.name for link in description.links}
    on_chain = {frame.name for frame in chain.frames}
    for frame in chain.frames:
        if frame.name not in known:
            continue
        T_first_link = np.linalg.inv(chain.frame(frame.after).home) @ frame.home
        yield frame.name, frame.after, T_first_link
        waiting = [(joint, T_first_link) for joint in description.joints_below(frame.name)]
        while waiting:
            joint, T_first_parent = waiting.pop()
            if joint.child in on_chain:
                continue
            T = T_first_parent @ joint.T_parent_joint @ _moved(joint)
            yield joint.child, frame.after, T
            waiting += [(below, T) for below in description.joints_below(joint.child)]


def _moved(joint: Joint) -> FloatArray:
    """By how much a joint beside the chain moves its child at 0, or at the limit nearest to it."""
    from pieper.spatial.twist import exp

    value = float(np.clip(0.0, joint.lower, joint.upper)) if joint.moves else 0.0
    screw = np.zeros(6)
    screw[slice(0, 3) if joint.type == "prismatic" else slice(3, 6)] = joint.axis * value
    return exp(screw)


def enclosing_capsule(
    solid: Geometry, vertices: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, float, bool]:
    """Ends (3,) and radius [m] of a capsule that holds a solid, in the frame of the solid, and whether it is the solid itself.

    Parameters
    ----------
    solid : Geometry
    vertices : (k, 3) array, optional
        Of a mesh [m].

    Examples
    --------
    >>> a, b, radius, exact = enclosing_capsule(Cylinder(0.1, 1.0))
    >>> round(float(b[2]), 3), round(radius, 3), exact
    (0.454, 0.11, False)
    """
    z = np.array([0.0, 0.0, 1.0])
    if isinstance(solid, Capsule | Sphere):
        half = 0.5 * solid.length if isinstance(solid, Capsule) else 0.0
        return -half * z, half * z, solid.radius, True
    if isinstance(solid, Cylinder):
        return (*_around(z, 0.5 * solid.length, solid.radius), False)
    if isinstance(solid, Box):
        long = int(np.argmax(solid.size))
        direction = np.eye(3)[long]
        across = 0.5 * float(np.linalg.norm(np.delete(solid.size, long)))
        return (*_around(direction, 0.5 * float(solid.size[long]), across), False)
    assert vertices is not None
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    direction = np.linalg.svd(vertices - middle, full_matrices=False)[2][0]
    along = (vertices - middle) @ direction
    radius = float(np.linalg.norm(vertices - middle - np.outer(along, direction), axis=1).max())
    center = middle + direction * 0.5 * float(along.min() + along.max())
    a, b, larger = _around(direction, 0.5 * float(np.ptp(along)), radius)
    return center + a, center + b, larger, False


def _around(direction: FloatArray, half: float, radius: float) -> tuple[FloatArray, FloatArray, float]:
    """A capsule around a cylinder: 10 % thicker, as much shorter as that allows; a ball where the cylinder is flat."""
    larger = min(1.1 * radius, float(np.hypot(half, radius)))
    inner = max(0.0, half - float(np.sqrt(max(0.0, larger * larger - radius * radius))))
    return -inner * direction, inner * direction, max(larger, float(np.hypot(half - inner, radius)))
