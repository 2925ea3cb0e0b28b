"""Trusted reverse proxies, and the headers in which they name the clients of their requests."""

from __future__ import annotations

import ipaddress
import logging
import re
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Final, Literal, NamedTuple

logger = logging.getLogger("rwt_transports.http.proxies")

Address = ipaddress.IPv4Address | ipaddress.IPv6Address
Fact = Literal["address", "scheme", "host", "prefix"]

PROXY_HEADERS: Final = ("x-forwarded-for", "x-forwarded-proto")
"""Headers that a proxy is expected to write by default; nginx, Caddy and Traefik can."""

FACTS: Final[Mapping[str, tuple[Fact, ...]]] = MappingProxyType(
    {
        "x-forwarded-for": ("address",),
        "forwarded": ("address", "scheme", "host"),
        "x-real-ip": ("address",),
        "true-client-ip": ("address",),
        "cf-connecting-ip": ("address",),
        "x-forwarded-proto": ("scheme",),
        "x-forwarded-host": ("host",),
        "x-forwarded-prefix": ("prefix",),
    }
)
"""Headers that can be trusted, with the facts that each gives. Each fact has one source at most."""

#: Headers in which proxies name clients, also those of products that cannot be trusted here, and the
#: spellings with underscores, which WSGI apps cannot distinguish. They never reach a route.
_FORWARDING: Final = re.compile(
    r"(?m)^(?:"
    r"(?:x[-_])?forwarded(?:[-_].*)?|via|front[-_]end[-_]https|"
    r"x[-_](?:real|remote|client|originating|proxyuser|cluster[-_]client)[-_](?:ip|addr)|"
    r"x[-_](?:original[-_](?:forwarded[-_]for|host|url|uri)|rewrite[-_]url|url[-_]scheme|scheme|host|port)|"
    r"x[-_](?:envoy[-_]external[-_]address|azure[-_]clientip|appengine[-_]user[-_]ip)|"
    r"(?:(?:true|fastly|fly|do)[-_])?client[-_]ip|"
    r"(?:do|cf)[-_]connecting[-_]ip(?:v6)?|cf[-_]pseudo[-_]ipv4"
    r")$"
)

_HOPS: Final = 16
"""Maximum number of proxies in a row; a client can write thousands of addresses before theirs."""

_PAIRS: Final = 64
"""Maximum number of parameters in a `Forwarded` header."""

_WITH_PORT: Final = re.compile(r"\[([0-9A-Fa-f:.]+)\](?::\d{1,5})?|([0-9.]+):\d{1,5}")
_PREFIX: Final = re.compile(r"(?:/[A-Za-z0-9._~!$&'()*+;=:@%-]+)+")
_is_scheme: Final = re.compile(r"(?:http|ws)s?").fullmatch

#: Parameter of `Forwarded` with the delimiter behind it (RFC 7239 section 4).
_PAIR: Final = re.compile(
    r"[ \t]*(?:([!#$%&'*+.^_`|~0-9A-Za-z-]+)=(?:\"((?:[^\"\\]|\\.)*)\"|([^\s\";,]+)))?[ \t]*([;,]|$)"
)

_BEHIND: Final = "proxy "


def parsed(text: str) -> Address | None:
    """Return an IP address, that of IPv4 for one that is mapped into IPv6; None if the text is not one."""
    try:
        address = ipaddress.ip_address(text)
    except ValueError:
        return None
    return getattr(address, "ipv4_mapped", None) or address


def behind_proxy(address: str) -> str:
    """Return the name of a client behind the proxy at an address, for a client whose own is not known.

    It counts like an address, and is never local: limits apply to all clients with this name together.
    """
    return f"{_BEHIND}{address or 'of this machine'}"


class _Named(NamedTuple):
    """Claims of a proxy about a request.

    Attributes:
        addresses: addresses of the client and of the proxies before the last, as written.
    """

    addresses: list[str]
    scheme: str = ""
    host: str = ""
    prefix: str = ""


class Proxies:
    """Trusted reverse proxies, and the headers that they write.

    Each fact about a request has one source: a proxy that writes one header passes on the others as the
    client sent them. So all forwarding headers but the configured ones are dropped, and all of them from
    other peers.

    Args:
        networks: addresses of the proxies, or networks such as ``10.0.0.0/8``.
        headers: headers that each of them writes or appends to, with exactly one for the client's address.

    Attributes:
        headers: these headers, in lower case.
        unread: headers with addresses of clients that were not read, because the proxy or the header is not
            configured, or the address is malformed.

    Raises:
        ValueError: an item is neither an address nor a network, or includes every address; or a header is
            not known, or gives what another does, or none gives the address.
    """

    def __init__(self, networks: Iterable[str] = (), headers: Iterable[str] = PROXY_HEADERS) -> None:
        self._networks = tuple(ipaddress.ip_network(each) for each in networks)
        for network in self._networks:
            if network.prefixlen == 0:
                raise ValueError(f"every address is in {network}: expected those of proxies")
        self.headers = tuple(name.lower() for name in headers)
        self._sources = _sources(self.headers)
        self.unread: set[str] = set()

    def __bool__(self) -> bool:
        return bool(self._networks)

    def log(self) -> None:
        """Log what is trusted, if there are proxies."""
        if self:
            trusted, peers = ", ".join(self.headers), ", ".join(map(str, self._networks))
            logger.info("trusting %s from %s; other headers that name clients are ignored", trusted, peers)

    def __contains__(self, address: str) -> bool:
        found = parsed(address)
        return found is not None and any(found in network for network in self._networks)

    def resolve(self, peer: str, headers: dict[str, str]) -> tuple[str, str]:
        """Return the address of the client behind a request and the prefix of its path.

        Args:
            peer: address from which the request came.
            headers: headers of the request by their names in lower case. Forwarding headers are removed, and
                ``host`` and ``x-forwarded-proto`` become those of the client's request.

        Returns:
            The address, or that of the proxy by :func:`behind_proxy` if none can be read or if it is one of
            this machine or of a proxy; and the prefix, without a trailing slash.
        """
        given = {name: headers.pop(name, "") for name in _FORWARDING.findall("\n".join(headers))}
        address = parsed(peer)
        if address is not None and "%" not in peer:
            peer = str(address)
        if peer not in self:
            # A proxy here, perhaps at a Unix socket, that is not configured: its clients are not local.
            if given and (address is None or address.is_loopback):
                self._note_unread(peer, given)
                return behind_proxy(peer), ""
            return peer, ""
        named = self._named(given)
        client = self._client(named.addresses)
        if not client:
            self._note_unread(peer, given)
        if named.scheme and _is_scheme(named.scheme):
            headers["x-forwarded-proto"] = named.scheme
        if named.host:
            headers["host"] = named.host
        prefix = named.prefix if _PREFIX.fullmatch(named.prefix) else ""
        return client or behind_proxy(peer), prefix

    def _named(self, given: Mapping[str, str]) -> _Named:
        source = self._sources["address"]
        value = given.get(source, "")
        if source == "forwarded":
            named = _forwarded(value)
        elif source == "x-forwarded-for":
            named = _Named(value.rsplit(",", _HOPS)[-_HOPS:])
        else:
            named = _Named([value])
        # Each proxy appends to a list: the last item is by the one that sent the request.
        last = {
            fact: given.get(name, "").rpartition(",")[2].strip()
            for fact, name in self._sources.items()
            if name != source
        }
        scheme, host = last.get("scheme", named.scheme), last.get("host", named.host)
        return named._replace(scheme=scheme.lower(), host=host, prefix=last.get("prefix", "").rstrip("/"))

    def _client(self, addresses: Iterable[str]) -> str:
        """Return the last address that is not a proxy's: each proxy appends its peer. Empty if there is none.

        Addresses before one that cannot be read are not proven by a proxy.
        """
        found = ""
        for text in reversed(list(addresses)):
            address = _client_address(text)
            if address is None:
                break
            found = str(address)
            if found not in self:
                return behind_proxy(found) if address.is_loopback else found
        return found and behind_proxy(found)

    def _note_unread(self, peer: str, given: Mapping[str, str]) -> None:
        """Warn once for each header that could have named a client."""
        for name in given:
            if "address" not in FACTS.get(name, ()) or name in self.unread:
                continue
            self.unread.add(name)
            is_trusted = peer in self and name in self.headers
            logger.warning(
                "A request from %s names its client only in %s, which %s: its clients share the limits of one"
                " address. Set `proxies` to the addresses of your proxies, and `proxy_headers` to what they"
                " write.",
                peer,
                name,
                "has no address that can be read" if is_trusted else "is not trusted",
            )


def _sources(headers: tuple[str, ...]) -> Mapping[Fact, str]:
    """Return the header of each fact. Raises ValueError if the headers are not usable."""
    sources: dict[Fact, str] = {}
    for name in headers:
        if name not in FACTS:
            raise ValueError(f"{name!r} is not known: expected some of {', '.join(FACTS)}")
        for fact in FACTS[name]:
            other = sources.setdefault(fact, name)
            if other != name:
                raise ValueError(f"{other} and {name} both give the client's {fact}: expected one of them")
    if "address" not in sources:
        known = ", ".join(name for name, facts in FACTS.items() if "address" in facts)
        raise ValueError(f"no header gives the client's address: expected one of {known}")
    return sources


def _client_address(text: str) -> Address | None:
    """Return an address as proxies write it, perhaps with a port; None for another text."""
    text = text.strip()
    if found := _WITH_PORT.fullmatch(text):
        text = found[1] or found[2]
    return None if "%" in text else parsed(text)


def _forwarded(text: str) -> _Named:
    """Return what a ``Forwarded`` header names (RFC 7239); nothing if it is malformed.

    A client can open a quoted string that what the proxy appends would end, so nothing in such a header can
    be trusted.
    """
    elements: list[dict[str, str]] = [{}]
    position = 0
    for _ in range(_PAIRS):
        pair = _PAIR.match(text, position)
        if pair is None:
            break
        name, quoted, plain, delimiter = pair.groups()
        if name:
            if name.lower() in elements[-1]:
                break
            elements[-1][name.lower()] = plain or re.sub(r"\\(.)", r"\1", quoted)
        if not delimiter:
            last = elements[-1]
            addresses = [each.get("for", "") for each in elements[-_HOPS:]]
            return _Named(addresses, last.get("proto", ""), last.get("host", ""))
        if delimiter == ",":
            elements.append({})
        position = pair.end()
    return _Named([])


NO_PROXIES: Final = Proxies()
