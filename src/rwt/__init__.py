"""Public API: an assembled server, and the names that most programs need.

Each name is imported on first use.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt.blocking import BlockingNode
    from rwt.errors import ServerError
    from rwt.playback import PlaybackServer
    from rwt.server import Server
    from rwt.settings import LoadedSettings, Settings, SettingsError, load_settings, read_settings
    from rwt_client import connect
    from rwt_graph import MemoryGraph, Node, SimulatedClock
    from rwt_participant.api import RobotApi
    from rwt_participant.diagnostics import DiagnosticLevel, DiagnosticStatus, DiagnosticUpdater
    from rwt_participant.errors import (
        CallFailed,
        CallTimeout,
        GoalAborted,
        GoalCanceled,
        GoalEnded,
        GoalRejected,
        HandleClosed,
        ImageFormat,
        InterfaceError,
        InvalidMessage,
        InvalidQoS,
        NotFound,
        ParameterRejected,
        ProviderGone,
        ProviderNotFound,
        RobotError,
        ServiceFailed,
        TimedOut,
        TransformUnavailable,
        UnknownType,
        WrongThread,
    )
    from rwt_participant.goals import Goal, GoalResult, GoalStatus, ReceivedGoal
    from rwt_participant.images import (
        compressed_image,
        image_from_numpy,
        image_from_pillow,
        image_to_numpy,
        image_to_pillow,
    )
    from rwt_participant.messages import Message, MessageLike
    from rwt_participant.qos import (
        BEST_AVAILABLE,
        LATCHED,
        SENSOR_DATA,
        Durability,
        History,
        QoS,
        Reliability,
    )
    from rwt_participant.timers import Watchdog
    from rwt_tf2 import (
        StampedTransform,
        Transform,
        euler_from_quaternion,
        quaternion_from_euler,
        quaternion_from_yaw,
        yaw_from_quaternion,
    )

_HOMES: Final = {
    name: home
    for home, names in {
        "rwt.server": "Server",
        "rwt.blocking": "BlockingNode",
        "rwt.playback": "PlaybackServer",
        "rwt.errors": "ServerError",
        "rwt.settings": "Settings SettingsError LoadedSettings load_settings read_settings",
        "rwt_client": "connect",
        "rwt_graph": "Node MemoryGraph SimulatedClock",
        "rwt_participant.api": "RobotApi",
        "rwt_participant.timers": "Watchdog",
        "rwt_participant.diagnostics": "DiagnosticUpdater DiagnosticStatus DiagnosticLevel",
        "rwt_participant.images": (
            "image_to_numpy image_from_numpy image_to_pillow image_from_pillow compressed_image"
        ),
        "rwt_tf2": (
            "Transform StampedTransform quaternion_from_yaw yaw_from_quaternion "
            "quaternion_from_euler euler_from_quaternion"
        ),
        "rwt_participant.goals": "Goal GoalResult GoalStatus ReceivedGoal",
        "rwt_participant.messages": "Message MessageLike",
        "rwt_participant.qos": "QoS BEST_AVAILABLE LATCHED SENSOR_DATA Durability History Reliability",
        "rwt_participant.errors": (
            "CallFailed CallTimeout GoalAborted GoalCanceled GoalEnded GoalRejected "
            "HandleClosed ImageFormat InterfaceError InvalidMessage InvalidQoS NotFound ParameterRejected "
            "ProviderGone ProviderNotFound RobotError ServiceFailed TimedOut "
            "TransformUnavailable UnknownType WrongThread"
        ),
    }.items()
    for name in names.split()
}

__all__ = [
    "Server",
    "BlockingNode",
    "PlaybackServer",
    "ServerError",
    "Settings",
    "SettingsError",
    "LoadedSettings",
    "load_settings",
    "read_settings",
    "connect",
    "Node",
    "MemoryGraph",
    "SimulatedClock",
    "RobotApi",
    "Goal",
    "GoalResult",
    "GoalStatus",
    "ReceivedGoal",
    "Message",
    "MessageLike",
    "QoS",
    "BEST_AVAILABLE",
    "LATCHED",
    "SENSOR_DATA",
    "Durability",
    "History",
    "Reliability",
    "Transform",
    "StampedTransform",
    "quaternion_from_yaw",
    "yaw_from_quaternion",
    "quaternion_from_euler",
    "euler_from_quaternion",
    "image_to_numpy",
    "image_from_numpy",
    "image_to_pillow",
    "image_from_pillow",
    "compressed_image",
    "Watchdog",
    "DiagnosticUpdater",
    "DiagnosticStatus",
    "DiagnosticLevel",
    "CallFailed",
    "CallTimeout",
    "GoalAborted",
    "GoalCanceled",
    "GoalEnded",
    "GoalRejected",
    "HandleClosed",
    "ImageFormat",
    "InterfaceError",
    "InvalidMessage",
    "InvalidQoS",
    "NotFound",
    "ParameterRejected",
    "ProviderGone",
    "ProviderNotFound",
    "RobotError",
    "ServiceFailed",
    "TimedOut",
    "TransformUnavailable",
    "UnknownType",
    "WrongThread",
]


def __getattr__(name: str) -> object:
    """Import a name on first use."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """Return all public names, for completion."""
    return sorted({*globals(), *__all__})
