"""With pyzeros, an independent program that speaks rmw_zenoh's wire: topics and services, both ways."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from typing import Any

import anyio
import numpy as np
import pytest
import pyzeros
import zenoh
from cydr import types
from pyzeros.builtin_msgs import Attachment
from pyzeros.qos import QosProfile
from ros2_pyterfaces.cydr import all_srvs
from ros2_pyterfaces.cydr.all_msgs import String

from rwt.extensions.zenoh import ZenohGraph
from rwt_graph.api import Sample
from rwt_participant.errors import ProviderNotFound, ServiceFailed
from rwt_participant.messages import Message
from rwt_participant.qos import SENSOR_DATA
from tests.waiting import PATIENCE, until

#: Their parts are made at run time, which checkers cannot follow.
SetBool: Any = all_srvs.SetBool

# The first run on a machine compiles pyzeros's codecs.
pytestmark = [pytest.mark.anyio, pytest.mark.timeout(300)]


@pytest.fixture(scope="module", autouse=True)
def codecs() -> None:
    """Compile them before anything is waited for, and without optimising, which takes three times as long."""
    if shutil.which("cc") is None:
        pytest.skip("pyzeros compiles its codecs, and there is no C compiler here")
    attachment = Attachment(
        sequence_number=types.int64(0),
        source_timestamp=types.int64(0),
        source_gid=np.zeros(16, np.uint8),
    )
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("CFLAGS", "-O0 -g0")
        for message in (attachment, String(), SetBool.Request(), SetBool.Response()):
            type(message).deserialize(message.serialize())


@pytest.fixture
def other(peer: zenoh.Session) -> Iterator[Any]:
    """A node of pyzeros, `/demo/other`; what is made meanwhile belongs to it."""
    with pyzeros.auto_context(node="other", zenoh_session=peer, namespace="/demo") as node:
        yield node


async def test_a_topic_of_pyzeros_is_listed_typed_and_heard(graph: ZenohGraph, other: Any) -> None:
    publisher = other.create_publisher(String, "chatter", QosProfile.sensor_data())
    await until(lambda: graph.topic("/demo/chatter") is not None)
    info = graph.topic("/demo/chatter")
    assert info is not None
    assert info.type is graph.registry.message("std_msgs/String")
    assert [(e.node, e.type, e.qos) for e in info.publishers] == [
        ("/demo/other", "std_msgs/msg/String", SENSOR_DATA)
    ]
    assert [(node.name, node.publishing) for node in graph.nodes()] == [("/demo/other", ("/demo/chatter",))]
    samples: list[Sample] = []
    graph.participant("/ear").subscribe("/demo/chatter", samples.append)
    await until(lambda: bool(publisher.zenoh_pub.matching_status.matching))
    for word in (b"one", b"two"):
        publisher.publish(String(data=word))
    await until(lambda: len(samples) == 2)
    messages: list[Message] = [sample.payload.value() for sample in samples]
    assert [message.data for message in messages] == ["one", "two"]
    assert [sample.node for sample in samples] == ["/demo/other"] * 2
    publisher.close()
    await until(lambda: [node.publishing for node in graph.nodes()] == [(), ()])


async def test_pyzeros_hears_a_topic_of_the_graph(graph: ZenohGraph, other: Any) -> None:
    subscription = other.create_subscriber(String, "/chatter")
    first = subscription.wait_for_next()
    node = graph.node("mouth")
    publisher = node.advertise("chatter", "std_msgs/String")
    await until(lambda: publisher.subscriber_count == 1)
    publisher.publish({"data": "hello"})
    with anyio.fail_after(PATIENCE):
        assert (await first).data == b"hello"
    info = graph.topic("/chatter")
    assert info is not None
    assert [end.node for end in info.subscribers] == ["/demo/other"]
    subscription.close()
    await until(lambda: publisher.subscriber_count == 0)


async def test_a_service_of_pyzeros_is_called(graph: ZenohGraph, other: Any) -> None:
    server = other.create_service(SetBool, "switch")
    requests = server.listen_reliable()
    await until(lambda: graph.service("/demo/switch") is not None)
    info = graph.service("/demo/switch")
    assert info is not None
    assert (info.node, info.type) == ("/demo/other", graph.registry.service("std_srvs/SetBool"))

    async def serve() -> None:
        responder = await anext(requests)
        assert responder.request.data
        responder.response.success = True
        responder.response.message = b"done"
        responder.send()

    async with anyio.create_task_group() as tasks:
        tasks.start_soon(serve)
        with anyio.fail_after(PATIENCE):
            response = await graph.node("caller").call("/demo/switch", {"data": True}, timeout=PATIENCE)
    assert (response.success, response.message) == (True, "done")
    server.close()
    await until(lambda: graph.service("/demo/switch") is None)
    with pytest.raises(ProviderNotFound):
        await graph.node("late").call("/demo/switch")


async def test_pyzeros_calls_a_service_of_the_graph(graph: ZenohGraph, other: Any) -> None:
    def switch(request: Message) -> dict[str, object]:
        if not request.data:
            raise ServiceFailed("only on")
        return {"success": True, "message": "on"}

    graph.node("lamp").advertise_service("~/switch", "std_srvs/SetBool", switch)
    client = other.create_client(SetBool, "/lamp/switch")
    with anyio.fail_after(PATIENCE):
        await client.wait_for_service()
        response = await client.call_async(SetBool.Request(data=True))
        assert (response.success, response.message) == (True, b"on")
        with pytest.raises(RuntimeError, match=r"^only on$"):
            await client.call_async(SetBool.Request(data=False))
    client.close()
