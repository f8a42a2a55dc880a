"""Functions of the C library of Cyclone DDS that its Python package calls slowly, or with the interpreter locked.

Calls through ctypes let other threads run meanwhile, so a write that has to wait, or a wait, stops nobody else.
"""

from __future__ import annotations

import ctypes as c
from typing import TYPE_CHECKING, Any

from cyclonedds.core import DDSException
from cyclonedds.internal import DDS, dds_c_t

from pieper.errors import RosError

if TYPE_CHECKING:
    from cyclonedds.core import Entity

TIMEOUT = DDSException.DDS_RETCODE_TIMEOUT
BAD_PARAMETER = DDSException.DDS_RETCODE_BAD_PARAMETER

_library = c.CDLL(DDS._dll_handle._name)  # our own handle, so that argument types set here are ours


class Sample(c.Structure):
    """Serialised bytes, as the Python types of cyclonedds hand them to C."""

    _fields_ = (("data", c.c_char_p), ("size", c.c_size_t))


class _Endpoint(c.Structure):
    """``dds_builtintopic_endpoint_t``."""

    _fields_ = (
        ("key", c.c_uint8 * 16),
        ("participant_key", c.c_uint8 * 16),
        ("participant_handle", c.c_uint64),
        ("topic_name", c.c_char_p),
        ("type_name", c.c_char_p),
        ("qos", c.c_void_p),
    )


def _function(name: str, *arguments: Any, result: Any = c.c_int32) -> Any:
    function = _library[name]
    function.argtypes, function.restype = arguments, result
    return function


_entity, _duration = c.c_int32, c.c_int64
write = _function("dds_write", _entity, c.POINTER(Sample))
waitset_attach = _function("dds_waitset_attach", _entity, _entity, c.c_ssize_t)
waitset_detach = _function("dds_waitset_detach", _entity, _entity)
waitset_wait = _function("dds_waitset_wait", _entity, c.POINTER(c.c_ssize_t), c.c_size_t, _duration)
set_guard = _function("dds_set_guardcondition", _entity, c.c_bool)
take_guard = _function("dds_take_guardcondition", _entity, c.POINTER(c.c_bool))
_readers = _function("dds_get_publication_matched_status", _entity, c.POINTER(dds_c_t.publication_matched_status))
_writers = _function("dds_get_subscription_matched_status", _entity, c.POINTER(dds_c_t.subscription_matched_status))

_acknowledged = _function("dds_wait_for_acks", _entity, _duration)
_refused_readers = _function(
    "dds_get_offered_incompatible_qos_status", _entity, c.POINTER(dds_c_t.offered_incompatible_qos_status)
)
_refused_writers = _function(
    "dds_get_requested_incompatible_qos_status", _entity, c.POINTER(dds_c_t.requested_incompatible_qos_status)
)
_reader_handles = _function("dds_get_matched_subscriptions", _entity, c.POINTER(c.c_uint64), c.c_size_t)
_writer_handles = _function("dds_get_matched_publications", _entity, c.POINTER(c.c_uint64), c.c_size_t)
_reader_data = _function("dds_get_matched_subscription_data", _entity, c.c_uint64, result=c.POINTER(_Endpoint))
_writer_data = _function("dds_get_matched_publication_data", _entity, c.c_uint64, result=c.POINTER(_Endpoint))
_free_endpoint = _function("dds_builtintopic_free_endpoint", c.POINTER(_Endpoint), result=None)
_get_user_data = _function(
    "dds_qget_userdata", c.c_void_p, c.POINTER(c.c_void_p), c.POINTER(c.c_size_t), result=c.c_bool
)
_free = _function("dds_free", c.c_void_p, result=None)


def matched_readers(writer: Entity) -> int:
    """Return how many readers a writer sends to now."""
    status = dds_c_t.publication_matched_status()
    checked(_readers(writer._ref, status), "counting subscribers")
    return int(status.current_count)


def matched_writers(reader: Entity) -> int:
    """Return how many writers a reader hears now."""
    status = dds_c_t.subscription_matched_status()
    checked(_writers(reader._ref, status), "counting publishers")
    return int(status.current_count)


def acknowledged(writer: Entity) -> bool:
    """Whether all readers have all that was written."""
    return bool(_acknowledged(writer._ref, 0) != TIMEOUT)


def refused_readers(writer: Entity) -> int | None:
    """Return the policy because of which readers did not match a writer since the last time, or None."""
    status = dds_c_t.offered_incompatible_qos_status()
    code = _refused_readers(writer._ref, status)
    return int(status.last_policy_id) if code == 0 and status.total_count_change else None


def refused_writers(reader: Entity) -> int | None:
    """Return the policy because of which writers did not match a reader since the last time, or None."""
    status = dds_c_t.requested_incompatible_qos_status()
    code = _refused_writers(reader._ref, status)
    return int(status.last_policy_id) if code == 0 and status.total_count_change else None


def user_data_of_readers(writer: Entity) -> list[bytes]:
    """Return what the readers that a writer sends to tell of themselves."""
    return _user_data_of_all(writer, matched_readers(writer), _reader_handles, _reader_data)


def user_data_of_writers(reader: Entity) -> list[bytes]:
    """Return what the writers that a reader hears tell of themselves."""
    return _user_data_of_all(reader, matched_writers(reader), _writer_handles, _writer_data)


def _user_data_of_all(entity: Entity, most: int, list_handles: Any, get: Any) -> list[bytes]:
    if most == 0:
        return []
    handles = (c.c_uint64 * most)()
    count = checked(list_handles(entity._ref, handles, most), "listing matched endpoints")
    found = (_user_data(get(entity._ref, handle)) for handle in handles[: min(count, most)])
    return [data for data in found if data is not None]


def user_data_of_writer(reader: Entity, writer: int) -> bytes | None:
    """Return what a writer that a reader hears tells of itself; None if it is gone."""
    return _user_data(_writer_data(reader._ref, writer))


def _user_data(endpoint: Any) -> bytes | None:
    if not endpoint:
        return None
    try:
        return user_data(endpoint.contents.qos)
    finally:
        _free_endpoint(endpoint)


def user_data(qos: Any) -> bytes:
    """Return what an entity tells of itself, from its policies in C."""
    value, size = c.c_void_p(), c.c_size_t()
    if not _get_user_data(qos, value, size) or value.value is None:
        return b""
    data = c.string_at(value, size.value)
    _free(value)
    return data


def checked(code: int, doing: str) -> int:
    """Return a code of the C library that says all is well; raise RosError for one that does not."""
    if code < 0:
        raise RosError(f"Cyclone DDS failed at {doing}: {DDSException(code)}")
    return code


def delete(entity: Entity | None) -> None:
    """Delete an entity now, and not when the garbage collector comes; again does no harm."""
    if entity is not None:
        entity.__del__()
