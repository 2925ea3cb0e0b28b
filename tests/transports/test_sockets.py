from __future__ import annotations

import socket

import pytest

from rwt_transports.drivers.sockets import bind_tcp

pytestmark = [pytest.mark.anyio, pytest.mark.asyncio_only]


async def test_every_address_of_a_name_gets_the_same_port() -> None:
    sockets = await bind_tcp("localhost", 0)
    try:
        assert len({each.getsockname()[1] for each in sockets}) == 1
        # asyncio switches Nagle's delay off only for sockets that name their protocol.
        assert {each.proto for each in sockets} == {socket.IPPROTO_TCP}
    finally:
        for each in sockets:
            each.close()
