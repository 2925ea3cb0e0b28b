"""Event loops that a server runs on."""

from __future__ import annotations

import pytest

from rwt.server import Loop

LOOPS: dict[Loop, tuple[str, dict[str, bool]]] = {
    "asyncio": ("asyncio", {"use_uvloop": False}),
    "trio": ("trio", {}),
    "uvloop": ("asyncio", {"use_uvloop": True}),
}


@pytest.fixture(params=LOOPS)
def loop(request: pytest.FixtureRequest) -> Loop:
    """Each event loop by the name that `Server` has for it."""
    name: Loop = request.param
    return name
