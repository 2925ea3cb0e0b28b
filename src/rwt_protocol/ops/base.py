"""What every op shares: its envelope, the kinds of its members, and how it is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, ClassVar, Final, get_args

import msgspec
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from rwt_protocol.error_text import Expected
from rwt_protocol.errors import Level
from rwt_protocol.payloads import (
    AS_PLAIN_VALUES,
    EMPTY,
    Decoded,
    Encodable,
    JsonKind,
    RawJson,
    RawPayload,
    plain_copy,
)


@dataclass(frozen=True, slots=True)
class NoEffect:
    """Marks a member that is taken and changes nothing: the reference says so, and a test sees to it.

    Attributes:
        reason: why that is right.
    """

    reason: str


@dataclass(frozen=True, slots=True)
class Opaque:
    """Marks a payload: a member that this package does not look into.

    Attributes:
        convert: makes the member's value from what the codec left of it.
        kinds: what ROS puts there. What arrives is not looked at; what a program writes is one of them.
    """

    convert: Callable[[msgspec.Raw | RawPayload], RawPayload | str]
    kinds: tuple[JsonKind, ...]

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        written = core_schema.no_info_plain_validator_function(self._written)
        arrived = [
            core_schema.is_instance_schema(RawJson),
            core_schema.is_instance_schema(Decoded),
            *([core_schema.str_schema(strict=True)] if "string" in self.kinds else []),
        ]
        return core_schema.custom_error_schema(
            core_schema.json_or_python_schema(
                json_schema=written,
                python_schema=core_schema.union_schema([*arrived, written], mode="left_to_right"),
            ),
            custom_error_type="payload",
            custom_error_message=f"Input should be of type {' or '.join(self.kinds)}, and hold only what JSON"
            " has, bytes, and integers of at most 64 bits",
            serialization=AS_PLAIN_VALUES,
        )

    def __get_pydantic_json_schema__(
        self, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        return {"type": list(self.kinds) if len(self.kinds) > 1 else self.kinds[0]}

    def _written(self, value: object) -> object:
        """A member as a program writes it: an object that codecs can write, or the value itself."""
        if hasattr(value, "json") and hasattr(value, "plain") and not isinstance(value, type):
            return value
        try:
            payload = self.convert(Decoded(plain_copy(value)))
        except RecursionError:
            raise ValueError("nested too deeply") from None
        if not isinstance(payload, str) and payload.kind not in self.kinds:
            raise ValueError("of another kind")
        return payload


def opaque(raw: msgspec.Raw | RawPayload) -> RawPayload:
    """The undecoded bytes as a payload of their own: copied, so that they do not keep the frame alive."""
    return RawJson(bytes(raw)) if type(raw) is msgspec.Raw else raw


def opaque_or_empty(raw: msgspec.Raw | RawPayload) -> RawPayload:
    """The payload of :func:`opaque`; null is the same as an absent member (SRV-02, SVP-05)."""
    payload = opaque(raw)
    return EMPTY if payload.kind == "null" else payload


def opaque_or_text(raw: msgspec.Raw | RawPayload) -> RawPayload | str:
    """The payload of :func:`opaque_or_empty`; a string, as failures have it, is decoded (SRV-05)."""
    payload = opaque_or_empty(raw)
    if isinstance(payload, Decoded):
        return payload.value if isinstance(payload.value, str) else payload
    return msgspec.json.decode(payload.data, type=str) if payload.kind == "string" else payload


def _whole_number(value: object) -> object:
    """An integral float is an integer (SUB-11)."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


_Integer = Annotated[int, Field(ge=-(2**63), lt=2**64)]
MOST_MARK: Final = 4096
"""Characters of the longest `id`: it is kept as long as what it names, and repeated in what answers it."""

_Mark = Annotated[str, Field(max_length=MOST_MARK)]
_ID = Expected(f"a string of at most {MOST_MARK} characters or a 64-bit integer")

RequiredId = Annotated[_Mark | _Integer, Field(union_mode="left_to_right"), _ID]
Id = Annotated[_Mark | _Integer | None, Field(union_mode="left_to_right"), _ID]
"""The sender's own mark, echoed unchanged in what answers it (ENV-02).

None is an absent id, and null on the wire is the same: roslibpy writes it where it has none (STA-07). It is
echoed if and only if it is there and not null (SRV-01).
"""

Text = Annotated[str, Expected("a string")]
OptionalText = Annotated[str | None, Expected("a string")]
Flag = Annotated[bool, Expected("true or false")]
MOST: Final = 2**53 - 1
"""The largest whole number that every reader of JSON has exactly (RFC 8259 section 6)."""
MOST_SECONDS: Final = 2**63 // 10**9 + 1
"""The longest time that 64 bits of nanoseconds hold, rounded up: ROS 2 writes it for no end."""

SafeInteger = Annotated[int, Field(ge=-MOST, le=MOST)]
_Natural = Annotated[int, Field(ge=0, le=MOST)]

Whole = Annotated[
    SafeInteger,
    BeforeValidator(_whole_number, json_schema_input_type=SafeInteger),
    Expected("a whole number"),
]
Count = Annotated[
    _Natural,
    BeforeValidator(_whole_number, json_schema_input_type=_Natural),
    Expected("a whole number, zero or more"),
]

# Members of these three types have `strict=False`: type checkers then let programs write plain values there.
Message = Annotated[Encodable, Opaque(opaque, ("object",)), Expected("an object")]
Arguments = Annotated[
    Encodable, Opaque(opaque_or_empty, ("object", "array")), Expected("an object or an array")
]
Values = Annotated[
    Encodable | str,
    Opaque(opaque_or_text, ("object", "string")),
    Expected("an object, or a string that says what failed"),
]


class Op(BaseModel):
    """One message of the protocol. Immutable.

    Members that the model does not have are ignored (ENV-01), and on the wire null stands for an absent
    optional member.

    What each member means is said in the docstring of its op; the reference is made from it.

    Attributes:
        id: the sender's own mark, repeated unchanged in what answers this message (ENV-02). null: none.
        topic: name of the topic. `chatter` and `/chatter` are the same topic.
        service: name of the service.
        action: name of the action.
        fragment_size: split what is longer than so many characters (FRG-20); None and 0: do not.
    """

    model_config = ConfigDict(frozen=True, strict=True, extra="ignore", hide_input_in_errors=True)

    wire_order: ClassVar[tuple[str, ...]] = ()
    """The members in the order in which they are written (ENV-16), where it is not the order of the model."""

    op: str
    id: Id = None


class Direction(Enum):
    """Who sends an op."""

    TO_SERVER = "client to server"
    TO_CLIENT = "server to client"
    BOTH = "both"


@dataclass(frozen=True, slots=True)
class ReplyTo:
    """The part of a message that a refusal repeats; readable even when the rest of the message is not valid.

    Attributes:
        op: the name of the op as it was sent, empty when there was none.
        id: the sender's id.
        name: the service or action that was meant, as it was written; empty when there was none.
    """

    op: str = ""
    id: str | int | None = None
    name: str = ""

    @classmethod
    def of(cls, op: Op) -> ReplyTo:
        """Where to answer `op`."""
        name = getattr(op, "service", None) or getattr(op, "action", None) or ""
        return cls(op.op, op.id, name)


Refuse = Callable[[ReplyTo, str, Level], Op]
"""Makes the op that reports to the sender of a message why it was refused."""


@dataclass(frozen=True, slots=True)
class OpSpec:
    """One op in the table of all of them.

    Attributes:
        model: the op's type.
        direction: who sends it.
        refuse: makes the op that reports a refusal to its sender.
        in_session: whether the session itself does what it asks, so that no handler sees it.
    """

    model: type[Op]
    direction: Direction
    refuse: Refuse
    in_session: bool = False

    @property
    def name(self) -> str:
        """The op's name on the wire."""
        name: object = self.model.model_fields["op"].default
        return str(name)

    @property
    def aliases(self) -> tuple[str, ...]:
        """Other names under which it is accepted."""
        return tuple(name for name in get_args(self.model.model_fields["op"].annotation) if name != self.name)
