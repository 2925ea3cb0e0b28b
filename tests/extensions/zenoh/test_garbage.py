"""Malformed bytes and tokens from the network on the keys of a robot."""

from __future__ import annotations

import time

import pytest
import zenoh

from rwt import Server
from rwt.extensions.zenoh import ZenohGraph
from tests.core.rosbridge.recording_client import Client
from tests.waiting import until

pytestmark = pytest.mark.anyio

CHATTER = (
    "0/chatter/std_msgs::msg::dds_::String_"
    "/RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
)
FLOOD = 5_000
BEGINNING = bytes.fromhex("0001000003000000")
"""Of a String of two letters, in CDR."""
MOST_LINES = 110
"""Of each place: a burst; and five a second."""


async def test_a_flood_of_garbage_fills_no_log_and_hides_no_message(
    graph: ZenohGraph, peer: zenoh.Session, caplog: pytest.LogCaptureFixture
) -> None:
    began = time.monotonic()
    async with Server("ws://127.0.0.1:0", graph=graph) as server:
        client = Client(server.bridge)
        client.say("subscribe", topic="/chatter", type="std_msgs/String")
        server.node("robot").subscribe("/chatter", lambda message: None, type="std_msgs/String")

        async def pass_on(word: bytes) -> None:
            def is_heard() -> bool:
                peer.put(CHATTER, BEGINNING + word + b"\0")
                return {"data": word.decode()} in client.heard_of("/chatter")

            await until(is_heard)

        await pass_on(b"hi")  # From now on the peer knows that somebody listens.
        for number in range(FLOOD):
            peer.put(CHATTER, b"garbage %d" % number, attachment=b"no attachment")
            peer.put(CHATTER, b"\x00\x01\x00\x00\xff\xff\xff\xff")
        declared = [
            peer.liveliness().declare_token(f"@ros2_lv/0/{'g' * 9}{number}/0/1/MP/%/%/%/x")
            for number in range(200)
        ]
        await pass_on(b"ho")
        for token in declared:
            token.undeclare()
    of_place: dict[tuple[str, int], int] = {}
    for record in caplog.records:
        place = record.pathname, record.lineno
        of_place[place] = of_place.get(place, 0) + 1
    assert of_place, "garbage is mentioned"
    assert max(of_place.values(), default=0) <= MOST_LINES + 5 * (time.monotonic() - began), of_place
    assert graph.running
