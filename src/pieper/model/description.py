"""A robot description: the tree of links and joints that a URDF states, and the serial chains inside it.

A description keeps everything that was read, geometry included, for the viewer and the simulator. Computations take a
`Chain`: `Description.chain` cuts the path from a base link to a tip link out of the tree and turns it into screws.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.errors import AmbiguousError, DescriptionError, UrdfError, unknown_name
from pieper.model._chain_links import links_and_joints
from pieper.model._default_tip import sensible_tips
from pieper.model._joint_motion import inverse, limits_of, moved, screw_of
from pieper.model._tree_checks import check_tree
from pieper.model.chain import Chain, Frame
from pieper.model.geometry import Box, Capsule, Collision, Cylinder, Geometry, Inertial, Material, Mesh, Sphere, Visual
from pieper.model.joint import JOINT_TYPES, MAX_NAME, Joint, Link, Mimic

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pieper.model._arrays import FloatArray


__all__ = [
    "JOINT_TYPES", "MAX_NAME", "Box", "Capsule", "Collision", "Cylinder", "Description", "Geometry", "Inertial", "Joint", "Link",
    "Material", "Mesh", "Mimic", "Sphere", "Step", "Visual",
]  # fmt: skip

_UNSUPPORTED = frozenset({"floating", "planar"})
_MAX_AXES = 2000  # the coupling of a chain is dense; no arm comes near, and a hostile file must not fill the memory


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
        check_tree(self.name, self.source, self.links, self.joints, self.base, self.tip)

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
                    screws.append(screw_of(T, joint, 1.0 if forward else -1.0))
                    rows.append((master, multiplier))
                if offset != 0.0:
                    T = T @ moved(joint, offset if forward else -offset)
            if not forward:
                T = T @ inverse(joint.T_parent_joint)
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
            limits=np.array([limits_of(joint) for joint in masters]).reshape(-1, 2),
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
        tips = sensible_tips(self.root, start, self._down)
        if len(tips) == 1:
            return tips[0]
        first = base if base is not None else (self.base if self.base is not None else self.root)
        shown = [f"{first} -> {tip} ({self._joint_count(first, tip)} joints)" for tip in tips[:12]]
        more = f", and {len(tips) - 12} more" if len(tips) > 12 else ""
        raise AmbiguousError(
            f"{self.source}: several chains fit in {self.name!r}; choose one with base= and tip=: {', '.join(shown)}{more}"
        )

    def _joint_count(self, base: str, tip: str) -> int:
        """Joints of the chain: those on the path, or the ones that they follow."""
        masters = (self._masters[step.joint.name] for step in self.path(base, tip) if step.joint.moves)
        return len({master for master, multiplier, _ in masters if multiplier != 0.0})

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
        links, joints = links_and_joints(chain)
        return cls(chain.name, links, joints, chain.name, base=chain.base, tip=chain.tip)
