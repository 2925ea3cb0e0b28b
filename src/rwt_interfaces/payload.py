"""Message of one type, in all forms requested so far."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable
from typing import TYPE_CHECKING, Final, Literal

import msgspec

from rwt_interfaces.serialise import json_reader
from rwt_interfaces.serialise.forms import BinaryForm, CutText, Relayed, Source, SplicedMessage, SplitText
from rwt_interfaces.serialise.json import REJECTIONS, SEQUENCE, parse
from rwt_interfaces.serialise.json_reader import LARGE_BYTES, LONG_FORMS_BYTES, Now, complete, read_json
from rwt_interfaces.serialise.long_lists import plain, plain_lists
from rwt_interfaces.serialise.long_strings import Parts, RawText
from rwt_interfaces.serialise.splice import encode_long_text, long_octets, long_text, put, without_views
from rwt_interfaces.steps import Steps, finished

if TYPE_CHECKING:
    from rwt_interfaces.structs import MessageType

__all__ = ["LARGE_BYTES", "LONG_FORMS_BYTES", "Form", "Payload"]

_NULL: Final = re.compile(b"null")
_SEQUENCE_PATH: Final = ("header", "seq")
Form = Literal["json", "cbor", "serialised", "plain"]
"""Payload representation of frames; :meth:`Payload.prepare` makes nothing for `plain`."""


class Payload(msgspec.Struct, eq=False):
    """Checked message of one type: the form in which it came, and the forms made of it so far.

    Other forms are made on first use and shared by all readers. Exact JSON keeps its bytes and nothing else,
    so a relaying server never builds objects. Make payloads with the ``from_…`` class methods.

    Attributes:
        type: type of the message.
        source: whole message in one of the forms of :mod:`rwt_interfaces.serialise.forms`. The private
            attributes are made of it, and :meth:`forget_forms` drops them.
        is_long: True if other forms should be made in steps, by :meth:`prepare`.
        checked: small text with arrays as :meth:`MessageJson.check` returned it, so that other forms need not
            read it again. A retained message has none.
    """

    type: MessageType
    source: Source
    is_long: bool = False
    checked: msgspec.Struct | None = None
    _json: Parts | None = None
    _value: msgspec.Struct | None = None
    _spliced: SplicedMessage | None = None
    _binary: dict[BinaryForm, Parts] | None = None

    def __repr__(self) -> str:
        return f"<Payload {self.type.name}>"

    @classmethod
    def from_json(
        cls, message_type: MessageType, raw: RawText, now: Now | None = None, *, is_trusted: bool = False
    ) -> Payload:
        """Check a JSON message, and complete it if necessary.

        A small text is checked as a whole and completed if it is not exact. For others
        :mod:`rwt_interfaces.serialise.json_reader` lists the attempts, in their order.

        Args:
            message_type: expected type.
            raw: JSON text. It is kept without a copy if it may be passed on untouched.
            now: ROS time in nanoseconds, for headers without a stamp and for "now". Default: the wall clock.
            is_trusted: True to accept any number of slow numbers.

        Raises:
            InvalidMessage: the message does not fit. No other exception is raised, whatever the bytes.
        """
        if len(raw) >= json_reader.LONG_STRING_BYTES:
            return finished(cls.from_json_in_steps(message_type, raw, now, is_trusted=is_trusted))
        codec = message_type.json
        try:
            checked = codec.check(raw)
        except REJECTIONS:
            return cls(message_type, finished(complete(message_type, raw, now or time.time_ns)))
        return cls(message_type, raw, checked=checked) if codec.has_arrays else cls(message_type, raw)

    @classmethod
    def from_json_in_steps(
        cls,
        message_type: MessageType,
        raw: RawText,
        now: Now | None = None,
        *,
        is_trusted: bool = False,
        is_dense: bool = False,
    ) -> Steps[Payload]:
        """Same as :meth:`from_json`, in steps. Exact messages up to `WHOLE_BYTES` take hardly any.

        Args:
            message_type, raw, now, is_trusted: as for :meth:`from_json`.
            is_dense: True if the text holds too many objects to be parsed. It is accepted only if it may be
                passed on untouched, or if nearly all of it is one long string.

        Raises:
            NotExact: the text is dense and not exact.
            InvalidMessage: the message does not fit, or has too many slow numbers.
        """
        now = now or time.time_ns
        read = yield from read_json(message_type, raw, now, is_trusted=is_trusted, is_dense=is_dense)
        return cls(message_type, *read)

    @classmethod
    def from_args(cls, message_type: MessageType, raw: RawText | None, now: Now | None = None) -> Payload:
        """Check the arguments of a service: an object by name, a list by position, otherwise none (SRV-02).

        Raises:
            InvalidMessage: the arguments do not fit.
        """
        if raw is not None and bytes(raw[:1]) == b"{":
            return cls.from_json(message_type, raw, now)
        parsed = None if raw is None else parse(raw)
        return cls.from_value(message_type, parsed if isinstance(parsed, (dict, list)) else {}, now)

    @classmethod
    def from_value(cls, message_type: MessageType, value: object, now: Now | None = None) -> Payload:
        """Check and copy a Python message: a Struct, a mapping, or a list of values by position (SRV-02).

        Numeric arrays may be numpy arrays, octets may be bytes. Missing fields of a mapping are completed and
        headers stamped, as in JSON. A Struct keeps its stamp, even zero.

        Raises:
            InvalidMessage: the message does not fit.
        """
        if isinstance(value, (list, tuple)):
            names = (slot.name for slot in message_type.slots)
            value = dict(zip(names, value, strict=False))
        codec = message_type.json
        try:
            message = codec.convert(value)
        except REJECTIONS:
            message = message_type.decode_leniently(value, now or time.time_ns)
        holds_list = message_type.holds_long_list if codec.has_arrays else None
        is_long = (holds_list is not None and holds_list(message)) or (
            bool(message_type.long_text_fields) and long_text(message_type, message) is not None
        )
        return cls(message_type, message, is_long)

    @classmethod
    def from_value_in_steps(
        cls, message_type: MessageType, value: dict[str, object], now: Now | None = None
    ) -> Steps[Payload]:
        """Same as :meth:`from_value` for a mapping, long lists in steps; raises InvalidMessage."""
        message = yield from message_type.large_json.complete_values(value, now or time.time_ns)
        if message is None:
            return cls.from_value(message_type, value, now)
        return cls(message_type, message, is_long=True)

    @classmethod
    def deserialised(cls, message_type: MessageType, data: bytes | memoryview) -> Payload:
        """Decode a message in its distribution's serialisation; raises only InvalidMessage."""
        return cls(message_type, message_type.deserialise(data))

    @classmethod
    def from_cbor(cls, message_type: MessageType, data: bytes | memoryview) -> Payload:
        """Decode a message in CBOR, as :meth:`cbor` writes it; raises only InvalidMessage.

        Zero stamps stay zero. Only for bytes of a trusted program: :func:`rwt_protocol.parse` reads those of
        others within limits.
        """
        from rwt_interfaces.serialise import cbor

        return cls.from_value(message_type, cbor.decode(data), lambda: 0)

    @classmethod
    def from_cdr(cls, message_type: MessageType, data: bytes | memoryview) -> Payload:
        """Decode a message in CDR, with its encapsulation header; raises only InvalidMessage."""
        return cls(message_type, message_type.from_cdr(data))

    @classmethod
    def relayed_cdr(cls, message_type: MessageType, data: bytes) -> Payload:
        """Wrap a message in CDR without checking it, so that it costs nothing without readers.

        If it does not fit its type, the first call of a method other than :meth:`cdr` raises
        :exc:`InvalidMessage`.
        """
        return cls(message_type, Relayed("cdr", data), _is_long(message_type, data))

    @classmethod
    def relayed_ros1(cls, message_type: MessageType, data: bytes | memoryview) -> Payload:
        """Same as :meth:`relayed_cdr`, for ROS 1's serialisation and a type of ROS 1.

        A view must not change while the message, or what was made of it, exists.
        """
        return cls(message_type, Relayed("ros1", data), _is_long(message_type, data))

    @classmethod
    def from_ros1(cls, message_type: MessageType, data: bytes | memoryview) -> Payload:
        """Decode a message in ROS 1's serialisation, without a length prefix; raises only InvalidMessage."""
        return cls(message_type, message_type.from_ros1(data))

    @classmethod
    def from_ros1_in_steps(cls, message_type: MessageType, data: bytes | memoryview) -> Steps[Payload]:
        """Same as :meth:`from_ros1`, long lists in steps."""
        message = yield from message_type.step_decoder(data)
        return cls(message_type, without_views(message_type, message), _is_long(message_type, data))

    @property
    def is_passthrough(self) -> bool:
        """True if the message arrived as JSON and is passed on untouched."""
        return isinstance(self.source, bytes | memoryview | CutText)

    @property
    def received_json(self) -> RawText | None:
        """JSON text that is passed on untouched; None if the message has none."""
        match self.source:
            case ((bytes() | memoryview()) as text) | CutText(raw=text):
                return text
            case _:
                return None

    @property
    def is_decoded(self) -> bool:
        """True if :meth:`value` has nothing to decode."""
        return self._value is not None or isinstance(self.source, msgspec.Struct)

    @property
    def is_relayed(self) -> bool:
        """True if the message is only in the form in which another program sent it."""
        return (
            isinstance(self.source, Relayed)
            and self._value is None
            and self._spliced is None
            and self._json is None
        )

    def json(self) -> RawText:
        """Return the message in JSON: the received bytes, if they may be passed on."""
        source = self.source
        if isinstance(source, bytes):
            return source
        parts = self.json_parts()
        if len(parts) > 1:
            self._json = parts = (b"".join(parts),)
        return parts[0]

    def json_parts(self) -> Parts:
        """Return :meth:`json` in parts, so that long messages are not copied."""
        source = self.source
        if isinstance(source, bytes):  # The usual case, once per message and encoding.
            return (source,)
        made = self._json
        if made is None:
            match source:
                case (memoryview() as text) | CutText(raw=text):
                    made = (text,)
                case SplitText(parts=made):
                    pass
                case _:
                    encode = self.type.json.encode
                    spliced = self._apart() if self.type.long_fields else None
                    if spliced is not None:
                        made = spliced.json(encode)
                    else:
                        # Unlike other encoders, this one takes any Struct: a None is written like NaN.
                        made = (encode(source if isinstance(source, msgspec.Struct) else self.value()),)
            self._json = made
        return made

    def cbor(self) -> bytes:
        """Return the message in CBOR, without any envelope (CBR-02 to CBR-07)."""
        return self._whole("cbor")

    def cbor_parts(self) -> Parts:
        """Return :meth:`cbor` in parts, so that long messages are not copied."""
        return self._made("cbor")

    def serialised(self) -> bytes:
        """Return the message in its distribution's serialisation: CDR or ROS 1's."""
        return self._whole(self.type.registry.distro.serialisation)

    def serialised_parts(self) -> Parts:
        """Return :meth:`serialised` in parts, so that long messages are not copied."""
        return self._made(self.type.registry.distro.serialisation)

    def cdr(self) -> bytes:
        """Return the message in CDR, with its encapsulation header."""
        return self._whole("cdr")

    def prepare(self, forms: Iterable[Form]) -> Steps[None]:
        """Make forms of a message with long lists or strings in steps; existing forms take none."""
        wanted = set(forms)
        if "json" in wanted:
            yield from self._prepare_json()
        binary: dict[Form, BinaryForm] = {
            "cbor": "cbor",
            "serialised": self.type.registry.distro.serialisation,
        }
        missing = [name for form, name in binary.items() if form in wanted and self._existing(name) is None]
        if missing:
            yield from self._prepare_binary(missing)

    def _prepare_json(self) -> Steps[None]:
        if self._json is not None or self._has_text:
            return
        yield from self._decode()
        if isinstance(self.source, SplicedMessage) or self._spliced is not None:
            return
        if self.type.json.has_arrays:
            self._json = yield from self.type.large_json.encode(self._encodable())
        if self._json is None and self.is_decoded:
            field = long_text(self.type, self.value())
            if field is not None:
                self._json = yield from encode_long_text(self.type, self.value(), field)

    def _prepare_binary(self, forms: Iterable[BinaryForm]) -> Steps[None]:
        yield from self._decode()
        spliced = self._apart()
        if spliced is not None:
            yield from spliced.prepare_octets()
        elif self.type.json.has_arrays:
            for form in forms:
                large = None
                if self._has_text and self._value is None:
                    large = yield from self.type.large_json.split(self.json())
                short, lists = (self._encodable(), {}) if large is None else (yield from large.apart())
                self._keep(form, (yield from self.type.step_encoder(form)(short, lists)))
        elif self.is_decoded:
            field = long_text(self.type, self.value())
            if field is not None:
                text = SplicedMessage.from_text(self.value(), field)
                yield from text.prepare_octets()
                for form in forms:
                    self._keep(form, text.binary(*self.type.binary_encoder(form)))

    def _decode(self) -> Steps[None]:
        """Decode a relayed message with long lists in steps; others take none."""
        if self.is_long and self.is_relayed and isinstance(self.source, Relayed):
            message = yield from self.type.step_decoder(self.source.data)
            holds_list = self.type.holds_long_list
            if holds_list is None or not holds_list(message):
                self._take_views(message)
            else:
                self._value = without_views(self.type, message)

    def _take_views(self, message: msgspec.Struct) -> SplicedMessage | msgspec.Struct:
        """Keep a decoded message whose long octets may be views: as a whole, or in two parts."""
        found = SplicedMessage.from_views(self.type, message)
        if isinstance(found, SplicedMessage):
            self._spliced = found
        else:
            self._value = found
        return found

    def plain(self) -> object:
        """Return the message as dicts, lists and scalars, octets as bytes."""
        return plain(self._encodable())

    def plain_in_steps(self) -> Steps[object]:
        """Same as :meth:`plain`, long lists in steps; other messages take none."""
        if self.is_long:
            yield from self._decode()
            return (yield from plain_lists(self.type, self._encodable()))
        return self.plain()

    @property
    def size(self) -> int:
        """Bytes of the message in JSON."""
        return sum(map(len, self.json_parts()))

    def _whole(self, form: BinaryForm) -> bytes:
        parts = self._made(form)
        if len(parts) == 1 and isinstance(parts[0], bytes):
            return parts[0]
        whole = b"".join(parts)
        self._keep(form, (whole,))
        return whole

    def _made(self, form: BinaryForm) -> Parts:
        made = self._existing(form)
        if made is None:
            spliced = self._apart()
            encode, length_head = self.type.binary_encoder(form)
            made = (encode(self._encodable()),) if spliced is None else spliced.binary(encode, length_head)
            self._keep(form, made)
        return made

    def _existing(self, form: BinaryForm) -> Parts | None:
        made = None if self._binary is None else self._binary.get(form)
        if made is None and isinstance(self.source, Relayed) and self.source.form == form:
            return (self.source.data,)
        return made

    def _keep(self, form: BinaryForm, parts: Parts) -> None:
        # A new dict, because forms may be dropped between two steps, or made in another thread.
        self._binary = {**(self._binary or {}), form: parts}

    def _apart(self) -> SplicedMessage | None:
        """Return the message in two parts if most of it is one long string or octets."""
        type, source = self.type, self.source
        if isinstance(source, SplicedMessage):
            return source
        if self._spliced is None and type.long_fields:
            if isinstance(source, CutText):
                self._spliced = SplicedMessage.from_cut(type, type.json.decode(source.short), source)
            elif isinstance(source, Relayed) and self._value is None:
                self._take_views(type.deserialise_views(source.data))
            elif self.is_decoded:
                field = long_octets(type, self._encodable())
                self._spliced = None if field is None else SplicedMessage.from_octets(self.value(), field)
        return self._spliced

    def value(self) -> msgspec.Struct:
        """Return the message as its type's Struct. It is shared: treat it as read-only.

        Raises:
            InvalidMessage: the message was relayed and does not fit.
        """
        value = self._value
        if value is None:
            match self.source:
                case bytes() | memoryview() as text:
                    checked = None if self.checked is None else self._without_nulls()
                    value = self.type.json.decode(text) if checked is None else self._own_struct(checked)
                case CutText(raw=text):
                    spliced = self._apart()
                    value = self.type.json.decode(text) if spliced is None else spliced.value()
                case SplitText():
                    value = self.type.json.decode(self.json())
                case SplicedMessage() as spliced:
                    value = spliced.value()
                case Relayed(data=data):
                    found = self._spliced or self._take_views(self.type.deserialise_views(data))
                    value = found.value() if isinstance(found, SplicedMessage) else found
                case message:
                    value = message
                    if message.__class__ is not self.type.struct:
                        value = self.source = self._own_struct(message)
            self._value = value
        return value

    @property
    def kept_size(self) -> int:
        """Approximate bytes of the message without the forms that :meth:`forget_forms` drops."""
        source = self.source
        if isinstance(source, bytes):  # The usual case.
            return len(source)
        match source:
            case (memoryview() as data) | CutText(raw=data) | Relayed(data=data):
                return len(data)
            case SplitText(parts=parts):
                return sum(map(len, parts))
            case SplicedMessage() as spliced:
                return spliced.kept_size
            case message:
                return self.type.sizes([message])

    def detach(self) -> Payload:
        """Return the message without references to the receive buffer, for retaining it."""
        own: Source
        match self.source:
            case memoryview() as text:
                own = bytes(text)
            case CutText(raw=memoryview() as text) as cut:
                own = cut.moved(bytes(text))
            case SplitText():
                own = bytes(self.json())
            case SplicedMessage() as spliced:
                own = spliced.detached()
            case Relayed(form, memoryview() as data):
                own = Relayed(form, bytes(data))
            case own:
                pass
        if own is self.source:
            self.checked = None
            return self
        return Payload(self.type, own, self.is_long, _value=self._value)

    def forget_forms(self) -> None:
        """Drop all forms but the source; others are made again on use."""
        self._json = self._value = self._spliced = self._binary = None

    def numbered(self, number: int) -> Payload:
        """Return the message with that `header.seq`; its type must have one."""
        match self.source:
            case bytes() | memoryview() as text:
                parts: Parts = (text,)
            case SplitText(parts=parts):
                pass
            case _:
                parts = ()
        found = SEQUENCE.match(parts[0]) if parts else None
        if found is None:
            spliced = self._apart()
            if spliced is not None:
                return Payload(self.type, spliced.numbered(number))
            return Payload(self.type, put(self.value(), _SEQUENCE_PATH, number))
        start, end = found.span(1)
        first = memoryview(parts[0])
        before = b"".join((first[:start], b"%d" % number))
        if len(first) < json_reader.LONG_STRING_BYTES and len(parts) == 1:
            return Payload(self.type, before + first[end:])
        known = None if self._value is None else put(self.value(), _SEQUENCE_PATH, number)
        numbered = SplitText((before, first[end:], *parts[1:]))
        return Payload(self.type, numbered, self.is_long, _value=known)

    @property
    def _has_text(self) -> bool:
        return isinstance(self.source, bytes | memoryview | CutText | SplitText)

    def _own_struct(self, message: msgspec.Struct) -> msgspec.Struct:
        try:
            return msgspec.convert(message, self.type.struct, from_attributes=True)
        except msgspec.ValidationError:
            # A None in a float field becomes NaN in the lenient decoder.
            own: msgspec.Struct = self.type.decode_leniently(message, time.time_ns)
            return own

    def _encodable(self) -> msgspec.Struct:
        """Return the message as a Struct that all encoders take: without None in a float."""
        if self._value is not None:
            return self._value
        source = self.source
        if isinstance(source, msgspec.Struct):
            return source if source.__class__ is self.type.json.sendable else self.value()
        return self._without_nulls() or self.value()

    def _without_nulls(self) -> msgspec.Struct | None:
        """Return the checked Struct if no float can be None in it, as encoders require."""
        if self.checked is None or not isinstance(self.source, bytes | memoryview):
            return None
        return None if _NULL.search(self.source) else self.checked


def _is_long(message_type: MessageType, data: bytes | memoryview) -> bool:
    return len(data) >= json_reader.LONG_FORMS_BYTES and (
        message_type.json.has_arrays or bool(message_type.long_text_fields)
    )
