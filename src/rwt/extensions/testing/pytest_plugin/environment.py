"""Environment of one test: a graph in its own thread, a robot, a server, and the wire between."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cached_property

import pytest
from anyio.from_thread import BlockingPortal, start_blocking_portal

from rwt.access.settings import SettingsError
from rwt.extensions.testing import ObservedGraph, ObservedWire, ScriptedRobot
from rwt.extensions.testing.expectations import TIMEOUT_SECONDS, block_until, wait_until
from rwt.extensions.testing.pytest_plugin.options import Options
from rwt.extensions.testing.virtual_time import VirtualTime
from rwt.server import Server
from rwt.settings.models import Settings
from rwt.settings.sources import Given, from_text, load_settings
from rwt_graph.clock import SimulatedClock

#: Start of virtual time, nanoseconds since the epoch. Not 0, which means "no time yet" in ROS.
EPOCH_NS = 1_700_000_000_000_000_000

#: Open environments: that of the test, and those of fixtures with a longer scope.
_OPEN: list[Environment] = []

_ANY_PORT = "ws://127.0.0.1:0"


class RobotServer:
    """Rosbridge server on a free port of this machine.

    Attributes:
        url: ``ws://127.0.0.1:PORT``.
        host: ``127.0.0.1``.
        faults: faults of the wire.
        transcript: transcript of the wire.
    """

    def __init__(self, url: str, wire: ObservedWire) -> None:
        self.url = url
        self.host, _, port = url.removeprefix("ws://").partition(":")
        self.port = int(port)
        self.faults = wire.faults
        self.transcript = wire.transcript
        self._wire = wire

    @property
    def client_count(self) -> int:
        """Number of connected clients."""
        return self._wire.client_count

    def wait_for_clients(self, count: int = 1, within: float = TIMEOUT_SECONDS) -> None:
        """Block until exactly `count` clients are connected.

        Args:
            within: timeout in seconds of real time.

        Raises:
            AssertionError: timeout.
            BlockingWait: called from a coroutine.
        """
        __tracebackhide__ = True
        instead = "use `await rwt_server.until_clients(...)`"
        block_until(lambda: self.client_count == count, within, lambda: self._count(count, within), instead)

    async def until_clients(self, count: int = 1, within: float = TIMEOUT_SECONDS) -> None:
        """Like :meth:`wait_for_clients`, for coroutines."""
        __tracebackhide__ = True
        await wait_until(lambda: self.client_count == count, within, lambda: self._count(count, within))

    def _count(self, count: int, within: float) -> str:
        return f"{self.client_count} clients are connected after {within:g} s, where {count} should be"


class Environment:
    """Objects that the fixtures of one test share. The robot is created on first use."""

    def __init__(
        self, url: str, wire: ObservedWire, graph: ObservedGraph, portal: BlockingPortal, stack: ExitStack
    ) -> None:
        self.graph = graph
        self.wire = wire
        self.server = RobotServer(url, wire)
        self._portal = portal
        self._stack = stack

    @property
    def virtual_time(self) -> VirtualTime:
        """Clock that the test moves."""
        clock = self.graph.clock
        if not isinstance(clock, SimulatedClock):
            raise pytest.UsageError(
                "rwt_clock must be an argument of the test or of a fixture that it names, so that the robot"
                " is made with it; request.getfixturevalue comes too late"
            )
        return VirtualTime(clock, self._portal)

    @cached_property
    def robot(self) -> ScriptedRobot:
        """Scripted robot, named `robot`."""
        robot = ScriptedRobot(self.graph)
        self._stack.callback(robot.close)
        return robot


@contextmanager
def open_environment(options: Options) -> Iterator[Environment]:
    """Run a graph and a server in a thread until the block is left. The thread has then ended.

    For fixtures with a longer scope than one test.

    Raises:
        UsageError: a setting or an interface file is invalid.
    """
    settings = _settings(options)
    clock = SimulatedClock(EPOCH_NS) if options.virtual else None
    with ExitStack() as stack:
        portal = stack.enter_context(start_blocking_portal("asyncio", name="rwt robot"))
        try:
            server = Server(
                _ANY_PORT,
                settings=settings,
                graph=ObservedGraph,
                clock=clock,
                middleware=lambda accept: wire.middleware(accept),
            )
            graph = server.graph
            assert isinstance(graph, ObservedGraph), "the class that the server was given"
            wire = ObservedWire(graph, bson=settings.bson_only_mode)
            stack.enter_context(portal.wrap_async_context_manager(server))
        except SettingsError as error:
            raise pytest.UsageError(f"rwt_settings: {error}") from None
        environment = Environment(server.urls[0], wire, graph, portal, stack)
        _OPEN.append(environment)
        try:
            yield environment
        finally:
            _OPEN.remove(environment)


def transcripts(most: int) -> list[str]:
    """Return the last `most` lines of each open transcript, for the report of a failing test."""
    texts = [environment.wire.transcript.text(most) for environment in _OPEN] if most else []
    return [text for text in texts if text]


def _settings(options: Options) -> Settings:
    """Return the server's settings; those from the ini file are strings, those from markers are values."""
    given = []
    marked = {"demo": options.demo, "interfaces": options.interfaces, "distro": options.distro}
    try:
        for dotted, value in options.settings.items():
            key = tuple(dotted.split("."))
            if isinstance(value, str):
                given.append(from_text(key, value, "pytest"))
            else:
                given.append(Given(key, value, "pytest"))
        given += [Given((key,), value, "pytest") for key, value in marked.items() if value]
        return load_settings(command_line=tuple(given)).settings
    except SettingsError as error:
        raise pytest.UsageError(f"rwt_settings: {error}") from None
