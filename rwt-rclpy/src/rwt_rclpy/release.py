"""Releases of rclpy whose behaviour differs, and the one that programs run with."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeVar

from rwt_rclpy.exceptions import InvalidHandle, RCLError

_Class = TypeVar("_Class", bound=type)


@dataclass(frozen=True, slots=True)
class Release:
    """Release of rclpy; the defaults are Jazzy's.

    Attributes:
        calls_raise_timeout: True if `Client.call` raises TimeoutError; otherwise it returns None.
        durations_calculate: True if durations can be added, subtracted and multiplied.
        has_kilted_names: True if names exist that came with Kilted: `TimerInfo`, content filters, and nodes,
            endpoints and timers in ``with`` statements.
        tasks_are_fifo: True if the oldest task of an executor is run first; otherwise the newest.
        executors_outlive_shutdown: True if nodes and tasks may be added to an executor after its shutdown.
        error_without_context: what an executor raises without an initialised context.
        error_after_shutdown: what a node raises that makes a publisher or a subscription after the shutdown.
        error_of_second_shutdown: what a context raises that is shut down again.
        error_of_unknown_policy: what a `QoSProfile` raises for a policy that it does not have.
        executors_create_futures: True if executors have `create_future`.
        init_returns_context_manager: True if `rclpy.init` may be used in a ``with`` statement.
        parameter_types_are_numbers: True if `Parameter.Type` is an IntEnum, which prints numbers.
        rosout_is_preset: True if the profile of /rosout is in `QoSPresetProfiles`.
        transitions_raise: True if impossible lifecycle transitions raise RCLError; otherwise they fail.
        warn_is_deprecated: True if `warn` of a logger issues a DeprecationWarning.
    """

    calls_raise_timeout: bool = False
    durations_calculate: bool = False
    has_kilted_names: bool = False
    tasks_are_fifo: bool = False
    executors_outlive_shutdown: bool = False
    error_without_context: type[Exception] = TypeError
    error_after_shutdown: type[Exception] = RCLError
    error_of_second_shutdown: type[Exception] = RCLError
    error_of_unknown_policy: type[Exception] = AssertionError
    executors_create_futures: bool = False
    init_returns_context_manager: bool = False
    parameter_types_are_numbers: bool = False
    rosout_is_preset: bool = False
    transitions_raise: bool = True
    warn_is_deprecated: bool = False


RELEASES: Final = {
    "jazzy": Release(),
    "kilted": Release(
        calls_raise_timeout=True,
        durations_calculate=True,
        has_kilted_names=True,
        tasks_are_fifo=True,
        executors_outlive_shutdown=True,
        error_without_context=RuntimeError,
        error_after_shutdown=InvalidHandle,
        error_of_second_shutdown=RuntimeError,
        error_of_unknown_policy=TypeError,
        executors_create_futures=True,
        init_returns_context_manager=True,
        parameter_types_are_numbers=True,
        rosout_is_preset=True,
        transitions_raise=False,
        warn_is_deprecated=True,
    ),
}
#: Distribution of ROS_DISTRO, which `rwt run --distro` sets; by default Jazzy.
RELEASE: Final = RELEASES.get(os.environ.get("ROS_DISTRO", ""), RELEASES["jazzy"])


def from_kilted(*names: str) -> Callable[[_Class], _Class]:
    """Return a decorator that takes attributes from a class, unless the release has those of Kilted."""

    def adapted(cls: _Class) -> _Class:
        if not RELEASE.has_kilted_names:
            for name in names:
                delattr(cls, name)
        return cls

    return adapted
