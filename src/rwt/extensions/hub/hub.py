"""Hub for dial-out: robots behind a NAT dial in, and clients reach each under its own path.

A robot has one connection (:mod:`rwt.extensions.hub.uplink`), on which each client and each request for a
page is a stream. Messages, refusals and close codes pass end to end. Samples for several clients arrive once
(:mod:`rwt.extensions.hub.feeds`), and the queue rules of each client decide what it loses.
"""

from __future__ import annotations

import hmac
import logging
import secrets
import time
from collections.abc import AsyncIterator, Awaitable, Collection, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from functools import partial
from ssl import SSLContext
from typing import Final, Protocol

import anyio

from rwt.extensions.hub.ends import (
    ADDRESS_BYTES,
    CLIENTS,
    Admission,
    ClientEnd,
    RobotEnd,
    WaitingBytes,
    join,
)
from rwt.extensions.hub.feeds import RobotFeeds
from rwt.extensions.hub.listing import hub_routes
from rwt.extensions.hub.uplink.carrier import Carrier
from rwt.extensions.hub.uplink.dial import SOFTWARE
from rwt.extensions.hub.uplink.frames import SUBPROTOCOL, BadFrame, Hello
from rwt.extensions.hub.uplink.openings import (
    INSTANCE,
    NAME_RULE,
    REPLACED,
    ROBOTS,
    UNUSED,
    encode_client,
    encode_request,
    is_robot_name,
    split_client_path,
)
from rwt.extensions.hub.uplink.pages import PageInbox
from rwt.extensions.hub.uplink.streams import Stream
from rwt.extensions.hub.uplink.uplink import Uplink
from rwt_graph.clock import Clock, SteadyClock
from rwt_protocol.frames import Frame
from rwt_transports.background import background_tasks
from rwt_transports.endpoint import Accept, Endpoint, PeerInfo, Sink
from rwt_transports.errors import Refused
from rwt_transports.http.addresses import AddressCount, holder_of
from rwt_transports.http.proxies import NO_PROXIES, Proxies
from rwt_transports.http.routes import HttpRequest, HttpResponse
from rwt_transports.limits import Limits
from rwt_transports.listener import listen
from rwt_transports.scheduler import MESSAGES, WRITING, Scheduler
from rwt_transports.shared_pool import PoolFull, PoolRow, Share, SharedPool
from rwt_transports.websocket.close_codes import (
    ABNORMAL,
    GOING_AWAY,
    POLICY,
    PROTOCOL_ERROR,
    TRY_AGAIN_LATER,
)

logger = logging.getLogger("rwt.extensions.hub.hub")

TICK_SECONDS: Final = 0.25
PAGE_SECONDS: Final = 120.0
"""Default timeout of a robot's answer to a request for a page. Calls of services wait for at most 60 s."""
MAX_ROBOTS: Final = 10_000
"""Default limit of robots."""
UNUSED_SECONDS: Final = 60.0
"""Time without clients after which another node stops serving its robot here."""
MAX_PENDING: Final = 256
"""Connections of robots that have not said who they are."""
ROBOT_PLACES: Final = PoolRow("robots of a hub", "--robots", "robots")
GREETINGS: Final = PoolRow("robots that dial in", "", "robots that are dialling in")
_SUBPROTOCOLS: Final = (SUBPROTOCOL, "foxglove.sdk.v1", "foxglove.websocket.v1")


class Nodes(Protocol):
    """Other nodes of a hub, at which robots have dialled in."""

    def came(self, robot: str) -> None:
        """Note a robot that has dialled in here."""

    def left(self, robot: str) -> None:
        """Note a robot that has left."""

    def has(self, robot: str) -> bool:
        """Return True if a robot is at another node."""

    @property
    def count(self) -> int:
        """Number of other nodes whose robots are known."""

    @property
    def robots(self) -> Iterable[str]:
        """Names of the robots at other nodes."""

    async def bring(self, robot: str, address: str) -> None:
        """Let the node of a robot dial in here for it; returns after that, or after a while without.

        Args:
            address: address of the client who wants that, to which it is charged.

        Raises:
            PoolFull: too many robots of other nodes are served here.
        """

    def unlinked(self, robot: str) -> None:
        """Note that a robot of another node is no longer served here."""


@dataclass(slots=True, eq=False)
class DialedRobot:
    """Robot that has dialled in, here or at another node, which has then dialled in for it.

    Attributes:
        instance: random id of the program; distinguishes it from another of the same name.
        address: address of its connection.
        uplink: its streams.
        feeds: samples of its topics for several clients.
        carrier: its connection; None for a moment after a loss.
        software: name and version of its program.
        is_linked: True if it is at another node.
        used: monotonic time at which it had clients or pages.
    """

    name: str
    instance: str
    address: str
    uplink: Uplink
    feeds: RobotFeeds
    carrier: RobotCarrier | None = None
    software: str = ""
    is_linked: bool = False
    used: float = 0.0

    @property
    def is_reachable(self) -> bool:
        """True if messages reach it."""
        return self.uplink.is_carried

    @property
    def clients(self) -> int:
        """Number of its clients and pages."""
        return len(self.uplink.streams)

    def wake(self) -> None:
        """Send what can be sent."""
        if self.carrier is not None:
            self.carrier.wake()


class Hub:
    """Robots that have dialled in, and their clients.

    Args:
        tokens: bearer tokens; a robot must present one. ``NAME=TOKEN`` is for one robot. Empty: every robot
            is accepted.
        limits: limits of each stream, and of the listener; ``connections`` counts clients and plain HTTP.
        addresses: counter of connections per address; a robot's own connection is not counted.
        waiting_bytes: limit per client address, see :class:`WaitingBytes`.
        page_seconds: timeout of the head of a robot's page.
        scheduler: scheduler of the messages that are passed on, shared by all connections.
        writing: scheduler of the frames that are sent.
        max_robots: maximum number of robots.
        clock: clock of the throttles of clients; the caller drives it. By default, time that never jumps.

    Attributes:
        nodes: other nodes; None for a hub of one.
        url: URL at which it listens, with the actual port; empty until it is open.
        places: pool of the connections of clients.
        clients: clients so far.
        pages: requests for pages of robots so far.
        bytes: bytes of messages and pages so far, in both directions.
    """

    def __init__(
        self,
        tokens: Collection[str] = (),
        limits: Limits | None = None,
        addresses: AddressCount | None = None,
        *,
        waiting_bytes: int = ADDRESS_BYTES,
        page_seconds: float = PAGE_SECONDS,
        scheduler: Scheduler | None = None,
        writing: Scheduler | None = None,
        max_robots: int = MAX_ROBOTS,
        clock: Clock | None = None,
    ) -> None:
        self.clock = clock or SteadyClock()
        self.nodes: Nodes | None = None
        self._expected: dict[str, tuple[bytes, anyio.Event]] = {}
        self.url = ""
        self.scheduler = scheduler or Scheduler.immediate(MESSAGES)
        self.writing = writing or Scheduler.immediate(WRITING)
        self._limits = limits or Limits()
        self._buffers = self._limits.receive_pool()
        self._page_seconds = page_seconds
        self.waiting = WaitingBytes(waiting_bytes)
        self.places = SharedPool(CLIENTS, self._limits.connections)
        self.addresses = addresses or AddressCount()
        self._robots: dict[str, DialedRobot] = {}
        self._robot_places = SharedPool(ROBOT_PLACES, max_robots)
        self._places: dict[str, Share] = {}
        self._greetings = SharedPool(GREETINGS, MAX_PENDING)
        self._pending: dict[RobotCarrier, Share] = {}
        self.clients = self.pages = self.bytes = 0
        self.take_tokens(tokens)

    def take_tokens(self, tokens: Collection[str]) -> None:
        """Replace the tokens, and disconnect robots that lose theirs.

        A robot with a ``NAME=TOKEN`` needs it.
        """
        bound = [token.partition("=") for token in tokens]
        self._tokens = tuple(
            (name if equals else "", (token if equals else name).encode()) for name, equals, token in bound
        )
        self._names = {name for name, _ in self._tokens if name}
        connected = [each.carrier for each in self._robots.values() if each.carrier is not None]
        for carrier in (*connected, *self._pending):
            is_known = carrier.is_linked or self._knows(carrier.authorization, carrier.name)
            if self._tokens and not is_known:
                reason = "the token of this robot was removed"
                if carrier.robot is not None:
                    self._forget(carrier.robot, POLICY, reason)
                carrier.give_up(POLICY, reason)

    @property
    def robots(self) -> tuple[DialedRobot, ...]:
        """Robots that have a connection or had one a moment ago, by name."""
        return tuple(self._robots[name] for name in sorted(self._robots))

    async def admit(self, info: PeerInfo) -> Accept:
        """Decide about a robot, or let the robot decide about a client.

        Raises:
            Refused: there is no such robot (404), it is unreachable or does not answer (503), or it refuses
                the client; or a robot without the token (401), from a browser (403), with an invalid name
                (400), with a program that does not speak the uplink (426), or beyond the number of robots
                (503).
        """
        path = info.path.partition("?")[0]
        if path.startswith(ROBOTS):
            name = path.removeprefix(ROBOTS)
            self._check_robot(info, name)
            return lambda sink, _: self._accept_robot(sink, info, name)
        name, path = split_client_path(info.path)
        if info.subprotocol == SUBPROTOCOL:
            raise Refused(400, f"a robot dials in at {ROBOTS}NAME")
        await self._bring(name, info.address)
        robot = self.robot(name)
        stream = robot.uplink.open(encode_client(info, path), info.address)
        try:
            await Admission(stream, robot.name).granted()
        except BaseException:
            stream.close(GOING_AWAY, "the client was not admitted")
            stream.resume()
            raise
        return lambda sink, _: self._accept_client(sink, info, robot, stream)

    def identify(self, info: PeerInfo) -> str:
        """Return the name of a robot, which holds one place of the listener; empty for clients."""
        path = info.path.partition("?")[0]
        return path if path.startswith(ROBOTS) else ""

    def refuse(self, sink: Sink, info: PeerInfo) -> Endpoint:
        """Refuse a connection that is no WebSocket."""
        raise Refused(400, "a hub is reached by WebSocket or HTTP")

    def tick(self, now: float) -> None:
        """Check the timeouts of robots; `now` is monotonic, in seconds."""
        for carrier in tuple(self._pending):
            carrier.check(now)
        for robot in tuple(self._robots.values()):
            robot.feeds.report()
            if robot.clients:
                robot.used = now
            elif robot.is_linked and now - robot.used >= UNUSED_SECONDS:
                self.unlink(robot.name, "the robot has no clients at this node")
                continue
            if robot.carrier is not None:
                robot.carrier.check(now)
            elif not robot.uplink.tick(now):
                self._forget(robot, ABNORMAL, "its connection was lost")

    async def watch(self) -> None:
        """Call :meth:`tick` several times a second, until cancelled."""
        while True:
            self.tick(time.monotonic())
            await anyio.sleep(TICK_SECONDS)

    # -- robots --------------------------------------------------------------------------------------------

    def _accept_robot(self, sink: Sink, info: PeerInfo, name: str) -> Endpoint:
        if info.subprotocol != SUBPROTOCOL:
            raise Refused(
                426,
                f"this hub speaks the WebSocket subprotocol {SUBPROTOCOL}; update the robot's program",
            )
        holder, is_linked = holder_of(info.address), self._is_expected(info, name)
        if name not in self._robots and not is_linked:
            self._robot_places.check(holder)
        self._greetings.check(holder)
        self.addresses.leave(info.address)
        return RobotCarrier(self, sink, info, name, is_linked=is_linked)

    def _check_robot(self, info: PeerInfo, name: str) -> None:
        if "origin" in info.headers:
            raise Refused(403, "robots dial in here, not web pages; a page connects to /NAME")
        if self._is_expected(info, name):
            return
        if self._tokens and not self._knows(info.headers.get("authorization", ""), name):
            logger.warning("refusing a robot named %.80r: invalid token (%s)", name, info.address)
            raise Refused(
                401,
                "this hub wants `Authorization: Bearer TOKEN` with its own token",
                {"WWW-Authenticate": 'Bearer realm="rwt hub"'},
            )
        if not is_robot_name(name):
            raise Refused(400, f"a robot cannot be called {name[:80]!r}; a name is {NAME_RULE}")

    def expect(self, robot: str, token: str) -> anyio.Event:
        """Accept a node that dials in for a robot with this token. Returns what is set when it has."""
        arrived = anyio.Event()
        self._expected[robot] = token.encode(), arrived
        return arrived

    def unexpect(self, robot: str) -> None:
        """Accept no node any more that dials in for a robot."""
        self._expected.pop(robot, None)

    def unlink(self, robot: str, reason: str) -> None:
        """End the connection of another node for a robot."""
        found = self._robots.get(robot)
        if found is not None and found.is_linked:
            link = found.carrier
            self._forget(found, GOING_AWAY, reason)
            if link is not None:
                link.give_up(UNUSED, reason)

    def _is_expected(self, info: PeerInfo, name: str) -> bool:
        """Return True for a node that dials in for a robot which is not here itself."""
        expected, robot = self._expected.get(name), self._robots.get(name)
        shown = _shown(info.headers.get("authorization", ""))
        if expected is None or not hmac.compare_digest(shown, expected[0]):
            return False
        if robot is not None and not robot.is_linked:
            raise Refused(409, f"the robot {name} has dialled in here")
        return True

    def _knows(self, authorization: str, name: str) -> bool:
        shown = _shown(authorization)
        # Compare all tokens: constant time.
        wanted = name if name in self._names else ""
        right = [hmac.compare_digest(shown, known) and its == wanted for its, known in self._tokens]
        return any(right)

    def pending(self, carrier: RobotCarrier) -> None:
        """Note a connection whose greeting is awaited; raises PoolFull."""
        end = partial(carrier.give_up, TRY_AGAIN_LATER)
        self._pending[carrier] = self._greetings.take(holder_of(carrier.address), end)

    def not_pending(self, carrier: RobotCarrier) -> None:
        """Note a connection that has greeted, or ended; idempotent."""
        share = self._pending.pop(carrier, None)
        if share is not None:
            self._greetings.release(share)

    def greeted(self, carrier: RobotCarrier, hello: Hello) -> None:
        """Resume the session of a robot, or begin one; raises BadFrame."""
        robot = self._robots.get(carrier.name)
        if carrier.is_linked and carrier.name not in self._expected:
            raise BadFrame("the robot is no longer wanted here")
        if robot is not None and robot.instance != carrier.instance:
            self._replace(robot, carrier)
            robot = None
        if robot is not None and robot.carrier is not None:
            # The robot has noticed the loss of that connection first.
            robot.carrier.give_up(TRY_AGAIN_LATER, "the robot has opened another connection")
        if robot is not None and (not hello.session or hello.session != robot.uplink.session):
            self._forget(robot, ABNORMAL, "the robot has started again")
            robot = None
        received, silent_since = hello.received, None if robot is None else robot.uplink.heard_at
        if robot is None:
            robot, received = self._begin(carrier), 0
        robot.software = hello.software
        robot.carrier = carrier
        carrier.robot = robot
        carrier.greet(Hello(robot.uplink.session, robot.uplink.received, SOFTWARE))
        if not carrier.carry(robot.uplink, received):
            self._forget(robot, ABNORMAL, f"the session of {robot.name} cannot be resumed")
            raise BadFrame("the session cannot be resumed")
        if silent_since is not None:
            silence = time.monotonic() - silent_since
            logger.info("robot %s is back from %s, after %.1f s", robot.name, carrier.address or "?", silence)

    def _place(self, carrier: RobotCarrier) -> Share:
        try:
            return self._robot_places.take(holder_of(carrier.address), partial(self._displace, carrier.name))
        except PoolFull as full:
            carrier.give_up(TRY_AGAIN_LATER, full.reason)
            raise BadFrame(full.reason) from None

    def _begin(self, carrier: RobotCarrier) -> DialedRobot:
        place = None
        if not carrier.is_linked:
            place = self._place(carrier)
        uplink = Uplink(
            secrets.token_hex(8),
            self._limits,
            self._buffers,
            lambda: robot.wake(),
            repeats=False,
            closed=lambda stream: feeds.ended(stream),
            fed=lambda frame: feeds.receive(frame),
            now=time.monotonic(),
        )
        feeds = RobotFeeds(uplink, holder_of(carrier.address), self.clock, self.scheduler)
        robot = DialedRobot(
            carrier.name, carrier.instance, carrier.address, uplink, feeds,
            is_linked=carrier.is_linked, used=time.monotonic(),
        )  # fmt: skip
        self._robots[carrier.name] = robot
        if place is not None:
            self._places[carrier.name] = place
        if robot.is_linked:
            logger.info("the node at %s serves robot %s here", robot.address or "?", robot.name)
            self._expected[robot.name][1].set()
        else:
            logger.info("robot %s dialled in from %s", robot.name, robot.address or "?")
            if self.nodes is not None:
                self.nodes.came(robot.name)
        return robot

    def _displace(self, name: str, reason: str) -> None:
        """End a robot whose place another address gets."""
        robot = self._robots[name]
        carrier = robot.carrier
        logger.warning("closing the robot %s: %s", name, reason)
        self._forget(robot, ABNORMAL, reason)
        if carrier is not None:
            carrier.give_up(TRY_AGAIN_LATER, reason)

    def _replace(self, robot: DialedRobot, newer: RobotCarrier) -> None:
        """Replace a robot by a newer program of the same name: after a crash, old connections may linger."""
        reason = f"another program dialled in as {robot.name}, from {newer.address or '?'}"
        logger.warning("%s; closing the one from %s", reason, robot.address or "?")
        carrier = robot.carrier
        self._forget(robot, ABNORMAL, reason)
        if carrier is not None:
            carrier.give_up(REPLACED, reason)

    def left(self, carrier: RobotCarrier, code: int, reason: str) -> None:
        """Called when a connection of a robot has ended; with 1001, the robot leaves."""
        self.addresses.enter(carrier.address)
        robot = carrier.robot
        if robot is None or robot.carrier is not carrier:
            return
        robot.carrier = None
        if code == GOING_AWAY:
            self._forget(robot, code, reason)
        else:
            logger.info("the connection of robot %s was lost: %s", robot.name, f"{code} {reason}".rstrip())

    def _forget(self, robot: DialedRobot, code: int, reason: str) -> None:
        if self._robots.get(robot.name) is robot:
            del self._robots[robot.name]
            place = self._places.pop(robot.name, None)
            if place is not None:
                self._robot_places.release(place)
            logger.info("robot %s is gone", robot.name)
            if robot.is_linked:
                self.unexpect(robot.name)
                if self.nodes is not None:
                    self.nodes.unlinked(robot.name)
            elif self.nodes is not None:
                self.nodes.left(robot.name)
        robot.carrier = None
        robot.uplink.end(code, reason)

    # -- clients -------------------------------------------------------------------------------------------

    def has(self, name: str) -> bool:
        """Return True if a robot has dialled in here or at another node."""
        return name in self._robots or (self.nodes is not None and self.nodes.has(name))

    async def _bring(self, name: str, address: str) -> None:
        """Let another node serve a robot here, if it is there."""
        if name not in self._robots and self.nodes is not None and self.nodes.has(name):
            await self.nodes.bring(name, address)

    def here(self, name: str) -> DialedRobot | None:
        """Return a robot that has dialled in here itself."""
        robot = self._robots.get(name)
        return None if robot is None or robot.is_linked else robot

    def robot(self, name: str) -> DialedRobot:
        """Return a robot that can be reached; raises Refused."""
        robot = self._robots.get(name)
        if robot is None and self.has(name):
            text = f"the robot {name} is at another node, which cannot be reached at the moment"
            raise Refused(503, text, {"Retry-After": "1"})
        if robot is None:
            raise Refused(404, f"no robot called {name[:80]!r} is here; GET / lists those that are")
        if not robot.is_reachable:
            raise Refused(503, f"the robot {name} is unreachable at the moment", {"Retry-After": "1"})
        return robot

    def _accept_client(self, sink: Sink, info: PeerInfo, robot: DialedRobot, stream: Stream) -> Endpoint:
        try:
            client = ClientEnd(self, robot, sink, info.address)
        except Refused as refused:
            stream.close(POLICY, refused.reason)
            stream.resume()
            raise
        robot.feeds.admit(stream.number, sink)
        join(client, RobotEnd(self, robot, stream, info.address))
        self.clients += 1
        return client

    def page(self, request: HttpRequest) -> HttpResponse | Awaitable[HttpResponse]:
        """Forward an HTTP request to a robot over its uplink."""
        name, _ = split_client_path(request.path)
        if name not in self._robots and self.has(name):
            return self._page_from_afar(request, name)
        return self._page(request)

    async def _page_from_afar(self, request: HttpRequest, name: str) -> HttpResponse:
        try:
            await self._bring(name, request.address)
        except Refused as refused:
            return HttpResponse.refusing(refused)
        response = self._page(request)
        return response if isinstance(response, HttpResponse) else await response

    def _page(self, request: HttpRequest) -> HttpResponse | Awaitable[HttpResponse]:
        name, path = split_client_path(request.path)
        prefix = f"{request.prefix}/{name}"
        try:
            robot = self.robot(name)
        except Refused as refused:
            return HttpResponse.refusing(refused)
        if request.path == f"/{name}":
            # Without the slash, relative links would lead to other robots.
            query = f"?{request.query}" if request.query else ""
            return HttpResponse(status=308, headers={"Location": f"{prefix}/{query}"})
        self.pages += 1
        stream = robot.uplink.open(encode_request(request, path, prefix), request.address)
        inbox = PageInbox()
        stream.begin(inbox)
        if request.body:
            stream.send(Frame(request.body, binary=True))
        return self._linked(stream, inbox, request)

    async def _linked(self, stream: Stream, inbox: PageInbox, request: HttpRequest) -> HttpResponse:
        """Return the robot's response with a link to the list of robots (RFC 6573), first in its header."""

        def left(code: int, reason: str) -> None:
            inbox.drop(code, reason)
            stream.close(code, reason)
            stream.resume()

        response = await inbox.response(left, self._page_seconds, head_only=request.method == "HEAD")
        links = [f'<{request.prefix}/robots>; rel="collection"', response.headers.get("Link")]
        return replace(response, headers={**response.headers, "Link": ", ".join(filter(None, links))})


class RobotCarrier(Carrier):
    """Connection of a robot to the hub.

    Attributes:
        name: name of the robot.
        instance: random id of its program.
        address: address of the connection.
        authorization: ``Authorization`` header, with its token.
        is_linked: True for a connection of another node.
        robot: the robot; None before the greeting.
    """

    def __init__(self, hub: Hub, sink: Sink, info: PeerInfo, name: str, *, is_linked: bool) -> None:
        super().__init__(sink, hub.writing)
        self.is_linked = is_linked
        self._hub = hub
        self.name = name
        self.instance = info.headers.get(INSTANCE, "")[:64]
        self.address = info.address
        self.authorization = info.headers.get("authorization", "")
        self.robot: DialedRobot | None = None
        hub.pending(self)

    def greeted(self, hello: Hello) -> None:
        self._hub.not_pending(self)
        self._hub.greeted(self, hello)

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        """Give up a robot that sends more than a frame."""
        self.give_up(PROTOCOL_ERROR, f"a message of {size} bytes")

    def gone(self, code: int, reason: str) -> None:
        self._hub.not_pending(self)
        self._hub.left(self, code, reason)


def _shown(authorization: str) -> bytes:
    scheme, _, token = authorization.partition(" ")
    return token.strip().encode() if scheme.lower() == "bearer" else b""


@asynccontextmanager
async def open_hub(
    url: str,
    *,
    tokens: Collection[str] = (),
    limits: Limits | None = None,
    tls: SSLContext | None = None,
    hosts: Iterable[str] = (),
    proxies: Proxies = NO_PROXIES,
    access_log: bool = False,
    waiting_bytes: int = ADDRESS_BYTES,
    page_seconds: float = PAGE_SECONDS,
    max_robots: int = MAX_ROBOTS,
    clock: Clock | None = None,
) -> AsyncIterator[Hub]:
    """Connect robots and clients at `url` within the block; leaving it closes all with 1001.

    Args:
        url: ``ws://HOST:PORT`` or ``wss://HOST:PORT``; port 0 picks a free one.
        tokens: bearer tokens, see :class:`Hub`.
        limits: limits of the listener and of each connection; ``connections`` does not count robots.
        tls: certificate and key for ``wss``.
        hosts: accepted host names, see :class:`~rwt_transports.http.routes.Hosts`.
        proxies: proxies that are trusted to name their clients' addresses.
        access_log: True to log each HTTP request to ``rwt_transports.access``.
        waiting_bytes: limit per client address, see :class:`Hub`.
        page_seconds: timeout of the head of a robot's page.
        max_robots: maximum number of robots.
        clock: clock of the throttles of clients; by default, time that never jumps.

    Raises:
        BadUrl: the URL is not one to listen on.
        ListenError: the address is not available.
    """
    chosen = limits or Limits()
    addresses = AddressCount(chosen.connections_per_address, proxies)
    hub = Hub(
        tokens,
        chosen,
        addresses,
        waiting_bytes=waiting_bytes,
        page_seconds=page_seconds,
        scheduler=Scheduler.of_loop(MESSAGES),
        writing=Scheduler.of_loop(WRITING),
        max_robots=max_robots,
        clock=clock,
    )
    async with (
        listen(
            url,
            hub.refuse,
            routes=hub_routes(hub),
            hosts=hosts,
            proxies=proxies,
            access_log=access_log,
            subprotocols=_SUBPROTOCOLS,
            admit=hub.admit,
            identify=hub.identify,
            addresses=addresses,
            limits=replace(chosen, connections=chosen.connections + max_robots),
            tls=tls,
        ) as listener,
        background_tasks() as tasks,
    ):
        tasks.start_soon(hub.clock.drive)
        tasks.start_soon(hub.watch)
        hub.url = listener.url
        yield hub
