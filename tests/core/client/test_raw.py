"""Raw subscriptions: what the robot serialised with the server's stamp, and what comes without that."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_client.wire.cbor import read_cbor, read_raw
from rwt_participant.messages import RawMessage
from rwt_protocol.codecs.cbor import publish_prefix, raw_publish_frame
from tests.core.client.worlds import World, world
from tests.waiting import until


def _subscribers(here: World) -> int:
    topic = here.graph.topic("/text")
    return len(topic.subscribers) if topic else 0


@pytest.mark.anyio
@pytest.mark.parametrize("distro", ["jazzy", "noetic"])
@pytest.mark.parametrize("transport", ["memory", "ws"])
async def test_messages_come_serialised_and_stamped(distro: str, transport: str) -> None:
    async with world(transport, distro) as here:
        stamps: list[int] = []
        here.node.subscribe_samples("/text", on_sample=lambda sample: stamps.append(sample.stamp_ns))
        text = here.node.advertise("/text", "std_msgs/String")
        heard: list[RawMessage] = []
        subscription = await here.robot.subscribe_raw("/text", heard.append)
        await here.subscribed("/text")
        await until(lambda: _subscribers(here) == 2)
        text.publish({"data": "hello"})
        await until(lambda: heard)
        read = subscription.type.from_ros1 if distro == "noetic" else subscription.type.from_cdr
        message: Any = read(heard[0].data)
        assert message.data == "hello"
        assert heard[0].stamp_ns == stamps[0]
        subscription.close()
        await until(lambda: _subscribers(here) == 1)


@pytest.mark.anyio
async def test_json_over_a_transport_without_cbor_is_serialised_here_without_a_stamp() -> None:
    async with world("tcp") as here:
        text = here.node.advertise("/text", "std_msgs/String")
        heard: list[RawMessage] = []
        subscription = await here.robot.subscribe_raw("/text", heard.append, "std_msgs/String")
        await here.subscribed("/text")
        text.publish({"data": "hello"})
        await until(lambda: heard)
        value: Any = subscription.type.from_cdr(heard[0].data)
        assert (value.data, heard[0].stamp_ns) == ("hello", None)


@given(
    topic=st.text(min_size=1, max_size=60),
    stamp=st.one_of(st.integers(0, 10**11), st.integers(10**18, 4 * 10**18)),
    data=st.one_of(st.binary(max_size=300), st.integers(65_530, 65_550).map(bytes)),
    cut=st.one_of(st.none(), st.integers(0, 100)),
    tail=st.binary(max_size=2),
)
def test_the_fast_reader_of_raw_frames_gives_what_the_other_gives(
    topic: str, stamp: int, data: bytes, cut: int | None, tail: bytes
) -> None:
    frame = raw_publish_frame(publish_prefix(topic), [data], stamp).data[:cut] + tail
    found = read_raw(frame)
    if found is None:
        return
    other: Any = read_cbor(frame)
    assert (other["op"], other["topic"].encode(), other["msg"]) == ("publish", *found)


@given(
    topic=st.text(min_size=1, max_size=60),
    nanoseconds=st.integers(0, 10**9 - 1),
    data=st.binary(max_size=300),
)
def test_the_fast_reader_reads_what_servers_send(topic: str, nanoseconds: int, data: bytes) -> None:
    frame = raw_publish_frame(publish_prefix(topic), [data], 1_700_000_000 * 10**9 + nanoseconds).data
    found = read_raw(frame)
    assert found == (topic.encode(), {"secs": 1_700_000_000, "nsecs": nanoseconds, "bytes": data})
