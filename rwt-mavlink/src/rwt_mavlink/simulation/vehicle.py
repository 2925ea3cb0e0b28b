"""Simulated multicopter: commands, modes, simple flight, failsafe and telemetry; no I/O."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from rwt_mavlink.link.frames import FrameReader, FrameWriter, MavlinkMessage, dialect
from rwt_mavlink.protocol.exchange import Identity
from rwt_mavlink.protocol.missions import Plan
from rwt_mavlink.simulation.plans import ParameterService, PlanService, sender_of

HOME: Final = (47.397742, 8.545594, 488.0)
"""Latitude and longitude in degrees, and altitude in metres, of the place where it starts."""

_METRES_PER_DEGREE: Final = 111_319.5
_SPEED: Final = 5.0
_CLIMB: Final = 2.5
_DESCENT: Final = 1.5
_REACHED: Final = 0.3
#: Seconds without a velocity after which it hovers, as with ArduPilot's GUID_TIMEOUT.
_VELOCITY_SECONDS: Final = 3.0
_BOOT_SECONDS: Final = 2.0
#: Time in which a repeated command is recognised.
_REPEAT_SECONDS: Final = 30.0
_IGNORE_POSITION: Final = 7
_IGNORE_VELOCITY: Final = 7 << 3
_GLOBAL_FRAMES: Final = {0, 3, 5, 6, 10, 11}

#: Numbers of ArduPilot Copter's modes.
STABILIZE, AUTO, GUIDED, LOITER, RTL, LAND = 0, 3, 4, 5, 6, 9

#: PX4's modes with the same meaning: the custom mode's upper bytes.
_PX4_MODES: Final = {
    STABILIZE: 7 << 16, AUTO: (4 << 16) | (4 << 24), GUIDED: 6 << 16, LOITER: (4 << 16) | (3 << 24),
    RTL: (4 << 16) | (5 << 24), LAND: (4 << 16) | (6 << 24),
}  # fmt: skip


class Executed(NamedTuple):
    """Command that was executed.

    Attributes:
        confirmation: number of the transmission that was executed.
    """

    station: Identity
    command: int
    parameters: tuple[float, ...]
    confirmation: int


class SimulatedVehicle:
    """Multicopter of ArduPilot, or of PX4, with simple flight.

    Its state is the flight's (`mode`, `is_armed`, `position`, `velocity`, `target`), and the journal of its
    commands (`executed`, `setpoints`). A restart clears everything but plans and parameters.

    Args:
        system: system id.
        px4: True for modes and parameters like PX4's.

    Attributes:
        outbox: frames for all stations, which the caller takes.
        mode: number of the mode, one of the constants of this module.
        is_armed: True if its motors turn.
        position: metres north, east and down of its start.
        velocity: metres per second, likewise.
        executed: commands, without repetitions.
        setpoints: velocities and overrides that were received, with their time.
        plans: mission service.
        parameters: parameter service.
        restarts: number of restarts.
    """

    def __init__(self, system: int = 1, *, px4: bool = False) -> None:
        self._own = Identity(system, dialect.MAV_COMP_ID_AUTOPILOT1)
        self._px4 = px4
        self._writer = FrameWriter(system, self._own.component)
        self._now = 0.0
        self.outbox: list[bytes] = []
        self.executed: list[Executed] = []
        self.setpoints: list[tuple[float, str, tuple[float, ...]]] = []
        self.plans = PlanService(self.send)
        self.parameters = ParameterService(self.send, px4)
        failsafe = (
            {"NAV_DLL_ACT": 2, "COM_DL_LOSS_T": 10} if px4 else {"FS_GCS_ENABLE": 1, "FS_GCS_TIMEOUT": 5.0}
        )
        self.parameters.values.update(
            {**failsafe, "FENCE_ALT_MAX": 100.0, "RTL_ALT": 1500, "WPNAV_SPEED": 500.0}
        )
        self.restarts = 0
        self._start(0.0)

    def _start(self, now: float) -> None:
        self._started_at = now
        self._sent_at = -1.0
        self.mode = STABILIZE
        self.is_armed = False
        self.position = (0.0, 0.0, 0.0)
        self.velocity = (0.0, 0.0, 0.0)
        self.target: tuple[float, float, float] | None = None
        self._velocity_until = 0.0
        self._waypoint = 0
        self._station_at = now
        self._acks: dict[tuple[Identity, int], tuple[Executed, int, float]] = {}

    def restart(self) -> None:
        """Lose power for a moment; it boots for some seconds, without receiving anything."""
        self.restarts += 1
        self.plans.restart()
        self._start(self._now + _BOOT_SECONDS)

    @property
    def is_running(self) -> bool:
        """False while it boots."""
        return self._now >= self._started_at

    def send(self, message: MavlinkMessage) -> None:
        """Send a message to all stations."""
        self.outbox.append(self._writer.encode(message))

    # -- received --------------------------------------------------------------------------------------------

    def receive(self, data: bytes) -> None:
        """Take the frames of a station."""
        if not self.is_running:
            return
        for message in FrameReader().decode(data):
            if getattr(message, "target_system", self._own.system) in (0, self._own.system):
                self._take(message)

    def _take(self, message: MavlinkMessage) -> None:
        type = message.get_type()
        if type == "HEARTBEAT":
            self._station_at = self._now
        elif type == "COMMAND_LONG":
            seven = tuple(getattr(message, f"param{number}") for number in range(1, 8))
            self._command(message, seven, message.confirmation)
        elif type == "COMMAND_INT":
            four = tuple(getattr(message, f"param{number}") for number in range(1, 5))
            self._command(message, (*four, message.x / 1e7, message.y / 1e7, message.z), 0)
        elif type.startswith("MISSION_"):
            self.plans.receive(message)
        elif type.startswith("PARAM_"):
            self.parameters.receive(message)
        elif type in ("SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT"):
            self._setpoint(message)
        elif type == "RC_CHANNELS_OVERRIDE":
            channels = tuple(float(getattr(message, f"chan{number}_raw")) for number in range(1, 9))
            self.setpoints.append((self._now, "override", channels))

    def _setpoint(self, message: MavlinkMessage) -> None:
        if not message.type_mask & _IGNORE_VELOCITY:
            velocity = (message.vx, message.vy, message.vz)
            self.setpoints.append((self._now, "velocity", velocity))
            if self.mode == GUIDED and self.is_armed:
                self.target, self.velocity = None, velocity
                self._velocity_until = self._now + _VELOCITY_SECONDS
        elif not message.type_mask & _IGNORE_POSITION:
            if message.get_type() == "SET_POSITION_TARGET_GLOBAL_INT":
                target = self._local(message.lat_int / 1e7, message.lon_int / 1e7, message.alt)
            else:
                target = (message.x, message.y, message.z)
            self.setpoints.append((self._now, "position", target))
            if self.mode == GUIDED and self.is_armed:
                self.target = target

    def _command(self, message: MavlinkMessage, parameters: tuple[float, ...], confirmation: int) -> None:
        station = sender_of(message)
        command = Executed(station, message.command, parameters, confirmation)
        before = self._acks.get((station, message.command))
        if (
            confirmation
            and before is not None
            and before[0].parameters == parameters
            and self._now - before[2] < _REPEAT_SECONDS
        ):
            result = before[1]
        else:
            result = self._execute(message.command, parameters)
            self.executed.append(command)
        self._acks[station, message.command] = (command, result, self._now)
        self.send(
            dialect.MAVLink_command_ack_message(
                message.command, result, 0, 0, station.system, station.component
            )
        )

    def _execute(self, command: int, parameters: Sequence[float]) -> int:
        accepted, denied = int(dialect.MAV_RESULT_ACCEPTED), int(dialect.MAV_RESULT_DENIED)
        match command:
            case dialect.MAV_CMD_COMPONENT_ARM_DISARM:
                if not parameters[0] and self.position[2] < -_REACHED and parameters[1] != 21196:
                    return denied  # It flies.
                self.is_armed = bool(parameters[0])
            case dialect.MAV_CMD_DO_SET_MODE:
                return accepted if self._set_mode(parameters) else denied
            case dialect.MAV_CMD_NAV_TAKEOFF:
                if not self.is_armed or (self.mode != GUIDED and not self._px4):
                    return denied
                self.mode = GUIDED
                self.target = (self.position[0], self.position[1], -parameters[6])
            case dialect.MAV_CMD_NAV_LAND:
                self.mode = LAND
            case dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                self.mode = RTL
            case dialect.MAV_CMD_MISSION_START:
                self.mode, self._waypoint = AUTO, 0
            case dialect.MAV_CMD_DO_SET_MISSION_CURRENT:
                if not 0 <= parameters[0] < len(self.plans.plans[Plan.MISSION]):
                    return denied
                self._waypoint = int(parameters[0])
            case (
                dialect.MAV_CMD_DO_SET_HOME
                | dialect.MAV_CMD_SET_MESSAGE_INTERVAL
                | dialect.MAV_CMD_DO_SET_SERVO
            ):
                pass
            case _:
                return int(dialect.MAV_RESULT_UNSUPPORTED)
        return accepted

    def _set_mode(self, parameters: Sequence[float]) -> bool:
        wanted = int(parameters[1])
        if self._px4:
            wanted = (int(parameters[1]) << 16) | (int(parameters[2]) << 24)
            known = {number: mode for mode, number in _PX4_MODES.items()}
            if wanted not in known:
                return False
            wanted = known[wanted]
        elif wanted not in _PX4_MODES:
            return False
        self.mode, self.target, self.velocity, self._waypoint = wanted, None, (0.0, 0.0, 0.0), 0
        return True

    # -- flight ----------------------------------------------------------------------------------------------

    def step(self, now: float) -> None:
        """Advance to a time in seconds; at most a tenth of a second after the last."""
        seconds, self._now = now - self._now, now
        if not self.is_running:
            return
        self.plans.step(now)
        self.parameters.step()
        if self.is_armed:
            self._fly(seconds)
        if now - self._sent_at >= 0.2:
            self._report(has_heartbeat=int(now) != int(self._sent_at))
            self._sent_at = now

    def _fly(self, seconds: float) -> None:
        values = self.parameters.values
        is_on, timeout = (
            (values["NAV_DLL_ACT"], values["COM_DL_LOSS_T"])
            if self._px4
            else (values["FS_GCS_ENABLE"], values["FS_GCS_TIMEOUT"])
        )
        if is_on and self._now - self._station_at > timeout and self.mode not in (RTL, LAND):
            self.mode = RTL
        if self.mode == RTL:
            self.target = (0.0, 0.0, min(self.position[2], -5.0))
            if math.hypot(*self.position[:2]) < _REACHED:
                self.mode = LAND
        if self.mode == AUTO:
            self._follow_mission()
        if self.mode == LAND:
            self.target = (self.position[0], self.position[1], 0.0)
        if self.mode == GUIDED and self.target is None and self._now > self._velocity_until:
            self.velocity = (0.0, 0.0, 0.0)
        if self.mode in (STABILIZE, LOITER):
            self.target, self.velocity = None, (0.0, 0.0, 0.0)
        if self.target is not None:
            self.velocity = self._towards(self.target, seconds)
        self.position = tuple(  # type: ignore[assignment]
            place + each * seconds for place, each in zip(self.position, self.velocity, strict=True)
        )
        if self.mode == LAND and self.position[2] > -0.05:
            self.position = (self.position[0], self.position[1], 0.0)
            self.velocity, self.target, self.is_armed = (0.0, 0.0, 0.0), None, False

    def _follow_mission(self) -> None:
        items = self.plans.plans[Plan.MISSION]
        if self._waypoint >= len(items):
            self.target, self.velocity = None, (0.0, 0.0, 0.0)
            return
        item = items[self._waypoint]
        if item.command == dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            self.mode = RTL
            return
        if item.frame in _GLOBAL_FRAMES and (item.x or item.y):
            self.target = self._local(item.x / 1e7, item.y / 1e7, item.z)
        else:
            self.target = (self.position[0], self.position[1], -item.z)
        if math.dist(self.position, self.target) < _REACHED:
            self.send(dialect.MAVLink_mission_item_reached_message(self._waypoint))
            self._waypoint += 1

    def _towards(self, target: tuple[float, float, float], seconds: float) -> tuple[float, float, float]:
        away = [goal - place for goal, place in zip(target, self.position, strict=True)]
        distance = math.hypot(*away[:2])
        scale = min(_SPEED, distance / max(seconds, 1e-3)) / distance if distance > 1e-6 else 0.0
        climb = max(-_CLIMB, min(_DESCENT, away[2] / max(seconds, 1e-3)))
        return away[0] * scale, away[1] * scale, climb

    @staticmethod
    def _local(latitude: float, longitude: float, altitude: float) -> tuple[float, float, float]:
        north = (latitude - HOME[0]) * _METRES_PER_DEGREE
        east = (longitude - HOME[1]) * _METRES_PER_DEGREE * math.cos(math.radians(HOME[0]))
        return north, east, -altitude

    # -- telemetry -------------------------------------------------------------------------------------------

    def _report(self, *, has_heartbeat: bool) -> None:
        boot_ms = 1 + int((self._now - self._started_at) * 1000)
        north, east, down = self.position
        latitude = HOME[0] + north / _METRES_PER_DEGREE
        longitude = HOME[1] + east / (_METRES_PER_DEGREE * math.cos(math.radians(HOME[0])))
        degrees = int(latitude * 1e7), int(longitude * 1e7)
        height = int((HOME[2] - down) * 1000), int(-down * 1000)
        speeds = [int(each * 100) for each in self.velocity]
        if has_heartbeat:
            self._beat()
            self.send(dialect.MAVLink_system_time_message(1_790_000_000_000_000, boot_ms))
            self.send(
                dialect.MAVLink_gps_raw_int_message(boot_ms * 1000, 3, *degrees, height[0], 80, 120, 0, 0, 12)
            )
            self.send(dialect.MAVLink_sys_status_message(0, 0, 0, 100, 12_400, 250, 87, 0, 0, 0, 0, 0, 0))
            self.send(dialect.MAVLink_mission_current_message(self._waypoint))
        self.send(dialect.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        self.send(dialect.MAVLink_local_position_ned_message(boot_ms, north, east, down, *self.velocity))
        self.send(dialect.MAVLink_global_position_int_message(boot_ms, *degrees, *height, *speeds, 0))

    def _beat(self) -> None:
        base = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        if self.is_armed:
            base |= dialect.MAV_MODE_FLAG_SAFETY_ARMED
        if self.mode in (GUIDED, AUTO, RTL):
            base |= dialect.MAV_MODE_FLAG_GUIDED_ENABLED
        autopilot = dialect.MAV_AUTOPILOT_PX4 if self._px4 else dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
        state = dialect.MAV_STATE_ACTIVE if self.is_armed else dialect.MAV_STATE_STANDBY
        custom = _PX4_MODES[self.mode] if self._px4 else self.mode
        self.send(
            dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_QUADROTOR, autopilot, base, custom, state, 3)
        )
