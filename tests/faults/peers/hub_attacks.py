"""Attacks of peers on a robot that is reached through a hub, which only forwards their offers."""

from __future__ import annotations

import asyncio
from struct import pack

import httpx

from rwt import Server
from rwt.extensions.hub.hub import open_hub
from rwt.extensions.hub.part import DialSettings
from rwt.settings.models import Settings
from rwt_client import connect
from rwt_webrtc.settings import WebRtcSettings
from tests.faults.peers.attacks import Damage, attack, chunk, send
from tests.faults.peers.datagram_attacks import flood, host_of
from tests.waiting import until
from tests.webrtc.peers import Side, other_side

WEBRTC = WebRtcSettings(enabled=True, addresses="all")
"""With private addresses: the robot does not believe a hub that its client is on the robot's machine."""


@attack
async def through_a_hub(side: Side, damage: Damage) -> None:
    """A HEARTBEAT without a length, SACKs with hundreds of gap blocks, and datagrams before ICE completes."""
    async with open_hub("ws://127.0.0.1:0") as hub:
        dialing = DialSettings(urls=(f"{hub.url}/robots/rosie",))
        settings = Settings(listen=(), dial=dialing, webrtc=WEBRTC)
        url = f"{hub.url.replace('ws', 'http', 1)}/rosie"
        async with (
            Server(settings=settings) as server,
            httpx.AsyncClient(timeout=60, headers={"Content-Type": "application/sdp"}) as client,
            other_side() as other,
            other_side() as silent,
        ):
            server.node("robot").advertise_service(
                "/beep", "std_srvs/Trigger", lambda request: {"success": True, "message": "here"}
            )
            await until(lambda: any(each.is_reachable for each in hub.robots))
            channel = other.connection.createDataChannel("open")
            answer = await client.post(f"{url}/webrtc", content=await other.offer())
            await other.take_answer(answer.text)
            await until(lambda: channel.readyState == "open")
            damage.begin()  # Libraries were loaded.
            sctp = other.connection.sctp
            assert sctp is not None
            await send(sctp, chunk(4, bytes(4)))
            body = pack("!LLHH", (sctp._last_received_tsn or 0), 1 << 20, 280, 0)
            await send(sctp, chunk(3, body + pack("!HH", 0, 65535) * 280))
            silent.connection.createDataChannel("never")
            answer = await client.post(f"{url}/webrtc", content=await silent.offer())
            await flood(*host_of(answer.text))
            await asyncio.sleep(0.1)
            async with connect(f"webrtc+{url}") as robot:
                assert (await robot.call("/beep")).message == "here"
