"""The robot's health: `/diagnostics`."""

from __future__ import annotations

from rwt_graph import Node
from rwt_nodes.demo import messages
from rwt_nodes.demo.battery import Battery
from rwt_nodes.demo.drive import DifferentialDrive
from rwt_nodes.demo.navigation.task import Navigation

#: Levels of `diagnostic_msgs/DiagnosticStatus`.
OK, WARN, ERROR = 0, 1, 2
_LOW_BATTERY, _EMPTY_BATTERY = 0.2, 0.05


class Diagnostics:
    """Publishes the state of motors, battery and navigation."""

    def __init__(
        self, node: Node, drive: DifferentialDrive, battery: Battery, navigation: Navigation
    ) -> None:
        self._node = node
        self._drive = drive
        self._battery = battery
        self._navigation = navigation
        self._reports = node.advertise("diagnostics", "diagnostic_msgs/DiagnosticArray")

    def publish(self) -> None:
        """Publish the state of this moment."""
        self._reports.publish(
            {
                "header": messages.header(self._node.clock.time_ns(), ""),
                "status": [self._motors(), self._power(), self._trips()],
            }
        )

    def _motors(self) -> messages.Message:
        drive = self._drive
        level, text = OK, "driving" if not drive.velocity.is_zero else "standing"
        if drive.bumped:
            level, text = WARN, "something is in the way"
        if not drive.enabled:
            level, text = WARN, "disabled; call /enable_motors"
        return _status(
            level,
            "motors",
            text,
            {
                "speed": f"{drive.velocity.linear:.2f} m/s",
                "turn rate": f"{drive.velocity.angular:.2f} rad/s",
            },
        )

    def _power(self) -> messages.Message:
        level, text = OK, "charged"
        if self._battery.level < _LOW_BATTERY:
            level, text = WARN, "low"
        if self._battery.level < _EMPTY_BATTERY:
            level, text = ERROR, "nearly empty; it is swapped when it is"
        return _status(
            level,
            "battery",
            text,
            {"charge": f"{self._battery.level:.1%}", "voltage": f"{self._battery.voltage:.2f} V"},
        )

    def _trips(self) -> messages.Message:
        return _status(OK, "navigation", "driving to a goal" if self._navigation.active else "no goal", {})


def _status(level: int, name: str, text: str, values: dict[str, str]) -> messages.Message:
    return {
        "level": level,
        "name": f"demo_robot: {name}",
        "message": text,
        "hardware_id": "demo_robot",
        "values": [{"key": key, "value": value} for key, value in values.items()],
    }
