"""`rclpy.wait_for_message`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rwt_rclpy.endpoints.qos import QoSProfile
from rwt_rclpy.execution.blocking import Wait

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
    """Wait for the next message of a topic, without spinning the node.

    Args:
        time_to_wait: timeout in seconds; negative for none.

    Returns:
        True and the message, or False and None after the timeout or the end of the context.
    """
    wait = Wait(node.context)
    subscription = node.create_subscription(msg_type, topic, lambda message: None, qos_profile)
    subscription._rwt_wake = wait.wake
    try:
        wait.until(subscription._rwt_has_work, time_to_wait)
        taken = subscription._take()
    finally:
        node.destroy_subscription(subscription)
    return (False, None) if taken is None else (True, taken[0])
