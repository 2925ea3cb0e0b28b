"""The robot's health: `/diagnostics`."""

from __future__ import annotations

from rwt.nodes.demo.battery import Battery
from rwt.nodes.demo.drive import DifferentialDrive
from rwt.nodes.demo.navigation.task import Navigation
from rwt_graph import Node
from rwt_participant.diagnostics import DiagnosticLevel, DiagnosticStatus, DiagnosticUpdater

_LOW_BATTERY, _EMPTY_BATTERY = 0.2, 0.05


class Diagnostics:
    """Publishes the state of motors, battery and navigation every `period` seconds."""

    def __init__(
        self, node: Node, drive: DifferentialDrive, battery: Battery, navigation: Navigation, period: float
    ) -> None:
        self._drive = drive
        self._battery = battery
        self._navigation = navigation
        updater = DiagnosticUpdater(
            node, "demo_robot", hardware_id="demo_robot", period=period, topic="diagnostics"
        )
        updater.add("motors", self._motors)
        updater.add("battery", self._power)
        updater.add("navigation", self._trips)

    def _motors(self) -> DiagnosticStatus:
        drive = self._drive
        level, text = DiagnosticLevel.OK, "driving" if not drive.velocity.is_zero else "standing"
        if drive.bumped:
            level, text = DiagnosticLevel.WARN, "something is in the way"
        if not drive.enabled:
            level, text = DiagnosticLevel.WARN, "disabled; call /enable_motors"
        return DiagnosticStatus(
            level,
            text,
            {
                "speed": f"{drive.velocity.linear:.2f} m/s",
                "turn rate": f"{drive.velocity.angular:.2f} rad/s",
            },
        )

    def _power(self) -> DiagnosticStatus:
        level, text = DiagnosticLevel.OK, "charged"
        if self._battery.level < _LOW_BATTERY:
            level, text = DiagnosticLevel.WARN, "low"
        if self._battery.level < _EMPTY_BATTERY:
            level, text = DiagnosticLevel.ERROR, "nearly empty; it is swapped when it is"
        return DiagnosticStatus(
            level, text, {"charge": f"{self._battery.level:.1%}", "voltage": f"{self._battery.voltage:.2f} V"}
        )

    def _trips(self) -> DiagnosticStatus:
        text = "driving to a goal" if self._navigation.active else "no goal"
        return DiagnosticStatus(DiagnosticLevel.OK, text)
