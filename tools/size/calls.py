"""Calls of the project's functions per message, in the thread of a server's event loop.

Each scenario has a server with a rosbridge client in the same event loop, which sends one message after the
other with a pause between. Functions with fewer than nine calls for ten messages, such as timers, are listed
as background. A generator or coroutine that goes on counts as a call, as it does for :func:`sys.setprofile`.

As a program it prints the calls of one scenario as JSON: ``python -m tools.size.calls publish .``.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from collections.abc import Iterable, Mapping
from contextlib import AsyncExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Final, Self

from tools.size.layout import ROOT, Layout, within

if TYPE_CHECKING:
    from websockets.asyncio.client import ClientConnection

MESSAGES: Final = 200
WARM_UP: Final = 100
"""Messages before those that are counted."""

PAUSE_SECONDS: Final = 0.01
"""Pause after each message, in which the server does what it does in later turns of the loop."""

STARTUP_SECONDS: Final = 1.0

_TYPE: Final = "geometry_msgs/Twist"
_RULE: Final = {
    "topics": ["/cmd_vel"],
    "lease": {"seconds": 5.0},
    "stop": {},
    "fields": {"linear.x": {"min": -0.3, "max": 0.8}},
}


@dataclass(frozen=True, slots=True)
class Scenario:
    """One way of a message through the server.

    Attributes:
        title: what is sent, and who receives it.
        service: true if services are called; else Twist messages are published, and another client
            subscribes.
        in_process: true if a node in the process subscribes, too.
        settings: settings of the server.
    """

    title: str
    service: bool = False
    in_process: bool = False
    settings: Mapping[str, object] = field(default_factory=dict)


SCENARIOS: Final[Mapping[str, Scenario]] = {
    "publish": Scenario("publish, one client subscribes"),
    "rate limit": Scenario(
        "publish by a client with a rate limit, one client subscribes",
        settings={"limits": {"messages_per_second": 1000}},
    ),
    "subscriber": Scenario("publish, one client and a node in the process subscribe", in_process=True),
    "service": Scenario("call of a service in the process", service=True),
    "gate": Scenario(
        "publish through a gate with a lease and a field rule, one client subscribes",
        settings={"gate": {"rules": {"drive": _RULE}}},
    ),
}


@dataclass(frozen=True, slots=True)
class FunctionCalls:
    """Calls of one function.

    Attributes:
        file: source file.
        line: line of the definition.
        function: qualified name.
        depth: number of the project's functions around its first call.
        calls: number of calls.
    """

    file: str
    line: int
    function: str
    depth: int
    calls: int


@dataclass(frozen=True)
class CallCounts:
    """Calls of functions while a number of messages was handled.

    Attributes:
        messages: number of messages.
        functions: in the order of the first call.
    """

    messages: int
    functions: tuple[FunctionCalls, ...]

    @property
    def steady(self) -> tuple[FunctionCalls, ...]:
        """Functions that are called for each message, or nearly each."""
        return tuple(each for each in self.functions if each.calls * 10 >= self.messages * 9)

    @property
    def background(self) -> tuple[FunctionCalls, ...]:
        """All other functions."""
        return tuple(each for each in self.functions if each.calls * 10 < self.messages * 9)

    @property
    def files(self) -> int:
        """Number of files of the steady functions."""
        return len({each.file for each in self.steady})

    @property
    def classes(self) -> int:
        """Number of classes of the steady functions."""
        owners = {(each.file, each.function.rpartition(".")[0]) for each in self.steady}
        return sum(bool(owner) and not owner.endswith("<locals>") for _, owner in owners)

    def per_message(self, functions: Iterable[FunctionCalls]) -> float:
        """Return the calls of some functions per message."""
        return round(sum(each.calls for each in functions) / self.messages, 2)


class CallCounter:
    """Counter of the calls, in the current thread, of functions defined in some folders, within a block.

    Args:
        folders: folders of source.
    """

    def __init__(self, folders: Iterable[Path]) -> None:
        self._folders = tuple(folders)
        self._ours: dict[str, bool] = {}
        self._found: dict[tuple[str, int, str], list[int]] = {}
        self._depth = 0

    def __enter__(self) -> Self:
        sys.setprofile(self._on_event)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)

    def counts(self, messages: int) -> CallCounts:
        """Return the calls so far."""
        return CallCounts(
            messages,
            tuple(
                FunctionCalls(file, line, name, depth, calls)
                for (file, line, name), (depth, calls) in self._found.items()
            ),
        )

    def _on_event(self, frame: FrameType, event: str, _: object) -> None:
        if event not in ("call", "return"):
            return
        code = frame.f_code
        ours = self._ours.get(code.co_filename)
        if ours is None:
            ours = self._ours[code.co_filename] = within(code.co_filename, self._folders)
        if not ours:
            return
        if event == "return":
            # Functions that were running when the block was entered return, too.
            self._depth = max(0, self._depth - 1)
            return
        key = (code.co_filename, code.co_firstlineno, code.co_qualname)
        self._found.setdefault(key, [self._depth, 0])[1] += 1
        self._depth += 1


def measure(layout: Layout, name: str) -> CallCounts:
    """Run one of :data:`SCENARIOS` in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", __name__, name, str(layout.root)],
        cwd=ROOT,
        env=layout.environment(),
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    found = json.loads(done.stdout)
    return CallCounts(found["messages"], tuple(FunctionCalls(**each) for each in found["functions"]))


async def run(scenario: Scenario, folders: Iterable[Path]) -> CallCounts:
    """Count the calls of one scenario."""
    from websockets.asyncio.client import connect

    from rwt import Server, Settings

    settings = Settings.model_validate(scenario.settings)
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(Server("ws://127.0.0.1:0", settings=settings))
        client, viewer = [
            await stack.enter_async_context(connect(server.urls[0], compression=None)) for _ in range(2)
        ]
        node = server.node("robot")
        if scenario.service:
            node.advertise_service("/add", "example_interfaces/AddTwoInts", _add)
        else:
            await _say(client, op="advertise", topic="/cmd_vel", type=_TYPE)
            await _say(viewer, op="subscribe", topic="/cmd_vel", type=_TYPE)
        if scenario.in_process:
            node.subscribe("/cmd_vel", _ignore, _TYPE)
        counter = CallCounter(folders)
        await asyncio.sleep(STARTUP_SECONDS)
        for number in range(WARM_UP):
            await _exchange(scenario, client, viewer, number)
        with counter:
            for number in range(MESSAGES):
                await _exchange(scenario, client, viewer, number)
        return counter.counts(MESSAGES)


def _add(request: Any) -> dict[str, int]:
    return {"sum": request.a + request.b}


def _ignore(_: object) -> None:
    """Do nothing: the message is decoded by then."""


async def _say(client: ClientConnection, **op: object) -> None:
    await client.send(json.dumps(op))


async def _exchange(
    scenario: Scenario, client: ClientConnection, viewer: ClientConnection, number: int
) -> None:
    """Send one message, and wait for the response or for the subscriber."""
    if scenario.service:
        await _say(client, op="call_service", service="/add", id=str(number), args={"a": 1, "b": number})
        answer = await client.recv()
    else:
        velocity = {
            "linear": {"x": number / 1000, "y": 0.0, "z": 0.0},
            "angular": {"x": 0.0, "y": 0.0, "z": 0.5},
        }
        await _say(client, op="publish", topic="/cmd_vel", msg=velocity)
        answer = await viewer.recv()
    if json.loads(answer)["op"] not in ("publish", "service_response"):
        raise RuntimeError(f"the server answers {answer!r}")
    await asyncio.sleep(PAUSE_SECONDS)


if __name__ == "__main__":
    packages = Layout(Path(sys.argv[2])).packages
    counts = asyncio.run(run(SCENARIOS[sys.argv[1]], packages.values()))
    json.dump(asdict(counts), sys.stdout)
