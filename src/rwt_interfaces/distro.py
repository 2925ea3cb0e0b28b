"""Differences between ROS distributions, as data: one field for each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final, Literal

from rwt_interfaces.names import Kind, three_part
from rwt_interfaces.times import NANOSECONDS


@dataclass(frozen=True, slots=True, kw_only=True)
class Distro:
    """ROS distribution.

    Attributes:
        name: ``jazzy``, ``noetic``.
        conventions: key of tables of what ROS 1 and ROS 2 do otherwise, the name of a distribution that has
            the same: ``jazzy`` for all of ROS 2.
        ros_version: 1 or 2, only for responses and files that report it. Differences in behaviour have
            fields.

        has_three_part_names: True if types are called ``std_msgs/msg/String``, not ``std_msgs/String``.
        part_separator: separator of a service's or action's name and its part.
        has_time_primitives: True if ``time`` and ``duration`` are primitives, not ``builtin_interfaces``.
        time_fields: names of a time's seconds and nanoseconds.
        byte_is_signed: True if ``byte`` is int8, not an octet.
        quotes_strings: True if string constants may be quoted and followed by a comment; otherwise they are
            the rest of the line.

        serialisation: binary form of messages.
        type_hash: hash by which programs compare types; "none" if they compare names only.
        has_qos: True if endpoints have quality of service; otherwise publishers are latched or not.

        parameters_belong_to_nodes: True if each node has its own parameters; otherwise all are in one tree.
        action_transport: hidden services, or the five topics of actionlib, whose messages are listed.
        introspects_calls: True if service introspection topics exist.
        joins_over_zenoh: True if programs may communicate over Zenoh.
        nodes_have_loggers: True if nodes offer services for loggers and their levels.
        master_version: version of the ROS 1 master, which offers it, its distribution and the run id as
            parameters; None without a master.
        graph_node: node of the graph's own publishers.
        rosout_type: message type of ``/rosout``.
        rosout_has_header: True if that message has a header, and levels that are powers of two.
        rosout_depth: number of messages for late subscribers of ``/rosout``.
        rosout_lifespan: seconds for which these are retained; None: while the publisher lives.

        encodes_all_cbor: True if rosbridge servers encode all messages in CBOR; otherwise some arrays are
            lost (CBR-07).
    """

    name: str
    conventions: Literal["jazzy", "noetic"]
    ros_version: Literal[1, 2]

    has_three_part_names: bool
    part_separator: Literal["", "_"]
    has_time_primitives: bool
    time_fields: tuple[str, str]
    byte_is_signed: bool
    quotes_strings: bool

    serialisation: Literal["cdr", "ros1"]
    type_hash: Literal["md5", "rihs01", "none"]
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


#: ROS 2 of 2024, supported until 2029.
JAZZY = Distro(
    name="jazzy",
    conventions="jazzy",
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
#: ROS 2 of 2022, supported until May 2027. It has no type hashes, so endpoints are compared by type name.
HUMBLE = replace(JAZZY, name="humble", type_hash="none", introspects_calls=False)
#: ROS 2 of 2025, supported until the end of 2026.
KILTED = replace(JAZZY, name="kilted")
#: ROS 2 of 2026, supported until 2031.
LYRICAL = replace(JAZZY, name="lyrical")
#: Development version of ROS 2, with the definitions of Lyrical.
ROLLING = replace(JAZZY, name="rolling")
#: The last ROS 1.
NOETIC = Distro(
    name="noetic",
    conventions="noetic",
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

#: What programs of Humble announce over Zenoh in place of a type hash.
NO_TYPE_HASH: Final = "TypeHashNotSupported"

#: The distributions that `rwt serve --distro` takes.
DISTROS: dict[str, Distro] = {
    distro.name: distro for distro in (HUMBLE, JAZZY, KILTED, LYRICAL, ROLLING, NOETIC)
}


def closest_distro(name: str, ros_version: int) -> Distro:
    """Return the distribution of that name, or else the default of that ROS version."""
    return DISTROS.get(name) or (NOETIC if ros_version == 1 else JAZZY)
