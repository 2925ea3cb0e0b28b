"""Structures of rosidl and of its type supports, as ctypes.

Every pointer of a structure is an address: ctypes does not keep its target alive. Owners are the objects of
:mod:`rwt.extensions.ros2.type_supports.defined`, which live as long as the process.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, Final

_POINTER: Final = ctypes.c_void_p

#: Functions that a type support calls. They run on the thread that uses the endpoint, and acquire the GIL.
Serialise: Final = ctypes.CFUNCTYPE(ctypes.c_bool, _POINTER, _POINTER)
SizeOf: Final = ctypes.CFUNCTYPE(ctypes.c_uint32, _POINTER)
MaximumSize: Final = ctypes.CFUNCTYPE(ctypes.c_size_t, ctypes.POINTER(ctypes.c_char))
Getter: Final = ctypes.CFUNCTYPE(_POINTER, _POINTER)
Finder: Final = ctypes.CFUNCTYPE(_POINTER, _POINTER, ctypes.c_char_p)


class String(ctypes.Structure):
    """`rosidl_runtime_c__String`."""

    _fields_ = (("data", ctypes.c_char_p), ("size", ctypes.c_size_t), ("capacity", ctypes.c_size_t))


class List(ctypes.Structure):
    """`…__Sequence` of any type."""

    _fields_ = (("data", _POINTER), ("size", ctypes.c_size_t), ("capacity", ctypes.c_size_t))


class DescribedFieldType(ctypes.Structure):
    """`rosidl_runtime_c__type_description__FieldType`."""

    _fields_ = (
        ("type_id", ctypes.c_uint8),
        ("capacity", ctypes.c_uint64),
        ("string_capacity", ctypes.c_uint64),
        ("nested_type_name", String),
    )


class DescribedField(ctypes.Structure):
    """`rosidl_runtime_c__type_description__Field`."""

    _fields_ = (("name", String), ("type", DescribedFieldType), ("default_value", String))


class DescribedType(ctypes.Structure):
    """`rosidl_runtime_c__type_description__IndividualTypeDescription`."""

    _fields_ = (("type_name", String), ("fields", List))


class TypeDescription(ctypes.Structure):
    """`rosidl_runtime_c__type_description__TypeDescription`."""

    _fields_ = (("type_description", DescribedType), ("referenced_type_descriptions", List))


class TypeHash(ctypes.Structure):
    """`rosidl_type_hash_t`."""

    _fields_ = (("version", ctypes.c_uint8), ("value", ctypes.c_uint8 * 32))


class MessageSupport(ctypes.Structure):
    """`rosidl_message_type_support_t`."""

    _fields_ = (
        ("identifier", _POINTER),
        ("data", _POINTER),
        ("find", Finder),
        ("get_hash", Getter),
        ("get_description", Getter),
        ("get_sources", Getter),
    )


class ServiceSupport(ctypes.Structure):
    """`rosidl_service_type_support_t`, without the functions that make events: no service is introspected."""

    _fields_ = (
        ("identifier", _POINTER),
        ("data", _POINTER),
        ("find", Finder),
        ("request", _POINTER),
        ("response", _POINTER),
        ("event", _POINTER),
        ("create_event", _POINTER),
        ("destroy_event", _POINTER),
        ("get_hash", Getter),
        ("get_description", Getter),
        ("get_sources", Getter),
    )


class MessageCallbacks(ctypes.Structure):
    """`message_type_support_callbacks_t` of `rosidl_typesupport_fastrtps_cpp`."""

    _fields_ = (
        ("namespace", ctypes.c_char_p),
        ("name", ctypes.c_char_p),
        ("serialise", Serialise),
        ("deserialise", Serialise),
        ("size", SizeOf),
        ("maximum_size", MaximumSize),
        ("key_callbacks", _POINTER),
    )


class ServiceCallbacks(ctypes.Structure):
    """`service_type_support_callbacks_t` of `rosidl_typesupport_fastrtps_cpp`."""

    _fields_ = (
        ("namespace", ctypes.c_char_p),
        ("name", ctypes.c_char_p),
        ("request", _POINTER),
        ("response", _POINTER),
    )


class IntrospectedField(ctypes.Structure):
    """`MessageMember` of `rosidl_typesupport_introspection_c`; its functions would read C structs."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("type_id", ctypes.c_uint8),
        ("string_upper_bound", ctypes.c_size_t),
        ("members", _POINTER),
        ("is_key", ctypes.c_bool),
        ("is_array", ctypes.c_bool),
        ("array_size", ctypes.c_size_t),
        ("is_upper_bound", ctypes.c_bool),
        ("offset", ctypes.c_uint32),
        ("default_value", _POINTER),
        ("functions", _POINTER * 6),
    )


class IntrospectedMessage(ctypes.Structure):
    """`MessageMembers` of `rosidl_typesupport_introspection_c`."""

    _fields_ = (
        ("namespace", ctypes.c_char_p),
        ("name", ctypes.c_char_p),
        ("count", ctypes.c_uint32),
        ("size_of", ctypes.c_size_t),
        ("has_key", ctypes.c_bool),
        ("members", _POINTER),
        ("init", _POINTER),
        ("fini", _POINTER),
    )


def string(text: str) -> String:
    """Return a string; the structure keeps its bytes alive."""
    data = text.encode()
    return String(data, len(data), len(data) + 1)


def sequence(items: Sequence[ctypes.Structure]) -> tuple[List, Any]:
    """Return a sequence of structures of one type, and the array that has to outlive it."""
    if not items:
        return List(), None
    array = (type(items[0]) * len(items))(*items)
    return List(ctypes.addressof(array), len(items), len(items)), array
