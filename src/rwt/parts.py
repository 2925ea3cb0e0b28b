"""Table of the built-in parts, and the loader of all parts.

This is the only module outside of the parts that has their names. A row is imported on first use. Parts of
other distributions are entry points of the groups in :data:`GROUPS`; built-in names take precedence.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple, cast

from rwt_protocol.extensions import ExtensionError, extension_names, load_extension

if TYPE_CHECKING:
    from rwt.declarations import Part
    from rwt_transports.shared_pool import PoolRow

Kind = Literal["gateway", "node", "graph", "service", "recorder", "script", "asgi", "supervisor", "check"]


class Row(NamedTuple):
    """Built-in part.

    Attributes:
        reference: module and name of its declaration, as in an entry point.
        settings: names at the top level of the settings: its table, or its settings there.
        extra: extra of `robot-web-tools` that installs its dependencies.
        by_name: True if a setting names it; False if its own settings turn it on.
        default: True if a server has it without a setting.
    """

    reference: str
    settings: tuple[str, ...] = ()
    extra: str = ""
    by_name: bool = True
    default: bool = False


BUILT_IN: Final[Mapping[Kind, Mapping[str, Row]]] = {
    "gateway": {
        "foxglove": Row("rwt.extensions.foxglove.part:PART", default=True),
        "http": Row("rwt.extensions.http.part:PART", ("api",), default=True),
        "mcp": Row("rwt.extensions.mcp.part:PART", ("mcp",), "mcp"),
    },
    "node": {
        "rosapi": Row("rwt.rosapi.part:PART", default=True),
        "tf2_web_republisher": Row("rwt.extensions.tf_stream.part:PART", default=True),
        "web_video_server": Row("rwt.extensions.video.part:PART", default=True),
        "robot_state_publisher": Row("rwt.extensions.state_publisher.part:PART", ("robot_state_publisher",)),
        "meshes": Row("rwt.extensions.meshes.part:PART", ("packages", "package_links"), by_name=False),
        "demo": Row("rwt.extensions.demo.part:PART", ("demo",), by_name=False),
        "on_demand_recorder": Row(
            "rwt.extensions.recording.part:ON_DEMAND", ("recorder",), "mcap", by_name=False
        ),
        "dashboard": Row("rwt.extensions.dashboard.part:PART", ("web",), by_name=False, default=True),
    },
    "graph": {
        "ros1": Row("rwt.extensions.ros1.part:PART"),
        "ros1-master": Row("rwt.extensions.ros1.part:PART"),
        "ros2": Row("rwt.extensions.ros2.part:PART", ("ros2",)),
        "zenoh": Row("rwt.extensions.zenoh.part:PART", ("zenoh",), "zenoh"),
    },
    "service": {
        "webrtc": Row("rwt_webrtc.part:PART", ("webrtc",), "webrtc", by_name=False),
        "dial": Row("rwt.extensions.hub.part:PART", ("dial",), by_name=False),
    },
    "recorder": {"mcap": Row("rwt.extensions.recording.part:WHOLE_GRAPH", (), "mcap")},
    "script": {"scripted": Row("rwt.extensions.testing.part:PART")},
    "asgi": {"apps": Row("rwt.extensions.asgi.part:PART")},
    "supervisor": {"processes": Row("rwt.extensions.workers.part:PART")},
    "check": {
        "ros1": Row("rwt.extensions.ros1.part:CHECK"),
        "webrtc+http": Row("rwt_webrtc.part:CHECK", (), "webrtc"),
        "webrtc+https": Row("rwt_webrtc.part:CHECK", (), "webrtc"),
    },
}
"""Built-in parts by kind and name, in the order in which help and errors list them."""

GROUPS: Final[Mapping[Kind, str]] = {
    "gateway": "rwt.gateways",
    "node": "rwt.nodes",
    "graph": "rwt.graphs",
    "service": "rwt.services",
    "check": "rwt.checks",
}
"""Groups of entry points by kind. Encodings and transports have groups of their own in the layers below."""


POOLS: Final = (
    "rwt_transports.connection:CONNECTIONS",
    "rwt_transports.connection:PENDING",
    "rwt_transports.drivers.sockets:HANDSHAKES",
    "rwt_transports.wires.receive_buffer:RECEIVING",
    "rwt.rosbridge.ops.actions:ORPHANS",
    "rwt.delivery.compact:COMPACT",
)
"""Shared pools of every server; parts declare theirs."""


class CommandRow(NamedTuple):
    """Command of a part.

    Attributes:
        help: one line for `rwt --help`.
        reference: module and name of the function that adds its parser; empty for a command of another
            distribution of this project, which is an entry point.
        distribution: that distribution.
    """

    help: str
    reference: str = ""
    distribution: str = ""


COMMANDS: Final[Mapping[str, CommandRow]] = {
    "web": CommandRow(
        "serve the dashboard without a robot, for any rosbridge server",
        "rwt.extensions.dashboard.command:add_web_command",
    ),
    "hub": CommandRow("relay clients to robots behind a NAT", "rwt.extensions.hub.command:add_hub_command"),
    "master": CommandRow("ROS 1 master without ROS", "rwt.extensions.ros1.command:add_master_command"),
    "run": CommandRow("run a ROS 2 program that imports rclpy, without ROS", distribution="rwt-rclpy"),
    "launch": CommandRow("start the nodes of a ROS 2 launch file, without ROS", distribution="rwt-rclpy"),
    "lerobot": CommandRow("LeRobot and MuJoCo arms: mujoco, serve, convert", distribution="rwt-lerobot"),
    "bag": CommandRow(
        "recordings: record, play, info, recover", "rwt.extensions.recording.commands:add_bag_command"
    ),
    "mcp": CommandRow(
        "give an agent tools for a robot, over standard input and output",
        "rwt.extensions.mcp.command:add_mcp_command",
    ),
    "ros2": CommandRow(
        "in place of rosbridge_suite: install, serve", "rwt.extensions.ros2.command:add_ros2_command"
    ),
}
"""Commands of built-in parts and of this project's other distributions, by name."""


class PartError(LookupError):
    """No part has the name, or it cannot be imported; the text says what to install."""


def row(kind: Kind, name: str) -> Row:
    """Return the row of a built-in part; one without settings for a part of another distribution."""
    return BUILT_IN[kind].get(name, Row("", (name,)))


def names(kind: Kind, *, by_name: bool = True) -> tuple[str, ...]:
    """Return the built-in names that a setting can name, or those that settings of their own turn on."""
    return tuple(name for name, each in BUILT_IN[kind].items() if each.by_name is by_name)


def defaults(kind: Kind, *, by_name: bool = True) -> tuple[str, ...]:
    """Return the built-in names that a server has without a setting."""
    return tuple(name for name in names(kind, by_name=by_name) if BUILT_IN[kind][name].default)


def installed(kind: Kind) -> list[str]:
    """Return the sorted names of parts from other distributions, without importing them."""
    return extension_names(GROUPS[kind]) if kind in GROUPS else []


def owner_of(key: str) -> tuple[Kind, str] | None:
    """Return kind and name of the part with this name at the top level of the settings; None if unknown."""
    for kind, rows in BUILT_IN.items():
        for name, each in rows.items():
            if key in each.settings:
                return kind, name
    for kind in GROUPS:
        if key in installed(kind):
            return kind, key
    return None


def settings_keys() -> Iterator[tuple[str, Kind, str]]:
    """Yield the names of built-in parts at the top level of the settings, with kind and name of the part."""
    for kind, rows in BUILT_IN.items():
        for name, each in rows.items():
            for key in each.settings:
                yield key, kind, name


def pools() -> Iterator[PoolRow]:
    """Yield the rows of the table of shared pools: those of every server, and those of the built-in parts.

    Raises:
        PartError: a part is not installed.
    """
    declared = (load(kind, name) for kind, rows in BUILT_IN.items() for name in rows)
    # Some parts have several names.
    for reference in dict.fromkeys((*POOLS, *(each for part in declared for each in part.pools))):
        module, _, attribute = reference.partition(":")
        yield cast("PoolRow", getattr(import_module(module), attribute))


def is_available(kind: Kind, name: str) -> bool:
    """Return True if the distribution with a built-in part is installed, and the part is not removed."""
    module = row(kind, name).reference.partition(":")[0]
    try:
        return module in sys.modules or find_spec(module) is not None
    except ModuleNotFoundError:
        return False


def load(kind: Kind, name: str) -> Part:
    """Import the declaration of a part.

    Raises:
        PartError: there is no such part, its distribution is not installed, or it cannot be imported.
    """
    built_in = BUILT_IN[kind].get(name)
    if built_in is None:
        return _adapted(kind, name, _load_entry_point(kind, name))
    module, _, attribute = built_in.reference.partition(":")
    try:
        return cast("Part", getattr(import_module(module), attribute))
    except ModuleNotFoundError as error:
        raise PartError(needs(name, error.name or module, built_in.extra)) from error


def needs(name: str, module: str, extra: str) -> str:
    """Return the text of an error about a part whose dependency is not installed."""
    hint = f": pip install 'robot-web-tools[{extra}]'" if extra else ""
    return f"{name} needs {module}, which is not installed{hint}"


def _load_entry_point(kind: Kind, name: str) -> object:
    if kind not in GROUPS:
        raise PartError(f"this installation has no part for {kind}: {name}")
    try:
        return load_extension(GROUPS[kind], name, names(kind))
    except ExtensionError as error:
        raise PartError(str(error)) from error


def _adapted(kind: Kind, name: str, value: object) -> Part:
    """Return the declaration that an entry point has; a bare factory, as in version 0.1, is wrapped."""
    from rwt.declarations import GatewayPart, GraphPart, NodePart, Part

    if isinstance(value, Part):
        return value
    group = GROUPS[kind]
    if not callable(value) or kind not in ("gateway", "node", "graph"):
        raise PartError(f"the entry point {name!r} of the group {group} is not the declaration of a part")
    warnings.warn(
        f"the entry point {name!r} of the group {group} is a factory; from version 0.3 on it has to be a"
        " declaration of rwt.declarations",
        DeprecationWarning,
        stacklevel=4,
    )
    make = cast("Callable[..., Any]", value)
    if kind == "gateway":
        # The verbs of such a gateway are declared by its own module.
        return GatewayPart(summary=name, make=lambda context, _: make(context.graph, context.access))
    if kind == "node":
        return NodePart(summary=name, make=lambda context, _: make(context.graph))
    return GraphPart(summary=name, make=lambda context, _: make(context.registry, context.clock))
