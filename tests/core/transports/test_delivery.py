"""Reports of the system about unsent bytes."""

from __future__ import annotations

import socket
import sys
import time

import pytest

from rwt_transports.api import Delivery
from rwt_transports.drivers.sockets import delivery_of


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells")
def test_bytes_that_a_peer_does_not_read_stay_unacknowledged() -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as listener,
        socket.create_connection(listener.getsockname()) as reader,
        listener.accept()[0] as writer,
    ):
        assert delivery_of(writer).unacknowledged == 0
        writer.setblocking(False)
        sent = 0
        for _ in range(1000):
            try:
                sent += writer.send(bytes(1 << 16))
            except BlockingIOError:
                break
        delivery = delivery_of(writer)
        assert 0 < delivery.unsent <= delivery.unacknowledged <= sent
        while sent:
            sent -= len(reader.recv(min(sent, 1 << 20)))
        until = time.monotonic() + 20
        while delivery_of(writer).unacknowledged and time.monotonic() < until:
            time.sleep(0.01)
        assert delivery_of(writer).unsent == delivery_of(writer).unacknowledged == 0


def test_other_sockets_tell_nothing() -> None:
    one, other = socket.socketpair()
    one.send(b"1")
    assert delivery_of(one).unsent == 0
    one.close()
    other.close()
    assert delivery_of(one) == Delivery()
