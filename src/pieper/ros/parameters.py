"""Parameters of a node: declared with a type and a check, set from the command line, a file, or by other nodes.

The six services that make ``ros2 param list``, ``get``, ``set``, ``describe`` and ``dump`` work are the ones rclpy
offers, under ``~/``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

import numpy as np

from pieper.errors import RosError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

Value = TypeVar("Value")

# rcl_interfaces/msg/ParameterType, and the field of ParameterValue that holds such a value
_KINDS: dict[str, tuple[int, str]] = {
    "not set": (0, ""),
    "bool": (1, "bool_value"),
    "int": (2, "integer_value"),
    "float": (3, "double_value"),
    "str": (4, "string_value"),
    "list of bool": (6, "bool_array_value"),
    "list of int": (7, "integer_array_value"),
    "list of float": (8, "double_array_value"),
    "list of str": (9, "string_array_value"),
}
_FIELDS = {number: fieldname for number, fieldname in _KINDS.values() if fieldname} | {5: "byte_array_value"}


def kind_of(value: Any) -> str:
    """Return the kind of a parameter value, such as ``"float"`` or ``"list of str"``.

    Raises
    ------
    RosError
        No parameter can hold it.

    Examples
    --------
    >>> kind_of([1.0, 2.0])
    'list of float'
    """
    for kind in (bool, int, float, str):
        if isinstance(value, kind):
            return kind.__name__
    if isinstance(value, list | tuple) and value:
        kinds = {kind_of(item) for item in value}
        if kinds == {"int", "float"}:
            return "list of float"
        if len(kinds) == 1 and (name := f"list of {kinds.pop()}") in _KINDS:
            return name
    raise RosError(f"a parameter is a bool, int, float, str or a list of one of them (not empty), got {value!r:.80}")


def as_value(value: Any) -> dict[str, Any]:
    """Return a value as the fields of ``rcl_interfaces/msg/ParameterValue``; of nothing if it is None."""
    if value is None:
        return {"type": 0}
    number, name = _KINDS[kind_of(value)]
    return {"type": number, name: value}


def from_value(message: Any) -> Any:
    """Read a ``rcl_interfaces/msg/ParameterValue``; None if it is not set."""
    name = _FIELDS.get(int(message.type))
    if name is None:
        return None
    value = getattr(message, name)
    return list(value) if isinstance(value, list) else np.asarray(value).tolist()


@dataclass
class Parameter(Generic[Value]):
    """A declared parameter and what may become of it."""

    name: str
    kind: str
    description: str
    read_only: bool
    check: Callable[[Any], None] | None
    current: Any = None

    @property
    def value(self) -> Value:
        """The value now."""
        return cast("Value", self.current)

    def convert(self, value: Any) -> Any:
        """Return the value as the type of this parameter.

        Raises
        ------
        ValueError
            It has another type, or the parameter's own check refuses it; the message is the reason.
        """
        try:
            kind = kind_of(value)
        except RosError as error:
            if not (isinstance(value, list) and not value and self.kind.startswith("list")):
                raise ValueError(str(error)) from None
            kind = self.kind
        if (kind, self.kind) in (("int", "float"), ("list of int", "list of float")):
            value = [float(item) for item in value] if isinstance(value, list | tuple) else float(value)
        elif kind != self.kind:
            raise ValueError(f"parameter {self.name!r} is of type {self.kind}, got {value!r:.80} ({kind})")
        if self.check is not None:
            self.check(value)
        return value

    def descriptor(self) -> dict[str, Any]:
        """Return the fields of ``rcl_interfaces/msg/ParameterDescriptor``."""
        return {
            "name": self.name,
            "type": _KINDS[self.kind][0],
            "description": self.description,
            "read_only": self.read_only,
        }


@dataclass
class Parameters:
    """All parameters of one node.

    Attributes
    ----------
    given : mapping
        Values from the command line and from files, by name; they win over the defaults.
    """

    given: Mapping[str, Any] = field(default_factory=dict)
    declared: dict[str, Parameter[Any]] = field(default_factory=dict)
    on_change: Callable[[list[Parameter[Any]]], None] | None = None

    def declare(
        self, name: str, default: Any, *, description: str, check: Callable[[Any], None] | None, read_only: bool
    ) -> Parameter[Any]:
        """Declare a parameter; see :meth:`pieper.ros.bus.Bus.parameter`."""
        if name in self.declared:
            raise RosError(f"parameter {name!r} is declared twice")
        parameter: Parameter[Any] = Parameter(name, kind_of(default), description, read_only, check)
        try:
            parameter.current = parameter.convert(self.given.get(name, default))
        except ValueError as error:
            raise RosError(str(error) if repr(name) in str(error) else f"parameter {name!r}: {error}") from None
        self.declared[name] = parameter
        return parameter

    def set(self, values: Iterable[tuple[str, Any]]) -> str:
        """Set all of these or none of them; return the reason where none is set, nothing otherwise."""
        accepted: list[tuple[Parameter[Any], Any]] = []
        for name, value in values:
            parameter = self.declared.get(name)
            if parameter is None:
                return f"no parameter {name!r}; parameters are: {', '.join(sorted(self.declared))}"
            if parameter.read_only:
                return f"parameter {name!r} is read-only; give it when the node starts: --ros-args -p {name}:=..."
            if value is None:
                return f"parameter {name!r} cannot be deleted"
            try:
                accepted.append((parameter, parameter.convert(value)))
            except ValueError as error:
                return str(error)
        for parameter, value in accepted:
            parameter.current = value
        if accepted and self.on_change is not None:
            self.on_change([parameter for parameter, _ in accepted])
        return ""

    def services(self) -> Iterator[tuple[str, str, Callable[[Any], dict[str, Any]]]]:
        """The services that offer these parameters to other nodes: name, type, and what answers a request."""
        for service, answer in {
            "DescribeParameters": self._describe,
            "GetParameters": self._get,
            "GetParameterTypes": self._get_types,
            "ListParameters": self._list,
            "SetParameters": self._set_each,
            "SetParametersAtomically": self._set_all,
        }.items():
            name = "".join(f"_{c.lower()}" if c.isupper() else c for c in service).lstrip("_")
            yield f"~/{name}", f"rcl_interfaces/srv/{service}", answer

    def _value(self, name: str) -> Any:
        return self.declared[name].current if name in self.declared else None

    def _describe(self, request: Any) -> dict[str, Any]:
        return {
            "descriptors": [self.declared[n].descriptor() if n in self.declared else {"name": n} for n in request.names]
        }

    def _get(self, request: Any) -> dict[str, Any]:
        return {"values": [as_value(self._value(name)) for name in request.names]}

    def _get_types(self, request: Any) -> dict[str, Any]:
        return {"types": [as_value(self._value(name))["type"] for name in request.names]}

    def _list(self, request: Any) -> dict[str, Any]:
        return {"result": _listed(self.declared, list(request.prefixes), int(request.depth))}

    def _set_each(self, request: Any) -> dict[str, Any]:
        return {"results": [_result(self.set([pair])) for pair in _pairs(request)]}

    def _set_all(self, request: Any) -> dict[str, Any]:
        return {"result": _result(self.set(_pairs(request)))}


def _pairs(request: Any) -> list[tuple[str, Any]]:
    return [(item.name, from_value(item.value)) for item in request.parameters]


def _result(reason: str) -> dict[str, Any]:
    return {"successful": not reason, "reason": reason}


def _listed(names: Iterable[str], prefixes: list[str], depth: int) -> dict[str, list[str]]:
    """Names below any of the prefixes, at most ``depth`` dots deep (0: any depth), and the prefixes that they have."""
    found = []
    for name in sorted(names):
        for prefix in prefixes or [""]:
            below = name.removeprefix(f"{prefix}.") if prefix else name
            if (not prefix or name == prefix or below != name) and (depth == 0 or below.count(".") < depth):
                found.append(name)
                break
    heads = sorted({name.rpartition(".")[0] for name in found if "." in name})
    return {"names": found, "prefixes": heads}
