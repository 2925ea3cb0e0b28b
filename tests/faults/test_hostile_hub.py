"""Hostile clients and hostile robots at a hub, and clients that come to a robot through one."""

from __future__ import annotations

import itertools
import json
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from typing import Any

import anyio
import anyio.lowlevel
import httpx
import pytest

from rwt import Server
from rwt.extensions.hub.hub import Hub, open_hub
from rwt.extensions.hub.uplink.dial import dial
from rwt_protocol.frames import Frame
from rwt_transports import Limits
from rwt_transports.errors import ConnectError
from rwt_transports.http.proxies import Proxies
from tests.extensions.hub.raw_robot import binary, end, raw_robot, text
from tests.extensions.hub.test_hub import AT_ONCE, SHORT, Mailbox, Program, client, robot, upgraded
from tests.faults.server_log import Failures
from tests.waiting import until

pytestmark = pytest.mark.anyio

MIB = 1 << 20
PATIENCE = 30.0
BEHIND_PROXY = Proxies(["127.0.0.1"])
"""So that clients of a test may come from elsewhere."""


@asynccontextmanager
async def hub_with_robot(**settings: Any) -> AsyncIterator[tuple[Hub, Server]]:
    """A robot that serves through a hub, and nowhere else."""
    async with open_hub("ws://127.0.0.1:0", limits=SHORT, proxies=BEHIND_PROXY) as hub:
        urls = {"urls": (f"{hub.url}/robots/rosie",)}
        async with Server(dial=urls, web={"enabled": False}, **settings) as server:
            await until(lambda: server.dials[0].connected)
            yield hub, server


def _are(boxes: Sequence[Mailbox], count: int) -> bool:
    return len(boxes) == count


def _closed(*boxes: Mailbox) -> list[tuple[int, str]]:
    return [box.ending for box in boxes if box.ending is not None]


async def test_what_waits_for_a_robot_that_reads_nothing_is_bounded_for_each_address() -> None:
    limits = Limits(close_seconds=0.5)
    with Failures() as failures:
        async with (
            open_hub("ws://127.0.0.1:0", limits=limits, proxies=BEHIND_PROXY, waiting_bytes=2 * MIB) as hub,
            AsyncExitStack() as opened,
        ):
            # It gives no credit.
            await opened.enter_async_context(raw_robot(hub))
            boxes = [
                await opened.enter_async_context(client(hub, "/rosie", **{"X-Forwarded-For": "192.0.2.1"}))
                for _ in range(6)
            ]
            other = await opened.enter_async_context(
                client(hub, "/rosie", **{"X-Forwarded-For": "192.0.2.2"})
            )
            other.sink.send(Frame(bytes(MIB), binary=True))
            for box in boxes:
                for _ in range(16):
                    box.sink.send(Frame(bytes(MIB), binary=True))
            await until(lambda: len(_closed(*boxes)) >= 3)
            assert other.ending is None
            assert all(code == 1008 and "--waiting-bytes" in why for code, why in _closed(*boxes))
            assert hub.waiting.total <= 3 * MIB + 2 * 256 * 1024
        failures.check()


async def test_what_waits_for_clients_that_read_nothing_is_bounded() -> None:
    program = Program()
    limits = Limits(close_seconds=0.5)
    with Failures() as failures:
        async with (
            open_hub("ws://127.0.0.1:0", limits=limits, proxies=BEHIND_PROXY, waiting_bytes=2 * MIB) as hub,
            robot(hub, program),
            AsyncExitStack() as opened,
        ):
            # Their addresses are this machine's: the bound of all together holds, four times as much.
            for number in range(14):
                await opened.enter_async_context(upgraded(hub, "/rosie"))
                await until(partial(_are, program.clients, number + 1))
            for each in program.clients:
                for _ in range(16):
                    each.sink.send(Frame(bytes(MIB), binary=True))
            await until(lambda: len(_closed(*program.clients)) >= 3)
            assert hub.waiting.total <= 9 * MIB
            async with client(hub, "/rosie") as ordinary:
                ordinary.sink.send(Frame(b'{"op":"x"}'))
                await until(lambda: ordinary.heard)
        await anyio.lowlevel.checkpoint()
        failures.check()


@pytest.mark.parametrize(
    "head",
    [
        {"status": 299, "content_type": "text/plain"},
        {"status": 200, "content_type": "text/plain", "headers": {"X Y": "z"}},
        {"status": 200, "content_type": "text/plain", "headers": {"": "z"}},
        {"status": 200, "content_type": "text/plain", "headers": {"a:b": "z"}},
        {"status": 200, "content_type": "text/plain", "headers": {"a" * 300: "z"}},
        {"status": 10**30, "content_type": "text/plain"},
        {"status": 1e308, "content_type": "text/plain"},
        {"status": True, "content_type": None, "headers": []},
        {"status": 204, "content_type": "text/plain"},
        {"status": 304, "content_type": "text/plain"},
        {"status": 200, "content_type": " text/plain"},
        {"status": 200, "content_type": "text/plain", "headers": {"x": " y "}},
    ],
)
async def test_a_hostile_robots_page_is_answered_by_the_hub(head: dict[str, Any]) -> None:
    def lie(stream: int) -> list[bytes]:
        return [text(stream, json.dumps(head).encode()), binary(stream, b"body")]

    with Failures() as failures:
        async with (
            open_hub("ws://127.0.0.1:0", limits=SHORT) as hub,
            raw_robot(hub, "liar", lie),
            httpx.AsyncClient(trust_env=False, timeout=PATIENCE) as asking,
        ):
            answer = await asking.get(f"{hub.url.replace('ws:', 'http:', 1)}/liar/page")
            assert answer.status_code == 502, answer
        failures.check()


async def test_a_page_of_a_silent_robot_ends_with_a_timeout() -> None:
    with Failures() as failures:
        async with (
            open_hub("ws://127.0.0.1:0", limits=SHORT, page_seconds=0.2) as hub,
            raw_robot(hub, "silent"),
            httpx.AsyncClient(trust_env=False, timeout=PATIENCE) as asking,
        ):
            answer = await asking.get(f"{hub.url.replace('ws:', 'http:', 1)}/silent/page")
            assert (answer.status_code, answer.text) == (504, "the robot did not answer within 0.2 s\n")
            await until(lambda: not hub.robots[0].clients)
        failures.check()


async def test_a_robot_that_floods_its_viewer_has_a_share_of_each_turn() -> None:
    program, count = Program(), 2000
    async with (
        open_hub("ws://127.0.0.1:0", limits=SHORT) as hub,
        robot(hub, program),
        client(hub, "/rosie") as viewer,
    ):
        await until(lambda: program.clients)
        seconds = itertools.count(0, 0.0005)  # Each look at the clock takes half a millisecond.
        hub.scheduler.monotonic = lambda: next(seconds)
        for _ in range(count):
            program.clients[0].sink.send(Frame(b"x"))
        most, before = 0, hub.bytes
        with anyio.fail_after(PATIENCE):
            while len(viewer.heard) < count:
                await anyio.lowlevel.checkpoint()
                most, before = max(most, hub.bytes - before), hub.bytes
        assert most <= 20, "the robot's share of a turn, and one message beyond it"


async def test_a_page_that_breaks_off_is_no_failure_of_the_hub() -> None:
    def break_off(stream: int) -> list[bytes]:
        head = b'{"status": 200, "content_type": "text/plain"}'
        return [text(stream, head), binary(stream, b"half of the "), end(stream, 1011, "no more")]

    with Failures() as failures:
        async with (
            open_hub("ws://127.0.0.1:0", limits=SHORT) as hub,
            raw_robot(hub, "quitter", break_off),
            httpx.AsyncClient(trust_env=False, timeout=PATIENCE) as asking,
        ):
            with pytest.raises(httpx.RemoteProtocolError):
                await asking.get(f"{hub.url.replace('ws:', 'http:', 1)}/quitter/page")
        failures.check()


async def test_a_token_of_one_robot_lets_nobody_else_in() -> None:
    rosie, others = "0123456789abcdef", "another-long-token"
    tokens = [f"rosie={rosie}", others]
    async with open_hub("ws://127.0.0.1:0", tokens=tokens, limits=SHORT) as hub:
        for name, wrong in (("rosie", others), ("other", rosie), ("rosie", f"rosie={rosie}")):
            url = f"{hub.url}/robots/{name}"
            async with dial(url, Program(), token=wrong, limits=SHORT, backoff=AT_ONCE) as status:
                await until(partial(getattr, status, "failures"))
                assert "401" in status.error
        assert not hub.robots
        async with robot(hub, Program(), token=rosie), robot(hub, Program(), "other", others):
            assert [each.name for each in hub.robots] == ["other", "rosie"]


# -- at the robot ------------------------------------------------------------------------------------------


EXTREMES = (2**31, 2**31 + 1, 2**53, 2**63 - 1, 2**63, 10**30, -1, 1e12, 1e15, 1e16, 1e300, 0.5)


@pytest.mark.parametrize("member", ["queue_length", "throttle_rate", "fragment_size", "depth", "deadline"])
async def test_no_number_of_a_viewer_ends_the_uplink_of_the_others(member: str) -> None:
    async with hub_with_robot() as (hub, _), client(hub, "/rosie") as other:
        await _ask(other)
        for number in EXTREMES:
            given: dict[str, object] = {member: number, **({"throttle_rate": 5} if member[0] == "q" else {})}
            if member in ("depth", "deadline"):
                given = {"qos": given}
            subscribe = {"op": "subscribe", "topic": "/odom", "type": "std_msgs/String", **given}
            async with client(hub, "/rosie") as viewer:
                viewer.sink.send(Frame(json.dumps(subscribe).encode()))
                await _ask(viewer)
                assert viewer.ending is None, number
        await _ask(other)
        assert other.ending is None


async def test_a_session_that_one_side_rejects_is_not_resumed() -> None:
    async with hub_with_robot() as (hub, _):
        rejected = hub.robots[0]
        assert rejected.carrier is not None
        rejected.carrier.give_up(1002, "not understood")
        await until(lambda: hub.robots and hub.robots[0] is not rejected and hub.robots[0].is_reachable)
        async with client(hub, "/rosie") as viewer:
            await _ask(viewer)


async def test_clients_through_a_hub_count_towards_their_address() -> None:
    async with hub_with_robot(limits={"connections_per_address": 2}) as (hub, _), AsyncExitStack() as opened:
        for _ in range(2):
            await opened.enter_async_context(client(hub, "/rosie", **{"X-Forwarded-For": "192.0.2.1"}))
        says = r"429: 2 connections from 192\.0\.2\.1 are open \(limits\.connections_per_address\)"
        with pytest.raises(ConnectError, match=says):
            async with client(hub, "/rosie", **{"X-Forwarded-For": "192.0.2.1"}):
                pass
        async with client(hub, "/rosie", **{"X-Forwarded-For": "192.0.2.2"}) as other:
            await _ask(other)


async def test_clients_through_a_hub_are_as_many_as_a_listener_takes() -> None:
    async with hub_with_robot(limits={"connections": 2}) as (hub, _), AsyncExitStack() as opened:
        for _ in range(2):
            await _ask(await opened.enter_async_context(client(hub, "/rosie")))
        with pytest.raises(ConnectError, match=r"503: 2 of 2 are in use.*limits\.connections"):
            async with client(hub, "/rosie"):
                pass


async def test_clients_through_a_hub_share_what_is_kept_for_their_address() -> None:
    limits = {"kept_bytes": 4000}
    async with hub_with_robot(limits=limits) as (hub, _), AsyncExitStack() as opened:
        refused = 0
        for number in range(6):
            box = await opened.enter_async_context(client(hub, "/rosie", **{"X-Forwarded-For": "192.0.2.1"}))
            box.sink.send(Frame(b'{"op": "set_level", "level": "error"}'))
            for each in range(3):
                publish = {
                    "op": "publish", "topic": f"/t{number}/{each}", "type": "std_msgs/String", "latch": True,
                    "msg": {"data": "x" * 1100},
                }  # fmt: skip
                box.sink.send(Frame(json.dumps(publish).encode()))
            await _ask(box)
            refused += b"limits.kept_bytes" in b"".join(box.heard)
        assert refused == 2, "four of them fill what their address may have"
        async with client(hub, "/rosie", **{"X-Forwarded-For": "192.0.2.2"}) as other:
            await _ask(other)


async def test_the_work_of_clients_through_a_hub_is_charged_to_their_address() -> None:
    limits = {"work_per_second": 0.001, "work_burst": 0.001}
    async with (
        hub_with_robot(limits=limits) as (hub, _),
        httpx.AsyncClient(trust_env=False, timeout=PATIENCE) as asking,
    ):
        page = f"{hub.url.replace('ws:', 'http:', 1)}/rosie/index"

        async def ask(address: str) -> int:
            return (await asking.get(page, headers={"X-Forwarded-For": address})).status_code

        with anyio.fail_after(PATIENCE):
            while await ask("192.0.2.1") != 429:
                pass
        assert await ask("192.0.2.2") == 200


async def _ask(box: Mailbox) -> None:
    """Wait until the robot has done all that was said before."""
    before = len(box.heard)
    call = {"op": "call_service", "service": "/rosapi/get_time", "id": "there"}
    box.sink.send(Frame(json.dumps(call).encode()))
    await until(lambda: any(b'"there"' in heard for heard in box.heard[before:]))


async def test_who_cannot_be_reached_costs_nothing() -> None:
    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub:
        for path in ("/nobody", "/" + "x" * 5000, "/..", "/%00", "//"):
            with pytest.raises(ConnectError, match="404"):
                async with client(hub, path):
                    pass
        assert hub.waiting.total == 0 and not hub.robots
