"""`rwt doctor` against a server that is well, and against some that are not."""

from __future__ import annotations

import json
import re
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.sync.server import ServerConnection

from rwt import Server
from rwt.cli.commands.doctor import encodings, stop_finding
from rwt_graph import MemoryGraph
from rwt_graph.api import Network
from tests.core.cli.conftest import Rwt, demo_server, response, served


def _verdicts(told: dict[str, Any]) -> dict[str, str]:
    return {finding["name"]: finding["verdict"] for finding in told["findings"]}


def test_a_server_that_is_well(rwt: Rwt, demo: str) -> None:
    ended = rwt("doctor", demo, "--json")
    told = ended.json
    assert (ended.code, told["ok"], told["url"]) == (0, True, demo)
    verdicts = _verdicts(told)
    assert list(verdicts)[:4] == ["server", "connection", "rosapi", "ROS"]
    assert {verdicts[f"encoding {name}"] for name in encodings()} == {"ok"}
    lines = rwt("doctor").out.splitlines()
    assert lines[0].startswith("ok       server: rwt ")


def test_ros_1(rwt: Rwt) -> None:
    with demo_server("--distro", "noetic") as url:
        told = rwt("doctor", url, "--json").json
    assert _verdicts(told)["ROS"] == "note"
    assert _verdicts(told)["encoding cbor-raw"] == "ok"


class _Joined(MemoryGraph):
    """A graph that says how many nodes of other programs it sees."""

    others = 0

    @property
    def network(self) -> Network:
        return Network("ROS 2 kilted", "domain 7, rmw_x, discovery range SUBNET", self.others, "start it")


@pytest.mark.parametrize(("others", "verdict"), [(0, "warning"), (1, "ok"), (12, "ok")])
def test_a_graph_on_which_there_is_only_the_server(rwt: Rwt, others: int, verdict: str) -> None:
    graph = _Joined()
    graph.others = others
    with Server("ws://127.0.0.1:0", graph=graph) as robot:
        told = rwt("doctor", robot.server.urls[0], "--json").json
    (found,) = (each for each in told["findings"] if each["name"] == "robot")
    assert found["verdict"] == verdict
    assert "ROS 2 kilted (domain 7, rmw_x, discovery range SUBNET)" in found["text"]
    if others == 0:
        assert found["text"].startswith("only the server itself is there")
        assert found["advice"] == "start it"


def test_the_network_is_not_revealed_to_those_who_may_not_see_all_topics(rwt: Rwt) -> None:
    token = "0123456789abcdef0123"
    auth = {"tokens": {"me": {"token": token, "role": "narrow"}}}
    roles = {"narrow": {"subscribe": ["/odom"]}}
    with Server("ws://127.0.0.1:0", graph=_Joined(), auth=auth, roles=roles) as robot:
        url = robot.server.urls[0]
        assert "robot" not in _verdicts(rwt("doctor", url, "--token", token, "--json").json)


def test_without_rosapi(rwt: Rwt) -> None:
    with demo_server("--set", "nodes=") as url:
        ended = rwt("doctor", url)
    assert ended.code == 1
    assert "problem  rosapi: refused" in ended.out
    assert "-> start rosapi beside the server" in ended.out
    assert "ok       encoding cbor" in ended.out


def test_a_token_that_is_missing_or_wrong(rwt: Rwt) -> None:
    token = "0123456789abcdef0123"
    settings = ("--set", f"auth.tokens.me.token={token}", "--set", "auth.tokens.me.role=viewer")
    with demo_server(*settings) as url:
        ended = rwt("doctor", url)
        assert (ended.code, "the server requires a token: --token or RWT_TOKEN" in ended.out) == (3, True)
        ended = rwt("doctor", url, "--token", "x" * 20)
        assert (ended.code, "the token is invalid" in ended.out) == (3, True)


def test_a_narrow_role_is_told_once_what_it_may_not(rwt: Rwt) -> None:
    narrow = ("--set", "auth.default_role=kiosk", "--set", 'roles.kiosk.call=["/reset"]')
    with demo_server(*narrow) as url:
        ended = rwt("doctor", url)
    assert ended.code == 0
    assert ended.out.count("may not") == 2
    (said,) = (line for line in ended.out.splitlines() if line.startswith("note     permissions: "))
    assert "role 'kiosk' may not publish on " in said
    assert "role 'kiosk' may not subscribe to " in said
    assert "encoding json" not in ended.out


def test_a_narrow_role_is_refused_no_more_than_it_is_told(rwt: Rwt) -> None:
    with Server("ws://127.0.0.1:0", auth={"default_role": "viewer"}) as robot:
        assert rwt("doctor", robot.server.urls[0]).code == 0
        text = robot.server.metrics.text().decode()
    refusals = [line for line in text.splitlines() if line.startswith("rwt_refusals_total{")]
    assert refusals == ['rwt_refusals_total{gateway="rosbridge",op="advertise"} 1']


def test_clients_beyond_their_rate_are_noticed(rwt: Rwt) -> None:
    with Server("ws://127.0.0.1:0") as robot, connect(robot.server.urls[0]):
        (peer,) = robot.server.bridge.clients
        peer.graph.work.add(1000.0, "messages")
        ended = rwt("doctor", robot.server.urls[0])
    assert "warning  server: rwt " in ended.out
    assert "1 of them beyond their work rate" in ended.out
    assert "raise limits.work_per_second" in ended.out


def test_nobody_there(rwt: Rwt) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    ended = rwt("doctor", f"ws://127.0.0.1:{port}")
    assert (ended.code, "start the server" in ended.out) == (3, True)


@pytest.mark.parametrize(
    ("url", "advice"),
    [("ws://no.such.host.invalid:1", "check the host name"), ("wss", "this port does not use TLS")],
)
def test_advice_is_about_the_cause(rwt: Rwt, demo: str, url: str, advice: str) -> None:
    ended = rwt("doctor", demo.replace("ws", url, 1) if url == "wss" else url)
    assert (ended.code, advice in ended.out) == (3, True)


@contextmanager
def _scripted(answer: Any) -> Iterator[str]:
    """A server that answers each op with what `answer` makes of it."""

    def handle(wire: ServerConnection) -> None:
        try:
            for text in wire:
                for reply in answer(json.loads(text)):
                    wire.send(json.dumps(reply))
        except ConnectionClosed:
            return

    with served(handle) as url:
        yield url


def _old_robot(op: dict[str, Any]) -> list[dict[str, Any]]:
    """A server of long ago: JSON only, no version, a clock an hour behind."""
    if op["op"] == "publish":
        return [{"op": "publish", "topic": op["topic"], "msg": op["msg"]}]
    if op["op"] != "call_service":
        return []
    if op["service"] == "/rosapi/get_time":
        return [response(op, {"time": {"secs": int(time.time()) - 3600, "nsecs": 0}})]
    if op["service"] == "/rosapi/topics":
        return [response(op, {"topics": [], "types": []})]
    return [response(op, "Service does not exist", result=False)]


def test_an_old_server_with_a_wrong_clock(rwt: Rwt) -> None:
    with _scripted(_old_robot) as url:
        ended = rwt("doctor", url, "--json")
    verdicts = _verdicts(ended.json)
    assert (ended.code, verdicts["clock"], verdicts["encoding json"]) == (0, "warning", "ok")
    assert verdicts["server"] == "note"
    assert {verdicts[f"encoding {name}"] for name in encodings() if name != "json"} == {"note"}
    (clock,) = (finding for finding in ended.json["findings"] if finding["name"] == "clock")
    assert clock["text"].startswith(("-3600", "-3601", "-3602"))
    assert "NTP" in clock["advice"]


def test_a_server_that_tells_a_version_of_its_own(rwt: Rwt) -> None:
    def answer(op: dict[str, Any]) -> list[dict[str, Any]]:
        values = {"version": "two", "distro": "own"} if op.get("service") == "/rosapi/get_ros_version" else {}
        return [response({"service": "", **op}, values)]

    with _scripted(answer) as url:
        ended = rwt("doctor", url, "--timeout", "0.2", "--json")
    assert _verdicts(ended.json)["ROS"] == "ok"


def test_a_server_that_never_answers(rwt: Rwt) -> None:
    with _scripted(lambda op: []) as url:
        ended = rwt("doctor", url, "--timeout", "0.2", "--json")
    verdicts = _verdicts(ended.json)
    assert (ended.code, verdicts["rosapi"], verdicts["encoding json"]) == (1, "problem", "problem")


def test_the_stop_latency_of_this_machine(rwt: Rwt) -> None:
    """The time itself is not asserted: the machine may be busy."""
    ended = rwt("doctor", "--stop-latency", "--json")
    told = ended.json
    assert (ended.code, told["ok"], told["url"]) == (0, True, "")
    stop, lease = told["findings"]
    assert (stop["name"], lease["name"]) == ("stop latency", "lease latency")
    assert re.match(r"p50 \d+\.\d ms, p99 \d+\.\d ms, max \d+\.\d ms of 200, .*guarantee 20 ms", stop["text"])
    assert {stop["verdict"], lease["verdict"]} <= {"ok", "warning"}


def test_the_verdict_on_latencies() -> None:
    assert stop_finding("x", [0.001] * 99 + [0.019], "since").verdict == "ok"
    slow = stop_finding("x", [0.001] * 99 + [0.021], "since")
    assert (slow.verdict, "p50 1.0 ms, p99 21.0 ms, max 21.0 ms of 100" in slow.text) == ("warning", True)
