"""Cameras of clients as topics, with plain aiortc as the camera's side."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest
from aiortc import VideoStreamTrack
from av import Packet
from websockets.asyncio.client import connect

from rwt import Server
from rwt.access.settings import AuthSettings, RoleSettings, TokenSettings
from rwt_participant.qos import LATCHED
from rwt_webrtc.media.whip import SENDERS_TOPIC
from tests.waiting import until
from tests.webrtc.cameras import Picture, jpeg_colour, media_server, whip_url
from tests.webrtc.encoded_frames import vp8_header
from tests.webrtc.watching import media_peer, metric

pytestmark = pytest.mark.anyio

TOPIC = "/operator/camera"


async def test_a_camera_becomes_a_topic_until_it_ends() -> None:
    picture = Picture()
    async with media_server() as server, media_peer(picture) as camera:
        got: list[Any] = []
        server.node("robot").subscribe(TOPIC, got.append, "sensor_msgs/CompressedImage")
        await camera.connect(whip_url(server, f"topic={TOPIC}&frame_id=head&quality=95"))
        await until(lambda: got and abs(jpeg_colour(got[-1])[0] - 200) < 20)
        picture.colour = (30, 30, 200)
        await until(lambda: abs(jpeg_colour(got[-1])[2] - 200) < 20)
        assert (got[-1].format, got[-1].header.frame_id) == ("jpeg", "head")
        assert got[-1].header.stamp.sec > 0
        await camera.connection.close()
        await until(lambda: metric(server, "rwt_webrtc_peers") == 0)


def _senders(server: Server) -> list[list[tuple[str, str, str, str]]]:
    """Senders after each change."""
    told: list[list[tuple[str, str, str, str]]] = []

    def take(message: Any) -> None:
        told.append([(each.topic, each.kind, each.client, each.role) for each in message.senders])
        assert all(each.since.sec > 0 for each in message.senders)

    server.node("looker").subscribe(SENDERS_TOPIC, take, "rwt_gate_msgs/MediaSenders", qos=LATCHED)
    return told


async def test_who_sends_is_told_while_it_is_received() -> None:
    async with media_server() as server:
        told = _senders(server)
        async with media_peer(Picture()) as camera:
            await until(lambda: told == [[]])
            # An offer that nobody follows up lights nothing.
            status, _ = await camera.offer(whip_url(server, f"topic={TOPIC}"))
            assert status == 201
        async with media_peer(Picture()) as camera:
            await camera.connect(whip_url(server, f"topic={TOPIC}"))
            await until(lambda: len(told) > 1)
            assert told[-1] == [(TOPIC, "video", "whip:2", "admin")]
            late = _senders(server)
            await until(lambda: late == [told[-1]])
        await until(lambda: told[-1] == [])
        assert len(told) == 3


class Giant(VideoStreamTrack):
    """A camera whose encoded images claim 16383 x 16383 pixels."""

    async def recv(self) -> Packet[Any]:  # type: ignore[override]  # aiortc accepts encoded packets, its types only frames
        packet = Packet(vp8_header(16383, 16383))
        packet.pts, packet.time_base = await self.next_timestamp()
        return packet


async def test_an_image_that_claims_too_many_pixels_is_not_decoded(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    async with media_server() as server, media_peer(Giant()) as camera:
        await camera.connect(whip_url(server, f"topic={TOPIC}"))
        await until(lambda: "has ended: images of 268402689 pixels" in caplog.text)
        assert metric(server, "rwt_webrtc_peers") == 0
        assert "failed to decode" not in caplog.text


async def test_nobody_else_says_who_sends() -> None:
    roles = {"guest": RoleSettings(subscribe=("/camera/*",), publish=("*",))}
    auth = AuthSettings(
        tokens={
            "guest": TokenSettings(token="guest-guest-guest", role="guest"),
            "admin": TokenSettings(token="admin-admin-admin", role="admin"),
        }
    )
    async with media_server(auth=auth, roles=roles) as server:
        told = _senders(server)
        for token in ("guest-guest-guest", "admin-admin-admin"):
            async with connect(
                server.urls[0], additional_headers={"Authorization": f"Bearer {token}"}
            ) as client:
                await client.send('{"op": "set_level", "level": "error"}')
                for name in (SENDERS_TOPIC, SENDERS_TOPIC[1:]):
                    for op in ("advertise", "publish"):
                        message: dict[str, Any] = {
                            "op": op,
                            "topic": name,
                            "type": "rwt_gate_msgs/MediaSenders",
                            "msg": {},
                        }
                        await client.send(json.dumps(message))
                        answer = json.loads(await asyncio.wait_for(client.recv(), 20))
                        assert f"{SENDERS_TOPIC} is published by the server alone" in answer["msg"]
            async with media_peer(Picture()) as camera:
                status, why = await camera.offer(whip_url(server, f"topic={SENDERS_TOPIC}&token={token}"))
                assert (status, why) == (403, f"{SENDERS_TOPIC} is published by the server alone\n")
        assert told == [[]]


async def test_a_role_publishes_where_it_may() -> None:
    roles = {"guest": RoleSettings(publish=("/chatter",))}
    async with (
        media_server(auth=AuthSettings(default_role="guest"), roles=roles) as server,
        media_peer(Picture()) as camera,
    ):
        status, text = await camera.offer(whip_url(server, f"topic={TOPIC}"))
        assert status == 403
        assert "roles.guest.publish" in text


@pytest.mark.parametrize(
    ("query", "status", "why"),
    [
        ("", 400, "`topic` is missing"),
        ("topic=/a&quality=0", 400, "`quality` must be a whole number from 1 to 100"),
        ("topic=/a%20b", 400, "/a b"),
        ("topic=/rosout", 409, "rcl_interfaces"),
    ],
)
async def test_refusals(query: str, status: int, why: str) -> None:
    async with media_server() as server, media_peer(Picture()) as camera:
        got = await camera.offer(whip_url(server, query))
        assert (got[0], why in got[1]) == (status, True), got


async def test_a_camera_whose_role_may_not_any_more_is_ended() -> None:
    tokens = {"operator": TokenSettings(token="operator-operator", role="operator")}
    may = {"operator": RoleSettings(publish=("/operator/*",))}
    may_not = {"operator": RoleSettings(publish=("/chatter",))}
    async with (
        media_server(auth=AuthSettings(tokens=tokens), roles=may) as server,
        media_peer(Picture()) as camera,
    ):
        got: list[Any] = []
        server.node("robot").subscribe(TOPIC, got.append, "sensor_msgs/CompressedImage")
        await camera.connect(whip_url(server, f"topic={TOPIC}&token=operator-operator"))
        await until(lambda: got)
        server.settings = server.settings.model_copy(update={"roles": may_not})
        server.reload()
        await until(lambda: camera.connection.connectionState in ("closed", "failed"))


async def test_a_camera_ends_when_the_robot_gives_its_topic_another_type() -> None:
    async with media_server() as server, media_peer(Picture()) as camera:
        await camera.connect(whip_url(server, f"topic={TOPIC}"))
        await until(lambda: camera.connection.connectionState == "connected")
        server.node("robot").subscribe(TOPIC, lambda _: None, "std_msgs/String")
        await until(lambda: camera.connection.connectionState in ("closed", "failed"))
