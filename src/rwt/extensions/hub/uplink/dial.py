"""Dial-out: a robot behind a NAT opens one connection to a hub, and serves the hub's clients over it."""

from __future__ import annotations

import logging
import secrets
import time
from collections.abc import AsyncIterator, Callable, Collection, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import version
from ipaddress import ip_address
from ssl import SSLContext
from typing import Final

import anyio

from rwt.extensions.hub.uplink.carrier import Carrier
from rwt.extensions.hub.uplink.feeds import Feeds
from rwt.extensions.hub.uplink.frames import SUBPROTOCOL, BadFrame, Hello, Refusal
from rwt.extensions.hub.uplink.openings import (
    INSTANCE,
    NAME_RULE,
    REPLACED,
    ROBOTS,
    UNUSED,
    BadOpening,
    PageRequest,
    decode_opening,
    is_robot_name,
)
from rwt.extensions.hub.uplink.pages import PageServer
from rwt.extensions.hub.uplink.streams import Stream
from rwt.extensions.hub.uplink.uplink import Uplink
from rwt_transports.background import TaskStarter, background_tasks
from rwt_transports.backoff import Backoff
from rwt_transports.connect import OutgoingConnection, connect
from rwt_transports.connection import CONNECTIONS
from rwt_transports.endpoint import Accept, Endpoint, Identify, PeerInfo, Sink, anonymous
from rwt_transports.errors import BadUrl, Refused, TransportError, log_exception
from rwt_transports.http.addresses import AddressCount, holder_of
from rwt_transports.http.proxies import behind_proxy
from rwt_transports.http.routes import Routes, is_local
from rwt_transports.limits import Limits
from rwt_transports.scheduler import WRITING, Scheduler
from rwt_transports.schemes import parse_connect_url
from rwt_transports.shared_pool import Holder, Share, SharedPool
from rwt_transports.websocket.close_codes import (
    ABNORMAL,
    GOING_AWAY,
    PROTOCOL_ERROR,
    TRY_AGAIN_LATER,
)
from rwt_transports.wires.receive_buffer import ReceiveBufferPool

logger = logging.getLogger("rwt.extensions.hub.uplink.dial")

BACKOFF: Final = Backoff(first=0.5, longest=2.0, jitter=1.0)
"""The first attempt follows a loss within half a second, the others within two, spread evenly: the robots of
a fleet do not come at once."""

REPLACED_BACKOFF: Final = Backoff(first=15.0, longest=30.0, jitter=0.5)
"""Delays after another program has taken the robot's name: sooner would displace that one."""

STEADY_SECONDS: Final = 5.0
"""Minimum duration of a connection to the hub; a shorter one counts as a failure. In seconds."""

TICK_SECONDS: Final = 0.25

REPORT_SECONDS: Final = 600.0
"""Time between two lines of the log about an uplink with clients."""

LOGGED_TOPICS: Final = 10
"""Maximum number of topics in that line: those with most clients."""

SOFTWARE: Final = f"rwt {version('robot-web-tools')}"


@dataclass(slots=True)
class UplinkStatus:
    """Status of the uplink to one hub.

    Attributes:
        url: URL of the hub, with the robot's path; of several nodes, the one in use.
        connected: True while it is open.
        hub: name and version of the hub's program; empty before the first connection.
        clients: number of clients and pages that it serves.
        round_trip: seconds of the last round trip; 0.0 before the first.
        rate: bytes per second that arrived at the hub lately.
        failures: attempts that failed since the last success.
        error: reason of the last failure; empty after a success.
        over: set once there are no further attempts.
        feeds: topics that cross the uplink for several clients; None before the first connection.
    """

    url: str
    connected: bool = False
    hub: str = ""
    clients: int = 0
    round_trip: float = 0.0
    rate: float = 0.0
    failures: int = 0
    error: str = ""
    over: anyio.Event = field(default_factory=anyio.Event)
    feeds: Feeds | None = None

    def __str__(self) -> str:
        """Return a line for the log."""
        feeds = self.feeds
        topics = feeds.demand().most_common(LOGGED_TOPICS) if feeds is not None else []
        drops = feeds.drops.items() if feeds is not None else ()
        parts = [
            f"{self.clients} clients and pages",
            f"round trip {self.round_trip * 1e3:.0f} ms",
            f"{self.rate / 1e3:.0f} kB/s",
            "clients by topic: " + (", ".join(f"{name} {count}" for name, count in topics) or "none"),
            "drops: " + (", ".join(f"{reason.value} {count}" for reason, count in drops) or "none"),
        ]
        return f"{self.url} ({self.hub or 'not connected yet'}): {'; '.join(parts)}"


Serve = Callable[[Stream, PeerInfo | PageRequest], None]
"""Admits a client or a page and begins its stream, now or later, or raises
:exc:`~rwt_transports.errors.Refused`."""


@asynccontextmanager
async def dial(
    url: str,
    accept: Accept,
    *,
    token: str | None = None,
    limits: Limits | None = None,
    addresses: AddressCount | None = None,
    identify: Identify = anonymous,
    buffers: ReceiveBufferPool | None = None,
    routes: Routes | None = None,
    tls: SSLContext | None = None,
    backoff: Backoff = BACKOFF,
) -> AsyncIterator[UplinkStatus]:
    """Serve the clients of a hub within the block; reconnects if the hub is unavailable.

    Args:
        url: ``wss://HUB/robots/NAME`` or ``ws://HUB/robots/NAME``; NAME is what clients call the robot.
            Several nodes of a hub are separated by commas: one is used at a time, and the next if it fails.
        accept: makes the endpoint of each client; may raise :exc:`~rwt_transports.errors.Refused`, which the
            hub answers. The address of a client is the hub's word, and never one of this machine.
        token: token of the robot for the hub.
        addresses: counts the clients of each address that the hub names; one of its own by default.
        identify: returns the credential of a client or request; by default none are needed.
        buffers: what large messages of all clients are received in; of its own by default.
        routes: pages for requests from the hub.
        tls: how to check the hub's certificate; by default against the system's authorities.
        backoff: delays between attempts, and their number.

    Raises:
        BadUrl: the URL is not a hub's URL of a robot.
    """
    starter = TaskStarter()

    def serve(stream: Stream, info: PeerInfo | PageRequest) -> None:
        endpoint: Endpoint
        if isinstance(info, PeerInfo):
            endpoint = accept(stream, info)
        else:
            page = PageServer(stream, routes or Routes(), info.request, info.body_size)
            starter.start_soon(page.run)
            endpoint = page
        stream.admit()
        stream.begin(endpoint)

    opened = open_uplink(
        url, serve, token=token, limits=limits, addresses=addresses, identify=identify,
        buffers=buffers, tls=tls, backoff=backoff,
    )  # fmt: skip
    async with background_tasks() as tasks:
        tasks.start_soon(starter.run, tasks)
        async with opened as status:
            yield status


@asynccontextmanager
async def open_uplink(
    url: str,
    serve: Serve,
    *,
    token: str | None = None,
    limits: Limits | None = None,
    addresses: AddressCount | None = None,
    identify: Identify = anonymous,
    buffers: ReceiveBufferPool | None = None,
    tls: SSLContext | None = None,
    backoff: Backoff = BACKOFF,
    until_unused: bool = False,
) -> AsyncIterator[UplinkStatus]:
    """Keep an uplink open within the block, and serve its streams.

    Args:
        serve: serves a stream.
        until_unused: True to end when the other side closes the connection with `UNUSED`.

    The other arguments, and errors, are those of :func:`dial`.
    """
    check_dial_url(url)
    headers = {INSTANCE: secrets.token_hex(8), "Sec-WebSocket-Protocol": SUBPROTOCOL}
    if token is not None:
        headers["Authorization"] = f"Bearer {token}"
    urls = url.split(",")
    status = UplinkStatus(urls[0])
    chosen = limits or Limits()
    pool = buffers or chosen.receive_pool()
    connect_one = partial(connect, limits=chosen, buffers=pool, tls=tls, headers=headers)
    counted = addresses or AddressCount(chosen.connections_per_address)
    last = {UNUSED} if until_unused else set[int]()
    robot = _Robot(status, urls, serve, backoff, connect_one, counted, chosen, pool, identify, last)
    async with background_tasks() as tasks:
        tasks.start_soon(robot.run)
        try:
            yield status
        finally:
            with anyio.move_on_after(chosen.close_seconds, shield=True):
                await robot.leave()


def check_dial_url(url: str) -> None:
    """Check a dial-out URL, or several that are separated by commas.

    Raises:
        BadUrl: the URL is invalid; the text gives the fault and an example.
    """
    example = "for example wss://hub.example/robots/my_robot"
    names = set[str]()
    for each in url.split(","):
        try:
            target = parse_connect_url(each)
        except BadUrl as error:
            raise BadUrl(f"cannot dial {each!r}: expected the WebSocket URL of a hub, {example}") from error
        if not target.scheme.http:
            raise BadUrl(f"cannot dial {each!r}: a hub is reached by ws:// or wss://, {example}")
        name = target.path.removeprefix(ROBOTS)
        if not target.path.startswith(ROBOTS) or not is_robot_name(name):
            raise BadUrl(
                f"cannot dial {each!r}: its path must be {ROBOTS}NAME, {example}; a name is {NAME_RULE}"
            )
        names.add(name)
    if len(names) > 1:
        raise BadUrl(
            f"cannot dial {url!r}: its alternatives are nodes of one hub, where the robot has one name"
        )


_ConnectOne = Callable[[str, Accept], AbstractAsyncContextManager[OutgoingConnection]]


class _Robot:
    """Uplink to one hub, over one connection at a time.

    Attributes by purpose:

    * Clients: ``_serve``, ``_addresses``, ``_identify``, ``_pool`` and ``_places`` (shares of
      `limits.connections` by stream).
    * Uplink: ``uplink`` (None without a session), ``_limits``, ``_buffers``, ``_carrier`` (the connection;
      None without one), ``scheduler`` (of writing).
    * Connecting: ``status``, ``_urls`` (alternatives), ``_backoff``, ``_connect_one``, ``_running``
      (cancelled when the robot leaves), ``_is_leaving``, ``_reported`` (time of the last line of the log),
      ``_ended`` (code of the last connection's end), ``_last`` (codes after which there is no further
      attempt).
    """

    def __init__(
        self,
        status: UplinkStatus,
        urls: Sequence[str],
        serve: Serve,
        backoff: Backoff,
        connect_one: _ConnectOne,
        addresses: AddressCount,
        limits: Limits,
        buffers: ReceiveBufferPool,
        identify: Identify,
        last: Collection[int],
    ) -> None:
        self.scheduler = Scheduler.of_loop(WRITING)
        self.status = status
        self._urls = urls
        self.uplink: Uplink | None = None
        self._carrier: _HubCarrier | None = None
        self._serve = serve
        self._last = last
        self._backoff = backoff
        self._connect_one = connect_one
        self._addresses = addresses
        self._limits = limits
        self._buffers = buffers
        self._identify = identify
        self._pool = SharedPool(CONNECTIONS, limits.connections)
        self._places: dict[Stream, Share] = {}
        self._running = anyio.CancelScope()
        self._ended = 0
        self._reported = time.monotonic()
        self._is_leaving = False

    async def run(self) -> None:
        """Keep a connection open, until :meth:`leave`."""
        with self._running:
            async with anyio.create_task_group() as tasks:
                tasks.start_soon(self._watch)
                await self._keep()
                tasks.cancel_scope.cancel()
        self._end_session("the connection to the hub has ended")
        self.status.over.set()

    async def leave(self) -> None:
        """End all streams, and then the connection."""
        carrier, uplink = self._carrier, self.uplink
        self._is_leaving = True
        if carrier is not None:
            carrier.sink.close(GOING_AWAY, "the server is going away")
            await carrier.over.wait()
        self._running.cancel()
        if uplink is not None:
            uplink.end(GOING_AWAY, "the server is going away")

    async def _keep(self) -> None:
        status = self.status
        while self._ended not in self._last:
            if status.failures:
                backoff = REPLACED_BACKOFF if self._ended == REPLACED else self._backoff
                delay = backoff.delay(self._choose_url())
                if delay is None:
                    logger.error("gave up dialling %s: %s", status.url, status.error)
                    return
                await anyio.sleep(delay)
            try:
                await self._connected()
            except TransportError as error:
                self._ended = 0
                self._failed(str(error))

    def _choose_url(self) -> int:
        """Choose the alternative to try after a failure. Returns how often that was tried in vain.

        The first attempt after a loss is at the same node, which may resume the session, unless it is going
        away or has fallen silent: a connection to a machine that is gone would only time out.
        """
        status, urls = self.status, self._urls
        if status.failures > 1 or self._ended in (GOING_AWAY, TRY_AGAIN_LATER):
            status.url = urls[(urls.index(status.url) + 1) % len(urls)]
        return 1 + (status.failures - 1) // len(urls)

    async def _connected(self) -> None:
        """Serve over one connection, until it ends."""
        opened = time.monotonic()
        async with self._connect_one(self.status.url, partial(_HubCarrier, self)) as connection:
            carrier = self._carrier
            assert carrier is not None
            greeting = "" if self.uplink is None else self.uplink.session
            received = 0 if self.uplink is None else self.uplink.received
            carrier.greet(Hello(greeting, received, SOFTWARE))
            await carrier.over.wait()
            self._carrier = None
            self._ended = carrier.code
            if carrier.code == TRY_AGAIN_LATER:
                connection.abort()  # A silent hub does not answer a close either.
        if carrier.code == PROTOCOL_ERROR:
            # A resumed session would repeat the frames that one side has rejected.
            self._end_session("the hub and the robot do not understand each other")
        if self._is_leaving:
            await anyio.sleep_forever()
        if self._ended in self._last:
            return
        lasted = time.monotonic() - opened
        if lasted >= STEADY_SECONDS:
            self.status.failures = 0
        self._failed(f"the hub closed the connection: {carrier.ending}")

    async def _watch(self) -> None:
        while True:
            await anyio.sleep(TICK_SECONDS)
            now = time.monotonic()
            if self._carrier is not None:
                self._carrier.check(now)
            uplink, status = self.uplink, self.status
            if uplink is None:
                continue
            if self._carrier is None and not uplink.tick(now):
                self._end_session("the connection to the hub was lost")
            status.round_trip, status.rate = uplink.round_trip, uplink.rate
            if status.clients and now - self._reported >= REPORT_SECONDS:
                self._reported = now
                logger.info("%s", status)

    def _end_session(self, reason: str) -> None:
        uplink, self.uplink = self.uplink, None
        if uplink is not None:
            uplink.end(ABNORMAL, reason)

    def greeted(self, carrier: _HubCarrier, hello: Hello) -> None:
        """Resume the session that the hub names, or begin it; raises BadFrame."""
        if self.uplink is None or self.uplink.session != hello.session:
            self._end_session("the hub does not know the session any more")
            self.uplink = Uplink(
                hello.session,
                self._limits,
                self._buffers,
                self._wake,
                repeats=True,
                opened=self._opened,
                closed=self._closed,
                now=time.monotonic(),
            )
            self.status.feeds = self.uplink.feeds
        if not carrier.carry(self.uplink, hello.received):
            self._end_session("the hub has not received what was sent")
            raise BadFrame("the session cannot be resumed")
        status = self.status
        if not status.connected:
            logger.info("dialled in at %s (%s)", status.url, hello.software or "unknown software")
        status.connected, status.error, status.hub = True, "", hello.software

    def connecting(self, carrier: _HubCarrier) -> None:
        """Note the connection."""
        self._carrier = carrier

    def _wake(self) -> None:
        if self._carrier is not None:
            self._carrier.wake()

    def _opened(self, stream: Stream, opening: bytes) -> None:
        """Serve a client or a page."""
        self.status.clients += 1
        try:
            info = decode_opening(opening)
        except BadOpening as error:
            raise BadFrame(str(error)) from None
        try:
            info = self._located(info)
            address = info.address if isinstance(info, PeerInfo) else info.request.address
            stream.address = address
            self._addresses.enter(address)
            self._addresses.check(address)
            holder = self._holder_of(info)
            stream.count_for(holder)
            self._places[stream] = self._pool.take(holder, partial(stream.close, TRY_AGAIN_LATER))
            self._serve(stream, info)
        except Refused as refused:
            stream.refuse(Refusal(refused.status, refused.reason, dict(refused.headers)))
        except Exception:
            log_exception("the accept function failed for a client of the hub")
            stream.refuse(Refusal(500, "internal error"))

    def _closed(self, stream: Stream) -> None:
        self.status.clients -= 1
        self._addresses.leave(stream.address)
        place = self._places.pop(stream, None)
        if place is not None:
            self._pool.release(place)

    def _holder_of(self, info: PeerInfo | PageRequest) -> Holder:
        if isinstance(info, PageRequest):
            asked = info.request
            info = PeerInfo("http", asked.address, 0, asked.target, asked.headers)
        return holder_of(info.address, self._identify(info) or "")

    def _located(self, info: PeerInfo | PageRequest) -> PeerInfo | PageRequest:
        """Return a client with an address that has limits: a hub may say what it likes."""
        if isinstance(info, PeerInfo):
            return replace(info, address=self._outside(info.address))
        return info._replace(request=replace(info.request, address=self._outside(info.request.address)))

    @staticmethod
    def _outside(address: str) -> str:
        try:
            is_outside = not is_local(address) and bool(ip_address(address.partition("%")[0]))
        except ValueError:
            is_outside = False
        return address if is_outside else behind_proxy(ascii(address)[1:-1][:64])

    def _failed(self, why: str) -> None:
        status = self.status
        status.connected = False
        status.failures += 1
        level = logging.WARNING if why != status.error else logging.DEBUG
        status.error = why
        logger.log(level, "cannot serve at %s: %s; trying again", status.url, why)


class _HubCarrier(Carrier):
    """Connection of a robot to a hub.

    Attributes:
        code: close code of its end.
        ending: code and reason of its end, for the log.
        over: set at its end.
    """

    def __init__(self, robot: _Robot, sink: Sink, info: PeerInfo) -> None:
        super().__init__(sink, robot.scheduler)
        self._robot = robot
        self.code = 0
        self.ending = ""
        self.over = anyio.Event()
        robot.connecting(self)

    def greeted(self, hello: Hello) -> None:
        self._robot.greeted(self, hello)

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        """Give up a hub that sends more than a frame."""
        self.give_up(PROTOCOL_ERROR, f"a message of {size} bytes")

    def gone(self, code: int, reason: str) -> None:
        self.code = code
        self.ending = f"{code} {reason}".strip()
        self.over.set()
