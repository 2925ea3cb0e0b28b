"""Acts of an agent on a robot elsewhere: publishing with the server's verdict, and the lease of its gate."""

from __future__ import annotations

from typing import Final

from rwt.extensions.mcp.errors import ToolError
from rwt_client import Robot
from rwt_participant.handles import Publisher
from rwt_participant.messages import MessageLike

_TAKE_LEASE: Final = "/gate/take_lease"


async def take_lease(robot: Robot, topic: str) -> float | None:
    """Take the lease of a topic, if the robot's gate has one.

    Returns:
        Silence after which the lease is lost, in seconds; None without one.

    Raises:
        ToolError: another client holds the lease, or the emergency stop is active.
    """
    if _TAKE_LEASE not in await robot.api.services():
        return None  # A gate shows its services to every role.
    answer = await robot.call(_TAKE_LEASE, {"topic": topic}, "rwt_gate_msgs/Lease")
    if answer.seconds and not answer.success:
        raise ToolError(answer.message)
    return answer.seconds or None


class CheckedPublisher(Publisher):
    """Publisher that raises what the server rejects."""

    def __init__(self, robot: Robot, topic: str, type: str) -> None:
        self._publisher = robot.advertise(topic, type)
        self.name = self._publisher.name

    async def ready(self) -> None:
        """Wait until the server knows the publisher."""
        await self._publisher.ready()

    def publish(self, message: MessageLike) -> None:
        """Publish a message. Raises ServerRefused if an earlier one was rejected."""
        self._publisher.publish(message)
        if self._publisher.rejection is not None:
            raise self._publisher.rejection

    async def __aexit__(self, *exc: object) -> None:
        try:
            if exc[0] is None:
                await self._publisher.confirm()
        finally:
            self.close()

    def close(self) -> None:
        """Withdraw the publisher."""
        self._publisher.close()
