"""Representations of responses: JSON or CBOR as the request accepts, with an entity tag."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from hashlib import blake2b
from typing import Final

import msgspec

from rwt.extensions.http.problems import HttpProblem
from rwt_interfaces.payload import Payload
from rwt_transports.http.routes import HttpRequest, HttpResponse

JSON: Final = "application/json"
CBOR: Final = "application/cbor"
EVENTS: Final = "text/event-stream"
HTML: Final = "text/html"

VALUES: Final = (JSON, CBOR)
"""Supported media types; the first is the default."""


def chosen(request: HttpRequest, offered: Sequence[str] = VALUES) -> str:
    """Return the offered media type that a request prefers (RFC 9110 12.5.1). Raises HttpProblem."""
    accept = request.headers.get("accept", "")
    if not accept.strip():
        return offered[0]
    ranges = list(_ranges(accept))
    best, best_quality = "", 0.0
    for media in offered:
        quality = _quality(media, ranges)
        if quality > best_quality:
            best, best_quality = media, quality
    if not best:
        detail = (
            f"the request accepts {accept[:200]!a}, and {request.path} is offered as {', '.join(offered)}"
        )
        raise HttpProblem("not-acceptable", detail)
    return best


def _ranges(accept: str) -> Iterable[tuple[str, float]]:
    for element in accept.split(",")[:50]:
        media, *parameters = element.split(";")
        quality = 1.0
        for parameter in parameters:
            name, _, value = parameter.partition("=")
            if name.strip().lower() == "q":
                try:
                    quality = min(max(float(value), 0.0), 1.0)
                except ValueError:
                    quality = 0.0
        yield media.strip().lower(), quality


def _quality(media: str, ranges: Iterable[tuple[str, float]]) -> float:
    found, specific = 0.0, -1
    for pattern, quality in ranges:
        # The most specific range decides, not the one with the highest quality (RFC 9110 section 12.5.1).
        fits = {media: 2, f"{media.partition('/')[0]}/*": 1, "*/*": 0}.get(pattern, -1)
        if fits > specific:
            found, specific = quality, fits
    return found


def value_response(
    request: HttpRequest,
    value: object,
    status: int = 200,
    headers: Mapping[str, str] | None = None,
    *,
    media: str = JSON,
) -> HttpResponse:
    """Return a response with a value of plain objects and payloads, in CBOR or the JSON of `media`.

    Raises:
        HttpProblem: the request accepts neither JSON nor CBOR.
    """
    if chosen(request, (media, CBOR)) == CBOR:
        import cbor2  # Imported here: only clients that accept CBOR need it.

        return tagged(request, cbor2.dumps(_converted(value, Payload.plain)), CBOR, status, headers)
    return tagged(request, json_of(value), media, status, headers)


def json_of(value: object) -> bytes:
    """Return a value of plain objects and payloads as JSON."""
    return msgspec.json.encode(_converted(value, lambda payload: msgspec.Raw(bytes(payload.json()))))


def payload_response(
    request: HttpRequest, payload: Payload, headers: Mapping[str, str] | None = None
) -> HttpResponse:
    """Return a response with a message in the accepted form, as shared bytes. Raises HttpProblem."""
    if chosen(request) == CBOR:
        return tagged(request, payload.cbor(), CBOR, 200, headers)
    return tagged(request, bytes(payload.json()), JSON, 200, headers)


def tagged(
    request: HttpRequest, body: bytes, media: str, status: int = 200, headers: Mapping[str, str] | None = None
) -> HttpResponse:
    """Return a response with an entity tag; without its body if the client has it (RFC 9110 13.1.2)."""
    all_headers = {"Cache-Control": "no-cache", "Vary": "Accept", **(headers or {})}
    if status != 200 or request.method not in ("GET", "HEAD"):
        return HttpResponse(body, status, media, all_headers)
    # The media type is part of the tag, since one address has several representations.
    tag = f'"{blake2b(body, digest_size=12, person=media.encode()[-16:]).hexdigest()}"'
    all_headers["ETag"] = tag
    known = {each.strip().removeprefix("W/") for each in request.headers.get("if-none-match", "").split(",")}
    if tag in known or "*" in known:
        return HttpResponse(b"", 304, media, all_headers)
    return HttpResponse(body, status, media, all_headers)


def _converted(value: object, convert: Callable[[Payload], object]) -> object:
    if isinstance(value, dict):
        return {name: _converted(item, convert) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_converted(item, convert) for item in value]
    return convert(value) if isinstance(value, Payload) else value
