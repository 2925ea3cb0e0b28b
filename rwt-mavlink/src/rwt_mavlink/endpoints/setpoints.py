"""Setpoints of a vehicle, with a dead-man: what moves it stops when its stream of messages stops."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from rwt_graph import Node
from rwt_mavlink.endpoints.conversions import Vector, frd_flu, ned_enu, ned_yaw, yaw_of
from rwt_mavlink.link.frames import MavlinkMessage, dialect
from rwt_mavlink.settings import MavlinkSettings
from rwt_mavlink.vehicle import Vehicle
from rwt_participant.messages import Message
from rwt_participant.timers import PeriodicTimer, Watchdog

_LOCAL_NED: Final = dialect.MAV_FRAME_LOCAL_NED
_BODY_NED: Final = dialect.MAV_FRAME_BODY_NED
_POSITION: Final = 7
_VELOCITY: Final = 7 << 3
_ACCELERATION: Final = 7 << 6
_YAW: Final = 1 << 10
_YAW_RATE: Final = 1 << 11

#: What a velocity leaves out, and what a position leaves out.
_VELOCITY_ONLY: Final = _POSITION | _ACCELERATION | _YAW
_POSITION_ONLY: Final = _VELOCITY | _ACCELERATION | _YAW_RATE

#: A stop is repeated for longer than a gap of the link.
_STOP_SECONDS: Final = 5.0
_STOP_PERIOD_SECONDS: Final = 0.1
#: Maximum of coordinates, speeds and angles.
_MAX_NUMBER: Final = 1e6
_CHANNELS: Final = 18
_RELEASE: Final = 0
#: Value that releases channels 9 to 18, for which 0 means no change.
_RELEASE_EXTENDED: Final = 65534
_NO_CHANGE: Final = 65535


class DeadMan:
    """Dead-man of one kind of commands.

    Args:
        node: node of the vehicle.
        seconds: silence after which the vehicle is stopped.
        stop: sends the message that stops it; called repeatedly, because the link may lose it.
        report: called once with the silence, when it begins.
    """

    def __init__(
        self, node: Node, seconds: float, stop: Callable[[], None], report: Callable[[float], None]
    ) -> None:
        self._node = node
        self._seconds = seconds
        self._stop = stop
        self._report = report
        self._watchdog = Watchdog(node, seconds, self._expire)
        self._repeats: PeriodicTimer | None = None
        self._until = 0.0
        self._is_moving = False

    def feed(self) -> None:
        """Note a command."""
        self._end()
        self._is_moving = True
        self._watchdog.feed()

    def release(self) -> None:
        """Note a command after which nothing needs to be stopped."""
        self._end()
        self._is_moving = False

    def close(self) -> None:
        """End the dead-man, after a last stop if commands were arriving."""
        self._watchdog.close()
        self._end()
        if self._is_moving:
            self._stop()

    def _expire(self) -> None:
        if not self._is_moving:
            return
        self._is_moving = False
        self._report(self._seconds)
        self._until = self._node.clock.monotonic() + _STOP_SECONDS
        self._end()
        self._repeats = self._node.create_timer(_STOP_PERIOD_SECONDS, self._repeat)
        self._stop()

    def _repeat(self) -> None:
        self._stop()
        if self._node.clock.monotonic() >= self._until:
            self._end()

    def _end(self) -> None:
        if self._repeats is not None:
            self._repeats.cancel()
            self._repeats = None


class Setpoints:
    """Topics of setpoints of one vehicle.

    Positions are goals that end by themselves. Velocities, accelerations and overrides move the vehicle for
    as long as messages arrive, each with a dead-man.

    Args:
        node: node of the vehicle.
        prefix: namespace of the vehicle.
        vehicle: the vehicle.
        settings: settings of the station.
    """

    def __init__(self, node: Node, prefix: str, vehicle: Vehicle, settings: MavlinkSettings) -> None:
        self._node = node
        self._vehicle = vehicle
        self._is_body = settings.velocity_frame == "body"
        self._rejected = ""
        self._velocity = DeadMan(node, settings.dead_man, self._hover, self._report("velocities"))
        self._override = DeadMan(node, settings.dead_man, self._release, self._report("overrides"))
        for name, type, handler in (
            ("setpoint_velocity/cmd_vel", "geometry_msgs/TwistStamped", self._on_twist_stamped),
            ("setpoint_velocity/cmd_vel_unstamped", "geometry_msgs/Twist", self._on_twist),
            ("setpoint_position/local", "geometry_msgs/PoseStamped", self._on_pose),
            ("setpoint_position/global", "geographic_msgs/GeoPoseStamped", self._on_geo_pose),
            ("setpoint_raw/local", "mavros_msgs/PositionTarget", self._on_raw),
            ("setpoint_raw/global", "mavros_msgs/GlobalPositionTarget", self._on_raw_global),
            ("rc/override", "mavros_msgs/OverrideRCIn", self._on_override),
        ):
            node.subscribe(f"{prefix}/{name}", handler, type)

    def close(self) -> None:
        """Stop the vehicle if it is moved, and take no more setpoints."""
        self._velocity.close()
        self._override.close()

    # -- velocities ------------------------------------------------------------------------------------------

    def _on_twist_stamped(self, message: Message) -> None:
        self._on_twist(message.twist)

    def _on_twist(self, twist: Message) -> None:
        linear = twist.linear.x, twist.linear.y, twist.linear.z
        if not self._may_send((*linear, twist.angular.z), "velocity"):
            return
        self._velocity.feed()
        self._send_velocity(linear, -twist.angular.z)

    def _send_velocity(self, linear: Vector, yaw_rate: float) -> None:
        frame = _BODY_NED if self._is_body else _LOCAL_NED
        speeds = frd_flu(*linear) if self._is_body else ned_enu(*linear)
        self._send_local(frame, _VELOCITY_ONLY, (0.0, 0.0, 0.0), speeds, (0.0, 0.0, 0.0), 0.0, yaw_rate)

    def _hover(self) -> None:
        if not self._vehicle.unavailable:
            self._send_velocity((0.0, 0.0, 0.0), 0.0)

    # -- positions -------------------------------------------------------------------------------------------

    def _on_pose(self, message: Message) -> None:
        place, turned = message.pose.position, message.pose.orientation
        position, yaw = (place.x, place.y, place.z), yaw_of(turned.w, turned.x, turned.y, turned.z)
        if self._may_send((*position, yaw), "position"):
            none = (0.0, 0.0, 0.0)
            self._send_local(_LOCAL_NED, _POSITION_ONLY, ned_enu(*position), none, none, ned_yaw(yaw), 0.0)

    def _on_geo_pose(self, message: Message) -> None:
        place, turned = message.pose.position, message.pose.orientation
        yaw = yaw_of(turned.w, turned.x, turned.y, turned.z)
        if self._may_send((place.latitude, place.longitude, place.altitude, yaw), "position"):
            none = (0.0, 0.0, 0.0)
            places = place.latitude, place.longitude, place.altitude
            frame = dialect.MAV_FRAME_GLOBAL_INT
            self._send_global(frame, _POSITION_ONLY, places, none, none, ned_yaw(yaw), 0.0)

    # -- raw setpoints ---------------------------------------------------------------------------------------

    def _on_raw(self, message: Message) -> None:
        is_body = message.coordinate_frame in (_BODY_NED, message.FRAME_BODY_OFFSET_NED)
        turned = frd_flu if is_body else ned_enu
        if message.coordinate_frame not in (_LOCAL_NED, message.FRAME_LOCAL_OFFSET_NED) and not is_body:
            self._reject(f"the frame {message.coordinate_frame} is not supported")
            return
        numbers = _used(message, _vector(message.position))
        if self._may_send(numbers, "setpoint"):
            self._feed_if_moving(message)
            place, velocity, acceleration = turned(*numbers[:3]), turned(*numbers[3:6]), turned(*numbers[6:9])
            yaw = -numbers[9] if is_body else ned_yaw(numbers[9])
            self._send_local(message.coordinate_frame, message.type_mask, place, velocity, acceleration, yaw,
                             -numbers[10])  # fmt: skip

    def _on_raw_global(self, message: Message) -> None:
        if message.coordinate_frame not in (5, 6, 11):
            self._reject(f"the frame {message.coordinate_frame} is not supported")
            return
        numbers = _used(message, (message.latitude, message.longitude, message.altitude))
        if self._may_send(numbers, "setpoint"):
            self._feed_if_moving(message)
            place = numbers[0], numbers[1], numbers[2]
            self._send_global(message.coordinate_frame, message.type_mask, place,
                              ned_enu(*numbers[3:6]), ned_enu(*numbers[6:9]), ned_yaw(numbers[9]),
                              -numbers[10])  # fmt: skip

    def _feed_if_moving(self, message: Message) -> None:
        """A setpoint with a velocity, an acceleration or a yaw rate moves the vehicle until it is stopped."""
        moving = ~message.type_mask
        if moving & (_VELOCITY | _ACCELERATION | _YAW_RATE):
            self._velocity.feed()

    # -- overrides -------------------------------------------------------------------------------------------

    def _on_override(self, message: Message) -> None:
        if self._may_send((), "override"):
            channels = [int(each) for each in message.channels]
            if all(each in (_RELEASE, _NO_CHANGE) for each in channels):
                self._override.release()
            else:
                self._override.feed()
            self._send_channels(channels)

    def _release(self) -> None:
        if not self._vehicle.unavailable:
            self._send_channels([_RELEASE] * 8 + [_RELEASE_EXTENDED] * (_CHANNELS - 8))

    def _send_channels(self, channels: Sequence[int]) -> None:
        target = self._vehicle.exchange.target
        self._vehicle.exchange.send(
            dialect.MAVLink_rc_channels_override_message(target.system, target.component, *channels)
        )

    # -- sending ---------------------------------------------------------------------------------------------

    def _may_send(self, numbers: Sequence[float], what: str) -> bool:
        if reason := self._vehicle.unavailable:
            self._reject(reason)
            return False
        if not all(abs(each) <= _MAX_NUMBER for each in numbers):
            self._reject(f"a {what} that is not finite, or beyond {_MAX_NUMBER:g}")
            return False
        self._rejected = ""
        return True

    def _reject(self, reason: str) -> None:
        """Log a rejection, once for many of the same kind."""
        kind = reason.partition(":")[0]
        if kind != self._rejected:
            self._rejected = kind
            text = f"rejected a setpoint: {reason}"
            self._node.log.warning(text)

    def _report(self, what: str) -> Callable[[float], None]:
        def report(seconds: float) -> None:
            text = f"no {what} for {seconds:g} s: stopping the vehicle"
            self._node.log.warning(text)

        return report

    def _send_local(
        self, frame: int, mask: int, place: Vector, velocity: Vector, acceleration: Vector, yaw: float,
        yaw_rate: float,
    ) -> None:  # fmt: skip
        target = self._vehicle.exchange.target
        self._send(
            dialect.MAVLink_set_position_target_local_ned_message(
                self._milliseconds, target.system, target.component, frame, mask,
                *place, *velocity, *acceleration, yaw, yaw_rate,
            )
        )  # fmt: skip

    def _send_global(
        self, frame: int, mask: int, place: Vector, velocity: Vector, acceleration: Vector, yaw: float,
        yaw_rate: float,
    ) -> None:  # fmt: skip
        target, (latitude, longitude, altitude) = self._vehicle.exchange.target, place
        if abs(latitude) > 90 or abs(longitude) > 180:
            self._reject(f"the position {latitude:g}, {longitude:g} is not on earth")
            return
        self._send(
            dialect.MAVLink_set_position_target_global_int_message(
                self._milliseconds, target.system, target.component, frame, mask,
                round(latitude * 1e7), round(longitude * 1e7), altitude,
                *velocity, *acceleration, yaw, yaw_rate,
            )
        )  # fmt: skip

    def _send(self, message: MavlinkMessage) -> None:
        self._vehicle.exchange.send(message)

    @property
    def _milliseconds(self) -> int:
        return int(self._node.clock.monotonic() * 1000) % 2**32


def _vector(value: Message) -> Vector:
    return value.x, value.y, value.z


def _used(message: Message, place: Vector) -> list[float]:
    """Return position, velocity, acceleration, yaw and yaw rate; 0 where the mask excludes the number."""
    vectors = *place, *_vector(message.velocity), *_vector(message.acceleration_or_force)
    bits = *range(9), 10, 11
    numbers = zip(bits, (*vectors, message.yaw, message.yaw_rate), strict=True)
    return [0.0 if message.type_mask & (1 << bit) else number for bit, number in numbers]
