"""The keys of topics and services: `<domain>/<name>/<dds type>/<type hash>` (design, "Publishers")."""

from __future__ import annotations

from rwt_graph.errors import WireError

#: What stands for `/` where a name must be one part of a key.
SLASH = "%"

_KINDS = ("msg", "srv", "action")


def data_key(domain: int, name: str, dds_type: str, type_hash: str) -> str:
    """The key that a topic's samples or a service's requests travel on.

    Args:
        domain: ROS_DOMAIN_ID.
        name: absolute name, `/chatter`.
        dds_type: as :func:`dds_type` writes it.
        type_hash: `RIHS01_` and 64 hexadecimal digits.
    """
    return f"{domain}/{name[1:]}/{dds_type}/{type_hash}"


def dds_type(type_name: str) -> str:
    """`std_msgs/msg/String` as `std_msgs::msg::dds_::String_`.

    Raises:
        WireError: not a three-part name.
    """
    parts = type_name.split("/")
    if len(parts) != 3 or parts[1] not in _KINDS or not all(parts):
        raise WireError(f"{type_name[:80]!r} is not a type name of three parts, like std_msgs/msg/String")
    package, kind, name = parts
    return f"{package}::{kind}::dds_::{name}_"


def type_name(dds: str) -> str:
    """`std_msgs::msg::dds_::String_` as `std_msgs/msg/String`.

    Raises:
        WireError: it is not written so.
    """
    parts = dds.split("::")
    if (
        len(parts) != 4
        or parts[1] not in _KINDS
        or parts[2] != "dds_"
        or not parts[0]
        or not parts[3].removesuffix("_")
        or not parts[3].endswith("_")
    ):
        raise WireError(f"{dds[:80]!r} is not a type name like std_msgs::msg::dds_::String_")
    return f"{parts[0]}/{parts[1]}/{parts[3][:-1]}"


def mangle(name: str) -> str:
    """An absolute name as one part of a key: `%chatter` for `/chatter`, `%` for `/` and for nothing."""
    return name.replace("/", SLASH) or SLASH


def demangle(part: str) -> str:
    """The absolute name that :func:`mangle` made `part` of; `/` for `%`."""
    return part.replace(SLASH, "/")
