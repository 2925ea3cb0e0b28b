"""All sessions, by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tests.traces import access, gateways, http_gateway, rosbridge
from tests.traces.transcript import Session, Transcript, recording

SESSIONS: Final[Mapping[str, Session]] = {
    **rosbridge.SESSIONS,
    **gateways.SESSIONS,
    **http_gateway.SESSIONS,
    **access.SESSIONS,
}


def played(name: str) -> str:
    """Play a session, and return what is recorded of it."""
    transcript = Transcript(name)
    SESSIONS[name](transcript)
    return recording(name, str(transcript))
