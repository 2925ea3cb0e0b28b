"""Relay hub for dial-out: robots behind a NAT dial in, and clients reach each under its own path.

Nothing is multiplexed. A robot keeps a few idle connections (:mod:`rwt.extensions.hub.relay.protocol`), and
each client gets one of them to itself. Messages, refusals and close codes pass end to end. A side that reads
slowly holds back the other, so the robot's own queue rules decide what is dropped.
"""

from __future__ import annotations

import hmac
import html
import json
import logging
import time
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import AsyncIterator, Awaitable, Collection, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from ssl import SSLContext
from typing import ClassVar, Final, Literal

import anyio

from rwt.extensions.hub.relay.pages import PageInbox
from rwt.extensions.hub.relay.protocol import (
    INSTANCE,
    NAME_RULE,
    REPLACED,
    ROBOTS,
    encode_assignment,
    encode_request,
    is_robot_name,
    split_client_path,
)
from rwt.observability.prometheus import CONTENT_TYPE, PrometheusText
from rwt_protocol.frames import Frame
from rwt_transports.api import FlowControl
from rwt_transports.background import background_tasks
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from rwt_transports.errors import Refused
from rwt_transports.http.addresses import AddressCount, holder_of, network_of
from rwt_transports.http.routes import (
    NO_PROXIES,
    HttpRequest,
    HttpResponse,
    Proxies,
    Routes,
    is_local,
    page_policy,
)
from rwt_transports.limits import MIB, Limits
from rwt_transports.listener import listen
from rwt_transports.scheduler import MESSAGES, Scheduler
from rwt_transports.shared_pool import PoolFull, PoolRow, Share, SharedPool
from rwt_transports.websocket.close_codes import (
    GOING_AWAY,
    POLICY,
    SERVICE_RESTART,
    TRY_AGAIN_LATER,
    may_travel,
)

logger = logging.getLogger("rwt.extensions.hub.hub")

TICK_SECONDS = 0.5
PASS_BYTES = 256 * 1024
"""Bytes to pass on before waiting until the other side has taken them."""
PATIENCE_SECONDS = 10.0
"""Maximum time that a client waits for a connection of its robot."""
GRACE_SECONDS = 3.0
"""Time for which a robot without a connection stays listed: it may be about to open the next one."""
PAGE_SECONDS: Final = 120.0
"""Default timeout of a robot's answer to a request for a page. Calls of services wait for at most 60 s."""
ADDRESS_BYTES: Final = 64 * MIB
"""Default limit of waiting bytes for the clients of one address."""
TOTAL_FACTOR: Final = 4
"""Limit for all addresses together, as a multiple of the limit of one."""
MAX_IDLE = 16
"""Maximum number of idle connections per robot."""
MAX_WAITING = 256
"""Maximum number of waiting clients per robot."""


WAITING_BYTES: Final = PoolRow("waiting bytes of a hub", "--waiting-bytes", "waiting bytes")
WAITING_CLIENTS: Final = PoolRow("waiting clients of a hub", "", "clients that wait for the robot")


class WaitingBytes:
    """Counter of waiting bytes; above the limit, it closes the connection that has waited for longest.

    A connection is held back once 256 KiB of it wait. What counts is therefore large messages to a side that
    does not read.

    Args:
        most: maximum number of waiting bytes for the clients of one address, in both directions. Local
            addresses have no limit of their own; all addresses together share four times as much.
    """

    def __init__(self, most: int = ADDRESS_BYTES) -> None:
        self._most = most
        self._pool = SharedPool(WAITING_BYTES, TOTAL_FACTOR * most)
        self._shares: dict[_RelayEnd, Share] = {}

    @property
    def total(self) -> int:
        """Waiting bytes of all connections."""
        return self._pool.used

    def take(self, end: _RelayEnd, size: int) -> None:
        """Add `size` waiting bytes of a connection."""
        share = self._shares.get(end)
        if share is None:
            share = self._pool.take(holder_of(end.address), partial(self._cut, end), 0)
            self._shares[end] = share
        self._pool.resize(share, share.amount + size)
        held = self._pool.held(share.holder)
        if (held > self._most and not is_local(end.address)) or self._pool.used > self._pool.capacity:
            self._pool.end_oldest(share.holder)

    def give_back(self, end: _RelayEnd) -> None:
        """Clear the waiting bytes of a connection; idempotent."""
        share = self._shares.pop(end, None)
        if share is not None:
            self._pool.release(share)

    def _cut(self, end: _RelayEnd, reason: str) -> None:
        del self._shares[end]
        end.cut(reason)


@dataclass(slots=True)
class DialedRobot:
    """Robot that has dialled in.

    Attributes:
        instance: random id of the program; distinguishes it from another of the same name.
        idle: connections that wait for a client.
        waiting: clients that wait for a connection, oldest first, with their shares of the places.
        pairs: connections that serve a client.
        alone_since: time at which it was first found without any connection.
    """

    name: str
    instance: str
    address: str
    idle: deque[_RobotEnd] = field(default_factory=deque)
    waiting: dict[_WaitingEnd, Share] = field(default_factory=dict)
    pairs: set[_RobotEnd] = field(default_factory=set)
    alone_since: float | None = None
    _places: SharedPool = field(default_factory=partial(SharedPool, WAITING_CLIENTS, MAX_WAITING))

    def add_waiting(self, client: _WaitingEnd) -> None:
        """Let a client wait for a connection.

        Raises:
            PoolFull: too many clients wait.
        """
        self.waiting[client] = self._places.take(holder_of(client.address), partial(self._displace, client))

    def remove_waiting(self, client: _WaitingEnd) -> None:
        """Note that a client does not wait any longer; idempotent."""
        share = self.waiting.pop(client, None)
        if share is not None:
            self._places.release(share)

    def _displace(self, client: _WaitingEnd, reason: str) -> None:
        del self.waiting[client]
        client.hang_up(TRY_AGAIN_LATER, reason)

    @property
    def is_alone(self) -> bool:
        """True if the robot has no connection left."""
        return not self.idle and not self.pairs


class Hub:
    """Relay of all robots that have dialled in, and of their clients.

    Args:
        tokens: bearer tokens; a robot must present one. ``NAME=TOKEN`` is for one robot. Empty: every robot
            is accepted.
        grace: seconds for which a robot without a connection stays listed.
        addresses: counter of connections per address; a robot's own connections are not counted.
        waiting_bytes: limit per client address, see :class:`WaitingBytes`.
        page_seconds: timeout of the head of a robot's page.
        scheduler: scheduler of the messages that are passed on, shared by all connections.

    Attributes:
        url: URL at which it listens, with the actual port; empty until it is open.
        clients: clients so far.
        pages: requests for pages of robots so far.
        bytes: bytes of messages and pages so far, in both directions.
    """

    def __init__(
        self,
        tokens: Collection[str] = (),
        grace: float = GRACE_SECONDS,
        addresses: AddressCount | None = None,
        waiting_bytes: int = ADDRESS_BYTES,
        page_seconds: float = PAGE_SECONDS,
        scheduler: Scheduler | None = None,
    ) -> None:
        self.url = ""
        self.scheduler = scheduler or Scheduler.immediate(MESSAGES)
        self._page_seconds = page_seconds
        self._grace = grace
        self.waiting = WaitingBytes(waiting_bytes)
        self.addresses = addresses or AddressCount()
        self._robots: dict[str, DialedRobot] = {}
        self.clients = self.pages = self.bytes = 0
        self.take_tokens(tokens)

    def take_tokens(self, tokens: Collection[str]) -> None:
        """Replace the tokens, for robots that dial in from now on. A robot with a ``NAME=TOKEN`` needs it."""
        bound = [token.partition("=") for token in tokens]
        self._tokens = tuple(
            (name if equals else "", (token if equals else name).encode()) for name, equals, token in bound
        )
        self._names = {name for name, _ in self._tokens if name}

    @property
    def robots(self) -> tuple[DialedRobot, ...]:
        """Robots that have a connection or had one a moment ago, by name."""
        return tuple(self._robots[name] for name in sorted(self._robots))

    def accept(self, sink: Sink, info: PeerInfo) -> Endpoint:
        """Accept a robot, or a client of one.

        Raises:
            Refused: there is no such robot (404); or a robot without the token (401), from a browser (403),
                with an invalid name (400) or with too many connections (429).
        """
        path = info.path.partition("?")[0]
        if path.startswith(ROBOTS):
            return self._accept_robot(sink, info, path.removeprefix(ROBOTS))
        return self._accept_client(sink, info)

    def tick(self, now: float) -> None:
        """End clients that have waited too long, and remove robots that have gone; `now` is in seconds."""
        for robot in self.robots:
            if not robot.is_alone:
                robot.alone_since = None
            elif robot.alone_since is None:
                robot.alone_since = now
            elif now - robot.alone_since >= self._grace:
                self._forget(robot)
            for client in tuple(robot.waiting):
                if client.since is None:
                    client.since = now
                elif now - client.since >= PATIENCE_SECONDS:
                    robot.remove_waiting(client)
                    client.hang_up(TRY_AGAIN_LATER, f"{robot.name} has no connection free; try again later")

    async def watch(self) -> None:
        """Call :meth:`tick` about twice a second, until cancelled."""
        while True:
            self.tick(time.monotonic())
            await anyio.sleep(TICK_SECONDS)

    # -- robots --------------------------------------------------------------------------------------------

    def _accept_robot(self, sink: Sink, info: PeerInfo, name: str) -> Endpoint:
        self._check_robot(info, name)
        instance = info.headers.get(INSTANCE, "")
        robot = self._robots.get(name)
        if robot is not None and robot.instance != instance:
            self._replace(robot, info)
            robot = None
        if robot is None:
            robot = self._robots[name] = DialedRobot(name, instance, info.address)
            logger.info("robot %s dialled in from %s", name, info.address or "?")
        if len(robot.idle) >= MAX_IDLE:
            raise Refused(429, f"{MAX_IDLE} connections of {name} wait already")
        side = _RobotEnd(self, robot, sink, info.address)
        self.addresses.leave(info.address)
        robot.idle.append(side)
        return side

    def _check_robot(self, info: PeerInfo, name: str) -> None:
        if "origin" in info.headers:
            raise Refused(403, "robots dial in here, not web pages; a page connects to /NAME")
        if self._tokens and not self._knows(info.headers.get("authorization", ""), name):
            logger.warning("refusing a robot named %.80r: invalid token (%s)", name, info.address)
            raise Refused(
                401,
                "this hub wants `Authorization: Bearer TOKEN` with its own token",
                {"WWW-Authenticate": 'Bearer realm="rwt hub"'},
            )
        if not is_robot_name(name):
            raise Refused(400, f"a robot cannot be called {name[:80]!r}; a name is {NAME_RULE}")

    def _knows(self, authorization: str, name: str) -> bool:
        scheme, _, token = authorization.partition(" ")
        shown = token.strip().encode()
        # Compare all tokens: constant time.
        wanted = name if name in self._names else ""
        right = [hmac.compare_digest(shown, known) and its == wanted for its, known in self._tokens]
        return scheme.lower() == "bearer" and any(right)

    def _replace(self, robot: DialedRobot, info: PeerInfo) -> None:
        """Replace a robot by a newer program of the same name: after a crash, old connections may linger."""
        reason = f"another program dialled in as {robot.name}, from {info.address or '?'}"
        logger.warning("%s; closing the one from %s", reason, robot.address or "?")
        del self._robots[robot.name]
        for side in (*robot.idle, *robot.pairs):
            side.hang_up(REPLACED, reason)
        self._turn_away(robot, reason)

    def left(self, side: _RobotEnd, *, for_good: bool) -> None:
        """Called when a connection of a robot has ended; `for_good`: the robot announced that it leaves."""
        robot = side.robot
        self.addresses.enter(side.own_address)
        robot.pairs.discard(side)
        if side in robot.idle:
            robot.idle.remove(side)
        if for_good and robot.is_alone:
            self._forget(robot)

    def _forget(self, robot: DialedRobot) -> None:
        if self._robots.get(robot.name) is robot:
            del self._robots[robot.name]
            logger.info("robot %s is gone", robot.name)
            self._turn_away(robot, f"the robot {robot.name} is gone")

    def _turn_away(self, robot: DialedRobot, reason: str) -> None:
        for client in tuple(robot.waiting):
            robot.remove_waiting(client)
            client.hang_up(SERVICE_RESTART, reason)

    # -- clients -------------------------------------------------------------------------------------------

    def _accept_client(self, sink: Sink, info: PeerInfo) -> Endpoint:
        name, path = split_client_path(info.path)
        robot = self._robots.get(name)
        if robot is None:
            raise Refused(404, f"no robot called {name[:80]!r} is here; GET / lists those that are")
        client = _ClientEnd(self, robot, sink, info.address, encode_assignment(info, path))
        robot.add_waiting(client)
        self.clients += 1
        return client

    def page(self, request: HttpRequest) -> HttpResponse | Awaitable[HttpResponse]:
        """Forward an HTTP request to a robot over one of its connections."""
        name, path = split_client_path(request.path)
        robot = self._robots.get(name)
        if robot is None:
            text = f"no robot called {name[:80]!r} is here; GET / lists those that are\n"
            return HttpResponse(text.encode(), 404)
        prefix = f"{request.prefix}/{name}"
        if request.path == f"/{name}":
            # Without the slash, relative links would lead to other robots.
            query = f"?{request.query}" if request.query else ""
            return HttpResponse(status=308, headers={"Location": f"{prefix}/{query}"})
        reader = _PageEnd(self, robot, request.address, encode_request(request, path, prefix))
        try:
            robot.add_waiting(reader)
        except PoolFull as full:
            return HttpResponse.refusing(full)
        self.pages += 1
        self.match(robot)
        return self._linked(reader, request)

    async def _linked(self, reader: _PageEnd, request: HttpRequest) -> HttpResponse:
        """Return the robot's response with a link to the list of robots (RFC 6573), first in its header."""
        head_only = request.method == "HEAD"
        response = await reader.inbox.response(reader.closed, self._page_seconds, head_only=head_only)
        links = [f'<{request.prefix}/robots>; rel="collection"', response.headers.get("Link")]
        return replace(response, headers={**response.headers, "Link": ", ".join(filter(None, links))})

    def match(self, robot: DialedRobot) -> None:
        """Assign idle connections to waiting clients: first to the address with fewest, then the oldest."""
        while robot.idle and robot.waiting:
            served = Counter(network_of(side.address) for side in robot.pairs)
            client = min(robot.waiting, key=lambda each: served[network_of(each.address)])
            side = robot.idle.popleft()
            robot.remove_waiting(client)
            robot.pairs.add(side)
            side.begin(client)


class _RelayEnd(ABC):
    """One of two connections that the hub joins. A robot without a client has its own address.

    Reading stops while the other side has not taken what was passed on (``_is_full``), and once this
    connection has used its share of a turn of the event loop, until another turn (``_is_late``).
    """

    holds_wire: ClassVar[Literal[True]] = True

    def __init__(self, hub: Hub, robot: DialedRobot, sink: Sink | PageInbox, address: str) -> None:
        self.address = address
        self.hub = hub
        self.robot = robot
        self.sink = sink
        self.flow_control: FlowControl | None = None
        self.other: _RelayEnd | None = None
        self._early: list[Frame] = []
        self._passed = 0
        self._is_full = self._is_late = False
        self._received = -1
        self._turn_began = 0.0

    def set_flow_control(self, flow_control: FlowControl) -> None:
        """Set the flow control of the connection. Called before it opens."""
        self.flow_control = flow_control
        self.hub.match(self.robot)

    def receive(self, data: bytes, binary: bool) -> None:
        scheduler = self.hub.scheduler
        now = scheduler.monotonic()
        if self.sink.received != self._received:  # Another read, and therefore another turn.
            self._received = self.sink.received
            self._turn_began = now
        frame = Frame(data, binary=binary)
        if self.other is None:
            self.too_early(frame)
        else:
            self._pass_on(frame, self.other)
        used = scheduler.monotonic() - self._turn_began
        must_wait = used > MESSAGES.share or scheduler.is_full
        if must_wait and not self._is_late and self.flow_control is not None:
            scheduler.note(used)
            self._is_late = True
            self.flow_control.pause()
            scheduler.wait(self._go_on)

    def _go_on(self) -> None:
        self._is_late = False
        self._turn_began = self.hub.scheduler.monotonic()
        self.resume()

    def resume(self) -> None:
        """Read on, unless there is another reason to wait."""
        if self.flow_control is not None and not (self._is_late or self._is_full):
            self.flow_control.resume()

    def too_early(self, frame: Frame) -> None:
        """Keep a message that arrived before the other end was assigned."""
        self._early.append(frame)
        self.hub.waiting.take(self, frame.size)

    def join(self, other: _RelayEnd) -> None:
        """Pass messages on to `other`, kept ones first."""
        self.other = other
        early, self._early = self._early, []
        self.hub.waiting.give_back(self)
        for frame in early:
            self._pass_on(frame, other)

    def _pass_on(self, frame: Frame, other: _RelayEnd) -> None:
        other.sink.send(frame)
        self._passed += frame.size
        self.hub.bytes += frame.size
        if self._passed >= PASS_BYTES and self.flow_control is not None and other.flow_control is not None:
            passed, self._passed = self._passed, 0
            self._is_full = True
            self.flow_control.pause()
            other.flow_control.when_empty(self._taken)
            self.hub.waiting.take(self, passed)

    def _taken(self) -> None:
        self.hub.waiting.give_back(self)
        self._is_full = False
        self.resume()

    def cut(self, reason: str) -> None:
        """Close both connections: too many bytes wait."""
        client = self.client
        client.closed(POLICY, reason)
        client.hang_up(POLICY, reason)

    @property
    def client(self) -> _RelayEnd:
        return self

    def closed(self, code: int, reason: str) -> None:
        """End the other connection as well; the waiting bytes of both no longer count."""
        self.hub.waiting.give_back(self)
        self._early.clear()
        other, self.other = self.other, None
        if other is not None:
            self.hub.waiting.give_back(other)
            other.other = None
            other.end(code, reason)

    def hang_up(self, code: int, reason: str) -> None:
        """Close this end, even if it is held back."""
        self.sink.close(code, reason)
        if self.flow_control is not None:
            # Resume reading, to receive the reply to the close. Messages are dropped now.
            self.flow_control.resume()

    @abstractmethod
    def end(self, code: int, reason: str) -> None:
        """Close this end because the other has gone."""


class _RobotEnd(_RelayEnd):
    """Connection of a robot."""

    def __init__(self, hub: Hub, robot: DialedRobot, sink: Sink, address: str) -> None:
        super().__init__(hub, robot, sink, address)
        self.own_address = address
        self._let_go = False

    @property
    def client(self) -> _RelayEnd:
        return self.other or self

    def too_early(self, frame: Frame) -> None:
        """Refuse a message from a robot that has no client."""
        self.sink.close(POLICY, "a robot speaks after the assignment of a client")

    def begin(self, client: _WaitingEnd) -> None:
        """Serve this client. The robot's messages are charged to the client's address."""
        self.address = client.address
        self.sink.count_for(holder_of(client.address))
        self.sink.send(Frame(client.assignment))
        self.join(client)
        client.join(self)
        client.resume()

    def closed(self, code: int, reason: str) -> None:
        super().closed(code, reason)
        self.hub.left(self, for_good=code == GOING_AWAY and not self._let_go)

    def end(self, code: int, reason: str) -> None:
        self._let_go = True
        self.hang_up(code if may_travel(code) else GOING_AWAY, reason)


class _WaitingEnd(_RelayEnd):
    """End that waits for a connection of its robot; `assignment` is the first message to the robot."""

    def __init__(
        self, hub: Hub, robot: DialedRobot, sink: Sink | PageInbox, address: str, first: bytes
    ) -> None:
        super().__init__(hub, robot, sink, address)
        self.assignment = first
        self.since: float | None = None

    def closed(self, code: int, reason: str) -> None:
        super().closed(code, reason)
        self.robot.remove_waiting(self)


class _ClientEnd(_WaitingEnd):
    """Connection of a client."""

    def set_flow_control(self, flow_control: FlowControl) -> None:
        flow_control.pause()
        super().set_flow_control(flow_control)

    def end(self, code: int, reason: str) -> None:
        if may_travel(code):
            self.hang_up(code, reason)
        else:
            self.hang_up(SERVICE_RESTART, f"the robot {self.robot.name} is gone: {reason}")


class _PageEnd(_WaitingEnd):
    """HTTP request for a page, in the place of a client."""

    def __init__(self, hub: Hub, robot: DialedRobot, address: str, first: bytes) -> None:
        self.inbox = PageInbox()
        super().__init__(hub, robot, self.inbox, address, first)
        self.flow_control = self.inbox

    def end(self, code: int, reason: str) -> None:
        self.inbox.close(code, reason)

    def hang_up(self, code: int, reason: str) -> None:
        self.inbox.drop()
        super().hang_up(code, reason)


# -- opening a hub ----------------------------------------------------------------------------------------


@asynccontextmanager
async def open_hub(
    url: str,
    *,
    tokens: Collection[str] = (),
    limits: Limits | None = None,
    tls: SSLContext | None = None,
    hosts: Iterable[str] = (),
    grace: float = GRACE_SECONDS,
    proxies: Proxies = NO_PROXIES,
    access_log: bool = False,
    waiting_bytes: int = ADDRESS_BYTES,
    page_seconds: float = PAGE_SECONDS,
) -> AsyncIterator[Hub]:
    """Relay between robots and clients at `url` within the block; leaving it closes all with 1001.

    Args:
        url: ``ws://HOST:PORT`` or ``wss://HOST:PORT``; port 0 picks a free one.
        tokens: bearer tokens, see :class:`Hub`.
        limits: limits of the listener and of each connection.
        tls: certificate and key for ``wss``.
        hosts: accepted host names, see :class:`~rwt_transports.http.routes.Hosts`.
        grace: seconds for which a robot without a connection stays listed, and its clients wait.
        proxies: proxies that are trusted to name their clients' addresses.
        access_log: True to log each HTTP request to ``rwt_transports.access``.
        waiting_bytes: limit per client address, see :class:`Hub`.
        page_seconds: timeout of the head of a robot's page.

    Raises:
        BadUrl: the URL is not one to listen on.
        ListenError: the address is not available.
    """
    addresses = AddressCount((limits or Limits()).connections_per_address)
    hub = Hub(tokens, grace, addresses, waiting_bytes, page_seconds, Scheduler.of_loop(MESSAGES))
    async with (
        listen(
            url,
            hub.accept,
            routes=hub_routes(hub),
            hosts=hosts,
            proxies=proxies,
            access_log=access_log,
            addresses=addresses,
            limits=limits,
            tls=tls,
        ) as listener,
        background_tasks() as tasks,
    ):
        tasks.start_soon(hub.watch)
        hub.url = listener.url
        yield hub


# -- pages of the hub --------------------------------------------------------------------------------------

_PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>Robots</title>
<style>body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 44rem; margin: 3rem auto; padding: 0 1rem }}
code {{ background: #8882; padding: .1em .3em; border-radius: 3px }}
td, th {{ padding: .1em 1em .1em 0; text-align: left }}</style>
<h1>Robots that have dialled in</h1>
<table><tr><th>robot<th>connect a rosbridge client to<th>clients{rows}</table>
"""


def hub_routes(hub: Hub) -> Routes:
    """Return the routes of a hub.

    ``GET /`` is a page, ``/robots`` the same as JSON; also ``/healthz``, ``/metrics``, and pages of robots
    below ``/NAME/``.
    """
    routes = Routes()
    routes.get("/", lambda request: _index(hub, request))
    routes.get("/robots", lambda request: _robots(hub))
    routes.get("/healthz", lambda request: _health(hub))
    routes.get("/metrics", lambda request: _metrics(hub))
    for method in ("GET", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"):
        routes.add("/*", hub.page, method)
    return routes


def _metrics(hub: Hub) -> HttpResponse:
    page, robots = PrometheusText(), hub.robots
    page.single("rwt_hub_robots", "gauge", "Robots that have dialled in.", len(robots))
    for name, attribute, help in (
        ("rwt_hub_idle_connections", "idle", "Connections of a robot that wait."),
        ("rwt_hub_used_connections", "pairs", "Those that serve a client or a page."),
        ("rwt_hub_waiting", "waiting", "Clients and pages that wait for one."),
    ):
        counts = [({"robot": robot.name}, len(getattr(robot, attribute))) for robot in robots]
        page.family(name, "gauge", help, counts)
    text = "Bytes that one side has sent and the other has not taken."
    page.single("rwt_hub_waiting_bytes", "gauge", text, hub.waiting.total)
    page.single("rwt_hub_clients_total", "counter", "Clients that came.", hub.clients)
    page.single("rwt_hub_pages_total", "counter", "Requests for pages of robots.", hub.pages)
    page.single("rwt_hub_passed_bytes_total", "counter", "Bytes passed on, both ways.", hub.bytes)
    return HttpResponse(page.text(), content_type=CONTENT_TYPE)


def _index(hub: Hub, request: HttpRequest) -> HttpResponse:
    host = html.escape(request.headers.get("host", "HOST"))
    rows = "".join(
        f"<tr><td>{robot.name}<td><code>ws://{host}/{robot.name}</code><td>{len(robot.pairs)}"
        for robot in hub.robots
    )
    page = _PAGE.format(rows=rows or "<tr><td>none")
    return HttpResponse(page.encode(), content_type="text/html; charset=utf-8", headers=page_policy())


def _robots(hub: Hub) -> HttpResponse:
    listed = [
        {"name": robot.name, "path": f"/{robot.name}", "clients": len(robot.pairs)} for robot in hub.robots
    ]
    return HttpResponse(json.dumps({"robots": listed}).encode(), content_type="application/json")


def _health(hub: Hub) -> HttpResponse:
    body = {
        "status": "ok",
        "robots": len(hub.robots),
        "clients": sum(len(robot.pairs) for robot in hub.robots),
    }
    return HttpResponse(json.dumps(body).encode(), content_type="application/json")
