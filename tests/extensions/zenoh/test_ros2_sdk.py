"""With zenoh-ros2-sdk, another independent program of that wire; it is given its definitions, lest it fetch
them."""

from __future__ import annotations

from collections.abc import AsyncIterator
from functools import partial
from typing import Any

import anyio.to_thread
import pytest
import zenoh_ros2_sdk as sdk
from zenoh_ros2_sdk.qos import QosDurability, QosProfile

from rwt.extensions.zenoh import ZenohGraph
from rwt_participant.messages import Message
from rwt_participant.qos import LATCHED
from tests.waiting import until, until_answered
from tests.zenoh_links import QUICK, free_endpoint

pytestmark = pytest.mark.anyio

STRING = {"msg_type": "std_msgs/msg/String", "msg_definition": "string data\n"}
SET_BOOL = {
    "srv_type": "std_srvs/srv/SetBool",
    "request_definition": "bool data\n",
    "response_definition": "bool success\nstring message\n",
}


@pytest.fixture
async def graph(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[ZenohGraph]:
    """A graph that the SDK's one session is connected to."""
    endpoint = free_endpoint()
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", "scouting/delay=20")
    async with ZenohGraph(listen=[endpoint], config=QUICK) as made:
        port = int(endpoint.rpartition(":")[2])
        session = await anyio.to_thread.run_sync(sdk.ZenohSession.get_instance, "127.0.0.1", port)
        try:
            yield made
        finally:
            await anyio.to_thread.run_sync(session.session.close)
            sdk.ZenohSession._instance = None


async def in_thread(function: Any, /, *args: object, **keywords: object) -> Any:
    """The SDK blocks."""
    return await anyio.to_thread.run_sync(partial(function, *args, **keywords))


async def test_topics_both_ways(graph: ZenohGraph) -> None:
    heard: list[str] = []
    theirs: list[str] = []
    publisher = await in_thread(sdk.ROS2Publisher, "/to_us", node_name="sdk_pub", **STRING)
    await in_thread(sdk.ROS2Subscriber, "/to_them", callback=lambda m: theirs.append(m.data), **STRING)
    await until(lambda: graph.topic("/to_us") is not None)
    info = graph.topic("/to_us")
    assert info is not None
    assert [(e.node, e.type) for e in info.publishers] == [("/sdk_pub", "std_msgs/msg/String")]

    def on_message(message: Message) -> None:
        heard.append(message.data)

    node = graph.node("ours")
    node.subscribe("/to_us", on_message)
    mouth = node.advertise("/to_them", "std_msgs/String")
    await until(lambda: mouth.subscriber_count == 1)
    mouth.publish({"data": "there"})
    await until(lambda: theirs == ["there"])
    while not heard:
        await in_thread(publisher.publish, data="here")
        await anyio.sleep(0.01)
    assert set(heard) == {"here"}


async def test_a_late_subscriber_is_given_what_a_latched_publisher_kept(graph: ZenohGraph) -> None:
    latched = graph.node("ours").advertise("/map_name", "std_msgs/String", qos=LATCHED)
    latched.publish({"data": "old"})
    latched.publish({"data": "hall"})
    theirs: list[str] = []
    qos = QosProfile(durability=QosDurability.TRANSIENT_LOCAL)
    await in_thread(
        sdk.ROS2Subscriber, "/map_name", callback=lambda m: theirs.append(m.data), qos=qos, **STRING
    )
    await until(lambda: theirs == ["hall"])


async def test_services_both_ways(graph: ZenohGraph) -> None:
    node = graph.node("ours")

    def switch(request: Message) -> dict[str, object]:
        return {"success": request.data, "message": "ours"}

    node.advertise_service("/our_switch", "std_srvs/SetBool", switch)
    client = await in_thread(sdk.ROS2ServiceClient, "/our_switch", **SET_BOOL)
    answer = await in_thread(client.call, data=True)
    assert (answer.success, answer.message) == (True, "ours")

    def serve(request: Any) -> Any:
        return server.response_msg_class(success=request.data, message="theirs")

    server = await in_thread(sdk.ROS2ServiceServer, "/their_switch", callback=serve, **SET_BOOL)
    await until(lambda: graph.service("/their_switch") is not None)
    response = await node.call("/their_switch", {"data": True}, timeout=20)
    assert (response.success, response.message) == (True, "theirs")


async def test_the_sdk_lists_what_the_graph_has(graph: ZenohGraph) -> None:
    node = graph.node("ours")
    node.advertise("/chatter", "std_msgs/String")
    node.advertise_service("/switch", "std_srvs/SetBool", lambda _: None)
    await listed(("/chatter", "std_msgs/msg/String"), sdk.get_topic_names_and_types)
    await listed(("/switch", "std_srvs/srv/SetBool"), sdk.get_service_names_and_types)


async def listed(what: tuple[str, str], ask: Any) -> None:
    """Wait until the SDK lists it."""

    async def is_listed() -> bool:
        return what in flat(await in_thread(ask))

    await until_answered(is_listed, f"the SDK does not list {what}")


def flat(names_and_types: Any) -> set[tuple[str, str]]:
    """Names with their types, whatever of dictionaries and pairs they came in."""
    pairs = names_and_types.items() if isinstance(names_and_types, dict) else names_and_types
    return {(name, type) for name, types in pairs for type in ([types] if isinstance(types, str) else types)}
