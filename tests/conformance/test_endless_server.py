"""A server that never ends a message, or its fragments: the case fails, and the suite keeps little of it."""

from __future__ import annotations

import asyncio
import itertools
import json

import pytest

from rosbridge_conformance.case_player import CASE_BYTES, CASE_FRAMES, TRANSCRIPT_LINES
from rosbridge_conformance.player import play
from rosbridge_conformance.suite.loading import load_cases
from rosbridge_conformance.suite.target import Target
from rosbridge_conformance.wire.pace import RealPace
from rosbridge_conformance.wire.wires import MESSAGE_BYTES, StreamWire, Wire, WireClosed


class EndlessWire:
    """Wire of a server that sends one fragment after another, without end."""

    def __init__(self, data: str) -> None:
        self._data = data
        self.sent = itertools.count()
        self.received = 0
        self.closed = False

    async def send(self, data: str | bytes) -> None:
        """Drop a message."""

    async def receive(self) -> str | bytes:
        """Return the next fragment."""
        if self.closed:
            raise WireClosed(1006)
        number = next(self.sent)
        self.received += len(self._data)
        if number % 100 == 0:
            await asyncio.sleep(0)
        fragment = {"op": "fragment", "id": "x", "num": number, "total": 10**9, "data": self._data}
        return json.dumps(fragment)

    async def close(self, *, abruptly: bool = False) -> None:
        """End."""
        self.closed = True


@pytest.mark.parametrize("size", [1, 100_000])
def test_fragments_without_end_fail_the_case(size: int) -> None:
    case = next(case for case in load_cases() if case.id.endswith("png-in-fragments"))
    wires: list[EndlessWire] = []

    async def dial(tag: str) -> Wire:
        wires.append(EndlessWire("x" * size))
        return wires[-1]

    played = asyncio.run(play(case, Target(timeout=60.0), dial, RealPace(), "t"))
    assert played.fault is not None
    assert len(played.transcript) <= TRANSCRIPT_LINES
    for wire in wires:
        assert wire.closed
        assert next(wire.sent) <= CASE_FRAMES + 2 and wire.received <= CASE_BYTES + 2 * size


def test_an_object_without_end_closes_the_connection() -> None:
    async def serve(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b'{"a": "')
        try:
            while True:
                writer.write(b"x" * 65536)
                await writer.drain()
        except OSError:
            writer.close()

    async def run() -> None:
        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        wire = await StreamWire.open("tcp://", lambda: asyncio.open_connection("127.0.0.1", port))
        with pytest.raises(WireClosed):
            async with asyncio.timeout(60):
                await wire.receive()
        server.close()

    assert MESSAGE_BYTES < 2**25
    asyncio.run(run())
