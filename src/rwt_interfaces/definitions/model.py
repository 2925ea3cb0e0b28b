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
    """The type of one field or constant.

    Attributes:
        name: a member of :data:`PRIMITIVES`, or the two-part name of a message (``geometry_msgs/Point``).
        string_bound: longest string, for ``string<=N`` and ``wstring<=N``.
        is_array: whether the field holds a sequence.
        length: number of elements of a fixed array ``T[N]``.
        bound: largest number of elements of a bounded sequence ``T[<=N]``.
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
    """One field.

    Attributes:
        name: as written.
        type: its type.
        default: the value written in the definition (ROS 2), of the field's type; a tuple for an array.
        where: in which text and on which line it is written, `my_msgs/msg/Status.msg:3`; empty if nowhere.
    """

    name: str
    type: WrittenType
    default: object | None = None
    where: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class Constant:
    """One constant; `text` is its value as written, which ROS 1's md5 sum is computed over."""

    name: str
    type: WrittenType
    value: bool | int | float | str
    text: str


@dataclass(frozen=True, slots=True)
class MessageDefinition:
    """One message.

    Attributes:
        name: two-part, ``std_msgs/String``. Parts of services and actions are called
            ``std_srvs/SetBool_Request``, ``nav2_msgs/NavigateToPose_Goal`` on ROS 2, without the ``_`` on ROS
            1. fields: in the order of the wire. constants: in the order of the text. text: the definition as
            written, comments included, with ``\\n`` line ends.
    """

    name: str
    fields: tuple[Field, ...]
    constants: tuple[Constant, ...] = ()
    text: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class ServiceDefinition:
    """One service."""

    name: str
    request: MessageDefinition
    response: MessageDefinition


@dataclass(frozen=True, slots=True)
class ActionDefinition:
    """One action."""

    name: str
    goal: MessageDefinition
    result: MessageDefinition
    feedback: MessageDefinition
