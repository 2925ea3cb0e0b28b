"""Differences between ROS distributions, as data: one field for each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from rwt_interfaces.names import Kind, three_part
from rwt_interfaces.times import NANOSECONDS


@dataclass(frozen=True, slots=True, kw_only=True)
class Distro:
    """One distribution.

    Attributes:
        name: ``jazzy``, ``noetic``.
        ros_version: 1 or 2, for answers and files that report it. No behaviour depends on it: what differs
            has a field of its own.

        has_three_part_names: types are called ``std_msgs/msg/String``, not ``std_msgs/String``.
        part_separator: what stands between the name of a service or action and that of its part.
        has_time_primitives: ``time`` and ``duration`` are primitives; otherwise messages of
            ``builtin_interfaces``.
        time_fields: the names of a time's two halves, whole seconds and nanoseconds.
        byte_is_signed: ``byte`` is an old name of int8; otherwise an octet.
        quotes_strings: a string constant may be quoted and followed by a comment; otherwise it is the rest of
            its line, quotes and ``#`` included.

        serialisation: the binary form of messages.
        type_hash: the digest by which two programs compare a type.
        has_qos: endpoints have quality of service; otherwise publishers are latched or not.

        parameters_belong_to_nodes: each node has its own; otherwise all are in one tree.
        action_transport: what carries actions between programs: hidden services, or the five topics of
            actionlib, whose messages are then listed among a package's messages.
        introspects_calls: there are topics that carry the calls of services.
        joins_over_zenoh: its programs may talk over Zenoh.
        nodes_have_loggers: each node offers services that list its loggers and set their levels.
        master_version: the version of ROS 1's core, which tells it, its distribution and the run's id as
            parameters; None where there is no core.
        graph_node: the node to which the graph's own publishers belong.
        rosout_type: the message of ``/rosout``.
        rosout_has_header: that message has a header, and levels that are powers of two.
        rosout_depth: how many messages a late subscriber of ``/rosout`` gets.
        rosout_lifespan: for how many seconds they are kept; None for as long as the publisher lives.

        encodes_all_cbor: rosbridge's servers encode every message in CBOR; otherwise some arrays are lost
            (CBR-07).
    """

    name: str
    ros_version: Literal[1, 2]

    has_three_part_names: bool
    part_separator: Literal["", "_"]
    has_time_primitives: bool
    time_fields: tuple[str, str]
    byte_is_signed: bool
    quotes_strings: bool

    serialisation: Literal["cdr", "ros1"]
    type_hash: Literal["md5", "rihs01"]
    has_qos: bool

    parameters_belong_to_nodes: bool
    action_transport: Literal["services", "topics"]
    introspects_calls: bool
    joins_over_zenoh: bool
    nodes_have_loggers: bool
    master_version: str | None
    graph_node: str
    rosout_type: str
    rosout_has_header: bool
    rosout_depth: int
    rosout_lifespan: float | None

    encodes_all_cbor: bool

    def type_name(self, name: str, kind: Kind) -> str:
        """Return the name of a type in this distribution, given its two-part name."""
        return three_part(name, kind) if self.has_three_part_names else name

    def time(self, time_ns: int) -> dict[str, int]:
        """Return a time or duration in nanoseconds, as the fields of its message."""
        return dict(zip(self.time_fields, divmod(time_ns, NANOSECONDS), strict=True))

    def time_ns(self, time: Any) -> int:
        """Return the nanoseconds of a time or duration in a message."""
        seconds, nanoseconds = self.time_fields
        return int(getattr(time, seconds) * NANOSECONDS + getattr(time, nanoseconds))


#: ROS 2 as of 2024.
JAZZY = Distro(
    name="jazzy",
    ros_version=2,
    has_three_part_names=True,
    part_separator="_",
    has_time_primitives=False,
    time_fields=("sec", "nanosec"),
    byte_is_signed=False,
    quotes_strings=True,
    serialisation="cdr",
    type_hash="rihs01",
    has_qos=True,
    parameters_belong_to_nodes=True,
    action_transport="services",
    introspects_calls=True,
    joins_over_zenoh=True,
    nodes_have_loggers=False,
    master_version=None,
    graph_node="/_graph",  # A leading underscore hides a node.
    rosout_type="rcl_interfaces/Log",
    rosout_has_header=False,
    rosout_depth=100,
    rosout_lifespan=10.0,
    encodes_all_cbor=True,
)
#: The last ROS 1.
NOETIC = Distro(
    name="noetic",
    ros_version=1,
    has_three_part_names=False,
    part_separator="",
    has_time_primitives=True,
    time_fields=("secs", "nsecs"),
    byte_is_signed=True,
    quotes_strings=False,
    serialisation="ros1",
    type_hash="md5",
    has_qos=False,
    parameters_belong_to_nodes=False,
    action_transport="topics",
    introspects_calls=False,
    joins_over_zenoh=False,
    nodes_have_loggers=True,
    master_version="1.17.0",
    graph_node="/rosout",
    rosout_type="rosgraph_msgs/Log",
    rosout_has_header=True,
    rosout_depth=1,
    rosout_lifespan=None,
    encodes_all_cbor=False,
)

#: The distributions that `rwt serve --distro` takes.
DISTROS: dict[str, Distro] = {distro.name: distro for distro in (JAZZY, NOETIC)}


def closest_distro(name: str, ros_version: int) -> Distro:
    """Return the distribution of that name; for an unknown name the one here of that version of ROS."""
    return DISTROS.get(name) or (NOETIC if ros_version == 1 else JAZZY)
