"""`rwt serve --workers N`: one address, several processes, one graph."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from rwt.cli import main
from tests.processes import ended, start

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="workers share ports as Linux does")

FOXGLOVE = Subprotocol("foxglove.websocket.v1")
_LONGEST = 60.0
_UP = re.compile(r"worker (\d) is up, as process (\d+)")


@dataclass(slots=True)
class Running:
    """A server that runs, and its log."""

    process: subprocess.Popen[str]
    urls: list[str] = field(default_factory=list)
    log: list[str] = field(default_factory=list)

    def logged(self, pattern: str, count: int = 1) -> list[re.Match[str]]:
        """The lines of the log that match, when there are so many."""
        deadline = time.monotonic() + _LONGEST
        while time.monotonic() < deadline:
            found = [match for line in tuple(self.log) if (match := re.search(pattern, line))]
            if len(found) >= count:
                return found
            time.sleep(0.02)
        raise AssertionError(f"not {count} times {pattern!r} in {self.log}")

    def pids(self) -> dict[int, int]:
        """The process of each worker, the latest."""
        return {int(match[1]): int(match[2]) for match in self.logged(_UP.pattern, 2)}

    def end(self, how: signal.Signals = signal.SIGINT) -> int:
        """Tell it to end; its exit code."""
        self.process.send_signal(how)
        return self.process.wait(_LONGEST)


@contextmanager
def workers(*arguments: str, urls: tuple[str, ...] = ("ws://127.0.0.1:0",)) -> Iterator[Running]:
    words = ("serve", *urls, "--workers", "2", *arguments)
    process = start(*words, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    watchdog = threading.Timer(1.5 * _LONGEST, process.kill)
    watchdog.start()
    running = Running(process)

    def read() -> None:
        assert process.stderr is not None
        running.log.extend(iter(process.stderr.readline, ""))

    reader = threading.Thread(target=read)
    reader.start()
    try:
        assert process.stdout is not None
        for _ in urls:
            line = process.stdout.readline()
            assert line.startswith("listening on "), (line, running.log)
            running.urls.append(line.removeprefix("listening on ").strip())
        yield running
    finally:
        watchdog.cancel()
        process.kill()
        process.wait()
        reader.join(_LONGEST)
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        process.stderr.close()


def ask(wire: ClientConnection, **op: object) -> dict[str, Any]:
    wire.send(json.dumps(op))
    answer: dict[str, Any] = json.loads(wire.recv(timeout=_LONGEST))
    return answer


@contextmanager
def at_each(server: Running, *protocols: Subprotocol) -> Iterator[dict[str, ClientConnection]]:
    """A client at each worker. Who gets whom is the system's choice, so it takes some tries."""
    with ExitStack() as stack:
        found: dict[str, ClientConnection] = {}
        for count in range(1, 65):
            opening = connect(server.urls[0], subprotocols=protocols or None, max_size=None)
            wire = stack.enter_context(opening)
            joined = server.logged(r"^\[(\d)\].* client \d+ joined", count)
            found.setdefault(joined[-1][1], wire)
            if len(found) == 2:
                yield found
                return
    raise AssertionError("the system gave all clients to one worker")


def test_two_processes_are_one_server_at_one_port() -> None:
    with workers("--demo") as server:
        with at_each(server) as wires:
            for wire in wires.values():
                answer = ask(wire, op="call_service", id="1", service="/add_two_ints", args={"a": 1, "b": 2})
                assert answer["values"] == {"sum": 3}
                nodes = ask(wire, op="call_service", id="2", service="/rosapi/nodes")["values"]["nodes"]
                assert sorted(set(nodes)) == sorted(nodes)
                assert "/demo_robot" in nodes
                assert ask(wire, op="subscribe", id="3", topic="/map")["topic"] == "/map"
                wire.send(json.dumps({"op": "unsubscribe", "id": "3", "topic": "/map"}))
            first, second = wires["1"], wires["2"]
            second.send(json.dumps({"op": "subscribe", "topic": "/word", "type": "std_msgs/String"}))
            first.send(json.dumps({"op": "advertise", "topic": "/word", "type": "std_msgs/String"}))
            heard: Mapping[str, Any] = {}
            deadline = time.monotonic() + _LONGEST
            while not heard and time.monotonic() < deadline:
                first.send(json.dumps({"op": "publish", "topic": "/word", "msg": {"data": "from 1 to 2"}}))
                try:
                    heard = json.loads(second.recv(timeout=0.1))
                except TimeoutError:
                    continue
            assert heard["msg"] == {"data": "from 1 to 2"}
        assert server.end() == 0
        assert "Traceback" not in "".join(server.log)


def test_the_metrics_are_those_of_all_workers() -> None:
    with workers() as server, at_each(server):
        page = _request(server, "GET", "/metrics").text
        for number in "12":
            assert f'rwt_worker_up{{worker="{number}"}} 1' in page
            clients = re.search(
                rf'^rwt_clients{{worker="{number}",gateway="rosbridge"}} (\d+)$', page, re.MULTILINE
            )
            assert clients is not None and int(clients[1]) >= 1
        assert page.count("# TYPE rwt_clients gauge") == 1
        assert re.search(r'^rwt_loop_lag_seconds_bucket{worker="1",le="\+Inf"} \d', page, re.MULTILINE)


def test_pages_of_nodes_are_at_every_worker() -> None:
    with workers() as server:
        for _ in range(8):
            assert "/none" in _request(server, "GET", "/stream_viewer?topic=/none").text


def test_a_worker_that_dies_is_started_again_and_the_others_serve_on() -> None:
    with workers() as server:
        before = server.pids()
        os.kill(before[2], signal.SIGKILL)
        said = server.logged(r"worker 2 \(process \d+\) ended by SIGKILL; it is started again in 0\.5 s")
        assert len(said) == 1
        with connect(server.urls[0]) as wire:
            answer = ask(wire, op="call_service", id="1", service="/rosapi/get_time")
            assert answer["result"] is True
        server.logged(_UP.pattern, 3)
        assert server.pids()[2] != before[2]
        server.logged(r"^\[2\].*connected to 1 others", 2)
        os.kill(server.pids()[1], signal.SIGKILL)
        server.logged(_UP.pattern, 4)
        # What was in the first is back, for the clients of the other too.
        deadline = time.monotonic() + _LONGEST
        with at_each(server) as wires:
            for wire in wires.values():
                while not ask(wire, op="call_service", id="1", service="/rosapi/get_time")["result"]:
                    assert time.monotonic() < deadline
        assert server.end(signal.SIGTERM) == 0


def test_workers_end_when_their_parent_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with workers() as server:
        pids = server.pids()
        assert [*tmp_path.iterdir()]
        server.end(signal.SIGKILL)
        deadline = time.monotonic() + _LONGEST
        while any(Path(f"/proc/{pid}").exists() for pid in pids.values()):
            assert time.monotonic() < deadline
            time.sleep(0.02)
    assert not [*tmp_path.iterdir()]


def test_every_scheme_of_tcp_is_shared_and_the_rest_is_the_firsts(tmp_path: Path) -> None:
    path = tmp_path / "rwt.sock"
    with workers(urls=("ws://127.0.0.1:0", "tcp://127.0.0.1:0", f"unix://{path}")) as server:
        address = ("127.0.0.1", int(server.urls[1].rpartition(":")[2]))
        question = json.dumps({"op": "call_service", "id": "1", "service": "/rosapi/get_time"}).encode()
        for _ in range(6):
            with socket.create_connection(address, _LONGEST) as wire:
                wire.sendall(question)
                assert b'"result":true' in wire.recv(65536)
        with socket.socket(socket.AF_UNIX) as wire:
            wire.connect(str(path))
            wire.sendall(question + b"\n")
            assert b'"result":true' in wire.recv(65536)
        assert server.end() == 0
    assert not path.exists()


def test_a_port_that_is_taken_is_said_once(capfd: pytest.CaptureFixture[str]) -> None:
    with workers() as server:
        assert main(["serve", server.urls[0], "--workers", "2"]) == 1
        assert capfd.readouterr().err.count("is in use") == 1
    with socket.create_server(("127.0.0.1", 0)) as taken:
        url = f"ws://127.0.0.1:{taken.getsockname()[1]}"
        assert main(["serve", url, "--workers", "2"]) == 1


def test_a_worker_that_cannot_start_ends_the_command() -> None:
    words = ("serve", "ws://127.0.0.1:0", "--workers", "2", "--graph", "zenoh", "--zenoh-listen", "here")
    done = ended(*words, timeout=_LONGEST)
    assert (done.returncode, done.stdout) == (1, "")
    assert "Zenoh does not take" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["ws://127.0.0.1:0", "--script", "robot.toml"], "script: sees one process only"),
        (["ws://127.0.0.1:0", "--record", "a.mcap"], "record: sees one process only"),
        (["ws://127.0.0.1:0", "--introspection"], "introspection: sees one process only"),
        (["ws://127.0.0.1:0", "--distro", "noetic"], "a graph of noetic cannot be joined"),
        (["stdio:"], "stdio: has one client"),
        (["ws://127.0.0.1:0", "--workers", "0"], "`workers`"),
    ],
)
def test_what_several_processes_cannot_do(
    arguments: list[str], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["serve", "--workers", "2", *arguments]) == 2
    assert text in capsys.readouterr().err


def _channel(viewer: ClientConnection, topic: str) -> int:
    while True:
        said = viewer.recv(timeout=_LONGEST)
        found = json.loads(said).get("channels", ()) if isinstance(said, str) else ()
        for channel in found:
            if channel["topic"] == topic:
                return int(channel["id"])


def _heard(viewer: ClientConnection) -> bytes:
    while isinstance(said := viewer.recv(timeout=_LONGEST), str):
        pass
    return said


def _request(server: Running, method: str, path: str, body: object = None, **headers: str) -> httpx.Response:
    """An answer to a request over a connection of its own."""
    url = f"{server.urls[0].replace('ws', 'http', 1)}{path}"
    return httpx.request(method, url, json=body, headers=headers, timeout=_LONGEST)


def test_every_gateway_is_at_every_worker() -> None:
    asked = ("--set", "gateways=foxglove,http,mcp", "--set", "mcp.default_role=admin")
    words = "/api/topics/words?type=std_msgs/String&latch=true"
    with workers("--demo", *asked) as server, at_each(server, FOXGLOVE) as viewers:
        assert _request(server, "POST", words, {"data": "first"}).status_code == 204
        for viewer in viewers.values():
            wanted = [{"id": 7, "channelId": _channel(viewer, "/words")}]
            viewer.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
            assert b"first" in _heard(viewer)
        assert _request(server, "POST", words, {"data": "second"}).status_code == 204
        assert all(b"second" in _heard(viewer) for viewer in viewers.values())

        goal = _request(server, "POST", "/api/actions/fibonacci/goals", {"order": 3})
        assert goal.status_code == 201
        answers: dict[int, Any] = {}
        for _ in range(64):
            answer = _request(server, "GET", f"/api/actions/fibonacci/goals/{goal.json()['id']}")
            answers[answer.status_code] = answer.json()
            if len(answers) == 2:
                break
        assert answers[200]["action"] == "/fibonacci"
        assert "several (workers)" in answers[421]["detail"], answers

        call = {"jsonrpc": "2.0", "id": 1, "method": "tools/list"}
        accept = "application/json, text/event-stream"
        for _ in range(4):
            said = _request(server, "POST", "/mcp", call, Accept=accept)
            assert said.is_success and "read_topic" in said.text, said.text
