"""A robot's own account of its health: `/diagnostics`, as ROS's diagnostic_updater publishes it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Protocol

from rwt_participant.errors import CallFailed
from rwt_participant.messages import MessageLike, is_coroutine_function

logger = logging.getLogger(__name__)


class DiagnosticLevel(IntEnum):
    """The levels of `diagnostic_msgs/DiagnosticStatus`."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class DiagnosticStatus:
    """State of one part of a robot.

    Attributes:
        level: severity.
        message: short text for people.
        values: measured values, shown as text.
    """

    level: DiagnosticLevel = DiagnosticLevel.OK
    message: str = ""
    values: Mapping[str, object] = field(default_factory=dict)


#: Looks at one part of the robot; a plain function, which should be quick.
Check = Callable[[], DiagnosticStatus]


class _Closes(Protocol):
    def close(self) -> None: ...


class _Publishes(_Closes, Protocol):
    def publish(self, message: MessageLike, /) -> object: ...


class _Timer(Protocol):
    def cancel(self) -> None: ...


class Reports(Protocol):
    """A robot as the updater needs it: :class:`~rwt_participant.api.RobotApi`, or one whose verbs wait."""

    def advertise(self, topic: str, type: str, /) -> _Publishes:
        """Become a publisher."""

    def create_timer(self, period: float, callback: Callable[[], None], /) -> _Timer:
        """Call `callback` every `period` seconds."""


class DiagnosticUpdater:
    """Publishes a `diagnostic_msgs/DiagnosticArray` of all its checks every `period` seconds.

    >>> updater = DiagnosticUpdater(robot, "base", hardware_id="chassis 7")
    >>> updater.add("battery", lambda: DiagnosticStatus(DiagnosticLevel.WARN, "low", {"charge": "12 %"}))

    A check that raises is reported at level ERROR with the exception's text, and logged once until it is well
    again. While a client has no connection, nothing is reported.

    Args:
        robot: a node or a client, awaited or blocking.
        name: whose health it is; each status is named `NAME: CHECK`.
        hardware_id: which of several devices: a serial number, say.
        period: seconds; of the graph's clock for a node.
        topic: what it is published on.

    Raises:
        ValueError: `period` is out of the range of timers.
    """

    def __init__(
        self,
        robot: Reports,
        name: str,
        *,
        hardware_id: str = "",
        period: float = 1.0,
        topic: str = "/diagnostics",
    ) -> None:
        self._name = name
        self._hardware_id = hardware_id
        self._checks: dict[str, Check] = {}
        self._failing: set[str] = set()
        self._timer = robot.create_timer(period, self._report)
        self._publisher = robot.advertise(topic, "diagnostic_msgs/DiagnosticArray")

    def add(self, name: str, check: Check) -> None:
        """Report what `check` finds from the next time on; one of the same name is replaced.

        Raises:
            TypeError: `check` is no function, or a coroutine function.
        """
        if not callable(check) or is_coroutine_function(check):
            raise TypeError(f"{name}: a check is a plain function that gives a status, got {check!r}")
        self._checks[name] = check

    def remove(self, name: str) -> None:
        """Report it no more; a name that is not there is no error."""
        self._checks.pop(name, None)
        self._failing.discard(name)

    def update(self) -> None:
        """Report now, beside the timer: when something has changed that should not wait.

        Raises:
            NotConnected: of a client: there is no connection now.
        """
        statuses = [self._status(name, check) for name, check in tuple(self._checks.items())]
        self._publisher.publish({"status": statuses})

    def close(self) -> None:
        """Report no more. May be called twice."""
        self._timer.cancel()
        self._publisher.close()

    def _report(self) -> None:
        if not self._checks:
            return
        try:
            self.update()
        except CallFailed as error:
            logger.debug("the diagnostics of %s are not published: %s", self._name, error)

    def _status(self, name: str, check: Check) -> dict[str, Any]:
        found = self._ask(name, check)
        return {
            "level": int(found.level),
            "name": f"{self._name}: {name}",
            "message": found.message,
            "hardware_id": self._hardware_id,
            "values": [{"key": key, "value": str(value)} for key, value in found.values.items()],
        }

    def _ask(self, name: str, check: Check) -> DiagnosticStatus:
        try:
            found = check()
        except Exception as error:
            if name not in self._failing:
                self._failing.add(name)
                logger.exception("the diagnostic check %s of %s failed", name, self._name)
            return DiagnosticStatus(DiagnosticLevel.ERROR, f"the check failed: {error}")
        self._failing.discard(name)
        return found
