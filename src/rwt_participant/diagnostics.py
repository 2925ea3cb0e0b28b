"""Self-diagnosis of a robot: publishes `/diagnostics` like ROS's diagnostic_updater."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Protocol

from rwt_participant.errors import CallFailed
from rwt_participant.messages import is_coroutine_function
from rwt_participant.timers import HasTimers

if TYPE_CHECKING:
    from rwt_participant.blocking import BlockingPublisher
    from rwt_participant.handles import Publisher

logger = logging.getLogger(__name__)


class DiagnosticLevel(IntEnum):
    """Levels of `diagnostic_msgs/DiagnosticStatus`."""

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


#: Checks one part of the robot; a plain function, which should be fast.
Check = Callable[[], DiagnosticStatus]


class Reports(HasTimers, Protocol):
    """Robot for the updater: :class:`~rwt_participant.api.RobotApi`, or its blocking form."""

    def advertise(self, topic: str, type: str, /) -> Publisher | BlockingPublisher:
        """Become a publisher."""


class DiagnosticUpdater:
    """Updater that publishes a `diagnostic_msgs/DiagnosticArray` of all its checks every `period` seconds.

    >>> updater = DiagnosticUpdater(robot, "base", hardware_id="chassis 7")
    >>> updater.add("battery", lambda: DiagnosticStatus(DiagnosticLevel.WARN, "low", {"charge": "12 %"}))

    A check that raises is reported at level ERROR with the exception's text, and logged once until it
    succeeds again. A client that is not connected reports nothing.

    Args:
        robot: node or client, awaited or blocking.
        name: prefix of each status, which is named `NAME: CHECK`.
        hardware_id: identifier of the device, such as a serial number.
        period: seconds; of the graph's clock for a node.
        topic: topic to publish on.

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
        """Add a check, from the next report on; replaces one of the same name.

        Raises:
            TypeError: `check` is not a function, or is a coroutine function.
        """
        if not callable(check) or is_coroutine_function(check):
            raise TypeError(f"{name}: a check is a plain function that gives a status, got {check!r}")
        self._checks[name] = check

    def remove(self, name: str) -> None:
        """Remove a check. No-op if there is none of that name."""
        self._checks.pop(name, None)
        self._failing.discard(name)

    def update(self) -> None:
        """Report now, for changes that should not wait for the timer.

        Raises:
            NotConnected: of a client: there is no connection now.
        """
        statuses = [self._status(name, check) for name, check in tuple(self._checks.items())]
        self._publisher.publish({"status": statuses})

    def close(self) -> None:
        """Stop reporting. No-op if it is closed."""
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
        try:
            found = check()
            self._failing.discard(name)
        except Exception as error:
            if name not in self._failing:
                self._failing.add(name)
                logger.exception("the diagnostic check %s of %s failed", name, self._name)
            found = DiagnosticStatus(DiagnosticLevel.ERROR, f"the check failed: {error}")
        return {
            "level": int(found.level),
            "name": f"{self._name}: {name}",
            "message": found.message,
            "hardware_id": self._hardware_id,
            "values": [{"key": key, "value": str(value)} for key, value in found.values.items()],
        }
