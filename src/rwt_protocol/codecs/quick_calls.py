"""Taking the usual small `call_service` and `service_response` apart by one parse, straight to what is asked.

Both are read strictly: a member that has an effect beside the name, the id and the payload, or one of another
type, and the frame is read as any other.
"""

from __future__ import annotations

from typing import Final

import msgspec

from rwt_protocol.codecs.quick_publish import QUICK


class UsualCall(msgspec.Struct, tag_field="op", tag="call_service", forbid_unknown_fields=True, frozen=True):
    """A call without a timeout or another wish.

    Attributes:
        args: an object, as it came.
        type: has no effect, since the service has one (SRV-03).
    """

    service: str
    id: str | None = None
    args: msgspec.Raw = msgspec.Raw(b"{}")
    type: str | None = None


class UsualResponse(
    msgspec.Struct, tag_field="op", tag="service_response", forbid_unknown_fields=True, frozen=True
):
    """The response of a service that succeeded.

    Attributes:
        values: an object, as it came.
    """

    service: str
    id: str
    values: msgspec.Raw
    result: bool = True


_STARTS: Final = tuple(
    b'{"op":%b"%b"' % (space, op) for op in (b"call_service", b"service_response") for space in (b"", b" ")
)
_decode: Final = msgspec.json.Decoder(UsualCall | UsualResponse).decode


def split_call(data: bytes) -> UsualCall | UsualResponse | None:
    """A text frame as a call or a response; None if it is not spelt in a way that is known here.

    The payload is an object as far as its brackets tell; who decodes it as a type finds out whether its
    strings are what JSON allows.
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
