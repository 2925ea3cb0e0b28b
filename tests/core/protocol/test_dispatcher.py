"""Handlers by type, and the one place where an exception becomes an answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Never

import pytest

from rwt_protocol.dispatcher import Dispatcher, Steps
from rwt_protocol.errors import IncompleteDispatcher, MalformedPayload, Misread, Refused
from rwt_protocol.ops import (
    ActionResult,
    CallService,
    Direction,
    Fragment,
    Op,
    Publish,
    SendActionGoal,
    ServiceResponse,
    Status,
    inbound,
)
from rwt_protocol.session import Refusal, Session

Handler = Callable[[list[Op], Never], None]


def keep(context: list[Op], op: Op) -> None:
    context.append(op)


def refuse(context: list[Op], op: Op) -> None:
    raise Refused("not here", "warning")


def fail(context: list[Op], op: Op) -> None:
    raise ZeroDivisionError("secret")


def table(handler: Handler = keep, direction: Direction = Direction.TO_SERVER) -> dict[type[Op], Handler]:
    return dict.fromkeys(inbound(direction), handler)


def unexpected(context: object, op: Op, error: Exception) -> None:
    raise AssertionError(op) from error


def test_an_op_goes_to_the_handler_of_its_type() -> None:
    seen: list[Op] = []

    def on_publish(context: list[Op], op: Publish) -> None:
        context.append(Publish(topic=op.topic + "!"))

    dispatcher: Dispatcher[list[Op]] = Dispatcher(table() | {Publish: on_publish}, unexpected)
    call = CallService(service="/s")
    assert dispatcher.dispatch(seen, Publish(topic="/a")) is None
    assert dispatcher.dispatch(seen, call) is None
    assert seen == [Publish(topic="/a!"), call]


def test_a_missing_or_surplus_handler_is_named() -> None:
    handlers = table()
    del handlers[Publish]
    del handlers[CallService]
    handlers[Status] = keep
    with pytest.raises(IncompleteDispatcher) as caught:
        Dispatcher(handlers, unexpected)
    assert str(caught.value) == (
        "client to server: no handler for CallService, Publish; a handler, but no such message, for Status"
    )
    with pytest.raises(IncompleteDispatcher, match="Fragment"):
        Dispatcher(table() | {Fragment: keep}, unexpected)


def test_a_client_has_its_own_table() -> None:
    direction = Direction.TO_CLIENT
    Dispatcher(table(direction=direction), unexpected, direction=direction)
    with pytest.raises(IncompleteDispatcher, match=r"^server to client: no handler for Status; "):
        Dispatcher(table(), unexpected, direction=direction)


@pytest.mark.parametrize(
    ("op", "answer"),
    [
        (Publish(topic="/a", id="i"), Status(level="warning", msg="not here", id="i")),
        (CallService(service="/s", id=3),
         ServiceResponse(service="/s", values="not here", result=False, id=3)),
        (CallService(service="/s"), ServiceResponse(service="/s", values="not here", result=False)),
        (SendActionGoal(action="/f", action_type="x/F", id="g"),
         ActionResult(action="/f", values="not here", result=False, status=0, id="g")),
    ],
)  # fmt: skip
def test_a_refusal_is_answered_as_its_op_is_refused(op: Op, answer: Op) -> None:
    dispatcher: Dispatcher[list[Op]] = Dispatcher(table(refuse), unexpected)
    assert dispatcher.dispatch([], op) == answer


def test_errors_of_this_package_and_named_ones_refuse() -> None:
    def raise_malformed(context: list[Op], op: Op) -> None:
        raise MalformedPayload("not JSON")

    def raise_lookup(context: list[Op], op: Op) -> None:
        raise LookupError("no such thing")

    handlers = table() | {Publish: raise_malformed, CallService: raise_lookup}
    dispatcher: Dispatcher[list[Op]] = Dispatcher(handlers, unexpected, refusals=(LookupError,))
    assert dispatcher.dispatch([], Publish(topic="/a")) == Status(level="error", msg="not JSON")
    assert dispatcher.dispatch([], CallService(service="/s")) == (
        ServiceResponse(service="/s", values="call_service: no such thing", result=False)
    )


def test_any_other_exception_is_handed_over_and_told_to_nobody() -> None:
    handed: list[tuple[list[Op], Op, Exception]] = []

    def hand_over(context: list[Op], op: Op, error: Exception) -> None:
        handed.append((context, op, error))

    dispatcher: Dispatcher[list[Op]] = Dispatcher(table(fail), hand_over)
    context: list[Op] = []
    op = CallService(service="/s", id="i")
    answer = ServiceResponse(service="/s", values="internal error", result=False, id="i")
    assert dispatcher.dispatch(context, op) == answer
    ((where, seen, error),) = handed
    assert where is context and seen is op
    assert isinstance(error, ZeroDivisionError)
    assert error.__traceback__ is not None


def test_a_light_op_goes_to_the_handler_of_its_op() -> None:
    (op,) = Session(light=True).decode(b'{"op":"publish","id":"1","topic":"/t","msg":{}}', False, 0.0)
    assert not isinstance(op, Refusal | Publish)
    seen: list[Op] = []
    assert Dispatcher(table(), unexpected).dispatch(seen, op) is None
    assert seen == [op]
    assert Dispatcher(table(refuse), unexpected).dispatch(seen, op) == (
        Status(level="warning", msg="not here", id="1")
    )


def test_a_misread_frame_is_left_to_the_caller() -> None:
    def misread(context: list[Op], op: Op) -> Never:
        raise Misread(b"frame")

    op = CallService(service="/s", id="i")
    with pytest.raises(Misread) as caught:
        Dispatcher(table(misread), unexpected).dispatch([], op)
    assert caught.value.frame == b"frame"


@pytest.mark.parametrize("pauses", [0, 1, 2])
def test_what_an_op_does_after_its_first_step_is_left_for_later(pauses: int) -> None:
    rests: list[Steps] = []

    def steps(context: list[Op], op: Op) -> Steps:
        for _ in range(pauses):
            yield
        refuse(context, op)

    def later(context: list[Op], op: Op, steps: Steps) -> Op | None:
        rests.append(steps)
        return None

    handlers = dict.fromkeys(inbound(Direction.TO_SERVER), steps)
    op, answer = Publish(topic="/a"), Status(level="warning", msg="not here")
    at_once, in_turns = Dispatcher(handlers, unexpected), Dispatcher(handlers, unexpected, later=later)
    assert at_once.dispatch([], op) == answer
    assert in_turns.dispatch([], op) == (None if pauses else answer)
    for rest in rests:
        assert in_turns.go_on([], op, rest, lambda: True) == answer
