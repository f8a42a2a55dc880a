"""Names of topics, services and nodes: how a short name becomes a full one, what is a name at all, and remapping.

The same rules hold for topics and for services.

References
----------
ROS 2 design, "Topic and Service name mapping to DDS" and "Static remapping of names"; what rcl and rmw check is what is
checked here (repeated underscores and names that begin with one are allowed: actions use ``_action``).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pieper.errors import RosError

if TYPE_CHECKING:
    from collections.abc import Iterable

LONGEST = 247
"""Characters of a full name: DDS allows 255, and the prefixes of ROS (``rq/``, ``Request``) need some."""

_SUBSTITUTION = re.compile(r"\{([^{}]*)\}")


@dataclass(frozen=True)
class Remap:
    """One rule ``from:=to``, or ``node:from:=to`` for one node alone.

    Attributes
    ----------
    source, target : str
        Names of topics or services, relative, private or absolute; or ``__node`` or ``__ns`` and the new name.
    node : str, optional
        The node that the rule is for; every node, if None.
    """

    source: str
    target: str
    node: str | None = None

    @classmethod
    def parse(cls, rule: str) -> Remap:
        """Read a rule from its text.

        Examples
        --------
        >>> Remap.parse("target:=/cell2/target")
        Remap(source='target', target='/cell2/target', node=None)
        >>> Remap.parse("inverse:__ns:=/cell2")
        Remap(source='__ns', target='/cell2', node='inverse')
        """
        left, separator, target = rule.partition(":=")
        kind, prefix, rest = left.partition("://")
        node, colon, source = (rest if prefix else left).rpartition(":")
        if not separator or not source or not target or (colon and not node):
            raise RosError(f"a remapping is written 'from:=to' or 'node:from:=to', got {rule!r}")
        if prefix:
            raise RosError(f"the remapping {rule!r} is for {kind}:// alone; leave that out: rules hold for all names")
        if colon:
            check_node(node)
        if source == "__name":
            source = "__node"
        if source == "__node":
            check_node(target)
        elif source == "__ns":
            check_namespace(target)
        elif source.startswith("__"):
            raise RosError(f"{source!r} cannot be remapped; names with two underscores are __node, __name and __ns")
        else:
            for side in (source, target):
                _expand(side, namespace="/", node="node")  # says what is wrong with it, if anything is
        return cls(source, target, node or None)


def resolve(name: str, *, namespace: str, node: str, remaps: Iterable[Remap] = ()) -> str:
    """Return the full name of a topic or service, after remapping.

    Parameters
    ----------
    name : str
        Relative (``"target"``), private (``"~/state"``) or absolute (``"/tf"``); ``{node}`` and ``{ns}`` (or
        ``{namespace}``) stand for those of the node.
    namespace : str
        Of the node: ``"/"`` or for example ``"/cell2"``.
    node : str
        Name of the node.
    remaps : iterable of Remap
        The first rule that fits the full name wins; its target is expanded like ``name``, and not remapped again.

    Raises
    ------
    RosError
        It is not a name; the message says why.

    Examples
    --------
    >>> resolve("target", namespace="/cell2", node="inverse")
    '/cell2/target'
    >>> resolve("~/state", namespace="/", node="inverse")
    '/inverse/state'
    >>> resolve("target", namespace="/cell2", node="inverse", remaps=[Remap.parse("target:=/goal")])
    '/goal'
    """
    full = _expand(name, namespace=namespace, node=node)
    for rule in remaps:
        if rule.source.startswith("__") or rule.node not in (None, node):
            continue
        if _expand(rule.source, namespace=namespace, node=node) == full:
            return _expand(rule.target, namespace=namespace, node=node)
    return full


def full_node_name(namespace: str, node: str) -> str:
    """Return ``"/cell2/inverse"`` for the namespace ``"/cell2"`` and the node ``"inverse"``."""
    return f"{namespace.rstrip('/')}/{node}"


def check_node(name: str) -> None:
    """Raise RosError unless this can be the name of a node: letters, digits and underscores, no digit first."""
    if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]{0,254}", name) is None:
        raise RosError(
            f"{name!r} is not the name of a node: "
            "letters, digits and underscores, beginning with no digit, at most 255 characters"
        )


def check_namespace(namespace: str) -> None:
    """Raise RosError unless this can be a namespace: ``"/"``, or an absolute name."""
    if namespace != "/":
        _check(namespace, namespace, "namespace")


def _expand(name: str, *, namespace: str, node: str) -> str:
    full = name
    if "{" in name or "}" in name:
        full = _SUBSTITUTION.sub(lambda match: _substitute(match[1], name, namespace, node), name)
    if full.startswith("~"):
        if full != "~" and full[1] != "/":
            raise RosError(f"{name!r} is not a name: after ~ comes a slash, as in '~/{full[1:]}'")
        full = full_node_name(namespace, node) + full[1:]
    elif not full.startswith("/"):
        full = f"{namespace.rstrip('/')}/{full}"
    _check(full, name, "name")
    return full


def _substitute(word: str, name: str, namespace: str, node: str) -> str:
    if word == "node":
        return node
    if word in ("ns", "namespace"):
        return namespace.rstrip("/")
    raise RosError(f"{name!r}: {{{word}}} stands for nothing; known are {{node}}, {{ns}} and {{namespace}}")


def _check(full: str, given: str, what: str) -> None:
    """Raise RosError for what rmw refuses; ``full`` is absolute unless a namespace was given without its slash."""
    problem = None
    odd = re.search(r"[^A-Za-z0-9_/]", full)
    if not given:
        problem = "it is empty"
    elif odd:
        problem = f"{odd[0]!r} is not allowed, only letters, digits, underscores and slashes"
    elif not full.startswith("/"):
        problem = f"it must begin with a slash, as in '/{full}'"
    elif full.endswith("/"):
        problem = "it ends with a slash"
    elif "//" in full:
        problem = "it has two slashes in a row"
    elif digit := re.search(r"/[0-9][^/]*", full):
        problem = f"{digit[0][1:]!r} begins with a digit"
    elif len(full) > LONGEST:
        problem = f"it has {len(full)} characters, and at most {LONGEST} are allowed"
    if problem:
        raise RosError(f"{given!r} is not a {what}: {problem}")
