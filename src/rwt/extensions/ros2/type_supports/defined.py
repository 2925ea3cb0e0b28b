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
from rwt.extensions.ros2.type_supports.fast_cdr import MESSAGE_BYTES, CdrExchange, SerialisedForm, Unsupported
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


class _Answers:
    """Callbacks of all type supports, and what they return by the address of a support.

    The middleware calls them when an endpoint is made.

    Raises:
        Unsupported: the middleware has no type supports of Fast CDR.
    """

    def __init__(self) -> None:
        fast_cdr, introspection = _identifier(_FAST_CDR), _identifier(_INTROSPECTION)
        if fast_cdr is None:
            raise Unsupported("it has no type supports of Fast CDR")
        self.fast_cdr = fast_cdr
        self._introspection = introspection
        self._texts = [ctypes.string_at(each) for each in (fast_cdr, introspection) if each is not None]
        self._announced: dict[str, str] = {}
        self._needs_fields = hasattr(rmw(), _REGISTER_FIELDS)
        self._hashes: dict[int, int] = {}
        self._descriptions: dict[int, int] = {}
        self._introspecting: dict[int, int] = {}
        self._no_sources = c.List()
        self.find = c.Finder(self._found)
        self.getters = (
            c.Getter(self._hashes.get),
            c.Getter(self._descriptions.get),
            c.Getter(lambda _: ctypes.addressof(self._no_sources)),
        )

    def _found(self, support: int, identifier: bytes) -> int | None:
        """Return the type support of one implementation; None of any other."""
        if identifier not in self._texts:
            return None
        return support if identifier == self._texts[0] else self._introspecting.get(support)

    def support(self, identifier: int, data: int) -> c.MessageSupport:
        """Return a new type support of a message."""
        return c.MessageSupport(identifier, data, self.find, *self.getters)

    def describe(self, made: _Support, description: Description, registry: Registry) -> None:
        """Set hash and description of a support."""
        value = (ctypes.c_uint8 * 32)(*bytes.fromhex(hash_of(description).rpartition("_")[2]))
        hashed, whole = c.TypeHash(_HASH_VERSION, value), DescribedInC(description, registry)
        made.kept += (hashed, whole)
        self._hashes[made.address] = ctypes.addressof(hashed)
        self._descriptions[made.address] = whole.address

    def introspect(self, made: _Support, description: Description) -> None:
        """Announce the fields of a message; no-op if the middleware does not."""
        if self._introspection is None:
            return
        introspected = Introspected(description, partial(self.support, self._introspection), self._announced)
        made.kept.append(introspected)
        self._introspecting.update((address, address) for address in introspected.addresses)
        if introspected.is_first or self._needs_fields:
            self._introspecting[made.address] = introspected.address


class DefinedTypes:
    """Type supports of this process, by name and hash.

    Raises:
        Unsupported: the middleware does not serialise with Fast CDR, or not as expected.
    """

    def __init__(self) -> None:
        self._exchange = CdrExchange()
        self._answers = _Answers()
        self._supports: dict[tuple[str, str], _Support] = {}
        self._classes: dict[tuple[str, str], Any] = {}
        memory = ctypes.create_string_buffer(MESSAGE_BYTES)
        probe = self._message(Registry().message("std_msgs/Empty"))
        self._exchange.check(probe.address, ctypes.addressof(memory))

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
        answers, described = self._answers, description(type.definition, type.registry)
        made = _Support(answers.support(answers.fast_cdr, ctypes.addressof(callbacks)))
        made.kept.append(callbacks)
        answers.introspect(made, described)
        answers.describe(made, described, type.registry)
        return made

    def _new_service(self, type: ServiceType, name: str, described: Description) -> _Support:
        registry = type.request.registry
        has_events = registry.distro.introspects_calls
        event = registry.message(f"{name}{EVENT}") if has_events else type.request
        messages = (type.request, type.response, event)
        parts = [self._message(each).address for each in messages]
        callbacks = c.ServiceCallbacks(*_cpp_name(name), *parts[:2])
        answers, data = self._answers, ctypes.addressof(callbacks)
        support = c.ServiceSupport(answers.fast_cdr, data, answers.find, *parts, None, None, *answers.getters)
        made = _Support(support)
        made.kept.append(callbacks)
        answers.describe(made, described, registry)
        return made


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
