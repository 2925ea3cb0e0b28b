from __future__ import annotations

import asyncio
from functools import partial
from typing import TYPE_CHECKING

import anyio
import pytest

from rwt_graph import MemoryGraph, Node, NotRunning
from rwt_interfaces.errors import InvalidMessage
from rwt_participant.errors import CallFailed, CallTimeout, NotFound, ProviderGone, ServiceFailed
from rwt_participant.messages import Message

if TYPE_CHECKING:
    from tests.core.graph.conftest import Advance

pytestmark = pytest.mark.anyio

ADD = "example_interfaces/AddTwoInts"


async def test_plain_and_coroutine_handlers(node: Node) -> None:
    async def add_slowly(request: Message, bonus: int) -> dict[str, object]:
        await anyio.lowlevel.checkpoint()
        return {"sum": request.a + request.b + bonus}

    node.advertise_service("/plain", ADD, lambda request: {"sum": request.a + request.b})
    node.advertise_service("/coroutine", ADD, partial(add_slowly, bonus=100))
    node.advertise_service("/awaitable", ADD, lambda request: add_slowly(request, 200))
    answers = [
        (await node.call(name, {"a": 1, "b": 2}, timeout=1)).sum
        for name in ("/plain", "/coroutine", "/awaitable")
    ]
    assert answers == [3, 103, 203]


async def test_coroutine_handlers_overlap(node: Node) -> None:
    go_on = anyio.Event()
    waiting: list[int] = []

    async def handler(request: Message) -> dict[str, object]:
        waiting.append(request.a)
        await go_on.wait()
        return {"sum": request.a}

    node.advertise_service("/s", ADD, handler)
    answers: list[int] = []

    async def call(number: int) -> None:
        answers.append((await node.call("/s", {"a": number})).sum)

    async with anyio.create_task_group() as group:
        for number in range(3):
            group.start_soon(call, number)
        await anyio.wait_all_tasks_blocked()
        assert sorted(waiting) == [0, 1, 2]
        go_on.set()
    assert sorted(answers) == [0, 1, 2]


async def test_none_is_a_response_of_defaults_and_no_request_one_too(node: Node) -> None:
    requests: list[Message] = []
    node.advertise_service("/s", ADD, requests.append)
    assert (await node.call("/s")).sum == 0
    assert (requests[0].a, requests[0].b) == (0, 0)


@pytest.mark.parametrize(
    ("outcome", "text", "logged"),
    [
        (ServiceFailed("the motor is hot"), "^the motor is hot$", False),
        (ValueError("a bad value"), "^a bad value$", True),
        (ZeroDivisionError(), "^ZeroDivisionError$", True),
        ({"sum": "three"}, "sum: ", True),
    ],
    ids=["refusal", "exception", "exception without a text", "wrong response"],
)
@pytest.mark.parametrize("kind", ["plain", "coroutine"])
async def test_a_handler_that_raises_or_answers_wrongly_fails_the_call(
    node: Node,
    caplog: pytest.LogCaptureFixture,
    kind: str,
    outcome: Exception | dict[str, object],
    text: str,
    logged: bool,
) -> None:
    def plain(_request: Message) -> dict[str, object]:
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    async def coroutine(request: Message) -> dict[str, object]:
        return plain(request)

    node.advertise_service("/s", ADD, plain if kind == "plain" else coroutine)
    with pytest.raises(ServiceFailed, match=text):
        await node.call("/s")
    assert ("service /s failed" in caplog.text) is logged


async def test_failures_of_a_call(node: Node, advance: Advance) -> None:
    with pytest.raises(NotFound, match=r"^Service /nope does not exist$"):
        await node.call("nope")

    async def never(_request: Message) -> None:
        await anyio.sleep_forever()

    service = node.advertise_service("/s", ADD, never)
    with pytest.raises(InvalidMessage, match="a: "):
        await node.call("/s", {"a": "one"})
    outcomes: list[str] = []

    async def call(seconds: float | None) -> None:
        try:
            await node.call("/s", timeout=seconds)
        except (CallTimeout, ProviderGone) as error:
            outcomes.append(f"{type(error).__name__}: {error}")

    async with anyio.create_task_group() as group:
        group.start_soon(call, 0.5)
        group.start_soon(call, None)
        await advance(1.0)
        assert outcomes == ["CallTimeout: Timeout exceeded while waiting for service response"]
        service.close()
    assert outcomes[1:] == ["ProviderGone: Service /s was unadvertised"]


async def test_before_the_graph_runs_only_plain_handlers_answer(graph: MemoryGraph) -> None:
    node = Node(graph, "n")

    async def coroutine(_request: Message) -> None:
        raise AssertionError("must not run")

    node.advertise_service("/plain", ADD, lambda request: {"sum": request.a})
    node.advertise_service("/coroutine", ADD, coroutine)
    assert (await node.call("/plain", {"a": 5})).sum == 5
    with pytest.raises(ServiceFailed, match="coroutine handler, and the graph is not running"):
        await node.call("/coroutine")


async def test_leaving_cancels_handlers_closes_participants_and_leaks_nothing(graph: MemoryGraph) -> None:
    ended: list[str] = []

    async def handler(_request: Message) -> None:
        try:
            await anyio.sleep_forever()
        finally:
            ended.append("handler")

    async def call(node: Node) -> None:
        try:
            await node.call("/s")
        except CallFailed:
            ended.append("caller")

    async with anyio.create_task_group() as group, graph:
        server, client = Node(graph, "server"), Node(graph, "client")
        server.advertise_service("/s", ADD, handler)
        client.subscribe("/t", handler)
        group.start_soon(call, client)
        await anyio.wait_all_tasks_blocked()
    assert ended == ["handler", "caller"] or ended == ["caller", "handler"]
    assert (graph.nodes(), graph.topics(), graph.services(), graph.actions()) == ((), (), (), ())
    assert not graph.running
    with pytest.raises(NotRunning, match="was closed"):
        graph.spawn(anyio.sleep_forever, "a late task")
    with pytest.raises(NotRunning, match="only once"):
        async with graph:
            pass


async def test_an_exception_in_the_body_comes_out_as_it_is(graph: MemoryGraph) -> None:
    with pytest.raises(ZeroDivisionError):
        async with graph:
            Node(graph, "n")
            raise ZeroDivisionError
    assert graph.nodes() == ()


async def test_a_cancelled_body_leaves_the_graph(graph: MemoryGraph) -> None:
    with anyio.move_on_after(0) as scope:
        async with graph:
            Node(graph, "n")
            await anyio.sleep_forever()
    assert scope.cancelled_caught
    assert graph.nodes() == ()


async def test_a_body_that_asyncio_cancels_leaves_the_graph(graph: MemoryGraph) -> None:
    entered = asyncio.Event()

    async def program() -> None:
        async with graph:
            Node(graph, "n")
            entered.set()
            await asyncio.sleep(60)

    before = asyncio.all_tasks()
    task = asyncio.create_task(program())
    await entered.wait()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert graph.nodes() == ()
    assert not graph.running
    assert asyncio.all_tasks() == before
