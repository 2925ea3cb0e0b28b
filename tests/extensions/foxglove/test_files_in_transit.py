"""Memory of files that many clients request: bounded, and no network keeps it from another."""

from __future__ import annotations

import random

import anyio
import anyio.lowlevel
import pytest

from rwt.extensions.foxglove import files_in_transit
from rwt.extensions.foxglove.files_in_transit import (
    CAPACITY_BYTES,
    OVERDUE_SECONDS,
    FileInTransit,
    FilesInTransit,
)

pytestmark = pytest.mark.anyio

GREEDY, OTHER = "192.0.2.7", "192.0.2.8"


class Clients:
    """Clients that request files on a clock that the test moves.

    Attributes:
        cut: files whose clients were disconnected.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(files_in_transit, "LOOK_SECONDS", 0.001)
        self.now = 0.0
        self.files = FilesInTransit(lambda: self.now)
        self.cut: list[FileInTransit] = []

    def file(self, address: str) -> FileInTransit:
        file = FileInTransit(address, lambda reason: self.cut.append(file))
        return file

    async def enter(self, address: str) -> FileInTransit:
        file = self.file(address)
        await self.files.enter(file)
        return file


@pytest.fixture
def clients(monkeypatch: pytest.MonkeyPatch) -> Clients:
    return Clients(monkeypatch)


async def test_who_reads_nothing_gives_room_to_another_network(clients: Clients) -> None:
    first, second = await clients.enter(GREEDY), await clients.enter(GREEDY)
    assert clients.files.used == CAPACITY_BYTES
    clients.now += 1
    async with anyio.create_task_group() as tasks:
        more = clients.file(GREEDY)
        tasks.start_soon(clients.files.enter, more)
        await anyio.sleep(0.05)
        assert not clients.cut, "the greedy one does not disconnect itself for more"
        other = await clients.enter(OTHER)
        assert clients.cut == [first]
        for file in (second, other, more):
            clients.files.leave(file)
    clients.files.leave(more)
    assert clients.files.used == 0


async def test_what_is_read_makes_room_for_others(clients: Clients) -> None:
    held = [await clients.enter(f"192.0.2.{number}") for number in range(2)]
    for file in held:
        clients.files.resize(file, 1000)
    third = await clients.enter(OTHER)
    assert not clients.cut
    assert clients.files.used == 2000 + third.size


async def test_a_file_that_is_not_read_for_long_makes_room(clients: Clients) -> None:
    held = [await clients.enter(address) for address in (GREEDY, OTHER)]
    clients.now += OVERDUE_SECONDS
    await clients.enter("192.0.2.9")
    assert clients.cut == held[:1]


@pytest.mark.parametrize("seed", range(20))
async def test_no_sequence_exceeds_the_capacity_or_loses_bytes(clients: Clients, seed: int) -> None:
    chance = random.Random(seed)
    held: list[FileInTransit] = []
    async with anyio.create_task_group() as tasks:
        for _ in range(200):
            clients.now += chance.random()
            if chance.random() < 0.5:
                held.append(clients.file(f"192.0.2.{chance.randrange(5)}"))
                tasks.start_soon(clients.files.enter, held[-1])
            elif held:
                file = chance.choice(held)
                if chance.random() < 0.5:
                    clients.files.resize(file, chance.randrange(file.size + 1))
                else:
                    held.remove(file)
                    clients.files.leave(file)
            await anyio.lowlevel.checkpoint()
            assert 0 <= clients.files.used <= CAPACITY_BYTES
        for file in held:
            clients.files.leave(file)
    assert clients.files.used == 0
