"""HTTP clients of the servers under test."""

from __future__ import annotations

from collections.abc import AsyncIterator

import httpx
import pytest

from rwt import Server


def client_of(server: Server) -> httpx.AsyncClient:
    """Return a client of a server's first port."""
    base = server.urls[0].replace("ws:", "http:", 1)
    return httpx.AsyncClient(base_url=base, timeout=60, trust_env=False)


@pytest.fixture
async def client(server: Server) -> AsyncIterator[httpx.AsyncClient]:
    """A client of the fixture `server`."""
    async with client_of(server) as client:
        yield client
