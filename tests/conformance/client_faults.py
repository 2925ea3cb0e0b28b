"""Small wrong behaviours of a client library, put between a right one and the suite: it has to find each."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

from rosbridge_conformance.case_player import Played
from rosbridge_conformance.client_player import play_as_server
from rosbridge_conformance.runner import Conditions, Run, judge_cases, select
from rosbridge_conformance.suite.case import Case
from rosbridge_conformance.suite.target import Target, find_client_target
from rosbridge_conformance.suite.values import Json
from rosbridge_conformance.wire.listening import Listener, listen
from rosbridge_conformance.wire.pace import RealPace
from rosbridge_conformance.wire.wires import Wire
from tests.conformance.faults import Alter, Memory, Message, altered, drop, on, put, twice, without
from tests.conformance.rwt_client_adapter import Adapter, answer, plain

TARGET = Path(__file__).parent / "rwt-client.toml"


@dataclass(frozen=True, slots=True)
class ClientFault:
    """A wrong behaviour.

    Attributes:
        cases: globs of the cases that ask about it.
        out: alters what the client sends.
        into: alters what it hears.
    """

    name: str
    cases: tuple[str, ...]
    out: Alter | None = None
    into: Alter | None = None


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
    def __init__(self, wire: Wire, fault: ClientFault, memory: Memory) -> None:
        self._wire = wire
        self._fault = fault
        self._memory = memory
        self._ready: list[str | bytes] = []

    async def send(self, data: str | bytes) -> None:
        for one in self._altered(data, self._fault.into):
            await self._wire.send(one)

    async def receive(self) -> str | bytes:
        while not self._ready:
            self._ready += self._altered(await self._wire.receive(), self._fault.out)
        return self._ready.pop(0)

    def _altered(self, data: str | bytes, alter: Alter | None) -> Sequence[str | bytes]:
        """Probes pass."""
        if alter is None or isinstance(data, bytes) or "/probe_" in data:
            return [data]
        return [each.decode() for each in altered(alter, data.encode(), self._memory)]

    async def close(self, *, abruptly: bool = False) -> None:
        await self._wire.close(abruptly=abruptly)


class _SpoiledListener(Listener):
    def __init__(self, listener: Listener, fault: ClientFault) -> None:
        super().__init__(listener.url, asyncio.Queue(), asyncio.Event())
        self._listener = listener
        self._fault = fault
        self._server: Message = {}

    async def accept(self) -> Wire:
        return _SpoiledWire(await self._listener.accept(), self._fault, Memory(self._server))


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


def _noted(memory: Memory, key: str, message: Message) -> list[Message]:
    """The messages noted under a key, with this one."""
    noted: Any = memory.here.setdefault(key, [])
    noted.append(message)
    return cast("list[Message]", noted)


def _first_id(op: str) -> Alter:
    """Every message of an op has the id of the first."""

    def alter(message: Message, memory: Memory) -> list[Message] | None:
        if message.get("op") != op:
            return None
        return [{**message, "id": _noted(memory, op, message)[0].get("id")}]

    return alter


def _answers_in_turn(message: Message, memory: Memory) -> list[Message] | None:
    """Takes responses as answers to its calls in the order of sending, whatever their ids."""
    if message.get("op") != "service_response":
        return None
    noted = _noted(memory, "responses", message)
    if len(noted) % 2:
        return []
    first, second = noted[-2:]
    return [{**first, "id": second.get("id")}, {**second, "id": first.get("id")}]


def _fragments_as_they_come(message: Message, memory: Memory) -> list[Message] | None:
    """Numbers fragments in the order of arrival."""
    if message.get("op") != "fragment":
        return None
    return [{**message, "num": len(_noted(memory, str(message.get("id")), message)) - 1}]


def _once_only(op: str) -> Alter:
    """Takes only the first message of an op."""

    def alter(message: Message, memory: Memory) -> list[Message] | None:
        return [] if message.get("op") == op and len(_noted(memory, op, message)) > 1 else None

    return alter


def _with_set_level(message: Message, memory: Memory) -> list[Message] | None:
    """Send a message of its own before the first one, as it cannot speak by itself here."""
    is_first = len(_noted(memory, "all", message)) == 1
    return [{"op": "set_level", "level": "none"}, message] if is_first else None


def _rename_action_type(message: Message) -> Message:
    return {**{k: v for k, v in message.items() if k != "action_type"}, "type": message["action_type"]}


def _never_again(op: str) -> Alter:
    """Sends an op on the first of two connections only."""

    def alter(message: Message, memory: Memory) -> list[Message] | None:
        memory.here.setdefault("is_first", memory.server.setdefault("first", id(memory)) == id(memory))
        return [] if message.get("op") == op and not memory.here["is_first"] else None

    return alter


def _unquote_parameter(message: Message) -> Message:
    args = message["args"]
    return {**message, "args": {**args, "value": "fast"}} if isinstance(args, dict) else message


def _sends(name: str, case: str, out: Alter) -> ClientFault:
    return ClientFault(name, (case,), out=out)


def _hears(name: str, case: str, into: Alter) -> ClientFault:
    return ClientFault(name, (case,), into=into)


def _as_float(message: Message) -> Message:
    return {**message, "throttle_rate": float(str(message.get("throttle_rate", 0)))}


CLIENT_FAULTS: tuple[ClientFault, ...] = (
    _sends("calls without an id", "services/call", without("call_service", "id")),
    _sends("one id for all calls", "envelope/ids-differ", _first_id("call_service")),
    _sends("positional arguments", "services/args-object", put("call_service", args=[1, 2])),
    _sends("no arguments", "services/call", without("call_service", "args")),
    _sends("calls sent twice", "services/call", twice("call_service")),
    _hears("a failure taken for a success", "services/failure", put("service_response", result=True)),
    _hears("responses matched by order", "services/any-order", _answers_in_turn),
    _hears("the second response dropped", "services/any-order", _once_only("service_response")),
    _sends("throttle_rate as a float", "subscribe/throttle", on("subscribe", _as_float)),
    _sends("throttle_rate in seconds", "subscribe/throttle", put("subscribe", throttle_rate=0.25)),
    _sends("throttle_rate forgotten", "subscribe/throttle", without("subscribe", "throttle_rate")),
    _sends("null options", "subscribe/no-nulls", put("subscribe", throttle_rate=None)),
    _sends("compression unasked", "subscribe/no-compression", put("subscribe", compression="cbor")),
    _sends("compression forgotten", "subscribe/png", without("subscribe", "compression")),
    _sends("fragment_size forgotten", "subscribe/fragment-size", without("subscribe", "fragment_size")),
    _sends("subscribe without a type", "subscribe/plain", without("subscribe", "type")),
    _sends("one id for all subscriptions", "subscribe/ids-differ", _first_id("subscribe")),
    _hears("each message given twice", "messages/plain", twice("publish")),
    _hears("messages lost", "messages/in-order", _once_only("publish")),
    _sends("unsubscribe forgotten", "unsubscribe/same-id", drop("unsubscribe")),
    _sends("unsubscribe with another id", "unsubscribe/same-id", put("unsubscribe", id="other")),
    _sends("unsubscribe without the topic", "unsubscribe/same-id", without("unsubscribe", "topic")),
    _sends("advertise forgotten", "publish/unadvertised", drop("advertise")),
    _sends("advertise without the type", "advertise/plain", without("advertise", "type")),
    _sends("latch forgotten", "advertise/latch", put("advertise", latch=False)),
    _sends("one id for all advertisements", "advertise/ids-differ", _first_id("advertise")),
    _sends("unadvertise forgotten", "advertise/unadvertise", drop("unadvertise")),
    _sends("unadvertise with another id", "advertise/unadvertise", put("unadvertise", id="other")),
    _sends("integers as floats", "publish/integer", put("publish", msg={"data": 5.0})),
    _sends("true as 1", "publish/bool", put("publish", msg={"data": 1})),
    _sends("octets not in base64", "publish/octets", put("publish", msg={"data": "0102ff"})),
    _sends("publications lost", "publish/in-order", _once_only("publish")),
    _sends("publications doubled", "publish/plain", twice("publish")),
    _sends("a key of its own", "publish/plain", put("publish", novel=True)),
    _sends("an unasked set_level", "publish/plain", _with_set_level),
    _sends("a service without type", "providers/advertise", without("advertise_service", "type")),
    _sends("an answer without id", "providers/answer", without("service_response", "id")),
    _sends("an answer with another id", "providers/odd-id", put("service_response", id="1")),
    _sends("an answer without values", "providers/answer", without("service_response", "values")),
    _sends("a handler's failure hidden", "providers/failure", put("service_response", result=True)),
    _sends("an exception unanswered", "providers/exception", drop("service_response")),
    _hears("the second request ignored", "providers/several", _once_only("call_service")),
    _sends("unadvertise_service forgotten", "providers/unadvertise", drop("unadvertise_service")),
    _sends("a goal without id", "actions/goal", without("send_action_goal", "id")),
    _sends("feedback not asked for", "actions/goal", without("send_action_goal", "feedback")),
    _sends("type for action_type", "actions/goal", on("send_action_goal", _rename_action_type)),
    _sends("a cancel without id", "actions/cancel", without("cancel_action_goal", "id")),
    _sends("one id for all goals", "actions/two-goals", _first_id("send_action_goal")),
    _hears("an aborted goal as a success", "actions/aborted", put("action_result", status=4)),
    _sends("no status in results", "action-providers/succeed", without("action_result", "status")),
    _sends("canceled as aborted", "action-providers/cancel", put("action_result", status=6)),
    _sends("feedback lost", "action-providers/succeed", drop("action_feedback")),
    _hears("cancels ignored", "action-providers/cancel", drop("cancel_action_goal")),
    _hears("fragments in order of arrival", "fragments/reversed", _fragments_as_they_come),
    _hears("one table for all fragments", "fragments/interleaved", put("fragment", id="all")),
    _hears("pictures ignored", "png/message", drop("png")),
    _sends("nothing sent after a loss", "reconnect/subscribe", _never_again("subscribe")),
    _sends("subscriptions doubled", "reconnect/twice", twice("subscribe")),
    _sends("JSON text not quoted", "params/set-text", on("call_service", _unquote_parameter)),
)
