"""Type supports made from definitions: no package of a type has to be installed.

Topics pass as serialised bytes, so a type support of a message only needs its name, its hash and its
description. Those of services serialise requests and responses with the callbacks of
:mod:`rwt.extensions.ros2.type_supports.fast_cdr`.

Lifetimes: rcl, the middleware and DDS keep addresses of type supports for as long as a participant has used
them, and do not say when they are done. Type supports are therefore made once for each name and hash, and
live as long as the process, with everything that they point to. Their number is that of the known types.
"""

from __future__ import annotations

import ctypes
from functools import partial
from typing import Any, Final

from rwt.extensions.ros2.rcl import rmw
from rwt.extensions.ros2.type_supports import c_structures as c
from rwt.extensions.ros2.type_supports.calls import Forms
from rwt.extensions.ros2.type_supports.capsules import class_of
from rwt.extensions.ros2.type_supports.descriptions import DescribedInC, Introspected
from rwt.extensions.ros2.type_supports.fast_cdr import MESSAGE_BYTES, Exchange, SerialisedForm, Unsupported
from rwt_interfaces.definitions.actionlib import EVENT
from rwt_interfaces.definitions.hashes import Description, description, hash_of, service_description
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType, ServiceType

#: Symbols of the names of the two implementations. A middleware compares addresses of names, not only texts.
_FAST_CDR: Final = "rosidl_typesupport_fastrtps_c__identifier"
_INTROSPECTION: Final = "rosidl_typesupport_introspection_c__identifier"

#: Function of rmw_fastrtps before Kilted, which rejects a type without fields. Later ones know a type without
#: them by its name alone.
_REGISTER_FIELDS: Final = (
    "_ZN23rmw_fastrtps_shared_cpp20register_type_objectEPK29rosidl_message_type_support_t"
    "RKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEE"
)

_HASH_VERSION: Final = 1


class _Support:
    """Type support, with the objects that its addresses refer to."""

    def __init__(self, support: c.MessageSupport | c.ServiceSupport) -> None:
        self.address = ctypes.addressof(support)
        self.kept: list[object] = [support]


class DefinedTypes:
    """Type supports of this process, by name and hash.

    Raises:
        Unsupported: the middleware does not serialise with Fast CDR, or not as expected.
    """

    def __init__(self) -> None:
        self._exchange = Exchange()
        fast_cdr, introspection = _identifier(_FAST_CDR), _identifier(_INTROSPECTION)
        if fast_cdr is None:
            raise Unsupported("it has no type supports of Fast CDR")
        self._fast_cdr, self._introspection = fast_cdr, introspection
        # True for the one that describes fields, which not every middleware uses.
        self._names = {ctypes.string_at(fast_cdr): False}
        if introspection is not None:
            self._names[ctypes.string_at(introspection)] = True
        self._supports: dict[tuple[str, str], _Support] = {}
        self._classes: dict[tuple[str, str], Any] = {}
        # What the callbacks return, by the address of a support.
        self._hashes: dict[int, int] = {}
        self._descriptions: dict[int, int] = {}
        self._introspections: dict[int, int] = {}
        self._announced: dict[str, str] = {}
        self._needs_fields = hasattr(rmw(), _REGISTER_FIELDS)
        self._no_sources = c.List()
        # Callbacks, which the middleware calls when an endpoint is made.
        self._find = c.Finder(self._found)
        self._get_hash = c.Getter(self._hashes.get)
        self._get_description = c.Getter(self._descriptions.get)
        self._get_sources = c.Getter(lambda _: ctypes.addressof(self._no_sources))
        memory = ctypes.create_string_buffer(MESSAGE_BYTES)
        probe = self._message(Registry().message("std_msgs/Empty"))
        self._exchange.check(probe.address, ctypes.addressof(memory))

    def _found(self, support: int, identifier: bytes) -> int | None:
        """Return the type support of one implementation; None of any other."""
        introspects = self._names.get(identifier)
        if introspects is None:
            return None
        return self._introspections.get(support) if introspects else support

    def message(self, type: MessageType) -> Any:
        """Return the class of a message for raw publishers and subscriptions."""
        return self._class((type.registry.type_name(type), type.rihs01), self._message(type))

    def service(self, type: ServiceType) -> tuple[Any, Forms]:
        """Return the class of a service, and the forms of one endpoint of it."""
        name, described = type.request.registry.type_name(type), _service_description(type)
        key = name, hash_of(described)
        support = self._supports.get(key)
        if support is None:
            support = self._supports[key] = self._new_service(type, name, described)
        forms = [SerialisedForm(self._exchange, f"{name}_{part}") for part in ("Request", "Response")]
        return self._class(key, support), Forms(*forms)

    def _class(self, key: tuple[str, str], support: _Support) -> Any:
        found = self._classes.get(key)
        if found is None:
            found = self._classes[key] = class_of(key[0], support.address)
        return found

    def _message(self, type: MessageType) -> _Support:
        key = type.registry.type_name(type), type.rihs01
        found = self._supports.get(key)
        if found is None:
            found = self._supports[key] = self._new_message(type, key[0])
        return found

    def _new_message(self, type: MessageType, name: str) -> _Support:
        exchange, (namespace, short) = self._exchange, _cpp_name(name)
        callbacks = c.MessageCallbacks(
            namespace,
            short,
            exchange.serialise,
            exchange.deserialise,
            exchange.size,
            exchange.maximum_size,
            None,
        )
        made = _Support(self._support_of(self._fast_cdr, ctypes.addressof(callbacks)))
        described = description(type.definition, type.registry)
        made.kept.append(callbacks)
        self._introspect(made, described)
        self._describe(made, described, type.registry)
        return made

    def _introspect(self, made: _Support, described: Description) -> None:
        """Announce the fields of a message, if the middleware does that."""
        if self._introspection is None:
            return
        make = partial(self._support_of, self._introspection)
        introspected = Introspected(described, make, self._announced)
        made.kept.append(introspected)
        self._introspections |= {address: address for address in introspected.addresses}
        if introspected.is_first or self._needs_fields:
            self._introspections[made.address] = introspected.address

    def _support_of(self, identifier: int, data: int) -> c.MessageSupport:
        getters = self._get_hash, self._get_description, self._get_sources
        return c.MessageSupport(identifier, data, self._find, *getters)

    def _new_service(self, type: ServiceType, name: str, described: Description) -> _Support:
        registry = type.request.registry
        has_events = registry.distro.introspects_calls
        event = registry.message(f"{name}{EVENT}") if has_events else type.request
        messages = (type.request, type.response, event)
        parts = [self._message(each).address for each in messages]
        callbacks = c.ServiceCallbacks(*_cpp_name(name), *parts[:2])
        getters = self._get_hash, self._get_description, self._get_sources
        data = ctypes.addressof(callbacks)
        made = _Support(c.ServiceSupport(self._fast_cdr, data, self._find, *parts, None, None, *getters))
        made.kept.append(callbacks)
        self._describe(made, described, registry)
        return made

    def _describe(self, made: _Support, description: Description, registry: Registry) -> None:
        """Set what the getters return for a support."""
        value = (ctypes.c_uint8 * 32)(*bytes.fromhex(hash_of(description).rpartition("_")[2]))
        hashed, whole = c.TypeHash(_HASH_VERSION, value), DescribedInC(description, registry)
        made.kept += (hashed, whole)
        self._hashes[made.address] = ctypes.addressof(hashed)
        self._descriptions[made.address] = whole.address


def _service_description(type: ServiceType) -> Description:
    """Return the description of a service; before ROS 2 Iron, services have none, nor hashes."""
    registry = type.request.registry
    if registry.distro.introspects_calls:
        return service_description(type.definition, registry.type_name(type), registry)
    return description(type.request.definition, registry)


def _identifier(symbol: str) -> int | None:
    """Return the address of the name of an implementation; None if the middleware does not use it."""
    try:
        return ctypes.c_void_p.in_dll(rmw(), symbol).value
    except ValueError:
        return None


def _cpp_name(name: str) -> tuple[bytes, bytes]:
    """Return namespace and name of a type in C++."""
    package, folder, short = name.split("/")
    return f"{package}::{folder}".encode(), short.encode()
