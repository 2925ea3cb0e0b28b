"""Player of one case: what is the same against servers and against client libraries."""

from __future__ import annotations

import asyncio
import json
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final, Literal, TypeAlias

from rosbridge_conformance.program import ProgramEnded
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
from rosbridge_conformance.wire.pace import Pace
from rosbridge_conformance.wire.unwrap import decode_text
from rosbridge_conformance.wire.wires import Wire, WireClosed, WireError

NO_TIME: Final = 1e-6
"""Shortest wait, in seconds."""
CASE_FRAMES: Final = 20_000
"""Maximum number of frames of one connection of a case. A peer that sends more fails the case."""
CASE_BYTES: Final = 64 * 1024 * 1024
"""Maximum size of these frames."""
TRANSCRIPT_LINES: Final = 2000
"""Maximum number of lines of a transcript."""

_TOO_MUCH: Final = 1009  # "message too big", the closest code

Raw: TypeAlias = str | bytes
Way: TypeAlias = Literal[">", "<", "!"]


@dataclass(frozen=True, slots=True)
class Line:
    """Line of a transcript: a frame, or an event of the connection.

    Attributes:
        at: seconds since the case began.
        way: `>` from the client to the server, `<` the other way, `!` an event.
    """

    at: float
    client: str
    way: Way
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


@dataclass(slots=True)
class Connection:
    """Named connection with its unread frames.

    Attributes:
        statuses: unread status messages of a server.
        answers: marks of the probes that a server has answered.
    """

    name: str
    wire: Wire
    reader: asyncio.Task[None] = field(init=False)
    frames: deque[Raw] = field(default_factory=deque)
    statuses: deque[Raw] = field(default_factory=deque)
    answers: set[str] = field(default_factory=set)
    closed: int | None = None
    probes: int = 0
    received_frames: int = 0
    received_bytes: int = 0

    def take(self, raw: Raw) -> bool:
        """Count a frame. Returns False above the limits."""
        self.received_frames += 1
        self.received_bytes += len(raw)
        return self.received_frames <= CASE_FRAMES and self.received_bytes <= CASE_BYTES


class CasePlayer(ABC):
    """Player of one case against a peer.

    Attributes:
        peer: the program under test.
        label: noun for a connection in reports.
        sent, received: ways of frames in the transcript.
        leaving: events of the transcript when this side closes or cuts a connection.
    """

    peer: ClassVar[str]
    label: ClassVar[str]
    sent: ClassVar[Way]
    received: ClassVar[Way]
    leaving: ClassVar[tuple[str, str]]

    def __init__(self, case: Case, target: Target, pace: Pace, tag: str) -> None:
        self._case = case
        self._target = target
        self._pace = pace
        self._tag = tag
        self._connections: dict[str, Connection] = {}
        self._gone: list[Connection] = []
        self._arrived = asyncio.Event()
        self._context = Context(ros=target.ros, three_part=target.type_names == "three")
        self._began = pace.now()
        self._remarks: list[str] = []
        self._transcript: list[Line] = []
        self._answers: list[float] = []
        self._unsupported = ""

    async def play(self) -> Played:
        """Play the case."""
        try:
            fault = await self._run()
        finally:
            await self._leave()
        return Played(
            fault,
            tuple(self._remarks),
            tuple(self._transcript),
            self._pace.now() - self._began,
            self._unsupported,
            tuple(self._answers),
        )

    async def _run(self) -> Fault | None:
        number, doing = 0, "connect"
        try:
            await self._connect()
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
        except ProgramEnded:
            return Fault(number, doing, Difference("", "a running program", "the program has ended"))
        return None

    async def _leave(self, *, abruptly: bool = False) -> None:
        """Close all connections."""
        readers = [each.reader for each in (*self._connections.values(), *self._gone)]
        for reader in readers:
            reader.cancel()
        for connection in self._connections.values():
            await connection.wire.close(abruptly=abruptly)
        await asyncio.gather(*readers, return_exceptions=True)

    # What differs

    @abstractmethod
    async def _connect(self) -> None:
        """Open the first connection."""

    @abstractmethod
    async def _open(self, name: str) -> Connection:
        """Open another connection."""

    @abstractmethod
    async def _connection(self, name: str) -> Connection:
        """Return the connection of a step."""

    @abstractmethod
    def _frames_of(self, step: Send, body: Json, index: int) -> list[Raw]:
        """Return the frames with a body of a step."""

    @abstractmethod
    async def _probe(self, connection: Connection) -> None:
        """Check that the peer still works, after everything that was sent to it."""

    @abstractmethod
    async def _sort(self, connection: Connection, raw: Raw) -> None:
        """Queue a frame, unless it belongs to a probe."""

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
                    await self._probe(await self._connection(name))
                await self._pace.sleep(self._target.settle)
            case Open():
                await self._open(step.client)
            case Close():
                await self._close(step)
            case Tell() | Hear() | HearNothing():
                raise Stop(Difference("", "a step for a server", describe(step)))

    async def _send(self, step: Send) -> None:
        connection = await self._connection(step.client)
        for index in range(step.times):
            if index and step.every:
                await self._pace.sleep(step.every)
            for raw in self._messages(step, index):
                await self._put(connection, raw)

    def _messages(self, step: Send, index: int) -> list[Raw]:
        if step.form == "hex":
            return [bytes.fromhex(str(step.body))]
        if step.form == "text":
            return [self._named(str(step.body))]
        return self._frames_of(step, fill(step.body, self._context, index), index)

    def _named(self, text: str) -> str:
        return text.replace("@", self._tag)

    def _pattern(self, pattern: Json) -> Json:
        value: Json = json.loads(self._named(json.dumps(pattern)))
        return value

    async def _expect(self, step: Expect) -> None:
        connection = await self._connection(step.client)
        pattern = self._pattern(step.frame)
        value = await self._next_value(connection, step, pattern)
        if isinstance(value, Difference):
            raise Stop(value)
        found = match_frame(pattern, value, self._context)
        if isinstance(found, Match):
            self._remark_extra(found)
            return
        for tolerated in step.tolerate:
            if self._matches(self._pattern(tolerated.frame), value):
                self._remarks.append(tolerated.why)
                return
        raise Stop(found)

    async def _next_value(self, connection: Connection, step: Expect, pattern: Json) -> Value | Difference:
        """Return the value of the next frame that a pattern is for."""
        return decode_text(await self._next(connection, step.within, as_text(as_value(pattern))))

    def _matches(self, pattern: Json, value: Value) -> bool:
        return isinstance(match_frame(pattern, value, self._context), Match)

    def _remark_extra(self, found: Match) -> None:
        if found.extra:
            self._remarks.append(f"keys that no text knows: {', '.join(found.extra)}")

    async def _expect_all(self, step: ExpectAll) -> None:
        connection = await self._connection(step.client)
        patterns = [self._pattern(frame) for frame in step.frames]
        while patterns:
            wanted = " or ".join(as_text(as_value(pattern)) for pattern in patterns)
            value = decode_text(await self._next(connection, step.within, wanted))
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
        connection = await self._connection(step.client)
        await self._pace.sleep(step.seconds)
        if step.matching is None:
            if connection.frames:
                got = show(connection.frames[0])
                raise Stop(Difference("", f"no frame within {step.seconds:g} s", got))
            return
        pattern = self._pattern(step.matching)
        for raw in connection.statuses if is_status(pattern) else connection.frames:
            value = decode_text(raw)
            if not isinstance(value, Difference) and self._matches(pattern, value):
                raise Stop(Difference("", f"no frame like {as_text(as_value(pattern))}", show(raw)))

    async def _expect_close(self, step: ExpectClose) -> None:
        connection = await self._connection(step.client)
        if not await self._until(lambda: connection.closed is not None, self._seconds(step.within)):
            raise Stop(Difference("", f"the connection closed by the {self.peer}", "an open connection"))
        if step.codes and connection.closed not in step.codes:
            wanted = " or ".join(str(code) for code in step.codes)
            raise Stop(Difference("", f"close code {wanted}", str(connection.closed)))
        self._gone.append(self._connections.pop(connection.name))

    async def _close(self, step: Close) -> None:
        connection = await self._connection(step.client)
        self._gone.append(self._connections.pop(connection.name))
        self._note(connection.name, "!", self.leaving[step.abruptly])
        connection.reader.cancel()
        await connection.wire.close(abruptly=step.abruptly)

    async def _finish(self) -> None:
        """Check that the peer still works, and that no frames were unexpected."""
        if self._case.probe:
            for connection in tuple(self._connections.values()):
                await self._probe(connection)
        if not self._case.leftover:
            await self._pace.sleep(self._target.settle)
            for connection in self._connections.values():
                self._refuse_leftover(connection)

    def _refuse_leftover(self, connection: Connection) -> None:
        if connection.frames:
            where, got = f"{self.label} {connection.name}", show(connection.frames[0])
            raise Stop(Difference(where, "no further frame", got))

    # Wires

    def _add(self, name: str, wire: Wire) -> Connection:
        connection = self._connections[name] = Connection(name, wire)
        self._note(name, "!", "connects")
        connection.reader = asyncio.create_task(self._read(connection))
        return connection

    async def _put(self, connection: Connection, raw: Raw) -> None:
        self._note(connection.name, self.sent, show(raw))
        await connection.wire.send(raw)

    async def _read(self, connection: Connection) -> None:
        while connection.closed is None:
            try:
                raw = await connection.wire.receive()
            except WireClosed as closed:
                connection.closed = closed.code
                self._note(connection.name, "!", str(closed))
            else:
                self._note(connection.name, self.received, show(raw))
                await self._sort(connection, raw)
                if not connection.take(raw):
                    self._note(connection.name, "!", f"more than {CASE_FRAMES} frames or {CASE_BYTES} bytes")
                    connection.closed = _TOO_MUCH
                    await connection.wire.close(abruptly=True)
            self._arrived.set()

    async def _next(
        self, connection: Connection, within: float | None, wanted: str, *, status: bool = False
    ) -> Raw:
        queue, seconds = connection.statuses if status else connection.frames, self._seconds(within)
        if not await self._until(lambda: bool(queue) or connection.closed is not None, seconds):
            raise Stop(Difference("", wanted, f"nothing within {seconds:g} s"))
        if not queue:
            raise Stop(Difference("", wanted, f"the connection {WireClosed(connection.closed or 0)}"))
        return queue.popleft()

    def _seconds(self, within: float | None) -> float:
        return self._target.timeout if within is None else within

    async def _until(self, done: Callable[[], bool], seconds: float) -> bool:
        """Wait until a condition holds. Returns False after the timeout."""
        deadline = self._pace.now() + seconds
        while not done():
            self._arrived.clear()
            left = deadline - self._pace.now()
            if left <= NO_TIME or not await self._pace.wait(self._arrived, left):
                return done()
        return True

    def _note(self, name: str, way: Way, text: str) -> None:
        if len(self._transcript) < TRANSCRIPT_LINES:
            self._transcript.append(Line(round(self._pace.now() - self._began, 4), name, way, text))


def is_status(pattern: Json) -> bool:
    """Return True for a pattern of status messages."""
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
