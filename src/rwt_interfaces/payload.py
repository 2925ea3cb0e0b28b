"""One message of one type in whichever forms exist so far."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Literal

import msgspec

from rwt_interfaces.errors import InvalidMessage, TooManyValues
from rwt_interfaces.serialise.json import REJECTIONS, begins_too_deep, parse, require_quick_numbers
from rwt_interfaces.serialise.long_arrays import (
    MOST_LENIENT,
    MOST_VALUES,
    PIECE,
    SEQUENCE,
    TakenMessage,
    has_many_values_in_steps,
)
from rwt_interfaces.serialise.long_lists import plain, plain_lists
from rwt_interfaces.serialise.long_strings import (
    LARGE,
    LongString,
    Parts,
    RawText,
    Steps,
    finished,
    string_of,
    substituted,
)
from rwt_interfaces.serialise.splice import (
    LONG_TEXT,
    SplicedMessage,
    json_of_text,
    long_octets,
    long_text,
    put,
)

if TYPE_CHECKING:
    from rwt_interfaces.structs import BinaryForm, MessageType

_SEQUENCE_PATH = ("header", "seq")
#: What frames are made of: JSON, CBOR, the distribution's own serialisation, or plain objects, for which
#: :meth:`Payload.prepare` makes nothing.
Form = Literal["json", "cbor", "serialised", "plain"]
#: ROS time in nanoseconds.
Now = Callable[[], int]


class Payload:
    """One message of one type. Each form is made at most once, when it is first asked for, and shared.

    A message that arrived as JSON exactly as this project would send it keeps its bytes and nothing else: a
    server that only relays never builds an object from it. Make payloads with the ``from_…`` class methods.

    Attributes:
        type: the message's type.
        is_long: whether other forms of it take so long to make that :meth:`prepare` should make them.
    """

    __slots__ = ("_forms", "_json", "_json_parts", "_message", "_spliced", "_string", "is_long", "type")

    def __init__(
        self,
        message_type: MessageType,
        json: RawText | None,
        message: msgspec.Struct | None,
        string: LongString | None = None,
        spliced: SplicedMessage | None = None,
    ) -> None:
        self.type = message_type
        self._json = json
        self._message = message
        self._string = string
        self._spliced = spliced
        self._json_parts: Parts | None = None
        self._forms: dict[BinaryForm, Parts] | None = None
        self.is_long = False

    def __repr__(self) -> str:
        return f"<Payload {self.type.name}>"

    @classmethod
    def from_json(
        cls, message_type: MessageType, raw: RawText, now: Now | None = None, *, is_trusted: bool = False
    ) -> Payload:
        """Take a message as it came in JSON.

        Args:
            message_type: what the message should be.
            raw: the JSON text; kept as it is if it may be passed on untouched, and then not copied.
            now: ROS time in nanoseconds for headers without a stamp and for "now"; the wall clock by default.
            is_trusted: whether it may have any number of numbers that take long to be read.

        Raises:
            InvalidMessage: it does not fit, and where and why; no other exception, whatever the bytes.
        """
        if len(raw) >= LARGE:
            return finished(cls._in_steps(message_type, raw, now, is_trusted))
        # As _wholly does it, written out: most are exact, and this runs for each of them.
        try:
            message_type.json.check(raw)
        except REJECTIONS:
            return finished(cls._wholly(message_type, raw, now or time.time_ns))
        return cls(message_type, raw, None)

    @classmethod
    def from_exact_json(cls, message_type: MessageType, raw: bytes) -> Payload | None:
        """Take a short message as it came in JSON if it may be passed on untouched; None for any other
        text, whatever it is."""
        try:
            message_type.json.check(raw)
        except REJECTIONS:
            return None
        return cls(message_type, raw, None)

    @classmethod
    def from_dense_json(
        cls, message_type: MessageType, raw: RawText, now: Now | None = None
    ) -> Payload | None:
        """Take a message as it came in JSON without ever making plain objects of all that it holds.

        So it must be one that may be passed on untouched, or nearly all of it one long string.

        Returns:
            The message, or None if it is neither.

        Raises:
            InvalidMessage: what stands around a long string does not fit.
        """
        return finished(cls.from_dense_json_in_steps(message_type, raw, now))

    @classmethod
    def from_dense_json_in_steps(
        cls, message_type: MessageType, raw: RawText, now: Now | None = None
    ) -> Steps[Payload | None]:
        """As :meth:`from_dense_json`, in such steps as :meth:`from_json_in_steps` takes.

        Raises:
            InvalidMessage: as :meth:`from_dense_json`, from any step.
        """
        codec = message_type.json
        string = yield from codec.cut(raw)
        if string is not None and len(string.text) < LARGE:
            return (yield from cls._in_steps(message_type, raw, now, False))
        yield from require_quick_numbers(raw)
        taken = yield from codec.long_arrays.take(raw, now or time.time_ns, completes=False)
        if taken is not None:
            return (
                None if taken.short is None and not taken.is_exact else cls._taken(message_type, raw, taken)
            )
        if (yield from has_many_values_in_steps(raw)):
            return None
        try:
            codec.check(raw)
        except REJECTIONS:
            return None
        payload = cls(message_type, raw, None)
        payload.is_long = codec.has_arrays
        return payload

    @classmethod
    def from_json_in_steps(
        cls, message_type: MessageType, raw: RawText, now: Now | None = None
    ) -> Steps[Payload]:
        """As :meth:`from_json`, in steps of less than a millisecond where the text allows: a large one is
        mostly one long string or long arrays, which are looked at piece by piece.

        Raises:
            InvalidMessage: as :meth:`from_json`, from any step; or too many of its numbers take long.
        """
        return (yield from cls._in_steps(message_type, raw, now, False))

    @classmethod
    def _in_steps(
        cls, message_type: MessageType, raw: RawText, now: Now | None, is_trusted: bool
    ) -> Steps[Payload]:
        codec, now = message_type.json, now or time.time_ns
        string = yield from codec.cut(raw)
        if not is_trusted:
            yield from require_quick_numbers(raw if string is None else string.text)
        if string is not None:
            try:
                codec.check(string.text)
            except REJECTIONS:
                return cls._around_string(message_type, string, now)
            payload = cls(message_type, raw, None, string)
            payload.is_long = bool(string.unescaped) and len(string.content) >= LONG_TEXT
            return payload
        if len(raw) < 4 * PIECE:
            try:
                codec.check(raw)
            except REJECTIONS:
                pass
            else:
                return cls(message_type, raw, None)
        taken = yield from codec.long_arrays.take(raw, now)
        if taken is None:
            if (yield from has_many_values_in_steps(raw)):
                raise TooManyValues(
                    "", f"more than {MOST_VALUES} values: so many are taken only as items of long lists"
                )
            payload = yield from cls._wholly(message_type, raw, now)
            payload.is_long = codec.has_arrays
            return payload
        return cls._taken(message_type, raw, taken)

    @classmethod
    def _taken(cls, message_type: MessageType, raw: RawText, taken: TakenMessage) -> Payload:
        """A message that was taken apart from its long arrays."""
        payload = cls(message_type, raw if taken.is_exact else None, taken.value())
        if not taken.is_exact:
            payload._json_parts = taken.json_parts(message_type.json.encode)
        payload.is_long = True
        return payload

    @classmethod
    def _wholly(cls, message_type: MessageType, raw: RawText, now: Now) -> Steps[Payload]:
        """Take a message that cannot be looked at in pieces: its checks are the steps, none of which others
        have to wait for together with the next."""
        yield
        with suppress(*REJECTIONS):
            message_type.json.check(raw)
            return cls(message_type, raw, None)
        yield
        with suppress(*REJECTIONS):
            return cls(message_type, None, message_type.complete_quickly(raw, now))
        if (yield from has_many_values_in_steps(raw, MOST_LENIENT)):
            if begins_too_deep(raw):
                raise InvalidMessage("", "nested too deeply")
            raise TooManyValues(
                "",
                f"more than {MOST_LENIENT} values, and not as ROS writes it:"
                " so many are taken only as items of long lists",
            )
        yield
        parsed = parse(raw)
        yield
        return cls(message_type, None, message_type.decode_leniently(parsed, now))

    @classmethod
    def _around_string(cls, message_type: MessageType, string: LongString, now: Now) -> Payload:
        """A message that may not be passed on as it is; its long string may be."""
        complete = message_type.decode_leniently
        parsed = parse(string.text)
        with suppress(InvalidMessage):
            short = complete(parsed, now)
            spliced = SplicedMessage.from_string(message_type, short, string)
            if spliced is not None:
                return cls(message_type, None, None, None, spliced)
        # Whatever is wrong may lie in the long string, or say what it is.
        whole = substituted(parsed, string.token.decode(), string_of(string.content, string.unescaped))
        return cls(message_type, None, complete(whole, now))

    @classmethod
    def from_args(cls, message_type: MessageType, raw: RawText | None, now: Now | None = None) -> Payload:
        """Take a service's arguments: an object by name, a list by position, anything else is no arguments
        (SRV-02).

        Raises:
            InvalidMessage: as :meth:`from_json`.
        """
        if raw is None:
            return cls.from_value(message_type, {}, now)
        if bytes(raw[:1]) == b"{":
            return cls.from_json(message_type, raw, now)
        parsed = parse(raw)
        return cls.from_value(message_type, parsed if isinstance(parsed, (dict, list)) else {}, now)

    @classmethod
    def from_value(cls, message_type: MessageType, value: object, now: Now | None = None) -> Payload:
        """Take a message from Python: a Struct, a mapping, or a list of values by position (SRV-02).

        Checked and copied at once, so that what the caller does to `value` afterwards changes nothing.
        Numeric arrays may be numpy arrays, octets may be bytes. Missing fields of a mapping are completed as
        those of JSON are, headers stamped; a Struct always has all its fields, so its header keeps the stamp
        it has, zero or not.

        Raises:
            InvalidMessage: it does not fit, and where and why.
        """
        if isinstance(value, (list, tuple)):
            names = (slot.name for slot in message_type.slots)
            value = dict(zip(names, value, strict=False))
        codec = message_type.json
        try:
            payload = cls(message_type, None, codec.convert(value))
        except REJECTIONS:
            payload = cls(message_type, None, message_type.decode_leniently(value, now or time.time_ns))
        message = payload._known()
        holds_list = message_type.holds_long_list if codec.has_arrays else None
        payload.is_long = (holds_list is not None and holds_list(message)) or (
            bool(message_type.text_places) and long_text(message_type, message) is not None
        )
        return payload

    @classmethod
    def from_value_in_steps(
        cls, message_type: MessageType, value: dict[str, object], now: Now | None = None
    ) -> Steps[Payload]:
        """As :meth:`from_value` for a mapping, its long lists in steps.

        Raises:
            InvalidMessage: as :meth:`from_value`, from any step.
        """
        codec = message_type.json
        if codec.has_arrays:
            message = yield from codec.long_arrays.of_value(value, now or time.time_ns)
            if message is not None:
                payload = cls(message_type, None, message)
                payload.is_long = True
                return payload
        return cls.from_value(message_type, value, now)

    @classmethod
    def deserialised(cls, message_type: MessageType, data: bytes | memoryview) -> Payload:
        """Take a message in the serialisation of its type's distribution.

        Raises:
            InvalidMessage: it does not fit; no other exception, whatever the bytes.
        """
        return cls(message_type, None, message_type.deserialise(data))

    @classmethod
    def from_cdr(cls, message_type: MessageType, data: bytes | memoryview) -> Payload:
        """Take a message as it came in CDR, with its encapsulation header.

        Raises:
            InvalidMessage: it does not fit; no other exception, whatever the bytes.
        """
        return cls(message_type, None, message_type.from_cdr(data))

    @classmethod
    def relayed_cdr(cls, message_type: MessageType, data: bytes) -> Payload:
        """Take a message as it came in CDR without a look at it, so that one without readers costs nothing.

        If it does not fit its type, the first call of a method other than :meth:`cdr` raises
        :exc:`InvalidMessage`.
        """
        payload = cls(message_type, None, None)
        payload._forms = {"cdr": (data,)}
        return payload

    @classmethod
    def from_ros1(cls, message_type: MessageType, data: bytes | memoryview) -> Payload:
        """Take a message as it came in ROS 1's own form, without a length prefix.

        Raises:
            InvalidMessage: it does not fit; no other exception, whatever the bytes.
        """
        return cls(message_type, None, message_type.from_ros1(data))

    @property
    def is_passthrough(self) -> bool:
        """Whether it came in JSON, and is passed on in the very bytes."""
        return self._json is not None and self._message is None

    def json(self) -> RawText:
        """The message in JSON: the very bytes that came, if they came fit to be passed on."""
        if self._json is None:
            self._json = _joined(self.json_parts())
        return self._json

    def json_parts(self) -> Parts:
        """The bytes of :meth:`json` in one part or more, so that a long one is not copied."""
        if self._json is not None:
            return (self._json,)
        if self._json_parts is not None:
            return self._json_parts
        spliced = self._apart()
        if spliced is not None:
            return spliced.json(self.type.json.encode)
        self._json = self.type.json.encode(self._known())
        return (self._json,)

    def cbor(self) -> bytes:
        """The message in CBOR, without any envelope (CBR-02 to CBR-07)."""
        return self._whole("cbor")

    def cbor_parts(self) -> Parts:
        """The bytes of :meth:`cbor` in one part or more, so that a long one is not copied."""
        return self._made("cbor")

    def serialised(self) -> bytes:
        """The message in the serialisation of its type's distribution: CDR, or ROS 1's own form."""
        return self._whole(self.type.registry.distro.serialisation)

    def serialised_parts(self) -> Parts:
        """The bytes of :meth:`serialised` in one part or more, so that a long one is not copied."""
        return self._made(self.type.registry.distro.serialisation)

    def cdr(self) -> bytes:
        """The message in CDR, with its encapsulation header."""
        return self._whole("cdr")

    def prepare(self, forms: Iterable[Form]) -> Steps[None]:
        """Make forms of a message with long lists or a long text in steps; forms that exist already take
        none."""
        has_lists = self.type.json.has_arrays
        text: SplicedMessage | None = None
        for form in forms:
            if form == "plain":
                continue
            if form == "json":
                if self._json is None and self._json_parts is None and has_lists:
                    self._json_parts = yield from self.type.json.long_arrays.json(self._encodable())
                if self._json is None and self._json_parts is None:
                    self._json_parts = yield from self._text_in_steps()
                continue
            name = self.type.registry.distro.serialisation if form == "serialised" else form
            if self._forms is not None and name in self._forms:
                continue
            spliced = self._apart()
            if spliced is not None:
                yield from spliced.octets_in_steps()
            elif not has_lists:
                text = text or self._text_apart()
                if text is not None:
                    yield from text.octets_in_steps()
                    made = text.binary(*self.type.binary_encoder(name))
                    self._forms = {**(self._forms or {}), name: made}
            else:
                apart = None
                if self._message is None and (self._json is not None or self._json_parts is not None):
                    apart = yield from self.type.json.long_arrays.apart(self.json())
                short, lists = apart or (self._encodable(), {})
                made = yield from self.type.step_encoder(name)(short, lists)
                self._forms = {**(self._forms or {}), name: made}

    def _text_apart(self) -> SplicedMessage | None:
        message = self._message
        place = None if message is None else long_text(self.type, message)
        return None if place is None else SplicedMessage.from_text(self.value(), place)

    def _text_in_steps(self) -> Steps[Parts | None]:
        message = self._message
        place = None if message is None else long_text(self.type, message)
        return None if place is None else (yield from json_of_text(self.type, self.value(), place))

    def plain(self) -> object:
        """The message as dicts, lists and scalars, octets as bytes."""
        return plain(self._encodable())

    def plain_in_steps(self) -> Steps[object]:
        """What :meth:`plain` returns, long lists in steps; other messages take none."""
        if self.is_long:
            return (yield from plain_lists(self.type, self._encodable()))
        return self.plain()

    @property
    def size(self) -> int:
        """Bytes of the message in JSON."""
        return sum(map(len, self.json_parts()))

    def _whole(self, form: BinaryForm) -> bytes:
        parts = self._made(form)
        if len(parts) > 1:
            assert self._forms is not None  # It was made.
            self._forms[form] = parts = (b"".join(parts),)
        whole = parts[0]
        assert isinstance(whole, bytes)  # Only a part of several is a view.
        return whole

    def _made(self, form: BinaryForm) -> Parts:
        if self._forms is None:
            self._forms = {}
        made = self._forms.get(form)
        if made is None:
            spliced = self._apart()
            encode, length_head = self.type.binary_encoder(form)
            made = (encode(self._encodable()),) if spliced is None else spliced.binary(encode, length_head)
            self._forms[form] = made
        return made

    def _apart(self) -> SplicedMessage | None:
        """The message in two parts, if most of it is one long string or octets."""
        if self._spliced is None and self.type.places:
            if self._string is not None:
                self._spliced = self._of_string(self._string)
                self._string = None
            elif self._message is not None or (self._json is None and self._json_parts is None):
                place = long_octets(self.type, self._encodable())
                self._spliced = None if place is None else SplicedMessage.from_octets(self.value(), place)
        return self._spliced

    def _of_string(self, string: LongString) -> SplicedMessage | None:
        return SplicedMessage.from_string(self.type, self.type.json.decode(string.text), string)

    def value(self) -> msgspec.Struct:
        """The message as its type's Struct. It is shared: treat it as read-only.

        Raises:
            InvalidMessage: the message was relayed as CDR, and does not fit.
        """
        message = self._message
        if message is None:
            message = self._message = self._decoded()
        elif message.__class__ is not self.type.struct:
            message = self._message = self._own_struct(message)
        return message

    @property
    def kept_size(self) -> int:
        """About how many bytes the message takes to be kept, in the form that it has now."""
        if self._json is not None:
            return len(self._json)
        if self._forms:
            return max(sum(map(len, parts)) for parts in self._forms.values())
        if self._json_parts is not None:
            return sum(map(len, self._json_parts))
        if self._spliced is not None:
            return self._spliced.kept_size
        return self.type.sizes([self._message])

    def detach(self) -> Payload:
        """The same message without a view of the buffer it was received in, for keeping."""
        if isinstance(self._json, memoryview):
            raw = bytes(self._json)
            string = None if self._string is None else self._string.moved(raw)
            return self._like(Payload(self.type, raw, self._message, string))
        if self._json_parts is not None:
            return self._like(Payload(self.type, bytes(self.json()), self._message))
        if self._spliced is not None:
            return Payload(self.type, self._json, self._message, None, self._spliced.detached())
        return self

    def forget_forms(self) -> None:
        """Have the message in one form alone again; the others are made anew when they are asked for."""
        if self._json is not None:
            self._message = self._forms = None
        elif self._message is not None or self._spliced is not None:
            self._forms = None

    def numbered(self, number: int) -> Payload:
        """The same message with that `header.seq`, of a type that has it."""
        parts = (self._json,) if self._json is not None else self._json_parts
        found = None if parts is None or self._string is not None else SEQUENCE.match(parts[0])
        if parts is None or found is None:
            spliced = self._apart()
            if spliced is not None:
                return Payload(self.type, None, None, None, spliced.numbered(number))
            return Payload(self.type, None, put(self.value(), _SEQUENCE_PATH, number))
        start, end = found.span(1)
        first = memoryview(parts[0])
        before = b"".join((first[:start], b"%d" % number))
        if len(first) < LARGE and len(parts) == 1:
            return Payload(self.type, before + first[end:], None)
        known = None if self._message is None else put(self.value(), _SEQUENCE_PATH, number)
        payload = self._like(Payload(self.type, None, known))
        payload._json_parts = (before, first[end:], *parts[1:])
        return payload

    def _like(self, other: Payload) -> Payload:
        other.is_long = self.is_long
        return other

    def _own_struct(self, message: msgspec.Struct) -> msgspec.Struct:
        try:
            return msgspec.convert(message, self.type.struct, from_attributes=True)
        except msgspec.ValidationError:
            # It has a None for a float, which the lenient decoder makes NaN.
            own: msgspec.Struct = self.type.decode_leniently(message, time.time_ns)
            return own

    def _encodable(self) -> msgspec.Struct:
        """The message in a Struct that every encoder takes."""
        message = self._message
        if message is not None and message.__class__ is self.type.json.sendable:
            return message
        return self.value()

    def _known(self) -> msgspec.Struct:
        return self._message if self._message is not None else self.value()

    def _decoded(self) -> msgspec.Struct:
        spliced = self._spliced or (self._apart() if self._string is not None else None)
        if spliced is not None:
            return spliced.value()
        if self._json is not None or self._json_parts is not None:
            return self.type.json.decode(self.json())
        assert self._forms is not None  # A payload has its text, its message or its CDR from the start.
        return self.type.from_cdr(_joined(self._forms["cdr"]))


def _joined(parts: Parts) -> RawText:
    return parts[0] if len(parts) == 1 else b"".join(parts)
