"""Apps of others on our port: real frameworks, and apps that misbehave."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import anyio
import httpx
import pytest
from fastapi import FastAPI, Request, WebSocket
from fastapi.responses import PlainTextResponse, StreamingResponse
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from rwt import Server, SettingsError
from rwt.extensions.asgi.mount import AsgiMount
from rwt.extensions.asgi.types import Receive, Scope, Send
from rwt_transports.http.connection import close_iterator
from rwt_transports.http.routes import HttpRequest
from tests.extensions.conftest import client_of
from tests.waiting import until

pytestmark = pytest.mark.anyio

LIVED: list[str] = []


@asynccontextmanager
async def lifespan(app: FastAPI) -> AsyncIterator[dict[str, str]]:
    LIVED.append("began")
    yield {"name": "the shop"}
    LIVED.append("ended")


shop = FastAPI(lifespan=lifespan)


@shop.get("/")
def front(request: Request) -> dict[str, str]:
    return {"name": request.state.name, "link": str(request.url_for("order"))}


@shop.post("/order")
async def order(request: Request) -> PlainTextResponse:
    response = PlainTextResponse((await request.body())[::-1], status_code=201, headers={"X-Shop": "yes"})
    response.set_cookie("a", "1")
    response.set_cookie("b", "2")
    return response


@shop.get("/count")
async def count() -> StreamingResponse:
    async def numbers() -> AsyncIterator[str]:
        for number in range(3):
            yield f"{number}\n"

    return StreamingResponse(numbers(), media_type="text/plain")


@shop.get("/for-ever")
async def for_ever() -> StreamingResponse:
    async def numbers() -> AsyncIterator[str]:
        try:
            while True:
                yield "x" * 1000
                await anyio.lowlevel.checkpoint()
        finally:
            LIVED.append("left")

    return StreamingResponse(numbers(), media_type="text/plain")


@shop.get("/broken")
async def broken() -> None:
    raise RuntimeError("on purpose")


@shop.websocket("/echo")
async def echo(socket: WebSocket) -> None:
    await socket.accept()
    while True:
        text = await socket.receive_text()
        if text == "flood":
            for _ in range(2000):
                await socket.send_bytes(b"x" * 10_000)
        elif text == "bye":
            await socket.close(4321, "as you say")
            return
        else:
            await socket.send_text(text.upper())


@pytest.fixture
async def server() -> AsyncIterator[Server]:
    LIVED.clear()
    async with Server("ws://127.0.0.1:0", web={"enabled": False}, mounts={"/shop": shop}) as server:
        assert LIVED == ["began"]
        yield server
    assert LIVED[-1] == "ended"


async def test_an_app_answers_below_its_path(client: httpx.AsyncClient) -> None:
    answer = await client.get("/shop/")
    assert answer.json() == {"name": "the shop", "link": f"{str(client.base_url).rstrip('/')}/shop/order"}
    made = await client.post("/shop/order", content=b"abc")
    assert (made.status_code, made.text, made.headers["x-shop"]) == (201, "cba", "yes")
    assert sorted(each.partition(";")[0] for each in made.headers.get_list("set-cookie")) == ["a=1", "b=2"]
    assert (await client.get("/shop/count")).text == "0\n1\n2\n"
    assert (await client.get("/shop/none")).status_code == 404
    head = await client.head("/shop/openapi.json")
    assert (head.status_code, head.content) == (200, b"")
    assert (await client.get("/shops")).status_code == 404
    assert (await client.get("/healthz")).json()["status"] == "ok"


async def test_a_failure_of_the_app_is_its_own(
    client: httpx.AsyncClient, caplog: pytest.LogCaptureFixture
) -> None:
    assert (await client.get("/shop/broken")).status_code == 500
    assert "on purpose" in caplog.text
    assert (await client.get("/shop/")).status_code == 200


async def test_a_stream_without_end_ends_with_its_reader(client: httpx.AsyncClient) -> None:
    async with client.stream("GET", "/shop/for-ever") as answer:
        async for _ in answer.aiter_bytes():
            break
    await until(lambda: "left" in LIVED)


async def test_a_stream_that_nobody_reads_ends() -> None:
    ended = anyio.Event()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            raise RuntimeError("no lifespan")
        await send({"type": "http.response.start", "status": 200})
        try:
            while True:
                await send({"type": "http.response.body", "body": b"x", "more_body": True})
        finally:
            ended.set()

    mount = AsgiMount("/app", app)
    async with mount.running():
        response = await mount.handle(HttpRequest("GET", "/app"))
        assert not isinstance(response.body, bytes)
        await close_iterator(response.body)
        with anyio.fail_after(5):
            await ended.wait()


async def test_a_websocket_of_the_app(server: Server) -> None:
    async with connect(f"{server.urls[0]}/shop/echo") as socket:
        await socket.send("hello")
        assert await socket.recv() == "HELLO"
        await socket.send("flood")
        got = [await socket.recv() for _ in range(2000)]
        assert {len(each) for each in got} == {10_000}
        await socket.send("bye")
        with pytest.raises(ConnectionClosed) as closed:
            await socket.recv()
        assert closed.value.rcvd is not None
        assert (closed.value.rcvd.code, closed.value.rcvd.reason) == (4321, "as you say")
    async with connect(server.urls[0]) as robot:
        await robot.send('{"op": "call_service", "service": "/rosapi/get_time"}')
        assert "result" in str(await robot.recv())


async def test_an_app_without_a_lifespan_or_that_cannot_start(caplog: pytest.LogCaptureFixture) -> None:
    async def plain(scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] != "http":
            raise RuntimeError("only http")
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": scope["root_path"].encode()})

    async def unable(scope: Any, receive: Any, send: Any) -> None:
        await receive()
        await send({"type": "lifespan.startup.failed", "message": "no database"})

    server = Server("ws://127.0.0.1:0", web={"enabled": False}, mounts={"/plain": plain})
    async with server, client_of(server) as client:
        assert (await client.get("/plain/x")).text == "/plain"
    with pytest.raises(RuntimeError, match="/unable could not start: no database"):
        async with Server("ws://127.0.0.1:0", mounts={"/unable": unable}):
            pass


@pytest.mark.parametrize("path", ["shop", "/shop/", "/", "/a*"])
async def test_a_path_that_is_none_is_refused(path: str) -> None:
    with pytest.raises(SettingsError, match="mounts"):
        Server("ws://127.0.0.1:0", mounts={path: shop})


async def test_a_path_of_the_servers_own_is_refused() -> None:
    with pytest.raises(SettingsError, match="'/api' is taken"):
        async with Server("ws://127.0.0.1:0", web={"enabled": False}, mounts={"/api": shop}):
            pass
