"""Our client over WebRTC, with our server."""

from __future__ import annotations

import pytest

from rwt import Server
from rwt.access.settings import AuthSettings, SettingsError, TokenSettings
from rwt_client import connect
from rwt_client.errors import ClientError
from rwt_transports import BadUrl
from rwt_transports.errors import ConnectError
from rwt_transports.schemes import parse_listen_url
from rwt_webrtc.settings import WebRtcSettings

WEBRTC = WebRtcSettings(enabled=True)


def _webrtc(server: Server, query: str = "") -> str:
    return server.urls[0].replace("ws://", "webrtc+http://") + query


@pytest.mark.anyio
async def test_calls_and_a_large_topic() -> None:
    async with Server("ws://127.0.0.1:0", webrtc=WEBRTC) as server:
        node = server.node("robot")
        node.advertise_service("/beep", "std_srvs/Trigger", lambda request: {"success": True, "message": "ü"})
        text = node.advertise("/text", "std_msgs/String", latch=True)
        text.publish({"data": "x" * 700_000})
        async with connect(_webrtc(server)) as robot:
            answer = await robot.call("/beep")
            assert (answer.success, answer.message) == (True, "ü")
            message = await robot.once("/text")
            assert len(message.data) == 700_000


@pytest.mark.anyio
async def test_a_token_is_asked_for() -> None:
    auth = AuthSettings(tokens={"ops": TokenSettings(token="operator-operator", role="admin")})
    async with Server("ws://127.0.0.1:0", webrtc=WEBRTC, auth=auth) as server:
        with pytest.raises((ConnectError, ClientError), match="401"):
            async with connect(_webrtc(server), reconnect=None):
                pass
        async with connect(_webrtc(server, "/?token=operator-operator")) as robot:
            await robot.call("/rosapi/get_time")


@pytest.mark.anyio
async def test_a_server_without_it_says_what_is_missing() -> None:
    async with Server("ws://127.0.0.1:0") as server:
        with pytest.raises((ConnectError, ClientError), match=r"webrtc\.enabled"):
            async with connect(_webrtc(server), reconnect=None):
                pass


@pytest.mark.anyio
@pytest.mark.parametrize("anyio_backend", ["trio"])
async def test_trio_is_refused_by_name() -> None:
    with pytest.raises(SettingsError, match="asyncio alone, and this event loop is another"):
        async with Server("ws://127.0.0.1:0", webrtc=WEBRTC):
            pass
    async with Server("ws://127.0.0.1:0") as server:
        with pytest.raises((ConnectError, ClientError), match="needs asyncio"):
            async with connect(_webrtc(server), reconnect=None):
                pass


def test_it_is_no_url_to_listen_on() -> None:
    with pytest.raises(BadUrl, match=r"webrtc\.enabled"):
        parse_listen_url("webrtc+http://127.0.0.1:9090")
