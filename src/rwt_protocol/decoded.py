"""A payload that came in an encoding whose values are read as a whole: CBOR and BSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import msgspec
from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from rwt_protocol.rawjson import RawJson, Shape

_SHAPES: Final[Mapping[type, Shape]] = {
    dict: "object",
    list: "array",
    str: "string",
    bool: "boolean",
    type(None): "null",
}


class Decoded(msgspec.Struct, frozen=True, eq=False):
    """One payload as plain objects, not checked against any message type.

    Attributes:
        value: dict, list, str, bytes, int, float, bool or None; typed arrays are lists, octets are bytes, and
            NaN is kept. What else a sender put there (a date, a key that is no text) is left as the library
            read it: whoever knows the message type refuses it.
        size: bytes of the message that it came in, envelope included, for those who count; not compared.
    """

    value: object
    size: int = 0

    def __eq__(self, other: object) -> bool:
        return self.value == other.value if isinstance(other, Decoded) else NotImplemented

    __hash__ = None  # type: ignore[assignment]  # its value may be a list

    @property
    def shape(self) -> Shape:
        """Which kind of value this is, in JSON's words."""
        return _SHAPES.get(type(self.value), "number")

    @classmethod
    def __get_pydantic_core_schema__(cls, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.is_instance_schema(cls)


RawPayload = RawJson | Decoded
"""A payload as this package hands it on: text that nobody has decoded, or values that nobody has checked."""


def plain_value(payload: RawPayload) -> object:
    """The payload as plain objects.

    Raises:
        MalformedPayload: it is text of another peer, and is not JSON.
    """
    return payload.value if isinstance(payload, Decoded) else msgspec.json.decode(payload.proven().data)
