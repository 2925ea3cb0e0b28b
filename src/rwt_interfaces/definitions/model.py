"""Message, service and action definitions as plain data."""

from __future__ import annotations

from dataclasses import dataclass, field

#: Types that are not messages. `time` and `duration` are ROS 1's own; ROS 2 has builtin_interfaces for them.
PRIMITIVES = frozenset(
    {
        "bool", "byte", "char", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64",
        "float32", "float64", "string", "wstring", "time", "duration",
    }
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class WrittenType:
    """Type of a field or constant.

    Attributes:
        name: a member of :data:`PRIMITIVES`, or the two-part name of a message (``geometry_msgs/Point``).
        string_bound: maximum length of ``string<=N`` and ``wstring<=N``.
        length: number of elements of a fixed array ``T[N]``.
        bound: maximum number of elements of a bounded sequence ``T[<=N]``.
    """

    name: str
    string_bound: int | None = None
    is_array: bool = False
    length: int | None = None
    bound: int | None = None

    @property
    def is_primitive(self) -> bool:
        """True if an element is a primitive rather than a nested message."""
        return self.name in PRIMITIVES


@dataclass(frozen=True, slots=True)
class Field:
    """Field of a message.

    Attributes:
        default: default value in the definition (ROS 2), of the field's type; a tuple for an array.
        where: text and line of the definition, `my_msgs/msg/Status.msg:3`; empty if there is none.
    """

    name: str
    type: WrittenType
    default: object | None = None
    where: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class Constant:
    """Constant; `text` is its value as written, which ROS 1's MD5 sum includes."""

    name: str
    type: WrittenType
    value: bool | int | float | str
    text: str


@dataclass(frozen=True, slots=True)
class MessageDefinition:
    """Definition of a message.

    Attributes:
        name: two-part, ``std_msgs/String``. Parts of services and actions are ``std_srvs/SetBool_Request``,
            ``nav2_msgs/NavigateToPose_Goal`` on ROS 2, without the ``_`` on ROS 1.
        text: the definition as written, including comments, with LF line ends.
    """

    name: str
    fields: tuple[Field, ...]
    constants: tuple[Constant, ...] = ()
    text: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class ServiceDefinition:
    """Definition of a service."""

    name: str
    request: MessageDefinition
    response: MessageDefinition


@dataclass(frozen=True, slots=True)
class ActionDefinition:
    """Definition of an action."""

    name: str
    goal: MessageDefinition
    result: MessageDefinition
    feedback: MessageDefinition
