"""Messages of which nearly all is one long string, or octets: every encoding is made of a short message with
a token in the place of the long content, which is then put between the two parts that the token leaves.

Nobody decodes or copies the content for that, except from base64 to octets or back, once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import msgspec
import pybase64

from rwt_interfaces import field_types
from rwt_interfaces.serialise.long_strings import (
    LongString,
    Parts,
    RawText,
    string_of,
    token_for_base64,
    token_for_text,
)
from rwt_interfaces.steps import Steps

if TYPE_CHECKING:
    from rwt_interfaces.structs import MessageType

#: Octets of a message in Python stand apart from this size on.
LONG_OCTETS = 1 << 14
#: Characters of a text from which it is written as JSON in steps, and of one step.
LONG_TEXT = 1 << 18
_TEXT_STEP = 1 << 16

_encode_text = msgspec.json.Encoder().encode

LengthHead = Callable[[int, bool], bytes]
"""What stands before a content of some length in an encoding; True for text."""


class Place:
    """A field where long content may stand: not in an array, of any length, and no wide string.

    Attributes:
        is_text: whether it is a string; else octets.
        fetch: takes its value out of a message.
    """

    __slots__ = ("_attributes", "fetch", "is_text")

    def __init__(self, attributes: tuple[str, ...], is_text: bool) -> None:
        self._attributes = attributes
        self.is_text = is_text
        self.fetch: Callable[[Any], Any] = attrgetter(".".join(attributes))

    def put(self, message: msgspec.Struct, content: str | bytes) -> msgspec.Struct:
        """A copy of a message with something else in this place; all else is shared."""
        return put(message, self._attributes, content)


def put(
    message: msgspec.Struct, attributes: tuple[str, ...], content: str | bytes | int | list[Any]
) -> msgspec.Struct:
    """A copy of a message with something else in the field that a path of attributes leads to."""
    first, *rest = attributes
    new = put(getattr(message, first), tuple(rest), content) if rest else content
    return msgspec.structs.replace(message, **{first: new})


def places(message: MessageType) -> Iterator[Place]:
    """The places of a message, in the order of its fields."""
    for attributes, is_text in _places(message, ()):
        yield Place(attributes, is_text)


def _places(message: MessageType, prefix: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], bool]]:
    for slot in message.slots:
        path = (*prefix, slot.attribute)
        match slot.type:
            case field_types.Message():
                yield from _places(slot.type.type, path)
            case field_types.Octets(length=None):
                yield path, False
            case field_types.String(bound=None, wide=False):
                yield path, True


def long_text(type: MessageType, message: msgspec.Struct) -> Place | None:
    """The first place where a message in Python has a text so long that it is written in steps."""
    for place in type.text_places:
        if len(place.fetch(message)) >= LONG_TEXT:
            return place
    return None


def long_octets(type: MessageType, message: msgspec.Struct) -> Place | None:
    """The first place where a message in Python has octets so long that they stand apart."""
    for place in type.places:
        if not place.is_text and len(place.fetch(message)) >= LONG_OCTETS:
            return place
    return None


def json_of_text(type: MessageType, message: msgspec.Struct, place: Place) -> Steps[Parts]:
    """A message in JSON, the long text in one of its places written in steps."""
    text: str = place.fetch(message)
    token = token_for_text(len(text))
    before, _, after = type.json.encode(place.put(message, token.decode())).partition(token)
    pieces: list[bytes] = []
    for start in range(0, len(text), _TEXT_STEP):
        pieces.append(_encode_text(text[start : start + _TEXT_STEP])[1:-1])
        yield
    return before, b"".join(pieces), after


class SplicedMessage:
    """A message in two parts: what is short, with a token in one place, and the content of that place."""

    __slots__ = ("_content", "_octets", "_place", "_short", "_token", "_unescaped")

    def __init__(
        self,
        short: msgspec.Struct,
        place: Place,
        token: bytes,
        content: RawText | None,
        octets: bytes | None = None,
        unescaped: tuple[str, ...] = (),
    ) -> None:
        self._short = short
        self._place = place
        self._token = token
        self._content = content
        self._octets = octets
        self._unescaped = unescaped

    @classmethod
    def from_string(
        cls, type: MessageType, short: msgspec.Struct, string: LongString
    ) -> SplicedMessage | None:
        """Of a message whose text was cut: None if the token is not in one of the type's places."""
        text = string.token.decode()
        octets = pybase64.b64decode(string.token) if string.is_base64 else None
        for place in type.places:
            if place.fetch(short) == (text if place.is_text else octets):
                return cls(short, place, string.token, string.content, None, string.unescaped)
        return None

    @classmethod
    def from_octets(cls, message: msgspec.Struct, place: Place) -> SplicedMessage:
        """Of a message in Python with long octets in one place."""
        octets: bytes = place.fetch(message)
        token = token_for_base64((len(octets) + 2) // 3 * 4, -len(octets) % 3)
        return cls(place.put(message, pybase64.b64decode(token)), place, token, None, octets)

    @classmethod
    def from_text(cls, message: msgspec.Struct, place: Place) -> SplicedMessage:
        """Of a message in Python with a long text in one place, for :meth:`binary` forms alone."""
        text: str = place.fetch(message)
        token = token_for_text(len(text))
        return cls(place.put(message, token.decode()), place, token, None, None, (text,))

    @property
    def content(self) -> RawText:
        """The content as it is in JSON, between quotes; octets are encoded once."""
        if self._content is None:
            self._content = pybase64.b64encode(self.octets)
        return self._content

    @property
    def octets(self) -> bytes:
        """What base64 or a text with escapes stands for; decoded once."""
        if self._octets is None and self._unescaped:
            self._octets = "".join(self._unescaped).encode()
        elif self._octets is None:
            assert self._content is not None  # It has one of the two from the start.
            self._octets = pybase64.b64decode(self._content, validate=True)
        return self._octets

    def octets_in_steps(self) -> Steps[None]:
        """Make the :attr:`octets` of a text with escapes in steps."""
        if self._octets is None and self._unescaped:
            pieces: list[bytes] = []
            for text in self._unescaped:
                for start in range(0, len(text), _TEXT_STEP):
                    pieces.append(text[start : start + _TEXT_STEP].encode())
                    yield
            self._octets = b"".join(pieces)

    @property
    def kept_size(self) -> int:
        """About how many bytes the content takes, in the forms that it has now."""
        return len(self._content or b"") + len(self._octets or b"")

    def numbered(self, number: int) -> SplicedMessage:
        """The same message with that `header.seq`."""
        short = put(self._short, ("header", "seq"), number)
        return SplicedMessage(short, self._place, self._token, self._content, self._octets, self._unescaped)

    def value(self) -> msgspec.Struct:
        """The whole message."""
        is_text = self._place.is_text
        content = string_of(self.content, self._unescaped) if is_text else self.octets
        return self._place.put(self._short, content)

    def json(self, encode: Callable[[msgspec.Struct], bytes]) -> Parts:
        """The parts of the message in JSON."""
        before, _, after = encode(self._short).partition(self._token)
        return before, self.content, after

    def binary(self, encode: Callable[[msgspec.Struct], bytes], length_head: LengthHead) -> Parts:
        """The parts of the message in an encoding where a length stands before strings and octets."""
        short, is_text = self._short, self._place.is_text
        content: RawText
        if not is_text:
            content, token = self.octets, pybase64.b64decode(self._token)
        elif not self._unescaped:
            content, token = self.content, self._token
        else:
            content = self.octets
            token = token_for_text(len(content))
            short = self._place.put(short, token.decode())
        before, _, after = encode(short).partition(token)
        short_head = length_head(len(token), is_text)
        return before.removesuffix(short_head) + length_head(len(content), is_text), content, after

    def detached(self) -> SplicedMessage:
        """The same message without a view of the buffer it was received in."""
        content = self._content
        return SplicedMessage(
            self._short,
            self._place,
            self._token,
            bytes(content) if content is not None else None,
            self._octets,
            self._unescaped,
        )
