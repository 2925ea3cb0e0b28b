"""One agent during one request: the robot as it may see it, and its limits."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol

from rwt.gateways.mcp.content.show import show
from rwt.gateways.mcp.errors import ToolError

if TYPE_CHECKING:
    from rwt.gateways.mcp.content.answer import Answer
    from rwt.gateways.mcp.goals import GoalTable
    from rwt.gateways.mcp.recordings import Recordings
    from rwt.gateways.mcp.robot import Robot
    from rwt.gateways.mcp.settings import McpSettings
    from rwt_participant.messages import Message

Act = Literal["publish", "call", "goals", "set_param"]
"""Acts that change something at the robot, by the names of the rights in the settings of roles."""


class ReportProgress(Protocol):
    """Tells the agent's program how far a tool has come."""

    async def __call__(self, progress: float, total: float | None = None, message: str | None = None) -> None:
        """Tell it.

        Args:
            progress: grows with each call.
            total: what it grows to, if that is known.
            message: in words.
        """


class InThread(Protocol):
    """Runs what takes long in a thread, and charges the work to whoever asked for it."""

    async def __call__(self, work: Callable[[], Answer]) -> Answer:
        """Run a plain function; what it raises comes out."""


async def _tell_nobody(progress: float, total: float | None = None, message: str | None = None) -> None:
    """For those who did not ask."""


async def _nobody_is_asked(act: Act, name: str, what: str) -> None:
    """For those who need no leave."""


@dataclass(frozen=True, slots=True)
class Agent:
    """One agent during one request.

    Attributes:
        owner: whose goals it may ask about: agents of the same role at the same address are one.
        robot: as the agent may see it and act on it.
        settings: bounds.
        acts: what tools it is offered that change something.
        goals: those that agents sent.
        sees: whether it may see a topic, by its name.
        in_thread: runs what takes long.
        charge: counts seconds of work for whoever asked for it.
        how_to_act: what lets it do more than look, for whom to tell.
        confirm: asks the person at the agent's program for leave to do something, and raises
            :exc:`~rwt.gateways.mcp.errors.ToolError` where there is none.
        recordings: those that it may look at; None for none.
        report_progress: see there.
    """

    owner: str
    robot: Robot
    settings: McpSettings
    acts: frozenset[Act]
    goals: GoalTable
    in_thread: InThread
    charge: Callable[[float], object]
    sees: Callable[[str], bool]
    how_to_act: str
    confirm: Callable[[Act, str, str], Awaitable[None]] = _nobody_is_asked
    recordings: Recordings | None = None
    report_progress: ReportProgress = field(default=_tell_nobody)

    def bounded_seconds(self, seconds: float, what: str) -> float:
        """A time that a tool may take.

        Raises:
            ToolError: it is longer than the longest.
        """
        longest = self.settings.longest_seconds
        if seconds > longest:
            raise ToolError(f"`{what}`: {seconds:g} s is too long: at most {longest:g} s, and then ask again")
        return seconds

    async def show(self, message: Message, type: str) -> Answer:
        """A message for the model, within the bounds."""
        settings = self.settings
        return await self.in_thread(
            lambda: show(message, type, settings.result_bytes, settings.picture_pixels)
        )
