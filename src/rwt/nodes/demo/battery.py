"""Battery that drains, faster while the robot drives, and its topic `/battery_state`."""

from __future__ import annotations

from rwt.nodes.demo import messages
from rwt.nodes.demo.drive import Velocity
from rwt.nodes.demo.model.urdf import BASE
from rwt_graph import Node

#: Volts of three lithium cells, empty and full.
EMPTY_VOLTAGE = 9.9
FULL_VOLTAGE = 12.6
#: Ampere hours when full.
CAPACITY = 2.5
#: Numbers of `sensor_msgs/BatteryState`.
_DISCHARGING, _HEALTH_GOOD, _LITHIUM_ION = 2, 1, 2
_CELLS = 3
#: Amperes of the computer and the laser, and of the motors for each m/s and each rad/s.
_IDLE_CURRENT = 0.8
_DRIVING_CURRENT = 3.0
_TURNING_CURRENT = 0.6


class Battery:
    """State of charge.

    Attributes:
        level: 1.0 full, 0.0 empty.
        current: current draw, amperes.
    """

    def __init__(self) -> None:
        self.level = 1.0
        self.current = _IDLE_CURRENT

    @property
    def voltage(self) -> float:
        """Voltage at this level."""
        return EMPTY_VOLTAGE + (FULL_VOLTAGE - EMPTY_VOLTAGE) * self.level

    def swap(self) -> None:
        """Recharge the battery."""
        self.level = 1.0

    def drain(self, velocity: Velocity, seconds: float) -> None:
        """Draw current for `seconds` at that velocity; an empty battery stays at 0."""
        self.current = (
            _IDLE_CURRENT + _DRIVING_CURRENT * abs(velocity.linear) + _TURNING_CURRENT * abs(velocity.angular)
        )
        self.level = max(0.0, self.level - self.current * seconds / 3600 / CAPACITY)


class BatteryPublisher:
    """Publisher of `/battery_state`."""

    def __init__(self, node: Node, battery: Battery) -> None:
        self._node = node
        self._battery = battery
        self._frame = messages.frame(node, BASE)
        self._states = node.advertise("battery_state", "sensor_msgs/BatteryState")

    def publish(self) -> None:
        """Publish the current state."""
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
