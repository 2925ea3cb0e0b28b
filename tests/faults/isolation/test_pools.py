"""What clients share: one that takes all of it leaves room for the next, and is told why it loses a part."""

from __future__ import annotations

import queue
import socket
import threading
from contextlib import ExitStack, closing, suppress
from http.client import HTTPConnection, HTTPException, HTTPResponse
from pathlib import Path
from typing import Final

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from tests.faults.isolation.greedy_clients import (
    DRIVERS,
    GREEDY,
    IMAGE,
    OTHER,
    connected,
    events,
    request,
    take_responses,
)
from tests.faults.isolation.served import LONGEST_S, served

VIEWER: Final = {"Authorization": "Bearer the-token-of-a-viewer"}
OPERATOR: Final = {"Authorization": "Bearer the-token-of-an-operator"}
TOKENS: Final = """
auth.tokens.viewer = { token = "the-token-of-a-viewer", role = "viewer" }
auth.tokens.operator = { token = "the-token-of-an-operator", role = "admin" }
"""


@pytest.mark.parametrize("pool", DRIVERS)
def test_a_greedy_client_leaves_room_for_another(pool: str, tmp_path: Path) -> None:
    driver = DRIVERS[pool]
    with driver.prepare(tmp_path, driver.settings) as server, ExitStack() as stack:
        driver.fill(server, stack)
        driver.ask(server, stack)


def test_clients_of_one_address_are_told_apart_by_their_credentials(tmp_path: Path) -> None:
    with served(tmp_path, f"demo = true\n{TOKENS}") as server, ExitStack() as stack:

        def small(number: int) -> tuple[HTTPResponse, HTTPConnection]:
            path = f"/stream?topic={IMAGE}&quality={number + 1}&width=16&height=12"
            return request(server, GREEDY, "GET", path, headers=VIEWER)

        assert take_responses(small, stack) == 16
        response, connection = request(server, GREEDY, "GET", f"/snapshot?topic={IMAGE}", headers=OPERATOR)
        with closing(connection):
            assert (response.status, response.read()[:2]) == (200, b"\xff\xd8")


def test_clients_behind_a_proxy_are_told_apart(tmp_path: Path) -> None:
    settings = 'proxies = ["127.0.0.1"]\nlimits.connections = 4\n'
    with served(tmp_path, settings) as server, ExitStack() as stack:
        for _ in range(4):
            stack.enter_context(server.connect(headers={"X-Forwarded-For": "203.0.113.1"}))
        with pytest.raises(InvalidStatus) as refused:
            server.connect(headers={"X-Forwarded-For": "203.0.113.1"})
        assert refused.value.response.status_code == 503
        other = stack.enter_context(server.connect(headers={"X-Forwarded-For": "203.0.113.2"}))
        assert other.call("/rosapi/get_time")["result"]


def test_a_client_alone_may_use_a_whole_pool(tmp_path: Path) -> None:
    with served(tmp_path, "limits.connections = 4\n") as server, ExitStack() as stack:
        clients = [connected(server, GREEDY, stack) for _ in range(4)]
        assert all(client.call("/rosapi/get_time")["result"] for client in clients)


def test_a_connection_that_is_taken_is_closed_with_the_setting(tmp_path: Path) -> None:
    with served(tmp_path, "limits.connections = 2\n") as server, ExitStack() as stack:
        first, second = (connected(server, GREEDY, stack) for _ in range(2))
        connected(server, OTHER, stack)
        with pytest.raises(ConnectionClosed) as closed:
            first.connection.recv(LONGEST_S)
        assert closed.value.rcvd is not None and closed.value.rcvd.code == 1013
        assert "(limits.connections)" in closed.value.rcvd.reason
        assert second.call("/rosapi/get_time")["result"]


def test_an_event_stream_that_is_taken_ends_with_the_setting(tmp_path: Path) -> None:
    with served(tmp_path, "api.streams = 2\n") as server, ExitStack() as stack:
        (first, connection), (_, another) = (events(server, GREEDY) for _ in range(2))
        stack.callback(connection.close)
        stack.callback(another.close)
        _, others = events(server, OTHER)
        stack.callback(others.close)
        end = first.read().decode()
        assert "event: ended\n" in end and "(api.streams)" in end


def test_a_long_poll_that_is_taken_is_refused_with_the_setting(tmp_path: Path) -> None:
    answers: queue.SimpleQueue[tuple[int, bytes]] = queue.SimpleQueue()

    with served(tmp_path, "api.streams = 2\n") as server, ExitStack() as stack:
        host, port = server.host.split(":")
        polls = [HTTPConnection(host, int(port), LONGEST_S, (GREEDY, 0)) for _ in range(3)]

        def poll(connection: HTTPConnection) -> None:
            # The poll that is left at the end is cut by this test.
            with suppress(OSError, HTTPException):
                connection.request("GET", "/api/topics/quiet?type=std_msgs/String&wait=60")
                response = connection.getresponse()
                answers.put((response.status, response.read()))

        threads = [threading.Thread(target=poll, args=(each,)) for each in polls]
        for thread in threads:
            thread.start()
        # Two wait, and the third is refused.
        status, body = answers.get(timeout=LONGEST_S)
        assert status == 503 and b"2 of 2 are in use, 2 by this client" in body
        response, connection = events(server, OTHER)
        stack.callback(connection.close)
        assert response.status == 200
        status, body = answers.get(timeout=LONGEST_S)
        assert status == 503 and b"no-room" in body and b"(api.streams)" in body
        for each in polls:
            if each.sock is not None:
                each.sock.shutdown(socket.SHUT_RDWR)
        for thread in threads:
            thread.join()
        for each in polls:
            each.close()
