"""Addresses of ROS 1: that of the master, and the one that other programs are given for this process."""

from __future__ import annotations

import os
import socket
from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

from rwt.extensions.ros1.wire.rpc import address_of
from rwt_graph.errors import Ros1Error, WireError

DEFAULT_MASTER: Final = "http://localhost:11311"
_DEFAULT_PORT: Final = 11311


@dataclass(frozen=True, slots=True)
class Address:
    """Address of this process.

    Attributes:
        host: host name or address that other programs are given.
        bind: address on which connections are accepted.
        source: where `host` comes from, for messages.
    """

    host: str
    bind: str
    source: str


def master_uri(given: str | None) -> str:
    """Return the URI of the master: the given one, else `ROS_MASTER_URI`, else that of this host.

    Args:
        given: `http://host:port`, `ros1://host:port` or `ros1-master://host:port`; without port, 11311.

    Raises:
        Ros1Error: it is not a URI.
    """
    if given == "ros1-master":
        given = f"{given}://127.0.0.1"
    text = given or os.environ.get("ROS_MASTER_URI") or DEFAULT_MASTER
    try:
        parts = urlsplit(text)
        port = parts.port or _DEFAULT_PORT
    except ValueError:
        parts, port = urlsplit(""), 0
    if parts.scheme not in ("http", "ros1", "ros1-master") or not parts.hostname:
        raise Ros1Error(f"{text!r} is not the address of a ROS 1 master: expected ros1://host:11311")
    host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
    return f"http://{host}:{port}/"


def own_address(master: str) -> Address:
    """Return the address of this process: `ROS_HOSTNAME`, `ROS_IP`, or the one that reaches the master.

    The host name would be ROS 1's default, which robots often cannot resolve. It is used only for a master on
    this host, if it resolves.
    """
    for variable in ("ROS_HOSTNAME", "ROS_IP"):
        host = os.environ.get(variable)
        if host:
            return Address(host, "127.0.0.1" if is_loopback(host) else "", variable)
    host = _local_address(master)
    if is_loopback(host):
        name = socket.gethostname()
        if not is_loopback(name):
            return Address(name, "", "the name of this host")
        return Address(host, "127.0.0.1", "the address of the master")
    return Address(host, "", "the address from which the master is reached")


def _local_address(master: str) -> str:
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect(address_of(master))  # Sends nothing.
            return str(probe.getsockname()[0])
    except (OSError, WireError):
        return "127.0.0.1"


def is_loopback(host: str) -> bool:
    """Return True if a host is this one, or if its name does not resolve."""
    if host == "localhost":
        return True
    try:
        return socket.gethostbyname(host).startswith("127.")
    except OSError:
        return True
