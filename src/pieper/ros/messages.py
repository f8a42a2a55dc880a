"""ROS 2 interface types by name: build from fields, to and from CDR bytes, type hashes.

The types that rosbags ships are used as they are; the others (services, actions, MoveIt's and ros2_control's messages)
are read from the interface texts in ``interfaces/``, which have the folders and the syntax that rosidl knows. A service
``pkg/srv/Name`` gives the types ``pkg/srv/Name_Request`` and ``_Response``; an action gives its goal, result, feedback
and the requests and responses of its hidden services.

References
----------
ROS 2 interface definitions (docs.ros.org, "Interfaces"), REP-2011 and REP-2016 (type descriptions and their hashes),
OMG DDS-XTypes 1.3, 7.4.1 (plain CDR, version 1).
"""

from __future__ import annotations

import ast
import operator
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import MissingExtraError, RosError, unknown_name

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

_INTERFACES = (
    Path(__file__).parent / "interfaces",
    Path(__file__).parents[3] / "ros2",  # in a checkout pieper_interfaces lies beside the package that builds it
)
_NAME = re.compile(r"([a-z][a-z0-9_]*)/(msg|srv|action)/([A-Z][A-Za-z0-9]*(?:_[A-Z][A-Za-z]*)*)")
_PARTS = {"srv": ("Request", "Response"), "action": ("Goal", "Result", "Feedback")}
_DEFAULTS: dict[str, dict[str, Any]] = {  # those other than zero of the types that rosbags ships, which drops them
    "geometry_msgs/msg/Quaternion": {"w": 1.0},
    "sensor_msgs/msg/NavSatStatus": {"status": -2},
}
_LARGEST = 2**28  # bytes: nothing that a robot arm sends is as large


def make(type_name: str, message: Mapping[str, Any] | object | None = None, /, **fields: Any) -> Any:
    """Build a message of a type from its fields.

    Parameters
    ----------
    type_name : str
        For example ``"geometry_msgs/msg/Point"``, or ``"std_srvs/srv/SetBool_Request"``.
    message : mapping or message, optional
        Fields as a mapping, nested ones too; or a message of this very type, which is returned as it is.
    **fields
        Fields by name; they go before those of ``message``. What is not given is 0, empty, or the type's own default.

    Returns
    -------
    message
        An object with the fields as attributes.

    Raises
    ------
    RosError
        The type or a field is not known, or a value does not fit its field.

    Examples
    --------
    >>> make("geometry_msgs/msg/Pose", position={"x": 1.0}).orientation.w
    1.0
    >>> make("geometry_msgs/msg/Point", r=1.0)
    Traceback (most recent call last):
    ...
    pieper.errors.RosError: geometry_msgs/msg/Point has no field 'r'; its fields are: x, y, z
    """
    return _maker(type_name)(message, fields)


def encode(type_name: str, message: object, /) -> bytes:
    """Return a message as CDR bytes, with the four bytes of encapsulation before them.

    Examples
    --------
    >>> encode("std_msgs/msg/String", make("std_msgs/msg/String", data="Hi")).hex(" ")
    '00 01 00 00 03 00 00 00 48 69 00'
    """
    return bytes(_store_with(type_name).serialize_cdr(message, type_name))


def decode(type_name: str, data: bytes | memoryview, /) -> Any:
    """Read a message from CDR bytes.

    Raises
    ------
    RosError
        The bytes are not a message of this type: cut short, too long, or counts and strings that do not fit.
    """
    store = _store_with(type_name)
    if len(data) > _LARGEST:
        raise RosError(f"{type_name}: a message of {len(data)} bytes; at most {_LARGEST} are accepted")
    try:
        return store.deserialize_cdr(data, type_name)
    except Exception as error:  # whatever hostile bytes do to the decoder, this is what it means
        raise RosError(f"the bytes are not a {type_name}: {error}") from error


def cut(type_name: str, data: bytes, /) -> bytes:
    """Return the CDR bytes of a message without what a serialiser may have left behind them.

    Examples
    --------
    >>> data = encode("std_msgs/msg/String", make("std_msgs/msg/String", data="Hi"))
    >>> cut("std_msgs/msg/String", data + b"rubbish") == data
    True
    """
    store = _store_with(type_name)
    definition = store.get_msgdef(type_name)
    read = definition.deserialize_cdr_le if data[1] else definition.deserialize_cdr_be
    _, end = read(data[4:], 0, definition.cls, store)
    return data[: 4 + end]


def fields_of(type_name: str) -> tuple[str, ...]:
    """Return the names of the fields of a message type, in order."""
    return tuple(name for name, _ in _fielddefs(type_name))


def definition(type_name: str) -> list[tuple[str, Any]]:
    """Return the fields of a type with their types as rosbags describes them, for who describes them to somebody else.

    An empty type has the one field that rosidl gives it.
    """
    return list(_store_with(type_name).fielddefs[type_name][1])


def typestore(type_name: str) -> Any:
    """The ``rosbags`` store of types that this module works with; it has the named type, and all that this needs."""
    return _store_with(type_name)


def as_fields(message: Any) -> Any:
    """Return a message as plain mappings, lists and numbers.

    Examples
    --------
    >>> as_fields(make("geometry_msgs/msg/Point", x=1.0))
    {'x': 1.0, 'y': 0.0, 'z': 0.0}
    """
    if hasattr(message, "__dataclass_fields__"):
        return {
            name: as_fields(getattr(message, name))
            for name in message.__dataclass_fields__
            if name not in ("__msgtype__", _EMPTY)
        }
    if isinstance(message, list):
        return [as_fields(item) for item in message]
    return message.tolist() if isinstance(message, np.ndarray) else message


def type_hash(type_name: str) -> str:
    """Return the hash of a message or service type, ``RIHS01_...``, as rosidl gives it (REP-2016).

    Examples
    --------
    >>> type_hash("std_msgs/msg/String")
    'RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18'
    """
    package, kind, name = _split(type_name)
    if kind == "srv" and not name.endswith(("_Request", "_Response", "_Event")):
        _describe_service(f"{package}/srv/{name}")
    elif kind == "action" and name.endswith(("_SendGoal", "_GetResult")):
        _describe_service(f"{package}/action/{name}")
    else:
        _store_with(type_name)
    return str(_described().hash_rihs01(type_name))


# Types


_EMPTY = "structure_needs_at_least_one_member"


@cache
def _store() -> Any:
    """The types as they are encoded: ``char`` and ``byte`` of a .msg file are unsigned bytes."""
    return _new_store(char="uint8", byte="uint8")


@cache
def _described() -> Any:
    """The types as they are described for their hashes, where a ``byte`` differs from a ``uint8``."""
    return _new_store(char="uint8")


def _new_store(**names: str) -> Any:
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise MissingExtraError("rosbags", "ros", "ROS 2 messages") from error
    store = get_typestore(Stores.ROS2_JAZZY)
    store.fielddefs.update({name: _renamed(definition, names) for name, definition in store.fielddefs.items()})
    return store


def _renamed(definition: Any, names: Mapping[str, str]) -> Any:
    """A definition with other names for some basic types; rosbags takes char and byte for those of IDL and of C."""

    def rename(desc: Any) -> Any:
        if isinstance(desc, str):
            return names.get(desc, desc)
        return type(desc)(rename(part) for part in desc) if type(desc) is tuple else desc

    constants, fields = definition
    return constants, [(name, rename(desc)) for name, desc in fields]


def _split(type_name: str) -> tuple[str, str, str]:
    match = _NAME.fullmatch(type_name)
    if match is None:
        raise RosError(f"{type_name!r} is not the name of a type; expected one such as 'sensor_msgs/msg/JointState'")
    return match[1], match[2], match[3]


def _store_with(type_name: str) -> Any:
    """The store of types, in which the named one and all that it needs are present."""
    store = _store()
    if type_name not in store.fielddefs:
        package, kind, name = _split(type_name)
        _load(package, kind, name.partition("_")[0], type_name)
    return store


def _load(package: str, kind: str, stem: str, wanted: str) -> None:
    for folder in _INTERFACES:
        file = folder / package / kind / f"{stem}.{kind}"
        if file.is_file():
            _register(package, kind, stem, file.read_text(encoding="utf-8"))
            return
    known = sorted({*_store().fielddefs, *_known_files()})
    siblings = [name for name in known if name.startswith(f"{package}/")]
    if siblings:
        raise RosError(str(unknown_name("type", wanted, siblings)))
    packages = sorted({name.partition("/")[0] for name in known})
    raise RosError(f"no type {wanted!r}; {unknown_name('package', package, packages)}")


def _known_files() -> Iterator[str]:
    for folder in _INTERFACES:
        for kind in ("msg", "srv", "action"):
            for file in folder.glob(f"*/{kind}/*.{kind}"):
                yield f"{file.parts[-3]}/{kind}/{file.stem}"
                for part in _PARTS.get(kind, ()):
                    yield f"{file.parts[-3]}/{kind}/{file.stem}_{part}"


def _register(package: str, kind: str, stem: str, text: str) -> None:
    """Add the types of one interface file, and those that it refers to."""
    from rosbags.typesys import get_types_from_msg

    names = [f"{stem}_{part}" for part in _PARTS[kind]] if kind in _PARTS else [stem]
    definitions: dict[str, Any] = {}
    for name, part in zip(names, re.split(r"^---\s*$", text, flags=re.MULTILINE), strict=True):
        type_name = f"{package}/{kind}/{name}"
        ((constants, fields),) = get_types_from_msg(part, f"{package}/msg/{name}").values()
        definitions[type_name] = (constants, fields)
        _DEFAULTS[type_name] = _defaults(part)
    if kind == "action":
        definitions |= _hidden_types(f"{package}/action/{stem}")
    for constants_fields in definitions.values():
        for needed in _named(constants_fields[1]):
            if needed not in definitions:
                _store_with(needed)
    _described().fielddefs.update({name: _renamed(d, {"char": "uint8"}) for name, d in definitions.items()})
    _store().register({name: _renamed(d, {"char": "uint8", "byte": "uint8"}) for name, d in definitions.items()})


def _hidden_types(action: str) -> dict[str, Any]:
    """What rosidl makes of an action: design.ros2.org/articles/actions.html, "Introspection tools"."""
    from rosbags.interfaces import Nodetype

    def named(type_name: str) -> Any:
        return (Nodetype.NAME, type_name)

    def number(type_name: str) -> Any:
        return (Nodetype.BASE, (type_name, 0))

    goal_id = ("goal_id", named("unique_identifier_msgs/msg/UUID"))
    return {
        f"{action}_SendGoal_Request": ([], [goal_id, ("goal", named(f"{action}_Goal"))]),
        f"{action}_SendGoal_Response": (
            [],
            [("accepted", number("bool")), ("stamp", named("builtin_interfaces/msg/Time"))],
        ),
        f"{action}_GetResult_Request": ([], [goal_id]),
        f"{action}_GetResult_Response": ([], [("status", number("int8")), ("result", named(f"{action}_Result"))]),
        f"{action}_FeedbackMessage": ([], [goal_id, ("feedback", named(f"{action}_Feedback"))]),
    }


def _named(fields: Any) -> Iterator[str]:
    """Types that these fields refer to."""
    from rosbags.interfaces import Nodetype

    for _, (node, rest) in fields:
        if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            yield from _named([("", rest[0])])
        elif node == Nodetype.NAME:
            yield rest


def _defaults(text: str) -> dict[str, Any]:
    """Default values of the fields of one interface text: a third word that is not a constant's ``=``."""
    found = {}
    for line in text.splitlines():
        words = line.partition("#")[0].split(None, 2)
        if len(words) == 3 and "=" not in words[1] and not words[2].startswith("="):
            found[words[1]] = ast.literal_eval({"true": "True", "false": "False"}.get(words[2], words[2]))
    return found


@cache
def _describe_service(type_name: str) -> None:
    """Describe a service as rosidl does for its hash: a structure of request, response and event."""
    from rosbags.interfaces import Nodetype

    request, response, event = (f"{type_name}_{part}" for part in ("Request", "Response", "Event"))
    _store_with(request)
    fielddefs = _described().fielddefs
    fielddefs[event] = (
        [],
        [
            ("info", (Nodetype.NAME, "service_msgs/msg/ServiceEventInfo")),
            ("request", (Nodetype.SEQUENCE, ((Nodetype.NAME, request), 1))),
            ("response", (Nodetype.SEQUENCE, ((Nodetype.NAME, response), 1))),
        ],
    )
    parts = {"request_message": request, "response_message": response, "event_message": event}
    fielddefs[type_name] = ([], [(name, (Nodetype.NAME, part)) for name, part in parts.items()])


def _fielddefs(type_name: str) -> list[tuple[str, Any]]:
    return [field for field in _store_with(type_name).fielddefs[type_name][1] if field[0] != _EMPTY]


# Values


@cache
def _maker(type_name: str) -> Callable[[Any, dict[str, Any]], Any]:
    """What builds messages of this type; made once for each type."""
    build = _store_with(type_name).types[type_name]
    converters = {name: _converter(desc, f"{type_name}.{name}") for name, desc in _fielddefs(type_name)}
    defaults = {name: _DEFAULTS.get(type_name, {}).get(name, _ABSENT) for name in converters}
    recipe = []  # of each field: its name, what converts a value, and the default where all messages can share it
    for name, convert in converters.items():
        default = convert(defaults[name])
        if isinstance(default, np.ndarray):
            default.setflags(write=False)
        elif not isinstance(default, bool | int | float | str):
            default = _ABSENT
        recipe.append((name, convert, default))
    padding = (0,) if _EMPTY in dict(_store().fielddefs[type_name][1]) else ()

    def make(message: Any, fields: Any) -> Any:
        if message is not None:
            if not fields and getattr(message, "__msgtype__", None) == type_name:
                return message
            given = message if hasattr(message, "keys") else _attributes(message, converters, type_name)
            fields = {**given, **fields} if fields else given
        used = 0
        values: list[Any] = []
        for name, convert, default in recipe:
            if name in fields:
                used += 1
                values.append(convert(fields[name]))
            else:
                values.append(convert(_ABSENT) if default is _ABSENT else default)
        if used != len(fields):
            odd = next(name for name in fields if name not in converters)
            raise RosError(f"{type_name} has no field {odd!r}; its fields are: {', '.join(converters) or 'none'}")
        return build(*values, *padding)

    return make


_ABSENT = object()


def _attributes(message: Any, names: Mapping[str, Any], type_name: str) -> dict[str, Any]:
    """The fields of a message of another library, for example one of rclpy's."""
    try:
        return {name: getattr(message, name) for name in names}
    except AttributeError:
        raise RosError(
            f"{type_name} is made from a mapping of fields or from such a message, not from {message!r:.80}"
        ) from None


def _converter(desc: Any, where: str) -> Callable[[Any], Any]:
    """What turns a value, or ``_ABSENT``, into what the encoder wants for this field."""
    from rosbags.interfaces import Nodetype

    node, rest = desc
    if node == Nodetype.NAME:
        maker = _maker(rest)
        return lambda value: maker(None if value is _ABSENT else value, {})
    if node == Nodetype.BASE:
        name, limit = rest
        return _scalar(name, limit, where)
    (inner, inner_rest), count = rest
    fixed = count if node == Nodetype.ARRAY else None
    bound = count if node == Nodetype.SEQUENCE and count else None
    if inner == Nodetype.BASE and inner_rest[0] != "string":
        return _numbers(inner_rest[0], fixed, bound, where)
    return _list(_converter((inner, inner_rest), where), fixed, bound, where)


def _scalar(name: str, limit: int, where: str) -> Callable[[Any], Any]:
    if name == "string":

        def convert(value: Any) -> Any:
            if value is _ABSENT:
                return ""
            if not _is_text(value, limit):
                kind = f"text of at most {limit} bytes" if limit else "text without zero characters and surrogates"
                raise RosError(f"{where} must be {kind}, got {value!r:.80}")
            return value

    elif name == "bool":

        def convert(value: Any) -> Any:
            if value is _ABSENT:
                return False
            if not isinstance(value, bool | np.bool_):
                raise RosError(f"{where} must be True or False, got {value!r:.80}")
            return bool(value)

    elif name.startswith("float"):

        def convert(value: Any) -> Any:
            if value is _ABSENT:
                return 0.0
            if isinstance(value, float):
                return value
            try:
                return operator.index(value) / 1 if not isinstance(value, np.floating) else float(value)
            except TypeError:
                raise RosError(f"{where} must be a number, got {value!r:.80}") from None

    else:
        span = np.iinfo(name)

        def convert(value: Any) -> Any:
            if value is _ABSENT:
                return 0
            try:
                number = operator.index(value)
            except TypeError:
                number = None
            if number is None or not span.min <= number <= span.max:
                raise RosError(f"{where} must be an integer from {span.min} to {span.max}, got {value!r:.80}")
            return number

    return convert


def _is_text(value: Any, limit: int) -> bool:
    """Whether this is text that a message can carry: UTF-8, ended by a zero."""
    if not isinstance(value, str) or "\0" in value:
        return False
    if value.isascii():
        return not limit or len(value) <= limit
    try:
        size = len(value.encode())
    except UnicodeEncodeError:
        return False
    return not limit or size <= limit


def _numbers(name: str, fixed: int | None, bound: int | None, where: str) -> Callable[[Any], Any]:
    dtype = np.dtype(name)

    def convert(value: Any) -> Any:
        if value is _ABSENT:
            return np.zeros(fixed or 0, dtype)
        if isinstance(value, bytes | bytearray | memoryview) and dtype == np.uint8:
            value = np.frombuffer(value, np.uint8)
        array = _as_dtype(value, dtype)
        if array is None or array.ndim != 1:
            raise RosError(f"{where} must be a sequence of {name}, got {value!r:.80}")
        return _counted(array, fixed, bound, where)

    return convert


def _as_dtype(value: Any, dtype: np.dtype[Any]) -> Any:
    """The values as an array of this type; None where some would have to change."""
    try:
        given = np.asarray(value)
    except (TypeError, ValueError):
        return None
    if given.size == 0 or given.dtype == dtype:
        return given.astype(dtype)
    if dtype.kind == "f":
        return given.astype(dtype) if given.dtype.kind in "iuf" else None
    if given.dtype.kind != dtype.kind and not (given.dtype.kind in "iu" and dtype.kind in "iu"):
        return None
    array = given.astype(dtype)
    return array if np.array_equal(array, given) else None


def _list(convert_item: Callable[[Any], Any], fixed: int | None, bound: int | None, where: str) -> Callable[[Any], Any]:
    def convert(value: Any) -> Any:
        if value is _ABSENT:
            return [convert_item(_ABSENT) for _ in range(fixed or 0)]
        if isinstance(value, str | bytes) or hasattr(value, "keys") or not hasattr(value, "__iter__"):
            raise RosError(f"{where} must be a list, got {value!r:.80}")
        return _counted([convert_item(item) for item in value], fixed, bound, where)

    return convert


def _counted(items: Any, fixed: int | None, bound: int | None, where: str) -> Any:
    if (fixed is not None and len(items) != fixed) or (bound is not None and len(items) > bound):
        wanted = f"exactly {fixed}" if fixed is not None else f"at most {bound}"
        raise RosError(f"{where} holds {wanted} values, got {len(items)}")
    return items
