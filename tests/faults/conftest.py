"""A server on loopback, in a thread of its own, with a service."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest
from anyio.from_thread import BlockingPortal, start_blocking_portal

from rwt import Server, Settings
from rwt.rosbridge.bridge import Bridge
from rwt.settings.models import LimitSettings
from tests.faults.blocking_client import BlockingClient
from tests.waiting import wait_until

MIB = 1 << 20


@dataclass(frozen=True, slots=True)
class Robot:
    """A running server.

    Attributes:
        ports: of the WebSocket listener and of the one for JSON over TCP.
        bridge: belongs to the portal's thread; `clients` asks it there.
    """

    ports: tuple[int, int]
    bridge: Bridge
    portal: BlockingPortal

    def connect(self, *headers: bytes) -> BlockingClient:
        return BlockingClient(self.ports[0], *headers)

    @property
    def clients(self) -> int:
        return self.portal.call(lambda: self.bridge.client_count)

    def wait_for_clients(self, count: int) -> None:
        """Wait until so many are connected."""
        wait_until(lambda: self.clients == count, lambda: f"{self.clients} clients, not {count}")


Start = Callable[[Settings], Robot]

BRIEF = LimitSettings(ping_seconds=0.4, pong_seconds=0.4, handshake_seconds=0.6, close_seconds=0.5)
"""Time-outs that a test can wait for."""


@pytest.fixture
def start() -> Iterator[Start]:
    with start_blocking_portal("asyncio") as portal, contextlib.ExitStack() as running:

        def begin(settings: Settings) -> Robot:
            made = Server("ws://127.0.0.1:0", "tcp://127.0.0.1:0", settings=settings, nodes=("rosapi",))
            server = running.enter_context(portal.wrap_async_context_manager(made))
            web, tcp = (int(url.rpartition(":")[2]) for url in server.urls)
            return Robot((web, tcp), server.bridge, portal)

        yield begin


@pytest.fixture
def robot(start: Start) -> Robot:
    return start(Settings(max_message_size=MIB, limits=BRIEF))
