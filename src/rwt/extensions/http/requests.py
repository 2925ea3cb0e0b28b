"""Parts of a request: the name in its path, its query, and its body as a message."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection
from typing import Final
from urllib.parse import parse_qs, unquote

import msgspec

from rwt.access.graph_view import GraphView
from rwt.extensions.http.problems import HttpProblem
from rwt.extensions.http.representations import CBOR, JSON
from rwt_graph.api import ActionInfo, ServiceInfo, TopicInfo
from rwt_graph.names import resolve
from rwt_interfaces.errors import InvalidMessage, NotExact
from rwt_interfaces.payload import LARGE_BYTES, Payload
from rwt_interfaces.serialise.json import require_quick_numbers
from rwt_interfaces.steps import finished
from rwt_interfaces.structs import MessageType
from rwt_protocol.codecs import cbor_codec
from rwt_protocol.codecs.base import DecodeFailure
from rwt_protocol.limits import WireLimits
from rwt_protocol.payloads import Decoded
from rwt_transports.http.routes import HttpRequest
from rwt_transports.scheduler import REQUESTS, Scheduler

IN_STEPS: Final = LARGE_BYTES
"""Bytes from which a body is read in steps."""

_MAX_BRACKETS: Final = 32 * 1024
"""Maximum number of objects and arrays in a larger body that is not complete in ROS's own order of fields:
each needs many times its size in memory.
"""

_CBOR_LIMITS: Final = WireLimits(max_depth=100, structure_bytes=64 * 1024)

MAX_WAIT_SECONDS: Final = 60.0
"""Longest time in seconds that a request may wait for a message or a response."""

_MAX_PARAMETERS: Final = 20

#: Text of msgspec about malformed JSON, with the byte at which it ends.
_BYTE: Final = re.compile(r"JSON is malformed: (.*) \(byte (\d+)\)")


def malformed(body: bytes) -> HttpProblem | None:
    """Return the problem with a body that is not JSON, with line and column; None if it is."""
    try:
        msgspec.json.decode(body, type=msgspec.Raw)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        found = _BYTE.fullmatch(str(error))
        if found is None:
            return HttpProblem("invalid-message", f"not valid JSON: {error}")
        before = body[: int(found[2])]
        line, column = before.count(b"\n") + 1, len(before) - before.rfind(b"\n")
        return HttpProblem("invalid-message", f"not valid JSON: {found[1]}: line {line}, column {column}")
    return None


def name_below(path: str, prefix: str, what: str) -> str:
    """Return the absolute name after a prefix of a path. Raises HttpProblem, InvalidGraphName."""
    return resolve("/" + text_below(path, prefix, what))


def text_below(path: str, prefix: str, what: str) -> str:
    """Return the rest of a path after a prefix, without enclosing slashes. Raises HttpProblem if empty."""
    try:
        text = unquote(path.removeprefix(prefix), errors="strict").strip("/")
    except UnicodeDecodeError:
        raise HttpProblem("invalid-name", "the path is not percent-encoded UTF-8") from None
    if not text:
        raise HttpProblem("not-found", f"{path} names no {what}; {prefix.rstrip('/')} lists them")
    return text


def name_and_type(reader: GraphView, row: TopicInfo | ServiceInfo | ActionInfo) -> dict[str, str | None]:
    """Return a row of a listing."""
    return {"name": row.name, "type": reader.registry.type_name(row.type) if row.type else None}


class Query:
    """Query of a request; unknown names, and names given twice, are rejected (HttpProblem)."""

    def __init__(self, request: HttpRequest, known: Collection[str] = ()) -> None:
        try:
            given = parse_qs(request.query, keep_blank_values=True, max_num_fields=_MAX_PARAMETERS)
        except ValueError:
            raise HttpProblem("invalid-request", f"more than {_MAX_PARAMETERS} parameters") from None
        given.pop("token", None)  # Credentials, which admission has read.
        for name, values in given.items():
            if name not in known:
                expected = f"here are {', '.join(sorted(known))}" if known else "none is known here"
                raise HttpProblem(
                    "invalid-request", f"no parameter {name[:80]!a} is known; {expected}", where=name[:80]
                )
            if len(values) > 1:
                raise HttpProblem("invalid-request", f"{name} is given {len(values)} times", where=name)
        self._given = {name: values[0] for name, values in given.items()}

    def __contains__(self, name: str) -> bool:
        return name in self._given

    def text(self, name: str) -> str | None:
        """Return a string; None if it is missing or empty."""
        return self._given.get(name) or None

    def flag(self, name: str) -> bool:
        """Return True if a flag is ``true`` or ``1``. Raises HttpProblem for other values."""
        value = self._given.get(name, "false").lower()
        if value not in ("true", "false", "1", "0"):
            raise HttpProblem(
                "invalid-request", f"{name}: expected true or false, got {value[:80]!a}", where=name
            )
        return value in ("true", "1")

    def seconds(self, name: str, default: float, most: float) -> float:
        """Return a time in seconds, at most `most`. Raises HttpProblem."""
        return self._number(name, default, most, float)

    def count(self, name: str, default: int, most: int) -> int:
        """Return a whole number from 1 to `most`. Raises HttpProblem."""
        return int(self._number(name, default, most, int, 1))

    def _number(
        self, name: str, default: float, most: float, kind: Callable[[str], float], least: float = 0
    ) -> float:
        text = self._given.get(name)
        if text is None:
            return default
        try:
            value = kind(text[:40])
        except ValueError:
            # NaN fails the comparison below, as does a NaN that was sent.
            value = math.nan
        if not least <= value <= most:
            expected = f"expected a number from {least:g} to {most:g}"
            raise HttpProblem("invalid-request", f"{name}: {expected}, got {text[:80]!a}", where=name)
        return value


async def payload_of(type: MessageType, request: HttpRequest, now: Callable[[], int]) -> Payload:
    """Return the body as a message, decoded in steps if it is large; an empty body is a message of defaults.

    Raises:
        HttpProblem: its media type is not supported, or it is malformed.
        InvalidMessage: it does not fit the type.
    """
    body = request.body
    if len(body) < IN_STEPS or media_of(request) == CBOR:
        return small_payload_of(type, request, now)
    try:
        return await _from_json(type, body, now)
    except InvalidMessage as error:
        # Only now, because it reads the body again: messages that fit need no second look.
        raise malformed(body) or error from None


def small_payload_of(type: MessageType, request: HttpRequest, now: Callable[[], int]) -> Payload:
    """Return the body as a message, decoded at once. Raises as :func:`payload_of`."""
    body = request.body
    if media_of(request) == CBOR and body:
        return Payload.from_value(type, _cbor_map(body), now)
    try:
        return Payload.from_json(type, body or b"{}", now)
    except InvalidMessage as error:
        raise malformed(body) or error from None  # As above.


async def _from_json(type: MessageType, body: bytes, now: Callable[[], int]) -> Payload:
    is_dense = body.count(b"{") + body.count(b"[") > _MAX_BRACKETS
    try:
        steps = Payload.from_json_in_steps(type, body, now, is_dense=is_dense)
        return await Scheduler.of_loop(REQUESTS).finish(steps)
    except NotExact:
        raise HttpProblem(
            "too-large",
            f"more than {_MAX_BRACKETS} brackets: so many are taken only in a message that has every field"
            f" of {type.name}, each as ROS writes it",
        ) from None


def value_of(request: HttpRequest) -> object:
    """Return the body as a plain value. Raises HttpProblem."""
    body = request.body
    if len(body) > IN_STEPS:
        raise HttpProblem("too-large", f"a value of {len(body)} bytes; {IN_STEPS} is the limit")
    if media_of(request) == CBOR:
        # The decoder only reads maps, so any other value is wrapped in one.
        return _cbor_map(b"\xa1\x61v" + body)["v"]
    try:
        finished(require_quick_numbers(body))
        return msgspec.json.decode(body)
    except InvalidMessage as error:
        raise HttpProblem("too-large", str(error)) from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise HttpProblem("invalid-request", f"the body is not JSON: {error}") from None


def media_of(request: HttpRequest) -> str:
    """Return the media type of the body, by default JSON. Raises HttpProblem for unknown types."""
    media = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    # `curl --data` and `fetch` send the types of text and forms by default, whatever the body is.
    if media in ("", JSON, "text/plain", "application/x-www-form-urlencoded") or media.endswith("+json"):
        return JSON
    if media == CBOR:
        return CBOR
    raise HttpProblem(
        "unsupported-media-type", f"the body is {media[:80]!a}", headers={"Accept": f"{JSON}, {CBOR}"}
    )


def _cbor_map(body: bytes) -> dict[str, object]:
    found = cbor_codec().split(body, _CBOR_LIMITS)[0]
    if isinstance(found, DecodeFailure):
        # The limit is fixed here, so the setting that the codec names would not help.
        reason = found.reason.replace(" (limits.structure_bytes)", "")
        raise HttpProblem("invalid-request", f"the body cannot be read: {reason}")
    return {name: value.value if isinstance(value, Decoded) else value for name, value in found.items()}
