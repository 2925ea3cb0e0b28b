"""Messages in other forms than plain JSON: fragments, pictures, large messages, several in one."""

from __future__ import annotations

import json

import pytest

from tests.core.client.worlds import scripted

pytestmark = pytest.mark.anyio

TEXT = "é" * 30_000
PUBLISHED = json.dumps({"op": "publish", "topic": "/text", "msg": {"data": TEXT}}).encode()


async def _received(*frames: bytes) -> str:
    async with scripted() as (server, robot), robot.topic("/text", "std_msgs/String") as texts:
        await server.hears("subscribe")
        for frame in frames:
            server.say_raw(frame)
        return str((await texts.get(timeout=5)).data)


async def test_a_large_message_is_read() -> None:
    assert len(PUBLISHED) > 100_000
    assert await _received(PUBLISHED) == TEXT


PADDING = b'"data":"' + b"x" * 400 + b'"'


@pytest.mark.parametrize(
    "frame",
    [
        b'{"op":"publish","topic":"/text","msg":{' + PADDING + b"}}",
        b'{"op": "publish", "topic": "/text", "msg": {' + PADDING + b"}}",
        b'{"op":"publish","topic":"/text","msg":{' + PADDING + b'},"latch":false}',
        b'{"op":"publish","topic":"/text","msg":{' + PADDING + b'},"more":{"a":{}}}',
        b'{"op":"publish","topic":"/text","msg":{"data":"wrong"},"msg":{' + PADDING + b"}}",
        b'{"topic":"/text","op":"publish","msg":{' + PADDING + b"}}\n",
    ],
)
async def test_the_message_is_found_wherever_it_stands(frame: bytes) -> None:
    assert await _received(frame) == "x" * 400


async def test_what_only_looks_like_a_message_is_left_out(caplog: pytest.LogCaptureFixture) -> None:
    broken = b'{"op":"publish","topic":"/text","msg":{' + PADDING + b"}"
    good = b'{"op":"publish","topic":"/text","msg":{"data":"good"}}'
    assert await _received(broken, broken + b"}}", good) == "good"
    assert "a message on /text is left out" in caplog.text


async def test_two_messages_in_one_frame() -> None:
    first = b'{"op":"publish","topic":"/other","msg":{"data":"a"}}'
    second = b'{"op":"publish","topic":"/text","msg":{"data":"b"}}'
    assert await _received(first + second) == "b"


async def test_json_in_a_binary_frame() -> None:
    async with scripted() as (server, robot), robot.topic("/text", "std_msgs/String") as texts:
        await server.hears("subscribe")
        server.say_raw(b'{"op":"publish","topic":"/text","msg":{"data":"a"}}', binary=True)
        assert (await texts.get(timeout=5)).data == "a"


async def test_the_level_of_complaints_is_asked_for_only_if_wanted() -> None:
    async with scripted(status_level="error") as (server, _):
        assert (await server.hears("set_level"))["level"] == "error"
    async with scripted(status_level=None) as (server, robot):
        await robot.topic("/text", "std_msgs/String")
        await server.hears("subscribe")
        assert server.ops("set_level") == []
