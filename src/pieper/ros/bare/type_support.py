"""What Cyclone DDS has to know of a message type: its name, and a description that other participants compare.

Samples go in and out as bytes that are serialised already: the Python types of cyclonedds are far slower than rosbags
(a 640x480 image: 52 against 1.3 ms), and the bytes are the same.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from cyclonedds.idl import make_idl_struct
from cyclonedds.idl import types as idl_types
from rosbags.interfaces import Nodetype

from pieper.ros import messages

types: Any = idl_types  # its types of containers are made in a way that type checkers cannot follow

_BASE: dict[str, Any] = {
    "bool": bool,
    "byte": types.byte,
    "octet": types.byte,
    "char": types.uint8,
    **{f"{kind}{bits}": getattr(types, f"{kind}{bits}") for kind in ("int", "uint") for bits in (8, 16, 32, 64)},
    **{f"float{bits}": getattr(types, f"float{bits}") for bits in (32, 64)},
}

_HEADER = {"guid": types.uint64, "sequence_number": types.int64}
"""What rmw_cyclonedds puts before the fields of a request or a response."""


def dds_type_name(type_name: str) -> str:
    """Return the name of a ROS type on the wire.

    Examples
    --------
    >>> dds_type_name("sensor_msgs/msg/JointState")
    'sensor_msgs::msg::dds_::JointState_'
    """
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


@cache
def describe(type_name: str, *, with_header: bool = False) -> Any:
    """Return the class that describes a ROS type to cyclonedds; always the same one for the same type.

    Parameters
    ----------
    type_name : str
        For example ``"sensor_msgs/msg/JointState"`` or ``"std_srvs/srv/SetBool_Request"``.
    with_header : bool
        Put the identity of a request before its fields, for requests and responses.

    Raises
    ------
    RosError
        The type is not known.
    """
    fields = {name: _field_type(kind) for name, kind in messages.definition(type_name)}
    header = _HEADER if with_header else {}
    name = type_name.rpartition("/")[2]
    return make_idl_struct(name, dds_type_name(type_name), {**header, **fields}, dataclassify=False)


def _field_type(kind: Any) -> Any:
    node, rest = kind
    if node == Nodetype.NAME:
        return describe(rest)
    if node == Nodetype.BASE:
        name, limit = rest
        if name == "string":
            return types.bounded_str[limit] if limit else str
        return _BASE[name]
    inner, count = _field_type(rest[0]), rest[1]
    if node == Nodetype.ARRAY:
        return types.array[inner, count]
    return types.sequence[inner, count] if count else types.sequence[inner]
