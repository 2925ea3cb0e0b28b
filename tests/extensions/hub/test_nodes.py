"""Several nodes of a hub: a robot dials in at one, and its clients connect to any."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import urlopen

import anyio
import pytest
import zenoh
from anyio import to_thread
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from rwt import Server
from rwt.access.gate.audit.file import read_audit
from rwt.extensions.hub.hub import UNUSED_SECONDS, DialedRobot, Hub, open_hub
from rwt.extensions.hub.nodes.directory import Directory, open_directory
from rwt.extensions.zenoh.session import ZenohOptions, ZenohSession
from rwt_participant.qos import LATCHED
from rwt_transports import Limits
from tests.extensions.hub.test_shared_feeds import Viewer, viewer
from tests.processes import free_port
from tests.waiting import until
from tests.zenoh_links import free_endpoint

pytestmark = pytest.mark.anyio


@dataclass
class Node:
    """Node of a hub."""

    hub: Hub
    directory: Directory

    @property
    def url(self) -> str:
        """URL of the robot for clients of this node."""
        return f"{self.hub.url}/rosie"

    @property
    def robot(self) -> DialedRobot:
        """The robot as this node has it."""
        (robot,) = self.hub.robots
        return robot

    @property
    def received(self) -> int:
        """Bytes that it has received from the robot, or for it from its home node."""
        assert self.robot.carrier is not None
        return self.robot.carrier.sink.received


@asynccontextmanager
async def node(endpoint: str, *, listens: bool, url: str = "") -> AsyncIterator[Node]:
    listen, others = ((endpoint,) if listens else ()), (() if listens else (endpoint,))
    async with (
        open_hub("ws://127.0.0.1:0") as hub,
        open_directory(hub, url or hub.url, listen=listen, connect=others, limits=Limits()) as directory,
    ):
        yield Node(hub, directory)


@asynccontextmanager
async def nodes(count: int) -> AsyncIterator[list[Node]]:
    endpoint = free_endpoint()
    async with AsyncExitStack() as stack:
        found = [
            await stack.enter_async_context(node(endpoint, listens=not number)) for number in range(count)
        ]
        await until(lambda: all(each.directory.count == count - 1 for each in found), "they do not meet")
        yield found


@asynccontextmanager
async def robot(home: Node, *others: Node, **settings: Any) -> AsyncIterator[Server]:
    """A robot at `home`, which the others know of."""
    server = Server(dial={"urls": [f"{home.hub.url}/robots/rosie"]}, nodes=(), **settings)
    async with server:
        await until(lambda: home.hub.robots and all(each.directory.has("rosie") for each in others))
        yield server


async def test_a_client_of_any_node_reaches_the_robot() -> None:
    async with nodes(3) as (home, other, third), robot(home, other, third) as server:
        server.node("adder").advertise_service(
            "/add", "example_interfaces/AddTwoInts", lambda asked: {"sum": asked.a + asked.b}
        )
        for each in (other, third, home):
            async with viewer(each.url) as far:
                await far.say(op="call_service", service="/add", args={"a": 1, "b": 2}, id="sum")
                await far.heard(2)
                assert far.others[1]["values"] == {"sum": 3}
        assert len(home.directory.links) == 2


async def test_samples_cross_each_uplink_once() -> None:
    async with nodes(2) as (home, other), robot(home, other) as server, AsyncExitStack() as stack:
        publisher = server.node("robot").advertise("/odom", "std_msgs/String", qos=LATCHED)
        publisher.publish({"data": "first"})
        wishes = {"topic": "/odom"}
        found: list[Viewer] = [
            await stack.enter_async_context(viewer(each.url, wishes))
            for each in (home, other)
            for _ in range(5)
        ]
        await until(lambda: all(each.data("/odom") == ["first"] for each in found))
        before = home.received, other.received
        for _ in range(20):
            publisher.publish({"data": "x" * 5000})
        await until(lambda: all(len(each.data("/odom")) == 21 for each in found))
        once = 20 * 5000
        assert once < home.received - before[0] < 1.3 * once
        assert once < other.received - before[1] < 1.3 * once


async def test_pages_of_the_robot_are_at_every_node() -> None:
    async with nodes(2) as (home, other), robot(home, other):

        def fetch(path: str) -> tuple[int, bytes]:
            try:
                with urlopen(other.hub.url.replace("ws://", "http://") + path, timeout=60) as response:
                    return response.status, response.read()
            except HTTPError as error:
                return error.code, error.read()

        status, body = await to_thread.run_sync(fetch, "/rosie/healthz")
        assert (status, json.loads(body)["status"]) == (200, "ok")
        assert (await to_thread.run_sync(fetch, "/nobody/healthz"))[0] == 404
        status, body = await to_thread.run_sync(fetch, "/robots")
        assert json.loads(body)["robots"] == [{"name": "rosie", "path": "/rosie", "clients": 0}]


async def test_the_robot_decides_about_clients_of_other_nodes() -> None:
    auth = {"tokens": {"operator": {"token": "0123456789abcdef", "role": "operator"}}}
    async with nodes(2) as (home, other), robot(home, other, auth=auth, roles={"operator": {}}):
        with pytest.raises(InvalidStatus) as raised:
            async with connect(other.url):
                pass
        assert raised.value.response.status_code == 401
        async with connect(other.url, additional_headers={"Authorization": "Bearer 0123456789abcdef"}):
            pass


async def test_two_people_at_two_nodes_share_one_lease(tmp_path: Path) -> None:
    """The audit of the robot names both, with the address and credential of each."""
    people = {"alice": "a" * 16, "bob": "b" * 16}
    settings = {
        "auth": {"tokens": {name: {"token": token, "role": "driver"} for name, token in people.items()}},
        "roles": {"driver": {"publish": ["/cmd_vel"]}},
        "gate": {
            "rules": {"drive": {"topics": ["/cmd_vel"], "lease": {"seconds": 60}, "stop": {}}},
            "audit": {"file": tmp_path / "audit.jsonl"},
        },
    }
    async with (
        nodes(2) as (home, other),
        robot(home, other, **settings) as server,
        connect(f"{home.url}?token={people['alice']}") as alice,
        connect(f"{other.url}?token={people['bob']}") as bob,
    ):
        driven: list[float] = []
        server.node("base").subscribe(
            "/cmd_vel", lambda twist: driven.append(twist.linear.x), "geometry_msgs/Twist"
        )
        for link in (alice, bob):
            await link.send('{"op":"set_level","level":"warning"}')
            await link.send('{"op":"advertise","topic":"/cmd_vel","type":"geometry_msgs/Twist"}')
        await _drive(alice, 0.1)
        await until(lambda: driven == [0.1])
        await _drive(bob, 0.9)
        refusal = json.loads(await bob.recv())
        assert "/cmd_vel is held by" in refusal["msg"], refusal
        assert "alice" not in refusal["msg"]
        await _drive(alice, 0.2)
        await until(lambda: driven == [0.1, 0.2])
        await alice.close()
        # Without its holder the robot stops, and the other one may drive.
        await until(lambda: driven[-1] == 0.0)
        await _drive(bob, 0.3)
        await until(lambda: driven[-1] == 0.3)
    said = {(line["decision"], line.get("credential")) for line in read_audit(tmp_path / "audit.jsonl")}
    assert {("allowed", "alice"), ("refused", "bob"), ("allowed", "bob")} <= said
    assert not {("refused", "alice")} & said


async def _drive(link: ClientConnection, speed: float) -> None:
    await link.send(json.dumps({"op": "publish", "topic": "/cmd_vel", "msg": {"linear": {"x": speed}}}))


async def test_a_node_that_nobody_has_asked_cannot_serve_a_robot() -> None:
    async with nodes(2) as (home, other), robot(home, other), viewer(other.url):
        assert other.robot.is_linked
        other.hub.take_tokens(["0123456789abcdef"])
        with pytest.raises(InvalidStatus) as raised:
            async with connect(
                f"{other.hub.url}/robots/rosie",
                subprotocols=["rwt-uplink.1"],  # type: ignore[list-item]  # it is a text
                additional_headers={"Authorization": f"Bearer {'x' * 43}"},
            ):
                pass
        assert raised.value.response.status_code == 401


async def test_a_link_without_clients_ends() -> None:
    async with nodes(2) as (home, other), robot(home, other):
        async with viewer(other.url):
            pass
        await until(lambda: not other.robot.clients)
        other.hub.tick(time.monotonic() + UNUSED_SECONDS)
        assert not other.hub.robots
        await until(lambda: not len(home.directory.links))
        async with viewer(other.url):
            assert other.robot.is_linked


async def test_clients_follow_a_robot_to_another_node() -> None:
    async with nodes(3) as (first, second, third), robot(first, third), connect(third.url) as link:
        home = first.directory.id
        assert third.robot.is_linked
        async with robot(second):
            await until(lambda: third.directory.home("rosie") == second.directory.id)
            with pytest.raises(ConnectionClosed):
                await link.recv()
            async with viewer(third.url):
                assert third.directory.home("rosie") != home


async def test_a_robot_dials_in_at_the_next_node() -> None:
    async with nodes(3) as (first, second, third), AsyncExitStack() as stack:
        urls = ",".join(f"{each.hub.url}/robots/rosie" for each in (first, second))
        await stack.enter_async_context(Server(dial={"urls": [urls]}, nodes=()))
        await until(lambda: third.directory.home("rosie") == first.directory.id)
        assert first.robot.carrier is not None
        first.robot.carrier.give_up(1001, "the node is going away")
        await until(lambda: third.directory.home("rosie") == second.directory.id)
        async with viewer(third.url):
            assert second.robot.is_reachable


async def test_a_robot_that_leaves_is_left_everywhere() -> None:
    async with nodes(2) as (home, other):
        async with robot(home, other), connect(other.url) as link:
            pass
        with pytest.raises(ConnectionClosed):
            await link.recv()
        await until(lambda: not other.directory.has("rosie"))
        assert not other.hub.robots
        with pytest.raises(InvalidStatus) as raised:
            async with connect(other.url):
                pass
        assert raised.value.response.status_code == 404


@pytest.mark.slow
async def test_a_robot_whose_node_cannot_dial_in_is_unreachable() -> None:
    endpoint = free_endpoint()
    nowhere = f"ws://127.0.0.1:{free_port()}"
    async with (
        node(endpoint, listens=True) as home,
        node(endpoint, listens=False, url=nowhere) as other,
        robot(home, other),
    ):
        with pytest.raises(InvalidStatus) as raised:
            async with connect(other.url):
                pass
        assert raised.value.response.status_code == 503
        await until(lambda: not len(home.directory.links))


async def test_a_node_that_misses_a_change_asks_for_all() -> None:
    endpoint = free_endpoint()
    rows: dict[str, Any] = {"url": "ws://127.0.0.1:9", "number": 1, "robots": {}}

    def tell(query: zenoh.Query) -> None:
        query.reply(query.key_expr, json.dumps(rows))

    async with node(endpoint, listens=True) as home:
        session = ZenohSession()
        opened = await to_thread.run_sync(session.open, ZenohOptions((), (endpoint,), "peer"))
        try:
            answer = opened.declare_queryable("rwt/hub/rows/raw", tell)
            token = opened.liveliness().declare_token("rwt/hub/node/raw")
            await until(lambda: home.directory.count == 1)
            change: dict[str, Any] = {"number": 2, "came": {"first": 1}, "left": []}
            opened.put("rwt/hub/change/raw", json.dumps(change))
            await until(lambda: home.directory.has("first"))
            rows.update(number=4, robots={"second": 2, "third": 3})
            opened.put("rwt/hub/change/raw", json.dumps({"number": 4, "came": {"third": 3}, "left": []}))
            await until(lambda: sorted(home.directory.robots) == ["second", "third"])
            del answer, token
        finally:
            await to_thread.run_sync(session.close)


@pytest.mark.slow
async def test_nodes_are_programs() -> None:
    """Robots of a node that is killed are at the other one once they have dialled in there."""
    endpoint, token = free_endpoint(), "0123456789abcdef"
    ports = free_port(), free_port()
    programs = [
        _program(port, token, option, endpoint)
        for port, option in zip(ports, ("--cluster-listen", "--cluster"), strict=True)
    ]
    try:
        await until(lambda: all(_listens(port) for port in ports))
        url = f"ws://127.0.0.1:{ports[1]}/robots/rosie"
        async with Server(dial={"urls": [url], "token": token}, nodes=()):
            async with _reachable(f"ws://127.0.0.1:{ports[0]}/rosie"):
                pass
            programs[1].send_signal(signal.SIGKILL)
            with pytest.raises(InvalidStatus):
                await _refused(f"ws://127.0.0.1:{ports[0]}/rosie")
    finally:
        for program in programs:
            program.kill()
            program.wait()


@pytest.mark.slow
async def test_a_robot_leaves_a_node_that_falls_silent(caplog: pytest.LogCaptureFixture) -> None:
    """Without trying it again, which would take until its handshake times out."""
    token, port = "0123456789abcdef", free_port()
    program = _program(port, token)
    try:
        await until(lambda: _listens(port))
        async with open_hub("ws://127.0.0.1:0", tokens=[token]) as hub:
            urls = f"ws://127.0.0.1:{port}/robots/rosie,{hub.url}/robots/rosie"
            async with (
                Server(dial={"urls": [urls], "token": token}, nodes=()),
                _reachable(f"ws://127.0.0.1:{port}/rosie"),
            ):
                program.send_signal(signal.SIGSTOP)
                await until(lambda: hub.robots)
                program.kill()
    finally:
        program.kill()
        program.wait()
    assert "no sign of life" in caplog.text
    assert "no answer within" not in caplog.text


def _program(port: int, *options: str) -> subprocess.Popen[bytes]:
    token, *cluster = options
    command = [sys.executable, "-m", "rwt.cli", "hub", f"ws://127.0.0.1:{port}", "--token", token, *cluster]
    return subprocess.Popen(command)


def _listens(port: int) -> bool:
    with socket.socket() as link:
        return link.connect_ex(("127.0.0.1", port)) == 0


@asynccontextmanager
async def _reachable(url: str) -> AsyncIterator[Viewer]:
    with anyio.fail_after(60):
        while True:
            try:
                async with connect(url):
                    break
            except (InvalidStatus, OSError):
                await anyio.sleep(0.1)
    async with viewer(url) as found:
        yield found


async def _refused(url: str) -> None:
    with anyio.fail_after(60):
        while True:
            async with connect(url):
                await anyio.sleep(0.1)
