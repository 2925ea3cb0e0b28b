"""Goals that agents have sent, kept until their owners have asked for the results."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from rwt.extensions.mcp.errors import ToolError

if TYPE_CHECKING:
    from rwt_participant.goals import Goal
    from rwt_participant.messages import Message


@dataclass(slots=True)
class AgentGoal:
    """Goal of an agent, in the table once it was sent."""

    owner: str
    result_type: str
    feedback_type: str
    goal: Goal = field(init=False)
    feedback: Message | None = None
    reports: int = 0

    def take_feedback(self, message: Message) -> None:
        """Note the last feedback."""
        self.feedback = message
        self.reports += 1


_OF_ANOTHER: Final = (
    "; this process of the server knows those alone that were sent through it, and there are several"
    " (workers): ask again, which may reach the other one"
)


class GoalTable:
    """Goals of all agents of one gateway; one owner has at most a quarter of `most`."""

    def __init__(self, most: int, *, several_processes: bool = False) -> None:
        self._most = most
        self._several_processes = several_processes
        self._goals: dict[str, AgentGoal] = {}

    def __len__(self) -> int:
        return len(self._goals)

    def of(self, owner: str) -> dict[str, AgentGoal]:
        """Return the goals of one owner, by id, oldest first."""
        return {id: sent for id, sent in self._goals.items() if sent.owner == owner}

    def check_room(self, owner: str) -> None:
        """Make room for a goal by removing the oldest that has ended. Raises ToolError at `mcp.goals`."""
        mine = self.of(owner)
        if len(mine) < max(1, self._most // 4) and len(self._goals) < self._most:
            return
        # An owner at its share makes room among its own goals, not at the expense of others.
        pool = mine if len(mine) >= max(1, self._most // 4) else self._goals
        for id, sent in pool.items():
            if sent.goal.done:
                del self._goals[id]
                return
        raise ToolError(
            f"{len(pool)} goals are under way, which is as many as may be (mcp.goals):"
            " wait for one with `check_goal`, or end one with `cancel_goal`"
        )

    def add(self, id: str, sent: AgentGoal) -> None:
        """Add a goal."""
        self._goals[id] = sent

    def find(self, owner: str, id: str) -> AgentGoal:
        """Return the owner's goal of that id. Raises ToolError if it is unknown."""
        sent = self._goals.get(id)
        if sent is None or sent.owner != owner:
            # A goal of another owner is reported as unknown, so its existence is not revealed.
            known = ", ".join(self.of(owner)) or "none"
            hint = _OF_ANOTHER if self._several_processes else ""
            raise ToolError(f"you have no goal {id[:64]!r}; yours are: {known}{hint}")
        return sent

    def forget(self, id: str) -> None:
        """Remove a goal whose result was reported."""
        self._goals.pop(id, None)
