"""Goals as programs see them: their states and how they end."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any


class GoalStatus(IntEnum):
    """The states of a goal, with the numbers of `action_msgs/GoalStatus`."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6

    @property
    def is_terminal(self) -> bool:
        """Whether nothing more can happen to the goal."""
        return self >= GoalStatus.SUCCEEDED


@dataclass(frozen=True, slots=True)
class GoalResult:
    """How a goal ended.

    Attributes:
        status: `SUCCEEDED`, `CANCELED` or `ABORTED`.
        result: the action's result message.
    """

    status: GoalStatus
    result: Any

    @property
    def succeeded(self) -> bool:
        """Whether the goal was reached."""
        return self.status is GoalStatus.SUCCEEDED
