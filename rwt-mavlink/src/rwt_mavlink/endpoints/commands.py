"""Services that command a vehicle: arming, modes, take-off, landing, home, and any command by its number."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from rwt_graph import Node
from rwt_mavlink.link.frames import dialect
from rwt_mavlink.protocol.commands import Answer
from rwt_mavlink.protocol.errors import Rejected
from rwt_mavlink.protocol.modes import mode_parameters
from rwt_mavlink.vehicle import Vehicle
from rwt_participant.messages import Message

#: Base modes of SetMode with an empty custom mode, which the vehicle gets as they are.
_MAX_RATE: Final = 1000.0
_MICROSECONDS: Final = 1_000_000


class CommandServices:
    """Services of commands of one vehicle.

    A vehicle that rejects a command answers with its result, as with mavros. A command that it did not
    answer, or that cannot be sent, fails with the reason.

    Args:
        node: node of the vehicle.
        prefix: namespace of the vehicle.
        vehicle: the vehicle.
    """

    def __init__(self, node: Node, prefix: str, vehicle: Vehicle) -> None:
        self._node = node
        self._vehicle = vehicle
        for name, type, handler in (
            ("cmd/arming", "mavros_msgs/CommandBool", self._arm),
            ("cmd/command", "mavros_msgs/CommandLong", self._command),
            ("cmd/command_int", "mavros_msgs/CommandInt", self._command_int),
            ("cmd/takeoff", "mavros_msgs/CommandTOL", self._take_off),
            ("cmd/land", "mavros_msgs/CommandTOL", self._land),
            ("cmd/set_home", "mavros_msgs/CommandHome", self._set_home),
            ("set_mode", "mavros_msgs/SetMode", self._set_mode),
            ("set_message_interval", "mavros_msgs/MessageInterval", self._set_interval),
            ("set_stream_rate", "mavros_msgs/StreamRate", self._set_stream_rate),
        ):
            node.advertise_service(f"{prefix}/{name}", type, handler)

    async def _run(self, command: int, *parameters: float) -> dict[str, Any]:
        answer = await self._vehicle.commands.execute(command, parameters)
        return self._response(command, answer)

    def _response(self, command: int, answer: Answer) -> dict[str, Any]:
        if not answer.is_accepted:
            found = dialect.enums["MAV_CMD"].get(command)
            text = f"{found.name if found else command}: the vehicle answers {answer.text}"
            self._node.log.warning(text)
        return {"success": answer.is_accepted, "result": answer.result}

    async def _arm(self, request: Message) -> dict[str, Any]:
        return await self._run(dialect.MAV_CMD_COMPONENT_ARM_DISARM, float(request.value))

    async def _command(self, request: Message) -> dict[str, Any]:
        _reject_broadcast(request)
        parameters = [getattr(request, f"param{number}") for number in range(1, 8)]
        answer = await self._vehicle.commands.execute(request.command, parameters, request.confirmation)
        return self._response(request.command, answer)

    async def _command_int(self, request: Message) -> dict[str, Any]:
        _reject_broadcast(request)
        target = self._vehicle.exchange.target
        message = dialect.MAVLink_command_int_message(
            target.system, target.component, request.frame, request.command, request.current,
            request.autocontinue, request.param1, request.param2, request.param3, request.param4,
            request.x, request.y, request.z,
        )  # fmt: skip
        answer = await self._vehicle.commands.execute_int(message)
        return {"success": self._response(request.command, answer)["success"]}

    async def _take_off(self, request: Message) -> dict[str, Any]:
        return await self._run(dialect.MAV_CMD_NAV_TAKEOFF, *_place(request))

    async def _land(self, request: Message) -> dict[str, Any]:
        return await self._run(dialect.MAV_CMD_NAV_LAND, *_place(request))

    async def _set_home(self, request: Message) -> dict[str, Any]:
        places = request.latitude, request.longitude, request.altitude
        here = float(request.current_gps)
        return await self._run(dialect.MAV_CMD_DO_SET_HOME, here, 0.0, 0.0, request.yaw, *places)

    async def _set_mode(self, request: Message) -> dict[str, Any]:
        vehicle = self._vehicle
        vehicle.exchange.check()  # The modes depend on the kind of vehicle.
        parameters: Sequence[float] | None = (float(request.base_mode), 0.0, 0.0)
        if request.custom_mode:
            parameters = mode_parameters(vehicle.autopilot, vehicle.type, request.custom_mode)
        if parameters is None:
            raise Rejected(f"the vehicle has no mode {request.custom_mode!r}")
        answer = await self._run(dialect.MAV_CMD_DO_SET_MODE, *parameters)
        return {"mode_sent": answer["success"]}

    async def _set_interval(self, request: Message) -> dict[str, Any]:
        rate = request.message_rate
        if not math.isfinite(rate) or rate > _MAX_RATE:
            raise Rejected(f"the rate is {rate:g}, maximum is {_MAX_RATE:g}")
        # 0 is the usual rate, and -1 none, as with mavros.
        interval = _MICROSECONDS / rate if rate > 0 else (-1.0 if rate < 0 else 0.0)
        answer = await self._run(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, request.message_id, interval)
        return {"success": answer["success"]}

    def _set_stream_rate(self, request: Message) -> None:
        self._vehicle.exchange.check()
        self._vehicle.request_streams(request.stream_id, request.message_rate, request.on_off)


def _place(request: Message) -> tuple[float, ...]:
    return request.min_pitch, 0.0, 0.0, request.yaw, request.latitude, request.longitude, request.altitude


def _reject_broadcast(request: Message) -> None:
    if request.broadcast:
        raise Rejected("commands to all vehicles are not supported: no vehicle confirms them")
