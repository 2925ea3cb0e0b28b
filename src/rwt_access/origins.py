"""Which web pages may connect: any page can open a WebSocket to whatever its reader's browser reaches."""

from __future__ import annotations

import fnmatch
import ipaddress
import re
from collections.abc import Iterable
from typing import Final
from urllib.parse import urlsplit

#: What a page without a site of its own sends: one that was opened from a file.
_NO_SITE: Final = frozenset({"null", "file://"})


class Origins:
    """The allow-list.

    By default a listener on a loopback address takes pages of this machine: any port of ``localhost``,
    ``127.0.0.0/8`` and ``[::1]``, and pages that come from files. Every other listener takes pages of the
    very host that the client addresses, on any port.

    Args:
        allow: globs of further origins.
    """

    def __init__(self, allow: Iterable[str]) -> None:
        self._allowed = re.compile(
            "|".join(fnmatch.translate(glob.lower().rstrip("/")) for glob in allow) or r"(?!)"
        )

    def allows(self, origin: str, host: str, *, loopback: bool) -> bool:
        """Whether a page of `origin` may connect.

        Args:
            origin: the request's ``Origin`` (RFC 6454 section 7).
            host: the request's ``Host``.
            loopback: whether the listener is only reached from this machine.
        """
        wanted = origin.lower()
        if self._allowed.fullmatch(wanted.rstrip("/")):
            return True
        if loopback and wanted in _NO_SITE:
            return True
        page = _site(wanted)
        if not page:
            return False
        return is_local(page) if loopback else page == _host(host)


def is_local(host: str) -> bool:
    """Whether a host, by name or address, is this machine as seen from itself."""
    if host == "localhost" or host.endswith(".localhost"):
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def is_loopback_listener(url: str) -> bool:
    """Whether a listener is only reached from this machine; one without a host, as a socket file, is."""
    host = _host(url.partition("://")[2])
    return not host or is_local(host)


def _site(origin: str) -> str:
    """The host in the origin of a web page, empty if it is none."""
    scheme, separator, rest = origin.partition("://")
    return _host(rest) if separator and scheme in ("http", "https") else ""


def _host(text: str) -> str:
    """The host of ``host:port``, in lower case and without brackets; empty if there is none."""
    try:
        return urlsplit(f"//{text}").hostname or ""
    except ValueError:
        return ""
