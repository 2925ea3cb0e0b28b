"""Objects of clients are freed when they leave, without Python's collector of cyclic garbage.

A server collects old objects as rarely as it can, since a full collection blocks the event loop.
"""

from __future__ import annotations

import asyncio
import gc
import socket
from collections.abc import Callable, Iterator
from typing import Final

import pytest

from rwt.cli.commands.serve import MAX_SCANNED, BoundedGarbageCollection
from rwt.delivery.throttle import Throttle
from rwt.rosbridge.ops.actions import PeerGoal
from rwt.rosbridge.ops.offers import Provided
from rwt.rosbridge.ops.subscriptions import ClientSubscription
from rwt.rosbridge.peer import Peer
from rwt_graph.memory.actions import MemoryActionServer
from rwt_interfaces.errors import InvalidMessage
from rwt_transports.connection import Connection
from rwt_transports.http.connection import HttpConnection
from rwt_transports.outbox import Outbox
from rwt_transports.websocket.wire import WebSocketWire
from tests.core.transports.rfc6455.frames import TEXT, frame
from tests.faults.blocking_client import PATIENCE, BlockingClient
from tests.faults.conftest import Robot
from tests.waiting import wait_until

COUNT = 200
"""Of what each client has."""

OWNED = (ClientSubscription, Throttle, PeerGoal, Provided, MemoryActionServer, Peer)
"""Classes whose instances belong to clients."""

FEW = 3 * COUNT
"""Objects that may be garbage in cycles once the clients have gone: fewer than one for each thing of each of
them. A connection itself may leave some."""


def _subscriptions(client: BlockingClient) -> None:
    for number in range(COUNT):
        compression = ("none", "cbor", "cbor-raw", "png")[number % 4]
        topic = f"/garbage{number}"
        client.say("subscribe", topic=topic, type="std_msgs/String", compression=compression)
        client.say("publish", topic=topic, type="std_msgs/String", msg={"data": ""})


def _throttled(client: BlockingClient) -> None:
    for number in range(COUNT):
        rules = {"throttle_rate": 1000, "queue_length": 3, "qos": {"deadline": 5.0, "lifespan": 1.0}}
        client.say("subscribe", topic=f"/garbage{number}", type="std_msgs/String", **rules)


def _services(client: BlockingClient) -> None:
    for number in range(COUNT):
        client.say("advertise_service", service=f"/garbage{number}", type="std_srvs/SetBool")
        client.say("call_service", service=f"/garbage{number}", id=str(number))


def _actions(client: BlockingClient) -> None:
    kind = "example_interfaces/Fibonacci"
    for number in range(COUNT):
        client.say("advertise_action", action=f"/garbage{number}", type=kind)
        client.say("send_action_goal", action=f"/garbage{number}", action_type=kind, id=str(number), args={})


def _owned() -> int:
    """Return the number of instances, counted in the robot's own thread.

    A tuple that the robot is about to make cannot be finished while another thread holds it.
    """
    return sum(isinstance(each, OWNED) for each in gc.get_objects())


@pytest.fixture
def uncollected() -> Iterator[None]:
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@pytest.mark.parametrize("act", [_subscriptions, _throttled, _services, _actions])
def test_what_a_client_has_is_freed_with_it(act: object, robot: Robot, uncollected: None) -> None:
    assert callable(act)
    others = robot.portal.call(_owned)  # What tests before this one have left, in log records for example.
    for _ in range(3):
        with robot.connect() as client:
            act(client)
            client.ask_something()
        robot.wait_for_clients(0)
    wait_until(lambda: robot.portal.call(_owned) == others, lambda: "some are left")
    assert robot.portal.call(gc.collect) < FEW


_LARGE: Final = 600_000
"""Bytes that each connection leaves behind, in the midst of a message."""

_OF_CONNECTIONS: Final = (Connection, HttpConnection, Outbox, WebSocketWire)


def _half_a_message(robot: Robot) -> None:
    client = robot.connect()
    client.ask_something()
    client.socket.sendall(frame(TEXT, b"x" * 2 * _LARGE, key=bytes(4))[:_LARGE])
    client.reset()


def _half_a_request(robot: Robot) -> None:
    head = b"POST /api/topics/a HTTP/1.1\r\nHost: localhost\r\nContent-Length: %d\r\n\r\n" % (2 * _LARGE)
    with socket.create_connection(("127.0.0.1", robot.ports[0]), PATIENCE) as client:
        client.sendall(head + b"x" * _LARGE)


def _left_behind() -> int:
    return sum(isinstance(each, _OF_CONNECTIONS) for each in gc.get_objects())


@pytest.mark.parametrize("act", [_half_a_message, _half_a_request])
def test_a_connection_is_freed_with_what_it_has_received(
    act: Callable[[Robot], None], robot: Robot, uncollected: None
) -> None:
    others = _left_behind()
    for _ in range(5):
        act(robot)
    wait_until(lambda: _left_behind() == others, lambda: "some are left")


def _connections_reset(robot: Robot) -> None:
    for _ in range(COUNT):
        client = robot.connect()
        client.ask_something()
        client.reset()


def _incomplete_large_messages(robot: Robot) -> None:
    with robot.connect() as client:
        markers: list[dict[str, object]] = [{}] * 50_000
        for _ in range(10):
            client.say("publish", topic="/markers", type="visualization_msgs/MarkerArray",
                       msg={"markers": markers, "other": 1})  # fmt: skip
        client.ask_something()


def _transports_and_errors() -> int:
    return sum(isinstance(each, asyncio.Transport | InvalidMessage) for each in gc.get_objects())


@pytest.mark.parametrize("act", [_connections_reset, _incomplete_large_messages])
def test_neither_lost_transports_nor_errors_stay_in_cycles(
    act: Callable[[Robot], None], robot: Robot, uncollected: None
) -> None:
    before = _transports_and_errors()
    act(robot)
    wait_until(lambda: _transports_and_errors() == before, lambda: "some are left")


class _Cycle:
    def __init__(self) -> None:
        self.own = self


def test_full_collections_are_made_by_the_loop_and_look_at_few_objects() -> None:
    due: list[object] = []
    before = gc.get_threshold()
    collections = BoundedGarbageCollection(lambda collect: due.append(collect))
    collections.begin()
    try:
        frozen = gc.get_freeze_count()
        kept = []
        while not due:
            kept.append([object()])
        assert len(kept) < 10 * before[0] * before[1]
        while len(kept) < 2 * MAX_SCANNED:
            kept.append([object()])
        garbage = _Cycle()
        del garbage
        (collect,) = due
        assert callable(collect)
        collect()
        assert gc.get_freeze_count() >= frozen + len(kept)
        assert not gc.get_objects(2)
        assert not any(type(each) is _Cycle for each in gc.get_objects())
    finally:
        collections.end()
    assert gc.get_threshold() == before
    assert gc.get_freeze_count() == 0
