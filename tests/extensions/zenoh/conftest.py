"""A graph over Zenoh, and a session of another program that it is connected to."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest
import zenoh

from rwt.extensions.zenoh import ZenohGraph
from tests.zenoh_links import QUICK, free_endpoint

# pyzeros compiles its codecs when it first needs them, and keeps them there.
_CODECS = Path(__file__).parents[3] / ".pytest_cache" / "cydr"
os.environ.setdefault("CYDR_CACHE_DIR", str(_CODECS))


@pytest.fixture
def endpoint() -> str:
    return free_endpoint()


@pytest.fixture
def peer(endpoint: str) -> Iterator[zenoh.Session]:
    """A session as any program may open it."""
    config = zenoh.Config()
    config.insert_json5("listen/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("timestamping/enabled", "true")
    with zenoh.open(config) as session:
        yield session


@pytest.fixture
async def graph(endpoint: str, peer: zenoh.Session) -> AsyncIterator[ZenohGraph]:
    async with ZenohGraph(connect=[endpoint], config=QUICK) as made:
        yield made
