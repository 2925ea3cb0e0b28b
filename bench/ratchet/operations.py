"""Operations whose calls are counted, each between clients and a server in one event loop."""

from __future__ import annotations

import asyncio
import json
import random
from abc import abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Protocol

from bench.traffic.messages import Stream, images, scans, twists
from tools.size.calls import CallCounter

if TYPE_CHECKING:
    from pathlib import Path

    from websockets.asyncio.client import ClientConnection

    from rwt import Server

WARM_UP: Final = 30
"""Operations before those that are counted."""

COUNTED: Final = 40

STARTUP_SECONDS: Final = 1.0
"""Time in which messages are also kept for late subscribers."""

IDLE_SECONDS: Final = 0.002
"""Pause after each operation, in which the server does the work of later turns."""

_GATE: Final = {
    "gate": {
        "rules": {
            "drive": {
                "topics": ["/cmd_vel"],
                "lease": {"seconds": 30.0},
                "stop": {},
                "fields": {"linear.x": {"min": -100.0, "max": 100.0}},
            },
            "sums": {"services": ["/add"], "fields": {"a": {"min": 0, "max": 1e9}}},
        }
    }
}


@dataclass(frozen=True, slots=True)
class Setup:
    """Server and clients of one operation.

    Attributes:
        server: server in this event loop.
        client: client that publishes or calls.
        others: subscribers, or the provider of a service.
    """

    server: Server
    client: ClientConnection
    others: Sequence[ClientConnection]


class Operation(Protocol):
    """Operation that is repeated and counted."""

    @property
    def settings(self) -> Mapping[str, object]:
        """Settings of the server."""

    @property
    def clients(self) -> int:
        """Number of clients besides the first."""

    @abstractmethod
    async def prepare(self, setup: Setup) -> None:
        """Advertise and subscribe."""

    @abstractmethod
    async def run(self, setup: Setup, number: int) -> None:
        """Do the operation once, until its effect has reached the clients."""


@dataclass(frozen=True)
class Publish:
    """A client publishes a message, which all others receive.

    Attributes:
        stream: topic and messages.
        compression: encoding of the subscribers.
        clients: number of subscribers.
        in_process: True if a node in the server's process subscribes, too.
        settings: settings of the server.
    """

    stream: Stream
    compression: str = "none"
    clients: int = 1
    in_process: bool = False
    settings: Mapping[str, object] = field(default_factory=dict)

    async def prepare(self, setup: Setup) -> None:
        """Advertise and subscribe."""
        if self.in_process:
            setup.server.node("listener").subscribe(self.stream.topic, _ignore, self.stream.type)
        await setup.client.send(self.stream.advertise(), text=True)
        for each in setup.others:
            await each.send(self.stream.subscribe(self.compression), text=True)

    async def run(self, setup: Setup, number: int) -> None:
        """Publish one message."""
        message = self.stream.messages[number % len(self.stream.messages)]
        await setup.client.send(self.stream.publish(message), text=True)
        for each in setup.others:
            frame = await each.recv()
            if isinstance(frame, str) and '"status"' in frame[:100]:
                raise RuntimeError(f"the server reports {frame[:200]}")


@dataclass(frozen=True)
class Call:
    """A client calls a service.

    Attributes:
        provider: `rosapi`, `node` in the server's process, or `client`.
        settings: settings of the server.
    """

    provider: str
    settings: Mapping[str, object] = field(default_factory=dict)

    @property
    def clients(self) -> int:
        """Number of clients besides the first."""
        return 1 if self.provider == "client" else 0

    async def prepare(self, setup: Setup) -> None:
        """Offer the service."""
        if self.provider == "node":
            setup.server.node("adder").advertise_service("/add", "example_interfaces/AddTwoInts", _add)
        for each in setup.others:
            await _say(each, op="advertise_service", service="/add", type="example_interfaces/AddTwoInts")

    async def run(self, setup: Setup, number: int) -> None:
        """Call the service once."""
        if self.provider == "rosapi":
            await _say(setup.client, op="call_service", service="/rosapi/get_time", id=str(number))
        else:
            arguments = {"a": 1, "b": number}
            await _say(setup.client, op="call_service", service="/add", id=str(number), args=arguments)
        for each in setup.others:
            request = json.loads(await each.recv())
            values = {"sum": 1 + number}
            await _say(
                each, op="service_response", service="/add", id=request["id"], values=values, result=True
            )
        answer = json.loads(await setup.client.recv())
        if answer.get("result") is not True:
            raise RuntimeError(f"the server answers {answer}")


@dataclass(frozen=True)
class Goal:
    """A client sends a goal to an action in the server's process, which sends feedback once."""

    settings: Mapping[str, object] = field(default_factory=dict)
    clients: int = 0

    async def prepare(self, setup: Setup) -> None:
        """Offer the action."""
        setup.server.node("counter").advertise_action("/count", "example_interfaces/Fibonacci", _count)

    async def run(self, setup: Setup, number: int) -> None:
        """Send one goal, and wait for its result."""
        await _say(
            setup.client,
            op="send_action_goal",
            action="/count",
            action_type="example_interfaces/Fibonacci",
            id=str(number),
            args={"order": 1},
            feedback=True,
        )
        feedback, result = [json.loads(await setup.client.recv()) for _ in range(2)]
        if (feedback["op"], result["op"], result.get("result")) != ("action_feedback", "action_result", True):
            raise RuntimeError(f"the server answers {feedback} and {result}")


@dataclass(frozen=True)
class Connect:
    """A client connects, subscribes to a latched topic, and receives its message."""

    settings: Mapping[str, object] = field(default_factory=dict)
    clients: int = 0

    async def prepare(self, setup: Setup) -> None:
        """Publish the latched message."""
        publisher = setup.server.node("talker").advertise("/hello", "std_msgs/String", latch=True)
        publisher.publish({"data": "hello"})

    async def run(self, setup: Setup, number: int) -> None:
        """Connect once."""
        from websockets.asyncio.client import connect

        async with connect(setup.server.urls[0], compression=None) as client:
            await _say(client, op="subscribe", topic="/hello", type="std_msgs/String")
            await client.recv()


def _streams() -> Iterator[tuple[str, Stream]]:
    """Yield realistic messages; those with missing fields lack what clients often omit."""
    yield "Twist", twists()
    yield "Twist, missing fields", Stream("/cmd_vel", "geometry_msgs/Twist", ({"linear": {"x": 0.25}},))
    yield "LaserScan", scans()
    yield "Image", images()
    yield "OccupancyGrid", Stream("/map", "nav_msgs/OccupancyGrid", (_grid(random.Random(5)),))
    yield "Path", Stream("/plan", "nav_msgs/Path", (_path(500),))


_HEADER: Final = {"stamp": {"sec": 1_700_000_000, "nanosec": 500_000_000}, "frame_id": "map"}


def _pose(x: float) -> dict[str, object]:
    return {"position": {"x": x, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}


def _grid(source: random.Random) -> dict[str, object]:
    info = {"map_load_time": _HEADER["stamp"], "resolution": 0.0625, "width": 200, "height": 200}
    cells = [source.choice((-1, 0, 100)) for _ in range(200 * 200)]
    return {"header": _HEADER, "info": {**info, "origin": _pose(0)}, "data": cells}


def _path(length: int) -> dict[str, object]:
    return {"header": _HEADER, "poses": [{"header": _HEADER, "pose": _pose(i / 8)} for i in range(length)]}


def operations() -> Mapping[str, Operation]:
    """Return all operations by name."""
    found: dict[str, Operation] = {}
    for name, stream in _streams():
        for compression in ("none", "cbor", "cbor-raw", "png"):
            encoding = "JSON" if compression == "none" else compression
            found[f"publish {name} to {encoding}"] = Publish(stream, compression)
    found["publish Twist to JSON, 10 clients"] = Publish(twists(), clients=10)
    found["publish Twist to JSON, 100 clients"] = Publish(twists(), clients=100)
    found["publish Twist to JSON, and to a node"] = Publish(twists(), in_process=True)
    found["publish Image to JSON, and to a node"] = Publish(images(), in_process=True)
    found["publish Twist to JSON, through the gate"] = Publish(twists(), settings=_GATE)
    found["call rosapi"] = Call("rosapi")
    found["call a node's service"] = Call("node")
    found["call a client's service"] = Call("client")
    found["call a node's service, through the gate"] = Call("node", _GATE)
    found["goal with feedback"] = Goal()
    found["connect, subscribe, receive"] = Connect()
    return found


async def count(operation: Operation, folders: Iterable[Path]) -> int:
    """Return the calls of functions in some folders that every operation of its kind makes.

    Of each function, the operation with the fewest calls counts: timers run during some of them only.
    """
    from websockets.asyncio.client import connect

    from rwt import Server, Settings

    async with AsyncExitStack() as stack:
        settings = Settings.model_validate(operation.settings)
        server = await stack.enter_async_context(Server("ws://127.0.0.1:0", settings=settings))
        client, *others = [
            await stack.enter_async_context(connect(server.urls[0], compression=None, max_size=None))
            for _ in range(1 + operation.clients)
        ]
        setup = Setup(server, client, others)
        await operation.prepare(setup)
        await asyncio.sleep(STARTUP_SECONDS)
        for number in range(WARM_UP):
            await operation.run(setup, number)
            await asyncio.sleep(IDLE_SECONDS)
        counter = CallCounter(folders)
        least: Counter[tuple[str, int]] | None = None
        before: Counter[tuple[str, int]] = Counter()
        for number in range(WARM_UP, WARM_UP + COUNTED):
            with counter:
                await operation.run(setup, number)
                await asyncio.sleep(IDLE_SECONDS)
            now = Counter({(each.file, each.line): each.calls for each in counter.counts(1).functions})
            least = now - before if least is None else least & (now - before)
            before = now
        return least.total() if least else 0


async def _say(client: ClientConnection, **op: object) -> None:
    await client.send(json.dumps(op))


def _ignore(_: object) -> None:
    """Do nothing: the message is decoded by then."""


def _add(request: Any) -> dict[str, int]:
    return {"sum": request.a + request.b}


async def _count(goal: Any) -> dict[str, list[int]]:
    goal.publish_feedback({"sequence": [0]})
    return {"sequence": [0, 1]}
