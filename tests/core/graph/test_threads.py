from __future__ import annotations

from collections.abc import Callable
from functools import partial

import anyio
import pytest

from rwt_graph import MemoryGraph, Node, NotRunning, TypeConflict
from rwt_participant.errors import ProviderNotFound, WrongThread

pytestmark = pytest.mark.anyio


async def in_thread(function: Callable[[], object]) -> object:
    return await anyio.to_thread.run_sync(function)


async def test_everything_that_is_no_coroutine_works_from_a_thread(graph: MemoryGraph) -> None:
    async with graph:
        received: list[str] = []

        def program() -> None:
            with Node(graph, "worker") as node:
                node.parameters.declare("speed", 1.0)
                node.parameters.set("speed", 2)
                with (
                    node.advertise("/t", "std_msgs/String") as publisher,
                    node.subscribe("/t", lambda message: received.append(message.data)),
                ):
                    publisher.publish({"data": "from a thread"})
                    with node.advertise_service("/s", "std_srvs/Trigger", lambda _: {"message": "ok"}):
                        received.append(node.run_blocking(lambda: node.call("/s", timeout=5.0)).message)
                node.create_timer(1.0, lambda: None).cancel()
                node.log.info("hello")
                received.append(str(node.parameters.get("speed")))
                with pytest.raises(TypeConflict):
                    node.advertise("/rosout", "std_msgs/String")

        await in_thread(program)
        await anyio.wait_all_tasks_blocked()
        assert received == ["from a thread", "ok", "2.0"]
        assert graph.nodes() == ()


async def test_any_coroutine_can_be_run_from_a_thread(node: Node) -> None:
    node.parameters.declare("speed", 1.5)
    assert await in_thread(lambda: node.run_blocking(lambda: node.params.get("/n:speed"))) == 1.5
    with pytest.raises(ProviderNotFound):
        await in_thread(lambda: node.run_blocking(lambda: node.call("/nope")))


async def test_a_blocking_call_on_the_graphs_own_thread_is_refused(graph: MemoryGraph) -> None:
    node = Node(graph, "n")
    with pytest.raises(NotRunning, match="async with graph"):
        node.run_blocking(lambda: node.call("/s"))
    async with graph:
        with pytest.raises(WrongThread, match="await it instead"):
            node.run_blocking(lambda: node.call("/s"))


async def test_a_blocking_call_ends_when_the_graph_is_left(graph: MemoryGraph) -> None:
    outcomes: list[Exception] = []

    def wait_for_ever(node: Node) -> None:
        try:
            node.run_blocking(never)
        except NotRunning as error:
            outcomes.append(error)

    began = anyio.Event()

    async def never() -> None:
        began.set()
        await anyio.sleep_forever()

    async with anyio.create_task_group() as group, graph:
        group.start_soon(anyio.to_thread.run_sync, partial(wait_for_ever, Node(graph, "n")))
        await began.wait()
    assert [type(error) for error in outcomes] == [NotRunning]


async def test_calls_handed_over_while_the_graph_ends_are_not_lost(graph: MemoryGraph) -> None:
    ran: list[int] = []
    async with graph:

        def hand_over() -> None:
            for number in range(10):
                graph.run_on_graph(partial(ran.append, number))

        await in_thread(hand_over)
    graph.run_on_graph(partial(ran.append, 10))
    await in_thread(partial(graph.run_on_graph, partial(ran.append, 11)))
    assert ran == list(range(12))


async def test_a_call_that_raises_is_logged(graph: MemoryGraph, caplog: pytest.LogCaptureFixture) -> None:
    def fail() -> None:
        raise ZeroDivisionError

    async with graph:
        graph.run_on_graph(fail)
        await anyio.wait_all_tasks_blocked()
    assert "ZeroDivisionError" in caplog.text


async def test_a_thread_that_never_pauses_does_not_hold_the_loop(graph: MemoryGraph) -> None:
    """A call that hands over the next one: each turn runs only what was there when it began."""
    turns = 0
    enough = False

    def again() -> None:
        nonlocal turns
        turns += 1
        if not enough:
            graph.run_on_graph(again)

    async with graph:
        graph.run_on_graph(again)
        for _ in range(5):
            await anyio.lowlevel.checkpoint()
        assert 0 < turns < 100
        enough = True
