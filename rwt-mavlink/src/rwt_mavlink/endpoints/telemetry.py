"""Telemetry of a vehicle: one row for each topic, with the messages of MAVLink that it comes from."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final, NamedTuple, TypeAlias

from rwt_graph import Node
from rwt_mavlink.endpoints.conversions import (
    Quaternion,
    enu_orientation,
    frd_flu,
    from_euler,
    ned_enu,
    quaternion,
    vector,
)
from rwt_mavlink.link.frames import MavlinkMessage, dialect
from rwt_mavlink.vehicle import Vehicle
from rwt_participant.handles import Publisher

Content: TypeAlias = Mapping[str, Any]
"""Message as it is published."""

_MAP: Final = {"frame_id": "map"}
_BASE_LINK: Final = {"frame_id": "base_link"}
_GRAVITY: Final = 9.80665
_UNKNOWN_U16: Final = 0xFFFF
#: Values of `covariance_type` in `sensor_msgs/NavSatFix`: unknown, and the diagonal is known.
_COVARIANCE_UNKNOWN, _COVARIANCE_DIAGONAL = 0, 2
#: Channels of RC_CHANNELS, and of SERVO_OUTPUT_RAW.
_CHANNELS: Final = 18
_SERVOS: Final = 16


class Row(NamedTuple):
    """Topic of telemetry.

    Attributes:
        topic: name below the vehicle's namespace.
        type: message type.
        source: type of the MAVLink message that causes a message.
        convert: returns the message, or None if there is nothing to publish.
    """

    topic: str
    type: str
    source: str
    convert: Callable[[MavlinkMessage, Vehicle], Content | None]


def _attitude(vehicle: Vehicle) -> Quaternion | None:
    """Return the newest attitude, in MAVLink's axes."""
    exact, euler = vehicle.latest.get("ATTITUDE_QUATERNION"), vehicle.latest.get("ATTITUDE")
    if exact is not None and (euler is None or exact.time_boot_ms >= euler.time_boot_ms):
        return exact.q1, exact.q2, exact.q3, exact.q4
    return None if euler is None else from_euler(euler.roll, euler.pitch, euler.yaw)


def _orientation(vehicle: Vehicle) -> dict[str, float]:
    attitude = _attitude(vehicle)
    return quaternion((1.0, 0.0, 0.0, 0.0) if attitude is None else enu_orientation(attitude))


def _rates(vehicle: Vehicle) -> dict[str, float]:
    newest = vehicle.latest.get("ATTITUDE") or vehicle.latest.get("ATTITUDE_QUATERNION")
    if newest is None:
        return vector((0.0, 0.0, 0.0))
    return vector(frd_flu(newest.rollspeed, newest.pitchspeed, newest.yawspeed))


def _acceleration(vehicle: Vehicle) -> dict[str, float]:
    exact = vehicle.latest.get("HIGHRES_IMU")
    if exact is not None:
        return vector(frd_flu(exact.xacc, exact.yacc, exact.zacc))
    for type in ("SCALED_IMU", "RAW_IMU"):
        if (raw := vehicle.latest.get(type)) is not None:  # In thousandths of g.
            return vector(frd_flu(*(each / 1000 * _GRAVITY for each in (raw.xacc, raw.yacc, raw.zacc))))
    return vector((0.0, 0.0, 0.0))


def _imu(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    return {
        "header": _BASE_LINK,
        "orientation": _orientation(vehicle),
        "angular_velocity": _rates(vehicle),
        "linear_acceleration": _acceleration(vehicle),
    }


def _imu_raw(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    scale = 1.0 if message.get_type() == "HIGHRES_IMU" else 0.001  # From milliradians per second.
    rates = frd_flu(*(each * scale for each in (message.xgyro, message.ygyro, message.zgyro)))
    return {
        "header": _BASE_LINK,
        "orientation_covariance": [-1.0, *[0.0] * 8],
        "angular_velocity": vector(rates),
        "linear_acceleration": _acceleration(vehicle),
    }


def _pose(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    position = vector(ned_enu(message.x, message.y, message.z))
    return {"header": _MAP, "pose": {"position": position, "orientation": _orientation(vehicle)}}


def _local_velocity(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    linear = vector(ned_enu(message.vx, message.vy, message.vz))
    return {"header": _MAP, "twist": {"linear": linear, "angular": _rates(vehicle)}}


def _local_odometry(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    """Pose in the map; the velocity is in the axes of the map as well, as `child_frame_id` says."""
    return {
        "header": _MAP,
        "child_frame_id": "map",
        "pose": {"pose": _pose(message, vehicle)["pose"]},
        "twist": {"twist": _local_velocity(message, vehicle)["twist"]},
    }


def _covariance(vehicle: Vehicle) -> Content:
    fix = vehicle.latest.get("GPS_RAW_INT")
    if fix is None or not fix.h_acc:
        return {"position_covariance_type": _COVARIANCE_UNKNOWN}
    horizontal, vertical = (fix.h_acc / 1000) ** 2, (fix.v_acc / 1000) ** 2
    diagonal = [horizontal, 0.0, 0.0, 0.0, horizontal, 0.0, 0.0, 0.0, vertical]
    return {"position_covariance": diagonal, "position_covariance_type": _COVARIANCE_DIAGONAL}


def _status(vehicle: Vehicle) -> Content:
    fix = vehicle.latest.get("GPS_RAW_INT")
    has_fix = fix is None or fix.fix_type >= dialect.GPS_FIX_TYPE_2D_FIX
    return {"status": 0 if has_fix else -1, "service": 1}


def _global(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    return {
        "header": _BASE_LINK,
        "status": _status(vehicle),
        "latitude": message.lat / 1e7,
        "longitude": message.lon / 1e7,
        "altitude": message.alt / 1000,
        **_covariance(vehicle),
    }


def _raw_fix(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    return {**_global(message, vehicle), "header": _BASE_LINK}


def _heading(message: MavlinkMessage, vehicle: Vehicle) -> Content | None:
    return None if message.hdg == _UNKNOWN_U16 else {"data": message.hdg / 100}


def _gps_raw(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    names = ("fix_type", "lat", "lon", "alt", "eph", "epv", "vel", "cog", "satellites_visible",
             "alt_ellipsoid", "h_acc", "v_acc", "yaw")  # fmt: skip
    fields = {name: getattr(message, name) for name in names}
    return {
        "header": _BASE_LINK,
        **fields,
        "vel_acc": message.vel_acc,
        "hdg_acc": min(message.hdg_acc, 2**31 - 1),
    }


def _battery(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    cells: list[float] = []
    percent, current = message.battery_remaining, message.current_battery
    if (status := vehicle.latest.get("BATTERY_STATUS")) is not None:
        # The first is the whole battery, if the autopilot does not measure its cells.
        cells = [each / 1000 for each in status.voltages if each != _UNKNOWN_U16]
    return {
        "header": {},
        "voltage": math.nan if message.voltage_battery == _UNKNOWN_U16 else message.voltage_battery / 1000,
        "current": math.nan if current < 0 else -current / 100,
        "percentage": math.nan if percent < 0 else percent / 100,
        "temperature": math.nan,
        "charge": math.nan,
        "capacity": math.nan,
        "design_capacity": math.nan,
        "power_supply_status": 2,
        "present": True,
        "cell_voltage": cells,
    }


def _vfr_hud(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    return {
        "header": {},
        "airspeed": message.airspeed,
        "groundspeed": message.groundspeed,
        "heading": message.heading,
        "throttle": message.throttle / 100,
        "altitude": message.alt,
        "climb": message.climb,
    }


def _altitude(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    return {
        "header": _MAP,
        "monotonic": message.altitude_monotonic,
        "amsl": message.altitude_amsl,
        "local": message.altitude_local,
        "relative": message.altitude_relative,
        "terrain": message.altitude_terrain,
        "bottom_clearance": message.bottom_clearance,
    }


def _home(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    return {
        "header": _MAP,
        "geo": {
            "latitude": message.latitude / 1e7,
            "longitude": message.longitude / 1e7,
            "altitude": message.altitude / 1000,
        },
        "position": vector(ned_enu(message.x, message.y, message.z)),
        "orientation": quaternion(enu_orientation(tuple(message.q))),
        "approach": vector(ned_enu(message.approach_x, message.approach_y, message.approach_z)),
    }


def _channels(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    channels = [
        getattr(message, f"chan{number}_raw") for number in range(1, min(message.chancount, _CHANNELS) + 1)
    ]
    return {"header": {}, "rssi": message.rssi, "channels": channels}


def _servos(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    channels = [getattr(message, f"servo{number}_raw", 0) for number in range(1, _SERVOS + 1)]
    return {"header": {}, "channels": channels}


def _extended_state(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    return {"header": {}, "vtol_state": message.vtol_state, "landed_state": message.landed_state}


def _system_status(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    names = ("voltage_battery", "current_battery", "battery_remaining", "drop_rate_comm", "errors_comm",
             "errors_count1", "errors_count2", "errors_count3", "errors_count4", "load")  # fmt: skip
    return {
        "header": {},
        **{name: getattr(message, name) for name in names},
        "sensors_present": message.onboard_control_sensors_present,
        "sensors_enabled": message.onboard_control_sensors_enabled,
        "sensors_health": message.onboard_control_sensors_health,
    }


def _time_reference(message: MavlinkMessage, vehicle: Vehicle) -> Content | None:
    if not message.time_unix_usec:
        return None
    seconds, microseconds = divmod(message.time_unix_usec, 1_000_000)
    if seconds >= 2**31:
        return None
    return {"header": {}, "time_ref": {"sec": seconds, "nanosec": microseconds * 1000}, "source": "fcu"}


def _radio(message: MavlinkMessage, vehicle: Vehicle) -> Content:
    names = ("rssi", "remrssi", "txbuf", "noise", "remnoise", "rxerrors", "fixed")
    # In half decibels, as radios with the firmware SiK report it.
    levels = {f"{name}_dbm": getattr(message, name) / 1.9 - 127 for name in ("rssi", "remrssi")}
    return {"header": {}, **{name: getattr(message, name) for name in names}, **levels}


TELEMETRY: Final = (
    Row("extended_state", "mavros_msgs/ExtendedState", "EXTENDED_SYS_STATE", _extended_state),
    Row("sys_status", "mavros_msgs/SysStatus", "SYS_STATUS", _system_status),
    Row("battery", "sensor_msgs/BatteryState", "SYS_STATUS", _battery),
    Row("global_position/global", "sensor_msgs/NavSatFix", "GLOBAL_POSITION_INT", _global),
    Row("global_position/rel_alt", "std_msgs/Float64", "GLOBAL_POSITION_INT",
        lambda message, _: {"data": message.relative_alt / 1000}),
    Row("global_position/compass_hdg", "std_msgs/Float64", "GLOBAL_POSITION_INT", _heading),
    Row("global_position/raw/fix", "sensor_msgs/NavSatFix", "GPS_RAW_INT", _raw_fix),
    Row("global_position/raw/satellites", "std_msgs/UInt32", "GPS_RAW_INT",
        lambda message, _: {"data": message.satellites_visible}),
    Row("gpsstatus/gps1/raw", "mavros_msgs/GPSRAW", "GPS_RAW_INT", _gps_raw),
    Row("local_position/pose", "geometry_msgs/PoseStamped", "LOCAL_POSITION_NED", _pose),
    Row("local_position/velocity_local", "geometry_msgs/TwistStamped", "LOCAL_POSITION_NED", _local_velocity),
    Row("local_position/odom", "nav_msgs/Odometry", "LOCAL_POSITION_NED", _local_odometry),
    Row("imu/data", "sensor_msgs/Imu", "ATTITUDE", _imu),
    Row("imu/data", "sensor_msgs/Imu", "ATTITUDE_QUATERNION", _imu),
    Row("imu/data_raw", "sensor_msgs/Imu", "RAW_IMU", _imu_raw),
    Row("imu/data_raw", "sensor_msgs/Imu", "SCALED_IMU", _imu_raw),
    Row("imu/data_raw", "sensor_msgs/Imu", "HIGHRES_IMU", _imu_raw),
    Row("vfr_hud", "mavros_msgs/VfrHud", "VFR_HUD", _vfr_hud),
    Row("altitude", "mavros_msgs/Altitude", "ALTITUDE", _altitude),
    Row("home_position/home", "mavros_msgs/HomePosition", "HOME_POSITION", _home),
    Row("rc/in", "mavros_msgs/RCIn", "RC_CHANNELS", _channels),
    Row("rc/out", "mavros_msgs/RCOut", "SERVO_OUTPUT_RAW", _servos),
    Row("radio_status", "mavros_msgs/RadioStatus", "RADIO_STATUS", _radio),
    Row("time_reference", "sensor_msgs/TimeReference", "SYSTEM_TIME", _time_reference),
)  # fmt: skip
"""Topics of telemetry, with the names and types of mavros."""

#: Topics whose last message is retained for late joiners.
_LATCHED: Final = {"home_position/home"}


def publish_telemetry(node: Node, prefix: str, vehicle: Vehicle) -> None:
    """Publish the telemetry of a vehicle below its namespace."""
    publishers: dict[str, Publisher] = {}
    for row in TELEMETRY:
        if row.topic not in publishers:
            publishers[row.topic] = node.advertise(
                f"{prefix}/{row.topic}", row.type, latch=row.topic in _LATCHED
            )
        vehicle.on(row.source, partial(_publish, row, vehicle, publishers[row.topic]))


def _publish(row: Row, vehicle: Vehicle, publisher: Publisher, message: MavlinkMessage) -> None:
    if (content := row.convert(message, vehicle)) is not None:
        publisher.publish(content)
