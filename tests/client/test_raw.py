"""Raw subscriptions: what the robot serialised with the server's stamp, and what comes without that."""

from __future__ import annotations

from typing import Any

import pytest

from rwt_client import RawMessage
from tests.client.worlds import until, world

pytestmark = pytest.mark.anyio


@pytest.mark.parametrize("distro", ["jazzy", "noetic"])
@pytest.mark.parametrize("transport", ["memory", "ws"])
async def test_messages_come_serialised_and_stamped(distro: str, transport: str) -> None:
    async with world(transport, distro) as here:
        stamps: list[int] = []
        here.node.subscribe("/text", on_sample=lambda sample: stamps.append(sample.stamp_ns))
        text = here.node.advertise("/text", "std_msgs/String")
        heard: list[RawMessage] = []
        subscription = await here.robot.subscribe_raw("/text", None, heard.append)
        await here.subscribed("/text")
        await until(lambda: len(here.graph.topic("/text").subscribers) == 2)  # type: ignore[union-attr]  # it is there
        text.publish({"data": "hello"})
        await until(lambda: heard)
        message = subscription.type.from_ros1 if distro == "noetic" else subscription.type.from_cdr
        assert message(heard[0].data).data == "hello"  # type: ignore[attr-defined]  # a String
        assert heard[0].stamp_ns == stamps[0]
        subscription.close()
        await until(lambda: len(here.graph.topic("/text").subscribers) == 1)  # type: ignore[union-attr]  # likewise


async def test_json_over_a_transport_without_cbor_is_serialised_here_without_a_stamp() -> None:
    async with world("tcp") as here:
        text = here.node.advertise("/text", "std_msgs/String")
        heard: list[RawMessage] = []
        subscription = await here.robot.subscribe_raw("/text", "std_msgs/String", heard.append)
        await here.subscribed("/text")
        text.publish({"data": "hello"})
        await until(lambda: heard)
        value: Any = subscription.type.from_cdr(heard[0].data)
        assert (value.data, heard[0].stamp_ns) == ("hello", None)
