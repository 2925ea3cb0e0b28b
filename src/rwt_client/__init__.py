"""Client for Python programs: typed access to a robot's topics, services, actions, parameters and types.

>>> async with connect("ws://robot:9090") as robot:
...     async for odometry in robot.topic("/odom", "nav_msgs/Odometry"):
...         print(odometry.pose.pose.position.x)

:mod:`rwt_client.blocking` is the same for notebooks and scripts.
"""

from rwt_client.connection import connect
from rwt_client.endpoints.publisher import RemotePublisher
from rwt_client.endpoints.remote_types import RemoteTypes
from rwt_client.endpoints.servers import ActionServer, ServiceServer
from rwt_client.endpoints.subscriptions import RawSubscription, RemoteSubscription
from rwt_client.endpoints.transforms import RemoteTransforms
from rwt_client.errors import (
    BadAddress,
    CannotConnect,
    ClientError,
    ConnectionClosed,
    ConnectionLost,
    MessageRejected,
    NotConnected,
    ServerRefused,
)
from rwt_client.events import ConnectionEvent, EventStream
from rwt_client.robot import Robot
from rwt_client.rosapi import FieldInfo, NodeDetails, RosApi, RosVersion, TypeInfo
from rwt_participant.messages import RawMessage
from rwt_transports.backoff import Backoff

__all__ = [
    "connect",
    "Robot",
    "RemoteSubscription",
    "RawSubscription",
    "RawMessage",
    "RemotePublisher",
    "ServiceServer",
    "ActionServer",
    "RemoteTransforms",
    "RemoteTypes",
    "RosApi",
    "NodeDetails",
    "RosVersion",
    "TypeInfo",
    "FieldInfo",
    "ConnectionEvent",
    "EventStream",
    "Backoff",
    "ClientError",
    "BadAddress",
    "ConnectionLost",
    "CannotConnect",
    "NotConnected",
    "ConnectionClosed",
    "ServerRefused",
    "MessageRejected",
]
