"""`rclpy.wait_for_message`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rwt_rclpy.endpoints.qos import QoSProfile

if TYPE_CHECKING:
    from rwt_rclpy.nodes.node import Node


def wait_for_message(
    msg_type: Any,
    node: Node,
    topic: str,
    *,
    qos_profile: QoSProfile | int = 1,
    time_to_wait: float | int = -1,
) -> tuple[bool, Any]:
    """The next message of a topic, without spinning the node.

    Args:
        time_to_wait: seconds; negative for as long as it takes.

    Returns:
        Whether one came, and the message or None.
    """
    keeper = node.context.link.timekeeper
    condition = keeper.condition()
    subscription = node.create_subscription(msg_type, topic, lambda message: None, qos_profile)

    def wake() -> None:
        with condition:
            condition.notify_all()

    subscription.wake = wake
    node.context.on_shutdown(wake)
    deadline = None if time_to_wait < 0 else keeper.steady_ns() + int(time_to_wait * 1e9)
    try:
        with condition:
            while not subscription.has_work() and node.context.ok():
                if deadline is not None and keeper.steady_ns() >= deadline:
                    return False, None
                keeper.wait(condition, deadline)
        taken = subscription._take()
    finally:
        node.destroy_subscription(subscription)
    return (False, None) if taken is None else (True, taken[0])
