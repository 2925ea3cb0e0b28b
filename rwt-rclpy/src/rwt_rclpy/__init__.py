"""`rclpy` without ROS: nodes that were written for ROS 2 run on the graph of this project.

>>> import rwt_rclpy
>>> rwt_rclpy.install()
'rwt_rclpy'
>>> import rclpy
>>> from std_msgs.msg import String

Nothing is imported under ROS's names before :func:`install`, or if ROS is installed.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from contextlib import AbstractContextManager
from os import PathLike
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    import numpy as np

    from rwt_graph.api import Graph
    from rwt_interfaces.registry import Registry
    from rwt_rclpy.messages.classes import Message

__all__ = ["install", "installed", "join", "octets_of", "uninstall", "use_graph"]

Which = Literal["ros", "rwt_rclpy"]


def install(interfaces: Iterable[str | PathLike[str]] = (), *, registry: Registry | None = None) -> Which:
    """Make `import rclpy` and the message packages work in this process.

    No-op if ROS is installed: its own rclpy is used.

    Args:
        interfaces: folders with packages of ``.msg``, ``.srv`` and ``.action`` files.
        registry: interfaces instead of the standard ones of jazzy.

    Returns:
        Name of the rclpy in use: ``ros`` or ``rwt_rclpy``.

    Raises:
        DefinitionError: a folder cannot be read; the text gives location and reason.
        RuntimeError: modules of ROS were imported already.
    """
    from rwt_rclpy import import_hook
    from rwt_rclpy.messages import loaded

    if import_hook.ros_is_installed():
        return "ros"
    present = sys.modules.get("rclpy")
    if present is not None and present.__name__ != "rwt_rclpy.client_library":
        raise RuntimeError(
            f"another rclpy is imported already, {present!r}: install before it, or not at all"
        )
    loaded.load(interfaces, registry)
    import_hook.install()
    return "rwt_rclpy"


def installed() -> Which | None:
    """Return the rclpy that a program would import: ROS's, this one, or none."""
    from rwt_rclpy import import_hook

    if import_hook.ros_is_installed():
        return "ros"
    return "rwt_rclpy" if import_hook._finder in sys.meta_path else None


def use_graph(graph: Graph | None) -> None:
    """Let new nodes join an existing graph, such as that of a server.

    Args:
        graph: graph, running or not; None for a graph of this process.
    """
    from rwt_rclpy.middleware.link import DOMAINS, Link

    DOMAINS.given = None if graph is None else Link(graph)


def join(where: str | None = None) -> AbstractContextManager[None]:
    """Let nodes created in a block join the graph of a server, or one over Zenoh.

    >>> with rwt_rclpy.join("ws://127.0.0.1:9090"):
    ...     rclpy.init()
    ...     rclpy.spin(rclpy.create_node("talker"))

    Args:
        where: ``memory``, ``ws://HOST:PORT``, ``unix:///PATH``, ``zenoh`` or ``zenoh:tcp/HOST:PORT``; None
            for the value of the variable RWT_RCLPY_GRAPH.

    Raises:
        CannotJoin: the graph is invalid or cannot be reached; raised on entering the block.
    """
    from rwt_rclpy.middleware.joining import joined

    return joined(where)


def octets_of(message: Message, name: str) -> np.ndarray:
    """Return the octets of a field of type ``uint8[]`` as a read-only numpy array, without a copy.

    They are the published bytes, within one process, as long as no program has read
    the field itself, which creates an `array.array`.

    >>> pixels = rwt_rclpy.octets_of(image, "data").reshape(image.height, image.width, 3)

    Raises:
        TypeError: the message has no such field, or its type differs.
    """
    from rwt_rclpy.messages import classes

    return classes.octets_of(message, name)


def uninstall() -> None:
    """Undo :func:`install`; references to imported modules stay valid."""
    from rwt_rclpy import import_hook

    import_hook.uninstall()
