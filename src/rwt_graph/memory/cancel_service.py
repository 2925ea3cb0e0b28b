"""`<action>/_action/cancel_goal`: ROS 2's service that cancels one goal or all of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rwt_interfaces.payload import Payload

if TYPE_CHECKING:
    from rwt_graph.api import ServiceCall
    from rwt_graph.memory.actions import MemoryActionServer
    from rwt_interfaces.structs import ServiceType

#: Return codes of `action_msgs/CancelGoal`.
ERROR_NONE, ERROR_REJECTED, ERROR_UNKNOWN_GOAL_ID = 0, 1, 2

_EVERY_GOAL = bytes(16)


def cancel_service(server: MemoryActionServer, type: ServiceType) -> Callable[[ServiceCall], None]:
    """Return the handler of an action's cancel service.

    Without a goal id, all goals are cancelled. Cancelling by the time of acceptance is rejected with
    `ERROR_REJECTED`.
    """

    def on_call(call: ServiceCall) -> None:
        request: Any = call.request.value()
        info = request.goal_info
        wanted = bytes(info.goal_id.uuid)
        if info.stamp.sec or info.stamp.nanosec:
            code, goals = ERROR_REJECTED, []
        elif wanted == _EVERY_GOAL:
            code, goals = ERROR_NONE, list(server.goals.values())
        else:
            goals = [goal for goal in server.goals.values() if goal.id == wanted.hex()]
            code = ERROR_NONE if goals else ERROR_UNKNOWN_GOAL_ID
        canceling = [{"goal_id": {"uuid": bytes.fromhex(goal.id)}} for goal in goals]
        call.reply(Payload.from_value(type.response, {"return_code": code, "goals_canceling": canceling}))
        for goal in goals:
            goal.request_cancel()

    return on_call
