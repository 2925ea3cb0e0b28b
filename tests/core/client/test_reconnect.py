"""Loss of the connection, and reconnection."""

from __future__ import annotations

from typing import Any

import anyio
import pytest
from anyio.abc import TaskStatus

from rwt import Server
from rwt_client import Backoff, CannotConnect, ConnectionEvent, ConnectionLost, NotConnected, connect
from rwt_client.connection import ConnectKeywords
from rwt_graph import MemoryGraph, Node
from rwt_participant.errors import TimedOut
from tests.core.client.worlds import AT_ONCE, ScriptedServer, scripted
from tests.waiting import until

pytestmark = pytest.mark.anyio


async def test_everything_is_said_again_in_the_order_in_which_it_was_said() -> None:
    async with scripted() as (server, robot):
        await robot.topic("/odom", "nav_msgs/Odometry", throttle=0.1)
        await robot.advertise("/cmd_vel", "geometry_msgs/Twist", latch=True)
        await robot.advertise_service("/beep", "std_srvs/Trigger", lambda request: {})
        await robot.advertise_action("/count", "example_interfaces/Fibonacci", _never)
        await server.hears("advertise_action")
        first, server.heard = server.heard, []
        server.hang_up()
        await server.hears("advertise_action")
        assert server.heard == first
        assert [op["op"] for op in first] == [
            "set_level", "subscribe", "advertise", "advertise_service", "advertise_action",
        ]  # fmt: skip


async def _never(goal: Any) -> None:
    await anyio.sleep_forever()


async def test_what_was_closed_is_not_said_again() -> None:
    async with scripted() as (server, robot):
        async with robot.topic("/odom", "nav_msgs/Odometry"):
            await server.hears("subscribe")
        (await robot.advertise("/cmd_vel", "geometry_msgs/Twist")).close()
        await server.hears("unadvertise")
        server.heard.clear()
        server.hang_up()
        await server.hears("set_level")
        await robot.topic("/last", "std_msgs/String")
        await server.hears("subscribe")
        assert [op["op"] for op in server.heard] == ["set_level", "subscribe"]
        assert server.heard[1]["topic"] == "/last"


async def test_events_tell_of_it() -> None:
    async with scripted() as (server, robot):
        events = robot.events()
        heard: list[ConnectionEvent] = []
        robot.on_event(heard.append)
        server.hang_up(reason="the cable was pulled")
        kinds = [(await anext(events)).kind for _ in range(3)]
        assert kinds == ["lost", "retrying", "restored"]
        assert heard[0] == ConnectionEvent("lost", "the cable was pulled")
        assert heard[1].attempt == 1
        assert robot.connected
    assert [event.kind async for event in events] == ["closed"]


async def test_a_callback_for_events_may_fail_and_may_be_ended(caplog: pytest.LogCaptureFixture) -> None:
    async with scripted() as (server, robot):
        heard: list[str] = []

        def callback(event: ConnectionEvent) -> None:
            heard.append(event.kind)
            raise ValueError

        end = robot.on_event(callback)
        server.hang_up()
        await server.hears("set_level", 2)
        assert heard == ["lost", "retrying", "restored"]
        end()
        end()
    assert "closed" not in heard
    assert "a callback for connection events failed" in caplog.text


async def test_a_repeatable_call_is_sent_once_more() -> None:
    async with scripted() as (server, robot):
        answers: list[Any] = []

        async def call() -> None:
            answers.append(await robot.call("/beep", {}, "std_srvs/Trigger", repeat=True))

        async with anyio.create_task_group() as tasks:
            tasks.start_soon(call)
            first = await server.hears("call_service")
            server.answers["/beep"] = {"success": True}
            server.hang_up()
            assert await server.hears("call_service", 2) == first
        assert answers[0].success


async def test_publishing_without_a_connection_is_told() -> None:
    slow = Backoff(first=3600.0)
    async with scripted(reconnect=slow) as (server, robot):
        publisher = await robot.advertise("/chatter", "std_msgs/String")
        server.hang_up()
        await until(lambda: not robot.connected)
        with pytest.raises(
            NotConnected, match="there is no connection to the server now; it is being retried"
        ):
            publisher.publish({"data": "x"})
        with pytest.raises(NotConnected):
            await robot.send_goal("/count", {}, "example_interfaces/Fibonacci")


async def test_when_it_is_given_up_everybody_hears_of_it() -> None:
    async with scripted(reconnect=None) as (server, robot):
        events = robot.events()
        messages = robot.topic("/chatter", "std_msgs/String")
        await messages
        publisher = await robot.advertise("/chatter", "std_msgs/String")
        await server.hears("advertise")
        server.hang_up()
        with pytest.raises(ConnectionLost, match="not tried again"):
            async for _ in messages:
                pass
        with pytest.raises(ConnectionLost, match="not tried again"):
            publisher.publish({"data": "x"})
        with pytest.raises(ConnectionLost, match="not tried again"):
            await robot.topic("/other", "std_msgs/String")
        assert [event.kind async for event in events] == ["lost", "closed"]


class TestInVirtualTime:
    @pytest.fixture
    def anyio_backend(self, virtual_time: object) -> object:
        return virtual_time

    async def test_the_waits_become_longer_up_to_a_bound(self) -> None:
        server = FlakyServer()
        backoff = Backoff(first=1.0, factor=3.0, longest=5.0, jitter=0.0, attempts=4)
        options: ConnectKeywords = {"ros_version": 2, "fetch_types": False, "reconnect": backoff}
        async with connect(server.accept, **options) as robot:
            events: list[tuple[str, float]] = []
            start = anyio.current_time()
            robot.on_event(lambda event: events.append((event.kind, anyio.current_time() - start)))
            server.down = True
            server.hang_up()
            await anyio.sleep(4.5)
            server.down = False
            await anyio.sleep(60)
            assert events == [
                ("lost", 0.0), ("retrying", 0.0), ("retrying", 1.0), ("retrying", 4.0), ("restored", 9.0),
            ]  # fmt: skip
            server.down = True
            server.hang_up()
            await anyio.sleep(1 + 3 + 5 + 5 + 1)
            assert events[-1][0] == "closed"


class FlakyServer(ScriptedServer):
    """A server that can be down."""

    down = False

    def accept(self, sink: Any, peer: Any) -> Any:
        if self.down:
            from rwt_transports.errors import ConnectError

            raise ConnectError("the connection was refused")
        return super().accept(sink, peer)


# -- over sockets --------------------------------------------------------------------------------------------


async def _serve(
    graph: MemoryGraph,
    url: str,
    ended: anyio.Event,
    *,
    task_status: TaskStatus[tuple[str, anyio.CancelScope]],
) -> None:
    with anyio.CancelScope() as scope:
        async with Server(url, graph=graph, nodes=()) as server:
            task_status.started((server.urls[0], scope))
            await anyio.sleep_forever()
    ended.set()


async def test_a_server_that_is_started_again_is_found_again() -> None:
    heard: list[str] = []
    async with MemoryGraph() as graph, anyio.create_task_group() as tasks:
        talker = Node(graph, "talker").advertise("/chatter", "std_msgs/String")
        ended = anyio.Event()
        url, first = await tasks.start(_serve, graph, "ws://127.0.0.1:0", ended)
        async with connect(url, reconnect=AT_ONCE, ros_version=2, fetch_types=False) as robot:
            await robot.subscribe("/chatter", lambda message: heard.append(message.data), "std_msgs/String")
            await until(lambda: talker.subscriber_count)
            first.cancel()
            await until(lambda: not robot.connected)
            # Clients hear of the end before the port is free.
            await ended.wait()
            with pytest.raises(TimedOut, match=r"no connection to the server within 0\.02 s"):
                await robot.wait_connected(timeout=0.02)
            await tasks.start(_serve, graph, url, anyio.Event())
            await robot.wait_connected(timeout=10)
            await until(lambda: talker.subscriber_count)
            talker.publish({"data": "after"})
            await until(lambda: heard)
        tasks.cancel_scope.cancel()
    assert heard == ["after"]


async def test_the_first_connection_must_succeed() -> None:
    with pytest.raises(CannotConnect, match="the connection was refused; is the server running"):
        async with connect("ws://127.0.0.1:1"):
            pass
