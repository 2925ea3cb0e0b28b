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
        executors_create_futures: True if executors have `create_future`.
        init_returns_context_manager: True if `rclpy.init` may be used in a ``with`` statement.
        transitions_raise: True if impossible lifecycle transitions raise RCLError; otherwise they fail.
        warn_is_deprecated: True if `warn` of a logger issues a DeprecationWarning.
    """

    calls_raise_timeout: bool
    durations_calculate: bool
    has_timer_info: bool
    tasks_are_fifo: bool
    executors_outlive_shutdown: bool
    error_without_context: type[Exception]
    error_after_shutdown: type[Exception]
    executors_create_futures: bool
    init_returns_context_manager: bool
    transitions_raise: bool
    warn_is_deprecated: bool


RELEASES: Final = {
    "jazzy": Release(
        calls_raise_timeout=False,
        durations_calculate=False,
        has_timer_info=False,
        tasks_are_fifo=False,
        executors_outlive_shutdown=False,
        error_without_context=TypeError,
        error_after_shutdown=RCLError,
        executors_create_futures=False,
        init_returns_context_manager=False,
        transitions_raise=True,
        warn_is_deprecated=False,
    ),
    "kilted": Release(
        calls_raise_timeout=True,
        durations_calculate=True,
        has_timer_info=True,
        tasks_are_fifo=True,
        executors_outlive_shutdown=True,
        error_without_context=RuntimeError,
        error_after_shutdown=InvalidHandle,
        executors_create_futures=True,
        init_returns_context_manager=True,
        transitions_raise=False,
        warn_is_deprecated=True,
    ),
}
#: Distribution of ROS_DISTRO, which `rwt run --distro` sets; by default Jazzy.
RELEASE: Final = RELEASES.get(os.environ.get("ROS_DISTRO", ""), RELEASES["jazzy"])
