"""The action `/fibonacci`, the one of every tutorial."""

from __future__ import annotations

from typing import Protocol

from rwt_graph import ActionGoal, GoalCanceled, Node
from rwt_nodes.demo.messages import Message

#: The last of which the numbers fit the message's int32.
_HIGHEST_ORDER = 46


class FibonacciRequest(Protocol):
    """The goal of every Fibonacci action."""

    order: int


class Fibonacci:
    """Finds one number after another.

    Attributes:
        rate: numbers in a second.
    """

    rate = 5.0

    def __init__(self, node: Node) -> None:
        ros1 = node.distro.ros_version == 1
        name = "actionlib_tutorials/Fibonacci" if ros1 else "example_interfaces/Fibonacci"
        self._node = node
        node.advertise_action("/fibonacci", name, self._execute, accept=self._accept)

    def _accept(self, request: FibonacciRequest) -> bool | str:
        if 0 <= request.order <= _HIGHEST_ORDER:
            return True
        return f"order must be 0 to {_HIGHEST_ORDER}, where int32 ends, got {request.order}"

    async def _execute(self, goal: ActionGoal) -> Message:
        request: FibonacciRequest = goal.request
        order = request.order
        sequence = [0, 1][: order + 1]
        while len(sequence) <= order:
            await self._node.clock.sleep(1 / self.rate)
            if goal.cancel_requested:
                raise GoalCanceled({"sequence": sequence})
            sequence = [*sequence, sequence[-1] + sequence[-2]]
            goal.publish_feedback({"sequence": sequence})
        return {"sequence": sequence}
