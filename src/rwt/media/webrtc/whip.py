"""WHIP (RFC 9725): ``POST /whip?topic=…&audio=…`` with an offer, and a client's camera and microphone become
topics, by the client's role and through the gate."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Container, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final, Never
from urllib.parse import parse_qsl

from rwt.access.errors import AccessError
from rwt.delivery.shared_graph import SharedGraph
from rwt.media.webrtc.camera import QUALITY, Camera, CameraRequest
from rwt.media.webrtc.decoding import bound_decoding
from rwt.media.webrtc.microphone import RATE, RATES, Microphone, MicrophoneRequest
from rwt.media.webrtc.opus import only_opus, require_opus
from rwt.media.webrtc.senders import SendersTopic, Sending
from rwt_graph.errors import InvalidGraphName
from rwt_participant.errors import RobotError
from rwt_transports.endpoint import PeerInfo
from rwt_transports.errors import Refused
from rwt_transports.http.routes import Audience, HttpResponse, Route
from rwt_transports.webrtc.sdp import BadDescription, Description, read_description
from rwt_transports.webrtc.signalling import SDP, answering, opened, resource_routes

if TYPE_CHECKING:
    from aiortc import MediaStreamTrack

    from rwt.access.access import Access
    from rwt.access.client_graph import ClientGraph
    from rwt.access.graph_view import GraphView
    from rwt_graph.api import Graph
    from rwt_transports.endpoint import Sink
    from rwt_transports.http.routes import HttpRequest
    from rwt_transports.webrtc.peer import Peer
    from rwt_transports.webrtc.signalling import Peers

PATH: Final = "/whip"
NODE: Final = "/whip"


@dataclass(frozen=True, slots=True)
class MediaRequest:
    """What a query asks for: a camera, a microphone or both.

    Attributes:
        camera: how images are published; None for none.
        microphone: how audio is published; None for none.
    """

    camera: CameraRequest | None
    microphone: MicrophoneRequest | None

    def check(self, description: Description) -> None:
        """Compare with what is offered.

        Raises:
            BadDescription: it lacks what is asked for, or has more than that.
        """
        offered = sorted(description.media)
        wanted = [kind for kind, each in (("audio", self.microphone), ("video", self.camera)) if each]
        if offered not in (["audio"], ["video"], ["audio", "video"]) or not set(wanted) <= set(offered):
            raise BadDescription(
                f"sections {', '.join(description.media) or 'none'} are offered, where one of"
                f" {' and one of '.join(wanted)} is wanted"
            )
        if self.microphone is not None:
            require_opus(description)


def read_query(query: str) -> MediaRequest:
    """What a query string asks for.

    Raises:
        BadDescription: it cannot be used; says what is expected.
    """
    given = dict(parse_qsl(query, keep_blank_values=True))
    topic, audio = given.get("topic"), given.get("audio")
    if not topic and not audio:
        raise BadDescription(
            "`topic` is missing: for example /whip?topic=/operator/camera for pictures,"
            " /whip?audio=/operator/voice for sound, or both"
        )
    quality = _number(given, "quality", QUALITY, range(1, 101), "a whole number from 1 to 100")
    rate = _number(given, "rate", RATE, RATES, f"one of {', '.join(map(str, RATES))}")
    channels = _number(given, "channels", 1, (1, 2), "1 or 2")
    return MediaRequest(
        CameraRequest(topic, given.get("frame_id", "")[:256], quality) if topic else None,
        MicrophoneRequest(audio, rate, channels) if audio else None,
    )


def _number(given: dict[str, str], name: str, usual: int, possible: Container[int], expected: str) -> int:
    text = given.get(name, str(usual))
    if not (text.isascii() and text.isdigit() and len(text) < 6 and int(text) in possible):
        raise BadDescription(f"`{name}` must be {expected}, got {text!r:.100}")
    return int(text)


class IncomingMedia:
    """The cameras and microphones of clients, as topics; satisfies what a server asks of a gateway when roles
    change.

    Args:
        graph: where they are published.
        access: who may do what.
        linger: seconds that a publisher outlives its last user.
    """

    def __init__(self, graph: Graph, access: Access, linger: float) -> None:
        self._access = access
        self._shared = SharedGraph(graph, NODE, linger, partial(access.audit.write, logging.INFO, "%s"))
        self._senders: dict[MediaSender, PeerInfo] = {}
        self._topic = SendersTopic(self._shared, access)
        self._count = 0

    def routes(self, peers: Peers) -> tuple[Route[GraphView], ...]:
        """The routes by which they come."""

        def page(request: HttpRequest, reader: GraphView) -> Awaitable[HttpResponse]:
            return answering(request, SDP, partial(self._offered, peers, reader))

        return (Route(PATH, page, Audience.ADMITTED, "POST"), *resource_routes(peers, PATH))

    async def _offered(self, peers: Peers, reader: GraphView, request: HttpRequest) -> HttpResponse:
        description = read_description(request.body, peers.terms.candidates)
        wanted = read_query(request.query)
        wanted.check(description)
        sender = self._sender(wanted, reader, request)

        async def answer(peer: Peer) -> str:
            sender.watch(peer)
            for kind in description.media:
                # Of what nobody has asked for there is nothing that would take it.
                taken = sender.takes(kind)
                transceiver = peer.connection.addTransceiver(kind, "recvonly" if taken else "inactive")
                if taken:
                    bound_decoding(transceiver.receiver)
                if taken and kind == "audio":
                    only_opus(transceiver)
            await peer.take_description(description, "offer")
            return await peer.describe()

        try:
            return opened(PATH, request, *await peers.open(_refuse, request.address, answer))
        except BaseException:
            sender.close()
            raise

    def _sender(self, wanted: MediaRequest, reader: GraphView, request: HttpRequest) -> MediaSender:
        self._count += 1
        name = f"whip:{self._count}"
        client = self._access.client(self._shared, reader.role, request.address, name)
        try:
            sender = MediaSender(client, name, wanted, self._tell, self._forget)
        except (AccessError, RobotError, InvalidGraphName) as error:
            client.close()
            status = 403 if isinstance(error, AccessError) else 409
            raise Refused(400 if isinstance(error, InvalidGraphName) else status, str(error)) from error
        target = f"{request.path}?{request.query}"
        self._senders[sender] = PeerInfo("http", request.address, 0, target, request.headers)
        return sender

    def _forget(self, sender: MediaSender) -> None:
        if self._senders.pop(sender, None) is not None:
            self._tell()

    def _tell(self) -> None:
        """Say who sends now."""
        self._topic.tell(each for sender in self._senders for each in sender.sending())

    def reload_roles(self) -> None:
        """Let each client publish as the settings allow now, and end those that may not."""
        for sender, info in tuple(self._senders.items()):
            try:
                sender.take_role(self._access.admission.role_now(info, None).name, self._access)
            except (Refused, AccessError, RobotError) as error:
                sender.end(str(error))
        self._tell()

    def close(self) -> None:
        """Leave the graph."""
        for sender in tuple(self._senders):
            sender.end("the server is going away")
        self._shared.close()


def _refuse(sink: Sink, info: PeerInfo) -> Never:
    raise Refused(403, "data channels are offered at /webrtc")


class MediaSender:
    """One client that sends its camera, its microphone or both.

    Args:
        client: the graph as the client may act on it.
        name: of the client.
        wanted: what was asked for.
        on_begin: called once when its peer is connected, so that what it sends is received.
        on_close: called once when it has ended.

    Raises:
        AccessError: the client may not publish on one of the topics.
        RobotError: one of them has another type.
    """

    def __init__(
        self,
        client: ClientGraph,
        name: str,
        wanted: MediaRequest,
        on_begin: Callable[[], None],
        on_close: Callable[[MediaSender], None],
    ) -> None:
        self._client = client
        self._name = name
        self._on_begin = on_begin
        self._since_ns: int | None = None
        self._on_close = on_close
        self._sinks: dict[str, Camera | Microphone] = {}
        if wanted.camera is not None:
            self._sinks["video"] = Camera(client, wanted.camera, self.end)
        if wanted.microphone is not None:
            self._sinks["audio"] = Microphone(client, wanted.microphone, self.end)
        self._peer: Peer | None = None
        self._tasks: dict[str, tuple[asyncio.Task[None], ...]] = {}
        self._over = False

    def takes(self, kind: str) -> bool:
        """Whether tracks of that kind, ``audio`` or ``video``, are published."""
        return kind in self._sinks

    def watch(self, peer: Peer) -> None:
        """Publish what the peer's tracks bring, until the peer ends."""
        self._peer = peer
        peer.connection.on("track", self._begin)
        peer.connection.on("connectionstatechange", self._state_changed)
        peer.when_ended(self.close)

    def _begin(self, track: MediaStreamTrack) -> None:
        sink = self._sinks.get(track.kind)
        if sink is not None and track.kind not in self._tasks and not self._over:
            loop = asyncio.get_running_loop()
            self._tasks[track.kind] = (loop.create_task(sink.take(track)), loop.create_task(sink.publish()))

    def _state_changed(self) -> None:
        connected = self._peer is not None and self._peer.connection.connectionState == "connected"
        if connected and self._since_ns is None and not self._over:
            self._since_ns = self._client.clock.time_ns()
            self._on_begin()

    def sending(self) -> Iterator[Sending]:
        """What is received of it now: nothing before its peer is connected."""
        if self._since_ns is not None:
            role = self._client.role.name
            for kind, sink in self._sinks.items():
                yield Sending(sink.topic, kind, self._name, role, self._since_ns)

    def take_role(self, name: str, access: Access) -> None:
        """Publish as the role `name` from now on. Raises AccessError where that may not."""
        self._client.take_role(access.admission.roles[name])
        for sink in self._sinks.values():
            sink.renew()

    def end(self, reason: str) -> None:
        """End it, and its peer."""
        if self._peer is not None and not self._peer.closed:
            self._peer.fail(reason)
        self.close()

    def close(self) -> None:
        """Publish nothing more."""
        if self._over:
            return
        self._over = True
        for task in (each for tasks in self._tasks.values() for each in tasks):
            task.cancel()
        self._client.close()
        self._on_close(self)
