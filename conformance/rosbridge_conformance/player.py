"""Player of one case against one server."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, TypeAlias

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
from rosbridge_conformance.wire.auth import fill_auth
from rosbridge_conformance.wire.pace import Pace
from rosbridge_conformance.wire.unwrap import (
    decode_cbor,
    decode_text,
    first_fault_of_fragment,
    join_fragments,
    open_png,
)
from rosbridge_conformance.wire.wires import Dial, Wire, WireClosed, WireError

_PROBE_AGAIN = 0.5
NO_TIME = 1e-6
"""Shortest wait, in seconds."""


@dataclass(frozen=True, slots=True)
class Line:
    """Line of a transcript: a frame, or an event of the connection.

    Attributes:
        at: seconds since the case began.
        way: `>` from the client to the server, `<` the other way, `!` an event.
    """

    at: float
    client: str
    way: Literal[">", "<", "!"]
    text: str


@dataclass(frozen=True, slots=True)
class Fault:
    """Failure of a case.

    Attributes:
        step: number of the step from 1; after the last step, one more than there are steps.
        doing: description of the step.
    """

    step: int
    doing: str
    difference: Difference


@dataclass(frozen=True, slots=True)
class Played:
    """Outcome of a case: the fault, if any, and tolerated deviations.

    Attributes:
        unsupported: feature that the client library under test lacks, or "".
        answers: response times of the server to probes, in seconds.
    """

    fault: Fault | None
    remarks: tuple[str, ...]
    transcript: tuple[Line, ...]
    seconds: float
    unsupported: str = ""
    answers: tuple[float, ...] = ()


class Stop(Exception):
    """A step failed; the case ends here."""

    def __init__(self, difference: Difference) -> None:
        super().__init__(str(difference))
        self.difference = difference


Raw: TypeAlias = str | bytes


CASE_FRAMES: Final = 20_000
"""Maximum number of frames of one connection of a case. A server that sends more fails the case."""
CASE_BYTES: Final = 64 * 1024 * 1024
"""Maximum size of these frames."""
TRANSCRIPT_LINES: Final = 2000
"""Maximum number of lines of a transcript."""

_TOO_MUCH: Final = 1009  # "message too big", the closest code


@dataclass(slots=True)
class _Client:
    """Named connection with its unread frames."""

    name: str
    wire: Wire
    frames: deque[Raw] = field(default_factory=deque)
    statuses: deque[Raw] = field(default_factory=deque)
    answers: set[str] = field(default_factory=set)
    arrived: asyncio.Event = field(default_factory=asyncio.Event)
    closed: int | None = None
    reader: asyncio.Task[None] | None = None
    probes: int = 0
    received_frames: int = 0
    received_bytes: int = 0

    def take(self, raw: Raw) -> bool:
        """Count a frame. Returns False above the limits."""
        self.received_frames += 1
        self.received_bytes += len(raw)
        return self.received_frames <= CASE_FRAMES and self.received_bytes <= CASE_BYTES


async def play(case: Case, target: Target, dial: Dial, pace: Pace, tag: str) -> Played:
    """Play one case.

    Args:
        case: case to play.
        target: description of the server.
        dial: opens a connection to the server.
        pace: clock.
        tag: unique part of names, which replaces `@` in the case.
    """
    player = _Player(case, target, dial, pace, tag)
    try:
        fault = await player.run()
    finally:
        await player.leave()
    return Played(
        fault,
        tuple(player.remarks),
        tuple(player.transcript),
        pace.now() - player.began,
        answers=tuple(player.answers),
    )


class _Player:
    def __init__(self, case: Case, target: Target, dial: Dial, pace: Pace, tag: str) -> None:
        self._case = case
        self._target = target
        self._dial = dial
        self._pace = pace
        self._tag = tag
        self._clients: dict[str, _Client] = {}
        self._gone: list[_Client] = []
        self._context = Context(ros=target.ros, three_part=target.type_names == "three")
        self.began = pace.now()
        self.remarks: list[str] = []
        self.transcript: list[Line] = []
        self.answers: list[float] = []

    async def run(self) -> Fault | None:
        number, doing = 0, "connect"
        try:
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
        except WireError as error:
            return Fault(number, doing, Difference("", "a connection", str(error)))
        return None

    async def leave(self) -> None:
        """Close all connections."""
        for client in (*self._clients.values(), *self._gone):
            if client.reader is not None:
                client.reader.cancel()
        for client in self._clients.values():
            await client.wire.close()
        readers = [client.reader for client in (*self._clients.values(), *self._gone) if client.reader]
        await asyncio.gather(*readers, return_exceptions=True)

    # Steps

    async def _step(self, step: Step) -> None:
        match step:
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
                    await self._probe(await self._client(name))
                await self._pace.sleep(self._target.settle)
            case Open():
                await self._open(step.client)
            case Close():
                await self._close(step)
            case Tell() | Hear() | HearNothing():
                raise Stop(Difference("", "a step for a server", describe(step)))

    async def _send(self, step: Send) -> None:
        client = await self._client(step.client)
        for index in range(step.times):
            if index and step.every:
                await self._pace.sleep(step.every)
            await self._put(client, self._message(step, index))

    def _message(self, step: Send, index: int) -> Raw:
        if step.form == "hex":
            return bytes.fromhex(str(step.body))
        if step.form == "text":
            return self._named(str(step.body))
        body = fill_auth(fill(step.body, self._context, index), self._target.auth_secret)
        return self._named(json.dumps(body))

    def _named(self, text: str) -> str:
        return text.replace("@", self._tag)

    def _pattern(self, pattern: Json) -> Json:
        value: Json = json.loads(self._named(json.dumps(pattern)))
        return value

    async def _expect(self, step: Expect) -> None:
        client = await self._client(step.client)
        pattern = self._pattern(step.frame)
        value = await self._next_value(client, step, _is_status(pattern))
        found = value if isinstance(value, Difference) else match_frame(pattern, value, self._context)
        if isinstance(found, Match):
            self._remark_extra(found)
            return
        if not isinstance(value, Difference):
            for tolerated in step.tolerate:
                if isinstance(match_frame(self._pattern(tolerated.frame), value, self._context), Match):
                    self.remarks.append(tolerated.why)
                    return
        raise Stop(found)

    def _remark_extra(self, found: Match) -> None:
        if found.extra:
            self.remarks.append(f"keys that no text knows: {', '.join(found.extra)}")

    async def _next_value(self, client: _Client, step: Expect, status: bool) -> Value | Difference:
        wanted = as_text(as_value(self._pattern(step.frame)))
        raw = await self._next(client, step.within, status, wanted)
        if step.via and step.via[0] == "cbor":
            return decode_cbor(raw)
        value = decode_text(raw)
        for wrapping in step.via:
            if isinstance(value, Difference):
                return value
            if wrapping == "png":
                text = open_png(value)
            else:
                text = await self._join(client, value, step.fragment_size or 1, step.within)
            value = text if isinstance(text, Difference) else decode_text(text)
        return value

    async def _join(self, client: _Client, first: Value, size: int, within: float | None) -> str | Difference:
        frames: list[dict[str, Value]] = []
        value: Value | Difference = first
        while True:
            if isinstance(value, Difference):
                return value
            fault = first_fault_of_fragment(value, len(frames), size)
            if fault is not None or not isinstance(value, dict):
                return fault or Difference("", "a fragment", as_text(value))
            frames.append(value)
            if len(frames) == frames[0]["total"]:
                return join_fragments(frames, size)
            value = decode_text(await self._next(client, within, False, f"fragment {len(frames)}"))

    async def _expect_all(self, step: ExpectAll) -> None:
        client = await self._client(step.client)
        patterns = [self._pattern(frame) for frame in step.frames]
        while patterns:
            wanted = " or ".join(as_text(as_value(pattern)) for pattern in patterns)
            value = decode_text(await self._next(client, step.within, False, wanted))
            if isinstance(value, Difference):
                raise Stop(value)
            for pattern in patterns:
                found = match_frame(pattern, value, self._context)
                if isinstance(found, Match):
                    self._remark_extra(found)
                    patterns.remove(pattern)
                    break
            else:
                raise Stop(Difference("", wanted, as_text(value)))

    async def _expect_nothing(self, step: ExpectNothing) -> None:
        client = await self._client(step.client)
        await self._pace.sleep(step.seconds)
        if step.matching is None:
            if client.frames:
                raise Stop(Difference("", f"no frame within {step.seconds} s", show(client.frames[0])))
            return
        pattern = self._pattern(step.matching)
        for raw in client.statuses if _is_status(pattern) else client.frames:
            value = decode_text(raw)
            if not isinstance(value, Difference) and isinstance(
                match_frame(pattern, value, self._context), Match
            ):
                raise Stop(Difference("", f"no frame like {as_text(as_value(pattern))}", show(raw)))

    async def _expect_close(self, step: ExpectClose) -> None:
        client = await self._client(step.client)
        deadline = self._pace.now() + (self._target.timeout if step.within is None else step.within)
        while client.closed is None:
            client.arrived.clear()
            left = deadline - self._pace.now()
            if left <= NO_TIME or not await self._pace.wait(client.arrived, left):
                raise Stop(Difference("", "the connection closed by the server", "an open connection"))
        if step.codes and client.closed not in step.codes:
            wanted = " or ".join(str(code) for code in step.codes)
            raise Stop(Difference("", f"close code {wanted}", str(client.closed)))
        self._gone.append(self._clients.pop(client.name))

    async def _close(self, step: Close) -> None:
        client = await self._client(step.client)
        del self._clients[step.client]
        self._gone.append(client)
        self._note(client.name, "!", "cuts the line" if step.abruptly else "leaves")
        if client.reader is not None:
            client.reader.cancel()
        await client.wire.close(abruptly=step.abruptly)

    # After the last step

    async def _finish(self) -> None:
        """Check that every connection responds, and that no frames were unexpected."""
        if self._case.probe:
            for client in tuple(self._clients.values()):
                await self._probe(client)
        if not self._case.leftover:
            await self._pace.sleep(self._target.settle)
            for client in self._clients.values():
                if client.frames:
                    got = show(client.frames[0])
                    raise Stop(Difference(f"client {client.name}", "no further frame", got))
                if client.closed is not None and self._case.probe:
                    raise Stop(Difference(f"client {client.name}", "an open connection", "a closed one"))

    async def _probe(self, client: _Client) -> None:
        """Probe a connection after everything it has sent (section 0 of the facts)."""
        client.probes += 1
        mark = f"{client.name}{client.probes}"
        if self._target.probe == "get_time":
            frames: list[Json] = [
                {"op": "call_service", "id": f"probe:{mark}", "service": "/rosapi/get_time"}
            ]
        else:
            frames = self._loopback(client, mark)
        asked_at = self._pace.now()
        for frame in frames:
            await self._put(client, self._named(json.dumps(frame)))
        deadline = self._pace.now() + max(self._target.timeout, 2 * _PROBE_AGAIN)
        while mark not in client.answers:
            if client.closed is not None:
                raise WireClosed(client.closed)
            client.arrived.clear()
            left = deadline - self._pace.now()
            if left <= NO_TIME:
                asked = as_text(as_value(frames[-1]))
                raise Stop(
                    Difference(
                        f"client {client.name}", f"an answer to {asked}", "none: the connection is dead"
                    )
                )
            if not await self._pace.wait(client.arrived, min(left, _PROBE_AGAIN)):
                await self._put(client, self._named(json.dumps(frames[-1])))
        self.answers.append(self._pace.now() - asked_at)

    def _loopback(self, client: _Client, mark: str) -> list[Json]:
        topic = f"/@/probe_{client.name}"
        publish: Json = {"op": "publish", "id": "probe", "topic": topic, "msg": {"data": f"probe:{mark}"}}
        if client.probes > 1:
            return [publish]
        kind: dict[str, Json] = {"id": "probe", "topic": topic, "type": "std_msgs/String"}
        return [{"op": "advertise", **kind}, {"op": "subscribe", **kind}, publish]

    # Wires

    async def _client(self, name: str) -> _Client:
        return self._clients[name] if name in self._clients else await self._open(name)

    async def _open(self, name: str) -> _Client:
        if name in self._clients:
            return self._clients[name]
        client = _Client(name, await self._dial(self._tag))
        self._note(name, "!", "connects")
        client.reader = asyncio.create_task(self._read(client))
        self._clients[name] = client
        if self._target.auth_secret is not None and self._case.profile != "AUTH":
            login = fill_auth({"$auth": {}}, self._target.auth_secret)
            await self._put(client, json.dumps(login))
        return client

    async def _put(self, client: _Client, raw: Raw) -> None:
        self._note(client.name, ">", show(raw))
        await client.wire.send(raw)

    async def _read(self, client: _Client) -> None:
        while client.closed is None:
            try:
                raw = await client.wire.receive()
            except WireClosed as closed:
                client.closed = closed.code
                self._note(client.name, "!", str(closed))
            else:
                self._note(client.name, "<", show(raw))
                self._sort(client, raw)
                if not client.take(raw):
                    self._note(client.name, "!", f"more than {CASE_FRAMES} frames or {CASE_BYTES} bytes")
                    client.closed = _TOO_MUCH
                    await client.wire.close(abruptly=True)
            client.arrived.set()

    def _sort(self, client: _Client, raw: Raw) -> None:
        """Sort a frame: responses to probes, status messages, and others."""
        value = None if isinstance(raw, bytes) else decode_text(raw)
        if isinstance(value, dict):
            mark = self._probe_mark(value)
            if mark is not None:
                client.answers.add(mark)
                return
            if value.get("op") == "status":
                if not str(value.get("id", "")).startswith("probe"):
                    client.statuses.append(raw)
                return
        client.frames.append(raw)

    def _probe_mark(self, value: dict[str, Value]) -> str | None:
        if str(value.get("id", "")).startswith("probe:"):
            return str(value["id"]).removeprefix("probe:")
        if not str(value.get("topic", "")).startswith(f"/{self._tag}/probe_"):
            return None
        message = value.get("msg")
        return str(message.get("data", "")).removeprefix("probe:") if isinstance(message, dict) else ""

    async def _next(self, client: _Client, within: float | None, status: bool, wanted: str) -> Raw:
        queue = client.statuses if status else client.frames
        seconds = self._target.timeout if within is None else within
        deadline = self._pace.now() + seconds
        while not queue:
            client.arrived.clear()
            left = deadline - self._pace.now()
            if client.closed is not None:
                raise Stop(Difference("", wanted, f"the connection {WireClosed(client.closed)}"))
            if left <= NO_TIME or not await self._pace.wait(client.arrived, left):
                raise Stop(Difference("", wanted, f"nothing within {seconds:g} s"))
        return queue.popleft()

    def _note(self, name: str, way: Literal[">", "<", "!"], text: str) -> None:
        if len(self.transcript) < TRANSCRIPT_LINES:
            self.transcript.append(Line(round(self._pace.now() - self.began, 4), name, way, text))


def _is_status(pattern: Json) -> bool:
    return isinstance(pattern, dict) and pattern.get("op") == "status"


def show(raw: Raw) -> str:
    """Return a frame as shown in transcripts."""
    return f"{len(raw)} bytes: {raw[:200].hex()}" if isinstance(raw, bytes) else shorten(raw)


def describe(step: Step) -> str:
    """Describe a step in a few words."""
    match step:
        case Send():
            sent = step.body if isinstance(step.body, str) else json.dumps(step.body)
            return f"{step.client} sends {shorten(sent)}"
        case Expect():
            through = f" through {' and '.join(step.via)}" if step.via else ""
            return f"{step.client} expects {shorten(json.dumps(step.frame))}{through}"
        case ExpectAll():
            return f"{step.client} expects {_joined(step.frames)}, in any order"
        case ExpectNothing():
            what = "nothing" if step.matching is None else f"nothing like {json.dumps(step.matching)}"
            return f"{step.client} expects {what} for {step.seconds:g} s"
        case ExpectClose():
            return f"{step.client} expects to be closed"
        case Wait():
            return f"wait {step.seconds:g} s"
        case Settle():
            return f"wait until the server has handled what {' and '.join(step.clients)} sent"
        case Open():
            return f"{step.client} connects"
        case Close():
            return f"{step.client} {'cuts the line' if step.abruptly else 'leaves'}"
        case Tell():
            return f"told to {shorten(json.dumps(step.command))}"
        case Hear():
            return f"the user hears {shorten(json.dumps(step.event))}"
        case HearNothing():
            return f"the user hears nothing for {step.seconds:g} s"


def _joined(frames: Sequence[Json]) -> str:
    return " and ".join(shorten(json.dumps(frame)) for frame in frames)
