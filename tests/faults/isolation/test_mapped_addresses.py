"""IPv4 clients of sockets for both IP versions: `::ffff:192.0.2.7` is one client, and no network of all."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Final

import pytest
from websockets.exceptions import InvalidStatus

from tests.faults.isolation.served import served

LIMIT: Final = 4
SETTINGS: Final = f"""
proxies = ["127.0.0.1"]

[limits]
connections_per_address = {LIMIT}
"""


def test_each_address_has_the_limit_of_its_own(tmp_path: Path) -> None:
    greedy, other = ({"X-Forwarded-For": f"::ffff:192.0.2.{number}"} for number in (7, 8))
    with served(tmp_path, SETTINGS) as server, ExitStack() as stack:
        for _ in range(LIMIT):
            stack.enter_context(server.connect(headers=greedy))
        with pytest.raises(InvalidStatus, match="429"):
            server.connect(headers=greedy)
        with server.connect(headers=other) as client:
            assert client.call("/rosapi/get_time")["result"]
