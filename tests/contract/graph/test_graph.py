from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import anyio
import anyio.lowlevel
import pytest

from rwt_graph import InvalidGraphName

if TYPE_CHECKING:
    from rwt_graph.api import Publisher, Registration, Subscription
    from tests.contract.graph.harness import Harness

pytestmark = pytest.mark.anyio


async def test_nodes_and_what_they_take_part_in(harness: Harness) -> None:
    registry = harness.graph.registry
    string, trigger = registry.message("std_msgs/String"), registry.service("std_srvs/Trigger")
    fibonacci = registry.action(harness.fibonacci)
    a, twin, b = (harness.graph.participant(name) for name in ("/a", "/a", "/b"))
    a.advertise("/y", string)
    twin.advertise("/x", string)
    a.subscribe("/z", lambda _: None, string)
    a.advertise_service("/s", trigger, lambda _: None)
    b.advertise_action("/f", fibonacci, lambda _: None)
    await harness.settle()
    nodes = {node.name: node for node in harness.graph.nodes()}
    assert sorted(nodes) == ["/a", "/b"]
    assert nodes["/a"].publishing == ("/x", "/y")
    assert nodes["/a"].subscribing == ("/z",)
    assert nodes["/a"].services == ("/s",)
    assert nodes["/b"].actions == ("/f",)
    a.close()
    await harness.settle()
    assert [node.name for node in harness.graph.nodes()] == ["/a", "/b"]
    twin.close()
    await harness.settle()
    assert [node.name for node in harness.graph.nodes()] == ["/b"]


async def test_services_actions_and_topics_are_listed_by_name(harness: Harness) -> None:
    registry = harness.graph.registry
    a = harness.graph.participant("/a")
    for name in ("/b", "/a"):
        a.advertise_service(name, registry.service("std_srvs/Trigger"), lambda _: None)
        a.advertise_action(name, registry.action(harness.fibonacci), lambda _: None)
        a.advertise(name, registry.message("std_msgs/String"))
    await harness.settle()
    graph = harness.graph
    assert [s.name for s in graph.services() if "/_" not in s.name] == ["/a", "/b"]
    assert [s.name for s in graph.actions()] == ["/a", "/b"]
    assert [t.name for t in graph.topics() if t.name in ("/a", "/b")] == ["/a", "/b"]
    assert (graph.topic("/no"), graph.service("/no"), graph.action("/no")) == (None, None, None)


async def test_the_version_grows_with_all_that_is_listed(harness: Harness) -> None:
    graph, registry = harness.graph, harness.graph.registry
    string, trigger = registry.message("std_msgs/String"), registry.service("std_srvs/Trigger")
    fibonacci = registry.action(harness.fibonacci)
    a, other = graph.participant("/a"), graph.participant("/b")
    undo: list[Callable[[], None]] = []
    steps: list[Callable[[], Registration | Publisher | Subscription]] = [
        lambda: a.advertise("/t", string),
        lambda: a.subscribe("/t", lambda _: None),
        lambda: a.advertise_service("/s", trigger, lambda _: None),
        lambda: other.advertise_service("/s", trigger, lambda _: None),
        lambda: a.advertise_action("/f", fibonacci, lambda _: None),
    ]

    def seen() -> tuple[object, ...]:
        return (graph.topics(), graph.services(), graph.actions(), graph.nodes())

    await harness.settle()
    states = [(graph.version, seen())]
    for step in steps:
        undo.append(step().close)
        await harness.settle()
        states.append((graph.version, seen()))
    for close in (*reversed(undo), a.close):
        close()
        await harness.settle()
        states.append((graph.version, seen()))
    for (version, before), (later, after) in pairwise(states):
        assert before != after
        assert version < later
    version = graph.version
    assert seen() == seen()
    await harness.settle()
    assert graph.version == version


@pytest.mark.parametrize("name", ["", "relative", "/a b", "/a//b", "/a/", "~/a", "/a#b", "/a\n"])
async def test_names_that_are_not_absolute_or_not_allowed(harness: Harness, name: str) -> None:
    a = harness.graph.participant("/a")
    string = harness.graph.registry.message("std_msgs/String")
    with pytest.raises(InvalidGraphName):
        a.advertise(name, string)
    with pytest.raises(InvalidGraphName):
        a.subscribe(name, lambda _: None, string)
    with pytest.raises(InvalidGraphName):
        harness.graph.participant(name)


async def test_rosout_and_clock_exist_without_any_node(harness: Harness) -> None:
    topics = {topic.name: topic.type for topic in harness.graph.topics()}
    assert topics["/rosout"] is harness.graph.registry.message("rcl_interfaces/Log")
    assert topics["/clock"] is harness.graph.registry.message("rosgraph_msgs/Clock")
    assert harness.graph.nodes() == ()


async def test_the_clock_is_published_as_it_moves(harness: Harness) -> None:
    seen: list[bytes] = []
    harness.graph.participant("/a").subscribe("/clock", lambda s: seen.append(bytes(s.payload.json())))
    await harness.advance(0.25)
    assert seen == [b'{"clock":{"sec":1,"nanosec":250000000}}']


async def test_calls_from_other_threads_keep_their_order(harness: Harness) -> None:
    ran: list[tuple[int, int]] = []

    def many(thread: int) -> None:
        for number in range(200):
            harness.graph.run_on_graph(partial(ran.append, (thread, number)))

    async with anyio.create_task_group() as group:
        for thread in range(3):
            group.start_soon(anyio.to_thread.run_sync, many, thread)
    await harness.settle()
    assert len(ran) == 600
    for thread in range(3):
        assert [n for t, n in ran if t == thread] == list(range(200))


async def test_calls_handed_over_run_on_the_graphs_thread(harness: Harness) -> None:
    threads: list[int] = []
    assert harness.graph.on_graph_thread()
    assert harness.graph.running

    def elsewhere() -> None:
        assert not harness.graph.on_graph_thread()
        harness.graph.run_on_graph(lambda: threads.append(threading.get_ident()))

    await anyio.to_thread.run_sync(elsewhere)
    await harness.settle()
    assert threads == [threading.get_ident()]


async def test_a_task_that_fails_ends_nothing_else(
    harness: Harness, caplog: pytest.LogCaptureFixture
) -> None:
    async def fail() -> None:
        raise ZeroDivisionError

    ran = anyio.Event()

    async def work() -> None:
        ran.set()

    harness.graph.spawn(fail, "the failing task")
    harness.graph.spawn(work, "the working task")
    await ran.wait()
    assert "the failing task failed" in caplog.text


@pytest.mark.parametrize("backend", ["asyncio", "trio"])
async def test_a_task_of_another_event_loop_runs_on_the_graphs(harness: Harness, backend: str) -> None:
    threads: list[int] = []

    async def work() -> None:
        await anyio.lowlevel.checkpoint()
        threads.append(threading.get_ident())

    async def spawn() -> None:
        harness.graph.spawn(work, "the task of another loop")

    await anyio.to_thread.run_sync(partial(anyio.run, spawn, backend=backend))
    await harness.settle()
    assert threads == [threading.get_ident()]
