"""One agent during one request: the robot as it may see it, and its limits."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal, Protocol

from rwt.extensions.mcp.content.answer import Answer, bounded_value
from rwt.extensions.mcp.content.images import show
from rwt.extensions.mcp.content.plain import plain
from rwt.extensions.mcp.errors import ToolError

if TYPE_CHECKING:
    from contextlib import AbstractAsyncContextManager

    from mcp.server.context import ServerRequestContext

    from rwt.extensions.mcp.goals import GoalTable
    from rwt.extensions.mcp.person import Questions
    from rwt.extensions.mcp.recordings import RecordingFolder
    from rwt.extensions.mcp.settings import McpSettings
    from rwt_participant.api import RobotApi
    from rwt_participant.handles import Publisher
    from rwt_participant.messages import Message

Act = Literal["publish", "call", "goals", "set_param"]
"""Rights that permit changes of the robot, as in the settings of roles."""

LONGEST_SECONDS: Final = 60.0
"""Longest time in seconds that one tool call may take."""

RESULT_BYTES: Final = 16 * 1024
"""Maximum size of the text in a tool result, in bytes."""

PICTURE_PIXELS: Final = 640
"""Maximum width and height of an image; larger images are scaled down."""


ReportProgress = Callable[[float, float | None, str | None], Awaitable[None]]
"""Reports the progress of a tool to the agent's program: amount done, amount at the end if known, text."""

InThread = Callable[[Callable[[], "Answer"]], Awaitable["Answer"]]
"""Runs slow work in a thread, and charges it to the client that asked for it."""


#: Maximum number of different notices of the gate in one result.
_MAX_NOTICES: Final = 10


def note_once(notices: list[str], text: str) -> None:
    """Record a notice of the gate about a command, once: a command may be repeated many times a second."""
    if text not in notices and len(notices) < _MAX_NOTICES:
        notices.append(text)


async def _no_progress(progress: float, total: float | None, message: str | None) -> None:
    """No-op: the agent's program did not ask for progress."""


async def _no_confirmation(act: Act, name: str, what: str) -> None:
    """No-op: the agent needs no confirmation."""


async def _no_approval(seconds: float) -> bool:
    """Return False: the robot's own server asks the people who may approve."""
    return False


@dataclass(frozen=True, slots=True)
class Agent:
    """Agent during one request.

    Attributes:
        owner: owner of the goals that the agent may ask about; agents of one credential and role at one
            address share it.
        acts: rights to change something; the tools that need others are not offered.
        how_to_act: advice for people on how to give the agent more rights.
        advertise: advertises a topic; the publisher raises what the robot's server rejects.
        lease_seconds: returns the silence after which the agent loses the gate's lease of a topic, which it
            has advertised; None without a lease. Raises ToolError if another client holds it.
        pass_gate: asks for approval of what the gate holds back, which should hold for so many seconds;
            returns True if it was given.
        confirm: asks the person at the agent's program to confirm an act; raises
            :exc:`~rwt.extensions.mcp.errors.ToolError` if that is refused.
        may_stop: True if the agent may press the emergency stop, whatever other rights it has.
        role: name of its role; empty for a robot of another program.
        hidden: returns how many topics, services and actions the role does not see.
        notices: what the gate did to the agent's commands, such as clamping.
    """

    owner: str
    robot: RobotApi
    settings: McpSettings
    acts: frozenset[Act]
    goals: GoalTable
    in_thread: InThread
    charge: Callable[[float], object]
    sees: Callable[[str], bool]
    how_to_act: str
    advertise: Callable[[str, str], Publisher]
    lease_seconds: Callable[[str], Awaitable[float | None]]
    pass_gate: Callable[[float], Awaitable[bool]] = _no_approval
    confirm: Callable[[Act, str, str], Awaitable[None]] = _no_confirmation
    recordings: RecordingFolder | None = None
    may_stop: bool = False
    role: str = ""
    hidden: Callable[[], Mapping[str, int]] = dict
    notices: list[str] = field(default_factory=list)
    report_progress: ReportProgress = _no_progress

    def bounded_seconds(self, seconds: float, what: str) -> float:
        """Return the time that a tool may take. Raises ToolError beyond :data:`LONGEST_SECONDS`."""
        if seconds > LONGEST_SECONDS:
            raise ToolError(
                f"`{what}`: {seconds:g} s is too long: at most {LONGEST_SECONDS:g} s, and then ask again"
            )
        return seconds

    async def show(self, message: Message, type: str) -> Answer:
        """Return a message, as the member `message` and for the model, within the bounds."""
        return await self.in_thread(lambda: shown(message, type))


def shown(message: Message, type: str) -> Answer:
    """Return a message, as the member `message` and for the model, within the bounds."""
    data = {"message": bounded_value(plain(message), RESULT_BYTES)}
    return Answer(data, show(message, type, RESULT_BYTES, PICTURE_PIXELS))


Allow = Callable[[str, str], Awaitable[None]]
"""Asks a person to permit an action of an owner's agent; raises if the person declines."""


class Host(Protocol):
    """Context of the server: identifies agents, logs and counts their actions."""

    questions: Questions
    settings: McpSettings

    def agent(
        self, context: ServerRequestContext[Any, Any], allow: Allow | None = None, *, lasts: bool = False
    ) -> AbstractAsyncContextManager[Agent]:
        """Return the sender of a request. Raises :exc:`ToolError`.

        Args:
            allow: asks its user.
            lasts: True for an agent that outlasts the request.
        """

    def note(self, context: ServerRequestContext[Any, Any], text: str, *, acts: bool) -> None:
        """Write an action of an agent into the audit log."""

    def count(self, tool: str, outcome: str) -> None:
        """Count a call of a tool: `done`, `asked`, `refused` or `failed`."""
