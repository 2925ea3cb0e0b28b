"""Check of origins: any web page can open WebSockets to what its browser reaches, and load images from it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Final

from rwt_transports.http.routes import any_of, host_name, is_local

#: Origins of pages without a site: opened from a file, or in a sandboxed frame of any site.
NO_SITE: Final = frozenset({"null", "file://"})

#: Browsers use the first two, for the page. Some other programs use the others, for the server.
_SCHEMES: Final = frozenset({"http", "https", "ws", "wss"})


class Origins:
    """Allow-list of origins.

    By default a listener on a loopback address accepts pages of this machine: any port of ``localhost``,
    ``127.0.0.0/8`` and ``[::1]``. Every other listener accepts pages of the host that the client addresses,
    on any port. Pages without a site are never accepted by default, since any site can create one.

    Args:
        allow: globs of further origins.
    """

    def __init__(self, allow: Iterable[str]) -> None:
        self._allowed = any_of(glob.rstrip("/") for glob in allow)

    def allows(self, origin: str, host: str, *, loopback: bool) -> bool:
        """Return True if a page of `origin` may connect.

        Args:
            origin: ``Origin`` header (RFC 6454 section 7); from programs other than browsers, empty or
                ``host:port`` without a scheme.
            loopback: True if the listener can only be reached from this machine.
        """
        wanted = origin.lower()
        if not wanted or self._allowed.fullmatch(wanted.rstrip("/")):
            return True
        page = _site(wanted)
        if not page:
            return False
        return is_local(page) if loopback else page == host_name(host)


def page_of(headers: Mapping[str, str]) -> str:
    """Return the origin of the web page that sends an HTTP request; empty if it is not known to be a page's.

    That is `Origin`, or else the origin of `Referer`, which browsers send with images and frames. A page of
    another site that sends neither is one without a site: browsers then name it in `Sec-Fetch-Site`, but only
    over https and to this machine.
    """
    origin = headers.get("origin") or _origin_of(headers.get("referer", ""))
    return origin or ("null" if headers.get("sec-fetch-site") == "cross-site" else "")


def is_navigation(method: str, headers: Mapping[str, str]) -> bool:
    """Return True if a browser opens a page in a tab: another page may link to it, and cannot read it."""
    return (
        method in ("GET", "HEAD")
        and headers.get("sec-fetch-mode") == "navigate"
        and headers.get("sec-fetch-dest") == "document"
    )


def _origin_of(url: str) -> str:
    """Return the origin of a URL, `null` if it has none; empty for an empty URL."""
    if not url:
        return ""
    scheme, separator, rest = url.partition("://")
    authority = re.split(r"[/?#\\]", rest, maxsplit=1)[0].rpartition("@")[2]
    return f"{scheme}://{authority}" if separator and authority else "null"


def is_loopback_listener(url: str) -> bool:
    """Return True if a listener can only be reached from this machine, such as one on a socket file."""
    host = host_name(url.partition("://")[2])
    return not host or is_local(host)


def _site(origin: str) -> str:
    """Return the host of an origin; empty if it has none."""
    if origin in NO_SITE:
        return ""
    scheme, separator, rest = origin.rpartition("://")
    return host_name(rest) if not separator or scheme in _SCHEMES else ""
