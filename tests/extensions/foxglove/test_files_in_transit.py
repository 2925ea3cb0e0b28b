"""Memory of files that many clients request: bounded, and no client keeps it from another."""

from __future__ import annotations

import random
from functools import partial

import anyio
import anyio.lowlevel
import pytest

from rwt.extensions.foxglove.files_in_transit import (
    CAPACITY_BYTES,
    GRACE_SECONDS,
    LOOK_SECONDS,
    MAX_BYTES,
    OVERDUE_SECONDS,
    FilesInTransit,
)
from rwt_graph import SimulatedClock
from rwt_transports.shared_pool import Holder, Share

pytestmark = pytest.mark.anyio

GREEDY, OTHER, THIRD = Holder("192.0.2.7"), Holder("192.0.2.8"), Holder("192.0.2.9")


class Clients:
    """Clients that request files.

    Attributes:
        rooms: room of each file that was let in.
        cut: files whose clients were disconnected, in order.
        unread: files that their clients have not read.
    """

    def __init__(self) -> None:
        self.clock = SimulatedClock()
        self.files = FilesInTransit(self.clock.sleep)
        self.rooms: dict[int, Share] = {}
        self.cut: list[int] = []
        self.unread: set[int] = set()
        self._count = 0

    async def fetch(self, holder: Holder) -> None:
        """Request a file, and read it once the test says so."""
        self._count += 1
        number = self._count
        self.unread.add(number)
        share = await self.files.enter(holder, partial(self._cut, number), lambda: number in self.unread)
        if share is None:
            return
        self.rooms[number] = share
        await self.files.read(lambda: number in self.unread, partial(self._cut, number))
        self.files.pool.release(share)

    def _cut(self, number: int, reason: str) -> None:
        self.cut.append(number)
        self.unread.discard(number)

    async def passes(self, seconds: float) -> None:
        for _ in range(round(seconds / LOOK_SECONDS)):
            self.clock.advance(LOOK_SECONDS)
            await anyio.lowlevel.checkpoint()
            await anyio.lowlevel.checkpoint()


async def test_who_reads_nothing_gives_room_to_another_client() -> None:
    clients = Clients()
    async with anyio.create_task_group() as tasks:
        for holder in (GREEDY, GREEDY, GREEDY):
            tasks.start_soon(clients.fetch, holder)
        await clients.passes(2 * GRACE_SECONDS)
        assert clients.files.pool.used == CAPACITY_BYTES
        assert not clients.cut, "the greedy one does not disconnect itself for more"
        tasks.start_soon(clients.fetch, OTHER)
        await clients.passes(GRACE_SECONDS / 2)
        assert not clients.cut, "a client has a moment to read"
        await clients.passes(GRACE_SECONDS)
        assert clients.cut == [1]
        assert set(clients.rooms) == {1, 2, 4}
        clients.unread.clear()
        await clients.passes(1.0)
    assert clients.files.pool.used == 0 == clients.files.waiting


async def test_what_is_read_makes_room_for_others_at_once() -> None:
    clients = Clients()
    async with anyio.create_task_group() as tasks:
        for holder in (GREEDY, OTHER):
            tasks.start_soon(clients.fetch, holder)
        await clients.passes(LOOK_SECONDS)
        for share in clients.rooms.values():
            clients.files.pool.resize(share, 1000)
        tasks.start_soon(clients.fetch, THIRD)
        await clients.passes(LOOK_SECONDS)
        assert set(clients.rooms) == {1, 2, 3} and not clients.cut
        assert clients.files.pool.used == 2000 + MAX_BYTES
        clients.unread.clear()
        await clients.passes(1.0)


async def test_a_file_that_is_not_read_for_long_makes_room() -> None:
    clients = Clients()
    async with anyio.create_task_group() as tasks:
        for holder in (GREEDY, OTHER):
            tasks.start_soon(clients.fetch, holder)
        await clients.passes(2 * OVERDUE_SECONDS)
        assert not clients.cut, "nobody waits"
        tasks.start_soon(clients.fetch, THIRD)
        await clients.passes(GRACE_SECONDS)
        assert clients.cut and 3 in clients.rooms
        clients.unread.clear()
        await clients.passes(1.0)


@pytest.mark.parametrize("seed", range(10))
async def test_no_sequence_exceeds_the_capacity_or_loses_bytes(seed: int) -> None:
    chance, clients = random.Random(seed), Clients()
    async with anyio.create_task_group() as tasks:
        for _ in range(100):
            if chance.random() < 0.6:
                tasks.start_soon(clients.fetch, Holder(f"192.0.2.{chance.randrange(5)}"))
            elif clients.unread:
                clients.unread.discard(chance.choice(sorted(clients.unread)))
            if clients.rooms and chance.random() < 0.5:
                share = clients.rooms[chance.choice(sorted(clients.rooms))]
                clients.files.pool.resize(share, chance.randrange(MAX_BYTES + 1))
            await clients.passes(chance.choice((LOOK_SECONDS, 0.5, 2.0)))
            assert 0 <= clients.files.pool.used <= CAPACITY_BYTES
        clients.unread.clear()
        await clients.passes(1.0)
    assert clients.files.pool.used == 0 == clients.files.waiting
