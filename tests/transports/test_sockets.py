from __future__ import annotations

import select
import socket
import struct

import pytest

from rwt_transports.api import HangUp
from rwt_transports.drivers.sockets import bind_tcp, hang_up_of

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


@pytest.mark.skipif(not hasattr(select, "POLLRDHUP"), reason="the system does not tell")
async def test_a_hang_up_is_seen_whatever_is_still_to_be_read() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        ours = socket.create_connection(listener.getsockname())
        theirs, _ = listener.accept()
    with ours, theirs:
        theirs.sendall(b"not read")
        assert hang_up_of(ours.fileno()) is HangUp.NO
        theirs.shutdown(socket.SHUT_WR)
        assert hang_up_of(ours.fileno()) is HangUp.SENDS_NO_MORE
        ours.sendall(b"not read either")
        theirs.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        theirs.close()  # With a reset, as when its process is killed and it is sent something.
        assert hang_up_of(ours.fileno()) is HangUp.GONE
