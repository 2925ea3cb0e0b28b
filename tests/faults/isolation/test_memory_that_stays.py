"""What clients name, and the server does not know, does not stay in its memory after they have left."""

from __future__ import annotations

import http.client
import json
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, Final

import pytest

from tests.faults.isolation.served import Served, served

MIB: Final = 1024 * 1024

_TOKEN: Final = "a-token-of-a-viewer-of-the-robot"

_SETTINGS: Final = f"""
gateways = ["mcp"]

[roles.viewer]
subscribe = ["*"]
get_param = ["*"]

[auth.tokens.viewer]
token = "{_TOKEN}"
role = "viewer"

[limits]
work_per_second = 0
messages_per_second = 0
"""


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Served]:
    with served(tmp_path, _SETTINGS) as server:
        yield server


def resident_bytes(server: Served) -> int:
    """Return the memory that the server's process has in use."""
    status = Path(f"/proc/{server.process.pid}/status").read_text()
    (line,) = [each for each in status.splitlines() if each.startswith("VmRSS:")]
    return int(line.split()[1]) * 1024


class Agent:
    """Agent with a session, over HTTP."""

    def __init__(self, host: str) -> None:
        self._connection = http.client.HTTPConnection(host, timeout=20)
        self._headers = {
            "Content-Type": "application/json",
            "Accept": "application/json, text/event-stream",
            "Authorization": f"Bearer {_TOKEN}",
        }
        about = {
            "protocolVersion": "2025-06-18",
            "capabilities": {},
            "clientInfo": {"name": "a", "version": "1"},
        }
        self.ask("initialize", about)
        self._post({"jsonrpc": "2.0", "method": "notifications/initialized"})

    def _post(self, message: dict[str, Any]) -> str:
        self._connection.request("POST", "/mcp", json.dumps(message), self._headers)
        response = self._connection.getresponse()
        text = response.read().decode()
        assert response.status < 300, text
        session = response.headers.get("mcp-session-id")
        if session is not None:
            self._headers["Mcp-Session-Id"] = session
        return text

    def ask(self, method: str, params: dict[str, Any]) -> str:
        return self._post({"jsonrpc": "2.0", "id": 1, "method": method, "params": params})

    def list_robot(self, pattern: str) -> str:
        return self.ask("tools/call", {"name": "list_robot", "arguments": {"filter": pattern}})

    def close(self) -> None:
        self._connection.close()


def test_patterns_of_an_agent(server: Served) -> None:
    with closing(Agent(server.host)) as agent:
        for number in range(100):
            agent.list_robot(f"/warm/{number}*")
        before = resident_bytes(server)
        for number in range(1500):
            assert "/rosapi" not in agent.list_robot(f"/{number}/" + "*a" * 120)
    assert resident_bytes(server) - before < 6 * MIB


def test_packages_of_unknown_types(server: Served) -> None:
    with server.connect(headers={"Authorization": f"Bearer {_TOKEN}"}) as viewer:
        viewer.send("set_level", level="error")

        def ask(count: int, package: str) -> None:
            for number in range(count):
                viewer.send("subscribe", topic="/t", type=f"{package * 490}{number}/Thing", id=number)
                if number % 100 == 99:  # All that were sent have been answered.
                    viewer.wait_for(op="status", id=number)

        ask(1000, "a")
        before = resident_bytes(server)
        ask(20_000, "p")
    assert resident_bytes(server) - before < 6 * MIB
