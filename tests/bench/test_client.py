"""The client benchmark's table, and its other side."""

from __future__ import annotations

import socket
import threading

import cbor2
import pytest

from bench.client.peer import CASES, MESSAGES, Frames
from rwt_protocol.frames import Frame
from rwt_transports.websocket.wire import CLIENT_FRAMING


@pytest.mark.parametrize("case", CASES)
def test_both_encodings_hold_the_message(case: str) -> None:
    assert b'"topic":"/bench"' in MESSAGES[case, False]
    frame = MESSAGES[case, True]
    found = cbor2.loads(frame[frame.index(b"\xa3\x62op") :])
    assert (found["op"], found["topic"]) == ("publish", "/bench")


def test_frames_are_read_and_passed_over() -> None:
    sizes = [0, 5, 125, 126, 1000, 65_535, 65_536, 3]
    near, far = socket.socketpair()
    data = b"".join(CLIENT_FRAMING.whole(Frame(b"x" * size)) for size in sizes)
    data += CLIENT_FRAMING.whole(Frame(b"the end"))
    sender = threading.Thread(target=near.sendall, args=(data,))
    with near, far:
        sender.start()
        frames = Frames(far)
        assert frames.next() == b""
        assert frames.next() == b"xxxxx"
        frames.skip(len(sizes) - 2)
        assert frames.next() == b"the end"
        sender.join()
