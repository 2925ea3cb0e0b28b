"""Event loops that the front door runs on."""

from __future__ import annotations

from typing import Any

import pytest

from rwt.blocking import Loop

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


@pytest.fixture
def anyio_backend(loop: Loop) -> tuple[str, dict[str, Any]]:
    """Each event loop, for tests that are coroutines."""
    return LOOPS[loop]
