"""Clients that come in by several listeners of a server at once: they share what there is for all."""

from __future__ import annotations

import ssl
import tracemalloc
from contextlib import AsyncExitStack, suppress
from pathlib import Path

import anyio
import pytest
from anyio.abc import ByteStream

from rwt import Server, Settings
from rwt.settings.models import LimitSettings
from rwt_client.connection import connect
from tests.core.transports.rfc6455.frames import TEXT, frame
from tests.core.transports.rfc6455.handshake import REQUEST
from tests.faults.conftest import MIB

PATIENCE = 60.0


async def _begun(url: str, message: bytes) -> ByteStream:
    """A connection over which all of a message has been sent but its last byte."""
    scheme, _, place = url.partition("://")
    stream = await anyio.connect_tcp("127.0.0.1", int(place.rpartition(":")[2]))
    if scheme == "ws":
        await stream.send(REQUEST)
        head = b""
        while b"\r\n\r\n" not in head:
            head += await stream.receive()
        message = frame(TEXT, message, key=bytes(4))
    await stream.send(message[:-1])
    return stream


@pytest.mark.anyio
async def test_all_listeners_share_the_bytes_of_messages_that_have_no_end() -> None:
    settings = Settings(max_message_size=600_000, limits=LimitSettings(incoming_bytes=1_200_000))
    message = b'{"op":"' + b"x" * 550_000 + b'"}'
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(
            Server("tcp://127.0.0.1:0", "ws://127.0.0.1:0", settings=settings)
        )
        over_tcp, websocket = server.urls
        streams = [
            await stack.enter_async_context(await _begun(url, message))
            for url in (over_tcp, websocket, websocket)
        ]
        with anyio.fail_after(PATIENCE):
            async with anyio.create_task_group() as tasks:

                async def read_on(stream: ByteStream) -> None:
                    with suppress(anyio.EndOfStream, anyio.BrokenResourceError):
                        while True:
                            await stream.receive()
                    tasks.cancel_scope.cancel()  # One of them has to give way.

                for each in streams:
                    tasks.start_soon(read_on, each)


@pytest.mark.anyio
async def test_a_connection_in_tls_takes_little_memory(tmp_path: Path) -> None:
    settings = Settings.model_validate({"tls": {"auto": True, "folder": tmp_path}})
    trust = ssl.create_default_context()
    trust.check_hostname, trust.verify_mode = False, ssl.CERT_NONE
    count = 12
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(Server("wss://127.0.0.1:0", settings=settings))

        async def come() -> None:
            robot = await stack.enter_async_context(connect(server.urls[0], tls=trust))
            await robot.wait_connected()

        await come()  # with which libraries and classes are loaded
        tracemalloc.start()
        try:
            for _ in range(count):
                await come()
            taken, _ = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
    assert taken / count < 0.25 * MIB, f"{taken / count / MIB:.2f} MiB for both ends of each"
