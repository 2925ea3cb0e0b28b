"""Keys of topics and services: `<domain>/<name>/<dds type>/<type hash>` (design, "Publishers")."""

from __future__ import annotations

import re

from rwt_graph.errors import WireError

#: Replacement of `/` in names that are one part of a key.
SLASH = "%"

_TYPE = re.compile("([^/]+)/(msg|srv|action)/([^/]+)")
_DDS_TYPE = re.compile("([^:]+)::(msg|srv|action)::dds_::([^:]+)_")


def data_key(domain: int, name: str, dds_type: str, type_hash: str) -> str:
    """Return the key of a topic's samples or a service's requests.

    Args:
        name: absolute name, `/chatter`.
        dds_type: type in the form of :func:`dds_type`.
        type_hash: `RIHS01_` and 64 hexadecimal digits, or what Humble has in its place.
    """
    return f"{domain}/{name[1:]}/{dds_type}/{type_hash}"


def dds_type(type_name: str) -> str:
    """Convert `std_msgs/msg/String` to `std_msgs::msg::dds_::String_`. Raises :exc:`WireError`."""
    parts = _TYPE.fullmatch(type_name)
    if parts is None:
        raise WireError(f"{type_name[:80]!r} is not a type name of three parts, like std_msgs/msg/String")
    return "{}::{}::dds_::{}_".format(*parts.groups())


def type_name(dds: str) -> str:
    """Convert `std_msgs::msg::dds_::String_` to `std_msgs/msg/String`. Raises :exc:`WireError`."""
    parts = _DDS_TYPE.fullmatch(dds)
    if parts is None:
        raise WireError(f"{dds[:80]!r} is not a type name like std_msgs::msg::dds_::String_")
    return "/".join(parts.groups())


def mangle(name: str) -> str:
    """Return an absolute name as one part of a key: `%chatter` for `/chatter`, `%` for `/` and for an empty
    name."""
    return name.replace("/", SLASH) or SLASH


def demangle(part: str) -> str:
    """Return the absolute name for a result of :func:`mangle`; `/` for `%`."""
    return part.replace(SLASH, "/")
