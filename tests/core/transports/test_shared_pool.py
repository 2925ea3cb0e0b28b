"""The rule of every pool that clients share, against a model of random clients."""

from __future__ import annotations

from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_transports.shared_pool import PoolFull, PoolRow, Share, SharedPool, lasting_room

ROW = PoolRow("places", "limits.places", "places")
NAMES = st.sampled_from("abcd")


class Clients:
    """Clients of one pool, with the shares that each of them still has, oldest first."""

    def __init__(self, capacity: int) -> None:
        self.pool = SharedPool(ROW, capacity)
        self.shares: dict[str, list[Share]] = {name: [] for name in "abcd"}
        self.reasons: list[str] = []

    def held(self, name: str) -> int:
        return sum(share.amount for share in self.shares[name])

    def take(self, name: str, amount: int = 1) -> Share:
        made: list[Share] = []
        share = self.pool.take(name, partial(self._ended, name, made), amount)
        made.append(share)
        self.shares[name].append(share)
        return share

    def _ended(self, name: str, made: list[Share], reason: str) -> None:
        self.shares[name].remove(made[0])
        self.reasons.append(reason)

    def release(self, name: str) -> None:
        if self.shares[name]:
            self.pool.release(self.shares[name].pop())

    def check(self) -> None:
        assert self.pool.used == sum(map(self.held, self.shares))
        assert all(self.pool.held(name) == self.held(name) for name in self.shares)


@given(st.integers(1, 12), st.lists(st.tuples(NAMES, st.booleans())))
def test_nobody_is_refused_while_another_has_more_than_one_more(
    capacity: int, events: list[tuple[str, bool]]
) -> None:
    clients = Clients(capacity)
    for name, takes in events:
        before = {each: clients.held(each) for each in clients.shares}
        if not takes:
            clients.release(name)
        else:
            most = max(before.values())
            try:
                clients.take(name)
            except PoolFull as full:
                assert clients.pool.used == capacity and before[name] + 1 >= most
                assert full.status == 503 and "(limits.places)" in full.reason
                assert before == {each: clients.held(each) for each in clients.shares}
            else:
                lost = [each for each in before if clients.held(each) < before[each]]
                assert all(before[each] == most > before[name] + 1 for each in lost)
        clients.check()
        assert clients.pool.used <= capacity


@given(st.integers(1, 12), st.lists(NAMES, max_size=4, unique=True), st.data())
def test_clients_that_want_everything_get_equal_parts(
    capacity: int, names: list[str], data: st.DataObject
) -> None:
    clients = Clients(capacity)
    refused: set[str] = set()
    while len(refused) < len(names):
        name = data.draw(st.sampled_from(names))
        try:
            clients.take(name)
            refused.clear()
        except PoolFull:
            refused.add(name)
    held = [clients.held(name) for name in names]
    if names:
        assert sum(held) == capacity and max(held) - min(held) <= 1


@given(st.integers(1, 50), st.lists(st.tuples(NAMES, st.integers(0, 30), st.booleans())))
def test_a_share_that_grows_takes_from_the_client_with_most(
    capacity: int, events: list[tuple[str, int, bool]]
) -> None:
    clients = Clients(capacity)
    for name, amount, is_new in events:
        if is_new or not clients.shares[name]:
            clients.take(name, 0)
        growing = clients.shares[name][-1]
        before = {each: clients.held(each) for each in clients.shares}
        before[name] += amount - growing.amount
        clients.pool.resize(growing, amount)
        lost = [each for each in before if clients.held(each) < before[each]]
        # What is left to one that lost a share is at least what it had beyond the others, less that share.
        assert all(before[each] >= max(before.values()) - capacity for each in lost)
        if lost and before[name] < max(before.values()):
            assert before[lost[0]] > before[name] or name in lost
        clients.check()
        assert clients.pool.used <= capacity or len(clients.pool) == 1


@given(st.integers(1, 50), st.lists(st.tuples(NAMES, st.integers(0, 30))))
def test_amounts_are_refused_as_a_whole(capacity: int, events: list[tuple[str, int]]) -> None:
    clients = Clients(capacity)
    for name, amount in events:
        before = {each: list(clients.shares[each]) for each in clients.shares}
        try:
            clients.take(name, amount)
        except PoolFull:
            assert before == clients.shares
        clients.check()
        assert clients.pool.used <= capacity


def test_the_oldest_share_is_taken_and_told_why() -> None:
    clients = Clients(3)
    first, second, third = (clients.take("a") for _ in range(3))
    clients.take("b")
    assert clients.shares["a"] == [second, third]
    assert clients.reasons == ["3 of 3 were this client's, the most of all: places (limits.places)"]
    clients.pool.resize(first, 5)  # No-op.
    clients.pool.release(first)
    clients.check()


def test_a_share_counts_to_another_client() -> None:
    clients = Clients(2)
    moved = clients.take("a")
    clients.take("a")
    clients.pool.move(moved, "b")
    assert (clients.pool.held("a"), clients.pool.held("b")) == (1, 1)
    with pytest.raises(PoolFull):
        clients.take("c")


def test_a_share_that_grows_beyond_what_there_is_keeps_its_amount() -> None:
    clients = Clients(10)
    small, large = clients.take("a", 3), clients.take("b", 6)
    with pytest.raises(PoolFull, match=r"8 are needed, and 6 of 10 are in use, 0 by this client"):
        clients.pool.grow(small, 8)
    clients.pool.grow(small, 5)
    assert (small.amount, clients.shares["b"]) == (5, []) and large.amount == 0


@given(st.integers(0, 10**6), st.integers(1, 20))
def test_what_cannot_be_taken_back_is_never_used_up(capacity: int, clients: int) -> None:
    used = 0
    for _ in range(clients):
        held = 0
        while room := lasting_room(capacity, used, held):
            used, held = used + room, held + room
        assert held <= capacity - used + 1 and used <= capacity
