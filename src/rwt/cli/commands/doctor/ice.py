"""Whether the STUN and TURN servers that a robot names are reached from here (the extra `webrtc`)."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

from rwt_transports.connect import explained
from rwt_transports.schemes import parse_connect_url
from rwt_transports.webrtc.connector import find_servers, require_asyncio
from rwt_transports.webrtc.ice_servers import Probe, probe

Verdict = Literal["ok", "note", "warning"]


async def examine_servers(
    url: str, headers: Mapping[str, str] | None, tls: ssl.SSLContext | None
) -> Sequence[tuple[Verdict, str, str]]:
    """Verdict, what was seen, and advice for each server.

    Raises:
        TransportError: the robot does not answer, or names what cannot be used.
    """
    require_asyncio()
    target = parse_connect_url(url)
    context = (tls or ssl.create_default_context()) if target.scheme.tls else None
    address = replace(target.address, tls=context, target=target.path, headers=headers or {})
    with explained(target):
        servers = await find_servers(address)
    if not servers:
        text = "the robot names no STUN or TURN server: it is reached where no NAT is between"
        return [("note", text, "")]
    found = await asyncio.gather(*(probe(server) for server in servers))
    return [_finding(each) for each in found]


def _finding(seen: Probe) -> tuple[Verdict, str, str]:
    text = f"{seen.url}: {seen.text}"
    if seen.works:
        return "ok", text, ""
    if "refuses" in seen.text:
        advice = (
            "compare `webrtc.username` and `webrtc.credential` of the robot, or what `credential_command`"
            " prints"
        )
    else:
        advice = "compare `webrtc.servers` of the robot, and let UDP to it through firewalls"
    return "warning", text, advice
