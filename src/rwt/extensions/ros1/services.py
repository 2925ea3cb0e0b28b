"""Services on ROS 1: those of this process, offered to other nodes, and those of other nodes."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Final

import anyio

from rwt.extensions.ros1.probes import UnusableType
from rwt.extensions.ros1.registrar import Registration
from rwt.extensions.ros1.wire.links import connected, exchange_headers
from rwt.extensions.ros1.wire.network import Unreachable
from rwt.extensions.ros1.wire.rpc import address_of
from rwt_graph.api import ServiceInfo
from rwt_graph.backend import MemoryCall, NodeResources, OfferedServices
from rwt_graph.errors import Ros1Error, WireError
from rwt_graph.names import is_for_clients
from rwt_interfaces.errors import InterfaceError, InvalidMessage
from rwt_interfaces.payload import LONG_FORMS_BYTES, Payload
from rwt_interfaces.steps import Steps, finished
from rwt_participant.errors import CallFailed, ProviderGone
from rwt_transports.scheduler import REQUESTS, Scheduler

if TYPE_CHECKING:
    from rwt.extensions.ros1.node import Ros1Node
    from rwt.extensions.ros1.probes import Ask
    from rwt.extensions.ros1.session import Session
    from rwt.extensions.ros1.wire.links import Link
    from rwt_graph.api import OnReply, PendingCall
    from rwt_graph.backend import MemoryProvider, Services
    from rwt_interfaces.structs import MessageType

logger = logging.getLogger(__name__)

#: Services that every node offers, with their types: they need not be asked for.
_OF_EVERY_NODE: Final = {
    "/get_loggers": "roscpp/GetLoggers",
    "/set_logger_level": "roscpp/SetLoggerLevel",
}


class ServiceOffer:
    """Service of this process, and the connections of its clients."""

    def __init__(self, services: Services, node: Ros1Node, provider: MemoryProvider) -> None:
        self._services = services
        self._node = node
        self._provider = provider
        self.registration = Registration("Service", provider.name, provider.type.name, node)
        self._links: set[Link] = set()
        # The call of each client; None while its request is decoded.
        self._open: dict[Link, PendingCall | None] = {}
        self._callers = NodeResources("/_ros1", private=True)

    def accept(self, link: Link) -> None:
        """Answer the header of a client."""
        type = self._provider.type
        if link.header["md5sum"] not in ("*", type.md5):
            link.refuse(f"md5sums of {self._provider.name} do not match: it is a {type.name}/{type.md5}")
            return
        link.send_header(
            {
                "callerid": self._node.name,
                "service": self._provider.name,
                "type": type.name,
                "md5sum": type.md5,
                "request_type": type.request.name,
                "response_type": type.response.name,
            }
        )
        if link.header.get("probe") == "1":
            link.finish()
            return
        self._links.add(link)
        link.on_frame = self._on_request
        link.on_close = self._on_close

    def _on_close(self, link: Link) -> None:
        self._links.discard(link)
        call = self._open.pop(link, None)
        if call is not None:
            call.cancel()

    def _on_request(self, link: Link, body: bytes | memoryview) -> None:
        if link in self._open:
            raise WireError("a request was sent before the response to the one before it")
        if len(body) < LONG_FORMS_BYTES:
            self._call(link, finished(_decoded(self._provider.type.request, body)))
        else:
            self._open[link] = None
            self._node.spawn(partial(self._call_later, link, body), "a long request on ROS 1")

    async def _call_later(self, link: Link, body: bytes | memoryview) -> None:
        request = await Scheduler.of_loop(REQUESTS).finish(_decoded(self._provider.type.request, body))
        if self._open.pop(link, self) is None:  # It is still connected.
            self._call(link, request)

    def _call(self, link: Link, request: Payload | InvalidMessage) -> None:
        if isinstance(request, InvalidMessage):
            self._answer(link, CallFailed(f"the request is not a {self._provider.type.name}: {request}"))
            return
        call = self._services.call(
            self._provider.name, request, partial(self._answer, link), None, self._callers
        )
        if isinstance(call, MemoryCall) and not call.done:
            self._open[link] = call

    def _answer(self, link: Link, answer: Payload | CallFailed) -> None:
        self._open.pop(link, None)
        if isinstance(answer, CallFailed):
            link.send(str(answer).encode(), status=b"\0")
        else:
            link.send(*answer.serialised_parts(), status=b"\1")
        if link.header.get("persistent", "").lower() not in ("1", "true"):
            self._links.discard(link)
            link.finish()

    def close(self) -> None:
        """Close the connections of clients, after the responses to their open calls."""
        for link in tuple(self._links):
            link.finish()
        self._links.clear()


class Ros1Services(OfferedServices["Session"]):
    """Services of other nodes, and those of this process on ROS 1."""

    def __init__(self, services: Services) -> None:
        super().__init__(services)
        self._remote: dict[str, tuple[str, ServiceInfo | None]] = {}
        self._open: set[MemoryCall] = set()

    def close(self) -> None:
        """End the calls of services of other nodes."""
        super().close()
        self._remote.clear()
        while self._open:
            self._open.pop().end_with(ProviderGone("the connection to ROS 1 was closed"))

    def _offer(self, connection: Session, provider: MemoryProvider) -> Callable[[], object]:
        node = connection.node_of(provider.owner)
        offer = node.services[provider.name] = ServiceOffer(self._services, node, provider)
        connection.registrar.add(offer.registration)

        def withdraw() -> None:
            if node.services.get(provider.name) is offer:
                del node.services[provider.name]
            connection.registrar.remove(offer.registration)
            connection.run_on_graph(offer.close)

        return withdraw

    # Services of other nodes

    def lost(self, name: str) -> None:
        """Remove a service that the master does not list."""
        del self._remote[name]
        self._services.changes.note()

    def found(self, name: str, node: str) -> Ask | None:
        """Add or keep a service that the master lists; returns what asks for its type if it is unknown."""
        known = self._remote.get(name)
        if known is None or known[0] != node:
            self._remote[name] = (node, None)
            self._services.changes.note()
            if not is_for_clients(node):
                self._services.robot_offers(name)
        if self._remote[name][1] is not None:
            return None
        ending = name.removeprefix(node)
        if ending not in _OF_EVERY_NODE:
            return partial(self._ask_type, name, node)
        self._learn(name, node, _OF_EVERY_NODE[ending], None)
        return None

    def _learn(self, name: str, node: str, type_name: str, md5: str | None) -> None:
        if self._connection is None or self._remote.get(name, ("",))[0] != node:
            return
        try:
            type = self._connection.graph.registry.service(type_name)
        except InterfaceError as error:
            self._forget_type(name, node)
            raise UnusableType(
                f"service {name} cannot be called: {error}. Give its definition with --interfaces, since"
                " ROS 1 nodes do not send those of services"
            ) from error
        if md5 not in (None, "*", type.md5):
            self._forget_type(name, node)
            raise UnusableType(
                f"service {name} cannot be called: node {node} has {type_name} with the MD5 sum {md5},"
                f" and the definition of this process has {type.md5}; give the right one with --interfaces"
            )
        self._remote[name] = (node, ServiceInfo(name, type, node))
        self._services.changes.note()

    def _forget_type(self, name: str, node: str) -> None:
        self._remote[name] = (node, None)
        self._services.changes.note()

    async def _ask_type(self, name: str, node: str) -> None:
        session = self._connection
        if session is not None:
            host, port = await self._address(session, name)
            async with connected(session.network, host, port) as link:
                fields = {"callerid": "/rwt", "service": name, "md5sum": "*", "probe": "1"}
                header = await exchange_headers(link, fields)
            self._learn(name, node, header.get("type", ""), header.get("md5sum"))

    async def _address(self, session: Session, name: str) -> tuple[str, int]:
        uri = await session.call_master("lookupService", "/rwt", name)
        try:
            return address_of(str(uri), "rosrpc")
        except WireError as error:
            raise Ros1Error(f"service {name} has no address: {error}") from error

    def info(self, name: str) -> ServiceInfo | None:
        return self._remote.get(name, ("", None))[1]

    def names(self) -> set[str]:
        return set(self._remote)

    def by_node(self) -> Iterator[tuple[str, str]]:
        for name, (node, _) in self._remote.items():
            yield node, name

    def call(
        self, name: str, request: Payload, on_reply: OnReply, timeout: float | None, caller: NodeResources
    ) -> PendingCall | None:
        info, session = self.info(name), self._connection
        if info is None or session is None:
            return None
        call = MemoryCall(name, request, on_reply)
        call.wait(self._open, caller, self._services.deadlines, timeout)
        session.network.spawn(partial(self._run, session, call, info, caller.name), f"call of {name}")
        return call

    async def _run(self, session: Session, call: MemoryCall, info: ServiceInfo, caller: str) -> None:
        """Send a request and wait for its response, or for the end of the call."""
        answered = anyio.Event()
        call.on_end = answered.set
        long: list[bytes | memoryview] = []

        def on_response(link: Link, body: bytes | memoryview) -> None:
            if not link.is_success:
                call.fail(str(body, errors="replace"))
            elif len(body) < LONG_FORMS_BYTES:
                reply(finished(_decoded(info.type.response, body)))
            else:
                long.append(body)
                answered.set()

        def reply(response: Payload | InvalidMessage) -> None:
            if isinstance(response, Payload):
                call.reply(response)
            else:
                call.fail(f"the response of {info.name} is not a {info.type.name}: {response}")

        def on_close(link: Link) -> None:
            call.end_with(ProviderGone(f"Service {info.name} went away without an answer: {link.reason}"))

        try:
            host, port = await self._address(session, info.name)
            async with connected(session.network, host, port, has_status=True) as link:
                # The request follows the response to the header: rospy loses one that arrives with it.
                fields = {"callerid": caller, "service": info.name, "md5sum": info.type.md5}
                await exchange_headers(link, fields)
                link.on_frame, link.on_close = on_response, on_close
                link.send(*call.request.serialised_parts())
                if link.ended.is_set():
                    on_close(link)
                await answered.wait()
                if long:
                    reply(await Scheduler.of_loop(REQUESTS).finish(_decoded(info.type.response, long[0])))
        except Ros1Error as error:
            call.end_with(ProviderGone(f"Service {info.name} cannot be called: {error}"))
            if not isinstance(error, Unreachable):
                await self._ask_again(session, info)

    async def _ask_again(self, session: Session, info: ServiceInfo) -> None:
        """Ask for the type of a service that refuses calls: its node may be another program by now."""
        try:
            await self._ask_type(info.name, info.node)
        except (Ros1Error, WireError) as error:
            session.warn_once(str(error))


def _decoded(type: MessageType, body: bytes | memoryview) -> Steps[Payload | InvalidMessage]:
    """Decode a request or response in steps; an error is returned, because the peer is told of it."""
    try:
        return (yield from Payload.from_ros1_in_steps(type, body))
    except InvalidMessage as error:
        return error
