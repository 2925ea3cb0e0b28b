"""Messages from the server to Foxglove clients, as frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from enum import IntEnum
from struct import Struct as Layout
from typing import Final

import msgspec

from rwt_protocol.frames import Buffer, Frame, GapFrame

encoded: Final = msgspec.json.Encoder().encode

MESSAGE_DATA: Final = 1
TIME: Final = 2
SERVICE_CALL_RESPONSE: Final = 3
FETCH_ASSET_RESPONSE: Final = 4
PLAYBACK_STATE: Final = 5

_BATCH: Final = 256 * 1024
"""Maximum bytes of one announcement; longer ones are split."""


class Level(IntEnum):
    """Severity of a status message."""

    INFO = 0
    WARNING = 1
    ERROR = 2


class PlaybackStatus(IntEnum):
    """State of a playback."""

    PLAYING = 0
    PAUSED = 1
    BUFFERING = 2
    ENDED = 3


def text(op: str, **members: object) -> Frame:
    """Return a text frame with these members, without those that are None."""
    given = {name: value for name, value in members.items() if value is not None}
    return Frame(encoded({"op": op, **given}))


def texts(op: str, member: str, items: Iterable[bytes]) -> list[Frame]:
    """Return text frames with a list of encoded items; none if there are no items."""
    frames: list[Frame] = []
    batch: list[bytes] = []
    size = 0
    for item in items:
        # A frame has at least one item, even one that exceeds the limit alone.
        if batch and size + len(item) > _BATCH:
            frames.append(_listing(op, member, batch))
            batch, size = [], 0
        batch.append(item)
        size += len(item)
    if batch:
        frames.append(_listing(op, member, batch))
    return frames


def _listing(op: str, member: str, items: Sequence[bytes]) -> Frame:
    # Items are encoded once for all clients, so they are joined as bytes.
    return Frame(b'{"op":"%s","%s":[%s]}' % (op.encode(), member.encode(), b",".join(items)))


def server_info(
    name: str,
    capabilities: Sequence[str],
    encodings: Sequence[str],
    metadata: Mapping[str, str],
    session_id: str,
    time_range: tuple[int, int] | None,
) -> Frame:
    """Return the first message; `time_range` of the recording is in nanoseconds since the epoch."""
    begin, end = (None, None) if time_range is None else map(_timestamp, time_range)
    return text(
        "serverInfo",
        name=name,
        capabilities=list(capabilities),
        supportedEncodings=list(encodings),
        metadata=dict(metadata),
        sessionId=session_id,
        dataStartTime=begin,
        dataEndTime=end,
    )


def _timestamp(time_ns: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(time_ns, 10**9)
    return {"sec": seconds, "nsec": nanoseconds}


def status(level: Level, message: str, id: str | None = None) -> Frame:
    """Return a status message for a person; a later one of the same id replaces it."""
    return text("status", level=int(level), message=message, id=id)


_KIND_OF_MESSAGE: Final = bytes((MESSAGE_DATA,))
subscription_number: Final = Layout("<I").pack
"""Id of a subscription in the gap of its messages."""
_STAMP: Final = Layout("<Q").pack
_TIME: Final = Layout("<BQ").pack
_RESPONSE: Final = Layout("<BIII").pack
_ASSET: Final = Layout("<BIBI").pack
_STATE: Final = Layout("<BBQfBI").pack


def message_data(time_ns: int, payload: Sequence[Buffer]) -> GapFrame:
    """Return a channel message with a shared payload and a gap for the id (:func:`subscription_number`)."""
    return GapFrame(_KIND_OF_MESSAGE, 4, _STAMP(time_ns), *payload, binary=True)


def time(time_ns: int) -> Frame:
    """Return the server's time; `time_ns` in nanoseconds since the epoch."""
    return Frame(_TIME(TIME, time_ns), binary=True)


def service_call_response(service_id: int, call_id: int, encoding: str, payload: Sequence[Buffer]) -> Frame:
    """Return the response of a service."""
    name = encoding.encode()
    head = _RESPONSE(SERVICE_CALL_RESPONSE, service_id, call_id, len(name)) + name
    return Frame(head, *payload, binary=True)


def service_call_failure(service_id: int, call_id: int, message: str) -> Frame:
    """Return the failure of a service call."""
    return text("serviceCallFailure", serviceId=service_id, callId=call_id, message=message)


def asset(request_id: int, content: Sequence[Buffer]) -> Frame:
    """Return the response with a file."""
    return Frame(_ASSET(FETCH_ASSET_RESPONSE, request_id, 0, 0), *content, binary=True)


def asset_failure(request_id: int, message: str) -> Frame:
    """Return the response for a file that is not available."""
    said = message.encode()
    return Frame(_ASSET(FETCH_ASSET_RESPONSE, request_id, 1, len(said)), said, binary=True)


def playback_state(
    status: PlaybackStatus, time_ns: int, speed: float, *, did_seek: bool, request_id: bytes = b""
) -> Frame:
    """Return the state of the playback at `time_ns`, nanoseconds since the epoch; `speed` is a factor."""
    head = _STATE(PLAYBACK_STATE, status, time_ns, speed, did_seek, len(request_id))
    return Frame(head, request_id, binary=True) if request_id else Frame(head, binary=True)
