"""Registrations of this process at the master.

The wanted registrations are compared with those that the master has confirmed. A master that restarts has
none of them, so they are all made again.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Container
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import anyio

from rwt.extensions.ros1.wire import rpc
from rwt_graph.errors import Ros1Error

if TYPE_CHECKING:
    from rwt.extensions.ros1.node import Ros1Node
    from rwt.extensions.ros1.session import Session

logger = logging.getLogger(__name__)

Kind = Literal["Publisher", "Subscriber", "Service"]

#: Seconds between attempts while the master does not answer.
_RETRY_SECONDS: Final = 1.0

#: Timeout of the calls that find out whether a node or service of the same name is alive.
_ALIVE_SECONDS: Final = 2.0

#: Seconds between two looks whether another node still offers a service of this process.
_LOOK_AGAIN_SECONDS: Final = 10.0

#: Timeout of all calls together when the process leaves.
_LEAVE_SECONDS: Final = 3.0


@dataclass(frozen=True, slots=True)
class Registration:
    """Publisher, subscriber or service of a node; `type` is "*" while it is unknown."""

    kind: Kind
    name: str
    type: str
    node: Ros1Node


class Registrar:
    """Task that keeps the master's tables in step with this process.

    Attributes:
        confirmed: registrations that the master has.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._wanted: dict[Registration, None] = {}
        self.confirmed: dict[Registration, None] = {}
        # Services that are not registered since another node offers them, with the time of the last look.
        self._refused: dict[Registration, float] = {}
        # Those of them that were logged.
        self._logged: set[Registration] = set()
        self._wake = anyio.Event()

    def add(self, registration: Registration) -> None:
        """Register soon."""
        self._wanted[registration] = None
        self._wake.set()

    def remove(self, registration: Registration) -> None:
        """Unregister soon."""
        self._wanted.pop(registration, None)
        self._refused.pop(registration, None)
        self._logged.discard(registration)
        self._wake.set()

    def repeat(self) -> None:
        """Register everything again: the master has lost it."""
        self.confirmed.clear()
        self._refused.clear()
        self._wake.set()

    def repeat_of(self, node: Ros1Node) -> None:
        """Register a node again, whose name has changed: the master has removed its registrations."""
        self.confirmed = {each: None for each in self.confirmed if each.node is not node}
        self._wake.set()

    def reconsider(self, services: Container[str]) -> None:
        """Try again to offer the services that another node offered: those that the master no longer lists,
        and from time to time the others, since a killed node stays listed."""
        before = time.monotonic() - _LOOK_AGAIN_SECONDS
        for each, looked_at in tuple(self._refused.items()):
            if each.name not in services or looked_at < before:
                del self._refused[each]
                self._wake.set()

    async def run(self) -> None:
        """Register and unregister, in the order of the requests, until the task is cancelled."""
        while True:
            self._wake = anyio.Event()
            try:
                await self._reconcile()
            except Ros1Error as error:
                self._session.on_master_error(error)
                await anyio.sleep(_RETRY_SECONDS)
                continue
            await self._wake.wait()

    async def _reconcile(self) -> None:
        for each in tuple(self.confirmed.keys() - self._wanted.keys()):
            await self._unregister(each)
        for each in tuple(self._wanted):
            is_open = each not in self.confirmed and each not in self._refused
            if is_open and each in self._wanted and not each.node.is_evicted:
                await self._register(each)

    async def _register(self, each: Registration) -> None:
        session, node = self._session, each.node
        await node.opened.wait()
        if not node.is_named:
            await self._choose_name(node)
        subscription = node.subscriptions.get(each.name) if each.kind == "Subscriber" else None
        updates = 0 if subscription is None else subscription.updates
        what: tuple[str, ...] = (each.name, each.type, node.uri)
        if each.kind == "Service":
            what = (each.name, node.service_uri, node.uri)
            if await self._is_served(each):
                self._refused[each] = time.monotonic()
                return
            if each in self._logged:
                self._logged.discard(each)
                logger.info("service %s of this process is offered on ROS 1 now", each.name)
        publishers = await session.call_master(f"register{each.kind}", node.name, *what)
        self.confirmed[each] = None
        # An update that has overtaken the response is newer.
        if subscription is not None and subscription.updates == updates and isinstance(publishers, list):
            subscription.follow([uri for uri in publishers if isinstance(uri, str)])

    async def _unregister(self, each: Registration) -> None:
        where = each.node.service_uri if each.kind == "Service" else each.node.uri
        await self._session.call_master(f"unregister{each.kind}", each.node.name, each.name, where)
        self.confirmed.pop(each, None)

    async def _choose_name(self, node: Ros1Node) -> None:
        """Change the name of a node if a living one has it: the master would shut that one down."""
        session = self._session
        uri = await session.try_master("lookupNode", node.name)
        if isinstance(uri, str) and uri != node.uri:
            try:
                with anyio.fail_after(_ALIVE_SECONDS):
                    await rpc.call(uri, "getPid", node.name)
            except (Ros1Error, TimeoutError):
                pass  # It was killed, and is still listed.
            else:
                name = node.name
                node.rename()
                logger.warning("a node %s exists on ROS 1; this one is called %s there", name, node.name)
        node.is_named = True

    async def _is_served(self, each: Registration) -> bool:
        """Return True if another living node offers the service; the master would replace it."""
        uri = await self._session.try_master("lookupService", each.name)
        if not isinstance(uri, str) or uri == each.node.service_uri:
            return False
        try:
            host, port = rpc.address_of(uri, "rosrpc")
            with anyio.fail_after(_ALIVE_SECONDS):
                stream = await anyio.connect_tcp(host, port)
        except (OSError, ValueError):
            return False
        await stream.aclose()
        if each not in self._logged:
            self._logged.add(each)
            logger.warning(
                "service %s of this process is not offered on ROS 1: another node offers it", each.name
            )
        return True

    async def leave(self) -> None:
        """Unregister everything, for as long as the master answers."""
        with anyio.move_on_after(_LEAVE_SECONDS, shield=True):
            for each in tuple(self.confirmed):
                try:
                    await self._unregister(each)
                except Ros1Error:
                    return
