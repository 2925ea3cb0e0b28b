"""The action `/fibonacci` of ROS's tutorials."""

from __future__ import annotations

from typing import Protocol

from rwt_graph import Node
from rwt_nodes.demo.messages import Message
from rwt_program.errors import GoalCanceled
from rwt_program.goals import ReceivedGoal

#: As many numbers, from 0 on, fit the message's int32.
_MOST_NUMBERS = 47

#: How many numbers more than the order says a tutorial finds: programs written for either count on it.
_SURPLUS = {"actionlib_tutorials/Fibonacci": 2, "example_interfaces/Fibonacci": 1}


class FibonacciRequest(Protocol):
    """The goal, which every package's Fibonacci action has."""

    order: int


class Fibonacci:
    """Serves the action: one number after another, slowly enough to watch and to cancel.

    Attributes:
        rate: numbers in a second.
    """

    rate = 2.0

    def __init__(self, node: Node) -> None:
        name = node.distro.fibonacci_type
        self._node = node
        self._surplus = _SURPLUS[name]
        node.advertise_action("fibonacci", name, self._execute, accept=self._accept)

    def _accept(self, request: FibonacciRequest) -> bool | str:
        highest = _MOST_NUMBERS - self._surplus
        if 0 <= request.order <= highest:
            return True
        return f"order must be 0 to {highest}, where int32 ends, got {request.order}"

    async def _execute(self, goal: ReceivedGoal) -> Message:
        request: FibonacciRequest = goal.request
        count = request.order + self._surplus
        sequence = [0, 1][:count]
        while len(sequence) < count:
            await self._node.clock.sleep(1 / self.rate)
            if goal.cancel_requested:
                raise GoalCanceled({"sequence": sequence})
            sequence = [*sequence, sequence[-1] + sequence[-2]]
            goal.publish_feedback({"sequence": sequence})
        return {"sequence": sequence}
