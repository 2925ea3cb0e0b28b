"""Selection of the graph that nodes join: one of this process, of a server, or over Zenoh."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from anyio.from_thread import start_blocking_portal

from rwt_participant.errors import RobotError
from rwt_rclpy.messages.loaded import classes
from rwt_rclpy.middleware.link import DOMAINS, Link, domain_of

if TYPE_CHECKING:
    from rwt_graph.api import Graph

#: Environment variable with the default graph.
VARIABLE: Final = "RWT_RCLPY_GRAPH"

_EXPECTED: Final = (
    "expected `memory`, the URL of a server (ws://HOST:PORT, unix:///PATH), `zenoh`, or `zenoh:ENDPOINT` such"
    " as zenoh:tcp/10.0.0.7:7447; nodes of ROS 2 are reached through `rwt serve --graph ros2 URL`"
)


class CannotJoin(RobotError):
    """The graph does not exist or cannot be reached; the text names it and the reason."""


@contextmanager
def joined(where: str | None = None) -> Iterator[None]:
    """Let nodes created in a block join a graph, which runs in a thread until the block ends.

    Args:
        where: ``memory``, the graph of this process; the URL of a server, whose graph they join over
            rosbridge; or ``zenoh``, optionally with an endpoint to connect to, for their ROS domain there.
            None for the value of RWT_RCLPY_GRAPH, by default ``memory``.

    Raises:
        CannotJoin: the graph is invalid, or cannot be reached.
    """
    place = os.environ.get(VARIABLE, "") if where is None else where
    if place in ("", "memory"):
        yield
        return
    graph = _graph(place)
    with start_blocking_portal() as portal:
        try:
            running = portal.wrap_async_context_manager(graph)
            running.__enter__()
        except RobotError as error:
            raise CannotJoin(f"the graph {place} cannot be joined: {error}") from error
        before = DOMAINS.given
        DOMAINS.given = Link(graph)
        try:
            yield
        finally:
            DOMAINS.given = before
            running.__exit__(None, None, None)


def _graph(place: str) -> Graph:
    kind, _, rest = place.partition(":")
    if kind == "zenoh":
        try:
            from rwt.extensions.zenoh import ZenohGraph
        except ImportError as error:
            raise CannotJoin(
                f"{place} needs more packages: pip install 'robot-web-tools[zenoh]' ({error})"
            ) from error
        endpoints = [rest] if rest else []
        return ZenohGraph(classes().registry, connect=endpoints, domain=domain_of(None))
    if "://" in place:
        from rwt_rclpy.middleware.robot_graph import RobotGraph

        return RobotGraph(place, classes().registry)
    raise CannotJoin(f"{place!r} is no graph: {_EXPECTED}")
