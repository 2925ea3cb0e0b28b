"""The encodings in which a client can receive samples: what `compression` on subscribe chooses from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import msgspec

from rwt_protocol.codecs import cbor, json, png
from rwt_protocol.transport import Frame

if TYPE_CHECKING:
    from rwt_graph.api import Sample
    from rwt_interfaces.payload import Payload

Encoder = Callable[["Sample"], Frame]
"""From a sample to the frame that all clients of one channel share."""


@dataclass(frozen=True, slots=True)
class Encoding:
    """One encoding.

    Attributes:
        name: as `compression` spells it.
        precedence: the strongest of a client's wishes for one topic wins (SUB-08).
        encoder: from the topic's name, as the client spelled it, to an encoder for its samples.
    """

    name: str
    precedence: int
    encoder: Callable[[str], Encoder]


def _json_encoder(topic: str) -> Encoder:
    prefix = json.publish_prefix(topic)

    def encode(sample: Sample) -> Frame:
        return json.publish_frame(prefix, sample.payload.json())

    return encode


def _png_encoder(topic: str) -> Encoder:
    """The JSON message in the pixels of a picture (PNG-01), made at once so that a topic keeps its order."""
    prefix = json.publish_prefix(topic)

    def encode(sample: Sample) -> Frame:
        return png.encode(json.publish_frame(prefix, sample.payload.json()))

    return encode


def _cbor_encoder(topic: str) -> Encoder:
    prefix = cbor.publish_prefix(topic)

    def encode(sample: Sample) -> Frame:
        return cbor.publish_frame(prefix, sample.payload.cbor())

    return encode


def _cbor_raw_encoder(topic: str) -> Encoder:
    """The message as its robot serialises it: ROS 1's own form or CDR, by distribution (CBR-10, CBR-11).

    The time is that of the server when the message was published (CBR-12), the same for all clients.
    """
    prefix = cbor.publish_prefix(topic)

    def encode(sample: Sample) -> Frame:
        return cbor.raw_publish_frame(prefix, sample.payload.serialised(), sample.stamp_ns)

    return encode


def _bson_encoder(topic: str) -> Encoder:
    from rwt_protocol.codecs.bson import document  # an optional package, there when BSON is spoken

    def encode(sample: Sample) -> Frame:
        return document({"op": "publish", "topic": topic, "msg": plain_message(sample.payload)})

    return encode


JSON: Final = Encoding("none", 0, _json_encoder)
BSON: Final = Encoding("bson", 4, _bson_encoder)
"""What every client of a server in BSON-only mode gets, whatever it asks for (BSN-01)."""

ENCODINGS: Final[Mapping[str, Encoding]] = MappingProxyType(
    {
        encoding.name: encoding
        for encoding in (
            JSON,
            Encoding("png", 1, _png_encoder),
            Encoding("cbor", 2, _cbor_encoder),
            Encoding("cbor-raw", 3, _cbor_raw_encoder),
        )
    }
)
"""Every encoding that a client can ask for, by its name in `compression`."""


def plain_message(payload: Payload) -> object:
    """A message as dicts, lists and scalars, octets as bytes."""
    return msgspec.to_builtins(payload.value(), builtin_types=(bytes,), enc_hook=_plain_array)


def _plain_array(array: object) -> object:
    """A numpy array as a list: the only thing in a message that is not plain."""
    to_list: Callable[[], object] = array.tolist  # type: ignore[attr-defined]  # numpy is not imported here
    return to_list()
