"""A message that is too large is skipped as it comes in: answered if its head tells what it is, else 1009."""

from __future__ import annotations

import json
from typing import Any

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from rwt import Server
from rwt_protocol.codecs.head_tail_split import head_members
from tests.core.rosbridge.recording_client import Client

MEBIBYTE = 1024 * 1024

REASON = "a message of 99 bytes: the limit is 9 (max_message_size)"


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
            huge = '{"op":"publish","id":"p","topic":"/x","msg":{"data":"' + "x" * size + '"}}'
            await clumsy.send(huge)
            status = json.loads(await clumsy.recv())
            assert (status["op"], status["level"], status["id"]) == ("status", "error", "p")
            assert "max_message_size" in status["msg"]
            await clumsy.send(json.dumps({"op": "publish", "topic": "/x", "msg": {"data": "still here"}}))
            for wire in (clumsy, other):
                assert json.loads(await wire.recv())["msg"] == {"data": "still here"}


@pytest.mark.anyio
async def test_a_caller_hears_of_it_and_whoever_cannot_be_answered_is_closed_with_1009() -> None:
    async with (
        Server("ws://127.0.0.1:0", max_message_size=4096) as server,
        connect(server.urls[0], compression=None) as caller,
    ):
        call = {"op": "call_service", "id": 7, "service": "/x", "args": {"text": "x" * 5000}}
        await caller.send(json.dumps(call))
        answer = json.loads(await caller.recv())
        assert (answer["op"], answer["id"], answer["result"]) == ("service_response", 7, False)
        assert "5,0" not in answer["values"] and "max_message_size" in answer["values"]
        await caller.send(json.dumps({"args": {"text": "x" * 5000}, "op": "call_service", "id": 8}))
        with pytest.raises(ConnectionClosed) as closed:
            await caller.recv()
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1009
        assert "max_message_size" in closed.value.rcvd.reason


@pytest.mark.parametrize(
    ("head", "answer"),
    [
        ({"op": "call_service", "service": "/x", "id": "a"}, {"op": "service_response", "id": "a"}),
        ({"id": "a", "op": "call_service", "service": "/x"}, {"op": "service_response", "id": "a"}),
        ({"op": "send_action_goal", "id": 3, "action": "/x"}, {"op": "action_result", "id": 3}),
        ({"op": "publish", "id": "p", "topic": "/x"}, {"op": "status", "id": "p"}),
    ],
)
def test_an_op_and_its_id_in_the_head_are_enough_for_an_answer(
    client: Client, head: dict[str, Any], answer: dict[str, Any]
) -> None:
    client.say("set_level", level="error")
    text = json.dumps(head)[:-1] + ', "args": {"long": "xxxx'
    client.peer.oversized(99, 9, text.encode())
    (heard,) = client.heard()
    assert {key: heard[key] for key in answer} == answer
    assert heard.get("msg", heard.get("values")) == f"{head['op']}: {REASON}"
    assert client.close_code is None


@pytest.mark.parametrize(
    "head",
    [
        '{"op": "call_service", "service": "/x", "args": {"',
        '{"id": "a", "service": "/x", "args": {"',
        '{"op": "call_service", "id": "a',
        '{"op": "dance", "id": "a", "args": {"',
        '{"op": 5, "id": "a", "args": {"',
        "[[[[[[",
        "",
        "\x00\xff" * 500,
    ],
)
def test_otherwise_the_connection_is_closed(client: Client, head: str) -> None:
    client.peer.oversized(99, 9, head.encode("latin-1"))
    assert (client.close_code, client.close_reason) == (1009, REASON)
    assert client.heard() == []


def test_a_response_that_is_too_large_ends_the_call(client: Client, other: Client) -> None:
    other.say("advertise_service", service="/x", type="std_srvs/Trigger")
    client.say("call_service", id="c", service="/x")
    (request,) = other.heard()
    head = {"op": "service_response", "id": request["id"], "service": "/x", "result": True}
    other.peer.oversized(99, 9, (json.dumps(head)[:-1] + ', "values": {"message": "').encode())
    (reply,) = client.heard()
    assert (reply["id"], reply["result"]) == ("c", False)
    assert "max_message_size" in reply["values"]


@pytest.mark.parametrize(
    ("head", "members"),
    [
        (b'{"op":"publish","topic":"/x","msg":{"data":"xx', {"op", "topic"}),
        (b' { "op" : "publish" , "msg" : { "a" : [1] } , "id":1, "x', {"op", "msg", "id"}),
        (b'{"op":"publ', set()),
        (b"\xff\xfe", set()),
        (b'{"op":"\xff","id":1,', set()),
    ],
)
def test_the_members_that_a_head_tells(head: bytes, members: set[str]) -> None:
    assert set(head_members(head)) == members
