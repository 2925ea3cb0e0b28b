"""Directory of the robots of several nodes, over Zenoh.

Each node has a random id and declares, below ``rwt/hub/``:

* ``node/ID``: a liveliness token, so that others learn that it has come or gone;
* ``rows/ID``: a queryable that answers with all its robots (:class:`_Rows`);
* ``change/ID``: a publication of the robots that came and left, at most one in `TICK_SECONDS`
  (:class:`_Change`). Changes are numbered; a node that has missed one asks for all rows;
* ``link/ID``: a queryable that asks it to serve one of its robots at another node (:class:`_Wish`).

Every node keeps all rows. A robot that several nodes claim, for example after a partition of the network, is
at the one where it dialled in last.
"""

from __future__ import annotations

import logging
import secrets
import time
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from ssl import SSLContext
from typing import Annotated, Final, TypeVar

import anyio
import anyio.to_thread
import msgspec
import zenoh

from rwt.extensions.hub.ends import LINKS
from rwt.extensions.hub.hub import Hub
from rwt.extensions.hub.nodes.links import Links
from rwt.extensions.hub.uplink.openings import is_robot_name
from rwt.extensions.zenoh.session import ZenohOptions, ZenohSession
from rwt_participant.threads.pool import call_soon_threadsafe
from rwt_transports.background import TaskStarter, background_tasks
from rwt_transports.http.addresses import holder_of
from rwt_transports.limits import Limits
from rwt_transports.shared_pool import Share, SharedPool

logger = logging.getLogger(__name__)

T = TypeVar("T")

TICK_SECONDS: Final = 0.1
"""Minimum time between two publications of a node."""

BRING_SECONDS: Final = 5.0
"""Time in which another node must have dialled in for a robot."""

AGAIN_SECONDS: Final = 1.0
"""Time until a node that has not answered is asked again."""

ASK_SECONDS: Final = 2.0
"""Timeout of a question to a node."""

MAX_LINKS: Final = 1024
"""Default limit of robots of other nodes that a node serves at a time."""

_ROOT: Final = "rwt/hub"
_Name = Annotated[str, msgspec.Meta(max_length=64)]
_Epoch = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
_Number = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
_Url = Annotated[str, msgspec.Meta(max_length=512, pattern=r"^wss?://[^/\s]+(/[^\s]*)?$")]


class _Rows(msgspec.Struct, frozen=True):
    """All robots of a node: names, and nanoseconds since the epoch at which they dialled in.

    Attributes:
        url: where other nodes dial in.
        number: number of the last change that they include.
    """

    url: _Url
    number: _Number
    robots: dict[_Name, _Epoch]


class _Change(msgspec.Struct, frozen=True):
    """Robots of a node that came or left."""

    number: _Number
    came: dict[_Name, _Epoch]
    left: list[_Name]


class _Wish(msgspec.Struct, frozen=True):
    """A node wants a robot: the receiver is to dial in there with that token."""

    robot: _Name
    url: _Url
    token: Annotated[str, msgspec.Meta(min_length=32, max_length=256)]


@dataclass(slots=True)
class _Node:
    """Another node.

    Attributes:
        number: number of the last change; None until it has answered with all rows.
    """

    url: str = ""
    number: int | None = None
    robots: dict[str, int] = field(default_factory=dict)


class Directory:
    """Robots of all nodes. Implements :class:`rwt.extensions.hub.hub.Nodes`.

    All of it runs on the event loop; Zenoh's threads only pass on what arrives.

    Attributes by purpose: ``_own`` (robots of this node), ``_came``, ``_left`` and ``_number`` (changes not
    published yet, and the number of the last published); ``_nodes`` (others, by id); ``_bringing`` (robots
    that another node has been asked for), ``_brought`` (robots that are served here:
    their node and place), ``_places``; ``_declared``
    (kept, because Zenoh undeclares what is no longer referenced).

    Attributes:
        links: links of this node to others.
        id: id of this node.
        url: URL at which other nodes dial in here.
    """

    def __init__(self, hub: Hub, links: Links, session: zenoh.Session, url: str, max_links: int) -> None:
        self.id = secrets.token_hex(8)
        self.url = url
        self._hub = hub
        self.links = links
        self._session = session
        self._own: dict[str, int] = {robot.name: time.time_ns() for robot in hub.robots}
        self._came: dict[str, int] = {}
        self._left: set[str] = set()
        self._number = 0
        self._changed = anyio.Event()
        self._nodes: dict[str, _Node] = {}
        self._bringing: dict[str, anyio.Event] = {}
        self._brought: dict[str, tuple[str, Share]] = {}
        self._places = SharedPool(LINKS, max_links)
        self._call_soon = call_soon_threadsafe()
        self._declared: list[object] = []

    # -- this node's robots ----------------------------------------------------------------------------------

    def came(self, robot: str) -> None:
        """See :class:`rwt.extensions.hub.hub.Nodes`."""
        self._own[robot] = self._came[robot] = time.time_ns()
        self._left.discard(robot)
        self._changed.set()

    def left(self, robot: str) -> None:
        """See :class:`rwt.extensions.hub.hub.Nodes`."""
        self._own.pop(robot, None)
        self._came.pop(robot, None)
        self._left.add(robot)
        self._changed.set()
        self.links.end(robot)

    async def publish(self) -> None:
        """Publish changes until cancelled."""
        while True:
            await self._changed.wait()
            self._changed = anyio.Event()
            self._number += 1
            change = _Change(self._number, self._came, sorted(self._left))
            self._came, self._left = {}, set()
            self._session.put(f"{_ROOT}/change/{self.id}", msgspec.json.encode(change))
            await anyio.sleep(TICK_SECONDS)

    # -- robots of others ------------------------------------------------------------------------------------

    @property
    def count(self) -> int:
        """See :class:`rwt.extensions.hub.hub.Nodes`."""
        return sum(node.number is not None for node in self._nodes.values())

    @property
    def robots(self) -> Iterable[str]:
        """See :class:`rwt.extensions.hub.hub.Nodes`."""
        return {name for node in self._nodes.values() for name in node.robots}

    def has(self, robot: str) -> bool:
        """See :class:`rwt.extensions.hub.hub.Nodes`."""
        return self.home(robot) is not None

    def home(self, robot: str) -> str | None:
        """Return the id of the other node at which a robot has dialled in last; None if there is none."""
        homes = [(node.robots[robot], id) for id, node in self._nodes.items() if robot in node.robots]
        return max(homes)[1] if homes else None

    async def bring(self, robot: str, address: str) -> None:
        """See :class:`rwt.extensions.hub.hub.Nodes`."""
        brought, home = self._bringing.get(robot), self.home(robot)
        if brought is not None:
            await brought.wait()
        elif home is not None:
            end = partial(self._hub.unlink, robot)
            share = self._places.take(holder_of(address), end)
            brought = self._bringing[robot] = anyio.Event()
            try:
                if await self._bring(robot, home):
                    self._brought[robot] = home, share
            finally:
                if robot not in self._brought:
                    self._places.release(share)
                del self._bringing[robot]
                brought.set()

    def unlinked(self, robot: str) -> None:
        """See :class:`rwt.extensions.hub.hub.Nodes`."""
        _, share = self._brought.pop(robot, ("", None))
        if share is not None:
            self._places.release(share)

    async def _bring(self, robot: str, home: str) -> bool:
        token = secrets.token_urlsafe(32)
        arrived = self._hub.expect(robot, token)
        wish = _Wish(robot, self.url, token)
        answers: list[bytes] = []
        answered = anyio.Event()
        self._get(f"link/{home}", answers.append, answered.set, msgspec.json.encode(wish))
        with anyio.move_on_after(BRING_SECONDS):
            await answered.wait()
            if answers == [b""]:
                await arrived.wait()
        if not arrived.is_set():
            self._hub.unexpect(robot)
            reason = answers[0].decode("utf-8", "replace")[:200] if answers else "it does not answer"
            logger.warning("robot %s is at node %s, which cannot be reached: %s", robot, home, reason)
        return arrived.is_set()

    def _check_homes(self) -> None:
        """End the links for robots that have moved."""
        for robot, (home, _) in tuple(self._brought.items()):
            if self.home(robot) != home:
                self._hub.unlink(robot, f"the robot {robot} has left its node")

    # -- Zenoh -----------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Declare what other nodes need, and learn of them."""
        session, liveliness = self._session, self._session.liveliness()
        self._declared += (
            session.declare_queryable(f"{_ROOT}/rows/{self.id}", self._callback(self._tell_rows)),
            session.declare_queryable(f"{_ROOT}/link/{self.id}", self._callback(self._link)),
            session.declare_subscriber(f"{_ROOT}/change/*", self._callback(self._change)),
            liveliness.declare_subscriber(f"{_ROOT}/node/*", self._callback(self._node), history=True),
            liveliness.declare_token(f"{_ROOT}/node/{self.id}"),
        )

    def _callback(
        self, function: Callable[[T], None], done: Callable[[], object] | None = None
    ) -> zenoh.handlers.Callback[T]:
        """Return a callback for Zenoh's threads that calls a function on the event loop."""

        def receive(item: T) -> None:
            self._call_soon(partial(function, item))

        drop = None if done is None else partial(self._call_soon, done)
        return zenoh.handlers.Callback(receive, drop, indirect=False)

    def _get(
        self,
        key: str,
        take: Callable[[bytes], object],
        done: Callable[[], object],
        payload: bytes | None = None,
    ) -> None:
        def answered(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                take(reply.ok.payload.to_bytes())

        self._session.get(
            f"{_ROOT}/{key}", self._callback(answered, done), payload=payload, timeout=ASK_SECONDS
        )

    def _node(self, sample: zenoh.Sample) -> None:
        """A node has come or gone."""
        id = str(sample.key_expr).rpartition("/")[2]
        if id == self.id:
            return
        if sample.kind is zenoh.SampleKind.DELETE:
            if self._nodes.pop(id, None) is not None:
                logger.info("node %s is gone", id)
                self._check_homes()
        elif id not in self._nodes:
            self._nodes[id] = _Node()
            self._ask_rows(id)

    def _ask_rows(self, id: str) -> None:
        self._get(f"rows/{id}", partial(self._take_rows, id), partial(self._asked_rows, id))

    def _asked_rows(self, id: str) -> None:
        """Ask again if a node has not answered."""
        node = self._nodes.get(id)
        if node is not None and node.number is None:
            self._hub.clock.call_later(AGAIN_SECONDS, partial(self._ask_again, id))

    def _ask_again(self, id: str) -> None:
        if id in self._nodes:
            self._ask_rows(id)

    def _take_rows(self, id: str, data: bytes) -> None:
        rows, node = _decoded(data, _Rows), self._nodes.get(id)
        if rows is None or node is None:
            return
        if node.number is None:
            logger.info("node %s is at %s, with %d robots", id, rows.url, len(rows.robots))
        node.url, node.number = rows.url, rows.number
        node.robots = {name: epoch for name, epoch in rows.robots.items() if is_robot_name(name)}
        self._check_homes()

    def _change(self, sample: zenoh.Sample) -> None:
        id = str(sample.key_expr).rpartition("/")[2]
        node, change = self._nodes.get(id), _decoded(sample.payload.to_bytes(), _Change)
        if node is None or change is None or node.number is None or change.number <= node.number:
            return
        if change.number > node.number + 1:
            self._ask_rows(id)
            return
        node.number = change.number
        node.robots.update((name, epoch) for name, epoch in change.came.items() if is_robot_name(name))
        for name in change.left:
            node.robots.pop(name, None)
        self._check_homes()

    def _tell_rows(self, query: zenoh.Query) -> None:
        # Robots that came since the last change are in the next one as well.
        rows = _Rows(self.url, self._number, self._own)
        query.reply(query.key_expr, msgspec.json.encode(rows))
        query.drop()

    def _link(self, query: zenoh.Query) -> None:
        wish = None if query.payload is None else _decoded(query.payload.to_bytes(), _Wish)
        said = "the question cannot be read" if wish is None else ""
        if wish is not None:
            said = self.links.open(wish.robot, wish.url, wish.token)
        query.reply(query.key_expr, said.encode())
        query.drop()


def _decoded(data: bytes, type: type[T]) -> T | None:
    try:
        return msgspec.json.decode(data, type=type)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        logger.warning("a node sends something else than %s: %s", type.__name__.strip("_").lower(), error)
        return None


@asynccontextmanager
async def open_directory(
    hub: Hub,
    url: str,
    *,
    listen: tuple[str, ...] = (),
    connect: tuple[str, ...] = (),
    config: Path | None = None,
    limits: Limits,
    tls: SSLContext | None = None,
    max_links: int = MAX_LINKS,
) -> AsyncIterator[Directory]:
    """Make a hub one of several nodes within the block.

    Args:
        url: URL at which other nodes dial in here, ``ws://HOST:PORT`` or ``wss://HOST:PORT``.
        listen: Zenoh endpoints of this node, such as ``tls/0.0.0.0:7447``.
        connect: Zenoh endpoints of other nodes; unreachable ones are retried.
        config: Zenoh configuration file (JSON5), for certificates and the like.
        limits: limits of each link to another node; ``connections`` counts its streams.
        tls: how to check the certificates of other nodes; by default against the system's authorities.
        max_links: maximum number of robots of other nodes that are served here at a time.

    Raises:
        ZenohError: the session cannot be opened.
    """
    session = ZenohSession()
    options = ZenohOptions(listen, connect, "router", config=config)
    opened = await anyio.to_thread.run_sync(session.open, options)
    try:
        starter = TaskStarter()
        directory = Directory(hub, Links(hub, starter, limits, tls), opened, url, max_links)
        hub.nodes = directory
        directory.open()
        async with background_tasks() as tasks:
            tasks.start_soon(starter.run, tasks)
            tasks.start_soon(directory.publish)
            yield directory
    finally:
        hub.nodes = None
        with anyio.CancelScope(shield=True):
            await anyio.to_thread.run_sync(session.close)
