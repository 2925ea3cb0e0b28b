"""The shared examples: one message of each op as texts show it and clients send it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from rwt_protocol.ops import Direction
from rwt_protocol.payloads import Encodable, RawJson

T = TypeVar("T")


class Example(msgspec.Struct, frozen=True):
    name: str
    direction: str
    valid: bool
    message: dict[str, Any]

    @property
    def directions(self) -> tuple[Direction, ...]:
        """The sides on which the message may arrive."""
        if self.direction == "both":
            return (Direction.TO_SERVER, Direction.TO_CLIENT)
        return (Direction.TO_SERVER if self.direction == "client->server" else Direction.TO_CLIENT,)


class Malformed(msgspec.Struct, frozen=True):
    name: str
    text: str


class Picture(msgspec.Struct, frozen=True):
    inner_json: str
    width: int
    height: int
    pixel_bytes_hex: str
    png_base64: str


class CborFrame(msgspec.Struct, frozen=True):
    name: str
    decoded: dict[str, Any]
    hex: str


class Examples(msgspec.Struct, frozen=True):
    examples: list[Example]
    malformed: list[Malformed]
    png: list[Picture]
    cbor: list[CborFrame]


EXAMPLES = msgspec.json.decode((Path(__file__).parent / "examples.json").read_bytes(), type=Examples)


def only(found: Sequence[object], kind: type[T]) -> T:
    """The only item of what a frame became."""
    (item,) = found
    assert isinstance(item, kind), item
    return item


def text_of(payload: Encodable) -> RawJson:
    """A payload that came as JSON."""
    assert isinstance(payload, RawJson)
    return payload
