"""Node of one vehicle: its topics and services."""

from __future__ import annotations

from collections.abc import Callable

from rwt_graph import Graph, Node
from rwt_mavlink.endpoints.commands import CommandServices
from rwt_mavlink.endpoints.parameters import ParameterServices
from rwt_mavlink.endpoints.plans import PlanServices
from rwt_mavlink.endpoints.setpoints import Setpoints
from rwt_mavlink.endpoints.status import StatusTopics
from rwt_mavlink.endpoints.telemetry import publish_telemetry
from rwt_mavlink.settings import MavlinkSettings
from rwt_mavlink.vehicle import Vehicle


class VehicleNode:
    """Node of a vehicle, in its namespace.

    Args:
        graph: running graph.
        vehicle: the vehicle.
        settings: settings of the station.
        station_problem: returns why the station may not command vehicles; empty if it may.

    Attributes:
        vehicle: the vehicle.
    """

    def __init__(
        self,
        graph: Graph,
        vehicle: Vehicle,
        settings: MavlinkSettings,
        station_problem: Callable[[], str],
    ) -> None:
        self.vehicle = vehicle
        prefix = settings.namespace_of(vehicle.exchange.target.system)
        namespace, _, name = prefix.rpartition("/")
        self._node = Node(graph, name, namespace or "/")
        publish_telemetry(self._node, prefix, vehicle)
        self._status = StatusTopics(self._node, prefix, vehicle, station_problem)
        self._setpoints = Setpoints(self._node, prefix, vehicle, settings)
        self._parameters = ParameterServices(graph, prefix, vehicle)
        CommandServices(self._node, prefix, vehicle)
        PlanServices(self._node, prefix, vehicle)

    def close(self) -> None:
        """Leave the graph."""
        self._setpoints.close()
        self._status.close()
        self._parameters.close()
        self._node.close()
