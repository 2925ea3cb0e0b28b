"""Message of one type, in all forms requested so far."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Final, Literal

import msgspec

from rwt_interfaces.errors import InvalidMessage, NotExact, TooManyValues
from rwt_interfaces.serialise.json import (
    MAX_LENIENT_VALUES,
    MAX_VALUES,
    REJECTIONS,
    SEQUENCE,
    Unsplittable,
    begins_too_deep,
    has_many_values,
    parse,
    require_quick_numbers,
)
from rwt_interfaces.serialise.long_lists import plain, plain_lists
from rwt_interfaces.serialise.long_strings import LongString, Parts, RawText, string_of, substituted
from rwt_interfaces.serialise.splice import (
    LONG_TEXT_CHARS,
    LongField,
    SplicedMessage,
    json_of_text,
    long_octets,
    long_text,
    put,
    without_views,
)
from rwt_interfaces.steps import Steps, finished
from rwt_interfaces.validation.lenient_decoder import Completion

if TYPE_CHECKING:
    from rwt_interfaces.serialise.large_json import LargeJson
    from rwt_interfaces.structs import BinaryForm, MessageType

LONG_STRING_BYTES: Final = 4096
"""Minimum size of a JSON text whose long string is kept separate."""
LARGE_BYTES: Final = 64 * 1024
"""Minimum size of a JSON text for :meth:`Payload.from_json_in_steps`."""
WHOLE_BYTES: Final = 384 * 1024
"""Maximum size of a JSON text that is checked at once, to be passed on untouched.

Checking 1 MB takes, in ms on the benchmark machine: LaserScan 6.2, OccupancyGrid 5.5, String with escapes
4.0, Path 1.7, Image and PointCloud2 0.5, String 0.2. So 384 KiB take at most 2.5 ms, or 10 ms on a board four
times slower.
"""
SLOW_BYTES: Final = 64 * 1024
"""Maximum size of a JSON text that is completed at once; 1 MB takes up to 40 ms."""
LONG_FORMS_BYTES: Final = 128 * 1024
"""Minimum size of a JSON text with arrays whose other forms are made in steps."""

_NULL: Final = re.compile(b"null")
_CHECKED_BYTES: Final = 32 * 1024
"""Maximum size of a JSON text whose checked Struct is kept for other forms: numbers take up to 16 times as
much memory."""

_SEQUENCE_PATH = ("header", "seq")
Form = Literal["json", "cbor", "serialised", "plain"]
"""Payload representation of frames; :meth:`Payload.prepare` makes nothing for `plain`."""
Now = Callable[[], int]
"""ROS time in nanoseconds."""


class Payload(msgspec.Struct, eq=False):
    """Checked message of one type, in one or more forms.

    Forms are made on first use and shared by all readers. Exact JSON keeps its bytes and nothing else, so a
    relaying server never builds objects. Make payloads with the ``from_…`` class methods.

    Invariant: at least one form exists: ``_json`` (with ``_string``, if most of the text is one long string),
    ``_json_parts``, ``_message``, ``_spliced``, or a relayed form in ``_forms``.

    Attributes:
        is_long: True if other forms should be made in steps, by :meth:`prepare`.
        checked: small text with arrays as :meth:`MessageJson.check` returned it, so that other forms need not
            read it again. A retained message has none.
    """

    type: MessageType
    _json: RawText | None
    _message: msgspec.Struct | None = None
    _string: LongString | None = None
    _spliced: SplicedMessage | None = None
    _json_parts: Parts | None = None
    _forms: dict[BinaryForm, Parts] | None = None
    is_long: bool = False
    checked: msgspec.Struct | None = None

    def __repr__(self) -> str:
        return f"<Payload {self.type.name}>"

    @classmethod
    def from_json(
        cls, message_type: MessageType, raw: RawText, now: Now | None = None, *, is_trusted: bool = False
    ) -> Payload:
        """Check a JSON message, and complete it if necessary.

        Args:
            message_type: expected type.
            raw: JSON text. It is kept without a copy if it may be passed on untouched.
            now: ROS time in nanoseconds, for headers without a stamp and for "now". Default: the wall clock.
            is_trusted: True to accept any number of slow numbers.

        Raises:
            InvalidMessage: the message does not fit. No other exception is raised, whatever the bytes.
        """
        if len(raw) < LONG_STRING_BYTES:
            codec = message_type.json
            try:
                checked = codec.check(raw)
            except REJECTIONS:
                message = finished(_completed(message_type, raw, now or time.time_ns))
                return cls(message_type, None, message)
            return cls(message_type, raw, checked=checked) if codec.has_arrays else cls(message_type, raw)
        return finished(cls.from_json_in_steps(message_type, raw, now, is_trusted=is_trusted))

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
        codec, now = message_type.json, now or time.time_ns
        # From cheap to expensive, so that exact messages pay for nothing else: around a long string; as a
        # whole, up to `WHOLE_BYTES`; around exact arrays; completed by msgspec; completed value by value, of
        # which there may be fewer. An attempt returns, or leaves the text to the next one.
        string = yield from codec.cut(raw)
        if string is not None and is_dense and len(string.text) >= LONG_STRING_BYTES:
            string = None
        # Before any decoder reads a number: a text of slow ones would block the event loop for seconds.
        if not is_trusted:
            yield from require_quick_numbers(raw if string is None else string.text)
        if string is not None:
            try:
                codec.check(string.text)
            except REJECTIONS:
                return _around_string(message_type, string, now)
            is_long = bool(string.unescaped) and len(string.content) >= LONG_TEXT_CHARS
            return cls(message_type, raw, None, string, is_long=is_long)
        is_long = codec.has_arrays and len(raw) >= LONG_FORMS_BYTES
        if len(raw) <= WHOLE_BYTES:
            try:
                checked = codec.check(raw)
            except REJECTIONS:
                if is_dense:
                    raise NotExact from None
            else:
                kept = checked if codec.has_arrays and len(raw) <= _CHECKED_BYTES else None
                return cls(message_type, raw, is_long=is_long, checked=kept)
        if len(raw) > SLOW_BYTES and codec.has_lists:
            large = yield from message_type.large_json.split(raw)
            if large is not None:
                with suppress(Unsplittable):
                    return (yield from _split(message_type, raw, large, now, is_dense=is_dense))
        if len(raw) > WHOLE_BYTES:
            if (yield from has_many_values(raw)):
                if is_dense:
                    raise NotExact
                raise TooManyValues(
                    "", f"more than {MAX_VALUES} values: so many are taken only as items of long lists"
                )
            yield
            with suppress(*REJECTIONS):
                codec.check(raw)
                return cls(message_type, raw, is_long=is_long)
            if is_dense:
                raise NotExact
        message = yield from _completed(message_type, raw, now)
        return cls(message_type, None, message, is_long=is_long)

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
        return cls(message_type, None, message, is_long=is_long)

    @classmethod
    def from_value_in_steps(
        cls, message_type: MessageType, value: dict[str, object], now: Now | None = None
    ) -> Steps[Payload]:
        """Same as :meth:`from_value` for a mapping, long lists in steps; raises InvalidMessage."""
        message = yield from message_type.large_json.complete_values(value, now or time.time_ns)
        if message is None:
            return cls.from_value(message_type, value, now)
        return cls(message_type, None, message, is_long=True)

    @classmethod
    def deserialised(cls, message_type: MessageType, data: bytes | memoryview) -> Payload:
        """Decode a message in its distribution's serialisation; raises only InvalidMessage."""
        return cls(message_type, None, message_type.deserialise(data))

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
        return cls(message_type, None, message_type.from_cdr(data))

    @classmethod
    def relayed_cdr(cls, message_type: MessageType, data: bytes) -> Payload:
        """Wrap a message in CDR without checking it, so that it costs nothing without readers.

        If it does not fit its type, the first call of a method other than :meth:`cdr` raises
        :exc:`InvalidMessage`.
        """
        return cls(message_type, None, None, None, None, None, {"cdr": (data,)}, _is_long(message_type, data))

    @classmethod
    def relayed_ros1(cls, message_type: MessageType, data: bytes | memoryview) -> Payload:
        """Same as :meth:`relayed_cdr`, for ROS 1's serialisation and a type of ROS 1.

        A view must not change while the message, or what was made of it, exists.
        """
        return cls(
            message_type, None, None, None, None, None, {"ros1": (data,)}, _is_long(message_type, data)
        )

    @classmethod
    def from_ros1(cls, message_type: MessageType, data: bytes | memoryview) -> Payload:
        """Decode a message in ROS 1's serialisation, without a length prefix; raises only InvalidMessage."""
        return cls(message_type, None, message_type.from_ros1(data))

    @classmethod
    def from_ros1_in_steps(cls, message_type: MessageType, data: bytes | memoryview) -> Steps[Payload]:
        """Same as :meth:`from_ros1`, long lists in steps."""
        message = yield from message_type.deserialise_in_steps(data)
        is_long = _is_long(message_type, data)
        return cls(message_type, None, without_views(message_type, message), is_long=is_long)

    @property
    def is_passthrough(self) -> bool:
        """True if the message arrived as JSON and is passed on untouched."""
        return self._json is not None and self._message is None

    @property
    def received_json(self) -> RawText | None:
        """JSON text that is passed on untouched; None if the message has none."""
        return self._json

    @property
    def is_decoded(self) -> bool:
        """True if :meth:`value` has nothing to decode."""
        return self._message is not None

    def json(self) -> RawText:
        """Return the message in JSON: the received bytes, if they may be passed on."""
        json = self._json
        if json is None:
            parts = self.json_parts()
            json = self._json = parts[0] if len(parts) == 1 else b"".join(parts)
        return json

    def json_parts(self) -> Parts:
        """Return :meth:`json` in parts, so that long messages are not copied."""
        if self._json is not None:
            return (self._json,)
        if self._json_parts is not None:
            return self._json_parts
        type = self.type
        spliced = self._apart() if type.long_fields else None
        if spliced is not None:
            return spliced.json(type.json.encode)
        self._json = type.json.encode(self._message or self.value())
        return (self._json,)

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
        has_lists = self.type.json.has_arrays
        text: SplicedMessage | None = None
        for form in forms:
            if form == "plain":
                continue
            if form == "json":
                yield from self._decode_in_steps()
                if self._spliced is not None:
                    continue
                if self._json is None and self._json_parts is None and has_lists:
                    self._json_parts = yield from self.type.large_json.encode(self._encodable())
                if self._json is None and self._json_parts is None:
                    field = self._long_text()
                    if field is not None:
                        self._json_parts = yield from json_of_text(self.type, self.value(), field)
                continue
            name = self.type.registry.distro.serialisation if form == "serialised" else form
            if self._forms is not None and name in self._forms:
                continue
            yield from self._decode_in_steps()
            spliced = self._apart()
            if spliced is not None:
                yield from spliced.octets_in_steps()
            elif not has_lists:
                field = self._long_text()
                if field is not None:
                    text = text or SplicedMessage.from_text(self.value(), field)
                    yield from text.octets_in_steps()
                    made = text.binary(*self.type.binary_encoder(name))
                    self._forms = {**(self._forms or {}), name: made}
            else:
                large = None
                if self._message is None and (self._json is not None or self._json_parts is not None):
                    large = yield from self.type.large_json.split(self.json())
                short, lists = (self._encodable(), {}) if large is None else (yield from large.apart())
                made = yield from self.type.step_encoder(name)(short, lists)
                self._forms = {**(self._forms or {}), name: made}

    def _decode_in_steps(self) -> Steps[None]:
        """Decode a relayed message with long lists in steps; others take none."""
        if self.is_long and self.is_relayed:
            message = yield from self.type.deserialise_in_steps(self._serialised())
            holds_list = self.type.holds_long_list
            if holds_list is None or not holds_list(message):
                self._take_views(message)
            else:
                self._message = without_views(self.type, message)

    def _take_views(self, message: msgspec.Struct) -> None:
        found = SplicedMessage.from_views(self.type, message)
        if isinstance(found, SplicedMessage):
            self._spliced = found
        else:
            self._message = found

    def _long_text(self) -> LongField | None:
        return None if self._message is None else long_text(self.type, self._message)

    def plain(self) -> object:
        """Return the message as dicts, lists and scalars, octets as bytes."""
        return plain(self._encodable())

    def plain_in_steps(self) -> Steps[object]:
        """Same as :meth:`plain`, long lists in steps; other messages take none."""
        if self.is_long:
            yield from self._decode_in_steps()
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
        assert self._forms is not None  # Made above.
        whole = b"".join(parts)
        self._forms[form] = (whole,)
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
        """Return the message in two parts if most of it is one long string or octets."""
        if self._spliced is None and self.type.long_fields:
            if self._string is not None:
                short = self.type.json.decode(self._string.text)
                self._spliced = SplicedMessage.from_string(self.type, short, self._string)
                self._string = None
            elif self.is_relayed and self.type.long_octets_fields:
                self._take_views(self.type.deserialise_views(self._serialised()))
            elif self._message is not None or (self._json is None and self._json_parts is None):
                field = long_octets(self.type, self._encodable())
                self._spliced = None if field is None else SplicedMessage.from_octets(self.value(), field)
        return self._spliced

    def value(self) -> msgspec.Struct:
        """Return the message as its type's Struct. It is shared: treat it as read-only.

        Raises:
            InvalidMessage: the message was relayed and does not fit.
        """
        message = self._message
        if message is None:
            raw = self._json
            if raw is None or self._string is not None:
                message = self._decoded()
            else:
                checked = None if self.checked is None else self._without_nulls()
                message = self.type.json.decode(raw) if checked is None else self._own_struct(checked)
            self._message = message
        elif message.__class__ is not self.type.struct:
            message = self._message = self._own_struct(message)
        return message

    @property
    def kept_size(self) -> int:
        """Approximate bytes of the message in its present forms."""
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
        """Return the message without references to the receive buffer, for retaining it."""
        if isinstance(self._json, memoryview):
            raw = bytes(self._json)
            string = None if self._string is None else self._string.moved(raw)
            return Payload(self.type, raw, self._message, string, is_long=self.is_long)
        self.checked = None
        if self._json_parts is not None:
            return Payload(self.type, bytes(self.json()), self._message, is_long=self.is_long)
        if self._spliced is not None:
            return Payload(self.type, self._json, self._message, None, self._spliced.detached())
        forms = self._forms or {}
        if any(isinstance(part, memoryview) for parts in forms.values() for part in parts):
            is_only = self._json is None and self._message is None
            own: dict[BinaryForm, Parts] = {form: (b"".join(parts),) for form, parts in forms.items()}
            kept = own if is_only else None
            return Payload(self.type, self._json, self._message, None, None, None, kept, self.is_long)
        return self

    def forget_forms(self) -> None:
        """Drop all forms but one; others are made again on use."""
        if self._json is not None:
            self._message = self._forms = None
        elif self._message is not None or self._spliced is not None:
            self._forms = None

    def numbered(self, number: int) -> Payload:
        """Return the message with that `header.seq`; its type must have one."""
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
        if len(first) < LONG_STRING_BYTES and len(parts) == 1:
            return Payload(self.type, before + first[end:])
        known = None if self._message is None else put(self.value(), _SEQUENCE_PATH, number)
        numbered = (before, first[end:], *parts[1:])
        return Payload(self.type, None, known, None, None, numbered, is_long=self.is_long)

    def _own_struct(self, message: msgspec.Struct) -> msgspec.Struct:
        try:
            return msgspec.convert(message, self.type.struct, from_attributes=True)
        except msgspec.ValidationError:
            # A None in a float field becomes NaN in the lenient decoder.
            own: msgspec.Struct = self.type.decode_leniently(message, time.time_ns)
            return own

    def _encodable(self) -> msgspec.Struct:
        message = self._message
        if message is None:
            return self._without_nulls() or self.value()
        return message if message.__class__ is self.type.json.sendable else self.value()

    def _without_nulls(self) -> msgspec.Struct | None:
        """Return the checked Struct if no float can be None in it, as encoders require."""
        return None if self.checked is None or _NULL.search(self._json or b"") else self.checked

    def _decoded(self) -> msgspec.Struct:
        spliced = self._spliced or (self._apart() if self._string is not None else None)
        if spliced is not None:
            return spliced.value()
        if self._json is not None or self._json_parts is not None:
            return self.type.json.decode(self.json())
        return self.type.deserialise(self._serialised())

    @property
    def is_relayed(self) -> bool:
        """True if only a relayed form exists."""
        return (
            self._json is None
            and self._message is None
            and self._spliced is None
            and self._json_parts is None
        )

    def _serialised(self) -> RawText:
        assert self._forms is not None  # Invariant: text, message or a relayed form exists.
        parts = self._forms[self.type.registry.distro.serialisation]
        return parts[0] if len(parts) == 1 else b"".join(parts)


def _is_long(message_type: MessageType, data: bytes | memoryview) -> bool:
    return len(data) >= LONG_FORMS_BYTES and (
        message_type.json.has_arrays or bool(message_type.long_text_fields)
    )


def _split(
    message_type: MessageType, raw: RawText, large: LargeJson, now: Now, *, is_dense: bool
) -> Steps[Payload]:
    """Decode a message in chunks of its long arrays; raises Unsplittable."""
    is_large, is_long = len(raw) > WHOLE_BYTES, len(raw) >= LONG_FORMS_BYTES
    # The check of a smaller message has failed, so if its arrays are exact, what is around them is not.
    is_exact_around = is_large and (yield from large.is_exact_around())
    if (is_exact_around or not is_dense) and (yield from large.has_exact_arrays()):
        if is_exact_around and large.has_sequence_first:
            return Payload(message_type, raw, is_long=is_long)
        # In the first part, a publisher can replace `header.seq` without a copy of the rest.
        parts = yield from large.around_arrays(now)
        return Payload(message_type, None, None, None, None, parts, is_long=is_long)
    if is_dense:
        raise NotExact
    if not is_large:
        yield
        with suppress(*REJECTIONS):
            return Payload(message_type, None, message_type.complete_quickly(raw, now), is_long=is_long)
    message = yield from large.complete(Completion(now))
    return Payload(message_type, None, message, is_long=is_long)


def _completed(message_type: MessageType, raw: RawText, now: Now) -> Steps[msgspec.Struct]:
    """Complete a message as a whole; each attempt is a step."""
    yield
    with suppress(*REJECTIONS):
        return message_type.complete_quickly(raw, now)
    if (yield from has_many_values(raw, MAX_LENIENT_VALUES)):
        if begins_too_deep(raw):
            raise InvalidMessage("", "nested too deeply")
        raise TooManyValues(
            "",
            f"more than {MAX_LENIENT_VALUES} values, and not as ROS writes it:"
            " so many are taken only as items of long lists",
        )
    yield
    parsed = parse(raw)
    yield
    message: msgspec.Struct = message_type.decode_leniently(parsed, now)
    return message


def _around_string(message_type: MessageType, string: LongString, now: Now) -> Payload:
    """Complete a message around its long string, which may be passed on as it is."""
    complete = message_type.decode_leniently
    parsed = parse(string.text)
    with suppress(InvalidMessage):
        short = complete(parsed, now)
        spliced = SplicedMessage.from_string(message_type, short, string)
        if spliced is not None:
            return Payload(message_type, None, None, None, spliced)
    # The error may lie in the long string, or quote it.
    whole = substituted(parsed, string.token.decode(), string_of(string.content, string.unescaped))
    return Payload(message_type, None, complete(whole, now))
