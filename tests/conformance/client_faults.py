"""Small wrong behaviours of a client library, put between a right one and the suite: it has to find each."""

from __future__ import annotations

import asyncio
import itertools
import json
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from rosbridge_conformance.case_player import Played
from rosbridge_conformance.client_player import play_as_server
from rosbridge_conformance.runner import Conditions, Run, judge_cases, select
from rosbridge_conformance.suite.case import Case
from rosbridge_conformance.suite.target import Target, find_client_target
from rosbridge_conformance.suite.values import Json
from rosbridge_conformance.wire.listening import Listener, listen
from rosbridge_conformance.wire.pace import RealPace
from rosbridge_conformance.wire.wires import Wire
from tests.conformance.rwt_client_adapter import Adapter, answer, plain

Message: TypeAlias = dict[str, Json]
Alter: TypeAlias = Callable[[Message], list[Message]]
"""Effect of a fault on a message."""

TARGET = Path(__file__).parent / "rwt-client.toml"


@dataclass(frozen=True, slots=True)
class ClientFault:
    """A wrong behaviour.

    Attributes:
        cases: globs of the cases that ask about it.
        out: what becomes of each message that the client sends.
        into: what becomes of each message before the client sees it.
    """

    name: str
    cases: tuple[str, ...]
    out: Callable[[], Alter] | None = None
    into: Callable[[], Alter] | None = None


class InProcess:
    """The client library in this process, driven without pipes."""

    def __init__(self) -> None:
        self.on_event: Callable[[dict[str, Json]], None] = lambda event: None
        self.on_noise: Callable[[str], None] = lambda text: None
        self._adapter = Adapter(lambda line: self.on_event(plain(line)))

    async def tell(self, command: Mapping[str, Json]) -> dict[str, Json]:
        return await answer(self._adapter, dict(command))

    def kill(self) -> None:
        pass


class _SpoiledWire:
    def __init__(self, wire: Wire, fault: ClientFault) -> None:
        self._wire = wire
        self._out = fault.out() if fault.out else None
        self._into = fault.into() if fault.into else None
        self._ready: list[str | bytes] = []

    async def send(self, data: str | bytes) -> None:
        for one in _altered(data, self._into):
            await self._wire.send(one)

    async def receive(self) -> str | bytes:
        while not self._ready:
            self._ready += _altered(await self._wire.receive(), self._out)
        return self._ready.pop(0)

    async def close(self, *, abruptly: bool = False) -> None:
        await self._wire.close(abruptly=abruptly)


def _altered(data: str | bytes, alter: Alter | None) -> Sequence[str | bytes]:
    """Probes and what is no JSON object pass."""
    if alter is None or isinstance(data, bytes):
        return [data]
    try:
        message = json.loads(data)
    except ValueError:
        return [data]
    if not isinstance(message, dict) or "/probe_" in str(message.get("topic")):
        return [data]
    return [json.dumps(one) for one in alter(message)]


class _SpoiledListener(Listener):
    def __init__(self, listener: Listener, fault: ClientFault) -> None:
        super().__init__(listener.url, asyncio.Queue(), asyncio.Event())
        self._listener = listener
        self._fault = fault

    async def accept(self) -> Wire:
        return _SpoiledWire(await self._listener.accept(), self._fault)


@asynccontextmanager
async def _listen(fault: ClientFault | None) -> AsyncIterator[Listener]:
    async with listen("ws://127.0.0.1:0") as listener:
        yield _SpoiledListener(listener, fault) if fault else listener


async def play_client(cases: Sequence[Case], fault: ClientFault | None = None) -> Run:
    """Play cases against the project's client, with a fault or without."""
    target = replace(find_client_target(str(TARGET)), timeout=0.3 if fault else 5.0)
    pace = RealPace()

    async def play_one(case: Case, tag: str) -> Played:
        async with _listen(fault) as listener:
            return await play_as_server(case, target, InProcess(), listener, pace, tag)

    return await judge_cases(cases, target, play_one, "in process", Conditions(jobs=4), pace)


def asked(cases: Sequence[Case], fault: ClientFault) -> tuple[Case, ...]:
    """The cases that ask about a fault."""
    return select(cases, Target(), fault.cases)


def _on(op: str, change: Callable[[Message], Message | None]) -> Callable[[], Alter]:
    """Change messages of one op; None drops them."""

    def alter(message: Message) -> list[Message]:
        if message.get("op") != op:
            return [message]
        changed = change(dict(message))
        return [] if changed is None else [changed]

    return lambda: alter


def _put(op: str, **fields: Json) -> Callable[[], Alter]:
    return _on(op, lambda message: {**message, **fields})


def _without(op: str, *keys: str) -> Callable[[], Alter]:
    return _on(op, lambda message: {key: value for key, value in message.items() if key not in keys})


def _drop(op: str) -> Callable[[], Alter]:
    return _on(op, lambda message: None)


def _twice(op: str) -> Callable[[], Alter]:
    return lambda: lambda message: [message, message] if message.get("op") == op else [message]


def _first_id(op: str) -> Callable[[], Alter]:
    """Every message of an op has the id of the first."""

    def make() -> Alter:
        ids: list[Json] = []

        def alter(message: Message) -> list[Message]:
            if message.get("op") != op:
                return [message]
            ids.append(message.get("id"))
            return [{**message, "id": ids[0]}]

        return alter

    return make


def _answers_in_turn() -> Alter:
    """Takes responses as answers to its calls in the order of sending, whatever their ids."""
    waiting: list[Message] = []

    def alter(message: Message) -> list[Message]:
        if message.get("op") != "service_response":
            return [message]
        waiting.append(message)
        if len(waiting) < 2:
            return []
        swapped = [{**waiting[0], "id": waiting[1].get("id")}, {**waiting[1], "id": waiting[0].get("id")}]
        waiting.clear()
        return swapped

    return alter


def _fragments_as_they_come() -> Alter:
    """Numbers fragments in the order of arrival."""
    counts: dict[str, itertools.count[int]] = {}

    def alter(message: Message) -> list[Message]:
        if message.get("op") != "fragment":
            return [message]
        count = counts.setdefault(str(message.get("id")), itertools.count())
        return [{**message, "num": next(count)}]

    return alter


def _one_table_of_fragments() -> Alter:
    return _put("fragment", id="all")()


def _once_only(op: str) -> Callable[[], Alter]:
    """Takes only the first message of an op."""

    def make() -> Alter:
        seen: list[Message] = []

        def alter(message: Message) -> list[Message]:
            if message.get("op") == op:
                seen.append(message)
                return [message] if len(seen) == 1 else []
            return [message]

        return alter

    return make


def _with_set_level() -> Alter:
    """Send a message of its own before the first one, as it cannot speak by itself here."""
    began: list[bool] = []

    def alter(message: Message) -> list[Message]:
        if began:
            return [message]
        began.append(True)
        return [{"op": "set_level", "level": "none"}, message]

    return alter


def _renamed_action_type() -> Alter:
    def rename(message: Message) -> Message:
        return {**{k: v for k, v in message.items() if k != "action_type"}, "type": message["action_type"]}

    return _on("send_action_goal", rename)()


def _never_again(op: str) -> Callable[[], Alter]:
    """Sends an op on the first of two connections only."""
    connections = itertools.count()
    return lambda: _drop(op)() if next(connections) % 2 else lambda message: [message]


def _raw_parameter() -> Alter:
    def unquote(message: Message) -> Message:
        args = message["args"]
        return {**message, "args": {**args, "value": "fast"}} if isinstance(args, dict) else message

    return _on("call_service", unquote)()


def _sends(name: str, case: str, out: Callable[[], Alter]) -> ClientFault:
    return ClientFault(name, (case,), out=out)


def _hears(name: str, case: str, into: Callable[[], Alter]) -> ClientFault:
    return ClientFault(name, (case,), into=into)


def _as_float(message: Message) -> Message:
    return {**message, "throttle_rate": float(str(message.get("throttle_rate", 0)))}


CLIENT_FAULTS: tuple[ClientFault, ...] = (
    _sends("calls without an id", "services/call", _without("call_service", "id")),
    _sends("one id for all calls", "envelope/ids-differ", _first_id("call_service")),
    _sends("positional arguments", "services/args-object", _put("call_service", args=[1, 2])),
    _sends("no arguments", "services/call", _without("call_service", "args")),
    _sends("calls sent twice", "services/call", _twice("call_service")),
    _hears("a failure taken for a success", "services/failure", _put("service_response", result=True)),
    _hears("responses matched by order", "services/any-order", _answers_in_turn),
    _hears("the second response dropped", "services/any-order", _once_only("service_response")),
    _sends(
        "throttle_rate as a float",
        "subscribe/throttle",
        _on("subscribe", _as_float),
    ),
    _sends("throttle_rate in seconds", "subscribe/throttle", _put("subscribe", throttle_rate=0.25)),
    _sends("throttle_rate forgotten", "subscribe/throttle", _without("subscribe", "throttle_rate")),
    _sends("null options", "subscribe/no-nulls", _put("subscribe", throttle_rate=None)),
    _sends("compression unasked", "subscribe/no-compression", _put("subscribe", compression="cbor")),
    _sends("compression forgotten", "subscribe/png", _without("subscribe", "compression")),
    _sends("fragment_size forgotten", "subscribe/fragment-size", _without("subscribe", "fragment_size")),
    _sends("subscribe without a type", "subscribe/plain", _without("subscribe", "type")),
    _sends("one id for all subscriptions", "subscribe/ids-differ", _first_id("subscribe")),
    _hears("each message given twice", "messages/plain", _twice("publish")),
    _hears("messages lost", "messages/in-order", _once_only("publish")),
    _sends("unsubscribe forgotten", "unsubscribe/same-id", _drop("unsubscribe")),
    _sends("unsubscribe with another id", "unsubscribe/same-id", _put("unsubscribe", id="other")),
    _sends("unsubscribe without the topic", "unsubscribe/same-id", _without("unsubscribe", "topic")),
    _sends("advertise forgotten", "publish/unadvertised", _drop("advertise")),
    _sends("advertise without the type", "advertise/plain", _without("advertise", "type")),
    _sends("latch forgotten", "advertise/latch", _put("advertise", latch=False)),
    _sends("one id for all advertisements", "advertise/ids-differ", _first_id("advertise")),
    _sends("unadvertise forgotten", "advertise/unadvertise", _drop("unadvertise")),
    _sends("unadvertise with another id", "advertise/unadvertise", _put("unadvertise", id="other")),
    _sends("integers as floats", "publish/integer", _put("publish", msg={"data": 5.0})),
    _sends("true as 1", "publish/bool", _put("publish", msg={"data": 1})),
    _sends("octets not in base64", "publish/octets", _put("publish", msg={"data": "0102ff"})),
    _sends("publications lost", "publish/in-order", _once_only("publish")),
    _sends("publications doubled", "publish/plain", _twice("publish")),
    _sends("a key of its own", "publish/plain", _put("publish", novel=True)),
    _sends("an unasked set_level", "publish/plain", _with_set_level),
    _sends("a service without type", "providers/advertise", _without("advertise_service", "type")),
    _sends("an answer without id", "providers/answer", _without("service_response", "id")),
    _sends("an answer with another id", "providers/odd-id", _put("service_response", id="1")),
    _sends("an answer without values", "providers/answer", _without("service_response", "values")),
    _sends("a handler's failure hidden", "providers/failure", _put("service_response", result=True)),
    _sends("an exception unanswered", "providers/exception", _drop("service_response")),
    _hears("the second request ignored", "providers/several", _once_only("call_service")),
    _sends("unadvertise_service forgotten", "providers/unadvertise", _drop("unadvertise_service")),
    _sends("a goal without id", "actions/goal", _without("send_action_goal", "id")),
    _sends("feedback not asked for", "actions/goal", _without("send_action_goal", "feedback")),
    _sends("type for action_type", "actions/goal", _renamed_action_type),
    _sends("a cancel without id", "actions/cancel", _without("cancel_action_goal", "id")),
    _sends("one id for all goals", "actions/two-goals", _first_id("send_action_goal")),
    _hears("an aborted goal as a success", "actions/aborted", _put("action_result", status=4)),
    _sends("no status in results", "action-providers/succeed", _without("action_result", "status")),
    _sends("canceled as aborted", "action-providers/cancel", _put("action_result", status=6)),
    _sends("feedback lost", "action-providers/succeed", _drop("action_feedback")),
    _hears("cancels ignored", "action-providers/cancel", _drop("cancel_action_goal")),
    _hears("fragments in order of arrival", "fragments/reversed", _fragments_as_they_come),
    _hears("one table for all fragments", "fragments/interleaved", _one_table_of_fragments),
    _hears("pictures ignored", "png/message", _drop("png")),
    _sends("nothing sent after a loss", "reconnect/subscribe", _never_again("subscribe")),
    _sends("subscriptions doubled", "reconnect/twice", _twice("subscribe")),
    _sends("JSON text not quoted", "params/set-text", _raw_parameter),
)
