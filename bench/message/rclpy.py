"""CPU time of a message in a node of `rwt_rclpy`, from `publish` to the end of the callback.

One node publishes, and subscribes in the same process, and one executor runs it: a Twist, and an Image, given
as numpy's array, which is copied when it is assigned, or as bytes, which nobody copies. It is the best of
some rounds: other work on the machine makes rounds longer, never shorter.

Example: python -m bench.message.rclpy
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from typing import Any, Final

import rwt_rclpy

ROUNDS: Final = 7
MESSAGES: Final = 2_000
#: Of the image, in bytes: VGA in colour.
PIXELS: Final = 640 * 480 * 3


def _node() -> tuple[Any, Any]:
    import rclpy

    rclpy.init(args=[])
    node = rclpy.create_node("bench")
    executor = rclpy.executors.SingleThreadedExecutor()
    executor.add_node(node)
    return node, executor


def seconds_each(node: Any, executor: Any, make: Callable[[], Any], messages: int) -> float:
    """CPU seconds of one message of a topic of its own, its making included."""
    heard: list[int] = []
    kind = type(make())
    topic = f"/bench_{kind.__name__}_{time.monotonic_ns()}"
    subscription = node.create_subscription(kind, topic, lambda _: heard.append(1), 1)
    publisher = node.create_publisher(kind, topic, 1)
    began = time.process_time()
    for _ in range(messages):
        publisher.publish(make())
        executor.spin_once(timeout_sec=10.0)
    spent = time.process_time() - began
    node.destroy_subscription(subscription)
    node.destroy_publisher(publisher)
    assert len(heard) == messages, "every message is heard"
    return spent / messages


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure both; prints a line for each."""
    parser = argparse.ArgumentParser(prog="python -m bench.message.rclpy", description=__doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"default {ROUNDS}")
    parser.add_argument("--messages", type=int, default=MESSAGES, help=f"of a round, default {MESSAGES}")
    options = parser.parse_args(arguments)
    if rwt_rclpy.install() == "ros":
        raise SystemExit("ROS is installed: its own rclpy would be measured")
    import numpy as np

    from rwt_rclpy.messages.loaded import message_class

    node, executor = _node()
    twist: Any = message_class("geometry_msgs/Twist")()
    twist.linear.x = 0.25
    image: Any = message_class("sensor_msgs/Image")(height=480, width=640, encoding="rgb8", step=1920)
    pixels = np.zeros(PIXELS, np.uint8)

    def fresh() -> Any:
        image.data = pixels
        return image

    image.data = pixels.tobytes()
    for name, make in (
        ("Twist", lambda: twist),
        ("Image of 921,600 bytes", lambda: image),
        ("Image of 921,600 bytes, from numpy each time", fresh),
    ):
        messages = options.messages if name == "Twist" else max(1, options.messages // 20)
        each = min(seconds_each(node, executor, make, messages) for _ in range(options.rounds))
        print(f"{name}: {each * 1e6:.0f} µs of CPU, {1 / each:,.0f} a second")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
