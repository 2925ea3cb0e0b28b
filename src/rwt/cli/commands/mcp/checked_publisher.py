"""Acts of an agent on a robot elsewhere: publishing with the server's verdict, and the lease of its gate."""

from __future__ import annotations

from typing import Final

from rwt.gateways.mcp.errors import ToolError
from rwt_client import ConnectionEvent, Robot, ServerRefused
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
    """Publisher that raises what the server rejects.

    A rosbridge server reports a rejected message later, and not which one it was. Of two such publishers that
    publish at the same time, both raise it.
    """

    def __init__(self, robot: Robot, topic: str, type: str) -> None:
        self._robot = robot
        self._publisher = robot.advertise(topic, type)
        self._rejection = ""
        self._stop_listening = robot.on_event(self._on_event)
        self.name = self._publisher.name

    def _on_event(self, event: ConnectionEvent) -> None:
        if event.kind == "status" and event.level == "error" and event.text.startswith("publish: "):
            self._rejection = event.text

    async def ready(self) -> None:
        """Wait until the server knows the publisher."""
        await self._publisher.ready()

    def publish(self, message: MessageLike) -> None:
        """Publish a message. Raises ServerRefused if an earlier one was rejected."""
        self._publisher.publish(message)
        self._raise_rejection()

    def _raise_rejection(self) -> None:
        if self._rejection:
            raise ServerRefused(self._rejection)

    async def __aexit__(self, *exc: object) -> None:
        try:
            if exc[0] is None:
                # The server reports on the messages before it answers a question that is asked after them.
                await self._robot.time_ns()
                self._raise_rejection()
        finally:
            self.close()

    def close(self) -> None:
        """Withdraw the publisher."""
        self._stop_listening()
        self._publisher.close()
