"""What a ROS 2 node reads from its command line: everything between ``--ros-args`` and ``--``.

References
----------
ROS 2 documentation, "Passing ROS arguments to nodes via the command-line"; rcl, ``rcl_parse_arguments`` and the parser of
parameter files. Values are read as rcl reads them, so ``1e-9`` is a number and ``12:30`` is text.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from pieper.errors import MissingExtraError, RosError
from pieper.ros.names import Remap, full_node_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

LEVELS = ("debug", "info", "warn", "error", "fatal")

_WITH_VALUE = {
    "-r": "remap",
    "--remap": "remap",
    "-p": "param",
    "--param": "param",
    "--params-file": "file",
    "--log-level": "level",
    "-e": "ignored",
    "--enclave": "ignored",
    "--log-config-file": "ignored",
    "--log-file-name": "ignored",
}
_SWITCHES = {
    f"--{verb}-{what}-{noun}"
    for verb in ("enable", "disable")
    for what, noun in (("rosout", "logs"), ("stdout", "logs"), ("external-lib", "logs"))
}


@dataclass(frozen=True)
class Arguments:
    """The ROS arguments of one node.

    Attributes
    ----------
    node, namespace : str, optional
        New name and namespace; None where the command line says nothing.
    remaps : tuple of Remap
        Rules in their order.
    parameters : dict
        Values by name, as ``-p`` and ``--params-file`` gave them; the later ones went before the earlier ones.
    log_level : str, optional
        debug, info, warn, error or fatal.
    rest : list of str
        What was not between ``--ros-args`` and ``--``.
    """

    node: str | None = None
    namespace: str | None = None
    remaps: tuple[Remap, ...] = ()
    parameters: dict[str, Any] = field(default_factory=dict)
    log_level: str | None = None
    rest: list[str] = field(default_factory=list)


def parse(argv: Sequence[str], *, node_name: str, namespace: str = "/") -> Arguments:
    """Read the ROS arguments of a command line.

    Parameters
    ----------
    argv : sequence of str
        Without the name of the program.
    node_name, namespace : str
        Of the node, unless the arguments say otherwise: rules, parameters and files may be for some nodes only.

    Raises
    ------
    RosError
        An argument is unknown or not well written, a file of parameters cannot be read or is not one.

    Examples
    --------
    >>> a = parse("mh12 --ros-args -r __ns:=/cell2 -p rate:=50.0 -r target:=goal".split(), node_name="inverse")
    >>> a.namespace, a.parameters, a.rest
    ('/cell2', {'rate': 50.0}, ['mh12'])
    """
    options, rest = _split(argv)
    rules = [Remap.parse(value) for kind, value in options if kind == "remap"]
    node, space = (_first(rules, name, node_name) for name in ("__node", "__ns"))
    full = full_node_name(space or namespace, node or node_name)
    parameters: dict[str, Any] = {}
    level = None
    for kind, value in options:
        if kind == "param":
            for_node, name, given = _assignment(value)
            if matches(for_node, full):
                parameters[name] = given
        elif kind == "file":
            parameters |= read_parameters(value, full)
        elif kind == "level":
            logger, _, word = value.rpartition(":=")
            if word.lower() not in LEVELS:
                raise RosError(f"--log-level takes one of {', '.join(LEVELS)}, got {value!r}")
            if logger in ("", node or node_name, full.strip("/").replace("/", ".")):
                level = word.lower()
    return Arguments(node, space, tuple(rules), parameters, level, rest)


def read_parameters(file: str | Path, node: str) -> dict[str, Any]:
    """Return the parameters that a YAML file has for a node.

    Parameters
    ----------
    file : path
        ``/cell2/inverse: {ros__parameters: {rate: 50.0}}``; a name may hold ``*`` (one part) and ``**`` (any number of
        parts), and nested names are joined by dots.
    node : str
        Full name of the node, ``"/cell2/inverse"``.

    Raises
    ------
    RosError
        The file cannot be read, is not YAML, or not a file of parameters.
    """
    try:
        text = Path(file).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RosError(f"cannot read the parameters file {str(file)!r}: {error}") from error
    content = read_yaml(text, f"the parameters file {str(file)!r}")
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise RosError(f"{file}: expected names of nodes with 'ros__parameters' under each, got {content!r:.80}")
    found: dict[str, Any] = {}
    for name, values in _nodes(content, "", str(file)):
        if matches(name, node):
            found |= dict(_flat(values, "", f"{file}: {name}"))
    return found


def matches(pattern: str, node: str) -> bool:
    """Whether a name of a node, perhaps with ``*`` and ``**``, is that of this node.

    Examples
    --------
    >>> matches("/**", "/cell2/inverse"), matches("/*/inverse", "/cell2/inverse"), matches("inverse", "/cell2/inverse")
    (True, True, False)
    """
    parts = re.split(r"(/\*\*|/\*)", "/" + pattern.lstrip("/"))
    rule = "".join({"/**": r"(/\w+)*", "/*": r"/\w+"}.get(part, re.escape(part)) for part in parts)
    return re.fullmatch(rule, node) is not None


def read_value(text: str, where: str = "the value") -> Any:
    """Read one value as rcl does: bool, int, float, text, or a list of one of them.

    Examples
    --------
    >>> read_value("1e-9"), read_value("on"), read_value("[1, 2.5]"), read_value("12:30")
    (1e-09, True, [1.0, 2.5], '12:30')
    """
    return _checked(read_yaml(text, where), where) if text.strip() else ""


def _split(argv: Sequence[str]) -> tuple[list[tuple[str, str]], list[str]]:
    options: list[tuple[str, str]] = []
    rest: list[str] = []
    unknown: list[str] = []
    inside = False
    words = iter(argv)
    for word in words:
        if word == "--ros-args":
            inside = True
        elif not inside:
            rest.append(word)
        elif word == "--":
            inside = False
        elif word in _WITH_VALUE:
            value = next(words, None)
            if value is None or value in ("--", "--ros-args"):
                raise RosError(f"{word} needs a value behind it")
            options.append((_WITH_VALUE[word], value))
        elif word not in _SWITCHES:
            unknown.append(word)
    if unknown:
        raise RosError(
            f"unknown ROS arguments: {' '.join(unknown)}; known are {', '.join([*_WITH_VALUE, *sorted(_SWITCHES)])}; "
            "arguments that are not for ROS come before --ros-args or behind --"
        )
    return options, rest


def _first(rules: Iterable[Remap], source: str, node: str) -> str | None:
    return next((rule.target for rule in rules if rule.source == source and rule.node in (None, node)), None)


def _assignment(text: str) -> tuple[str, str, Any]:
    left, separator, value = text.partition(":=")
    node, colon, name = left.rpartition(":")
    if not separator or not name or (colon and not node):
        raise RosError(f"a parameter is written 'name:=value' or 'node:name:=value', got {text!r}")
    return node if colon else "/**", name, read_value(value, f"parameter {name!r}")


def _nodes(content: dict[Any, Any], above: str, file: str) -> Iterator[tuple[str, dict[Any, Any]]]:
    for key, values in content.items():
        if key == "ros__parameters":
            if not above:
                raise RosError(f"{file}: 'ros__parameters' must stand under the name of a node, or under '/**'")
            if values is not None and not isinstance(values, dict):
                raise RosError(f"{file}: {above}: 'ros__parameters' must hold names and values, got {values!r:.80}")
            yield above, values or {}
        elif isinstance(values, dict):
            yield from _nodes(values, f"{above}/{str(key).strip('/')}", file)
        else:
            raise RosError(f"{file}: {above}/{key}: expected 'ros__parameters' under the name of a node")


def _flat(values: dict[Any, Any], above: str, where: str) -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        name = f"{above}{key}"
        if isinstance(value, dict):
            yield from _flat(value, f"{name}.", where)
        else:
            yield name, _checked(value, f"{where}: parameter {name!r}")


def _checked(value: Any, where: str) -> Any:
    if isinstance(value, list):
        kinds = {type(item) for item in value}
        if kinds == {int, float}:
            return [float(item) for item in value]
        if len(kinds) > 1 or not kinds <= {bool, int, float, str}:
            raise RosError(f"{where} must be a list of values of one type, got {value!r:.80}")
    elif not isinstance(value, bool | int | float | str):
        raise RosError(f"{where} must be a boolean, a number, text, or a list of one of them, got {value!r:.80}")
    return value


def read_yaml(text: str, where: str) -> Any:
    """Read YAML with scalars as rcl knows them.

    Raises
    ------
    RosError
        It is not YAML; ``where`` says what is not.
    """
    loader = _loader()
    try:
        from yaml import YAMLError, load

        return load(text, loader)
    except (YAMLError, ValueError, RecursionError) as error:
        raise RosError(f"{where} is not YAML: {' '.join(str(error).split())}") from error


@cache
def _loader() -> type:
    """Make a safe loader of YAML with the scalars that rcl knows, in place of those of YAML 1.1."""
    try:
        import yaml
    except ImportError as error:
        raise MissingExtraError("pyyaml", "ros", "reading parameters") from error

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        yaml_implicit_resolvers: ClassVar[dict[str, list[Any]]] = {}
        bool_values: ClassVar[dict[str, bool]] = {**yaml.SafeLoader.bool_values, "y": True, "n": False}

        def integer(self, node: Any) -> int:
            word = self.construct_scalar(node)
            base = 16 if "x" in word.lower() else 8 if re.fullmatch(r"[-+]?0[0-7]+", word) else 10
            return int(word, base)

    Loader.add_constructor("tag:yaml.org,2002:int", Loader.integer)
    for kind, pattern in _SCALARS.items():
        Loader.add_implicit_resolver(f"tag:yaml.org,2002:{kind}", re.compile(pattern), None)
    return Loader


_SCALARS = {
    "bool": r"^(?:[yYnN]|yes|Yes|YES|no|No|NO|true|True|TRUE|false|False|FALSE|on|On|ON|off|Off|OFF)$",
    "int": r"^[-+]?(?:[0-9]+|0[xX][0-9a-fA-F]+)$",
    "float": r"^[-+]?(?:(?:[0-9]+\.[0-9]*|\.[0-9]+|[0-9]+(?=[eE]))(?:[eE][-+]?[0-9]+)?|\.(?:inf|Inf|INF))$|^\.(?:nan|NaN|NAN)$",
    "null": r"^(?:~|null|Null|NULL|)$",
    "merge": r"^<<$",
}
