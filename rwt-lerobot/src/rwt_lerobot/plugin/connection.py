"""Connection of a device, in a thread behind it, and the errors that it raises."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Final

from rwt_client import ConnectionEvent
from rwt_client.blocking import BlockingRobot, connect
from rwt_lerobot.reports import LOG_TYPE, ROSOUT, WARN

if TYPE_CHECKING:
    from rwt_lerobot.plugin.config import ServerConfig

CONNECT_SECONDS: Final = 10.0
FIRST_SECONDS: Final = 5.0
"""Time for the first joint states to arrive."""


class DeviceError(ConnectionError):
    """A device cannot go on; the text gives the cause."""


class StaleData(DeviceError):
    """No new data has arrived for too long."""


class CommandRejected(DeviceError):
    """The gate or the robot rejected a command."""


class DoesNotFollow(DeviceError):
    """The state of the robot does not follow the commands."""


class Latest:
    """Newest message of a topic, with the time of its arrival."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.arrived = threading.Condition()
        self.count = 0
        self._message: Any = None
        self._at = 0.0

    def put(self, message: Any) -> None:
        """Replace the message; called in the thread of the connection."""
        with self.arrived:
            self._message, self._at = message, time.monotonic()
            self.count += 1
            self.arrived.notify_all()

    @property
    def is_empty(self) -> bool:
        """True before the first message."""
        return self.count == 0

    def get(self, max_age: float) -> Any:
        """Return the message.

        Raises:
            StaleData: there is none, or it is older than `max_age` seconds.
        """
        with self.arrived:
            age = time.monotonic() - self._at
            if self.is_empty:
                raise StaleData(f"no message has arrived on {self.topic}")
            if age > max_age:
                raise StaleData(
                    f"the last message on {self.topic} is {age:.2f} s old; the limit is {max_age:g} s"
                )
            return self._message

    def wait(self, count: int, seconds: float) -> bool:
        """Wait until more than `count` messages have arrived; False if they have not in time."""
        with self.arrived:
            return self.arrived.wait_for(lambda: self.count > count, seconds)


class Connection:
    """Connection of one device; it ends with the first loss.

    Args:
        url: URL of the server.
        token: bearer token, or empty.
        commands: topic of the device's commands, whose rejections raise; empty for devices without.

    Attributes:
        robot: the connection itself.

    Raises:
        DeviceError: the server cannot be reached.
    """

    def __init__(self, url: str, token: str = "", commands: str = "") -> None:
        self._commands = commands
        self._error: DeviceError | None = None
        self._stopped = ""
        headers = {"Authorization": f"Bearer {token}"} if token else None
        try:
            # No reconnection: an arm that was lost while it moved is not commanded again by itself.
            self.robot: BlockingRobot = connect(url, timeout=CONNECT_SECONDS, reconnect=None, headers=headers)
        except Exception as error:  # LeRobot's scripts expect one class of errors.
            raise DeviceError(f"cannot connect to {url}: {error}") from error
        self._url = url
        self.robot.on_event(self._on_event)
        if commands:
            self.robot.subscribe(ROSOUT, self._on_log, LOG_TYPE)
            self.robot.subscribe("/gate/stopped", self._on_stopped, "rwt_gate_msgs/EmergencyStop")

    @property
    def is_open(self) -> bool:
        """True if the connection was not lost."""
        return self.robot.connected

    def latest(self, topic: str, type: str) -> Latest:
        """Subscribe to a topic, and return its newest message."""
        latest = Latest(topic)
        self.robot.subscribe(topic, latest.put, type)
        return latest

    def first_states(self, topic: str) -> Latest:
        """Subscribe to joint states, and wait for the first.

        Raises:
            DeviceError: none arrive, or the connection is lost.
        """
        states = self.latest(topic, "sensor_msgs/JointState")
        if not within(FIRST_SECONDS, lambda: not states.is_empty, self.check):
            raise DeviceError(f"no joint states on {topic} of {self._url}")
        return states

    def check(self) -> None:
        """Raise the error that ended the connection, or rejected a command.

        Raises:
            CommandRejected: the gate or the robot rejected a command, or the emergency stop is pressed.
            DeviceError: the connection was lost.
        """
        if self._error is not None:
            raise self._error
        if self._stopped:
            raise CommandRejected(self._stopped)
        if not self.robot.connected:
            raise DeviceError(f"the connection to {self._url} was lost")

    def close(self) -> None:
        """Close the connection."""
        self.robot.close()

    def _fail(self, error: DeviceError) -> None:
        self._error = self._error or error  # The first one is the cause.

    def _on_event(self, event: ConnectionEvent) -> None:
        if event.kind in ("lost", "closed"):
            self._fail(DeviceError(f"the connection to {self._url} was lost: {event.text}"))
        elif event.kind == "status" and self._commands and event.level in ("warning", "error"):
            self._fail(CommandRejected(f"the server: {event.text}"))

    def _on_log(self, line: Any) -> None:
        if line.level >= WARN and self._commands in line.msg:
            self._fail(CommandRejected(f"{line.name}: {line.msg}"))

    def _on_stopped(self, stop: Any) -> None:
        self._stopped = f"the emergency stop is pressed by {stop.by}: {stop.reason}" if stop.stopped else ""


class Device:
    """Common part of devices: the connection.

    Attributes:
        noun: the device in texts.
    """

    noun: ClassVar[str]

    _connection: Connection | None = None

    @property
    def is_connected(self) -> bool:
        """True between :meth:`connect` and :meth:`disconnect`, also after an error."""
        return self._connection is not None

    @property
    def is_calibrated(self) -> bool:
        """True: what is behind the server is calibrated there."""
        return True

    def calibrate(self) -> None:
        """No-op: what is behind the server is calibrated there."""

    def configure(self) -> None:
        """No-op: what is behind the server is configured there."""

    def disconnect(self) -> None:
        """Close the connection."""
        connection = self._connected()
        self._connection = None
        connection.close()

    def _connect(self, config: ServerConfig, commands: str = "") -> Connection:
        """Return a new connection, which the device keeps once it is complete."""
        if self._connection is not None:
            raise DeviceError(f"the {self.noun} is connected already")
        return Connection(config.url, config.token, commands)

    def _connected(self) -> Connection:
        if self._connection is None:
            raise DeviceError(f"the {self.noun} is not connected")
        return self._connection


def within(seconds: float, ready: Callable[[], bool], check: Callable[[], None]) -> bool:
    """Wait until `ready` returns True; returns False after so many seconds. `check` may raise meanwhile."""
    end = time.monotonic() + seconds
    while not ready():
        check()
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True
