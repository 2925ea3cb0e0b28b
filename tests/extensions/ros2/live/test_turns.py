"""Turns of the event loop in which samples of ROS 2 are taken."""

from __future__ import annotations

import math
from collections import deque
from typing import Any, cast

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: run `make test-ros2`, which installs its wheels")

from rwt.extensions.ros2.wakeups import Inbox, Wakeups


class _Woken:
    """Wake-ups of no endpoint."""

    def add(self, kind: str, endpoint: object, drain: object) -> object:
        return object()


def _inbox(waiting: deque[int], handled: list[int]) -> Inbox[int]:
    def take() -> int | None:
        return waiting.popleft() if waiting else None

    return Inbox(cast("Wakeups", _Woken()), "subscription", cast("Any", None), take, handled.append)


def test_a_turn_whose_time_is_over_takes_one_sample() -> None:
    handled: list[int] = []
    inbox = _inbox(deque(range(10)), handled)
    assert inbox.drain(-math.inf) and handled == [0]
    assert inbox.drain(-math.inf) and handled == [0, 1]


def test_a_turn_takes_all_that_its_time_allows() -> None:
    handled: list[int] = []
    assert not _inbox(deque(range(10)), handled).drain(math.inf)
    assert handled == [*range(10)]


def test_an_endpoint_that_is_closed_is_emptied_whatever_the_time() -> None:
    handled: list[int] = []
    assert not _inbox(deque(range(100)), handled).take(1000)
    assert handled == [*range(100)]
