"""Harnesses of the project's own backends."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import anyio

from rwt_graph import MemoryGraph
from rwt_interfaces.distro import NOETIC
from rwt_interfaces.registry import Registry
from tests.contract.graph.harness import Harness
from tests.contract.graph.paired import PairedGraph
from tests.processes import free_port

if TYPE_CHECKING:
    import pytest

    from rwt_graph import SimulatedClock


class MemoryHarness(Harness):
    def __init__(self) -> None:
        super().__init__()
        self.graph = MemoryGraph(Registry(), self.clock)

    async def settle(self) -> None:
        await anyio.wait_all_tasks_blocked()


class LoneZenohHarness(MemoryHarness):
    """A graph over Zenoh that nobody has joined: everything happens in memory."""

    def __init__(self) -> None:
        super().__init__()
        from rwt.extensions.zenoh import ZenohGraph

        self.graph = ZenohGraph(Registry(), self.clock)


class LoneRos1Harness(MemoryHarness):
    """A graph that is a ROS 1 master, and that nobody has joined."""

    #: Tests that spell types and times as ROS 2 does, or count the nodes.
    differences: ClassVar = {
        "test_another_type_is_refused_whoever_comes_first": "names of types have two parts",
        "test_nodes_and_what_they_take_part_in": "a master has the node /rosout",
        "test_rosout_and_clock_exist_without_any_node": "the type of /rosout is another one",
        "test_subscriber_count_and_endpoints": "names of types have two parts",
        "test_the_clock_is_published_as_it_moves": "the fields of a time have other names",
    }

    def __init__(self) -> None:
        super().__init__()
        from rwt.extensions.ros1 import Ros1Graph

        self.graph = Ros1Graph(Registry(NOETIC), self.clock, master=f"ros1-master://127.0.0.1:{free_port()}")


class ZenohHarness(Harness):
    """Two graphs over Zenoh: providers in one, consumers in the other."""

    def __init__(self) -> None:
        super().__init__()
        self.graph = self._pair = ZenohPair(self.clock)

    def patch(self, monkeypatch: pytest.MonkeyPatch) -> None:
        from rwt.extensions.zenoh import topics

        # Everything in the order in which it came, so that `settle` can tell when it has.
        monkeypatch.setattr(topics, "belongs_to_action", lambda _topic: True)

    async def settle(self) -> None:
        await self._pair.ripple.settle()


class ZenohPair(PairedGraph):
    """Two graphs over Zenoh, each connected to the other."""

    def __init__(self, clock: SimulatedClock) -> None:
        from rwt.extensions.zenoh import ZenohGraph
        from tests.zenoh_links import QUICK, Counting, Ripple, free_endpoint

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
        super().__init__()
        from tests.contract.graph.ros2_pair import Ros2Pair

        self.graph = self._pair = Ros2Pair(self.clock)

    async def settle(self) -> None:
        await self._pair.settle()
