"""Sensors of the robot: laser scans and battery state."""

from __future__ import annotations

from rwt.nodes.demo import messages
from rwt.nodes.demo.battery import CAPACITY, Battery
from rwt.nodes.demo.drive import DifferentialDrive
from rwt.nodes.demo.frames import frame
from rwt.nodes.demo.model.urdf import BASE, LASER
from rwt.nodes.demo.world.lidar import Lidar
from rwt_graph import Node, Timer
from rwt_participant.qos import SENSOR_DATA

#: Numbers of `sensor_msgs/BatteryState`.
_DISCHARGING, _HEALTH_GOOD, _LITHIUM_ION = 2, 1, 2
_CELLS = 3


class ScanPublisher:
    """Publishes `/scan`."""

    def __init__(self, node: Node, drive: DifferentialDrive, lidar: Lidar) -> None:
        self._node = node
        self._drive = drive
        self._lidar = lidar
        self._frame = frame(node, LASER)
        self._scans = node.advertise("scan", "sensor_msgs/LaserScan", qos=SENSOR_DATA)
        self._period = 0.1
        self._timer: Timer | None = None

    def start(self) -> None:
        """Publish scans from now on."""
        self._timer = self._node.create_timer(self._period, self._scan)

    def set_rate(self, rate: float) -> None:
        """Scan `rate` times a second from now on."""
        self._period = 1 / rate
        if self._timer is not None:
            self._timer.cancel()
            self.start()

    def _scan(self) -> None:
        # Rays are cast for subscribers only.
        if not self._scans.subscriber_count:
            return
        lidar = self._lidar
        self._scans.publish(
            {
                "header": messages.header(self._node.clock.time_ns(), self._frame),
                "angle_min": lidar.angle_min,
                "angle_max": lidar.angle_min + (lidar.ray_count - 1) * lidar.angle_increment,
                "angle_increment": lidar.angle_increment,
                "scan_time": self._period,
                "range_min": lidar.range_min,
                "range_max": lidar.range_max,
                "ranges": lidar.scan(self._drive.pose),
            }
        )


class BatteryPublisher:
    """Publishes `/battery_state`."""

    def __init__(self, node: Node, battery: Battery) -> None:
        self._node = node
        self._battery = battery
        self._frame = frame(node, BASE)
        self._states = node.advertise("battery_state", "sensor_msgs/BatteryState")

    def publish(self) -> None:
        """Publish the state of this moment."""
        battery = self._battery
        self._states.publish(
            {
                "header": messages.header(self._node.clock.time_ns(), self._frame),
                "voltage": round(battery.voltage, 3),
                "current": round(-battery.current, 3),
                "charge": round(battery.level * CAPACITY, 4),
                "capacity": CAPACITY,
                "design_capacity": CAPACITY,
                "percentage": round(battery.level, 4),
                "power_supply_status": _DISCHARGING,
                "power_supply_health": _HEALTH_GOOD,
                "power_supply_technology": _LITHIUM_ION,
                "present": True,
                "cell_voltage": [round(battery.voltage / _CELLS, 3)] * _CELLS,
                "location": "main",
            }
        )
