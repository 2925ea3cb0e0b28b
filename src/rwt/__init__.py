"""The front door: an assembled server, and the few names that most programs need.

Nothing is imported before its name is used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt.errors import ServerError
    from rwt.playback import PlaybackServer
    from rwt.server import BlockingNode, Server
    from rwt.settings import LoadedSettings, Settings, SettingsError, load_settings, read_settings
    from rwt_client import connect
    from rwt_graph import MemoryGraph, Node, SimulatedClock
    from rwt_program.api import RobotApi
    from rwt_program.errors import (
        CallFailed,
        CallTimeout,
        GoalAborted,
        GoalCanceled,
        GoalRejected,
        HandleClosed,
        InvalidMessage,
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
    from rwt_program.qos import BEST_AVAILABLE, LATCHED, SENSOR_DATA, QoS

_HOMES: Final = {
    "Server": "rwt.server",
    "PlaybackServer": "rwt.playback",
    "ServerError": "rwt.errors",
    "BlockingNode": "rwt.server",
    "Node": "rwt_graph",
    "MemoryGraph": "rwt_graph",
    "SimulatedClock": "rwt_graph",
    "RobotApi": "rwt_program.api",
    "Goal": "rwt_program.goals",
    "GoalResult": "rwt_program.goals",
    "GoalStatus": "rwt_program.goals",
    "ReceivedGoal": "rwt_program.goals",
    "BEST_AVAILABLE": "rwt_program.qos",
    "LATCHED": "rwt_program.qos",
    "SENSOR_DATA": "rwt_program.qos",
    "QoS": "rwt_program.qos",
    "CallFailed": "rwt_program.errors",
    "CallTimeout": "rwt_program.errors",
    "GoalAborted": "rwt_program.errors",
    "GoalCanceled": "rwt_program.errors",
    "GoalRejected": "rwt_program.errors",
    "HandleClosed": "rwt_program.errors",
    "InvalidMessage": "rwt_program.errors",
    "NotFound": "rwt_program.errors",
    "ParameterRejected": "rwt_program.errors",
    "ProviderGone": "rwt_program.errors",
    "ProviderNotFound": "rwt_program.errors",
    "RobotError": "rwt_program.errors",
    "ServiceFailed": "rwt_program.errors",
    "TimedOut": "rwt_program.errors",
    "TransformUnavailable": "rwt_program.errors",
    "UnknownType": "rwt_program.errors",
    "WrongThread": "rwt_program.errors",
    "connect": "rwt_client",
    "Settings": "rwt.settings",
    "SettingsError": "rwt.settings",
    "LoadedSettings": "rwt.settings",
    "load_settings": "rwt.settings",
    "read_settings": "rwt.settings",
}

__all__ = [
    "Server",
    "PlaybackServer",
    "ServerError",
    "BlockingNode",
    "Node",
    "MemoryGraph",
    "SimulatedClock",
    "RobotApi",
    "Goal",
    "GoalResult",
    "GoalStatus",
    "ReceivedGoal",
    "BEST_AVAILABLE",
    "LATCHED",
    "SENSOR_DATA",
    "QoS",
    "CallFailed",
    "CallTimeout",
    "GoalAborted",
    "GoalCanceled",
    "GoalRejected",
    "HandleClosed",
    "InvalidMessage",
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
    "connect",
    "Settings",
    "SettingsError",
    "LoadedSettings",
    "load_settings",
    "read_settings",
]


def __getattr__(name: str) -> object:
    """Import a name when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """The names for completion, imported or not."""
    return sorted({*globals(), *__all__})
