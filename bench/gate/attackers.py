"""Attackers at full rate: `python -m bench.gate.attackers HOST PORT COUNT`, until standard input ends.

Each is a thread with a connection from a loopback address of its own, so that limits per address do not apply
to all of them together. All are in one process, so that they occupy one core. Prints what each has sent.
"""

from __future__ import annotations

import base64
import json
import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from typing import Final

from bench.gate.robot import ATTACKER_TOKEN, LIST, TWIST
from bench.traffic.wire import masked

#: Topics of an attacker with globs; less than the default limit of advertisements.
_TOPICS: Final = 900

#: Numbers in a list that is checked, and in one that is rejected by its size (1.6 MB of JSON).
_CHECKED: Final = 9_900
_OVERSIZED: Final = 400_000

_RETRY_SECONDS: Final = 0.1


def _op(**op: object) -> bytes:
    return masked(json.dumps(op, separators=(",", ":")).encode())


def _publish(topic: str, type: str, **msg: object) -> bytes:
    return _op(op="publish", topic=topic, type=type, msg=msg)


def _call(service: str, **args: object) -> bytes:
    return _op(op="call_service", service=service, args=args)


def _flood(topic: str) -> list[bytes]:
    return [_publish(topic, TWIST, linear={"x": 0.1}) * 500]


def _advertise() -> list[bytes]:
    topics = [f"/x/{os.urandom(3).hex()}" for _ in range(_TOPICS)]
    each = [_op(op=op, topic=name, type=TWIST) for op in ("advertise", "unadvertise") for name in topics]
    return [b"".join(each)]


def _drive_many() -> list[bytes]:
    topics = [f"/x/{os.urandom(3).hex()}" for _ in range(_TOPICS)]
    return [b"".join(_publish(name, TWIST, linear={"x": 0.1}) for name in topics)]


def _lists(topic: str, value: float) -> list[bytes]:
    checked = _publish(topic, LIST, data=[value] * _CHECKED)
    return [checked, _publish(topic, LIST, data=[1.5] * _OVERSIZED), checked]


def _calls_to_approve() -> list[bytes]:
    return [_call("/reset") * 500]


def _messages_to_approve() -> list[bytes]:
    each = (_publish("/asked", "std_msgs/String", data=str(number) * 100) for number in range(500))
    return [b"".join(each)]


def _audit() -> list[bytes]:
    each = (
        _call("/gate/release_stop", reason="x" * 400)
        + _call("/gate/take_lease", topic="/stopped")
        + _call("/gate/stop", reason=str(number))
        for number in range(200)
    )
    return [b"".join(each)]


def _one_message() -> list[bytes]:
    return [_publish("/stopped", TWIST, linear={"x": 0.1})]


#: Frames of each kind of attacker, and True for one that connects again after them.
KINDS: Final[tuple[tuple[str, Callable[[], list[bytes]], bool], ...]] = (
    ("flood of a held topic", partial(_flood, "/stopped"), False),
    ("flood of a leased topic", partial(_flood, "/leased"), False),
    ("advertise under a glob", _advertise, False),
    ("publish under a glob", _drive_many, False),
    ("large lists, range", partial(_lists, "/range", 0.5), False),
    ("large lists, clamp", partial(_lists, "/clamp", 1.5), False),
    ("calls to approve", _calls_to_approve, False),
    ("messages to approve", _messages_to_approve, False),
    ("rejected requests for the audit", _audit, False),
    ("a connection per message", _one_message, True),
)


class Attacker(threading.Thread):
    """One attacker.

    Attributes:
        sent_bytes: bytes that the kernel took so far.
        connections: number of connections so far.
    """

    def __init__(self, number: int, host: str, port: int) -> None:
        super().__init__(daemon=True)
        self.kind, make, self._reconnects = KINDS[number % len(KINDS)]
        self._frames = make()
        self._source = f"127.0.0.{2 + number}"
        self._address = host, port
        self.sent_bytes = 0
        self.connections = 0

    def run(self) -> None:
        """Attack until the process ends; a server that closes the connection gets another one."""
        while True:
            try:
                with self._connect() as wire:
                    for _ in self._rounds():
                        for frames in self._frames:
                            wire.sendall(frames)
                            self.sent_bytes += len(frames)
            except OSError:
                time.sleep(_RETRY_SECONDS)

    def _rounds(self) -> Iterator[int]:
        return iter(range(1)) if self._reconnects else count()

    def _connect(self) -> socket.socket:
        wire = socket.create_connection(self._address, source_address=(self._source, 0))
        key = base64.b64encode(os.urandom(16)).decode()
        wire.sendall(
            f"GET /?token={ATTACKER_TOKEN} HTTP/1.1\r\nHost: {self._address[0]}:{self._address[1]}\r\n"
            f"Upgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        if not wire.recv(4096).startswith(b"HTTP/1.1 101"):
            wire.close()
            raise ConnectionRefusedError("the server refused the handshake")
        self.connections += 1
        threading.Thread(target=self._drain, args=(wire,), daemon=True).start()
        return wire

    @staticmethod
    def _drain(wire: socket.socket) -> None:
        """Read all answers: a client that does not read would be closed."""
        try:
            while wire.recv(1 << 16):
                pass
        except OSError:
            return


def main(host: str, port: int, number: int) -> None:
    """Attack until standard input ends."""
    attackers = [Attacker(each, host, port) for each in range(number)]
    for attacker in attackers:
        attacker.start()
    began = time.monotonic()
    print("attacking", flush=True)
    sys.stdin.read()
    seconds = time.monotonic() - began
    for attacker in attackers:
        rate, connections = attacker.sent_bytes / 1e6 / seconds, attacker.connections
        print(f"{attacker.kind:34} {rate:8.2f} MB/s {connections:6} connections", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
