"""Executors wait for events: one that has nothing to do takes no time of the processor."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest

#: Seconds of the processor that one spin may take: looking over the entities a few times takes milliseconds.
LITTLE = 0.25


@pytest.fixture
def rclpy() -> Iterator[Any]:
    import rclpy

    rclpy.init(args=[])
    yield rclpy
    rclpy.try_shutdown()


@pytest.mark.parametrize("name", ["SingleThreadedExecutor", "MultiThreadedExecutor", "EventsExecutor"])
def test_an_idle_executor_does_not_spin(rclpy: Any, name: str) -> None:
    from rwt_rclpy.execution import executors
    from rwt_rclpy.messages.loaded import message_class

    node = rclpy.create_node("idle")
    node.create_subscription(message_class("std_msgs/Int32"), "/nothing", lambda _: None, 1)
    node.create_timer(3600.0, lambda: None)
    with getattr(executors, name)() as executor:
        executor.add_node(node)
        executor.spin_once(timeout_sec=0.0)
        before = time.thread_time()
        executor.spin_once(timeout_sec=2.0)
        assert time.thread_time() - before < LITTLE
