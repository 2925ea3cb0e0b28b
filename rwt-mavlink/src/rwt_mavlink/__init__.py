"""Vehicles of ArduPilot and PX4 as robots for rosbridge clients, over MAVLink.

:class:`Station` is a ground station with a node for each vehicle; :class:`MavlinkSettings` are its settings.
"""

from __future__ import annotations

from rwt_mavlink.settings import MavlinkSettings
from rwt_mavlink.station import Station

__all__ = ["MavlinkSettings", "Station"]
