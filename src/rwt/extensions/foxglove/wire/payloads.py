"""Payloads of clients, decoded from the encoding of the channel or call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from rwt.extensions.foxglove.errors import NotPossible
from rwt_interfaces.distro import Distro
from rwt_interfaces.errors import NotExact
from rwt_interfaces.payload import LARGE_BYTES, Payload
from rwt_interfaces.steps import Steps
from rwt_interfaces.structs import MessageType
from rwt_protocol.frames import Buffer
from rwt_protocol.limits import has_more_brackets

JSON: Final = "json"


def encodings(distro: Distro) -> tuple[str, ...]:
    """Return the supported encodings, preferred first: the serialisation of the robot's distribution, and
    JSON.
    """
    return (distro.serialisation, JSON)


def check_encoding(encoding: str, distro: Distro) -> None:
    """Raise NotPossible for an encoding that is not supported."""
    if encoding not in encodings(distro):
        raise NotPossible(f"encoding {encoding[:80]!r}: expected {' or '.join(encodings(distro))}")


def is_long(encoding: str, data: memoryview) -> bool:
    """Return True if a payload is JSON so long that :func:`payload_of` takes steps."""
    return encoding == JSON and len(data) >= LARGE_BYTES


def payload_of(
    type: MessageType, encoding: str, data: memoryview, now: Callable[[], int], structure: int
) -> Steps[Payload]:
    """Decode the message in a view of its frame, long JSON in steps of about a millisecond.

    Args:
        type: expected type.
        encoding: encoding of the data.
        data: view of the frame.
        now: ROS time in nanoseconds.
        structure: maximum number of brackets in long JSON that is not exact.

    Raises:
        InvalidMessage: the message does not fit.
        NotPossible: long JSON is not exact and has more than `structure` brackets.
    """
    if encoding != JSON:
        return Payload.deserialised(type, data)
    if not is_long(encoding, data):
        return Payload.from_json(type, data, now)
    whole = bytes(data)  # The frame's buffer may be reused before the next step.
    is_dense = has_more_brackets(whole, structure // 2)
    try:
        return (yield from Payload.from_json_in_steps(type, whole, now, is_dense=is_dense))
    except NotExact:
        raise NotPossible(
            f"more than {structure} brackets (limits.structure_bytes): so many are taken only in a message"
            f" that has every field of {type.name}, each as ROS writes it"
        ) from None


def in_encoding(payload: Payload, encoding: str) -> tuple[Buffer, ...]:
    """Return a message in one of the encodings, in parts."""
    return tuple(payload.json_parts() if encoding == JSON else payload.serialised_parts())
