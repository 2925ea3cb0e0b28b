"""A program on `asyncio.run` or `uvloop.run`: in callbacks of the loop nothing tells which loop it is."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
import uvloop

from rwt import Server
from rwt_client import connect
from rwt_transports.http.routes import Audience, HttpExtension, HttpRequest, HttpResponse, Reader, Route


async def _page(request: HttpRequest, reader: Reader) -> HttpResponse:
    await asyncio.sleep(0)
    return HttpResponse(b"a page")


_PAGES = HttpExtension((Route("/page", _page, Audience.ADMITTED),))


async def _beep(request: Any) -> dict[str, object]:
    await asyncio.sleep(0)
    return {"success": True, "message": "beep"}


async def _count(goal: Any) -> dict[str, object]:
    await asyncio.sleep(0)
    return {"sequence": list(range(goal.request.order))}


async def _all() -> list[object]:
    async with Server("ws://127.0.0.1:0", http=[_PAGES]) as server:
        robot = server.node("robot")
        robot.advertise_service("/beep", "std_srvs/Trigger", _beep)
        async with connect(server.urls[0]) as client:
            await client.advertise_service("/boop", "std_srvs/Trigger", _beep)
            await client.advertise_action("/count", "example_interfaces/Fibonacci", _count)
            own: Any = await client.call("/beep")
            offered: Any = await robot.call("/boop", {})
            goal = await robot.send_goal("/count", {"order": 3})
            _, result = await goal.result()
        reader, writer = await asyncio.open_connection("127.0.0.1", int(server.urls[0].rpartition(":")[2]))
        writer.write(b"GET /page HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
        answer = await reader.read()
        writer.close()
    sequence: Any = result
    return [own.message, offered.message, list(sequence.sequence), answer.rpartition(b"\n")[2]]


@pytest.mark.parametrize("run", [asyncio.run, uvloop.run])
def test_coroutine_handlers_and_pages_run(run: Callable[[Coroutine[Any, Any, list[object]]], object]) -> None:
    assert run(_all()) == ["beep", "beep", [0, 1, 2], b"a page"]
