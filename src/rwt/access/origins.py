"""Which web pages may connect: any page can open a WebSocket to whatever its reader's browser reaches."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from rwt_transports.http.routes import any_of, host_name, is_local

#: What a page without a site of its own sends: one from a file, or in a sandboxed frame of any site.
NO_SITE: Final = frozenset({"null", "file://"})

#: Browsers name a page by the first two. Some programs that are no browsers name the server by the others.
_SCHEMES: Final = frozenset({"http", "https", "ws", "wss"})


class Origins:
    """The allow-list.

    By default a listener on a loopback address takes pages of this machine: any port of ``localhost``,
    ``127.0.0.0/8`` and ``[::1]``. Every other listener takes pages of the very host that the client
    addresses, on any port. A page without a site is taken by none, since any site can make one.

    Args:
        allow: globs of further origins.
    """

    def __init__(self, allow: Iterable[str]) -> None:
        self._allowed = any_of(glob.rstrip("/") for glob in allow)

    def allows(self, origin: str, host: str, *, loopback: bool) -> bool:
        """Whether a page of `origin` may connect.

        Args:
            origin: the request's ``Origin`` (RFC 6454 section 7); empty, or ``host:port`` without a scheme,
                for programs that are no browsers.
            host: the request's ``Host``.
            loopback: whether the listener is only reached from this machine.
        """
        wanted = origin.lower()
        if not wanted or self._allowed.fullmatch(wanted.rstrip("/")):
            return True
        page = _site(wanted)
        if not page:
            return False
        return is_local(page) if loopback else page == host_name(host)


def is_loopback_listener(url: str) -> bool:
    """Whether a listener is only reached from this machine; one without a host, as a socket file, is."""
    host = host_name(url.partition("://")[2])
    return not host or is_local(host)


def _site(origin: str) -> str:
    """The host in an origin, empty if it has none."""
    if origin in NO_SITE:
        return ""
    scheme, separator, rest = origin.rpartition("://")
    return host_name(rest) if not separator or scheme in _SCHEMES else ""
