"""A robot as the tools use it: the few verbs that they need, whichever way leads to it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

from rwt_interfaces.structs import ActionType, MessageType, ServiceType
from rwt_participant.api import Parameters
from rwt_participant.goals import Goal
from rwt_participant.handles import Handle, Publisher
from rwt_participant.messages import Message, MessageCallback, MessageLike
from rwt_participant.transforms import Transforms


@dataclass(frozen=True, slots=True, order=True)
class Named:
    """A topic, a service or an action.

    Attributes:
        name: absolute name.
        type: its type, as the robot's distribution spells it; empty where that is not known.
        publishers: of a topic; None where that is not known.
        subscribers: likewise.
    """

    name: str
    type: str = ""
    publishers: int | None = None
    subscribers: int | None = None


class Robot(Protocol):
    """What the tools ask of a robot.

    There are two: in the gateway the graph as one client may see it (`graph_robot`), and in the
    command `rwt mcp` a connection to a robot elsewhere. Both raise what
    :class:`rwt_participant.api.RobotApi` says of the verbs that it has too.

    Attributes:
        params: the parameters of all nodes.
    """

    params: Parameters

    @property
    def tf(self) -> Transforms:
        """Where the frames are."""

    async def topics(self) -> tuple[Named, ...]:
        """The topics that are there, sorted by name."""

    async def services(self) -> tuple[Named, ...]:
        """The services that are there, sorted by name."""

    async def actions(self) -> tuple[Named, ...]:
        """The actions that are there, sorted by name."""

    async def type_of(self, topic: str) -> MessageType:
        """The type of a topic.

        Raises:
            NotFound: there is no such topic, or it has no type yet.
        """

    async def interface(self, name: str) -> MessageType | ServiceType | ActionType:
        """The message, service or action of that name.

        Raises:
            UnknownType: there is none.
        """

    def subscribe(self, topic: str, callback: MessageCallback, type: str) -> Handle:
        """Call a plain function with each message of a topic, those first that it keeps for late joiners."""

    def advertise(self, topic: str, type: str) -> Publisher:
        """Become a publisher of a topic until the handle is closed."""

    async def call(self, service: str, request: MessageLike, seconds: float) -> Message:
        """Call a service and wait so many seconds for its response."""

    async def send_goal(
        self, action: str, goal: MessageLike, on_feedback: Callable[[Message], object]
    ) -> Goal:
        """Send a goal to an action."""

    def cancel_goal(self, goal: Goal) -> None:
        """Ask that a goal end early, which was sent through this robot or another of the same way."""

    async def pass_gate(self, seconds: float = 0.0) -> bool:
        """Have a person asked for the yes that the robot's gate wants for what was just tried, where the
        person at the agent's program may give it.

        Args:
            seconds: for how long it should hold, if the gate allows that.

        Returns:
            Whether one was given. Where others have to give it, none is.

        Raises:
            ToolError: the person says no, or cannot be asked.
        """

    async def take_lease(self, topic: str) -> float | None:
        """Make sure that the robot's gate lets a topic be published on, which this robot has advertised.

        Returns:
            For how long the gate lets that go on without a word of whoever publishes, in seconds; None where
            it sets no bound.

        Raises:
            ToolError: another client holds the topic, who is named, or the emergency stop is on.
        """

    async def time_ns(self) -> int:
        """The robot's time, nanoseconds since the epoch."""

    def monotonic(self) -> float:
        """Seconds on the clock that times of tools are measured by."""

    async def sleep(self, seconds: float) -> None:
        """Wait for so many seconds of that clock."""

    def within(self, seconds: float | None) -> AbstractContextManager[object]:
        """Leave the block after so many seconds of that clock."""
