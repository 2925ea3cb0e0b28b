"""The backends that sign the contract, each with how to wait until it has nothing left to deliver."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Callable

import anyio
import pytest

from rwt.extensions.ros1 import Ros1Graph
from rwt.extensions.zenoh import ZenohGraph
from rwt.extensions.zenoh import topics as zenoh_topics
from rwt_graph import MemoryGraph, SimulatedClock
from rwt_graph.api import GoalEvents, Graph
from rwt_interfaces.distro import NOETIC
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_participant.errors import CallFailed
from rwt_participant.goals import GoalStatus
from rwt_participant.messages import Message
from tests.contract.graph.paired import PairedGraph
from tests.contract.graph.ros2_pair import DIFFERENCES, HAS_ROS, UNSTABLE, Ros2Pair
from tests.processes import free_port
from tests.zenoh_links import QUICK, Counting, Ripple, free_endpoint


class Harness(ABC):
    """A running graph of one backend, and the messages that the tests send through it."""

    graph: Graph
    clock: SimulatedClock
    fibonacci = "example_interfaces/Fibonacci"

    @abstractmethod
    async def settle(self) -> None:
        """Return when everything that was sent has arrived."""

    async def advance(self, seconds: float) -> None:
        """Let time go by, then settle."""
        self.clock.advance(seconds)
        await self.settle()

    def message(self, name: str, value: object) -> Payload:
        return Payload.from_value(self.graph.registry.message(name), value)

    def text(self, data: str) -> Payload:
        """A `std_msgs/String`."""
        return self.message("std_msgs/String", {"data": data})

    def request(self) -> Payload:
        return Payload.from_value(self.graph.registry.service("std_srvs/Trigger").request, {})

    def response(self, message: str = "", success: bool = True) -> Payload:
        response = self.graph.registry.service("std_srvs/Trigger").response
        return Payload.from_value(response, {"success": success, "message": message})

    def goal(self, order: int = 1) -> Payload:
        return Payload.from_value(self.graph.registry.action(self.fibonacci).goal, {"order": order})

    def sequence(self, *numbers: int, part: str = "result") -> Payload:
        interface = self.graph.registry.action(self.fibonacci)
        kind = interface.result if part == "result" else interface.feedback
        return Payload.from_value(kind, {"sequence": list(numbers)})


class MemoryHarness(Harness):
    def __init__(self) -> None:
        self.clock = SimulatedClock(start_ns=1_000_000_000)
        self.graph = MemoryGraph(Registry(), self.clock)

    async def settle(self) -> None:
        await anyio.wait_all_tasks_blocked()


class LoneZenohHarness(MemoryHarness):
    """A graph over Zenoh that nobody has joined: everything happens in memory."""

    def __init__(self) -> None:
        self.clock = SimulatedClock(start_ns=1_000_000_000)
        self.graph = ZenohGraph(Registry(), self.clock)


class LoneRos1Harness(MemoryHarness):
    """A graph that is a ROS 1 master, and that nobody has joined."""

    def __init__(self) -> None:
        self.clock = SimulatedClock(start_ns=1_000_000_000)
        master = f"ros1-master://127.0.0.1:{free_port()}"
        self.graph = Ros1Graph(Registry(NOETIC), self.clock, master=master)


class ZenohHarness(Harness):
    """Two graphs over Zenoh: providers in one, consumers in the other."""

    def __init__(self) -> None:
        self.clock = SimulatedClock(start_ns=1_000_000_000)
        self.graph = self._pair = ZenohPair(self.clock)

    async def settle(self) -> None:
        await self._pair.ripple.settle()


class ZenohPair(PairedGraph):
    """Two graphs over Zenoh, each connected to the other."""

    def __init__(self, clock: SimulatedClock) -> None:
        registry, endpoint = Registry(), free_endpoint()
        provider = ZenohGraph(registry, clock, listen=[endpoint], config=QUICK)
        consumer = ZenohGraph(registry, clock, connect=[endpoint], config=QUICK)
        super().__init__(provider, consumer)
        self.ripple = Ripple((provider, consumer), (Counting(provider), Counting(consumer)))

    async def start(self) -> None:
        await self.ripple.start()


class Ros2Harness(Harness):
    """Two graphs on ROS 2: providers in one, consumers in the other."""

    fibonacci = "test_msgs/Fibonacci"

    def __init__(self) -> None:
        self.clock = SimulatedClock(start_ns=1_000_000_000)
        self.graph = self._pair = Ros2Pair(self.clock)

    async def settle(self) -> None:
        await self._pair.settle()


#: Tests that spell types and times as ROS 2 does, or count the nodes.
OF_ROS2 = {
    "test_another_type_is_refused_whoever_comes_first": "names of types have two parts",
    "test_nodes_and_what_they_take_part_in": "a master has the node /rosout",
    "test_rosout_and_clock_exist_without_any_node": "the type of /rosout is another one",
    "test_subscriber_count_and_endpoints": "names of types have two parts",
    "test_the_clock_is_published_as_it_moves": "the fields of a time have other names",
}

#: A backend over the network adds itself here.
BACKENDS: dict[str, Callable[[], Harness]] = {
    "memory": MemoryHarness,
    "ros1-alone": LoneRos1Harness,
    "zenoh": ZenohHarness,
    "zenoh-alone": LoneZenohHarness,
}
if HAS_ROS:
    BACKENDS["ros2"] = Ros2Harness


def _case(test: pytest.Function) -> str:
    """Return the name of a test, with its parameter `how` if it has one."""
    how = test.callspec.params.get("how")
    return test.originalname if how is None else f"{test.originalname}[{how}]"


@pytest.fixture(params=sorted(BACKENDS))
async def harness(
    request: pytest.FixtureRequest, anyio_backend: object, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[Harness]:
    # Everything in the order in which it came, so that `settle` can tell when it has.
    monkeypatch.setattr(zenoh_topics, "belongs_to_action", lambda _topic: True)
    if request.param == "ros2" and (why := UNSTABLE.get(request.node.originalname)):
        pytest.skip(why)
    if request.param == "ros2" and (why := DIFFERENCES.get(_case(request.node))):
        request.applymarker(pytest.mark.xfail(reason=why))
    if request.param == "ros1-alone" and (why := OF_ROS2.get(request.node.originalname)):
        request.applymarker(pytest.mark.xfail(reason=why))
    made = BACKENDS[request.param]()
    async with made.graph:
        yield made


class GoalDiary:
    """Writes down what the client of a goal hears."""

    def __init__(self) -> None:
        self.heard: list[object] = []

    @property
    def events(self) -> GoalEvents:
        return GoalEvents(self._result, self._feedback, lambda: self.heard.append("accepted"))

    def _feedback(self, feedback: Payload) -> None:
        message: Message = feedback.value()
        self.heard.append(message.sequence)

    def _result(self, status: GoalStatus, outcome: Payload | CallFailed) -> None:
        self.heard.append((status, outcome))


@pytest.fixture
def diary() -> GoalDiary:
    return GoalDiary()
