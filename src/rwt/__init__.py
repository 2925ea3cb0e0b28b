"""Public API: an assembled server, and the names that most programs need.

Each name is imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt.moved import install as install_moved_modules
from rwt.moved import with_moved_names
from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.blocking import BlockingNode as BlockingNode
    from rwt.errors import ServerError as ServerError
    from rwt.server import Server as Server
    from rwt.settings import LoadedSettings as LoadedSettings
    from rwt.settings import Settings as Settings
    from rwt.settings import SettingsError as SettingsError
    from rwt.settings import load_settings as load_settings
    from rwt.settings import read_settings as read_settings
    from rwt_client import connect as connect
    from rwt_graph import MemoryGraph as MemoryGraph
    from rwt_graph import Node as Node
    from rwt_graph import SimulatedClock as SimulatedClock
    from rwt_participant.api import RobotApi as RobotApi
    from rwt_participant.diagnostics import DiagnosticLevel as DiagnosticLevel
    from rwt_participant.diagnostics import DiagnosticStatus as DiagnosticStatus
    from rwt_participant.diagnostics import DiagnosticUpdater as DiagnosticUpdater
    from rwt_participant.errors import CallFailed as CallFailed
    from rwt_participant.errors import CallTimeout as CallTimeout
    from rwt_participant.errors import GoalAborted as GoalAborted
    from rwt_participant.errors import GoalCanceled as GoalCanceled
    from rwt_participant.errors import GoalEnded as GoalEnded
    from rwt_participant.errors import GoalRejected as GoalRejected
    from rwt_participant.errors import HandleClosed as HandleClosed
    from rwt_participant.errors import ImageFormat as ImageFormat
    from rwt_participant.errors import InterfaceError as InterfaceError
    from rwt_participant.errors import InvalidMessage as InvalidMessage
    from rwt_participant.errors import InvalidQoS as InvalidQoS
    from rwt_participant.errors import NotFound as NotFound
    from rwt_participant.errors import ParameterRejected as ParameterRejected
    from rwt_participant.errors import ProviderGone as ProviderGone
    from rwt_participant.errors import ProviderNotFound as ProviderNotFound
    from rwt_participant.errors import RobotError as RobotError
    from rwt_participant.errors import ServiceFailed as ServiceFailed
    from rwt_participant.errors import TimedOut as TimedOut
    from rwt_participant.errors import TransformUnavailable as TransformUnavailable
    from rwt_participant.errors import UnknownType as UnknownType
    from rwt_participant.errors import WrongThread as WrongThread
    from rwt_participant.errors import WrongType as WrongType
    from rwt_participant.goals import Goal as Goal
    from rwt_participant.goals import GoalResult as GoalResult
    from rwt_participant.goals import GoalStatus as GoalStatus
    from rwt_participant.goals import ReceivedGoal as ReceivedGoal
    from rwt_participant.images import compressed_image as compressed_image
    from rwt_participant.images import image_from_numpy as image_from_numpy
    from rwt_participant.images import image_from_pillow as image_from_pillow
    from rwt_participant.images import image_to_numpy as image_to_numpy
    from rwt_participant.images import image_to_pillow as image_to_pillow
    from rwt_participant.messages import Message as Message
    from rwt_participant.messages import MessageLike as MessageLike
    from rwt_participant.qos import BEST_AVAILABLE as BEST_AVAILABLE
    from rwt_participant.qos import LATCHED as LATCHED
    from rwt_participant.qos import SENSOR_DATA as SENSOR_DATA
    from rwt_participant.qos import Durability as Durability
    from rwt_participant.qos import History as History
    from rwt_participant.qos import QoS as QoS
    from rwt_participant.qos import Reliability as Reliability
    from rwt_participant.timers import Watchdog as Watchdog
    from rwt_tf2 import InvalidDescription as InvalidDescription
    from rwt_tf2 import StampedTransform as StampedTransform
    from rwt_tf2 import Transform as Transform
    from rwt_tf2 import euler_from_quaternion as euler_from_quaternion
    from rwt_tf2 import quaternion_from_euler as quaternion_from_euler
    from rwt_tf2 import quaternion_from_yaw as quaternion_from_yaw
    from rwt_tf2 import yaw_from_quaternion as yaw_from_quaternion

__all__, __getattr__, __dir__ = exports(
    __name__,
    {
        "rwt.server": "Server",
        "rwt.blocking": "BlockingNode",
        "rwt.errors": "ServerError",
        "rwt.settings": "Settings SettingsError LoadedSettings load_settings read_settings",
        "rwt_client": "connect",
        "rwt_graph": "Node MemoryGraph SimulatedClock",
        "rwt_participant.api": "RobotApi",
        "rwt_participant.goals": "Goal GoalResult GoalStatus ReceivedGoal",
        "rwt_participant.messages": "Message MessageLike",
        "rwt_participant.qos": "QoS BEST_AVAILABLE LATCHED SENSOR_DATA Durability History Reliability",
        "rwt_tf2": (
            "InvalidDescription Transform StampedTransform quaternion_from_yaw yaw_from_quaternion "
            "quaternion_from_euler euler_from_quaternion"
        ),
        "rwt_participant.images": (
            "image_to_numpy image_from_numpy image_to_pillow image_from_pillow compressed_image"
        ),
        "rwt_participant.timers": "Watchdog",
        "rwt_participant.diagnostics": "DiagnosticUpdater DiagnosticStatus DiagnosticLevel",
        "rwt_participant.errors": (
            "CallFailed CallTimeout GoalAborted GoalCanceled GoalEnded GoalRejected HandleClosed "
            "ImageFormat InterfaceError InvalidMessage InvalidQoS NotFound ParameterRejected "
            "ProviderGone ProviderNotFound RobotError ServiceFailed TimedOut TransformUnavailable "
            "UnknownType WrongThread WrongType"
        ),
    },
)

__getattr__ = with_moved_names(__getattr__)
install_moved_modules()
