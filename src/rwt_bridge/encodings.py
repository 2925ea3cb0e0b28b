"""The encodings in which a client can receive samples: what `compression` on subscribe chooses from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rwt_protocol.codecs.json import publish_frame, publish_prefix
from rwt_protocol.errors import Refused
from rwt_protocol.frames import Frame

if TYPE_CHECKING:
    from rwt_graph.api import Sample

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
    prefix = publish_prefix(topic)

    def encode(sample: Sample) -> Frame:
        return publish_frame(prefix, sample.payload.json())

    return encode


JSON = Encoding("none", 0, _json_encoder)

#: Every encoding that this server offers, by its name in `compression`.
ENCODINGS: dict[str, Encoding] = {JSON.name: JSON}

#: What the protocol knows beside them.
_NOT_OFFERED = frozenset({"png", "cbor", "cbor-raw"})


def encoding_of(compression: str | None) -> Encoding:
    """The encoding for a `compression` field; an unknown word counts as none (SUB-10).

    Raises:
        Refused: the protocol has this encoding and this server does not offer it.
    """
    name = compression or "none"
    if name in _NOT_OFFERED:
        raise Refused(
            f'subscribe: compression "{name}" is not offered here; use one of {", ".join(ENCODINGS)}'
        )
    return ENCODINGS.get(name, JSON)
