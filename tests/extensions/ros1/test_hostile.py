"""Peers that break the rules, against a graph that is its own master. ROS is not needed."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from functools import partial
from typing import Any
from xmlrpc.client import Fault, ServerProxy

import anyio
import anyio.abc
import anyio.to_thread
import pytest

from rwt.extensions.ros1 import Ros1Graph, discovery
from rwt.extensions.ros1.node import Ros1Node
from rwt.extensions.ros1.wire import links, rpc, xmlrpc
from rwt.extensions.ros1.wire.tcpros import decode_header, encode_header, length_prefix
from rwt_graph.errors import Ros1Error
from tests.processes import free_port
from tests.waiting import until

pytestmark = [
    pytest.mark.anyio,
    pytest.mark.parametrize("anyio_backend", ["asyncio", "trio"]),
]

Serve = Callable[[anyio.abc.SocketStream], Awaitable[None]]

STRING = {
    "callerid": "/hostile",
    "topic": "/chatter",
    "type": "std_msgs/String",
    "md5sum": "992ce8a1687cec8c8bd883ec73ca41d1",
    "message_definition": "string data\n",
}


@pytest.fixture
async def graph(anyio_backend: str, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Ros1Graph]:
    """A graph that is the master."""
    monkeypatch.setenv("ROS_IP", "127.0.0.1")
    monkeypatch.setattr(discovery, "POLL_SECONDS", 0.05)
    async with Ros1Graph(master=f"ros1-master://127.0.0.1:{free_port()}") as joined:
        yield joined


async def opened(graph: Ros1Graph, name: str) -> Ros1Node:
    """Return a node of the graph once it accepts connections."""
    assert graph.session is not None
    node = graph.session.nodes[name]
    await node.opened.wait()
    return node


@pytest.fixture
async def talker(graph: Ros1Graph) -> Ros1Node:
    """A node that publishes on `/chatter`."""
    graph.node("talker").advertise("/chatter", "std_msgs/String")
    return await opened(graph, "/talker")


def master_that_answers(graph: Ros1Graph, answer: rpc.Dispatch) -> AbstractAsyncContextManager[int]:
    """A master of another program, and its port."""
    assert graph.session is not None
    return rpc.serve(graph.session.network, "127.0.0.1", answer)


@pytest.fixture
async def tasks(graph: Ros1Graph) -> AsyncIterator[anyio.abc.TaskGroup]:
    async with anyio.create_task_group() as group:
        yield group
        group.cancel_scope.cancel()


class Hostile:
    """A node that answers calls as a node does, and connections of subscribers as `serve` does."""

    def __init__(self, graph: Ros1Graph, serve: Serve) -> None:
        self._graph = graph
        self._serve = serve
        self.uri = ""
        self.port = 0

    async def run(self, *, task_status: anyio.abc.TaskStatus[None]) -> None:
        data = await anyio.create_tcp_listener(local_host="127.0.0.1")
        self.port = data.extra(anyio.abc.SocketAttribute.local_port)
        assert self._graph.session is not None
        async with rpc.serve(self._graph.session.network, "127.0.0.1", self._dispatch) as port, data:
            self.uri = f"http://127.0.0.1:{port}/"
            task_status.started()
            await data.serve(self._serve)

    def _dispatch(self, method: str, params: tuple[Any, ...]) -> Any:
        return [1, "", ["TCPROS", "127.0.0.1", self.port] if method == "requestTopic" else 0]

    async def publish(self, topic: str = "/chatter", type: str = "std_msgs/String") -> None:
        await rpc.call(self._graph.master, "registerPublisher", "/hostile", topic, type, self.uri)


async def receive_header(stream: anyio.abc.SocketStream) -> dict[str, str]:
    received = b""
    while len(received) < 4 or len(received) < 4 + int.from_bytes(received[:4], "little"):
        received += await stream.receive()
    return decode_header(received[4:])


def sends(*chunks: bytes) -> Serve:
    """A publisher that sends these bytes after the subscriber's header, and then waits."""

    async def serve(stream: anyio.abc.SocketStream) -> None:
        async with stream:
            await receive_header(stream)
            for chunk in chunks:
                await stream.send(chunk)
            with pytest.raises((anyio.EndOfStream, anyio.BrokenResourceError)):
                await stream.receive()

    return serve


GOOD = encode_header(STRING) + length_prefix(6) + length_prefix(2) + b"hi"


async def start(graph: Ros1Graph, tasks: anyio.abc.TaskGroup, serve: Serve) -> Hostile:
    hostile = Hostile(graph, serve)
    await tasks.start(hostile.run)
    return hostile


@pytest.mark.parametrize(
    ("chunks", "text"),
    [
        ((b"\xff\xff\xff\xff",), "4294967295 bytes"),
        ((encode_header(STRING), b"\xff\xff\xff\xff"), ""),
        ((length_prefix(10) + b"not a head",), "malformed"),
        ((encode_header({**STRING, "md5sum": "0" * 32}),), "MD5 sum"),
        ((encode_header({**STRING, "type": "other/Type", "md5sum": "1"}),), "MD5 sum"),
        (
            (
                encode_header(
                    {**STRING, "type": "std_msgs/Int8", "md5sum": "27ffa0c9c4b8fb8492252bcad9e5c57b"}
                ),
            ),
            "has type",
        ),
        ((encode_header({**STRING, "md5sum": "1", "message_definition": "int8 a\n" * 60_000}),), "too large"),
        ((encode_header({"error": "go away"}),), "go away"),
        ((encode_header(STRING), length_prefix(3) + b"abc"), "sent what is no std_msgs/String"),
    ],
)
async def test_a_hostile_publisher_hurts_nobody_else(
    graph: Ros1Graph,
    tasks: anyio.abc.TaskGroup,
    chunks: tuple[bytes, ...],
    text: str,
    caplog: pytest.LogCaptureFixture,
) -> None:
    hostile = await start(graph, tasks, sends(*chunks))
    texts: list[str] = []
    node = graph.node("listener")
    node.subscribe("/chatter", lambda each: texts.append(each.data), "std_msgs/String")
    await hostile.publish()
    if text:
        await until(lambda: text in caplog.text)
    good = await start(graph, tasks, sends(GOOD))
    await rpc.call(graph.master, "registerPublisher", "/good", "/chatter", "std_msgs/String", good.uri)
    await until(lambda: "hi" in texts)


async def test_a_peer_that_says_nothing_is_dropped(talker: Ros1Node, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(links, "CONNECT_SECONDS", 0.1)
    host, port = rpc.address_of(talker.service_uri, "rosrpc")
    async with await anyio.connect_tcp(host, port) as stream:
        await stream.send(b"\x10")  # A drip.
        with anyio.fail_after(20):
            with pytest.raises((anyio.EndOfStream, anyio.BrokenResourceError)):
                await stream.receive()


@pytest.mark.parametrize(
    "request_bytes",
    [
        b"GET / HTTP/1.1\r\nHost: a\r\n\r\n",
        b"\0" * 100_000,
        b"POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 99999999999\r\n\r\n" + b"x" * 1000,
        b"POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 5\r\n\r\n<a/>\n",
    ],
)
async def test_garbage_on_the_slave_api_is_survived(talker: Ros1Node, request_bytes: bytes) -> None:
    uri = talker.uri
    async with await anyio.connect_tcp(*rpc.address_of(uri)) as stream:
        await stream.send(request_bytes)
        assert await rpc.call(uri, "getName", "/me") == "/talker"
    for wrong in (("requestTopic", "/me"), ("publisherUpdate", "/me", "/chatter", 5), ("nothing", "/me")):
        with pytest.raises(Ros1Error):
            await rpc.call(uri, *wrong)


async def test_connections_to_one_node_are_limited(talker: Ros1Node) -> None:
    uri = talker.uri
    streams = [await anyio.connect_tcp(*rpc.address_of(uri)) for _ in range(80)]
    with anyio.fail_after(30), pytest.raises((anyio.EndOfStream, anyio.BrokenResourceError)):
        await streams[0].receive()  # The one that was idle for longest made room.
    assert await rpc.call(uri, "getName", "/me") == "/talker"
    for stream in streams:
        await stream.aclose()
    assert await rpc.call(uri, "getName", "/me") == "/talker"


async def test_an_idle_connection_to_a_node_is_closed(
    graph: Ros1Graph, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rpc, "IDLE_SECONDS", 0.2)
    graph.node("talker").advertise("/chatter", "std_msgs/String")
    uri = (await opened(graph, "/talker")).uri
    async with await anyio.connect_tcp(*rpc.address_of(uri)) as stream:
        with anyio.fail_after(30), pytest.raises((anyio.EndOfStream, anyio.BrokenResourceError)):
            await stream.receive()


async def test_the_calls_of_one_call_are_answered_one_by_one(graph: Ros1Graph) -> None:
    calls = [
        {"methodName": "registerSubscriber", "params": ["/one", "/topic", "std_msgs/String", "http://one:1"]},
        {"methodName": "lookupNode", "params": ["/me", "/one"]},
        {"methodName": "system.multicall", "params": [[]]},
        {"methodName": "lookupNode"},
        {"methodName": "unregisterSubscriber", "params": ["/one", "/topic", "http://one:1"]},
        {"methodName": "lookupNode", "params": ["/me", "/one"]},
    ]
    proxy: Any
    with ServerProxy(graph.master) as proxy:
        answers = await anyio.to_thread.run_sync(proxy.system.multicall, calls)
        with pytest.raises(Fault, match="a list of calls"):
            await anyio.to_thread.run_sync(proxy.system.multicall, "calls")
    faults = [each["faultString"] for each in answers if isinstance(each, dict)]
    assert faults == ["method system.multicall is not supported", "malformed call"]
    assert [each[0] for each in answers if isinstance(each, list)] == [
        [1, "registered", []],
        [1, "node api", "http://one:1"],
        [1, "unregistered", 1],
        [-1, "unknown node [/one]", ""],
    ]


async def test_ten_thousand_topics_are_listed(graph: Ros1Graph, caplog: pytest.LogCaptureFixture) -> None:
    state = [[[f"/t{number}", ["/many"]] for number in range(10_000)], [], []]
    types = [[f"/t{number}", "std_msgs/String"] for number in range(10_000)]
    answers = {"getSystemState": state, "getTopicTypes": types}
    fake = master_that_answers(graph, lambda method, _: [1, "", answers.get(method, {})])
    async with fake as port, Ros1Graph(master=f"ros1://127.0.0.1:{port}") as other:
        await until(lambda: len(other.topics()) > 10_000)
        assert [node.name for node in other.nodes() if node.name == "/many"] == ["/many"]


@pytest.mark.parametrize(
    "answer",
    [0, [1, "", 5], [1, "", [[], []]], [[]], [1, "", [[["/a", 5], 7], [["/b", [1, {}]]], [[]]]], {"a": 1}],
)
async def test_a_hostile_master_is_survived(
    graph: Ros1Graph, answer: Any, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    fake = master_that_answers(graph, lambda _method, _params: answer)
    async with fake as port, Ros1Graph(master=f"ros1://127.0.0.1:{port}") as other:
        node = other.node("both")
        heard: list[str] = []
        node.subscribe("/chatter", lambda each: heard.append(each.data), "std_msgs/String")
        node.advertise("/chatter", "std_msgs/String").publish({"data": "here"})
        await until(partial(bool, heard))
        await anyio.sleep(0.2)
    assert xmlrpc.BODY_BYTES < 2**25


@pytest.mark.usefixtures("talker")
async def test_a_node_that_cannot_connect_back_is_reported_with_the_address_it_was_given(
    graph: Ros1Graph, caplog: pytest.LogCaptureFixture
) -> None:
    deaf = "http://127.0.0.1:9/"
    await rpc.call(graph.master, "registerSubscriber", "/deaf", "/chatter", "std_msgs/String", deaf)
    await until(lambda: "has not connected to this process" in caplog.text)
    assert "node /deaf subscribes to /chatter" in caplog.text
    assert "at 127.0.0.1, the address it was given (ROS_IP). Set ROS_IP to an address" in caplog.text


async def test_publishers_are_found_where_no_update_of_the_master_arrives(
    graph: Ros1Graph, tasks: anyio.abc.TaskGroup, caplog: pytest.LogCaptureFixture
) -> None:
    good = await start(graph, tasks, sends(GOOD))
    answers = {
        "getSystemState": [[["/chatter", ["/hostile"]]], [], []],
        "getTopicTypes": [["/chatter", "std_msgs/String"]],
        "registerSubscriber": [],
        "lookupNode": good.uri,
    }
    fake = master_that_answers(graph, lambda method, _: [1, "", answers.get(method, {})])
    texts: list[str] = []
    async with fake as port, Ros1Graph(master=f"ros1://127.0.0.1:{port}") as other:
        node = other.node("listener")
        node.subscribe("/chatter", lambda each: texts.append(each.data), "std_msgs/String")
        await until(lambda: "hi" in texts)
    assert "the ROS 1 master does not report the publishers of /chatter" in caplog.text


async def test_one_port_per_node_and_several_publishers(graph: Ros1Graph, tasks: anyio.abc.TaskGroup) -> None:
    texts: list[str] = []
    node = graph.node("listener")
    node.subscribe("/chatter", lambda each: texts.append(each.data), "std_msgs/String")
    for name in ("/first", "/second", "/third"):
        good = await start(graph, tasks, sends(GOOD))
        await rpc.call(graph.master, "registerPublisher", name, "/chatter", "std_msgs/String", good.uri)
    await until(lambda: len(texts) == 3)
    graph.node("other").advertise("/own", "std_msgs/String")
    await opened(graph, "/other")
    assert graph.session is not None
    assert len({each.uri for each in graph.session.nodes.values()}) == len(graph.session.nodes) > 1
