"""Player of one case as a server, against a client library in its program."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

from rosbridge_conformance.player import NO_TIME, Fault, Line, Played, Raw, Stop, describe, show
from rosbridge_conformance.program import Driven, ProgramEnded
from rosbridge_conformance.suite.case import (
    Case,
    Close,
    Expect,
    ExpectAll,
    ExpectClose,
    ExpectNothing,
    Hear,
    HearNothing,
    Open,
    Send,
    Settle,
    Step,
    Tell,
    Wait,
)
from rosbridge_conformance.suite.matching import Context, Difference, Match, fill, match_frame
from rosbridge_conformance.suite.target import Target
from rosbridge_conformance.suite.values import Json, Value, as_text, as_value, shorten
from rosbridge_conformance.wire.line_protocol import ASIDE
from rosbridge_conformance.wire.listening import Listener
from rosbridge_conformance.wire.pace import Pace
from rosbridge_conformance.wire.unwrap import decode_text
from rosbridge_conformance.wire.wires import Wire, WireClosed
from rosbridge_conformance.wire.wrap import wrap

_GOODBYE_SECONDS = 3.0
ANSWER_SECONDS = 10.0
"""Timeout of a response of the program, in seconds. It only confirms the command, so it is generous."""


class _Unsupported(Exception):
    """The library lacks the feature that the case tests; the text names it."""


@dataclass(slots=True)
class _Connection:
    """Connection of the client under test."""

    name: str
    wire: Wire
    frames: deque[Raw] = field(default_factory=deque)
    closed: int | None = None
    reader: asyncio.Task[None] | None = None
    probes: int = 0


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
    player = _ClientPlayer(case, target, program, listener, pace, tag)
    unsupported, fault = "", None
    try:
        fault = await player.run()
    except _Unsupported as error:
        unsupported = str(error)
    finally:
        await player.leave()
    seconds = pace.now() - player.began
    return Played(fault, tuple(player.remarks), tuple(player.transcript), seconds, unsupported)


class _ClientPlayer:
    def __init__(
        self, case: Case, target: Target, program: Driven, listener: Listener, pace: Pace, tag: str
    ) -> None:
        self._case = case
        self._target = target
        self._program = program
        self._listener = listener
        self._pace = pace
        self._tag = tag
        self._connections: dict[str, _Connection] = {}
        self._gone: list[_Connection] = []
        self._events: deque[dict[str, Json]] = deque()
        self._asides: dict[str, deque[dict[str, Json]]] = {name: deque() for name in ASIDE}
        self._probes_heard: set[str] = set()
        self._subscribed: set[str] = set()
        self._arrived = asyncio.Event()
        self._context = Context(ros=target.ros, three_part=target.type_names == "three")
        self._rosapi = any("rosapi/" in str(step) for step in case.steps)
        self.began = pace.now()
        self.remarks: list[str] = []
        self.transcript: list[Line] = []
        program.on_event = self._take_event
        program.on_noise = lambda text: self._note("a", "!", f"prints: {shorten(text)}")

    async def run(self) -> Fault | None:
        number, doing = 0, "connect"
        try:
            first = self._case.steps[0]
            if not (isinstance(first, Tell) and _word(first.command, "do") == "connect"):
                await self._tell({"do": "connect"}, None)
                await self._open(self._case.clients[0])
            for number, step in enumerate(self._case.steps, 1):
                doing = describe(step) + (f" ({note})" if (note := self._case.notes[number - 1]) else "")
                await self._step(step)
            number, doing = len(self._case.steps) + 1, "after the last step"
            await self._finish()
        except Stop as stop:
            return Fault(number, doing, stop.difference)
        except WireClosed as closed:
            return Fault(number, doing, Difference("", "an open connection", str(closed)))
        except ProgramEnded:
            return Fault(number, doing, Difference("", "a running program", "the program has ended"))
        return None

    async def leave(self) -> None:
        """Disconnect the client; the program is killed if that fails."""
        try:
            async with asyncio.timeout(_GOODBYE_SECONDS):
                await self._program.tell({"do": "close"})
        except (TimeoutError, ProgramEnded):
            self._program.kill()
        self._program.on_event = lambda event: None
        self._program.on_noise = lambda text: None
        connections = (*self._connections.values(), *self._gone)
        for connection in connections:
            if connection.reader is not None:
                connection.reader.cancel()
            await connection.wire.close(abruptly=True)
        readers = [connection.reader for connection in connections if connection.reader]
        await asyncio.gather(*readers, return_exceptions=True)

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
            case Send():
                await self._send(step)
            case Expect():
                await self._expect(step)
            case ExpectAll():
                await self._expect_all(step)
            case ExpectNothing():
                await self._expect_nothing(step)
            case ExpectClose():
                await self._expect_close(step)
            case Wait():
                await self._pace.sleep(step.seconds)
            case Settle():
                for name in step.clients:
                    await self._probe(self._connection(name))
            case Open():
                await self._open(step.client)
            case Close():
                await self._close(step)

    async def _tell(self, command: Json, within: float | None) -> None:
        """Send a command to the program, and wait for its confirmation."""
        told = self._named(command)
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
        pattern = self._named(step.event)
        queue = self._asides[_word(pattern, "event")] if _word(pattern, "event") in ASIDE else self._events
        seconds = self._target.timeout if step.within is None else step.within
        wanted = as_text(as_value(pattern))
        if not await self._until(lambda: bool(queue), seconds):
            raise Stop(Difference("", wanted, f"nothing within {seconds:g} s"))
        found = match_frame(pattern, as_value(queue.popleft()), self._context)
        if isinstance(found, Difference):
            raise Stop(found)

    def _refuse_events(self, wanted: str) -> None:
        if self._events:
            raise Stop(Difference("", wanted, shorten(json.dumps(self._events[0]))))

    async def _send(self, step: Send) -> None:
        connection = self._connection(step.client)
        for index in range(step.times):
            if index and step.every:
                await self._pace.sleep(step.every)
            for raw in self._messages(step, index):
                await self._put(connection, raw)

    def _messages(self, step: Send, index: int) -> list[Raw]:
        if step.form == "hex":
            return [bytes.fromhex(str(step.body))]
        if step.form == "text":
            return [str(step.body).replace("@", self._tag)]
        body = self._named(fill(step.body, self._context, index))
        return wrap(body, step.via, step.fragment_size, f"{self._tag}:{index}")

    async def _expect(self, step: Expect) -> None:
        connection = self._connection(step.client)
        pattern = self._named(step.frame)
        value = decode_text(await self._next(connection, step.within, as_text(as_value(pattern))))
        if isinstance(value, Difference):
            raise Stop(value)
        found = match_frame(pattern, value, self._context)
        if isinstance(found, Match):
            self._remark_extra(found)
            return
        for tolerated in step.tolerate:
            if isinstance(match_frame(self._named(tolerated.frame), value, self._context), Match):
                self.remarks.append(tolerated.why)
                return
        raise Stop(found)

    def _remark_extra(self, found: Match) -> None:
        if found.extra:
            self.remarks.append(f"keys that no text knows: {', '.join(found.extra)}")

    async def _expect_all(self, step: ExpectAll) -> None:
        connection = self._connection(step.client)
        patterns = [self._named(frame) for frame in step.frames]
        while patterns:
            wanted = " or ".join(as_text(as_value(pattern)) for pattern in patterns)
            value = decode_text(await self._next(connection, step.within, wanted))
            if isinstance(value, Difference):
                raise Stop(value)
            fitting = [p for p in patterns if isinstance(match_frame(p, value, self._context), Match)]
            if not fitting:
                raise Stop(Difference("", wanted, as_text(value)))
            patterns.remove(fitting[0])

    async def _expect_nothing(self, step: ExpectNothing) -> None:
        connection = self._connection(step.client)
        await self._pace.sleep(step.seconds)
        for raw in connection.frames:
            value = decode_text(raw)
            pattern: Json = {"$any": "anything"} if step.matching is None else self._named(step.matching)
            if isinstance(value, Difference) or isinstance(match_frame(pattern, value, self._context), Match):
                raise Stop(Difference("", f"no such frame within {step.seconds:g} s", show(raw)))

    async def _expect_close(self, step: ExpectClose) -> None:
        connection = self._connection(step.client)
        seconds = self._target.timeout if step.within is None else step.within
        if not await self._until(lambda: connection.closed is not None, seconds):
            raise Stop(Difference("", "the connection closed by the client", "an open connection"))
        if step.codes and connection.closed not in step.codes:
            wanted = " or ".join(str(code) for code in step.codes)
            raise Stop(Difference("", f"close code {wanted}", str(connection.closed)))
        self._gone.append(self._connections.pop(connection.name))

    async def _close(self, step: Close) -> None:
        connection = self._connections.pop(step.client)
        self._gone.append(connection)
        self._note(connection.name, "!", "the server cuts the line" if step.abruptly else "the server closes")
        if connection.reader is not None:
            connection.reader.cancel()
        await connection.wire.close(abruptly=step.abruptly)

    # After the last step

    async def _finish(self) -> None:
        """Check that the client still works, and that no frames or events were unexpected."""
        if self._case.probe:
            for connection in tuple(self._connections.values()):
                await self._probe(connection)
        if self._case.leftover:
            return
        await self._pace.sleep(self._target.settle)
        for connection in self._connections.values():
            if connection.frames:
                raise Stop(
                    Difference(
                        f"connection {connection.name}", "no further frame", show(connection.frames[0])
                    )
                )
        self._refuse_events("no further event")
        if self._listener.waiting:
            raise Stop(Difference("", "no further connection", "one more"))

    async def _probe(self, connection: _Connection) -> None:
        """Probe the client with a subscription and a message, sent after everything else."""
        connection.probes += 1
        topic, mark = f"/@/probe_{connection.name}", f"{connection.name}{connection.probes}"
        if connection.probes == 1:
            handle = f"probe_{connection.name}"
            kind: dict[str, Json] = {"topic": topic, "type": "std_msgs/String"}
            await self._tell({"do": "subscribe", "as": handle, **kind}, None)
            if not await self._until(lambda: connection.name in self._subscribed, self._target.timeout):
                raise Stop(Difference("", f"a subscription of {topic}", "none: the client is stuck"))
        message: Json = {"op": "publish", "topic": topic, "msg": {"data": mark}}
        await self._put(connection, json.dumps(self._named(message)))
        if not await self._until(lambda: mark in self._probes_heard, self._target.timeout):
            raise Stop(Difference("", f"a message on {topic} heard", "nothing: the client is stuck"))

    # Wires and events

    def _connection(self, name: str) -> _Connection:
        if name not in self._connections:
            raise Stop(Difference("", f"connection {name}", "none"))
        connection = self._connections[name]
        return connection

    async def _open(self, name: str) -> None:
        try:
            async with asyncio.timeout(ANSWER_SECONDS):
                wire = await self._listener.accept()
        except TimeoutError as error:
            raise Stop(Difference("", "a connection", "none")) from error
        connection = _Connection(name, wire)
        self._note(name, "!", "connects")
        connection.reader = asyncio.create_task(self._read(connection))
        self._connections[name] = connection

    async def _put(self, connection: _Connection, raw: Raw) -> None:
        self._note(connection.name, "<", show(raw))
        await connection.wire.send(raw)

    async def _read(self, connection: _Connection) -> None:
        while connection.closed is None:
            try:
                raw = await connection.wire.receive()
            except WireClosed as closed:
                connection.closed = closed.code
                self._note(connection.name, "!", str(closed))
            else:
                self._note(connection.name, ">", show(raw))
                await self._sort(connection, raw)
            self._arrived.set()

    async def _sort(self, connection: _Connection, raw: Raw) -> None:
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

    async def _refuse(self, connection: _Connection, service: str, call: dict[str, Value]) -> None:
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
            self.remarks.append(f"an exception that nobody caught: {shorten(_word(event, 'text'))}")
        self._asides.get(_word(event, "event"), self._events).append(event)
        self._arrived.set()

    async def _next(self, connection: _Connection, within: float | None, wanted: str) -> Raw:
        seconds = self._target.timeout if within is None else within
        if not await self._until(lambda: bool(connection.frames) or connection.closed is not None, seconds):
            raise Stop(Difference("", wanted, f"nothing within {seconds:g} s"))
        if not connection.frames:
            raise Stop(Difference("", wanted, f"the connection {WireClosed(connection.closed or 0)}"))
        return connection.frames.popleft()

    async def _until(self, done: Callable[[], bool], seconds: float) -> bool:
        """Wait until a condition holds. Returns False after the timeout."""
        deadline = self._pace.now() + seconds
        while not done():
            self._arrived.clear()
            left = deadline - self._pace.now()
            if left <= NO_TIME or not await self._pace.wait(self._arrived, left):
                return done()
        return True

    def _named(self, value: Json) -> Json:
        named: Json = json.loads(json.dumps(value).replace("@", self._tag))
        return named

    def _note(self, name: str, way: Literal[">", "<", "!"], text: str) -> None:
        self.transcript.append(Line(round(self._pace.now() - self.began, 4), name, way, text))


def _word(value: Json | Value, key: str) -> str:
    """Return a string of an object, or ""."""
    return str(value.get(key, "")) if isinstance(value, dict) else ""
