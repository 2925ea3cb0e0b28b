"""Type supports of installed interfaces, as classes that the C++ part of `rclpy` accepts.

They replace the generated Python classes. `rclpy` reads a type support from its metaclass and never looks at
the fields of a raw sample, so bytes pass without a conversion.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

from rwt.extensions.ros2.ament import library
from rwt_graph.errors import Ros2Error
from rwt_interfaces.structs import MessageType

_new_capsule = ctypes.pythonapi.PyCapsule_New
_new_capsule.restype = ctypes.py_object
_new_capsule.argtypes = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)

#: Name of every capsule. A capsule refers to its name, which therefore lives as long as the process.
_CAPSULE_NAME = ctypes.c_char_p(b"rosidl_message_type_support_t")


class NotInstalled(Ros2Error):
    """The package of a type is not installed with ROS 2, or is older than the type."""

    def __init__(self, name: str, package: str) -> None:
        super().__init__(
            f"type {name} is not installed with ROS 2: install the package {package}, or source its workspace"
        )
        self.package = package


@cache
def _library(package: str) -> ctypes.CDLL:
    return ctypes.CDLL(library(f"lib{package}__rosidl_typesupport_c.so"))


def type_support(name: str, kind: str) -> int:
    """Return the address of the type support of a `message` or `service`, by its full name.

    Raises:
        NotInstalled: its package is not installed with ROS 2.
    """
    package, folder, short = name.split("/")
    symbol = f"rosidl_typesupport_c__get_{kind}_type_support_handle__{package}__{folder}__{short}"
    try:
        function = getattr(_library(package), symbol)
    except (OSError, AttributeError) as error:
        raise NotInstalled(name, package) from error
    function.restype = ctypes.c_void_p
    return int(function())


def _capsule(pointer: int) -> object:
    return _new_capsule(pointer, _CAPSULE_NAME, None)


@cache
def _class(name: str, kind: str) -> Any:
    metaclass = type("TypeSupport", (type,), {"_TYPE_SUPPORT": _capsule(type_support(name, kind))})
    return metaclass(name.rpartition("/")[2], (), {"__slots__": ()})


def message_class(type: MessageType) -> Any:
    """Return the class of a message for raw publishers and subscriptions.

    Raises:
        NotInstalled: its package is not installed with ROS 2.
    """
    return _class(type.registry.type_name(type), "message")


def service_class(name: str) -> Any:
    """Return the class of a service, by its full name, for services and clients.

    Raises:
        NotInstalled: its package is not installed with ROS 2.
    """
    return _class(name, "service")
