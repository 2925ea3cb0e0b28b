"""Log of a node: `/rosout` for the graph, Python's logging for the process."""

from __future__ import annotations

import logging
import sys
from collections.abc import Mapping
from contextlib import suppress
from types import MappingProxyType
from typing import Final

from rwt_graph.disclosure import NOTHING, Disclosure, Writes
from rwt_graph.nodes.endpoints import TopicPublisher
from rwt_interfaces.distro import Distro
from rwt_participant.errors import HandleClosed, ServiceFailed
from rwt_participant.messages import Message
from rwt_participant.qos import Durability, QoS

#: Names of the levels in ROS 1's services.
_LEVEL_NAMES: Final = {
    "debug": logging.DEBUG,
    "info": logging.INFO,
    "warn": logging.WARNING,
    "error": logging.ERROR,
    "fatal": logging.CRITICAL,
}
#: Name of a node's only logger, as in rospy.
_LOGGER: Final = "rosout"

DISCLOSURES: Final[Mapping[str, Disclosure]] = MappingProxyType(
    {"roscpp/GetLoggers": NOTHING, "roscpp/SetLoggerLevel": (Writes("logger"),)}
)
"""Disclosures of the logger services: permission to set the parameter `/rosout` allows setting a level."""

#: Python's level → number in `rosgraph_msgs/Log` (ROS 1); `rcl_interfaces/Log` uses Python's own numbers.
ROS_1_LEVELS = {logging.DEBUG: 1, logging.INFO: 2, logging.WARNING: 4, logging.ERROR: 8, logging.CRITICAL: 16}


def rosout_qos(distro: Distro) -> QoS:
    """Return the QoS with which nodes advertise `/rosout`."""
    return QoS(
        depth=distro.rosout_depth, durability=Durability.TRANSIENT_LOCAL, lifespan=distro.rosout_lifespan
    )


class NodeLog:
    """Log that writes to `/rosout` and to the Python logger of the node's name. Safe from any thread.

    Once the node or its graph was closed, lines go to the Python logger only.
    """

    def __init__(self, node: str, distro: Distro, publisher: TopicPublisher) -> None:
        self._node = node
        # Logger names of ROS 2; ROS 1 uses the node's name itself.
        self._name = node.strip("/").replace("/", ".")
        self._distro = distro
        self._publisher = publisher
        self._least = logging.DEBUG
        self._logger = logging.getLogger(f"ros.{self._name}")

    def debug(self, text: str) -> None:
        """Log a line for developers."""
        self._write(logging.DEBUG, text)

    def info(self, text: str) -> None:
        """Log a line for operators."""
        self._write(logging.INFO, text)

    def warning(self, text: str) -> None:
        """Log an unexpected event that does not affect the node."""
        self._write(logging.WARNING, text)

    warn = warning

    def error(self, text: str) -> None:
        """Log a failure."""
        self._write(logging.ERROR, text)

    def fatal(self, text: str) -> None:
        """Log a failure after which the node cannot continue."""
        self._write(logging.CRITICAL, text)

    def loggers(self, _: object = None) -> Mapping[str, object]:
        """Answer `~get_loggers` (`roscpp/GetLoggers`): the node's only logger, and its level."""
        level = next(name for name, number in _LEVEL_NAMES.items() if number == self._least)
        return {"loggers": [{"name": _LOGGER, "level": level}]}

    def set_level(self, request: Message) -> Mapping[str, object]:
        """Answer `~set_logger_level` (`roscpp/SetLoggerLevel`): drop lines below that level."""
        level = _LEVEL_NAMES.get(request.level.lower())
        if request.logger != _LOGGER or level is None:
            raise ServiceFailed(
                f"no logger {request.logger[:80]!r} with a level {request.level[:80]!r}: the logger is"
                f" {_LOGGER!r}, its levels are {', '.join(_LEVEL_NAMES)}"
            )
        self._least = level
        return {}

    def _write(self, level: int, text: str) -> None:
        if level < self._least:
            return
        self._logger.log(level, "%s", text)
        caller = sys._getframe(2)
        where = {
            "file": caller.f_code.co_filename,
            "function": caller.f_code.co_name,
            "line": caller.f_lineno,
        }
        with suppress(HandleClosed):  # Threads of drivers log their own end after that of the node.
            self._publisher.publish({**self._head(level), **where, "msg": text})

    def _head(self, level: int) -> dict[str, object]:
        stamp = self._distro.time(self._publisher.now_ns())
        if self._distro.rosout_has_header:
            return {"header": {"stamp": stamp}, "level": ROS_1_LEVELS[level], "name": self._node}
        return {"stamp": stamp, "level": level, "name": self._name}
