"""Two hosts on one machine with a bad line between them: network namespaces, and this process as the line.

Packets are delayed and lost here and not by the kernel's netem, which not every kernel has. Needs Linux, root
and `/dev/net/tun`.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import random
import selectors
import struct
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Final

ADDRESSES: Final = ("10.78.0.1", "10.78.0.2")

_TUNSETIFF: Final = 0x400454CA
_IFF_TUN, _IFF_NO_PI = 0x0001, 0x1000
_CLONE_NEWNET: Final = 0x40000000
_LARGEST: Final = 65_535


@dataclass(frozen=True, slots=True)
class Line:
    """Properties of a line, in each direction.

    Attributes:
        loss: part of the packets that do not arrive.
        delay: seconds that one takes.
        jitter: seconds by which that differs, at most and evenly; packets may overtake each other.
        bits: a second that it carries; 0 for any number. More wait for up to :attr:`queue` seconds.
        queue: see above; what would wait longer is lost.
    """

    loss: float = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    bits: float = 0.0
    queue: float = 0.2


class LossyLink:
    """Carries packets between two hosts, in a thread of its own.

    Args:
        names: of the namespaces of the two hosts.
        line: what it does to packets; may be changed while it runs.
        seed: of what is lost and delayed.

    Attributes:
        line: as given.
        offered_bytes: bytes that each host has sent, lost ones included.
    """

    def __init__(self, names: tuple[str, str], line: Line, seed: int = 1) -> None:
        self.line = line
        self.offered_bytes = [0, 0]
        self._random = random.Random(seed)
        self._tuns = [_open_tun(name, address) for name, address in zip(names, ADDRESSES, strict=True)]
        self._free_at = [0.0, 0.0]
        self._flying: list[tuple[float, int, int, bytes]] = []
        self._count = 0
        self._over = False
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        with selectors.DefaultSelector() as selector:
            for end, tun in enumerate(self._tuns):
                selector.register(tun, selectors.EVENT_READ, end)
            while not self._over:
                due = self._flying[0][0] - time.monotonic() if self._flying else 0.1
                for key, _ in selector.select(max(0.0, min(due, 0.1))):
                    self._send(key.data, os.read(key.fd, _LARGEST))
                while self._flying and self._flying[0][0] <= time.monotonic():
                    _, _, end, packet = heappop(self._flying)
                    os.write(self._tuns[end], packet)

    def _send(self, end: int, packet: bytes) -> None:
        line, now = self.line, time.monotonic()
        self.offered_bytes[end] += len(packet)
        begins = max(now, self._free_at[end])
        if self._random.random() < line.loss or begins - now > line.queue:
            return
        self._free_at[end] = begins + (8 * len(packet) / line.bits if line.bits else 0.0)
        arrives = self._free_at[end] + line.delay + self._random.uniform(-line.jitter, line.jitter)
        self._count += 1
        heappush(self._flying, (arrives, self._count, 1 - end, packet))

    def close(self) -> None:
        """Carry nothing more."""
        self._over = True
        self._thread.join()
        for tun in self._tuns:
            os.close(tun)


def _open_tun(name: str, address: str) -> int:
    """A device in a namespace, whose packets this process reads and writes."""
    found: list[int] = []

    def open_there() -> None:
        # The namespace is that of the thread; a device stays in the one where it was made.
        libc = ctypes.CDLL(None, use_errno=True)
        with open(f"/run/netns/{name}", "rb") as namespace:
            if libc.setns(namespace.fileno(), _CLONE_NEWNET):
                raise OSError(ctypes.get_errno(), f"cannot enter the namespace {name}")
        tun = os.open("/dev/net/tun", os.O_RDWR)
        fcntl.ioctl(tun, _TUNSETIFF, struct.pack("16sH", b"line", _IFF_TUN | _IFF_NO_PI))
        found.append(tun)

    thread = threading.Thread(target=open_there)
    thread.start()
    thread.join()
    _ip("-n", name, "addr", "add", f"{address}/24", "dev", "line")
    _ip("-n", name, "link", "set", "line", "up")
    _ip("-n", name, "link", "set", "lo", "up")
    return found[0]


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True, timeout=20)


@contextmanager
def lossy_link(line: Line, seed: int = 1) -> Iterator[tuple[LossyLink, tuple[str, str]]]:
    """Two hosts and the line between them; gone with the block. Gives the line and the names of the hosts."""
    names = (f"rwt-{os.getpid()}-robot", f"rwt-{os.getpid()}-operator")
    with ExitStack() as stack:
        for name in names:
            _ip("netns", "add", name)
            stack.callback(_ip, "netns", "del", name)
        link = LossyLink(names, line, seed)
        stack.callback(link.close)
        yield link, names
