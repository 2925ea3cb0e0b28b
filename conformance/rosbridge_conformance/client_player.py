"""Player of one case as a server, against a client library in its program."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from itertools import count

from rosbridge_conformance.case_player import CasePlayer, Connection, Fault, Played, Raw, Stop
from rosbridge_conformance.program import Driven, ProgramEnded
from rosbridge_conformance.suite.case import Case, Hear, HearNothing, Send, Step, Tell
from rosbridge_conformance.suite.matching import Difference, match_frame
from rosbridge_conformance.suite.target import Target
from rosbridge_conformance.suite.values import Json, Value, as_text, as_value, shorten
from rosbridge_conformance.wire.line_protocol import ASIDE
from rosbridge_conformance.wire.listening import Listener
from rosbridge_conformance.wire.pace import Pace
from rosbridge_conformance.wire.unwrap import decode_text
from rosbridge_conformance.wire.wrap import wrap

_GOODBYE_SECONDS = 3.0
ANSWER_SECONDS = 10.0
"""Timeout of a response of the program, in seconds. It only confirms the command, so it is generous."""


class _Unsupported(Exception):
    """The library lacks the feature that the case tests; the text names it."""


async def play_as_server(
    case: Case, target: Target, program: Driven, listener: Listener, pace: Pace, tag: str
) -> Played:
    """Play one case.

    Args:
        case: case to play.
        target: description of the client library.
        program: program around it, not connected yet.
        listener: listener that it connects to.
        pace: clock.
        tag: unique part of names, which replaces `@` in the case.
    """
    return await _ClientPlayer(case, target, program, listener, pace, tag).play()


class _ClientPlayer(CasePlayer):
    peer, label = "client", "connection"
    sent, received = "<", ">"
    leaving = ("the server closes", "the server cuts the line")

    def __init__(
        self, case: Case, target: Target, program: Driven, listener: Listener, pace: Pace, tag: str
    ) -> None:
        super().__init__(case, target, pace, tag)
        self._program = program
        self._listener = listener
        self._events: deque[dict[str, Json]] = deque()
        self._asides: dict[str, deque[dict[str, Json]]] = {name: deque() for name in ASIDE}
        # Each mark is used once: a connection may be opened again under its name.
        self._probe_numbers = count(1)
        self._probes_heard: set[str] = set()
        self._subscribed: set[str] = set()
        self._rosapi = any("rosapi/" in str(step) for step in case.steps)
        program.on_event = self._take_event
        program.on_noise = lambda text: self._note("a", "!", f"prints: {shorten(text)}")

    async def _run(self) -> Fault | None:
        try:
            return await super()._run()
        except _Unsupported as error:
            self._unsupported = str(error)
            return None

    async def _connect(self) -> None:
        first = self._case.steps[0]
        if not (isinstance(first, Tell) and _word(first.command, "do") == "connect"):
            await self._tell({"do": "connect"}, None)
            await self._open(self._case.clients[0])

    async def _leave(self, *, abruptly: bool = True) -> None:
        """Disconnect the client; the program is killed if that fails."""
        try:
            async with asyncio.timeout(_GOODBYE_SECONDS):
                await self._program.tell({"do": "close"})
        except (TimeoutError, ProgramEnded):
            self._program.kill()
        self._program.on_event = lambda event: None
        self._program.on_noise = lambda text: None
        await super()._leave(abruptly=abruptly)

    # Steps

    async def _step(self, step: Step) -> None:
        match step:
            case Tell():
                await self._tell(step.command, step.within)
            case Hear():
                await self._hear(step)
            case HearNothing():
                await self._pace.sleep(step.seconds)
                self._refuse_events(f"no event within {step.seconds:g} s")
            case _:
                await super()._step(step)

    async def _tell(self, command: Json, within: float | None) -> None:
        """Send a command to the program, and wait for its confirmation."""
        told = self._pattern(command)
        if not isinstance(told, dict):
            raise TypeError("a command is an object")
        if told["do"] in ("connect", "reconnect"):
            told = {**told, "url": self._listener.url}
        if told.get("wait") is False:
            self._listener.keep_waiting()
        for key in ("as", "of"):
            if key in told:
                told[key] = f"{self._tag}.{told[key]}"
        self._note("a", "!", f"told: {shorten(json.dumps(told))}")
        seconds = ANSWER_SECONDS if within is None else within
        try:
            async with asyncio.timeout(seconds):
                answer = await self._program.tell(told)
        except TimeoutError as error:
            raise Stop(Difference("", "an answer of the program", f"none within {seconds:g} s")) from error
        if "unsupported" in answer:
            self._note("a", "!", f"says: {shorten(json.dumps(answer))}")
            raise _Unsupported(str(answer["unsupported"]))
        if answer.get("ok") is not True:
            raise Stop(Difference("", "the command done", shorten(json.dumps(answer))))

    async def _hear(self, step: Hear) -> None:
        pattern = self._pattern(step.event)
        queue = self._asides[_word(pattern, "event")] if _word(pattern, "event") in ASIDE else self._events
        seconds = self._seconds(step.within)
        wanted = as_text(as_value(pattern))
        if not await self._until(lambda: bool(queue), seconds):
            raise Stop(Difference("", wanted, f"nothing within {seconds:g} s"))
        found = match_frame(pattern, as_value(queue.popleft()), self._context)
        if isinstance(found, Difference):
            raise Stop(found)

    def _refuse_events(self, wanted: str) -> None:
        if self._events:
            raise Stop(Difference("", wanted, shorten(json.dumps(self._events[0]))))

    def _frames_of(self, step: Send, body: Json, index: int) -> list[Raw]:
        return wrap(self._pattern(body), step.via, step.fragment_size, f"{self._tag}:{index}")

    # After the last step

    async def _finish(self) -> None:
        await super()._finish()
        if not self._case.leftover:
            self._refuse_events("no further event")
            if self._listener.waiting:
                raise Stop(Difference("", "no further connection", "one more"))

    async def _probe(self, connection: Connection) -> None:
        """Probe the client with a subscription and a message, sent after everything else."""
        connection.probes += 1
        topic, mark = f"/@/probe_{connection.name}", f"{connection.name}{next(self._probe_numbers)}"
        if connection.probes == 1:
            handle = f"probe_{connection.name}"
            kind: dict[str, Json] = {"topic": topic, "type": "std_msgs/String"}
            await self._tell({"do": "subscribe", "as": handle, **kind}, None)
            if not await self._until(lambda: connection.name in self._subscribed, self._target.timeout):
                raise Stop(Difference("", f"a subscription of {topic}", "none: the client is stuck"))
        message: Json = {"op": "publish", "topic": topic, "msg": {"data": mark}}
        await self._put(connection, json.dumps(self._pattern(message)))
        if not await self._until(lambda: mark in self._probes_heard, self._target.timeout):
            raise Stop(Difference("", f"a message on {topic} heard", "nothing: the client is stuck"))

    # Wires and events

    async def _connection(self, name: str) -> Connection:
        if name not in self._connections:
            raise Stop(Difference("", f"connection {name}", "none"))
        return self._connections[name]

    async def _open(self, name: str) -> Connection:
        try:
            async with asyncio.timeout(ANSWER_SECONDS):
                wire = await self._listener.accept()
        except TimeoutError as error:
            raise Stop(Difference("", "a connection", "none")) from error
        return self._add(name, wire)

    async def _sort(self, connection: Connection, raw: Raw) -> None:
        """Sort a frame: probes, and calls of rosapi that no step expects, are kept apart."""
        value = decode_text(raw)
        if isinstance(value, dict):
            if str(value.get("topic", "")).startswith(f"/{self._tag}/probe_"):
                self._subscribed.add(connection.name)
                return
            service = str(value.get("service", ""))
            if service.lstrip("/").startswith("rosapi/") and not self._rosapi:
                await self._refuse(connection, service, value)
                return
        connection.frames.append(raw)

    async def _refuse(self, connection: Connection, service: str, call: dict[str, Value]) -> None:
        """Reject a call of rosapi, which this server does not have (SRV-04)."""
        refusal: dict[str, Value] = {
            "op": "service_response",
            "service": service,
            "values": f"Service {service} does not exist",
            "result": False,
        }
        if "id" in call:
            refusal["id"] = call["id"]
        await self._put(connection, as_text(refusal))

    def _take_event(self, event: dict[str, Json]) -> None:
        self._note("a", "!", f"says: {shorten(json.dumps(event, ensure_ascii=False))}")
        handle = event.get("of")
        if isinstance(handle, str):
            tag, _, name = handle.partition(".")
            if tag != self._tag:
                return
            event = {**event, "of": name}
            if name.startswith("probe_"):
                self._probes_heard.add(_word(event.get("value"), "data"))
                self._arrived.set()
                return
        if event.get("event") == "uncaught":
            self._remarks.append(f"an uncaught exception: {shorten(_word(event, 'text'))}")
        self._asides.get(_word(event, "event"), self._events).append(event)
        self._arrived.set()


def _word(value: Json | Value, key: str) -> str:
    """Return a string of an object, or ""."""
    return str(value.get(key, "")) if isinstance(value, dict) else ""
