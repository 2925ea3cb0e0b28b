"""State of a vehicle: mode, arming, status texts, diagnostics and what its failsafe does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from rwt_graph import Node
from rwt_mavlink.link.frames import MavlinkMessage, dialect, text_of
from rwt_mavlink.protocol.errors import VehicleError
from rwt_mavlink.protocol.failsafe import describe_failsafe, failsafe_parameters
from rwt_mavlink.protocol.modes import mode_name
from rwt_mavlink.vehicle import Vehicle
from rwt_participant.diagnostics import DiagnosticLevel, DiagnosticStatus, DiagnosticUpdater

#: Characters of one STATUSTEXT; a shorter text is the last of its chunks.
_CHUNK: Final = 50
_LONGEST_TEXT: Final = 1000
#: Seconds for which the last status text is shown in the diagnostics.
_TEXT_SECONDS: Final = 30.0
_BATTERY_LOW: Final = 20


class StatusTexts:
    """Status texts of a vehicle, whose chunks are joined.

    Args:
        publish: called with severity and text.
    """

    def __init__(self, publish: Callable[[int, str], None]) -> None:
        self._publish = publish
        self._id = 0
        self._severity = 0
        self._chunks: list[str] = []

    def receive(self, message: MavlinkMessage) -> None:
        """Take a STATUSTEXT."""
        text = text_of(message.text)
        if not message.id:
            self._publish(message.severity, text)
            return
        if message.id != self._id or message.chunk_seq != len(self._chunks):
            self.flush()  # Chunks of another text, or some were lost.
        self._id, self._severity = message.id, message.severity
        self._chunks.append(text)
        if len(text) < _CHUNK or len(self._chunks) * _CHUNK >= _LONGEST_TEXT:
            self.flush()

    def flush(self) -> None:
        """Publish the chunks that have arrived."""
        if self._chunks:
            self._publish(self._severity, "".join(self._chunks))
        self._chunks = []


class StatusTopics:
    """Topics `state`, `statustext/recv` and `/diagnostics` of a vehicle.

    Args:
        node: node of the vehicle.
        prefix: namespace of the vehicle.
        vehicle: the vehicle.
        station_problem: returns why this station may not command vehicles; empty if it may.
    """

    def __init__(self, node: Node, prefix: str, vehicle: Vehicle, station_problem: Callable[[], str]) -> None:
        self._node = node
        self._vehicle = vehicle
        self._station_problem = station_problem
        self._last_text = ("", 0, 0.0)
        self._state = node.advertise(f"{prefix}/state", "mavros_msgs/State", latch=True)
        self._texts = node.advertise(f"{prefix}/statustext/recv", "mavros_msgs/StatusText")
        self._updater = DiagnosticUpdater(node, prefix.strip("/").replace("/", "."))
        self._updater.add("link", self._link)
        self._updater.add("failsafe", self._failsafe)
        self._updater.add("status text", self._text)
        self._updater.add("battery", self._battery)
        vehicle.on("HEARTBEAT", lambda message: self.publish_state())
        vehicle.on("STATUSTEXT", StatusTexts(self._publish_text).receive)
        vehicle.on_connected(self._connected)
        vehicle.on_lost(self._lost)
        self.publish_state()

    def close(self) -> None:
        """Stop publishing."""
        self._updater.close()

    @property
    def failsafe(self) -> str:
        """What the autopilot does without its ground station."""
        values = {name: float(each.value) for name, each in self._vehicle.parameters.known.items()}
        return describe_failsafe(self._vehicle.autopilot, self._vehicle.type, values)

    def publish_state(self) -> None:
        """Publish mode and arming, as of the last heartbeat."""
        last = self._vehicle.heartbeat
        if last is None or not self._vehicle.is_connected:
            self._state.publish({"header": {}, "connected": False})
            return
        self._state.publish(
            {
                "header": {},
                "connected": True,
                "armed": bool(last.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED),
                "guided": bool(last.base_mode & dialect.MAV_MODE_FLAG_GUIDED_ENABLED),
                "manual_input": bool(last.base_mode & dialect.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED),
                "mode": mode_name(last.autopilot, last.type, last.base_mode, last.custom_mode),
                "system_status": last.system_status,
            }
        )

    def _connected(self) -> None:
        self._node.log.info("the vehicle is connected")
        self._node.graph.spawn(self._read_failsafe, "failsafe parameters")

    async def _read_failsafe(self) -> None:
        vehicle = self._vehicle
        for name in failsafe_parameters(vehicle.autopilot, vehicle.type):
            try:
                await vehicle.parameters.get(name)
            except VehicleError as error:
                text = f"the failsafe of the autopilot is not known: {error}"
                self._node.log.warning(text)

    def _lost(self) -> None:
        text = f"{self._vehicle.unavailable}; {self.failsafe}"
        self._node.log.warning(text)
        self.publish_state()

    def _publish_text(self, severity: int, text: str) -> None:
        self._last_text = (text, severity, self._node.clock.monotonic())
        self._texts.publish({"header": {}, "severity": severity, "text": text})

    # -- diagnostics -----------------------------------------------------------------------------------------

    def _link(self) -> DiagnosticStatus:
        reason = self._station_problem() or self._vehicle.unavailable
        if not reason:
            return DiagnosticStatus(message="connected")
        if self._vehicle.heartbeat is None:
            return DiagnosticStatus(DiagnosticLevel.STALE, reason)
        return DiagnosticStatus(DiagnosticLevel.ERROR, reason)

    def _failsafe(self) -> DiagnosticStatus:
        if self._vehicle.heartbeat is None:
            return DiagnosticStatus(DiagnosticLevel.STALE, "no vehicle")
        text = self.failsafe
        is_certain = text.startswith("after")
        return DiagnosticStatus(DiagnosticLevel.OK if is_certain else DiagnosticLevel.WARN, text)

    def _text(self) -> DiagnosticStatus:
        text, severity, at = self._last_text
        if not text or self._node.clock.monotonic() - at > _TEXT_SECONDS:
            return DiagnosticStatus()
        level = DiagnosticLevel.OK
        if severity <= dialect.MAV_SEVERITY_WARNING:
            level = DiagnosticLevel.WARN
        if severity <= dialect.MAV_SEVERITY_ERROR:
            level = DiagnosticLevel.ERROR
        return DiagnosticStatus(level, text, {"severity": severity})

    def _battery(self) -> DiagnosticStatus:
        status = self._vehicle.latest.get("SYS_STATUS")
        if status is None or status.battery_remaining < 0:
            return DiagnosticStatus(DiagnosticLevel.STALE, "not reported")
        level = DiagnosticLevel.WARN if status.battery_remaining < _BATTERY_LOW else DiagnosticLevel.OK
        return DiagnosticStatus(
            level, f"{status.battery_remaining} %", {"voltage": status.voltage_battery / 1000}
        )
