"""Signalling through a hub: after the handshake nothing passes through it."""

from __future__ import annotations

import asyncio

import httpx
import pytest

from rwt import Server
from rwt.extensions.hub.hub import open_hub
from rwt.extensions.hub.part import DialSettings
from rwt.settings.models import Settings
from rwt_client import connect
from rwt_webrtc.settings import WebRtcSettings
from tests.waiting import until

pytestmark = pytest.mark.anyio

WEBRTC = WebRtcSettings(enabled=True, addresses="all")
"""With private addresses: the robot does not believe a hub that its client is on the robot's machine."""


async def test_a_robot_that_dials_in_is_reached_without_its_hub() -> None:
    async with open_hub("ws://127.0.0.1:0") as hub:
        dialing = DialSettings(urls=(f"{hub.url}/robots/rosie",))
        settings = Settings(listen=(), dial=dialing, webrtc=WEBRTC)
        async with Server(settings=settings) as server:
            server.node("robot").advertise_service(
                "/beep", "std_srvs/Trigger", lambda request: {"success": True, "message": "here"}
            )
            await until(lambda: any(each.is_reachable for each in hub.robots))
            url = f"{hub.url.replace('ws://', 'webrtc+http://')}/rosie"
            async with connect(url) as robot:
                # No stream of the robot's uplink is in use: the offer's is over.
                await until(lambda: not any(each.clients for each in hub.robots))
                assert (await robot.call("/beep")).message == "here"
                assert not any(each.clients for each in hub.robots)


def test_it_is_signalled_to_a_robot_in_a_program_of_plain_asyncio() -> None:
    """Source of callbacks outside of an event loop known to anyio."""

    async def program() -> str:
        async with open_hub("ws://127.0.0.1:0") as hub:
            dialing = DialSettings(urls=(f"{hub.url}/robots/rosie",))
            settings = Settings(listen=(), dial=dialing, webrtc=WEBRTC)
            async with Server(settings=settings):
                await until(lambda: any(each.is_reachable for each in hub.robots))
                url = f"{hub.url.replace('ws', 'http', 1)}/rosie/webrtc"
                async with httpx.AsyncClient(timeout=60) as client:
                    return (await client.get(url)).text

    assert asyncio.run(program()) == '{"iceServers": []}'
