"""Clients behind a trusted reverse proxy, which passes on headers that it does not write itself."""

from __future__ import annotations

import http.client
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

import pytest
from websockets.exceptions import InvalidStatus

from tests.faults.isolation.served import LONGEST_S, Served, served

MOST = 8
SETTINGS = f"""
proxies = ["127.0.0.1"]
access_log = true
[limits]
connections_per_address = {MOST}
"""

#: What a client writes beside the header of the proxy.
FORGED = [
    {"Forwarded": "for=127.0.0.1"},
    {"Forwarded": "for=203.0.113.{number}"},
    {"Forwarded": 'for="[::1]:{number}"'},
    {"Forwarded": "for=127.0.0.1", "X-Real-IP": "127.0.0.1", "True-Client-IP": "127.0.0.1"},
]


def connections(server: Served, stack: ExitStack, headers: Mapping[str, str]) -> int:
    """Try five times as many connections as one address may have, and return the number of open ones."""
    opened = 0
    for number in range(5 * MOST):
        sent = {name: value.format(number=number) for name, value in headers.items()}
        try:
            stack.enter_context(server.connect(headers=sent))
        except InvalidStatus as refused:
            assert refused.response.status_code == 429
        else:
            opened += 1
    return opened


def page(server: Served, headers: Mapping[str, str]) -> tuple[int, str]:
    """Return status and text of the index page."""
    client = http.client.HTTPConnection(server.host, timeout=LONGEST_S)
    try:
        client.request("GET", "/index", headers=headers)
        answer = client.getresponse()
        return answer.status, answer.read().decode()
    finally:
        client.close()


@pytest.mark.parametrize("forged", FORGED)
def test_a_client_cannot_choose_its_address(tmp_path: Path, forged: Mapping[str, str]) -> None:
    with served(tmp_path, SETTINGS) as server, ExitStack() as stack:
        assert connections(server, stack, {"X-Forwarded-For": "198.51.100.7", **forged}) == MOST
        assert connections(server, stack, {"X-Forwarded-For": "198.51.100.8", **forged}) == MOST
    assert "198.51.100.7 GET / 101" in server.log.read_text()


def test_clients_that_no_header_names_share_one_limit(tmp_path: Path) -> None:
    with served(tmp_path, SETTINGS) as server, ExitStack() as stack:
        assert connections(server, stack, {}) == MOST
        assert connections(server, stack, {"X-Forwarded-For": "198.51.100.7, unknown"}) == 0
        assert connections(server, stack, {"X-Forwarded-For": "198.51.100.7"}) == MOST


def test_a_client_cannot_choose_the_name_of_the_server(tmp_path: Path) -> None:
    with served(tmp_path, SETTINGS) as server:
        proxied = {"X-Forwarded-For": "198.51.100.7", "Host": "foreign.example"}
        forged = {"Forwarded": "host=localhost;proto=https"}
        assert page(server, proxied)[0] == 403
        assert page(server, {**proxied, **forged})[0] == 403
        text = page(server, {"X-Forwarded-For": "198.51.100.7", "Forwarded": "host=evil.localhost"})[1]
        assert f"ws://{server.host}" in text and "evil" not in text
