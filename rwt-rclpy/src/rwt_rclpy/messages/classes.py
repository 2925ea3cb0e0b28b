"""Classes of messages, services and actions with the semantics of rosidl's generated ones.

A class is created once for each type of a registry, with its nested classes. The reference to the type is
where rosidl stores the C handle: `_TYPE_SUPPORT` of the metaclass.
"""

from __future__ import annotations

import os
import re
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, ClassVar, TypeVar

import numpy as np

from rwt_interfaces.errors import UnknownType
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import ActionType, MessageType, ServiceType, python_name
from rwt_rclpy.messages.fields import NUMBER_CODES, Convert, MessageField, Nested, message_field
from rwt_rclpy.messages.slot_types import AbstractSequence, BasicType, SlotType, UnboundedSequence

T = TypeVar("T")

_WORD_ENDS = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")


def module_of(name: str) -> str:
    """Return rosidl's module of an interface: `_add_two_ints` for `AddTwoInts`."""
    return "_" + _WORD_ENDS.sub("_", name).lower()


#: True if setters check: with ``ROS_PYTHON_CHECK_FIELDS=1``, as in the real one.
FIELDS_ARE_CHECKED = os.environ.get("ROS_PYTHON_CHECK_FIELDS") == "1"


class InterfaceMeta(type):
    """Metaclass of all interfaces.

    Attributes:
        _TYPE_SUPPORT: type in the registry.
    """

    _TYPE_SUPPORT: ClassVar[MessageType | ServiceType | ActionType | None] = None

    @classmethod
    def __import_type_support__(mcs) -> None:
        """No-op: the class is created from its definition."""


class Message(metaclass=InterfaceMeta):
    """Base of all message classes."""

    __slots__: Sequence[str] = ("_check_fields",)

    _check_fields: bool
    _fields_and_field_types: ClassVar[dict[str, str]] = {}
    SLOT_TYPES: ClassVar[tuple[SlotType, ...]] = ()
    _rwt_fields: ClassVar[tuple[MessageField, ...]] = ()
    _rwt_defaults: ClassVar[tuple[tuple[str, Callable[[], Any]], ...]] = ()
    _rwt_to_graph: ClassVar[Convert]
    _rwt_from_graph: ClassVar[Convert]

    def __init__(self, **kwargs: Any) -> None:
        self._check_fields = bool(kwargs.pop("check_fields", FIELDS_ARE_CHECKED))
        if not kwargs:
            for slot, default in self._rwt_defaults:
                setattr(self, slot, default())
            return
        for field in self._rwt_fields:
            if field.name in kwargs:
                value = kwargs.pop(field.name)
                if self._check_fields and isinstance(field.type, AbstractSequence):
                    value = field.store(value)  # rosidl's constructors convert sequences before the check.
                setattr(self, field.name, value)
            else:
                setattr(self, f"_{field.name}", field.default())
        if kwargs and self._check_fields:
            raise AssertionError(f"Invalid arguments passed to constructor: {', '.join(sorted(kwargs))}")

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """Return the fields by name, with their types in IDL notation."""
        return dict(cls._fields_and_field_types)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, type(self)):
            return False
        for field in self._rwt_fields:
            mine, its = getattr(self, field.name), getattr(other, field.name)
            if isinstance(mine, np.ndarray) or isinstance(its, np.ndarray):
                if not np.array_equal(mine, its):
                    return False
            elif mine != its:
                return False
        return True

    def __repr__(self) -> str:
        shown = ", ".join(f"{field.name}={self._shown(field)}" for field in self._rwt_fields)
        package = type(self).__module__.rpartition(".")[0]
        return f"{package}.{type(self).__name__}({shown})"

    def _shown(self, field: MessageField) -> str:
        value = getattr(self, field.name)
        kind = field.type
        if isinstance(kind, AbstractSequence):
            element = kind.value_type
            if isinstance(element, BasicType) and element.typename in NUMBER_CODES:
                return repr(list(value))
        return repr(value)


class MessageClasses:
    """Classes of one registry, created on first use. Thread-safe."""

    def __init__(self, registry: Registry) -> None:
        self.registry = registry
        self._lock = threading.RLock()
        self._messages: dict[str, type[Message]] = {}
        self._services: dict[str, type] = {}
        self._actions: dict[str, type] = {}

    @property
    def in_use(self) -> bool:
        """True if a class was created."""
        return bool(self._messages)

    def of(self, message: MessageType) -> type[Message]:
        """Return the class of a message type of the registry."""
        return self._once(self._messages, message.name, lambda: self._make(message))

    def message(self, name: str) -> type[Message]:
        """Return the class of a message, or of a part of a service or action. Raises :exc:`UnknownType`."""
        return self.of(self.registry.message(name))

    def service(self, name: str) -> type:
        """Return the class of a service with `Request`, `Response`, `Event`. Raises :exc:`UnknownType`."""
        return self._once(self._services, name, lambda: self._make_service(self.registry.service(name)))

    def action(self, name: str) -> type:
        """Return the class of an action with `Goal`, `Result` and `Feedback`. Raises :exc:`UnknownType`."""
        return self._once(self._actions, name, lambda: self._make_action(self.registry.action(name)))

    def by_type_name(self, name: str) -> type:
        """Return the class of ``pkg/msg/Name``, ``pkg/srv/Name`` or ``pkg/action/Name``, or of a part of the
        latter two, such as ``pkg/srv/Name_Request``.

        Raises:
            UnknownType: the registry has no such interface.
        """
        kind = name.split("/")[1] if name.count("/") == 2 else "msg"
        short = f"{name.split('/')[0]}/{name.rpartition('/')[2]}"
        if kind == "srv" or (kind == "action" and short.endswith(("_SendGoal", "_GetResult"))):
            is_part = short.endswith(("_Request", "_Response", "_Event"))
            return self.message(short) if is_part else self.service(short)
        parts = ("_Goal", "_Result", "_Feedback", "_FeedbackMessage", "_Request", "_Response", "_Event")
        if kind == "action" and not short.endswith(parts):
            return self.action(short)
        return self.message(short)

    def _once(self, known: dict[str, T], name: str, make: Callable[[], T]) -> T:
        found = known.get(name)
        if found is None:
            with self._lock:
                found = known.get(name)
                if found is None:
                    found = known[name] = make()
        return found

    # Messages

    def _nested(self, name: str) -> Nested:
        cls = self.message(name)
        package, kind, short = self.registry.full_name(name).split("/")
        return Nested(cls, short, (package, kind), cls._rwt_to_graph, cls._rwt_from_graph)

    def _make(self, message: MessageType) -> type[Message]:
        package, kind, short = self.registry.full_name(message.name).split("/")
        definition = message.definition
        fields = tuple(message_field(field, self._nested) for field in definition.fields)
        constants = {
            python_name(each.name): bytes([int(each.value)]) if each.type.name == "byte" else each.value
            for each in definition.constants
        }
        defaults = {
            f"{field.name.upper()}__DEFAULT": field.default()
            for field, written in zip(fields, definition.fields, strict=True)
            if written.default is not None
        }
        meta = type(
            f"Metaclass_{short}",
            (InterfaceMeta,),
            {
                "_TYPE_SUPPORT": message,
                **{name: property(_constant(value)) for name, value in {**constants, **defaults}.items()},
            },
        )
        base = short.rsplit("_", 1)[0] if "_" in short else short
        namespace = {
            "__doc__": f"Message class '{short}'.",
            "__slots__": tuple(f"_{field.name}" for field in fields),
            "__module__": f"{package}.{kind}.{module_of(base)}",
            "__hash__": None,
            "SLOT_TYPES": tuple(field.type for field in fields),
            "_rwt_fields": fields,
            "_rwt_defaults": tuple((f"_{field.name}", field.default) for field in fields),
            "_fields_and_field_types": {field.name: field.type_text for field in fields},
            **constants,
            **defaults,
            **{field.name: _property(field) for field in fields},
        }
        cls: type[Message] = meta(short, (Message,), namespace)
        cls.__slots__ = [*cls.__slots__, "_check_fields"]  # As the classes of rosidl list them.
        cls._rwt_to_graph = staticmethod(_writer(message, fields))
        cls._rwt_from_graph = staticmethod(_reader(message, fields, cls))
        return cls

    # Services and actions

    def _make_service(self, service: ServiceType) -> type:
        package, kind, short = self.registry.type_name(service).split("/")
        parts = {"Request": self.of(service.request), "Response": self.of(service.response)}
        with suppress(UnknownType):  # Introspection needs service_msgs.
            parts["Event"] = self.message(f"{service.name}_Event")
        return _holder(package, kind, short, service, parts)

    def _make_action(self, action: ActionType) -> type:
        package, _, short = self.registry.type_name(action).split("/")
        impl = type(
            "Impl",
            (),
            {
                "__doc__": f"The services and messages that carry {package}/action/{short}.",
                "SendGoalService": self.service(f"{action.name}_SendGoal"),
                "GetResultService": self.service(f"{action.name}_GetResult"),
                "FeedbackMessage": self.message(f"{action.name}_FeedbackMessage"),
                "CancelGoalService": self.service("action_msgs/CancelGoal"),
                "GoalStatusMessage": self.message("action_msgs/GoalStatusArray"),
            },
        )
        parts = {
            "Goal": self.of(action.goal),
            "Result": self.of(action.result),
            "Feedback": self.of(action.feedback),
            "Impl": impl,
        }
        return _holder(package, "action", short, action, parts)


def _holder(
    package: str, kind: str, short: str, interface: ServiceType | ActionType, parts: dict[str, Any]
) -> type:
    def refuse(self: object) -> None:
        raise NotImplementedError(
            f"{package}/{kind}/{short} is made of {', '.join(parts)}: make one of these instead"
        )

    meta = type(f"Metaclass_{short}", (InterfaceMeta,), {"_TYPE_SUPPORT": interface})
    module = f"{package}.{kind}.{module_of(short)}"
    namespace = {"__doc__": f"{package}/{kind}/{short}.", "__module__": module, "__init__": refuse, **parts}
    made: type = meta(short, (), namespace)
    return made


def _constant(value: Any) -> Callable[[type], Any]:
    return lambda cls: value


def _property(field: MessageField) -> property:
    slot, check, store, thaw = f"_{field.name}", field.check, field.store, field.thaw

    def get(self: Message) -> Any:
        return getattr(self, slot)

    def get_thawed(self: Message) -> Any:
        value = getattr(self, slot)
        if thaw is not None and isinstance(value, bytes):
            value = thaw(value)
            setattr(self, slot, value)
        return value

    def put(self: Message, value: Any) -> None:
        setattr(self, slot, check(value) if self._check_fields else store(value))

    return property(get if thaw is None else get_thawed, put, doc=f"Field '{field.name}', {field.type_text}.")


def octets_of(message: Message, name: str) -> np.ndarray:
    """See :func:`rwt_rclpy.octets_of`."""
    if message._fields_and_field_types.get(name) != "sequence<uint8>":
        raise TypeError(f"{type(message).__name__} has no field {name!r} of type uint8[]")
    seen = np.frombuffer(getattr(message, f"_{name}"), np.uint8)
    seen.flags.writeable = False
    return seen


def _writer(message: MessageType, fields: tuple[MessageField, ...]) -> Convert:
    """Return a function from a message to its Struct in the graph, generated as one call for speed."""
    converts: dict[str, Any] = {f"c{i}": field.to_graph for i, field in enumerate(fields)}
    values = ", ".join(
        f"m._{field.name}" if field.to_graph is None else f"c{i}(m._{field.name})"
        for i, field in enumerate(fields)
    )
    checked = tuple(each for each in fields if not _is_always_valid(each))
    source = f"def convert(m):\n    if not m._check_fields:\n        verify(m)\n    return struct({values})"
    return _compiled(source, {**converts, "struct": message.struct, "verify": partial(_verify, checked)})


def _verify(fields: tuple[MessageField, ...], message: Message) -> None:
    """Check fields that setters did not check; raises AssertionError like them."""
    for field in fields:
        field.check(getattr(message, field.name))


def _is_always_valid(field: MessageField) -> bool:
    """True for sequences of numbers of any length: setters convert them, and a check would copy them."""
    kind = field.type
    if not isinstance(kind, UnboundedSequence):
        return False
    return isinstance(kind.value_type, BasicType) and kind.value_type.typename in NUMBER_CODES


def _reader(message: MessageType, fields: tuple[MessageField, ...], cls: type[Message]) -> Convert:
    """Return a function from a Struct of the graph, which is checked already, to a message."""
    lines = ["def convert(s):", "    m = new(cls)", f"    m._check_fields = {FIELDS_ARE_CHECKED}"]
    names: dict[str, Any] = {"new": object.__new__, "cls": cls}
    for i, field in enumerate(fields):
        names[f"c{i}"] = field.from_graph
        value = f"s.{python_name(field.name)}"
        lines.append(f"    m._{field.name} = " + (value if field.from_graph is None else f"c{i}({value})"))
    lines.append("    return m")
    return _compiled("\n".join(lines), names)


def _compiled(source: str, names: dict[str, Any]) -> Convert:
    # The names in the code are fields of a definition, validated by the parser.
    exec(source, names)
    convert: Convert = names["convert"]
    return convert
