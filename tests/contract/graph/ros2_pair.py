"""Two graphs on a real ROS 2, in one process; only where its `rclpy` is installed."""

from __future__ import annotations

import importlib.util
import os
from typing import TYPE_CHECKING, Any

import anyio

from rwt_interfaces.registry import Registry
from tests.contract.graph.paired import PairedGraph
from tests.waiting import PATIENCE

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt.extensions.ros2 import Ros2Graph
    from rwt_graph.clock import SimulatedClock

HAS_ROS = importlib.util.find_spec("rclpy") is not None and "AMENT_PREFIX_PATH" in os.environ

#: Seconds without any sample or change, after which nothing is on the way: DDS has no mark of an end.
_QUIET_SECONDS = 0.15


class Ros2Pair(PairedGraph):
    """Two graphs on ROS 2, each a participant of its own."""

    def __init__(self, clock: SimulatedClock) -> None:
        from rwt.extensions.ros2 import Ros2Graph, add_installed
        from rwt.extensions.ros2.ament import installed_release

        registry = Registry(installed_release())
        add_installed(registry)

        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        domain = 101 + os.getpid() % 100
        pair = Ros2Graph(registry, clock, domain=domain), Ros2Graph(registry, clock, domain=domain)
        super().__init__(*pair)
        self._activity = 0
        for graph in pair:
            self._count(graph)

    def _count(self, graph: Ros2Graph) -> None:
        run = graph.run_on_graph

        def counted(call: Callable[[], None]) -> None:
            self._activity += 1
            run(call)

        graph.run_on_graph = counted  # type: ignore[method-assign]  # wrapped, to count changes of discovery

    async def start(self) -> None:
        graph: Any
        for graph in (self.provider, self.consumer):
            wakeups = graph._connection.wakeups
            for wakeup in wakeups._wakeups.values():
                self._watch(wakeup)
            add = wakeups.add

            def watched(kind: object, endpoint: object, drain: object, add: Any = add) -> object:
                wakeup = add(kind, endpoint, drain)
                self._watch(wakeup)
                return wakeup

            wakeups.add = watched
        await self.settle()

    def _watch(self, wakeup: Any) -> None:
        drain = wakeup.drain

        def counted(until: float) -> bool:
            self._activity += 1
            return bool(drain(until))

        wakeup.drain = counted

    async def settle(self) -> None:
        """Return when nothing has happened for a while."""
        with anyio.fail_after(PATIENCE):
            quiet = 0.0
            while quiet < _QUIET_SECONDS:
                before = self._activity
                await anyio.sleep(0.01)
                quiet = quiet + 0.01 if before == self._activity else 0.0
