"""Base of all ops: envelope, member types and rejections."""

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
    """Marker of a member that is accepted without effect; documented in the reference and tested."""

    reason: str


@dataclass(frozen=True, slots=True)
class Opaque:
    """Marker of a payload: a member that this package does not inspect.

    Attributes:
        convert: makes the member's value from the undecoded member.
        kinds: JSON kinds that ROS uses. Not checked on arrival; programs write one of them.
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
        """Return a member as written by a program: an object that codecs can encode, or the value itself."""
        # By its methods: messages of rwt_interfaces qualify, which this package does not import.
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
    """Return undecoded bytes as a payload. They are copied, so that they do not keep the frame alive."""
    return RawJson(bytes(raw)) if type(raw) is msgspec.Raw else raw


def opaque_or_empty(raw: msgspec.Raw | RawPayload) -> RawPayload:
    """Same as :func:`opaque`; null equals an absent member (SRV-02, SVP-05)."""
    payload = opaque(raw)
    return EMPTY if payload.kind == "null" else payload


def opaque_or_text(raw: msgspec.Raw | RawPayload) -> RawPayload | str:
    """Same as :func:`opaque_or_empty`; strings, as in failures, are decoded (SRV-05)."""
    payload = opaque_or_empty(raw)
    # In CBOR and BSON the text of a failure is decoded already.
    if isinstance(payload, Decoded):
        return payload.value if isinstance(payload.value, str) else payload
    return msgspec.json.decode(payload.data, type=str) if payload.kind == "string" else payload


def whole_number(value: object) -> object:
    """Accept integral floats as integers (SUB-11)."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


_Integer = Annotated[int, Field(ge=-(2**63), lt=2**64)]
MOST_MARK: Final = 4096
"""Maximum characters of an `id`, which is stored, and repeated in responses."""

_Mark = Annotated[str, Field(max_length=MOST_MARK)]
_ID = Expected(f"a string of at most {MOST_MARK} characters or a 64-bit integer")

RequiredId = Annotated[_Mark | _Integer, Field(union_mode="left_to_right"), _ID]
Id = Annotated[_Mark | _Integer | None, Field(union_mode="left_to_right"), _ID]
"""Id chosen by the sender, echoed unchanged in responses (ENV-02), which have none if it is absent
(SRV-01).

None means absent, and so does null on the wire, which roslibpy sends (STA-07).
"""

Text = Annotated[str, Expected("a string")]
OptionalText = Annotated[str | None, Expected("a string")]
Flag = Annotated[bool, Expected("true or false")]
MOST: Final = 2**53 - 1
"""Largest integer that all JSON readers represent exactly (RFC 8259 section 6)."""
MOST_SECONDS: Final = 2**63 // 10**9 + 1
"""Maximum seconds in 64 bits of nanoseconds, rounded up; ROS 2 uses it for "infinite"."""

SafeInteger = Annotated[int, Field(ge=-MOST, le=MOST)]
_Natural = Annotated[int, Field(ge=0, le=MOST)]

Whole = Annotated[
    SafeInteger,
    BeforeValidator(whole_number, json_schema_input_type=SafeInteger),
    Expected("a whole number"),
]
Count = Annotated[
    _Natural,
    BeforeValidator(whole_number, json_schema_input_type=_Natural),
    Expected("a whole number, zero or more"),
]

# Members of these three types have `strict=False`, so that type checkers accept plain values.
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
    """Message of the protocol. Immutable.

    Unknown members are ignored (ENV-01), and null stands for an absent optional member. For the wire, use
    :func:`rwt_protocol.dump`, which leaves absent members out; ``model_dump_json`` writes them as null.

    The docstring of each op describes its members; the reference is generated from it.

    Attributes:
        id: id chosen by the sender, repeated unchanged in responses (ENV-02). null: none.
        topic: name of the topic. `chatter` and `/chatter` are the same topic.
        service: name of the service.
        action: name of the action.
        fragment_size: maximum characters of a message before it is split (FRG-20); None and 0: never split.
    """

    # Built on first use, see `rwt_protocol.readers`: programs use few of the ops.
    model_config = ConfigDict(
        frozen=True, strict=True, extra="ignore", hide_input_in_errors=True, defer_build=True
    )

    wire_order: ClassVar[tuple[str, ...]] = ()
    """Order in which members are written (ENV-16), if it differs from the model's."""

    op: str
    id: Id = None


class Direction(Enum):
    """Sender of an op."""

    TO_SERVER = "client to server"
    TO_CLIENT = "server to client"
    BOTH = "both"


@dataclass(frozen=True, slots=True)
class ReplyTo:
    """Part of a message that a rejection repeats; readable even if the rest is invalid.

    Attributes:
        op: name of the op as sent; empty if absent.
        id: id of the sender.
        name: name of the service or action as written; empty if absent.
    """

    op: str = ""
    id: str | int | None = None
    name: str = ""

    @classmethod
    def of(cls, op: Op) -> ReplyTo:
        """Return the reply address of `op`."""
        name = getattr(op, "service", None) or getattr(op, "action", None) or ""
        return cls(op.op, op.id, name)


Refuse = Callable[[ReplyTo, str, Level], Op]
"""Factory of the op that reports a rejection to the sender."""


@dataclass(frozen=True, slots=True)
class OpSpec:
    """Entry of the table of ops.

    Attributes:
        model: type of the op.
        direction: sender of the op.
        refuse: makes the op that reports a rejection to its sender.
        in_session: True if the session handles the op itself, without a handler.
    """

    model: type[Op]
    direction: Direction
    refuse: Refuse
    in_session: bool = False

    @property
    def name(self) -> str:
        """Name of the op on the wire."""
        name: object = self.model.model_fields["op"].default
        return str(name)

    @property
    def aliases(self) -> tuple[str, ...]:
        """Other accepted names."""
        return tuple(name for name in get_args(self.model.model_fields["op"].annotation) if name != self.name)
