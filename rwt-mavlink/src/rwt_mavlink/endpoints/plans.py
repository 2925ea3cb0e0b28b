"""Missions, fences and rally points of a vehicle: services to upload and download them, and topics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from rwt_graph import Node
from rwt_mavlink.link.frames import MavlinkMessage, dialect
from rwt_mavlink.protocol.errors import Rejected
from rwt_mavlink.protocol.missions import MissionItem, Plan
from rwt_mavlink.vehicle import Vehicle
from rwt_participant.messages import Message

_DEGREES: Final = 1e7
_METRES: Final = 1e4
_LOCAL_FRAMES: Final = {1, 4, 7, 8, 9, 12, 20, 21}
_INT32: Final = 2**31


class _Names(NamedTuple):
    """Names of a kind of plans below the vehicle's namespace."""

    plan: Plan
    services: str
    topic: str


_NAMES: Final = (
    _Names(Plan.MISSION, "mission", "mission/waypoints"),
    _Names(Plan.FENCE, "geofence", "geofence/fences"),
    _Names(Plan.RALLY, "rallypoint", "rallypoint/rallypoints"),
)


class PlanServices:
    """Services and topics of the plans of one vehicle.

    Args:
        node: node of the vehicle.
        prefix: namespace of the vehicle.
        vehicle: the vehicle.
    """

    def __init__(self, node: Node, prefix: str, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._current = 0
        self._plans: dict[Plan, tuple[MissionItem, ...]] = {}
        self._topics = {
            names.plan: node.advertise(f"{prefix}/{names.topic}", "mavros_msgs/WaypointList", latch=True)
            for names in _NAMES
        }
        for names in _NAMES:
            self._advertise(node, f"{prefix}/{names.services}", names.plan)
        node.advertise_service(
            f"{prefix}/mission/set_current", "mavros_msgs/WaypointSetCurrent", self._set_current
        )
        self._reached = node.advertise(f"{prefix}/mission/reached", "mavros_msgs/WaypointReached")
        vehicle.on("MISSION_ITEM_REACHED", lambda message: self._reached.publish({"wp_seq": message.seq}))
        vehicle.on("MISSION_CURRENT", self._on_current)

    def _advertise(self, node: Node, prefix: str, plan: Plan) -> None:
        async def pull(request: Message) -> dict[str, Any]:
            items = await self._vehicle.missions.download(plan)
            self._keep(plan, items)
            return {"success": True, "wp_received": len(items)}

        async def push(request: Message) -> dict[str, Any]:
            if request.start_index:
                raise Rejected("partial updates are not supported: upload the whole plan, start_index is 0")
            items = [_item(number, waypoint) for number, waypoint in enumerate(request.waypoints)]
            await self._vehicle.missions.upload(items, plan)
            self._keep(plan, items)
            return {"success": True, "wp_transfered": len(items)}

        async def clear(request: Message) -> dict[str, Any]:
            await self._vehicle.missions.clear(plan)
            self._keep(plan, ())
            return {"success": True}

        node.advertise_service(f"{prefix}/pull", "mavros_msgs/WaypointPull", pull)
        node.advertise_service(f"{prefix}/push", "mavros_msgs/WaypointPush", push)
        node.advertise_service(f"{prefix}/clear", "mavros_msgs/WaypointClear", clear)

    async def _set_current(self, request: Message) -> dict[str, Any]:
        command = dialect.MAV_CMD_DO_SET_MISSION_CURRENT
        answer = await self._vehicle.commands.execute(command, [float(request.wp_seq)])
        return {"success": answer.is_accepted}

    def _keep(self, plan: Plan, items: Sequence[MissionItem]) -> None:
        self._plans[plan] = tuple(items)
        self._publish(plan)

    def _on_current(self, message: MavlinkMessage) -> None:
        if message.seq != self._current:
            self._current = message.seq
            if Plan.MISSION in self._plans:
                self._publish(Plan.MISSION)

    def _publish(self, plan: Plan) -> None:
        current = self._current if plan is Plan.MISSION else 0
        waypoints = [
            _waypoint(item, plan is Plan.MISSION and number == current)
            for number, item in enumerate(self._plans[plan])
        ]
        self._topics[plan].publish({"current_seq": current, "waypoints": waypoints})


def _item(number: int, waypoint: Message) -> MissionItem:
    scale = _METRES if waypoint.frame in _LOCAL_FRAMES else _DEGREES
    places = waypoint.x_lat * scale, waypoint.y_long * scale
    if not all(map(math.isfinite, (*places, waypoint.z_alt))) or max(map(abs, places)) >= _INT32:
        raise Rejected(f"waypoints[{number}]: the position is not finite, or out of range")
    return MissionItem(
        waypoint.frame, waypoint.command, int(waypoint.is_current), int(waypoint.autocontinue),
        waypoint.param1, waypoint.param2, waypoint.param3, waypoint.param4,
        round(places[0]), round(places[1]), waypoint.z_alt,
    )  # fmt: skip


def _waypoint(item: MissionItem, is_current: bool) -> dict[str, Any]:
    scale = _METRES if item.frame in _LOCAL_FRAMES else _DEGREES
    names = ("frame", "command", "param1", "param2", "param3", "param4")
    return {
        **{name: getattr(item, name) for name in names},
        "is_current": is_current,
        "autocontinue": bool(item.autocontinue),
        "x_lat": item.x / scale,
        "y_long": item.y / scale,
        "z_alt": item.z,
    }
