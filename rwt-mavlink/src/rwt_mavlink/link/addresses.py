"""Addresses of links, in the forms of mavros's `fcu_url`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, Literal

_PORT: Final = 14550
_TCP_PORT: Final = 5760
_BAUD: Final = 57600
_HOST_AND_PORT: Final = re.compile(r"(?P<host>\[[0-9A-Fa-f:.]+\]|[^\s:/@\[\]]*)(?::(?P<port>\d{1,5}))?")
_SERIAL: Final = re.compile(r"(?P<device>/?[^\s:]+|COM\d+)(?::(?P<baud>\d{3,7}))?")


@dataclass(frozen=True, slots=True)
class LinkAddress:
    """Address of a link.

    Attributes:
        kind: `listen` for UDP from any sender, `udp` for UDP to a known one.
        host: host to listen on or to connect to, or the device of a serial port.
        port: port, or baud rate of a serial port.
    """

    kind: Literal["listen", "udp", "tcp", "serial"]
    host: str
    port: int


def parse_link(text: str) -> LinkAddress:
    """Return the address that a URL names.

    Raises:
        ValueError: the text is no such URL; the text of the error shows the forms.
    """
    scheme, separator, rest = text.partition("://")
    found = None
    if separator and scheme == "serial":
        found = _SERIAL.fullmatch(rest)
        if found is not None:
            return LinkAddress("serial", found["device"], int(found["baud"] or _BAUD))
    elif separator and scheme in ("udp", "tcp"):
        is_remote = rest.startswith("@")
        found = _HOST_AND_PORT.fullmatch(rest.removeprefix("@").rstrip("/"))
        if found is not None and not (scheme == "tcp" and is_remote):
            port = int(found["port"] or (_TCP_PORT if scheme == "tcp" else _PORT))
            host = found["host"].strip("[]")
            if port <= 65535 and (host or not (is_remote or scheme == "tcp")):
                if scheme == "tcp":
                    return LinkAddress("tcp", host, port)
                return LinkAddress("udp" if is_remote else "listen", host or "127.0.0.1", port)
    raise ValueError(
        f"{text!r} is no link: expected udp://0.0.0.0:14550 to listen, udp://@HOST:14550 to send first,"
        " tcp://HOST:5760 or serial:///dev/ttyACM0:57600"
    )
