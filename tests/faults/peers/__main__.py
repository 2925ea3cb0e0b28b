"""One attack of a peer in a process with limits: `python -m tests.faults.peers NAME [--server URL]`.

Prints the damage as JSON. The process fails if the attacked side no longer serves another peer.
"""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import resource
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import asdict
from io import StringIO
from typing import cast

import httpx

from rwt_transports.http.routes import HttpResponse
from tests.faults.peers import (  # noqa: F401 - the imports register the attacks in ATTACKS
    datagram_attacks,
    hub_attacks,
    sctp_attacks,
    turn_attacks,
)
from tests.faults.peers.attacks import ATTACKS, MIB, Damage, memory
from tests.webrtc.peers import Side, answering, other_side

ADDRESS_SPACE = 3072 * MIB
CPU_SECONDS = 60


@asynccontextmanager
async def watched(damage: Damage) -> AsyncIterator[None]:
    """Record the longest turn of the event loop in CPU time, and the growth of the process."""
    damage.begin()

    async def watch() -> None:
        while True:
            before = time.thread_time()
            await asyncio.sleep(0.001)  # Several turns at most, so that the figure is an upper bound.
            damage.held_ms = max(damage.held_ms, (time.thread_time() - before) * 1000)
            damage.grown_mib = max(damage.grown_mib, memory() - damage.began_mib)

    task = asyncio.create_task(watch())
    try:
        yield
        await asyncio.sleep(0.05)
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        damage.grown_mib = max(damage.grown_mib, memory() - damage.began_mib)


async def run(name: str) -> Damage:
    """Run an attack, and check that another peer is served afterwards."""
    damage = Damage()
    log = StringIO()
    handler = logging.StreamHandler(log)
    logging.getLogger().addHandler(handler)
    logging.getLogger().setLevel(logging.INFO)
    async with answering() as side:
        async with other_side() as friend:
            await friend.connect(side, friend.connection.createDataChannel("warm"))
        async with watched(damage):
            await ATTACKS[name](side, damage)
        gc.collect()  # Tasks whose exception nobody retrieved report it then.
        damage.log_bytes = len(log.getvalue())
        damage.log = log.getvalue()[-2000:]
        async with other_side() as friend:
            await friend.connect(side, friend.connection.createDataChannel("another"))
    return damage


class RemoteSide:
    """Server in another process; has what attacks use of a :class:`Side`."""

    def __init__(self, url: str) -> None:
        self._url = url
        self.ends = range(1000)  # They cannot be counted from here.

    async def ask(
        self, method: str, path: str, body: bytes = b"", content_type: str = "application/sdp"
    ) -> HttpResponse:
        """Send a request, again while there is no room for a peer."""
        headers = {"Content-Type": content_type}
        async with httpx.AsyncClient(timeout=60) as client:
            while True:
                answer = await client.request(method, self._url + path, content=body, headers=headers)
                if answer.status_code != 503:
                    return HttpResponse(answer.content, answer.status_code, headers=answer.headers)
                await asyncio.sleep(0.1)


async def attack_remote(name: str, url: str) -> None:
    """Attack a server in another process."""
    await ATTACKS[name](cast("Side", RemoteSide(url)), Damage())


def main() -> None:
    """Limit the process, then attack."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS))
    if sys.argv[2:3] == ["--server"]:
        asyncio.run(attack_remote(sys.argv[1], sys.argv[3]))
        return
    damage = asyncio.run(run(sys.argv[1]))
    sys.stdout.write(json.dumps(asdict(damage)) + "\n")


if __name__ == "__main__":
    main()
