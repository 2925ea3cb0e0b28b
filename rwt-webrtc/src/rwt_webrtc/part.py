"""Declarations of WebRTC: the service of a server, and the check of `rwt doctor`."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from rwt.declarations import CheckContext, CheckPart, Finding, Option, ServiceContext, ServicePart
from rwt_webrtc.settings import WebRtcSettings


@asynccontextmanager
async def _run(context: ServiceContext, settings: WebRtcSettings) -> AsyncIterator[None]:
    from rwt_webrtc.server import serve_webrtc  # Imports aiortc.

    async with serve_webrtc(context, settings):
        yield


async def _examine(context: CheckContext, report: Callable[[Finding], None]) -> None:
    from rwt_webrtc.diagnosis import examine_ice_servers

    for finding in await examine_ice_servers(context.url, context.headers, context.tls):
        report(finding)


PART = ServicePart(
    pools=(
        "rwt_webrtc.transport.signalling:PEERS",
        "rwt_webrtc.transport.signalling:HANDSHAKES",
        "rwt_webrtc.transport.signalling:OFFERS",
    ),
    summary="WebRTC: rosbridge over data channels, and images and audio as media tracks",
    settings=WebRtcSettings,
    is_on=lambda settings: settings.enabled,
    run=_run,
    on_every_worker=True,
    options=(
        Option(
            "--webrtc",
            "webrtc.enabled",
            {
                "action": "store_true",
                "default": None,
                "help": "also accept clients over WebRTC, with offers to /webrtc (requires the extra webrtc)",
            },
        ),
    ),
)

CHECK = CheckPart(summary="STUN and TURN servers that a robot names", examine=_examine)
