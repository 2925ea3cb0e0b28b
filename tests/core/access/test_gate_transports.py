"""The model of the gate over real connections: WebSocket, WebRTC, a hub, ASGI and agents, one server for all.

The environment variable `GATE_MODEL_EXAMPLES` is the number of runs; a hundredth of them runs here.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Mapping
from contextlib import AbstractAsyncContextManager, suppress
from typing import Any, TypeVar, cast

import pytest
import uvicorn
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import MultipleResults, initialize, multiple, rule
from mcp import MCPError

from rwt import Server
from rwt.access.access import Access
from rwt.access.audit import Audit
from rwt.access.gate.record import Recorder
from rwt.access.settings import AuditSettings, GateSettings
from rwt.extensions.hub.hub import open_hub
from rwt.extensions.hub.part import DialSettings
from rwt.settings.models import Settings
from rwt_client import connect
from rwt_graph import MemoryGraph, SimulatedClock
from rwt_participant.errors import RobotError
from rwt_participant.timers import Timer
from rwt_webrtc.settings import WebRtcSettings
from tests.core.access.gate_model import LIMITS
from tests.core.access.gated_robot import GATE, TWIST, GatedRobot, settings_of, token
from tests.core.access.test_gate_interleavings import CREDENTIALS, EXAMPLES, GateMachine, JumpingClock, Wire
from tests.extensions.mcp.agents import agent_at
from tests.waiting import until

pytestmark = pytest.mark.slow

TRANSPORTS = ("websocket", "webrtc", "hub", "asgi", "mcp")
PATIENCE = 30.0
T = TypeVar("T")


class LoopClock(JumpingClock):
    """Simulated clock of an event loop: what is due at once runs in the loop's next turn."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__(1_700_000_000 * 10**9)
        self._loop = loop

    def call_later(self, delay: float, call: Callable[[], None]) -> Timer:
        if delay > 0:
            return super().call_later(delay, call)
        return cast("Timer", self._loop.call_soon(call))  # It can be cancelled, too.

    def advance(self, seconds: float) -> None:
        async def go() -> None:
            SimulatedClock.advance(self, seconds)

        self._loop.run_until_complete(go())


class Held:
    """Context manager that is entered and left by a task of its own, since it has a task group."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._end = asyncio.Event()
        self._task: asyncio.Task[None] | None = None

    def enter(self, context: AbstractAsyncContextManager[T]) -> T:
        """Enter it, and return what it returns."""
        entered: asyncio.Future[T] = self._loop.create_future()

        async def hold() -> None:
            try:
                async with context as value:
                    entered.set_result(value)
                    await self._end.wait()
            except BaseException as error:
                if entered.done():
                    raise
                entered.set_exception(error)

        self._task = self._loop.create_task(hold())
        return self._loop.run_until_complete(asyncio.wait_for(entered, PATIENCE))

    def leave(self) -> None:
        """Leave it."""
        self._end.set()
        assert self._task is not None  # Entered before.
        self._loop.run_until_complete(asyncio.wait_for(self._task, PATIENCE))


class NotingRecorder(Recorder):
    """Recorder that keeps the texts of rejections, over whichever protocol."""

    def __init__(self, clock: SimulatedClock, refusals: list[str]) -> None:
        super().__init__(AuditSettings(), Audit(), clock)
        self._refusals = refusals

    def note(self, *event: Any, **more: Any) -> None:
        if event[0] == "refused":
            self._refusals.append(event[4])
        super().note(*event, **more)


class ServedRobot(GatedRobot):
    """Robot of a running server."""

    def __init__(self, loop: asyncio.AbstractEventLoop, gate: Mapping[str, Any], **others: Any) -> None:
        self.loop = loop
        self._held: list[Held] = []
        self.hub = self.enter(open_hub("ws://127.0.0.1:0"))
        self.clock = LoopClock(loop)
        settings = settings_of(
            gate,
            listen=("ws://127.0.0.1:0",),
            dial=DialSettings(urls=(f"{self.hub.url}/robots/rosie",)),
            gateways=("mcp",),
            webrtc=WebRtcSettings(enabled=True),
            **others,
        )
        self._settings = settings
        self.server = Server(settings=settings, clock=self.clock, reload=lambda: self._settings)
        assert isinstance(self.server.graph, MemoryGraph)
        self.graph = self.server.graph
        self.node = self.server.node("robot")
        self.heard = []
        self.samples = []
        self.graph.participant("/base").subscribe(
            "/cmd_vel", self._on_sample, self.graph.registry.message(TWIST)
        )
        self.node.advertise_service("/barrier", "std_srvs/Trigger", lambda _: {"success": True})
        app = uvicorn.Config(self.server.asgi(), port=0, log_level="critical", lifespan="off")
        self.enter(self.server)
        self.access: Access = self.server.bridge.access
        self.refusals: list[str] = []
        self.gate.recorder = NotingRecorder(self.clock, self.refusals)
        self._asgi = asgi = uvicorn.Server(app)
        self._serving = loop.create_task(asgi.serve())
        self.until(lambda: asgi.started)
        self.until(lambda: any(each.is_reachable for each in self.hub.robots))
        (self.asgi_port,) = (sock.getsockname()[1] for server in asgi.servers for sock in server.sockets)

    def enter(self, context: AbstractAsyncContextManager[T]) -> T:
        """Enter a context manager until the robot is closed."""
        self._held.append(Held(self.loop))
        return self._held[-1].enter(context)

    def run(self, act: Awaitable[T]) -> T:
        """Await a coroutine or a task on the event loop."""
        return self.loop.run_until_complete(asyncio.wait_for(act, PATIENCE))

    def until(self, condition: Callable[[], object]) -> None:
        """Run the event loop until a condition holds."""
        self.run(until(condition))

    def reload(self, gate: GateSettings) -> None:
        """Reload the settings, with another gate."""
        self._settings = self._settings.model_copy(update={"gate": gate})

        async def reload() -> None:
            self.server.reload()

        self.run(reload())

    def url(self, transport: str, credential: str) -> str:
        """Return the URL of a transport, with the token of a credential."""
        port = self.server.urls[0].rpartition(":")[2]
        urls = {
            "websocket": f"ws://127.0.0.1:{port}/",
            "webrtc": f"webrtc+http://127.0.0.1:{port}/",
            "hub": f"{self.hub.url}/rosie",
            "asgi": f"ws://127.0.0.1:{self.asgi_port}/",
        }
        return f"{urls[transport]}?token={token(credential)}"

    def close(self) -> None:
        """End the servers."""
        self._asgi.should_exit = True
        self.run(self._serving)
        for held in reversed(self._held):
            held.leave()


class ConnectedWire(Wire):
    """Client of rosbridge over a transport."""

    def __init__(self, robot: ServedRobot, transport: str, credential: str) -> None:
        super().__init__(credential)
        self._robot = robot
        known = set(robot.gate.actors)
        self._held = Held(robot.loop)
        url = robot.url(transport, credential)
        self.client = self._held.enter(connect(url, reconnect=None, fetch_types=False, ros_version=2))
        (self.person.name,) = set(robot.gate.actors) - known
        self._waiting: set[asyncio.Task[Any]] = set()

    def publish(self, message: dict[str, Any]) -> str:
        self._robot.refusals.clear()

        async def publish() -> None:
            self.client.publish("/cmd_vel", message, TWIST)
            await self.client.call("/barrier", type="std_srvs/Trigger")

        self._robot.run(publish())
        return " ".join(self._robot.refusals)

    def ask(self, service: str, arguments: dict[str, object]) -> dict[str, Any] | None:
        kind = self._robot.graph.service(service)
        assert kind is not None

        async def ask() -> Any:
            with suppress(RobotError):
                return await self.client.call(service, arguments, kind.type.name)

        if service == "/blink":  # It waits for approval.
            self._waiting.add(self._robot.loop.create_task(ask()))
            self._robot.run(self.client.call("/barrier", type="std_srvs/Trigger"))
            return None
        answer = self._robot.run(ask())
        return None if answer is None else {name: getattr(answer, name) for name in answer.__struct_fields__}

    def leave(self) -> bool:
        self._held.leave()
        self._robot.until(lambda: self.person.name not in self._robot.gate.actors)
        return True


class AgentWire(Wire):
    """Agent, each of whose requests is a client of the gate."""

    is_request = True

    def __init__(self, robot: ServedRobot, credential: str) -> None:
        super().__init__(credential)
        self._robot = robot
        self._held = Held(robot.loop)
        url = robot.server.urls[0].replace("ws:", "http:") + "/mcp"
        self.agent = self._held.enter(agent_at(url, token=token(credential)))

    def _call(self, tool: str, arguments: dict[str, object]) -> Any:
        return self._robot.run(self.agent.call_tool(tool, arguments))

    def publish(self, message: dict[str, Any]) -> str:
        answer = self._call("publish", {"topic": "/cmd_vel", "message": message})
        return str(answer.content) if answer.is_error else ""

    def ask(self, service: str, arguments: dict[str, object]) -> dict[str, Any] | None:
        try:
            answer = self._call("call_service", {"service": service, "request": arguments})
        except MCPError:  # Too many requests.
            return None
        values: dict[str, Any] | None = None if answer.is_error else json.loads(answer.content[0].text)
        return values

    def leave(self) -> bool:
        self._held.leave()
        return True


class ServedGateMachine(GateMachine):
    """Robot of a running server, and the model of its gate."""

    gateways = TRANSPORTS
    wires = GateMachine.wires

    @initialize(target=wires, take=st.sampled_from(["publish", "service"]))
    def start(self, take: str) -> MultipleResults[Wire]:
        self.loop = asyncio.new_event_loop()
        self.open: list[Wire] = []
        return multiple(*self._start(take))

    def _make_robot(self) -> GatedRobot:
        self.served = ServedRobot(self.loop, self._gate(LIMITS[0]))
        return self.served

    def _serve(self) -> None:
        """No-op: the server runs."""

    @rule(
        target=wires,
        credential=st.sampled_from(sorted(CREDENTIALS)),
        gateway=st.sampled_from(TRANSPORTS),
    )
    def connect(self, credential: str, gateway: str) -> Wire:
        return self._connect(credential, gateway)

    def _connect(self, credential: str, gateway: str) -> Wire:
        wire: Wire
        if gateway == "mcp":
            wire = AgentWire(self.served, credential)
        else:
            wire = ConnectedWire(self.served, gateway, credential)
        self.open.append(wire)
        return wire

    def _reload(self, changed: Settings) -> None:
        self.served.reload(changed.gate)

    def teardown(self) -> None:
        if hasattr(self, "served"):
            for wire in self.open:
                wire.leave()
            self.served.close()
            self.loop.close()


TestServedGateModel = ServedGateMachine.TestCase
TestServedGateModel.settings = settings(
    max_examples=max(2, EXAMPLES // 100),
    stateful_step_count=40,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_a_stop_has_no_quota(transport: str) -> None:
    loop = asyncio.new_event_loop()
    rules = {"drive": {"topics": ["/cmd_vel"], "stop": {}, "emergency": True}}
    robot = ServedRobot(loop, {"rules": rules}, limits={"calls": 1}, mcp={"requests": 1})
    asked: list[object] = []

    async def never(request: object) -> dict[str, object]:
        asked.append(request)
        await asyncio.sleep(3600)
        return {}

    async def wait_for_ever() -> None:
        with suppress(RobotError, asyncio.CancelledError):
            if isinstance(wire, AgentWire):
                await wire.agent.call_tool("call_service", {"service": "/never", "request": {}})
            else:
                await wire.client.call("/never", type="std_srvs/Trigger")

    robot.node.advertise_service("/never", "std_srvs/Trigger", never)
    wire = AgentWire(robot, "operator") if transport == "mcp" else ConnectedWire(robot, transport, "operator")
    waiting = loop.create_task(wait_for_ever())
    robot.until(lambda: asked)
    assert wire.ask("/barrier", {}) is None, "its quota is used up"
    wire.ask("/gate/stop", {"reason": "now"})
    assert robot.gate.stopped_by
    assert robot.heard[-1] == (0.0, GATE)
    waiting.cancel()
    wire.leave()
    robot.close()
    loop.close()
