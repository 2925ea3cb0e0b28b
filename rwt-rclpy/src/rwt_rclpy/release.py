"""Releases of rclpy whose behaviour differs, and the one that programs run with."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Final

from rwt_rclpy.exceptions import InvalidHandle, RCLError


@dataclass(frozen=True, slots=True)
class Release:
    """Release of rclpy.

    Attributes:
        calls_raise_timeout: True if `Client.call` raises TimeoutError; otherwise it returns None.
        durations_calculate: True if durations can be added, subtracted and multiplied.
        has_timer_info: True if callbacks of timers may take a `TimerInfo`.
        tasks_are_fifo: True if the oldest task of an executor is run first; otherwise the newest.
        executors_outlive_shutdown: True if nodes and tasks may be added to an executor after its shutdown.
        error_without_context: what an executor raises without an initialised context.
        error_after_shutdown: what a node raises that makes a publisher or a subscription after the shutdown.
        transitions_raise: True if impossible lifecycle transitions raise RCLError; otherwise they fail.
    """

    calls_raise_timeout: bool
    durations_calculate: bool
    has_timer_info: bool
    tasks_are_fifo: bool
    executors_outlive_shutdown: bool
    error_without_context: type[Exception]
    error_after_shutdown: type[Exception]
    transitions_raise: bool


RELEASES: Final = {
    "jazzy": Release(
        calls_raise_timeout=False,
        durations_calculate=False,
        has_timer_info=False,
        tasks_are_fifo=False,
        executors_outlive_shutdown=False,
        error_without_context=TypeError,
        error_after_shutdown=RCLError,
        transitions_raise=True,
    ),
    "kilted": Release(
        calls_raise_timeout=True,
        durations_calculate=True,
        has_timer_info=True,
        tasks_are_fifo=True,
        executors_outlive_shutdown=True,
        error_without_context=RuntimeError,
        error_after_shutdown=InvalidHandle,
        transitions_raise=False,
    ),
}
#: Distribution of ROS_DISTRO, which `rwt run --distro` sets; by default Jazzy.
RELEASE: Final = RELEASES.get(os.environ.get("ROS_DISTRO", ""), RELEASES["jazzy"])
