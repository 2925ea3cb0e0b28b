"""Type supports of installed packages, for a middleware that does not serialise with Fast CDR.

They replace those made from definitions with CycloneDDS, whose serialisation reads C structs. Requests and
responses are converted by the middleware's own functions, from and to these.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

from rwt.extensions.ros2.ament import library
from rwt.extensions.ros2.rcl import SerialisedMessage, check, rmw
from rwt.extensions.ros2.type_supports.calls import Forms
from rwt.extensions.ros2.type_supports.capsules import class_of
from rwt_graph.errors import Ros2Error
from rwt_interfaces.structs import MessageType, ServiceType


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


@cache
def _class(name: str, kind: str) -> Any:
    return class_of(name, type_support(name, kind))


class InstalledTypes:
    """Type supports of the installed packages."""

    def message(self, type: MessageType) -> Any:
        """Return the class of a message for raw publishers and subscriptions; raises NotInstalled."""
        return _class(type.registry.type_name(type), "message")

    def service(self, type: ServiceType) -> tuple[Any, Forms]:
        """Return the class of a service, and the forms of one endpoint of it; raises NotInstalled."""
        name = type.request.registry.type_name(type)
        return _class(name, "service"), Forms(StructForm(f"{name}_Request"), StructForm(f"{name}_Response"))


@cache
def _buffer() -> SerialisedMessage:
    """Return the buffer that all conversions share; it belongs to the graph's thread."""
    return SerialisedMessage()


class StructForm:
    """Requests or responses of one type as C structs, see :class:`~.calls.Form`.

    Args:
        name: full name of the message.
    """

    def __init__(self, name: str) -> None:
        package, folder, short = name.split("/")
        generator = ctypes.CDLL(library(f"lib{package}__rosidl_generator_c.so"))
        self._name = name
        self._support = type_support(name, "message")
        self._create = generator[f"{package}__{folder}__{short}__create"]
        self._create.restype = ctypes.c_void_p
        self._destroy = generator[f"{package}__{folder}__{short}__destroy"]
        self._destroy.argtypes = (ctypes.c_void_p,)
        self._address = 0

    def fill(self, data: bytes) -> int:
        """See :class:`~.calls.Form`."""
        given = SerialisedMessage()
        given.buffer = ctypes.cast(ctypes.c_char_p(data), ctypes.c_void_p)
        given.length = given.capacity = len(data)
        address = self.empty()
        result = rmw().rmw_deserialize(ctypes.byref(given), self._support, address)
        check(result, f"cannot convert a message of type {self._name}")
        return address

    def empty(self) -> int:
        """See :class:`~.calls.Form`."""
        self._address = self._create()
        return self._address

    def contents(self) -> bytes:
        """See :class:`~.calls.Form`."""
        made, capacity = _buffer(), -1
        while made.capacity != capacity:
            capacity = made.capacity
            # Padding is left as it was in memory, also in memory that the middleware adds.
            ctypes.memset(made.buffer, 0, capacity)
            result = rmw().rmw_serialize(self._address, self._support, ctypes.byref(made))
            check(result, f"cannot convert a message of type {self._name}")
        return made.contents()

    def clear(self) -> None:
        """See :class:`~.calls.Form`."""
        address, self._address = self._address, 0
        if address:
            self._destroy(address)
