"""Clients of the HTTP gateway that mean no good: they read nothing, unfold much, and leave in the middle."""

from __future__ import annotations

import http.client
import json
import socket

from rwt import Settings
from rwt_graph import Node
from rwt_graph.api import Graph
from tests.faults.conftest import BRIEF, MIB, Robot, Start
from tests.waiting import wait_until

PATIENCE = 60.0


def ask(robot: Robot, method: str, path: str, body: bytes = b"", **headers: str) -> tuple[int, bytes]:
    """Status and body of a request of an ordinary client."""
    connection = http.client.HTTPConnection("127.0.0.1", robot.ports[0], timeout=PATIENCE)
    try:
        connection.request(method, path, body, {n.replace("_", "-"): v for n, v in headers.items()})
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def follow(robot: Robot, topic: str, **options: int) -> socket.socket:
    """A reader of events, of which the head of the answer is read and nothing else."""
    reader = socket.socket()
    for option, value in options.items():
        reader.setsockopt(socket.SOL_SOCKET, getattr(socket, option), value)
    reader.settimeout(PATIENCE)
    reader.connect(("127.0.0.1", robot.ports[0]))
    request = (
        f"GET /api/topics/{topic}?queue=10 HTTP/1.1\r\nHost: 127.0.0.1\r\nAccept: text/event-stream\r\n\r\n"
    )
    reader.sendall(request.encode())
    assert reader.recv(12) == b"HTTP/1.1 200"
    return reader


def streams(robot: Robot) -> int:
    """Return the number of open connections."""
    text = ask(robot, "GET", "/metrics")[1].decode()
    return int(float(text.partition("\nrwt_http_streams ")[2].partition("\n")[0]))


def wait_for_streams(robot: Robot, count: int) -> None:
    wait_until(lambda: streams(robot) == count, lambda: f"{streams(robot)} streams are open, not {count}")


def flood(robot: Robot, graph: Graph) -> None:
    """Publish 100 MB."""
    talker = Node(graph, "talker").advertise("/flood", "std_msgs/String")
    for _ in range(100):
        talker.publish({"data": "x" * MIB})
    talker.close()


def test_readers_that_read_nothing_cost_a_queue_and_are_cut(start: Start) -> None:
    limits = BRIEF.model_copy(update={"stalled_http_seconds": 0.5})
    robot = start(Settings(limits=limits))
    graph = robot.bridge.shared.graph
    robot.portal.call(lambda: Node(graph, "it").advertise("/flood", "std_msgs/String"))
    readers = [follow(robot, "flood", SO_RCVBUF=4096) for _ in range(5)]
    try:
        assert streams(robot) == 5
        robot.portal.call(flood, robot, graph)
        assert ask(robot, "GET", "/healthz")[0] == 200
        # None of them takes anything, so all are cut, and their subscriptions end with them.
        wait_for_streams(robot, 0)
    finally:
        for reader in readers:
            reader.close()
    nodes = robot.portal.call(graph.nodes)
    assert next(node for node in nodes if node.name == "/http_bridge").subscribing == ()


def test_readers_that_leave_in_the_middle_leave_nothing(robot: Robot) -> None:
    graph = robot.bridge.shared.graph
    robot.portal.call(lambda: Node(graph, "it").advertise("/flood", "std_msgs/String"))
    for _ in range(20):
        follow(robot, "flood").close()
    wait_for_streams(robot, 0)


def test_bodies_that_unfold_are_refused(robot: Robot) -> None:
    path = "/api/topics/x?type=visualization_msgs/MarkerArray"
    for body, kind in (
        (b"[" * 1_000_000, "application/json"),
        (b'{"markers":[' + b'{"points":[{}]},' * 60_000 + b"{}]}", "application/json"),
        (b"\x81" * 1_000_000, "application/cbor"),
        (b"\xa1gmarkers\x9f" + b"\xa0" * 1_000_000 + b"\xff", "application/cbor"),
        (b'{"markers": ' + b"1" * 1_000_000 + b"}", "application/json"),
    ):
        status, answer = ask(robot, "POST", path, body, Content_Type=kind)
        assert 400 <= status < 500, body[:20]
        assert len(answer) < 2_000 and json.loads(answer)["detail"]
    assert ask(robot, "GET", "/healthz")[0] == 200


def test_half_a_body_is_waited_for_no_longer_than_the_limit(robot: Robot) -> None:
    with socket.create_connection(("127.0.0.1", robot.ports[0]), PATIENCE) as slow:
        slow.sendall(b"POST /api/topics/x HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 100\r\n\r\n{")
        assert slow.recv(12) == b"HTTP/1.1 408"
