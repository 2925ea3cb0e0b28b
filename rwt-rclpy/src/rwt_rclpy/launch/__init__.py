"""Launch files in Python, and the processes that they start: `launch` and `launch_ros`."""

from __future__ import annotations

from rwt_rclpy.launch import (
    actions,
    conditions,
    event_handlers,
    events,
    logging,
    sources,
    substitutions,
)
from rwt_rclpy.launch.conditions import Condition
from rwt_rclpy.launch.entities import (
    Action,
    Event,
    LaunchContext,
    LaunchDescription,
    LaunchDescriptionEntity,
    SomeEntitiesType,
    SomeSubstitutionsType,
    Substitution,
)
from rwt_rclpy.launch.event_handlers import EventHandler
from rwt_rclpy.launch.service import LaunchService
from rwt_rclpy.launch.sources import LaunchDescriptionSource

#: The module under the name in launch files.
launch_description_sources = sources

__all__ = [
    "Action",
    "Condition",
    "Event",
    "EventHandler",
    "LaunchContext",
    "LaunchDescription",
    "LaunchDescriptionEntity",
    "LaunchDescriptionSource",
    "LaunchService",
    "SomeEntitiesType",
    "SomeSubstitutionsType",
    "Substitution",
    "actions",
    "conditions",
    "event_handlers",
    "events",
    "launch_description_sources",
    "logging",
    "substitutions",
]
