"""A robot description: the tree of links and joints that a URDF states, and the serial chains inside it.

A description keeps everything that was read, geometry included, for the viewer and the simulator. Computations take a
`Chain`: `Description.chain` cuts the path from a base link to a tip link out of the tree and turns it into screws.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cached_property
from math import inf, isnan
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pieper.errors import AmbiguousError, ArrayError, DescriptionError, UrdfError, unknown_name
from pieper.model.chain import Chain, Frame, free_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

FloatArray = NDArray[np.float64]

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")

MAX_NAME = 1000  # characters

_MOVING = frozenset({"revolute", "continuous", "prismatic"})
_UNSUPPORTED = frozenset({"floating", "planar"})
_ROTATION_TOLERANCE = 1e-9  # as for Chain: ten typed digits pass, a typing error does not
_MAX_AXES = 2000  # the coupling of a chain is dense; no arm comes near, and a hostile file must not fill the memory
_ON_AXIS = 1e-13  # [m, relative beyond 1 m] rounding left by composing poses; a real offset is far larger


def _frozen(value: ArrayLike, shape: tuple[int, ...], name: str) -> FloatArray:
    """A read-only float64 copy of `value` with the given shape."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as cause:
        raise ArrayError(f"{name} must be numbers of shape {shape}, got {value!r}") from cause
    if array.shape != shape:
        raise ArrayError(f"{name} must have shape {shape}, got {array.shape}")
    array.setflags(write=False)
    return array


def _identity() -> FloatArray:
    return np.eye(4)


def _x_axis() -> FloatArray:
    return np.array([1.0, 0.0, 0.0])


def _ones() -> FloatArray:
    return np.ones(3)


# --------------------------------------------------------------------------------------------------------------------
# geometry and inertia, for the viewer and the simulator


@dataclass(frozen=True, eq=False)
class Box:
    """A box centred on its frame; `size` (3,) edge lengths [m]."""

    size: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", _frozen(self.size, (3,), "size of a box"))


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about z, centred on its frame [m]."""

    radius: float
    length: float


@dataclass(frozen=True)
class Capsule:
    """A cylinder about z with half spheres beyond its `length`, centred on its frame [m]."""

    radius: float
    length: float


@dataclass(frozen=True)
class Sphere:
    """A sphere centred on its frame [m]."""

    radius: float


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh file.

    Attributes
    ----------
    filename : str
        As written in the description, for example ``package://my_robot/meshes/link_1.stl``.
    scale : (3,) array
        Factors along x, y, z [-].
    path : str or None
        The file that `filename` was resolved to; None when it was not found.
    """

    filename: str
    scale: FloatArray = field(default_factory=_ones)
    path: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "scale", _frozen(self.scale, (3,), f"scale of mesh {self.filename!r}"))


Geometry: TypeAlias = Box | Cylinder | Capsule | Sphere | Mesh


@dataclass(frozen=True)
class Material:
    """How a surface looks: `rgba` in 0..1, or None; `texture` file name as written, or None."""

    name: str = ""
    rgba: tuple[float, float, float, float] | None = None
    texture: str | None = None


@dataclass(frozen=True, eq=False)
class Visual:
    """A shape to draw; `T_link_shape` (4, 4) places it in the link frame [m, -]."""

    geometry: Geometry
    T_link_shape: FloatArray = field(default_factory=_identity)
    material: Material | None = None
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_link_shape", _frozen(self.T_link_shape, (4, 4), "T_link_shape"))


@dataclass(frozen=True, eq=False)
class Collision:
    """A shape to collide with; `T_link_shape` (4, 4) places it in the link frame [m, -]."""

    geometry: Geometry
    T_link_shape: FloatArray = field(default_factory=_identity)
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_link_shape", _frozen(self.T_link_shape, (4, 4), "T_link_shape"))


@dataclass(frozen=True, eq=False)
class Inertial:
    """Mass [kg], the frame at the centre of mass, and the (3, 3) inertia about it in that frame [kg m^2]."""

    mass: float
    T_link_inertial: FloatArray
    inertia: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_link_inertial", _frozen(self.T_link_inertial, (4, 4), "T_link_inertial"))
        object.__setattr__(self, "inertia", _frozen(self.inertia, (3, 3), "inertia"))


# --------------------------------------------------------------------------------------------------------------------
# links and joints


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid body with a frame of its own."""

    name: str
    visuals: tuple[Visual, ...] = ()
    collisions: tuple[Collision, ...] = ()
    inertial: Inertial | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "visuals", tuple(self.visuals))
        object.__setattr__(self, "collisions", tuple(self.collisions))


@dataclass(frozen=True)
class Mimic:
    """The joint follows another one: ``value = multiplier * value_of(joint) + offset`` [rad or m]."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Joint:
    """The connection from a parent link to a child link.

    Attributes
    ----------
    name : str
    type : str
        One of `JOINT_TYPES`.
    parent, child : str
        Link names. The frame of the child is the frame of the joint, moved by the joint.
    T_parent_joint : (4, 4) array
        Joint frame in the parent frame at joint value 0 [m, -].
    axis : (3,) array
        Direction of the axis in the joint frame, normalised here [-].
    lower, upper : float
        Limits [rad or m]; infinite where there are none.
    velocity, effort : float
        Limits [rad/s or m/s, N m or N]; infinite where there are none.
    mimic : Mimic or None
    """

    name: str
    type: str
    parent: str
    child: str
    T_parent_joint: FloatArray = field(default_factory=_identity)
    axis: FloatArray = field(default_factory=_x_axis)
    lower: float = -inf
    upper: float = inf
    velocity: float = inf
    effort: float = inf
    mimic: Mimic | None = None

    def __post_init__(self) -> None:
        axis = np.array(_frozen(self.axis, (3,), f"axis of joint {self.name!r}"))
        largest = float(np.abs(axis).max())
        if 0.0 < largest < inf:  # a zero or infinite axis stays as it is: Description refuses it by name
            axis = axis / largest
            axis = axis / float(np.sqrt(axis @ axis))
        object.__setattr__(
            self, "T_parent_joint", _frozen(self.T_parent_joint, (4, 4), f"T_parent_joint of joint {self.name!r}")
        )
        object.__setattr__(self, "axis", _frozen(axis, (3,), "axis"))

    @property
    def moves(self) -> bool:
        """True for revolute, continuous and prismatic joints, mimicking ones included."""
        return self.type in _MOVING


class Step(NamedTuple):
    """One joint on a path; `forward` is False where the path runs from the child to the parent."""

    joint: Joint
    forward: bool


@dataclass(frozen=True, eq=False)
class Description:
    """A tree of links and joints, checked when it is made.

    Attributes
    ----------
    name : str
    links : tuple of Link
    joints : tuple of Joint
    source : str
        File name, or ``<string>``; error messages start with it.
    base, tip : str or None
        Links between which `chain` runs when it is not told otherwise.

    Raises
    ------
    DescriptionError
        The first fault found: not one root, an unknown parent or child, a cycle, a name given twice, a number that is
        not finite, a zero axis, lower > upper, an unknown joint type, a mimic without a target or in a circle.

    Examples
    --------
    >>> pan = Joint("pan", "revolute", "base", "arm", axis=[0, 0, 1], lower=-1, upper=1)
    >>> tilt = Joint("tilt", "continuous", "arm", "hand", axis=[0, 1, 0])
    >>> robot = Description("pan_tilt", (Link("base"), Link("arm"), Link("hand")), (pan, tilt))
    >>> robot.root, robot.leaves
    ('base', ('hand',))
    >>> robot.chain()
    Chain('pan_tilt', 2 joints, 'base' -> 'hand')
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    source: str = "<string>"
    base: str | None = None
    tip: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "links", tuple(self.links))
        object.__setattr__(self, "joints", tuple(self.joints))
        check(self)

    def __repr__(self) -> str:
        return f"Description({self.name!r}, {len(self.links)} links, {len(self.joints)} joints)"

    # ---- the tree

    @cached_property
    def _links(self) -> dict[str, Link]:
        return {link.name: link for link in self.links}

    @cached_property
    def _joints(self) -> dict[str, Joint]:
        return {joint.name: joint for joint in self.joints}

    @cached_property
    def _up(self) -> dict[str, Joint]:
        """The joint above each link; the root has none."""
        return {joint.child: joint for joint in self.joints}

    @cached_property
    def _down(self) -> dict[str, tuple[Joint, ...]]:
        """The joints below each link, in the order of the file."""
        below: dict[str, list[Joint]] = {link.name: [] for link in self.links}
        for joint in self.joints:
            below[joint.parent].append(joint)
        return {link: tuple(joints) for link, joints in below.items()}

    @cached_property
    def root(self) -> str:
        """The link that no joint moves."""
        return next(link.name for link in self.links if link.name not in self._up)

    @cached_property
    def leaves(self) -> tuple[str, ...]:
        """The links that carry no other link, in the order of the file."""
        return tuple(link.name for link in self.links if not self._down[link.name])

    def link(self, name: str) -> Link:
        """The link of that name."""
        self._require_link(name)
        return self._links[name]

    def joint(self, name: str) -> Joint:
        """The joint of that name."""
        try:
            return self._joints[name]
        except KeyError:
            raise unknown_name("joint", name, self._joints, f"description {self.name!r}") from None

    def joint_above(self, link: str) -> Joint | None:
        """The joint whose child is `link`; None for the root."""
        self._require_link(link)
        return self._up.get(link)

    def joints_below(self, link: str) -> tuple[Joint, ...]:
        """The joints whose parent is `link`, in the order of the file."""
        self._require_link(link)
        return self._down[link]

    def path(self, base: str, tip: str) -> tuple[Step, ...]:
        """The joints from `base` to `tip`, through their common ancestor when neither lies below the other."""
        self._require_link(base)
        self._require_link(tip)
        above_base = {link: steps for steps, link in enumerate(self._ancestors(base))}
        down: list[Step] = []
        common = tip
        while common not in above_base:
            joint = self._up[common]
            down.append(Step(joint, True))
            common = joint.parent
        up: list[Step] = []
        link = base
        while link != common:
            joint = self._up[link]
            up.append(Step(joint, False))
            link = joint.parent
        return (*up, *reversed(down))

    def _ancestors(self, link: str) -> Iterator[str]:
        yield link
        while link in self._up:
            link = self._up[link].parent
            yield link

    def _require_link(self, name: str) -> None:
        if name not in self._links:
            raise unknown_name("link", name, self._links, f"description {self.name!r}")

    # ---- chains

    def chain(self, base: str | None = None, tip: str | None = None) -> Chain:
        """The serial chain from `base` to `tip`.

        With axis direction w and a point p of each axis in the base frame at joint values 0, the screw of a turning
        joint is (p x w, w) and of a sliding joint (w, 0), linear part first (Modern Robotics, section 4.1.1). Fixed
        joints and the offsets of mimic joints are part of the home pose. A joint that the path runs through from
        child to parent counts with the opposite screw.

        Parameters
        ----------
        base : str, optional
            Link name; the description's own `base`, else the root.
        tip : str, optional
            Link name; the description's own `tip`, else the one sensible end: the single leaf; behind the last joint
            of the clearly longest branch the leaf that is named as a tool frame (``tool0``, ``tcp``, ``ee_link``,
            ``flange``); the link that carries the fingers when a hand follows an arm.

        Returns
        -------
        Chain
            A mimic joint moves with its master through `Chain.coupling`; a master that is not on the path is a joint
            of the chain all the same.

        Raises
        ------
        UnknownNameError
            No link of that name.
        AmbiguousError
            Several chains fit; the message lists them.
        UrdfError
            A floating or planar joint lies on the path.
        """
        if base is not None:
            self._require_link(base)
        if tip is not None:
            self._require_link(tip)
        else:
            tip = self.tip if self.tip is not None and self.tip != base else self._default_tip(base)
        start = base if base is not None else (self.base if self.base is not None else self.root)
        return self._chain_along(start, tip)

    def _chain_along(self, base: str, tip: str) -> Chain:
        T = np.eye(4)
        screws: list[FloatArray] = []
        rows: list[tuple[str, float]] = []  # master joint and multiplier of each axis
        frames = [Frame(base, 0, T)]
        for joint, forward in self.path(base, tip):
            if joint.type in _UNSUPPORTED:
                raise UrdfError(
                    self.source,
                    f"joint {joint.name!r}",
                    f"{joint.type} joints are unsupported in a serial chain; it lies between {base!r} and {tip!r}: "
                    f"choose base and tip on one side of it, for example base={joint.child!r}",
                )
            if forward:
                T = T @ joint.T_parent_joint
            if joint.moves:
                master, multiplier, offset = self._master(joint)
                if multiplier != 0.0:
                    if len(screws) == _MAX_AXES:
                        raise UrdfError(self.source, f"joint {joint.name!r}", f"is behind {_MAX_AXES} moving joints")
                    screws.append(_screw(T, joint, 1.0 if forward else -1.0))
                    rows.append((master, multiplier))
                if offset != 0.0:
                    T = T @ _moved(joint, offset if forward else -offset)
            if not forward:
                T = T @ _inverse(joint.T_parent_joint)
            frames.append(Frame(joint.child if forward else joint.parent, len(screws), T))
        names = tuple(dict.fromkeys(master for master, _ in rows))
        masters = [self._joints[name] for name in names]
        coupling = np.zeros((len(rows), len(names)))
        for axis, (master, multiplier) in enumerate(rows):
            coupling[axis, names.index(master)] = multiplier
        return Chain(
            name=self.name,
            screws=np.array(screws).reshape(-1, 6),
            home=T,
            limits=np.array([_limits(joint) for joint in masters]).reshape(-1, 2),
            joint_names=names,
            base=base,
            tip=tip,
            frames=tuple(frames),
            max_velocity=np.array([joint.velocity for joint in masters], dtype=np.float64),
            max_effort=np.array([joint.effort for joint in masters], dtype=np.float64),
            coupling=coupling,
        )

    @cached_property
    def _masters(self) -> dict[str, tuple[str, float, float]]:
        """For each joint the one that it follows in the end, with ``value = multiplier * master + offset``."""
        masters: dict[str, tuple[str, float, float]] = {}
        for joint in self.joints:
            followers: list[Joint] = []
            while joint.mimic is not None and joint.name not in masters:
                followers.append(joint)
                joint = self._joints[joint.mimic.joint]
            masters.setdefault(joint.name, (joint.name, 1.0, 0.0))
            for follower in reversed(followers):
                assert follower.mimic is not None
                master, multiplier, offset = masters[follower.mimic.joint]
                factor = follower.mimic.multiplier
                masters[follower.name] = (master, factor * multiplier, factor * offset + follower.mimic.offset)
        return masters

    def _master(self, joint: Joint) -> tuple[str, float, float]:
        master, multiplier, offset = self._masters[joint.name]
        if not (-inf < multiplier < inf and -inf < offset < inf):
            raise DescriptionError(self.source, f"joint {joint.name!r}", "the mimic multipliers grow without bound")
        return master, multiplier, offset

    # ---- the one sensible chain

    def _default_tip(self, base: str | None) -> str:
        start = base if base is not None else (self.base if self.base is not None else self.root)
        if self._reach[start] == 0:
            start = self.root  # a frame beside the arm, such as a base turned by pi: the arm hangs from the root
        tips = self._sensible_tips(start)
        if len(tips) == 1:
            return tips[0]
        first = base if base is not None else (self.base if self.base is not None else self.root)
        shown = [f"{first} -> {tip} ({self._joint_count(first, tip)} joints)" for tip in tips[:12]]
        more = f", and {len(tips) - 12} more" if len(tips) > 12 else ""
        raise AmbiguousError(
            f"{self.source}: several chains fit in {self.name!r}; choose one with base= and tip=: {', '.join(shown)}{more}"
        )

    @cached_property
    def _order(self) -> tuple[str, ...]:
        """All links, each behind its parent."""
        order = [self.root]
        for link in order:
            order.extend(joint.child for joint in self._down[link])
        return tuple(order)

    @cached_property
    def _reach(self) -> dict[str, int]:
        """Moving joints on the longest way down from each link."""
        reach = {link.name: 0 for link in self.links}
        for link in reversed(self._order):
            reach[link] = max((self._weight_from(joint, reach) for joint in self._down[link]), default=0)
        return reach

    @staticmethod
    def _weight_from(joint: Joint, reach: dict[str, int]) -> int:
        return reach[joint.child] + (joint.type != "fixed")

    def _weight(self, joint: Joint) -> int:
        """Moving joints on the longest way down that starts with `joint`."""
        return self._weight_from(joint, self._reach)

    def _joint_count(self, base: str, tip: str) -> int:
        """Joints of the chain: those on the path, or the ones that they follow."""
        masters = (self._masters[step.joint.name] for step in self.path(base, tip) if step.joint.moves)
        return len({master for master, multiplier, _ in masters if multiplier != 0.0})

    def _sensible_tips(self, start: str) -> list[str]:
        """The end of the one sensible chain, or one end for each of the branches that are about equally long."""
        tips: list[str] = []
        open_starts = [(start, 0)]
        while open_starts:
            link, count = open_starts.pop()
            bodies = [(link, count)]  # rigid bodies along the trunk: their first link, and the joints before it
            while True:
                branches = sorted((j for j in self._down[link] if self._weight(j)), key=self._weight, reverse=True)
                if not branches:
                    tips.append(self._tool_frame(bodies) or self._rigid_end(bodies[-1][0]))
                    break
                longest = self._weight(branches[0])
                rivals = [joint for joint in branches if 2 * self._weight(joint) > longest]
                if len(branches) > 1 and _is_hand(count, longest):
                    tips.append(self._tool_frame(bodies) or link)
                    break
                if len(rivals) > 1:
                    open_starts.extend((j.child, count + (j.type != "fixed")) for j in reversed(rivals))
                    break
                link = branches[0].child
                if branches[0].type != "fixed":
                    count += 1
                    bodies.append((link, count))
        return tips

    def _tool_frame(self, bodies: list[tuple[str, int]]) -> str | None:
        """The leaf named as a tool frame on the last body; or a little before it, where a gripper's jaw follows."""
        end = bodies[-1][1]
        for body, count in reversed(bodies):
            beyond = end - count
            if beyond and (beyond > 2 or count <= beyond):
                return None
            ranked = sorted((rank, leaf) for leaf in self._rigid_leaves(body) if (rank := _tool_rank(leaf)) is not None)
            if len(ranked) == 1 or (ranked and ranked[0][0] != ranked[1][0]):
                return ranked[0][1]
        return None

    def _rigid_leaves(self, body: str) -> list[str]:
        """The leaves that are rigidly fixed to a link."""
        leaves, stack = [], [body]
        while stack:
            link = stack.pop()
            below = self._down[link]
            if not below and link != body:
                leaves.append(link)
            stack.extend(joint.child for joint in below if joint.type == "fixed")
        return leaves

    def _rigid_end(self, body: str) -> str:
        """Down from a link over fixed joints as long as there is one way only."""
        while len(self._down[body]) == 1:
            body = self._down[body][0].child
        return body

    # ---- back from a chain

    @classmethod
    def from_chain(cls, chain: Chain) -> Description:
        """A description of the links and joints of a chain, for arms that came from DH rows or screws.

        Link frames are `Chain.frames`. Where a frame does not lie on the axis that moves it, a link named
        ``<joint>_axis`` is put between.

        Raises
        ------
        DescriptionError
            An axis depends on several joints at once, which links and joints cannot state.
        """
        return _FromChain(chain).build()


def _is_hand(before: int, longest: int) -> bool:
    """Whether branches of at most `longest` joints behind `before` joints are the fingers of a hand."""
    return before >= 2 * longest or (before >= 4 and before >= longest)


_TOOL_NAMES = tuple(
    re.compile(rf"(?:^|[^a-z])(?:{pattern})(?:$|[^a-z])", re.IGNORECASE)
    for pattern in (
        r"tcp",
        r"tool[0-9]+",
        r"ee|eef|end[_-]?effector",
        r"grasp|gripper[_-]frame|pinch",
        r"tool",
        r"flange",
    )
)


def _tool_rank(name: str) -> tuple[int, int] | None:
    """Smaller for names that more surely mean the tool frame; None for other names."""
    for rank, pattern in enumerate(_TOOL_NAMES):
        if pattern.search(name):
            return rank, len(name)
    return None


# --------------------------------------------------------------------------------------------------------------------
# joints as transforms


def _screw(T_base_joint: FloatArray, joint: Joint, sign: float) -> FloatArray:
    w = sign * (T_base_joint[:3, :3] @ joint.axis)
    if joint.type == "prismatic":
        return np.concatenate([w, np.zeros(3)])
    v = np.cross(T_base_joint[:3, 3], w)
    pitch = float(v @ w)  # rounding; more than that only where the joint lies far along its own axis
    return np.concatenate([v - pitch * w if abs(pitch) > _ON_AXIS else v, w])


def _moved(joint: Joint, value: float) -> FloatArray:
    """The motion of a joint in its own frame, (4, 4); Rodrigues' formula for a turn."""
    T = np.eye(4)
    if joint.type == "prismatic":
        T[:3, 3] = joint.axis * value
        return T
    x, y, z = joint.axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    T[:3, :3] += np.sin(value) * K + 2.0 * np.sin(0.5 * value) ** 2 * (K @ K)
    return T


def _inverse(T: FloatArray) -> FloatArray:
    inverse = np.eye(4)
    inverse[:3, :3] = T[:3, :3].T
    inverse[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return inverse


def _limits(joint: Joint) -> tuple[float, float]:
    return (-inf, inf) if joint.type == "continuous" else (joint.lower, joint.upper)


# --------------------------------------------------------------------------------------------------------------------
# checks


def check(description: Description) -> None:
    """Refuse a description that is not one tree of well-formed joints; see `Description` for the list of faults."""
    source = description.source

    def fault(element: str, reason: str) -> DescriptionError:
        return DescriptionError(source, element, reason)

    if not description.links:
        raise fault(f"robot {description.name!r}", "has no links; a description needs at least one")
    links = _unique_names(source, "link", (link.name for link in description.links))
    joints = _unique_names(source, "joint", (joint.name for joint in description.joints))

    above: dict[str, Joint] = {}
    for joint in description.joints:
        element = f"joint {joint.name!r}"
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                raise fault(element, f"{role} {link!r} is not a link of the description; {_near(link, links)}")
        if joint.parent == joint.child:
            raise fault(element, f"parent and child are the same link {joint.child!r}: a cycle; a tree is needed")
        if joint.child in above:
            other = above[joint.child].name
            raise fault(element, f"link {joint.child!r} is already the child of joint {other!r}; a link has one parent")
        above[joint.child] = joint
        _check_joint(source, joint)

    roots = [name for name in links if name not in above]
    if not roots:
        raise fault(f"joint {description.joints[0].name!r}", "the joints form a cycle; a tree with one root is needed")
    if len(roots) > 1:
        raise fault(
            f"robot {description.name!r}", f"has {len(roots)} roots ({_listed(roots)}); connect them to one tree"
        )
    order = description._order
    if len(order) < len(links):
        reached = set(order)
        cyclic = next(name for name in links if name not in reached)
        raise fault(f"joint {above[cyclic].name!r}", f"link {cyclic!r} is part of a cycle; a tree is needed")
    _check_mimics(source, description.joints, joints)
    for role, end in (("base", description.base), ("tip", description.tip)):
        if end is not None and end not in links:
            raise fault(role, f"{end!r} is not a link of the description; {_near(end, links)}")


def _unique_names(source: str, kind: str, names: Iterable[object]) -> dict[str, int]:
    seen: dict[str, int] = {}
    for position, name in enumerate(names):
        if not isinstance(name, str) or not name.strip():
            raise DescriptionError(source, f"{kind} number {position + 1}", f"needs a name, got {name!r}")
        if len(name) > MAX_NAME:
            raise DescriptionError(source, f"{kind} {name[:60]!r}...", f"the name is longer than {MAX_NAME} characters")
        if name in seen:
            raise DescriptionError(source, f"{kind} {name!r}", f"the name is given twice; {kind} names must be unique")
        seen[name] = position
    return seen


def _check_joint(source: str, joint: Joint) -> None:
    def fault(reason: str) -> DescriptionError:
        return DescriptionError(source, f"joint {joint.name!r}", reason)

    if joint.type not in JOINT_TYPES:
        raise fault(f"unknown type {joint.type!r}; types are: {', '.join(JOINT_TYPES)}")
    T = joint.T_parent_joint
    if not np.isfinite(T).all():
        raise fault(f"the origin must be finite, got position {T[:3, 3].tolist()}")
    deviation = float(np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max())
    if not deviation <= _ROTATION_TOLERANCE or np.linalg.det(T[:3, :3]) < 0.0:
        raise fault(f"the origin must be a pose; its 3x3 block deviates from a rotation by {deviation:.3g}")
    if T[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise fault(f"the origin must be a pose with the last row 0 0 0 1, got {T[3].tolist()}")
    if joint.type != "fixed" and joint.type != "floating":
        if not np.isfinite(joint.axis).all():
            raise fault(f"the axis must be finite, got {joint.axis.tolist()}")
        if not joint.axis.any():
            raise fault("the axis is zero; give it a direction, for example 0 0 1")
    for label, value in (("lower", joint.lower), ("upper", joint.upper)):
        if isnan(value):
            raise fault(f"the {label} limit must be a number, got {value}")
    if joint.type in ("revolute", "prismatic") and (
        joint.lower > joint.upper or joint.lower == inf or joint.upper == -inf
    ):
        raise fault(f"limits must be lower <= upper, got lower {joint.lower} and upper {joint.upper}")
    for label, value in (("velocity", joint.velocity), ("effort", joint.effort)):
        if isnan(value) or value < 0.0:
            raise fault(f"the {label} limit must not be negative, got {value}")


def _check_mimics(source: str, joints: Sequence[Joint], known: dict[str, int]) -> None:
    settled: set[str] = set()
    for joint in joints:
        seen: list[str] = []
        at = joint
        while at.mimic is not None and at.name not in settled:
            element = f"joint {at.name!r}"
            target = at.mimic.joint
            if at.name in seen:
                raise DescriptionError(source, element, f"mimics itself through {_listed(seen)}; remove one <mimic>")
            seen.append(at.name)
            if target not in known:
                raise DescriptionError(source, element, f"mimics {target!r}, which is no joint; {_near(target, known)}")
            for label, value in (("multiplier", at.mimic.multiplier), ("offset", at.mimic.offset)):
                if not -inf < value < inf:
                    raise DescriptionError(source, element, f"the mimic {label} must be finite, got {value}")
            master = joints[known[target]]
            if at.moves and not master.moves:
                raise DescriptionError(
                    source, element, f"mimics joint {target!r}, which is {master.type} and has no value to follow"
                )
            at = master
        settled.update(seen)


def _near(name: str, known: Iterable[str]) -> str:
    names = list(known)
    # comparing takes the product of the lengths, and the names come from outside
    short = [known_name for known_name in names[:2000] if len(known_name) <= 80]
    near = get_close_matches(name, short, n=3, cutoff=0.5) if len(name) <= 80 else []
    return "did you mean " + " or ".join(repr(n) for n in near) + "?" if near else f"there are: {_listed(names)}"


def _listed(names: Sequence[str], most: int = 8) -> str:
    shown = ", ".join(repr(name if len(name) <= 80 else name[:77] + "...") for name in names[:most])
    return shown + (f" and {len(names) - most} more" if len(names) > most else "")


# --------------------------------------------------------------------------------------------------------------------
# from a chain


class _FromChain:
    """Collects the links and joints that say the same as a chain."""

    def __init__(self, chain: Chain) -> None:
        self.chain = chain
        self.links = [chain.base]
        self.joints: list[Joint] = []
        self.taken_joints = set(chain.joint_names)
        self.taken_links = {chain.base, chain.tip, *(frame.name for frame in chain.frames)}
        self.owner: dict[int, int] = {}  # joint index -> the axis that bears its name; the other axes mimic it
        for axis, row in enumerate(chain.coupling):
            if np.count_nonzero(row) > 1:
                raise DescriptionError(
                    chain.name,
                    f"axis {axis + 1}",
                    f"depends on {np.count_nonzero(row)} joints at once, and a joint can mimic one joint only",
                )
            joint = int(np.argmax(row != 0.0))
            if row[joint] == 1.0:
                self.owner.setdefault(joint, axis)

    def build(self) -> Description:
        chain = self.chain
        at, T_at, after = chain.base, np.eye(4), 0
        written = {chain.base}
        frames = sorted(chain.frames, key=lambda frame: frame.after)
        if frames[-1].name != chain.tip:
            frames.append(Frame(chain.tip, len(chain.screws), chain.home))
        for frame in frames:
            if frame.name in written:  # the base itself
                continue
            written.add(frame.name)
            while after < frame.after:
                point = self._nearest_on_axis(after, frame.home[:3, 3])
                apart = float(np.linalg.norm(point - frame.home[:3, 3]))
                T_next, child = np.array(frame.home), frame.name
                if after + 1 < frame.after or apart > _ON_AXIS * max(1.0, float(np.linalg.norm(point))):
                    T_next[:3, 3] = point
                    child = self._new_link(f"{self._joint_name(after)}_axis")
                self._add(at, child, T_at, T_next, after)
                at, T_at, after = child, T_next, after + 1
            if at != frame.name:
                self._add(at, frame.name, T_at, np.array(frame.home), None)
                at, T_at = frame.name, np.array(frame.home)
        for joint in range(chain.dof):
            if joint not in self.owner:
                self._add_lone_master(joint)
        links = tuple(Link(name) for name in self.links)
        return Description(chain.name, links, tuple(self.joints), chain.name, base=chain.base, tip=chain.tip)

    def _nearest_on_axis(self, axis: int, point: FloatArray) -> FloatArray:
        v, w = self.chain.screws[axis, :3], self.chain.screws[axis, 3:]
        if not w.any():
            return point  # a sliding axis has a direction only
        foot = np.cross(w, v)
        return np.asarray(foot + w * float(w @ (point - foot)))

    def _joint_name(self, axis: int) -> str:
        return self.chain.joint_names[int(np.argmax(self.chain.coupling[axis] != 0.0))]

    def _new_link(self, name: str) -> str:
        name = free_name(name, self.taken_links)
        self.taken_links.add(name)
        return name

    def _add(self, parent: str, child: str, T_parent: FloatArray, T_child: FloatArray, axis: int | None) -> None:
        """A joint between two frames given at home; fixed when no axis moves it."""
        self.links.append(child)
        T = _inverse(T_parent) @ T_child
        T[3] = [0.0, 0.0, 0.0, 1.0]
        if axis is None or not self.chain.coupling[axis].any():
            name = free_name(f"{parent}-{child}", self.taken_joints)
            self.taken_joints.add(name)
            self.joints.append(Joint(name, "fixed", parent, child, T))
            return
        screw = self.chain.screws[axis]
        turns = bool(screw[3:].any())
        direction = T_child[:3, :3].T @ (screw[3:] if turns else screw[:3])
        index = int(np.argmax(self.chain.coupling[axis] != 0.0))
        if self.owner.get(index) == axis:
            self._add_moving(self.chain.joint_names[index], parent, child, T, direction, turns, index)
            return
        name = free_name(f"{self.chain.joint_names[index]}_mimic", self.taken_joints)
        self.taken_joints.add(name)
        mimic = Mimic(self.chain.joint_names[index], float(self.chain.coupling[axis, index]))
        self._add_moving(name, parent, child, T, direction, turns, index, mimic)

    def _add_moving(
        self,
        name: str,
        parent: str,
        child: str,
        T: FloatArray,
        direction: FloatArray,
        turns: bool,
        index: int,
        mimic: Mimic | None = None,
    ) -> None:
        factor = 1.0 if mimic is None else mimic.multiplier
        lower, upper = sorted(float(value) * factor for value in self.chain.limits[index])
        endless = turns and lower == -inf and upper == inf
        self.joints.append(
            Joint(
                name,
                "continuous" if endless else "revolute" if turns else "prismatic",
                parent,
                child,
                T,
                direction,
                lower,
                upper,
                float(self.chain.max_velocity[index]) * abs(factor),
                float(self.chain.max_effort[index]),
                mimic,
            )
        )

    def _add_lone_master(self, index: int) -> None:
        """A joint beside the chain that bears the name and the limits which axes on the chain mimic."""
        axes = np.flatnonzero(self.chain.coupling[:, index])
        turns = bool(self.chain.screws[axes[0], 3:].any()) if axes.size else True
        name = self.chain.joint_names[index]
        child = self._new_link(f"{name}_link")
        self.links.append(child)
        self._add_moving(name, self.chain.base, child, np.eye(4), np.array([0.0, 0.0, 1.0]), turns, index)
