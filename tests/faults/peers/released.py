"""Memory that ended peers leave behind: `python -m tests.faults.peers.released KIND COUNT`.

Python's collector of cyclic garbage is off, as it nearly is in a server that freezes what it has seen. Prints
objects, MiB and descriptors, and tasks, that were left by COUNT peers, as JSON.
"""

from __future__ import annotations

import asyncio
import ctypes
import gc
import json
import os
import sys
from collections.abc import Awaitable, Callable
from functools import partial

from rwt_transports.http.addresses import AddressCount
from rwt_transports.limits import Limits
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_webrtc.packets.ice_guard import Reach
from rwt_webrtc.transport.peer import RELEASE_SECONDS, Peer, PeerTerms
from rwt_webrtc.transport.sdp import read_description
from rwt_webrtc.transport.signalling import PeerBounds
from tests.faults.peers.attacks import memory, refuse
from tests.waiting import until
from tests.webrtc.peers import Side, answering, text_of

WARM = 20
AT_ONCE = 8
TERMS = PeerTerms(Limits(), ReceiveBufferPool(), AddressCount())


def _client() -> Peer:
    client = Peer(TERMS, (), refuse, "127.0.0.1", reach=Reach.LOOPBACK, on_closed=lambda peer: None)
    client.connection.createDataChannel("rosbridge")
    return client


async def connected(side: Side) -> None:
    """A peer that connects, opens a channel and leaves."""
    client = _client()
    answer = await side.ask("POST", "/webrtc", (await client.describe()).encode())
    await client.take_description(read_description(text_of(answer).encode()), "answer")
    sctp = client.connection.sctp
    await until(lambda: sctp is not None and sctp.state == "connected")
    await client.close(1000, "done")
    await until(lambda: len(side.peers) < AT_ONCE)


async def unanswered(side: Side, offer: bytes) -> None:
    """A peer that never takes the answer, and ends."""
    answer = await side.ask("POST", "/webrtc", offer)
    await side.ask("DELETE", answer.headers["Location"])


async def rejected(side: Side, offer: bytes) -> None:
    """A peer whose description aiortc rejects after it was created."""
    answer = await side.ask("POST", "/webrtc", offer.replace(b"a=mid:0", b"a=mid:1"))
    assert answer.status in (201, 400), text_of(answer)
    if answer.status == 201:
        await side.ask("DELETE", answer.headers["Location"])


async def main(kind: str, count: int) -> None:
    """Let peers come and go, and print what is left."""
    async with answering(bounds=PeerBounds(1000, 1000)) as side:
        client = _client()
        offer = (await client.describe()).encode()
        await client.close()
        act: Callable[[], Awaitable[None]] = {
            "connected": partial(connected, side),
            "unanswered": partial(unanswered, side, offer),
            "rejected": partial(rejected, side, offer),
        }[kind]
        for _ in range(WARM):
            await act()
        await _settle(side)
        gc.collect()
        gc.disable()
        before = _state()
        for _ in range(count):
            await act()
        await _settle(side)
        ctypes.CDLL("libc.so.6").malloc_trim(0)  # Free memory that glibc keeps between objects.
        after = _state()
    left = {name: after[name] - before[name] for name in after}
    sys.stdout.write(f"{json.dumps(left)}\n")


async def _settle(side: Side) -> None:
    await until(lambda: not len(side.peers))
    await asyncio.sleep(2 * RELEASE_SECONDS)
    side.ends.clear()


def _state() -> dict[str, float]:
    return {
        "objects": len(gc.get_objects()),
        "mib": memory(),
        "files": len(os.listdir("/proc/self/fd")),
        "tasks": len(asyncio.all_tasks()),
    }


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2])))
