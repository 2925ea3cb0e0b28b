"""Signalling through a hub: after the handshake nothing passes through it."""

from __future__ import annotations

import asyncio

import httpx
import pytest

from rwt import Server
from rwt.extensions.hub.hub import open_hub
from rwt.extensions.hub.part import DialSettings
from rwt.extensions.hub.relay.protocol import decode_assignment, encode_request
from rwt.settings.models import Settings
from rwt_client import connect
from rwt_transports.http.routes import HttpRequest
from rwt_webrtc.settings import WebRtcSettings
from tests.waiting import until

pytestmark = pytest.mark.anyio


async def test_a_robot_that_dials_in_is_reached_without_its_hub() -> None:
    async with open_hub("ws://127.0.0.1:0") as hub:
        dialing = DialSettings(urls=(f"{hub.url}/robots/rosie",))
        settings = Settings(listen=(), dial=dialing, webrtc=WebRtcSettings(enabled=True))
        async with Server(settings=settings) as server:
            server.node("robot").advertise_service(
                "/beep", "std_srvs/Trigger", lambda request: {"success": True, "message": "here"}
            )
            await until(lambda: any(each.idle for each in hub.robots))
            url = f"{hub.url.replace('ws://', 'webrtc+http://')}/rosie"
            async with connect(url) as robot:
                # No connection of the robot to its hub is in use: the offer's is over.
                await until(lambda: not any(each.pairs for each in hub.robots))
                assert (await robot.call("/beep")).message == "here"
                assert not any(each.pairs for each in hub.robots)


def test_it_is_signalled_to_a_robot_in_a_program_of_plain_asyncio() -> None:
    """Source of callbacks outside of an event loop known to anyio."""

    async def program() -> str:
        async with open_hub("ws://127.0.0.1:0") as hub:
            dialing = DialSettings(urls=(f"{hub.url}/robots/rosie",))
            settings = Settings(listen=(), dial=dialing, webrtc=WebRtcSettings(enabled=True))
            async with Server(settings=settings):
                await until(lambda: any(each.idle for each in hub.robots))
                url = f"{hub.url.replace('ws', 'http', 1)}/rosie/webrtc"
                async with httpx.AsyncClient(timeout=60) as client:
                    return (await client.get(url)).text

    assert asyncio.run(program()) == '{"iceServers": []}'


def test_the_body_of_a_request_comes_out_as_it_went_in() -> None:
    request = HttpRequest("POST", "/webrtc", "a=1", {"content-type": "application/sdp"}, b"v=0\r\n\xff")
    again = decode_assignment(encode_request(request, "/webrtc", "/rosie"))
    assert isinstance(again, HttpRequest)
    assert (again.method, again.body, again.prefix) == ("POST", b"v=0\r\n\xff", "/rosie")
