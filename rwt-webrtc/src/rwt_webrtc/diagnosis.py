"""Check of `rwt doctor`: the STUN and TURN servers that a robot names."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Mapping
from dataclasses import replace

from rwt.declarations import Finding
from rwt_transports.connect import explained
from rwt_transports.schemes import parse_connect_url
from rwt_webrtc.transport.connector import find_servers, require_asyncio
from rwt_webrtc.transport.ice_servers import Probe, probe


async def examine_ice_servers(
    url: str, headers: Mapping[str, str] | None, tls: ssl.SSLContext | None
) -> list[Finding]:
    """Probe the STUN and TURN servers that a robot names.

    Raises:
        TransportError: the robot does not answer, or names servers that cannot be used.
    """
    require_asyncio()
    target = parse_connect_url(url)
    context = (tls or ssl.create_default_context()) if target.scheme.tls else None
    address = replace(target.address, tls=context, target=target.path, headers=headers or {})
    with explained(target):
        servers = await find_servers(address)
    if not servers:
        text = "the robot names no STUN or TURN server: it is not reachable through a NAT"
        return [Finding("ICE server", "note", text)]
    return [_ice_finding(each) for each in await asyncio.gather(*(probe(server) for server in servers))]


def _ice_finding(seen: Probe) -> Finding:
    text = f"{seen.url}: {seen.text}"
    if seen.works:
        return Finding("ICE server", "ok", text)
    if seen.refused:
        advice = (
            "compare `webrtc.username` and `webrtc.credential` of the robot, or what `credential_command`"
            " prints"
        )
    else:
        advice = "compare `webrtc.servers` of the robot, and allow UDP to it in firewalls"
    return Finding("ICE server", "warning", text, advice)
