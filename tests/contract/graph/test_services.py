from __future__ import annotations

import logging
from functools import partial
from typing import TYPE_CHECKING

import pytest

from rwt_graph.api import ServiceCall
from rwt_interfaces.payload import Payload
from rwt_participant.errors import (
    CallFailed,
    CallTimeout,
    NotFound,
    ProviderNotFound,
    ServiceFailed,
)
from rwt_participant.messages import Message
from tests.contract.graph.harness import CLIENTS, failure_text

if TYPE_CHECKING:
    from rwt_interfaces.structs import ServiceType
    from tests.contract.graph.harness import Harness

pytestmark = pytest.mark.anyio


def _answer(response: Payload, call: ServiceCall) -> None:
    call.reply(response)


class Replies(list[str]):
    """Writes down the answers, as text."""

    def __init__(self) -> None:
        super().__init__()
        self.raw: list[Payload | CallFailed] = []

    def __call__(self, answer: Payload | CallFailed) -> None:
        self.raw.append(answer)
        if isinstance(answer, CallFailed):
            self.append(failure_text(answer))
        else:
            message: Message = answer.value()
            self.append(message.message)


@pytest.fixture
def trigger(harness: Harness) -> ServiceType:
    return harness.graph.registry.service("std_srvs/Trigger")


@pytest.fixture
def replies() -> Replies:
    return Replies()


async def test_a_call_is_answered(harness: Harness, trigger: ServiceType, replies: Replies) -> None:
    provider, caller = harness.graph.participant("/p"), harness.graph.participant("/c")
    calls: list[ServiceCall] = []

    def on_call(call: ServiceCall) -> None:
        calls.append(call)
        call.reply(harness.response("done"))

    provider.advertise_service("/s", trigger, on_call)
    await harness.settle()
    caller.call_service("/s", harness.request(), replies, timeout=1.0)
    await harness.settle()
    assert replies == ["done"]
    (call,) = calls
    assert call.done
    assert call.service == "/s"
    assert call.request.json() == harness.request().json()
    call.reply(harness.response("again"))
    call.fail("too late")
    await harness.advance(2)
    assert replies == ["done"]


async def test_answers_come_in_any_order(harness: Harness, trigger: ServiceType) -> None:
    calls: list[ServiceCall] = []
    harness.graph.participant("/p").advertise_service("/s", trigger, calls.append)
    caller = harness.graph.participant("/c")
    first, second = Replies(), Replies()
    await harness.settle()
    caller.call_service("/s", harness.request(), first)
    caller.call_service("/s", harness.request(), second)
    await harness.settle()
    assert first == second == []
    calls[1].reply(harness.response("second"))
    calls[0].fail("first failed")
    await harness.settle()
    assert second == ["second"]
    assert first == ["ServiceFailed: first failed"]
    assert isinstance(first.raw[0], ServiceFailed)


async def test_an_unknown_service_is_a_reply(harness: Harness, replies: Replies) -> None:
    harness.graph.participant("/c").call_service("/nope", harness.request(), replies)
    await harness.settle()
    assert replies == ["ProviderNotFound: Service /nope does not exist"]
    assert type(replies.raw[0]) is ProviderNotFound
    assert issubclass(ProviderNotFound, NotFound)


async def test_a_timeout_is_never_early_and_at_most_20_ms_late(
    harness: Harness, trigger: ServiceType, replies: Replies
) -> None:
    calls: list[ServiceCall] = []
    harness.graph.participant("/p").advertise_service("/s", trigger, calls.append)
    await harness.advance(0.0137)
    harness.graph.participant("/c").call_service("/s", harness.request(), replies, timeout=0.5)
    await harness.advance(0.499)
    assert replies == []
    await harness.advance(0.021)
    assert replies == ["CallTimeout: Timeout exceeded while waiting for service response"]
    assert isinstance(replies.raw[0], CallTimeout)
    assert calls[0].done
    calls[0].reply(harness.response("late"))
    await harness.settle()
    assert len(replies) == 1


async def test_without_a_timeout_a_call_waits(
    harness: Harness, trigger: ServiceType, replies: Replies
) -> None:
    calls: list[ServiceCall] = []
    harness.graph.participant("/p").advertise_service("/s", trigger, calls.append)
    await harness.settle()
    harness.graph.participant("/c").call_service("/s", harness.request(), replies)
    await harness.advance(100_000)
    assert replies == []
    calls[0].reply(harness.response("patience"))
    await harness.settle()
    assert replies == ["patience"]


async def test_a_second_provider_replaces_the_first(harness: Harness, trigger: ServiceType) -> None:
    first, second = harness.graph.participant("/n1"), harness.graph.participant("/n2")
    old = first.advertise_service("/s", trigger, lambda _: None)
    await harness.settle()
    before, after = Replies(), Replies()
    harness.graph.participant("/c").call_service("/s", harness.request(), before)
    await harness.settle()
    second.advertise_service("/s", trigger, lambda call: call.reply(harness.response("new")))
    await harness.settle()
    assert before == ["ProviderGone: Service /s was unadvertised"]
    old.close()
    harness.graph.participant("/c").call_service("/s", harness.request(), after)
    await harness.settle()
    assert after == ["new"]
    info = harness.graph.service("/s")
    assert info is not None
    assert (info.node, info.type) == ("/n2", trigger)


@pytest.mark.parametrize(
    ("leave", "answers"),
    [
        ([3], "2"),
        ([3, 2], "1"),
        ([2, 3], "1"),
        ([1, 3], "2"),
        ([2, 1, 3], None),
        ([1, 2], "3"),
    ],
)
async def test_a_displaced_provider_is_restored_when_the_newer_ones_have_gone(
    harness: Harness, trigger: ServiceType, leave: list[int], answers: str | None
) -> None:
    nodes = {number: harness.graph.participant(f"/n{number}") for number in (1, 2, 3)}
    for number, node in nodes.items():
        node.advertise_service("/s", trigger, partial(_answer, harness.response(str(number))))
    caller = harness.graph.participant("/c")
    for number in leave:
        nodes[number].close()
    await harness.settle()
    replies = Replies()
    caller.call_service("/s", harness.request(), replies)
    await harness.settle()
    assert replies == [answers or "ProviderNotFound: Service /s does not exist"]
    info = harness.graph.service("/s")
    assert (info.node if info else None) == (f"/n{answers}" if answers else None)
    for node in nodes.values():
        node.close()
    await harness.settle()
    assert harness.graph.service("/s") is None


async def test_a_displaced_provider_does_not_take_calls_of_another_type(
    harness: Harness, trigger: ServiceType
) -> None:
    first, second = harness.graph.participant("/n1"), harness.graph.participant("/n2")
    other = harness.graph.registry.service("std_srvs/Empty")
    taken: list[str] = []
    first.advertise_service("/s", trigger, lambda call: taken.append(call.request.type.name))
    displacing = second.advertise_service("/s", other, lambda call: taken.append(call.request.type.name))
    await harness.settle()
    info = harness.graph.service("/s")
    assert info is not None and info.type is other
    displacing.close()
    await harness.settle()
    info = harness.graph.service("/s")
    assert info is not None and info.type is trigger
    harness.graph.participant("/c").call_service("/s", harness.request(), Replies())
    await harness.settle()
    assert taken == [trigger.request.name]


#: What the caller hears, by the end of a call.
_ENDS: dict[str, list[str]] = {
    "reply": ["done"],
    "fail": ["ServiceFailed: no"],
    "timeout": ["CallTimeout: Timeout exceeded while waiting for service response"],
    "cancel": [],
    "caller leaves": ["CallFailed: node /c was closed"],
    "provider leaves": ["ProviderGone: Service /s was unadvertised"],
    "its node leaves": ["ProviderGone: Service /s was unadvertised"],
}


@pytest.mark.parametrize("how", _ENDS)
async def test_both_sides_learn_once_that_a_call_has_ended(
    harness: Harness, trigger: ServiceType, replies: Replies, how: str
) -> None:
    provider, caller = harness.graph.participant("/p"), harness.graph.participant("/c")
    ended: list[bool] = []
    calls: list[ServiceCall] = []

    def on_call(call: ServiceCall) -> None:
        calls.append(call)
        call.on_end = lambda: ended.append(call.done)

    registration = provider.advertise_service("/s", trigger, on_call)
    await harness.settle()
    pending = caller.call_service("/s", harness.request(), replies, timeout=1.0)
    await harness.settle()
    assert ended == []
    match how:
        case "reply":
            calls[0].reply(harness.response("done"))
        case "fail":
            calls[0].fail("no")
        case "timeout":
            await harness.advance(2)
        case "cancel":
            pending.cancel()
        case "caller leaves":
            caller.close()
        case "provider leaves":
            registration.close()
        case _:
            provider.close()
    await harness.settle()
    assert ended == [calls[0].done] == [True]
    assert replies == _ENDS[how]
    assert (harness.graph.service("/s") is None) is (how in ("provider leaves", "its node leaves"))
    pending.cancel()
    calls[0].reply(harness.response("late"))
    registration.close()
    await harness.advance(2)
    assert ended == [True]
    assert replies == _ENDS[how]


async def test_a_provider_that_raises_when_a_call_ends_is_logged(
    harness: Harness, trigger: ServiceType, replies: Replies, caplog: pytest.LogCaptureFixture
) -> None:
    def on_call(call: ServiceCall) -> None:
        call.on_end = lambda: [][0]
        call.reply(harness.response("done"))

    harness.graph.participant("/p").advertise_service("/s", trigger, on_call)
    await harness.settle()
    with caplog.at_level(logging.ERROR):
        harness.graph.participant("/c").call_service("/s", harness.request(), replies)
        await harness.settle()
    assert replies == ["done"]
    assert "/s" in caplog.text


async def test_a_provider_that_raises_fails_the_call_without_telling_why(
    harness: Harness, trigger: ServiceType, replies: Replies, caplog: pytest.LogCaptureFixture
) -> None:
    def on_call(_call: ServiceCall) -> None:
        raise ZeroDivisionError("secret")

    harness.graph.participant("/p").advertise_service("/s", trigger, on_call)
    await harness.settle()
    with caplog.at_level(logging.ERROR):
        harness.graph.participant("/c").call_service("/s", harness.request(), replies)
        await harness.settle()
    assert replies == ["ServiceFailed: internal error"]
    assert "secret" in caplog.text


async def test_a_provider_may_withdraw_from_within_its_call(
    harness: Harness, trigger: ServiceType, replies: Replies
) -> None:
    provider = harness.graph.participant("/p")
    registration = provider.advertise_service("/s", trigger, lambda _: registration.close())
    await harness.settle()
    harness.graph.participant("/c").call_service("/s", harness.request(), replies)
    await harness.settle()
    assert replies == ["ProviderGone: Service /s was unadvertised"]


async def test_a_caller_that_raises_is_logged(
    harness: Harness, trigger: ServiceType, caplog: pytest.LogCaptureFixture
) -> None:
    def on_reply(_answer: object) -> None:
        raise ZeroDivisionError

    harness.graph.participant("/p").advertise_service(
        "/s", trigger, lambda call: call.reply(harness.response())
    )
    await harness.settle()
    with caplog.at_level(logging.ERROR):
        harness.graph.participant("/c").call_service("/s", harness.request(), on_reply)
        await harness.settle()
    assert "ZeroDivisionError" in caplog.text


@pytest.mark.parametrize("where", ["here", "elsewhere"])
async def test_the_robots_service_displaces_that_of_clients(
    harness: Harness, trigger: ServiceType, replies: Replies, where: str
) -> None:
    clients = harness.graph.participant(CLIENTS, for_clients=True)
    displaced: list[str] = []
    offer = clients.advertise_service("/s", trigger, partial(_answer, harness.response("of a client")))
    offer.on_displaced = displaced.append
    await harness.settle()
    robot = harness.elsewhere("/robot") if where == "elsewhere" else harness.graph.participant("/robot")
    robot.advertise_service("/s", trigger, partial(_answer, harness.response("of the robot")))
    await harness.settle()
    harness.graph.participant("/caller").call_service("/s", harness.request(), replies)
    await harness.settle()
    assert replies == ["of the robot"]
    assert displaced == ["/s: the robot offers this service now"]
    robot.close()
    await harness.settle()
    assert harness.graph.service("/s") is None


async def test_open_calls_of_a_displaced_service_fail(
    harness: Harness, trigger: ServiceType, replies: Replies
) -> None:
    clients = harness.graph.participant(CLIENTS, for_clients=True)
    calls: list[ServiceCall] = []
    clients.advertise_service("/s", trigger, calls.append)
    await harness.settle()
    harness.graph.participant("/caller").call_service("/s", harness.request(), replies)
    await harness.settle()
    assert len(calls) == 1
    harness.graph.participant("/robot").advertise_service("/s", trigger, calls.append)
    await harness.settle()
    assert replies == ["ProviderGone: Service /s was unadvertised"]


async def test_clients_replace_each_others_service_until_they_withdraw_it(
    harness: Harness, trigger: ServiceType, replies: Replies
) -> None:
    clients = harness.graph.participant(CLIENTS, for_clients=True)
    displaced: list[str] = []
    offers = []
    for name in ("first", "second"):
        offer = clients.advertise_service("/s", trigger, partial(_answer, harness.response(name)))
        offer.on_displaced = displaced.append
        offers.append(offer)
    await harness.settle()
    caller = harness.graph.participant("/caller")
    caller.call_service("/s", harness.request(), replies)
    await harness.settle()
    offers[1].close()
    await harness.settle()
    caller.call_service("/s", harness.request(), replies)
    await harness.settle()
    assert replies == ["second", "first"]
    assert displaced == []
