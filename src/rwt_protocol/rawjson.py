"""A payload as it stands on the wire: JSON text that nothing in this package decodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Literal

import msgspec
from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from rwt_protocol.transport import Buffer

Shape = Literal["object", "array", "string", "number", "boolean", "null"]

_SHAPES: Final[dict[int, Shape]] = {
    ord("{"): "object",
    ord("["): "array",
    ord('"'): "string",
    ord("t"): "boolean",
    ord("f"): "boolean",
    ord("n"): "null",
}


class RawJson(msgspec.Struct, frozen=True, gc=False, eq=False):
    """The bytes of one JSON value, kept undecoded.

    Attributes:
        data: the bytes. A `memoryview` is a slice of the frame that they came in, and keeps that frame alive.
        prove: None when the bytes are known to be one JSON value in UTF-8. In a large message they are not
            looked at on arrival (see :mod:`rwt_protocol.codecs.head_tail_split`): a strict decoder of the
            message type proves them, and everybody else calls :meth:`proven` first.
    """

    data: Buffer
    prove: Callable[[], bytes] | None = None

    @property
    def size(self) -> int:
        """How many bytes there are."""
        return len(self.data)

    @property
    def verified(self) -> bool:
        """Whether the bytes are known to be one JSON value in UTF-8."""
        return self.prove is None

    @property
    def shape(self) -> Shape:
        """Which kind of JSON value this is, told from its first byte."""
        return _SHAPES.get(self.data[0], "number")

    def proven(self) -> RawJson:
        """The same payload with its bytes checked: self if they already are.

        Call it before the bytes are passed on without a type check, and when a strict decoder has refused
        bytes that are not `verified`: the whole message is then parsed, and what comes back is exactly
        what a full parse would have found, with the tokens ``NaN`` and ``Infinity`` turned into null.

        Raises:
            MalformedPayload: the message is not JSON, or not UTF-8.
        """
        return self if self.prove is None else RawJson(self.prove())

    def __eq__(self, other: object) -> bool:
        return self.data == other.data if isinstance(other, RawJson) else NotImplemented

    def __hash__(self) -> int:
        return hash(bytes(self.data))

    def __repr__(self) -> str:
        head = bytes(self.data[:60]).decode("utf-8", "replace")
        return f"RawJson({head}{'…' if len(self.data) > 60 else ''})"

    @classmethod
    def __get_pydantic_core_schema__(cls, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.is_instance_schema(cls)


EMPTY: Final = RawJson(b"{}")
"""What an absent payload means: an object without members (PUB-04, SRV-02, X15)."""
