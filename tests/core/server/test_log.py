"""A program that embeds the server has a log with the bounds of `rwt serve`."""

from __future__ import annotations

import json
import logging
import time

import anyio
import pytest
from websockets.asyncio.client import connect

from rwt import Server
from rwt.access.audit import LogRate, PlainText

pytestmark = pytest.mark.anyio

FLOOD = 5_000
BURST = 100
"""Lines of one place at once."""
PER_SECOND = 5


def _fail(message: object) -> None:
    raise RuntimeError("a callback of the robot's program that fails")


async def test_callbacks_that_fail_as_fast_as_a_client_publishes(caplog: pytest.LogCaptureFixture) -> None:
    began = time.monotonic()
    async with Server("ws://127.0.0.1:0") as server:
        robot = server.node("robot")
        robot.subscribe("/t", _fail, type="std_msgs/String")
        robot.advertise_service("/s", "std_srvs/Trigger", _fail)
        async with connect(server.urls[0]) as wire:
            for number in range(FLOOD):
                await wire.send(
                    json.dumps({"op": "publish", "topic": "/t", "type": "std_msgs/String", "msg": {}})
                )
                if number % 10 == 0:
                    await wire.send(json.dumps({"op": "call_service", "service": "/s", "id": str(number)}))
            answers = [json.loads(await wire.recv()) for _ in range(FLOOD // 10)]
    assert not any(answer["result"] for answer in answers)
    of_place: dict[tuple[str, int], int] = {}
    for record in caplog.records:
        if record.name.startswith("rwt"):
            place = record.pathname, record.lineno
            of_place[place] = of_place.get(place, 0) + 1
    most = BURST + 1 + PER_SECOND * (time.monotonic() - began)
    assert max(of_place.values()) >= BURST
    assert max(of_place.values()) <= most, of_place
    assert sum(len(record.getMessage()) for record in caplog.records) < 1_000_000


async def test_the_log_is_the_programs_own_again_when_the_server_has_ended() -> None:
    bridge, own = logging.getLogger("rwt.bridge"), logging.getLogger("my_robot")
    before = list(bridge.filters)
    async with Server("ws://127.0.0.1:0"):
        assert any(isinstance(each, LogRate) for each in bridge.filters)
        assert not any(isinstance(each, LogRate) for each in own.filters)
        await anyio.lowlevel.checkpoint()
    assert bridge.filters == before


async def test_a_module_that_is_imported_while_the_server_runs_logs_with_limits() -> None:
    async with Server("ws://127.0.0.1:0"):
        late, own = logging.getLogger("rwt.imported_late"), logging.getLogger("my_robot.imported_late")
        assert [type(each) for each in late.filters] == [LogRate, PlainText]
        assert own.filters == []
        await anyio.lowlevel.checkpoint()
    assert late.filters == []
