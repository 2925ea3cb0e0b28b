"""Player of one case against one server."""

from __future__ import annotations

import json

from rosbridge_conformance.case_player import NO_TIME, CasePlayer, Connection, Played, Raw, Stop, is_status
from rosbridge_conformance.suite.case import Case, Expect, Send
from rosbridge_conformance.suite.matching import Difference
from rosbridge_conformance.suite.target import Target
from rosbridge_conformance.suite.values import Json, Value, as_text, as_value
from rosbridge_conformance.wire.auth import fill_auth
from rosbridge_conformance.wire.pace import Pace
from rosbridge_conformance.wire.unwrap import (
    decode_cbor,
    decode_text,
    first_fault_of_fragment,
    join_fragments,
    open_png,
)
from rosbridge_conformance.wire.wires import Dial, WireClosed

_PROBE_AGAIN = 0.5


async def play(case: Case, target: Target, dial: Dial, pace: Pace, tag: str) -> Played:
    """Play one case.

    Args:
        case: case to play.
        target: description of the server.
        dial: opens a connection to the server.
        pace: clock.
        tag: unique part of names, which replaces `@` in the case.
    """
    return await _Player(case, target, dial, pace, tag).play()


class _Player(CasePlayer):
    peer, label = "server", "client"
    sent, received = ">", "<"
    leaving = ("leaves", "cuts the line")

    def __init__(self, case: Case, target: Target, dial: Dial, pace: Pace, tag: str) -> None:
        super().__init__(case, target, pace, tag)
        self._dial = dial

    async def _connect(self) -> None:
        await self._open(self._case.clients[0])

    async def _connection(self, name: str) -> Connection:
        return await self._open(name)

    async def _open(self, name: str) -> Connection:
        if name in self._connections:
            return self._connections[name]
        connection = self._add(name, await self._dial(self._tag))
        if self._target.auth_secret is not None and self._case.profile != "AUTH":
            login = fill_auth({"$auth": {}}, self._target.auth_secret)
            await self._put(connection, json.dumps(login))
        return connection

    def _frames_of(self, step: Send, body: Json, index: int) -> list[Raw]:
        return [self._named(json.dumps(fill_auth(body, self._target.auth_secret)))]

    async def _next_value(self, connection: Connection, step: Expect, pattern: Json) -> Value | Difference:
        wanted = as_text(as_value(pattern))
        raw = await self._next(connection, step.within, wanted, status=is_status(pattern))
        if step.via and step.via[0] == "cbor":
            return decode_cbor(raw)
        value = decode_text(raw)
        for wrapping in step.via:
            if isinstance(value, Difference):
                return value
            if wrapping == "png":
                text = open_png(value)
            else:
                text = await self._join(connection, value, step.fragment_size or 1, step.within)
            value = text if isinstance(text, Difference) else decode_text(text)
        return value

    async def _join(
        self, connection: Connection, first: Value, size: int, within: float | None
    ) -> str | Difference:
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
            value = decode_text(await self._next(connection, within, f"fragment {len(frames)}"))

    def _refuse_leftover(self, connection: Connection) -> None:
        super()._refuse_leftover(connection)
        if connection.closed is not None and self._case.probe:
            raise Stop(Difference(f"client {connection.name}", "an open connection", "a closed one"))

    async def _probe(self, connection: Connection) -> None:
        """Probe a connection after everything it has sent (section 0 of the facts)."""
        connection.probes += 1
        mark = f"{connection.name}{connection.probes}"
        if self._target.probe == "get_time":
            frames: list[Json] = [
                {"op": "call_service", "id": f"probe:{mark}", "service": "/rosapi/get_time"}
            ]
        else:
            frames = self._loopback(connection, mark)
        asked_at = self._pace.now()
        for frame in frames:
            await self._put(connection, self._named(json.dumps(frame)))
        deadline = asked_at + max(self._target.timeout, 2 * _PROBE_AGAIN)
        while not await self._until(
            lambda: mark in connection.answers or connection.closed is not None,
            min(deadline - self._pace.now(), _PROBE_AGAIN),
        ):
            if deadline - self._pace.now() <= NO_TIME:
                wanted = f"an answer to {as_text(as_value(frames[-1]))}"
                where, got = f"client {connection.name}", "none: the connection is dead"
                raise Stop(Difference(where, wanted, got))
            await self._put(connection, self._named(json.dumps(frames[-1])))
        if mark not in connection.answers:
            raise WireClosed(connection.closed or 0)
        self._answers.append(self._pace.now() - asked_at)

    def _loopback(self, connection: Connection, mark: str) -> list[Json]:
        topic = f"/@/probe_{connection.name}"
        publish: Json = {"op": "publish", "id": "probe", "topic": topic, "msg": {"data": f"probe:{mark}"}}
        if connection.probes > 1:
            return [publish]
        kind: dict[str, Json] = {"id": "probe", "topic": topic, "type": "std_msgs/String"}
        return [{"op": "advertise", **kind}, {"op": "subscribe", **kind}, publish]

    async def _sort(self, connection: Connection, raw: Raw) -> None:
        """Sort a frame: responses to probes, status messages, and others."""
        value = None if isinstance(raw, bytes) else decode_text(raw)
        if isinstance(value, dict):
            mark = self._probe_mark(value)
            if mark is not None:
                connection.answers.add(mark)
                return
            if value.get("op") == "status":
                if not str(value.get("id", "")).startswith("probe"):
                    connection.statuses.append(raw)
                return
        connection.frames.append(raw)

    def _probe_mark(self, value: dict[str, Value]) -> str | None:
        if str(value.get("id", "")).startswith("probe:"):
            return str(value["id"]).removeprefix("probe:")
        if not str(value.get("topic", "")).startswith(f"/{self._tag}/probe_"):
            return None
        message = value.get("msg")
        return str(message.get("data", "")).removeprefix("probe:") if isinstance(message, dict) else ""
