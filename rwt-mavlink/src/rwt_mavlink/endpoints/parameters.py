"""Parameters of a vehicle: services of mavros, and the parameters of a node."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from rwt_graph import Graph, Node
from rwt_mavlink.link.frames import MavlinkMessage
from rwt_mavlink.protocol.errors import Rejected, VehicleError
from rwt_mavlink.protocol.parameters import Parameter
from rwt_mavlink.vehicle import Vehicle
from rwt_participant.errors import ParameterRejected
from rwt_participant.messages import Message, ParameterValue

#: Numbers of rcl_interfaces/ParameterType.
_INTEGER: Final = 2
_DOUBLE: Final = 3


class ParameterServices:
    """Node `param` of one vehicle, whose parameters are those of the vehicle after the first pull.

    Setting one of them sets it on the vehicle, and fails unless the vehicle confirms the value.

    Args:
        graph: running graph.
        prefix: namespace of the vehicle.
        vehicle: the vehicle.
    """

    def __init__(self, graph: Graph, prefix: str, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._node = Node(graph, "param", prefix)
        self._is_confirmed = False
        self._declared: set[str] = set()
        self._events = self._node.advertise("~/event", "mavros_msgs/ParamEvent")
        self._node.advertise_service("~/pull", "mavros_msgs/ParamPull", self._pull)
        self._node.advertise_service("~/set", "mavros_msgs/ParamSetV2", self._set)
        # In place of the node's own service, which does not wait for the vehicle.
        self._node.advertise_service("~/set_parameters", "rcl_interfaces/SetParameters", self._set_several)
        vehicle.on("PARAM_VALUE", self._on_value)

    def close(self) -> None:
        """Leave the graph."""
        self._node.close()

    async def _pull(self, request: Message) -> dict[str, Any]:
        known = self._vehicle.parameters.known
        if request.force_pull or not self._declared:
            parameters = await self._vehicle.parameters.pull()
            for parameter in parameters:
                self._declare(parameter)
            return {"success": True, "param_received": len(parameters)}
        return {"success": True, "param_received": len(known)}

    async def _set(self, request: Message) -> dict[str, Any]:
        parameter = await self._write(request.param_id, request.value)
        return {"success": True, "value": _value(parameter)}

    async def _set_several(self, request: Message) -> dict[str, Any]:
        return {"results": [await self._result(each) for each in request.parameters]}

    async def _result(self, wanted: Message) -> dict[str, Any]:
        try:
            await self._write(wanted.name, wanted.value)
        except VehicleError as error:
            return {"successful": False, "reason": str(error)}
        return {"successful": True}

    async def _write(self, name: str, value: Message) -> Parameter:
        if value.type == _INTEGER:
            number: float = value.integer_value
        elif value.type == _DOUBLE and math.isfinite(value.double_value):
            number = value.double_value
        else:
            raise Rejected(f"{name}: expected an integer or a finite number")
        parameter = await self._vehicle.parameters.set(name, number)
        self._declare(parameter)
        return parameter

    def _on_value(self, message: MavlinkMessage) -> None:
        parameter = self._vehicle.parameters.receive(message)
        if parameter.name in self._declared:
            self._declare(parameter)
        self._events.publish(
            {
                "header": {},
                "param_id": parameter.name,
                "value": _value(parameter),
                "param_index": parameter.index,
                "param_count": parameter.count,
            }
        )

    def _declare(self, parameter: Parameter) -> None:
        """Store a value that the vehicle confirmed among the parameters of the node."""
        parameters = self._node.parameters
        with self._confirmed():
            if parameter.name in self._declared:
                before = parameters.get(parameter.name)
                if type(before) is type(parameter.value):
                    if before != parameter.value:
                        parameters.set(parameter.name, parameter.value)
                    return
                parameters.undeclare(parameter.name)  # Another firmware has another type.
            parameters.declare(parameter.name, parameter.value, on_change=self._check)
            self._declared.add(parameter.name)

    @contextmanager
    def _confirmed(self) -> Iterator[None]:
        self._is_confirmed = True
        try:
            yield
        finally:
            self._is_confirmed = False

    def _check(self, value: ParameterValue) -> None:
        if not self._is_confirmed:
            raise ParameterRejected("a parameter of the vehicle: set it by the service set_parameters")


def _value(parameter: Parameter) -> dict[str, Any]:
    if isinstance(parameter.value, int):
        return {"type": _INTEGER, "integer_value": parameter.value}
    return {"type": _DOUBLE, "double_value": parameter.value}
