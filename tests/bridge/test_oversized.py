"""A message that is too large is skipped as it comes in, and told of; the connection lives."""

from __future__ import annotations

import json

import pytest
from websockets.asyncio.client import connect

from rwt import Server

MEBIBYTE = 1024 * 1024


@pytest.mark.parametrize("anyio_backend", ["asyncio"])
@pytest.mark.parametrize("size", [100 * 1000 * 1000, 64 * MEBIBYTE + 1])
@pytest.mark.anyio
async def test_a_message_of_100_mb_costs_nobody_anything(size: int) -> None:
    async with Server("ws://127.0.0.1:0") as server:
        url = server.urls[0]
        async with connect(url, compression=None) as clumsy, connect(url, compression=None) as other:
            subscribe = json.dumps({"op": "subscribe", "topic": "/x", "type": "std_msgs/String"})
            for wire in (clumsy, other):
                await wire.send(subscribe)
            await clumsy.send(json.dumps({"op": "set_level", "level": "error"}))
            huge = '{"op":"publish","topic":"/x","msg":{"data":"' + "x" * size + '"}}'
            await clumsy.send(huge)
            status = json.loads(await clumsy.recv())
            assert (status["op"], status["level"]) == ("status", "error")
            assert "max_message_size" in status["msg"]
            await clumsy.send(json.dumps({"op": "publish", "topic": "/x", "msg": {"data": "still here"}}))
            for wire in (clumsy, other):
                assert json.loads(await wire.recv())["msg"] == {"data": "still here"}
