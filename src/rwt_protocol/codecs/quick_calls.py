"""Fast path for common small `call_service` and `service_response` frames: one strict parse.

Frames with other members that have an effect, or with members of other types, take the general path.
"""

from __future__ import annotations

from typing import Final

import msgspec

from rwt_protocol.codecs.quick_publish import QUICK


class UsualCall(msgspec.Struct, tag_field="op", tag="call_service", forbid_unknown_fields=True, frozen=True):
    """Call without a timeout or other options; `type` is ignored, since the service has one (SRV-03)."""

    service: str
    id: str | None = None
    args: msgspec.Raw = msgspec.Raw(b"{}")
    type: str | None = None


class UsualResponse(
    msgspec.Struct, tag_field="op", tag="service_response", forbid_unknown_fields=True, frozen=True
):
    """Response of a service that succeeded."""

    service: str
    id: str
    values: msgspec.Raw
    result: bool = True


_STARTS: Final = tuple(
    b'{"op":%b"%b"' % (space, op) for op in (b"call_service", b"service_response") for space in (b"", b" ")
)
_decode: Final = msgspec.json.Decoder(UsualCall | UsualResponse).decode


def split_call(data: bytes) -> UsualCall | UsualResponse | None:
    """Return a text frame as a call or response; None if it is not in a known form.

    Only the brackets of the payload are checked; its strings are validated when it is decoded as a type.
    """
    if not data.startswith(_STARTS) or len(data) > QUICK or not data.isascii():
        return None
    try:
        found = _decode(data)
    except (msgspec.DecodeError, RecursionError):
        return None
    if type(found) is UsualCall:
        return found if bytes(found.args)[:1] == b"{" else None
    return found if found.result and bytes(found.values)[:1] == b"{" else None
