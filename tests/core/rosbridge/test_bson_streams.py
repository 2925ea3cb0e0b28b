"""BSON-only mode beside WebSocket: documents one after the other on a stream of bytes."""

from __future__ import annotations

from typing import Any

import anyio
import bson
import pytest
from anyio.abc import ByteStream
from anyio.streams.buffered import BufferedByteReceiveStream

from rwt import Server
from rwt_transports.errors import BadUrl

pytestmark = pytest.mark.anyio


async def _receive(stream: BufferedByteReceiveStream) -> Any:
    head = await stream.receive_exactly(4)
    return bson.decode(head + await stream.receive_exactly(int.from_bytes(head, "little") - 4))


async def _send(stream: ByteStream, **message: object) -> None:
    await stream.send(bson.encode(message))


async def test_publish_and_call_over_tcp() -> None:
    async with Server("tcp://127.0.0.1:0", bson_only_mode=True) as server:
        server.node("adder").advertise_service(
            "/add", "example_interfaces/AddTwoInts", lambda request: {"sum": request.a + request.b}
        )
        port = int(server.urls[0].rpartition(":")[2])
        async with await anyio.connect_tcp("127.0.0.1", port) as stream:
            incoming = BufferedByteReceiveStream(stream)
            await _send(stream, op="subscribe", topic="/image", type="sensor_msgs/CompressedImage")
            await _send(stream, op="publish", topic="/image", msg={"format": "png", "data": b"\x00\xff"})
            published = await _receive(incoming)
            assert published["topic"] == "/image"
            assert published["msg"]["data"] == b"\x00\xff"
            await _send(stream, op="call_service", id="1", service="/add", args={"a": 2**40, "b": 1})
            reply = await _receive(incoming)
            assert (reply["id"], reply["values"], reply["result"]) == ("1", {"sum": 2**40 + 1}, True)


async def test_datagrams_carry_no_bson() -> None:
    with pytest.raises(BadUrl, match="BSON is not spoken over udp"):
        async with Server("udp://127.0.0.1:0", bson_only_mode=True):
            pass
