"""Transports of the client, and a virtual clock on trio for tests without a socket."""

from __future__ import annotations

import pytest
import trio.testing


@pytest.fixture(params=["memory", "ws", "tcp"])
def transport(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def virtual_time() -> tuple[str, dict[str, object]]:
    """A backend on which time goes by only when everybody waits: use it as `anyio_backend`."""
    return "trio", {"clock": trio.testing.MockClock(autojump_threshold=0)}
