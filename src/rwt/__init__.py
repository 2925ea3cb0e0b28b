"""The front door: an assembled server, and the few names that most programs need.

Nothing is imported before its name is used.
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
    from rwt_program.api import RobotApi
    from rwt_program.diagnostics import DiagnosticLevel, DiagnosticStatus, DiagnosticUpdater
    from rwt_program.errors import (
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
    from rwt_program.goals import Goal, GoalResult, GoalStatus, ReceivedGoal
    from rwt_program.images import (
        compressed_image,
        image_from_numpy,
        image_from_pillow,
        image_to_numpy,
        image_to_pillow,
    )
    from rwt_program.messages import Message, MessageLike
    from rwt_program.qos import BEST_AVAILABLE, LATCHED, SENSOR_DATA, Durability, History, QoS, Reliability
    from rwt_program.watchdog import Watchdog
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
        "rwt_program.api": "RobotApi",
        "rwt_program.watchdog": "Watchdog",
        "rwt_program.diagnostics": "DiagnosticUpdater DiagnosticStatus DiagnosticLevel",
        "rwt_program.images": (
            "image_to_numpy image_from_numpy image_to_pillow image_from_pillow compressed_image"
        ),
        "rwt_tf2": (
            "Transform StampedTransform quaternion_from_yaw yaw_from_quaternion "
            "quaternion_from_euler euler_from_quaternion"
        ),
        "rwt_program.goals": "Goal GoalResult GoalStatus ReceivedGoal",
        "rwt_program.messages": "Message MessageLike",
        "rwt_program.qos": "QoS BEST_AVAILABLE LATCHED SENSOR_DATA Durability History Reliability",
        "rwt_program.errors": (
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
    """Import a name when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """The names for completion, imported or not."""
    return sorted({*globals(), *__all__})
