"""Plain HTTP on a transport's port: host names, requests, responses, and routes of nodes and gateways."""

from __future__ import annotations

import fnmatch
import re
from abc import ABC, abstractmethod
from base64 import b64encode
from collections.abc import AsyncIterator, Awaitable, Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from hashlib import sha256
from typing import Final, Generic, Literal, NamedTuple, Protocol
from urllib.parse import urlsplit

from typing_extensions import TypeVar

from rwt_transports.errors import Refused
from rwt_transports.http.proxies import parsed
from rwt_transports.shared_pool import Holder

TEXT = "text/plain; charset=utf-8"


@dataclass(frozen=True, slots=True)
class HttpRequest:
    """Plain HTTP request.

    Attributes:
        method: upper case.
        path: path without the query, still percent-encoded.
        query: text after the question mark, undecoded.
        headers: names in lower case; repeated ones joined with a comma, without those in which proxies name
            clients (:class:`~rwt_transports.http.proxies.Proxies`). Behind a trusted proxy, ``host`` and
            ``x-forwarded-proto`` are those of the client's request.
        body: the whole body.
        address: the client's address; see :func:`~rwt_transports.http.proxies.behind_proxy`.
        prefix: path below which a proxy serves this server, without a trailing slash.
        connection: identity of the connection that the request came over; None if it is not known.
    """

    method: str
    path: str
    query: str = ""
    headers: Mapping[str, str] = field(default_factory=dict)
    body: bytes = b""
    address: str = ""
    prefix: str = ""
    connection: Hashable | None = field(default=None, compare=False, repr=False)

    @property
    def target(self) -> str:
        """Path with the query."""
        return f"{self.path}?{self.query}" if self.query else self.path


@dataclass(frozen=True, slots=True)
class HttpResponse:
    """Response of a route.

    Attributes:
        body: whole body, or an iterator of chunks that are sent as they come; the iterator is closed when
            the peer disconnects.
        content_type: value of the ``Content-Type`` header.
        cookies: ``Set-Cookie`` headers, which cannot be joined into one (RFC 6265 section 3).
        is_live: True if late chunks are worthless: the next one is requested when the one before has arrived.
    """

    body: bytes | AsyncIterator[bytes] = b""
    status: int = 200
    content_type: str = TEXT
    headers: Mapping[str, str] = field(default_factory=dict)
    cookies: tuple[str, ...] = ()
    is_live: bool = False

    @classmethod
    def refusing(cls, refused: Refused) -> HttpResponse:
        """Return a refusal as plain text."""
        return cls(f"{refused.reason}\n".encode(), refused.status, headers=refused.headers)


Handler = Callable[[HttpRequest], HttpResponse | Awaitable[HttpResponse]]
"""Handler of a route: a plain function, or a coroutine function, which runs in its own task."""


def joined_headers(pairs: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Return headers by name; the values of repeated ones are joined with a comma."""
    headers: dict[str, str] = {}
    for name, value in pairs:
        headers[name] = f"{headers[name]}, {value}" if name in headers else value
    return headers


class WorkAccount(ABC):
    """Rate-limited account of the work for the clients of an address."""

    __slots__ = ()

    @property
    @abstractmethod
    def excess(self) -> float:
        """Return the seconds until they are within their rate again; 0.0 if they are."""

    @abstractmethod
    def add(self, seconds: float, kind: Literal["pages", "pictures"]) -> None:
        """Add seconds of processor time used outside the page itself, such as in threads or streams."""


class Reader(Protocol):
    """Sender of a request for a page: visible graph and charged work."""

    @property
    def is_admitted(self) -> bool:
        """True if the reader may connect; False on pages for everybody, where it is not known."""

    @property
    def work(self) -> WorkAccount:
        """Account of the work for the reader's address."""

    @property
    def holder(self) -> Holder:
        """Client to which shares of pools count."""

    def may_subscribe(self, topic: str) -> bool:
        """Return True if the reader may subscribe to `topic`, an absolute name after remapping."""

    def while_allowed(self, topics: Iterable[str], end: Callable[[str], None]) -> Callable[[], None]:
        """Begin an open response, which ends if reloaded settings no longer admit the reader, or forbid one
        of the topics.

        Args:
            topics: absolute names; none for a response that shows no topic.
            end: called once in that case, with the reason.

        Returns:
            Function to call when the response has ended.

        Raises:
            Refused: access was withdrawn since the request was admitted.
        """


Page = Callable[[HttpRequest, Reader], HttpResponse | Awaitable[HttpResponse]]
"""Handler of a node's route; shows what its reader may see."""

AnyReader = TypeVar("AnyReader", default=Reader, contravariant=True)
"""Reader as a page needs it; gateways' pages need more than nodes'."""


def refusal_as_text(request: HttpRequest, refused: Refused) -> HttpResponse:
    """Return a refusal as plain text."""
    return HttpResponse.refusing(refused)


class Audience(Enum):
    """Clients that may request a route. Each route declares it, without a default."""

    ANYBODY = auto()
    """All clients, without credentials: the page reveals nothing of the robot (a health check)."""
    IF_ADMITTED = auto()
    """All clients; what the page reveals of the robot, it shows only if :attr:`Reader.is_admitted`."""
    ADMITTED = auto()
    """Clients that may connect; the page shows what its :class:`Reader` may see."""
    EVERY_TOPIC = auto()
    """Clients that may subscribe to every topic: the page names them all (metrics)."""


class StopRequests(NamedTuple, Generic[AnyReader]):
    """How requests for a route press the robot's emergency stop, ahead of all that waits.

    Attributes:
        may_press: returns True if a request names the stop and its sender may press it that way now. Decodes
            no body.
        press: presses the stop if the request, which is decoded now, asks for that; never raises a refusal.
    """

    may_press: Callable[[HttpRequest, AnyReader], bool]
    press: Callable[[HttpRequest, AnyReader], None]


@dataclass(frozen=True)
class Route(Generic[AnyReader]):
    """Path and method that a node or a gateway serves.

    Attributes:
        path: path as in :class:`Routes`, such as ``/stream`` or ``/packages/*``.
        page: handler, limited to the rights of its reader.
        audience: clients that may request it.
        method: HTTP method in upper case; ``GET`` includes ``HEAD``, and ``*`` is every method without a
            handler. Web pages of other origins may use a route only where they may connect by WebSocket (the
            setting `origins`), unless it is for everybody.
        refusal: builds the response to a request that is refused before it reaches the page.
        stop: how requests press the robot's emergency stop; None if they cannot.
        feature: name under which ``/role`` lists it, for pages that check first whether a server has it.
    """

    path: str
    page: Callable[[HttpRequest, AnyReader], HttpResponse | Awaitable[HttpResponse]]
    audience: Audience
    method: str = "GET"
    refusal: Callable[[HttpRequest, Refused], HttpResponse] = refusal_as_text
    stop: StopRequests[AnyReader] | None = None
    feature: str = ""


class MetricFamily(NamedTuple):
    """Metric with its samples, for ``/metrics``.

    Attributes:
        name: Prometheus name; that of a counter ends in ``_total``.
        help: one sentence.
        samples: labels and value of each.
    """

    name: str
    kind: Literal["counter", "gauge"]
    help: str
    samples: Iterable[tuple[Mapping[str, str], float]]


@dataclass(frozen=True)
class HttpExtension(Generic[AnyReader]):
    """HTTP routes and metrics that a node or a gateway adds to the server. A node has it as its `http`.

    Attributes:
        section: returns HTML for the index page, limited to what the reader may see.
        metrics: returns metrics for ``/metrics``.
        problems: returns what does not work, a sentence each, for ``/healthz``, which everybody may read.
    """

    routes: tuple[Route[AnyReader], ...] = ()
    section: Callable[[HttpRequest, AnyReader], str] | None = None
    metrics: Callable[[], Iterable[MetricFamily]] | None = None
    problems: Callable[[], Iterable[str]] | None = None


def page_policy(script: str = "") -> Mapping[str, str]:
    """Return the Content-Security-Policy header of an HTML page (CSP Level 3).

    Only images and videos of this server are allowed, no inline scripts, and no framing by other sites.

    Args:
        script: text of its only script, if it has one.
    """
    digest = b64encode(sha256(script.encode()).digest()).decode()
    scripts = f"script-src 'sha256-{digest}'; " if script else ""
    return {"Content-Security-Policy": f"default-src 'none'; {scripts}{_PAGE_POLICY}"}


_PAGE_POLICY: Final = (
    "style-src 'unsafe-inline'; img-src 'self'; media-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)


class EarlyRequests(Protocol):
    """Decides which requests are answered ahead of those that wait."""

    def may_begin(self, connection: Hashable, data: bytes) -> bool:
        """Return False if a connection has no early request now. Decodes nothing.

        Args:
            data: what has arrived of its request.
        """

    def begin(self, request: HttpRequest) -> bool:
        """Return True to answer a request early, whose connection then gets :meth:`end`.

        Args:
            request: as it arrived, so without the names that a proxy gives.
        """

    def end(self, connection: Hashable) -> None:
        """Called after an early request was handled."""


class Routes:
    """Method and path → handler. ``HEAD`` uses the handler of ``GET``.

    A path ending in ``/*`` matches everything below it. Exact paths win, then the longest.

    Attributes:
        early: decides which requests are answered ahead of their turn; None: none are.
    """

    def __init__(self) -> None:
        self.early: EarlyRequests | None = None
        self._handlers: dict[str, dict[str, Handler]] = {}
        self._public: set[Handler] = set()

    def add(self, path: str, handler: Handler, method: str = "GET", *, is_public: bool = False) -> None:
        """Serve `path`; a second handler for the same method and path replaces the first.

        Args:
            is_public: True if the handler needs no credentials of the server: bodies from everyone may be
                large.
        """
        self._handlers.setdefault(path, {})[method.upper()] = handler
        if is_public:
            self._public.add(handler)

    def get(self, path: str, handler: Handler) -> None:
        self.add(path, handler, "GET")

    @property
    def paths(self) -> tuple[str, ...]:
        """Served paths, in the order in which they were added."""
        return tuple(self._handlers)

    def find(self, method: str, path: str) -> Handler | HttpResponse:
        """Return the handler, or a 404 or 405 response."""
        handlers = self._handlers.get(path) or self._below(path)
        if handlers is None:
            known = ", ".join(sorted(self._handlers)) or "nothing but WebSocket connections"
            return HttpResponse(f"there is no {path} here; this port serves {known}\n".encode(), 404)
        handler = handlers.get("GET" if method == "HEAD" else method) or handlers.get("*")
        if handler is not None:
            return handler
        # HEAD is served wherever GET is (RFC 9110 section 9.1), though no route names it.
        allowed = ", ".join(sorted(handlers.keys() | ({"HEAD"} if "GET" in handlers else set())))
        text = f"{method} is not possible for {path}; use {allowed}\n"
        return HttpResponse(text.encode(), 405, headers={"Allow": allowed})

    def is_public(self, method: str, path: str) -> bool:
        """Return True if a handler serves the request that needs no credentials."""
        found = self.find(method, path)
        return not isinstance(found, HttpResponse) and found in self._public

    def _below(self, path: str) -> dict[str, Handler] | None:
        fitting = [known for known in self._handlers if known.endswith("/*") and path.startswith(known[:-1])]
        return self._handlers[max(fitting, key=len)] if fitting else None


class Hosts:
    """Host names that a listener accepts in the ``Host`` of a request (RFC 9110 section 7.2).

    A site can make its own name lead to any address (DNS rebinding); its pages then count as pages of what
    is there. So a listener on a loopback address answers to ``localhost``, ``*.localhost``, loopback
    addresses and the names that are configured. Any other listener answers to every name, or, where names
    are configured, to local ones, to any address and to those. A request without
    ``Host`` comes from no browser, and is answered.

    Args:
        names: globs of additional names, without port (the setting `origins.hosts`).
        loopback: True if the listener is only reached from this machine.
    """

    def __init__(self, names: Iterable[str], *, loopback: bool) -> None:
        names = tuple(names)
        self._every_name = not loopback and not names
        self._every_address = not loopback
        self._names = any_of(names)

    def include(self, host: str) -> bool:
        """Return True if the listener accepts the ``Host`` of a request; empty: it has none."""
        if self._every_name or not host:
            return True
        name = host_name(host)
        if is_local(name) or self._names.fullmatch(name):
            return True
        return self._every_address and parsed(name) is not None


def any_of(globs: Iterable[str]) -> re.Pattern[str]:
    """Return a pattern that matches what any of the globs matches, in lower case."""
    return re.compile("|".join(fnmatch.translate(glob.lower()) for glob in globs) or r"(?!)")


def is_local(host: str) -> bool:
    """Return True if a host name or address is the loopback of this machine."""
    if host == "localhost" or host.endswith(".localhost"):
        return True
    address = parsed(host)
    return address is not None and address.is_loopback


def host_name(text: str) -> str:
    """Return the host of ``host:port``, in lower case and without brackets; empty if there is none."""
    try:
        return (urlsplit(f"//{text}").hostname or "").removesuffix(".")
    except ValueError:
        return ""


EVERY_NAME = Hosts((), loopback=False)
