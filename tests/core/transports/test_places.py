"""Places of a listener: random clients behind one proxy, with and without credentials."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any, cast
from unittest.mock import Mock

from hypothesis import given
from hypothesis import strategies as st

from rwt_transports.connection import ListenerState, PeerConnection
from rwt_transports.endpoint import PeerInfo
from rwt_transports.http.addresses import holder_of
from rwt_transports.limits import Limits
from rwt_transports.shared_pool import Holder, PoolFull

PROXY = "10.0.0.1"
LIMIT = 4

#: Addresses and credentials; "later" stands for a client that has not authenticated.
CLIENTS = st.tuples(st.sampled_from(("192.0.2.1", "192.0.2.2")), st.sampled_from(("", "token", "later")))


class Visitor:
    """A connection whose client is known from its request on."""

    def __init__(self, state: ListenerState) -> None:
        self._state = state
        self.address = PROXY
        self.holder = holder_of(PROXY)
        self.over = False

    def begin(self) -> None:
        """Wait for the request."""

    def displace(self, reason: str) -> None:
        assert "(limits.connections)" in reason
        self.abort()

    def abort(self) -> None:
        self.over = True
        self._state.detach(cast("PeerConnection", self))


def identify(info: PeerInfo) -> str | None:
    credential = info.headers["credential"]
    return None if credential == "later" else credential


class Guests:
    """A listener, and the connections that it has not ended."""

    def __init__(self) -> None:
        self.state = ListenerState(Mock(), Mock(), Limits(connections=LIMIT), None, "ws", identify=identify)

    def places(self) -> Counter[Holder]:
        return Counter(cast("Any", each).holder for each in self.state.places)

    def come(self, client: str, credential: str) -> Iterator[None]:
        """Connect through the proxy; then ask for a place."""
        visitor: Any = Visitor(self.state)
        before = self.places()
        self.state.add(visitor, Mock())
        lost = before - self.places()
        assert not lost, "a place was taken for a client that is not known"
        yield
        if visitor.over:
            return
        visitor.address = client
        visitor.holder = holder_of(client)
        self.state.count_again(visitor, PROXY)
        if visitor in self.state.places:
            return
        before, asker = self.places(), holder_of(client, credential)
        try:
            self.state.claim(visitor, PeerInfo("ws", client, headers={"credential": credential}))
        except PoolFull:
            assert before[asker] + 1 >= max(before.values())
            visitor.abort()
            return
        lost = before - self.places()
        assert all(before[holder] > before[asker] + 1 for holder in lost)
        assert credential != "later" or not lost


@given(st.lists(st.tuples(CLIENTS, st.booleans()), max_size=40))
def test_a_place_is_taken_only_for_a_known_client_with_less(
    events: list[tuple[tuple[str, str], bool]],
) -> None:
    guests, waiting = Guests(), []
    for (client, credential), asks_at_once in events:
        steps = guests.come(client, credential)
        next(steps)
        waiting.append(steps)
        if asks_at_once:
            for each in waiting:
                next(each, None)
            waiting.clear()
        state = guests.state
        assert len(state.places) <= LIMIT and len(state.pending) <= LIMIT
        assert state.connections == {*state.places, *state.pending}
