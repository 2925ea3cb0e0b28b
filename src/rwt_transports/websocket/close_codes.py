"""Close codes of RFC 6455 section 7.4.1, also used by transports without close frames."""

from __future__ import annotations

NORMAL = 1000
GOING_AWAY = 1001
PROTOCOL_ERROR = 1002
NO_STATUS = 1005
ABNORMAL = 1006
INVALID_DATA = 1007
POLICY = 1008
TOO_BIG = 1009
INTERNAL_ERROR = 1011
SERVICE_RESTART = 1012
TRY_AGAIN_LATER = 1013

KNOWN = frozenset({1000, 1001, 1002, 1003, 1007, 1008, 1009, 1010, 1011, 1012, 1013, 1014})
"""Codes below 3000 that may travel in a close frame (the RFC and the IANA registry)."""


def may_travel(code: int) -> bool:
    """Return True if `code` is allowed in a close frame; 3000 to 4999 are free for libraries and programs."""
    return code in KNOWN or 3000 <= code < 5000
