"""What clients share: one that takes all of it leaves room for the next."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.faults.isolation.greedy_clients import (
    DRIVERS,
)


@pytest.mark.parametrize("pool", DRIVERS)
def test_a_greedy_client_leaves_room_for_another(pool: str, tmp_path: Path) -> None:
    driver = DRIVERS[pool]
    with driver.prepare(tmp_path, driver.settings) as server, ExitStack() as stack:
        driver.fill(server, stack)
        driver.ask(server, stack)
