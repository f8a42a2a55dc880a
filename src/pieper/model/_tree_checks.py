"""What is refused in a description: all that is not one tree of well-formed joints."""

from __future__ import annotations

from difflib import get_close_matches
from math import inf, isnan
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import DescriptionError
from pieper.model._arrays import pose_fault
from pieper.model.joint import JOINT_TYPES, MAX_NAME

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from pieper.model.joint import Joint, Link


def check_tree(
    name: str, source: str, links: Sequence[Link], joints: Sequence[Joint], base: str | None, tip: str | None
) -> None:
    """Refuse what is not one tree of well-formed joints; see `pieper.model.description.Description` for the list of faults."""

    def fault(element: str, reason: str) -> DescriptionError:
        return DescriptionError(source, element, reason)

    if not links:
        raise fault(f"robot {name!r}", "has no links; a description needs at least one")
    known = _unique_names(source, "link", (link.name for link in links))
    places = _unique_names(source, "joint", (joint.name for joint in joints))
    above = _joint_above_each(source, joints, known)
    roots = [link for link in known if link not in above]
    if not roots:
        raise fault(f"joint {joints[0].name!r}", "the joints form a cycle; a tree with one root is needed")
    if len(roots) > 1:
        raise fault(f"robot {name!r}", f"has {len(roots)} roots ({_listed(roots)}); connect them to one tree")
    cyclic = _out_of_reach(roots[0], known, joints)
    if cyclic is not None:
        raise fault(f"joint {above[cyclic].name!r}", f"link {cyclic!r} is part of a cycle; a tree is needed")
    _check_mimics(source, joints, places)
    for role, end in (("base", base), ("tip", tip)):
        if end is not None and end not in known:
            raise fault(role, f"{end!r} is not a link of the description; {_near(end, known)}")


def _joint_above_each(source: str, joints: Sequence[Joint], links: dict[str, int]) -> dict[str, Joint]:
    """The joint whose child is each link; every joint is checked on the way."""
    above: dict[str, Joint] = {}
    for joint in joints:

        def fault(reason: str, joint: Joint = joint) -> DescriptionError:
            return DescriptionError(source, f"joint {joint.name!r}", reason)

        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                raise fault(f"{role} {link!r} is not a link of the description; {_near(link, links)}")
        if joint.parent == joint.child:
            raise fault(f"parent and child are the same link {joint.child!r}: a cycle; a tree is needed")
        if joint.child in above:
            other = above[joint.child].name
            raise fault(f"link {joint.child!r} is already the child of joint {other!r}; a link has one parent")
        above[joint.child] = joint
        _check_joint(source, joint)
    return above


def _out_of_reach(root: str, links: Iterable[str], joints: Sequence[Joint]) -> str | None:
    """The first link that no way leads to from the root."""
    below: dict[str, list[str]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint.child)
    reached, stack = {root}, [root]
    while stack:
        children = below.get(stack.pop(), [])
        reached.update(children)
        stack.extend(children)
    return next((link for link in links if link not in reached), None)


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
    no_pose = pose_fault(T)
    if no_pose is not None:
        raise fault(f"the origin {no_pose}")
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


def first_of(texts: Sequence[str], most: int) -> str:
    """The first of some texts in a row, and how many more there are."""
    return ", ".join(texts[:most]) + (f" and {len(texts) - most} more" if len(texts) > most else "")


def _listed(names: Sequence[str]) -> str:
    return first_of([repr(name if len(name) <= 80 else name[:77] + "...") for name in names], 8)
