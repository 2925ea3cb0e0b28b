"""Standard messages as classes of packages, for :mod:`rwt_interfaces.jazzy` and `noetic`."""

from __future__ import annotations

from collections.abc import Callable

from rwt_interfaces import field_types
from rwt_interfaces.distro import Distro
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.registry import Registry
from rwt_interfaces.struct_fields import time_struct
from rwt_interfaces.structs import MessageType, named_parts


class Package:
    """Messages, services and actions of a ROS package, compiled on first use.

    A message is its class; services and actions are classes with their parts: `Request` and `Response`,
    `Goal`, `Result` and `Feedback`.
    """

    def __init__(self, registry: Registry, name: str) -> None:
        self._registry = registry
        self._name = name

    def __repr__(self) -> str:
        return f"<package {self._name} ({self._registry.distro.name})>"

    def __getattr__(self, name: str) -> type:
        if name.startswith("__"):
            raise AttributeError(name)
        found = self._find(name)
        setattr(self, name, found)  # cached for the next look-up
        return found

    def _find(self, name: str) -> type:
        full = f"{self._name}/{name}"
        try:
            return self._registry.message(full).struct
        except InterfaceError as error:
            unknown = error
        parts: dict[str, MessageType] = {}
        if full in self._registry.names("srv"):
            parts |= named_parts(self._registry.service(full))
        if full in self._registry.names("action"):
            parts |= named_parts(self._registry.action(full))
        if not parts:
            raise AttributeError(str(unknown)) from None
        structs = {part: message.struct for part, message in parts.items()}
        return type(name, (), {"__module__": self._name, **structs})


def packages_of(distro: Distro) -> Callable[[str], Package | type]:
    """Return a module's `__getattr__` that finds a distribution's packages, `Time` and `Duration`."""
    registry = Registry(distro)

    def find(name: str) -> Package | type:
        if distro.has_time_primitives and name in ("Time", "Duration"):
            held = registry.message(f"std_msgs/{name}").slots[0].type
            assert isinstance(held, field_types.Time)  # These messages hold nothing but a time.
            return time_struct(held)
        known = {full.partition("/")[0] for kind in ("msg", "srv", "action") for full in registry.names(kind)}
        if name not in known:
            raise AttributeError(f"{distro.name} has no package {name!r} in the standard set")
        return Package(registry, name)

    return find
