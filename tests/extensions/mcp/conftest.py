"""Versions of the protocol."""

from __future__ import annotations

import pytest

from tests.extensions.mcp.agents import Era


@pytest.fixture(params=["legacy", "auto"])
def era(request: pytest.FixtureRequest) -> Era:
    """The versions with a handshake and sessions, and the newest."""
    era: Era = request.param
    return era
