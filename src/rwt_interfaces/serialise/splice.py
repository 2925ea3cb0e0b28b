"""Messages that are mostly one long string or octets.

Encodings are made of a short message with a token, and the long content replaces the token. The content is
neither decoded nor copied, except between base64 and octets, once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import copy
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import msgspec
import pybase64

from rwt_interfaces import field_types
from rwt_interfaces.serialise.long_strings import (
    CutText,
    Parts,
    RawText,
    string_of,
    token_for_base64,
    token_for_text,
)
from rwt_interfaces.steps import Steps

if TYPE_CHECKING:
    from rwt_interfaces.structs import MessageType

#: Minimum bytes of separate octets of a message in Python.
LONG_OCTETS_BYTES = 1 << 14
#: Minimum characters of a string that is encoded as JSON in steps, and characters per step.
LONG_TEXT_CHARS = 1 << 18
_TEXT_STEP_CHARS = 1 << 16

_encode_text = msgspec.json.Encoder().encode

LengthHead = Callable[[int, bool], bytes]
"""Head of a content of some length in an encoding; True for text."""


class LongField:
    """Field for long content: not in an array, of unbounded length, and not a wide string."""

    def __init__(self, attributes: tuple[str, ...], is_text: bool) -> None:
        self._attributes = attributes
        self.is_text = is_text
        self.fetch: Callable[[Any], Any] = attrgetter(".".join(attributes))

    def put(self, message: msgspec.Struct, content: str | bytes) -> msgspec.Struct:
        """Return a copy of a message with another value in this field; all else is shared."""
        return put(message, self._attributes, content)


def put(
    message: msgspec.Struct, attributes: tuple[str, ...], content: str | bytes | int | list[Any]
) -> msgspec.Struct:
    """Return a copy of a message with another value at a path of attributes."""
    first, *rest = attributes
    new = put(getattr(message, first), tuple(rest), content) if rest else content
    return msgspec.structs.replace(message, **{first: new})


def long_fields(message: MessageType) -> Iterator[LongField]:
    """Yield the long fields of a message, in their order."""
    for path, field_type in field_types.leaves(message):
        match field_type:
            case field_types.Octets(length=None) | field_types.String(bound=None, wide=False):
                yield LongField(field_types.attributes(path), isinstance(field_type, field_types.String))


def long_text(type: MessageType, message: msgspec.Struct) -> LongField | None:
    """Return the first field of a Python message with a string to be encoded in steps."""
    return next((each for each in type.long_text_fields if len(each.fetch(message)) >= LONG_TEXT_CHARS), None)


def long_octets(type: MessageType, message: msgspec.Struct) -> LongField | None:
    """Return the first field of a Python message with separate octets."""
    long = (each for each in type.long_octets_fields if len(each.fetch(message)) >= LONG_OCTETS_BYTES)
    return next(long, None)


def without_views(type: MessageType, message: msgspec.Struct) -> msgspec.Struct:
    """Return a message whose long octets are bytes, not views."""
    for field in type.long_octets_fields:
        octets = field.fetch(message)
        if isinstance(octets, memoryview):
            message = field.put(message, bytes(octets))
    return message


def encode_long_text(type: MessageType, message: msgspec.Struct, field: LongField) -> Steps[Parts]:
    """Encode a message as JSON, the long text of one field in steps.

    The message is encoded with a token in that field. The encoded text then takes the token's place.

    Returns:
        The bytes before the text, the text without its quotes, and the bytes after it.
    """
    text: str = field.fetch(message)
    token = token_for_text(len(text))
    before, _, after = type.json.encode(field.put(message, token.decode())).partition(token)
    # Escapes stand for single characters, so the pieces encode to the same bytes as the whole text.
    encoded: list[bytes] = []
    for start in range(0, len(text), _TEXT_STEP_CHARS):
        quoted = _encode_text(text[start : start + _TEXT_STEP_CHARS])
        encoded.append(quoted[1:-1])
        yield
    return before, b"".join(encoded), after


class SplicedMessage:
    """Message in two parts: a short message with a token in one field, and that field's content."""

    __slots__ = ("_content", "_field", "_octets", "_short", "_token", "_unescaped")

    def __init__(
        self,
        short: msgspec.Struct,
        field: LongField,
        token: bytes,
        content: RawText | None,
        octets: RawText | None = None,
        unescaped: tuple[str, ...] = (),
    ) -> None:
        self._short = short
        self._field = field
        self._token = token
        self._content = content
        self._octets = octets
        self._unescaped = unescaped

    @classmethod
    def from_cut(cls, type: MessageType, short: msgspec.Struct, cut: CutText) -> SplicedMessage | None:
        """Return a message whose text was cut; None if the token is not in a long field of the type.

        Args:
            type: type of the message.
            short: message decoded from the short text, which holds the token.
            cut: text with its long string.
        """
        text = cut.token.decode()
        # In a field of octets the short message holds the decoded token.
        octets = pybase64.b64decode(cut.token) if cut.is_base64 else None
        for field in type.long_fields:
            if field.fetch(short) == (text if field.is_text else octets):
                return cls(short, field, cut.token, cut.content, None, cut.unescaped)
        return None

    @classmethod
    def from_octets(cls, message: msgspec.Struct, field: LongField) -> SplicedMessage:
        """Return a message of Python with long octets in one field, which may be a view."""
        octets: RawText = field.fetch(message)
        token = token_for_base64((len(octets) + 2) // 3 * 4, -len(octets) % 3)
        return cls(field.put(message, pybase64.b64decode(token)), field, token, None, octets)

    @classmethod
    def from_views(cls, type: MessageType, message: msgspec.Struct) -> SplicedMessage | msgspec.Struct:
        """Return a message whose long octets may be views; in two parts if it has long octets."""
        field = long_octets(type, message)
        if field is None:
            return message
        spliced = cls.from_octets(message, field)
        spliced._short = without_views(type, spliced._short)
        return spliced

    @classmethod
    def from_text(cls, message: msgspec.Struct, field: LongField) -> SplicedMessage:
        """Return a message of Python with a long text in one field, for :meth:`binary` forms only."""
        text: str = field.fetch(message)
        token = token_for_text(len(text))
        return cls(field.put(message, token.decode()), field, token, None, None, (text,))

    @property
    def content(self) -> RawText:
        """Content as quoted in JSON; octets are encoded once."""
        if self._content is None:
            self._content = pybase64.b64encode(self.octets)
        return self._content

    @property
    def octets(self) -> RawText:
        """Octets of base64 or of a text with escapes; decoded once."""
        if self._octets is None and self._unescaped:
            self._octets = "".join(self._unescaped).encode()
        elif self._octets is None:
            assert self._content is not None  # Invariant: one of the two exists.
            self._octets = pybase64.b64decode(self._content, validate=True)
        return self._octets

    def prepare_octets(self) -> Steps[None]:
        """Make the :attr:`octets` of a text with escapes in steps."""
        if self._octets is None and self._unescaped:
            pieces: list[bytes] = []
            for text in self._unescaped:
                for start in range(0, len(text), _TEXT_STEP_CHARS):
                    pieces.append(text[start : start + _TEXT_STEP_CHARS].encode())
                    yield
            self._octets = b"".join(pieces)

    @property
    def kept_size(self) -> int:
        """Approximate bytes of the content in its present forms."""
        return len(self._content or b"") + len(self._octets or b"")

    def numbered(self, number: int) -> SplicedMessage:
        """Return the same message with that `header.seq`."""
        numbered = copy(self)
        numbered._short = put(self._short, ("header", "seq"), number)
        return numbered

    def value(self) -> msgspec.Struct:
        """Return the whole message."""
        is_text = self._field.is_text
        content = string_of(self.content, self._unescaped) if is_text else bytes(self.octets)
        return self._field.put(self._short, content)

    def json(self, encode: Callable[[msgspec.Struct], bytes]) -> Parts:
        """Return the parts of the message in JSON."""
        before, _, after = encode(self._short).partition(self._token)
        return before, self.content, after

    def binary(self, encode: Callable[[msgspec.Struct], bytes], length_head: LengthHead) -> Parts:
        """Return the parts of the message in an encoding with length heads."""
        short, is_text = self._short, self._field.is_text
        content: RawText
        if not is_text:
            content, token = self.octets, pybase64.b64decode(self._token)
        elif not self._unescaped:
            content, token = self.content, self._token
        else:
            content = self.octets
            token = token_for_text(len(content))
            short = self._field.put(short, token.decode())
        before, _, after = encode(short).partition(token)
        short_head = length_head(len(token), is_text)
        return before.removesuffix(short_head) + length_head(len(content), is_text), content, after

    def detached(self) -> SplicedMessage:
        """Return the message without references to the receive buffer."""
        if not isinstance(self._content, memoryview) and not isinstance(self._octets, memoryview):
            return self
        detached = copy(self)
        detached._content = None if self._content is None else bytes(self._content)
        detached._octets = None if self._octets is None else bytes(self._octets)
        return detached
