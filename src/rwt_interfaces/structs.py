"""Message, service and action types: a definition with the Struct compiled from it.

Everything is compiled on first use, so that a registry of some two hundred types costs nothing until a type
is spoken. A message's Struct has its fields in the definition's order and a default for each, so that
``Twist(linear=Vector3(x=1.0))`` and ``Twist()`` are both complete messages.
"""

from __future__ import annotations

import keyword
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any

import msgspec

from rwt_interfaces import field_types
from rwt_interfaces.definitions.actionlib import ACTION_PARTS, SERVICE_PARTS
from rwt_interfaces.definitions.model import MessageDefinition, ServiceDefinition
from rwt_interfaces.distro import NO_TYPE_HASH
from rwt_interfaces.field_types import Slot
from rwt_interfaces.serialise.wire_rules import CDR, ROS1, RULES
from rwt_interfaces.struct_fields import compile_sizes, struct_field, time_struct

if TYPE_CHECKING:
    from rwt_interfaces.registry import Registry
    from rwt_interfaces.serialise.forms import BinaryForm
    from rwt_interfaces.serialise.json import MessageJson
    from rwt_interfaces.serialise.large_json import LargeMessages
    from rwt_interfaces.serialise.long_lists import Chunks
    from rwt_interfaces.serialise.long_strings import Parts
    from rwt_interfaces.serialise.splice import LengthHead, LongField
    from rwt_interfaces.steps import Steps
    from rwt_interfaces.validation.lenient_decoder import LenientDecoder
    from rwt_interfaces.validation.quick_completion import QuickCompletion

    BinaryEncoder = tuple[Callable[[msgspec.Struct], bytes], LengthHead]


def python_name(name: str) -> str:
    """Return the name of a field or constant in Python: a keyword gets an underscore appended, as in ROS."""
    return f"{name}_" if keyword.iskeyword(name) else name


class MessageType:
    """Message type; `name` is two-part."""

    def __init__(self, definition: MessageDefinition, registry: Registry) -> None:
        self.name = definition.name
        self.definition = definition
        self.registry = registry
        self._binary_encoders: dict[BinaryForm, BinaryEncoder] = {}
        self._step_encoders: dict[BinaryForm, Callable[[msgspec.Struct, Chunks], Steps[Parts]]] = {}

    def __repr__(self) -> str:
        return f"<MessageType {self.name} ({self.registry.distro.name})>"

    @cached_property
    def time(self) -> field_types.Time | None:
        """Set when this message is itself a time: builtin_interfaces/Time or Duration."""
        return field_types.time_type(self.name, self.registry.distro)

    @property
    def parts(self) -> tuple[MessageType, ...]:
        """The message itself."""
        return (self,)

    @cached_property
    def slots(self) -> tuple[Slot, ...]:
        """The fields, resolved; raises UnknownType for a nested message without a definition."""
        return tuple(
            Slot(
                field.name,
                python_name(field.name),
                field_types.field_type_of(field.type, self.registry),
                field.default,
            )
            for field in self.definition.fields
        )

    @cached_property
    def struct(self) -> type[msgspec.Struct]:
        """The class of this message in Python, with its constants.

        Called without arguments it makes a complete message.
        """
        if self.time is not None:
            return time_struct(self.time)
        return msgspec.defstruct(
            self.name.partition("/")[2],
            [struct_field(slot) for slot in self.slots],
            rename={slot.attribute: slot.name for slot in self.slots if slot.attribute != slot.name} or None,
            module=self.name.partition("/")[0],
            namespace={python_name(each.name): each.value for each in self.definition.constants},
        )

    @cached_property
    def md5(self) -> str:
        """ROS 1's md5 sum, 32 hexadecimal digits."""
        from rwt_interfaces.definitions import hashes

        return hashes.md5(self.definition, self.registry)

    @cached_property
    def rihs01(self) -> str:
        """ROS 2's type hash, ``RIHS01_`` and 64 hexadecimal digits."""
        from rwt_interfaces.definitions import hashes

        return hashes.rihs01(self.definition, self.registry)

    @property
    def announced_hash(self) -> str:
        """Type hash that programs of the distribution announce over Zenoh."""
        return self.rihs01 if self.registry.distro.type_hash == "rihs01" else NO_TYPE_HASH

    @cached_property
    def decode_leniently(self) -> LenientDecoder:
        """Lenient decoder of this type, which completes missing fields."""
        from rwt_interfaces.validation.lenient_decoder import compile_message

        return compile_message(self)

    @cached_property
    def complete_quickly(self) -> QuickCompletion:
        """Fast completion of texts whose only defect is missing fields."""
        from rwt_interfaces.validation.quick_completion import QuickCompletion

        return QuickCompletion(self)

    @cached_property
    def json(self) -> MessageJson:
        """Encodes and decodes messages of this type in JSON."""
        from rwt_interfaces.serialise.json import MessageJson

        return MessageJson(self)

    @cached_property
    def large_json(self) -> LargeMessages:
        """Decodes and encodes large messages of this type in steps."""
        from rwt_interfaces.serialise.large_json import LargeMessages

        return LargeMessages(self)

    @cached_property
    def has_sequence(self) -> bool:
        """True if publishers count in messages of this type: `header.seq` of ROS 1."""
        return any(
            slot.name == "header"
            and isinstance(slot.type, field_types.Message)
            and slot.type.type.name == "std_msgs/Header"
            and any(each.name == "seq" for each in slot.type.type.slots)
            for slot in self.slots
        )

    @cached_property
    def long_fields(self) -> tuple[LongField, ...]:
        """Where a message of this type may hold most of its bytes."""
        from rwt_interfaces.serialise import splice

        return tuple(splice.long_fields(self))

    @cached_property
    def long_text_fields(self) -> tuple[LongField, ...]:
        """Long fields that hold text."""
        return tuple(field for field in self.long_fields if field.is_text)

    @cached_property
    def long_octets_fields(self) -> tuple[LongField, ...]:
        """Long fields that hold octets."""
        return tuple(field for field in self.long_fields if not field.is_text)

    @cached_property
    def serialise(self) -> Callable[[msgspec.Struct], bytes]:
        """Encodes a message of this type as its distribution does: in CDR, or in ROS 1's own form."""
        return self.to_cdr if self.registry.distro.serialisation == "cdr" else self.to_ros1

    @cached_property
    def deserialise(self) -> Callable[[bytes | memoryview], msgspec.Struct]:
        """Decodes a message of this type from its distribution's serialisation; raises InvalidMessage."""
        return self.from_cdr if self.registry.distro.serialisation == "cdr" else self.from_ros1

    @cached_property
    def deserialise_views(self) -> Callable[[bytes | memoryview], msgspec.Struct]:
        """Same as :attr:`deserialise`, with long octets outside of arrays as views of the data."""
        from rwt_interfaces.serialise import unpack

        return unpack.compile_decoder(self, RULES[self.registry.distro.serialisation], views=True)

    @cached_property
    def step_decoder(self) -> Callable[[bytes | memoryview], Steps[msgspec.Struct]]:
        """Decoder of messages with long lists in steps; otherwise the same as :attr:`deserialise_views`."""
        from rwt_interfaces.serialise import unpack

        return unpack.compile_step_decoder(self, RULES[self.registry.distro.serialisation])

    def binary_encoder(self, form: BinaryForm) -> BinaryEncoder:
        """Return the encoder of one form, and its head of strings and octets."""
        encoder = self._binary_encoders.get(form)
        if encoder is None:
            if form == "cbor":
                from rwt_interfaces.serialise.cbor import length_head  # Not every client reads CBOR.

                encoder = self.to_cbor, length_head
            else:
                encoder = self.to_cdr if form == "cdr" else self.to_ros1, RULES[form].length_head
            self._binary_encoders[form] = encoder
        return encoder

    def step_encoder(self, form: BinaryForm) -> Callable[[msgspec.Struct, Chunks], Steps[Parts]]:
        """Return the encoder of one form in steps, for messages with long lists."""
        encoder = self._step_encoders.get(form)
        if encoder is None:
            from rwt_interfaces.serialise import cbor, pack

            encoder = (
                cbor.compile_steps(self) if form == "cbor" else pack.compile_step_encoder(self, RULES[form])
            )
            self._step_encoders[form] = encoder
        return encoder

    @cached_property
    def holds_long_list(self) -> Callable[[Any], bool] | None:
        """Test for messages of this type with a list that is encoded in steps; None if none can have one."""
        from rwt_interfaces.serialise.long_lists import compile_test

        return compile_test(self)

    @cached_property
    def sizes(self) -> Callable[[list[Any]], int]:
        """Estimates the bytes of messages of this type as objects."""
        return compile_sizes(self)

    @cached_property
    def to_cbor(self) -> Callable[[msgspec.Struct], bytes]:
        """Encodes a message of this type in CBOR."""
        from rwt_interfaces.serialise import cbor

        return cbor.compile_encoder(self)

    @cached_property
    def to_cdr(self) -> Callable[[msgspec.Struct], bytes]:
        """Encodes a message of this type in CDR."""
        from rwt_interfaces.serialise import pack

        return pack.compile_encoder(self, CDR)

    @cached_property
    def from_cdr(self) -> Callable[[bytes | memoryview], msgspec.Struct]:
        """Decodes a message of this type from CDR; raises InvalidMessage."""
        from rwt_interfaces.serialise import unpack

        return unpack.compile_decoder(self, CDR)

    @cached_property
    def to_ros1(self) -> Callable[[msgspec.Struct], bytes]:
        """Encodes a message of this type in ROS 1's own form."""
        from rwt_interfaces.serialise import pack

        return pack.compile_encoder(self, ROS1)

    @cached_property
    def from_ros1(self) -> Callable[[bytes | memoryview], msgspec.Struct]:
        """Decodes a message of this type from ROS 1's own form; raises InvalidMessage."""
        from rwt_interfaces.serialise import unpack

        return unpack.compile_decoder(self, ROS1)


class ServiceType:
    """Service type; `name` is two-part."""

    def __init__(self, name: str, request: MessageType, response: MessageType) -> None:
        self.name = name
        self.request = request
        self.response = response

    def __repr__(self) -> str:
        return f"<ServiceType {self.name}>"

    @property
    def parts(self) -> tuple[MessageType, ...]:
        """Request and response."""
        return self.request, self.response

    @cached_property
    def md5(self) -> str:
        """ROS 1's md5 sum, 32 hexadecimal digits."""
        from rwt_interfaces.definitions import hashes

        return hashes.service_md5(self.definition, self.request.registry)

    @property
    def rihs01(self) -> str:
        """ROS 2's type hash, ``RIHS01_`` and 64 hexadecimal digits; computed at each call."""
        from rwt_interfaces.definitions import hashes

        registry = self.request.registry
        return hashes.service_rihs01(self.definition, registry.type_name(self), registry)

    @property
    def announced_hash(self) -> str:
        """Type hash that programs of the distribution announce over Zenoh."""
        return self.rihs01 if self.request.registry.distro.type_hash == "rihs01" else NO_TYPE_HASH

    @property
    def definition(self) -> ServiceDefinition:
        """Definition of the service."""
        return ServiceDefinition(self.name, self.request.definition, self.response.definition)


class ActionType:
    """Action type; `name` is two-part."""

    __slots__ = ("feedback", "goal", "name", "result")

    def __init__(self, name: str, goal: MessageType, result: MessageType, feedback: MessageType) -> None:
        self.name = name
        self.goal = goal
        self.result = result
        self.feedback = feedback

    def __repr__(self) -> str:
        return f"<ActionType {self.name}>"

    @property
    def parts(self) -> tuple[MessageType, ...]:
        """Goal, result and feedback."""
        return self.goal, self.result, self.feedback


def named_parts(interface: ServiceType | ActionType) -> dict[str, MessageType]:
    """Return the parts of a service or action by name: `Request`, `Goal` and so on."""
    names = SERVICE_PARTS if isinstance(interface, ServiceType) else ACTION_PARTS
    return dict(zip(names, interface.parts, strict=True))
