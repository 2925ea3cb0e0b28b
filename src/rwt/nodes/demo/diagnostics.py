"""The robot's health: `/diagnostics`."""

from __future__ import annotations

from rwt.nodes.demo.battery import Battery
from rwt.nodes.demo.drive import DifferentialDrive
from rwt.nodes.demo.navigation.task import Navigation
from rwt_graph import Node
from rwt_participant.diagnostics import DiagnosticLevel, DiagnosticStatus, DiagnosticUpdater

_LOW_BATTERY, _EMPTY_BATTERY = 0.2, 0.05


def publish_diagnostics(
    node: Node, drive: DifferentialDrive, battery: Battery, navigation: Navigation, period: float
) -> None:
    """Publish the state of motors, battery and navigation every `period` seconds."""

    def motors() -> DiagnosticStatus:
        level, text = DiagnosticLevel.OK, "driving" if not drive.velocity.is_zero else "standing"
        if drive.bumped:
            level, text = DiagnosticLevel.WARN, "something is in the way"
        if not drive.enabled:
            level, text = DiagnosticLevel.WARN, "disabled; call /enable_motors"
        speed, turn = f"{drive.velocity.linear:.2f} m/s", f"{drive.velocity.angular:.2f} rad/s"
        return DiagnosticStatus(level, text, {"speed": speed, "turn rate": turn})

    def power() -> DiagnosticStatus:
        level, text = DiagnosticLevel.OK, "charged"
        if battery.level < _LOW_BATTERY:
            level, text = DiagnosticLevel.WARN, "low"
        if battery.level < _EMPTY_BATTERY:
            level, text = DiagnosticLevel.ERROR, "nearly empty; it is swapped when it is"
        values = {"charge": f"{battery.level:.1%}", "voltage": f"{battery.voltage:.2f} V"}
        return DiagnosticStatus(level, text, values)

    def trips() -> DiagnosticStatus:
        return DiagnosticStatus(DiagnosticLevel.OK, "driving to a goal" if navigation.active else "no goal")

    updater = DiagnosticUpdater(
        node, "demo_robot", hardware_id="demo_robot", period=period, topic="diagnostics"
    )
    for name, task in (("motors", motors), ("battery", power), ("navigation", trips)):
        updater.add(name, task)
