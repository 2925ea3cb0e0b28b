"""The demo robot in a process of its own, as the tests of the command line have it, and its recording."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.core.cli.conftest import demo as demo
from tests.core.cli.conftest import rwt as rwt


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Where a recording is written."""
    return tmp_path / "run.mcap"
