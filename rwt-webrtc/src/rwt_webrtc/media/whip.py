"""WHIP (RFC 9725): ``POST /whip?topic=…&audio=…`` with an offer publishes a client's camera and microphone.

They are topics like others: the client's role and the gate decide.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final
from urllib.parse import parse_qsl

from aiortc import MediaStreamTrack

from rwt.access.access import Access
from rwt.access.client_graph import ClientGraph
from rwt.access.errors import AccessError
from rwt.access.graph_view import GraphView
from rwt.access.roles import Role
from rwt.delivery.shared_graph import SharedGraph
from rwt_graph import Graph, InvalidGraphName
from rwt_interfaces.payload import Payload
from rwt_participant.errors import RobotError
from rwt_participant.qos import LATCHED
from rwt_transports.endpoint import PeerInfo
from rwt_transports.errors import Refused
from rwt_transports.http.routes import HttpRequest, HttpResponse, Route
from rwt_webrtc.media.camera import QUALITY, Camera, CameraRequest
from rwt_webrtc.media.decoding import bound_decoding
from rwt_webrtc.media.microphone import RATE, RATES, Microphone, MicrophoneRequest
from rwt_webrtc.media.opus import check_sections, only_opus
from rwt_webrtc.transport.peer import Peer
from rwt_webrtc.transport.sdp import BadDescription, read_description
from rwt_webrtc.transport.signalling import Peers, offer_routes, refuse_channels

NODE: Final = "/whip"
#: Latched topic of present senders: the recording light of an operator's camera.
SENDERS_TOPIC: Final = "/whip/senders"
SENDERS_TYPE: Final = "rwt_gate_msgs/MediaSenders"


@dataclass(frozen=True, slots=True)
class MediaRequest:
    """Request for a camera, a microphone or both."""

    camera: CameraRequest | None
    microphone: MicrophoneRequest | None


def read_query(query: str) -> MediaRequest:
    """Parse a query string.

    Raises:
        BadDescription: a value is invalid; the text says what is expected.
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
    """Cameras and microphones of clients, as topics; a server reloads its roles like those of a gateway.

    Args:
        linger: seconds for which a publisher outlives its last user.
    """

    def __init__(self, graph: Graph, access: Access, linger: float) -> None:
        self._access = access
        self._shared = SharedGraph(graph, NODE, linger, partial(access.audit.write, logging.INFO, "%s"))
        self._senders: dict[MediaSender, PeerInfo] = {}
        # No client can publish on it.
        access.reserve(SENDERS_TOPIC)
        self._publisher = self._shared.participant.advertise(
            SENDERS_TOPIC, graph.registry.message(SENDERS_TYPE), LATCHED
        )
        self._publish_senders()
        self._count = 0

    def routes(self, peers: Peers) -> tuple[Route[GraphView], ...]:
        """Return the routes of WHIP."""
        return offer_routes(peers, "whip", partial(self._offered, peers))

    async def _offered(self, peers: Peers, reader: GraphView, request: HttpRequest) -> HttpResponse:
        description = read_description(request.body, peers.terms.candidates)
        wanted = read_query(request.query)
        check_sections(description, video=wanted.camera is not None, audio=wanted.microphone is not None)
        sender = self._sender(wanted, reader, request)

        async def answer(peer: Peer) -> str:
            sender.watch(peer)
            for kind in description.media:
                # Sections that were not requested have no receiver.
                taken = sender.takes(kind)
                transceiver = peer.connection.addTransceiver(kind, "recvonly" if taken else "inactive")
                if taken:
                    bound_decoding(transceiver.receiver, sender.end)
                if taken and kind == "audio":
                    only_opus(transceiver)
            await peer.take_description(description, "offer")
            return await peer.describe()

        try:
            return await peers.open(request, reader.holder, refuse_channels, answer)
        except BaseException:
            sender.close()
            raise

    def _sender(self, wanted: MediaRequest, reader: GraphView, request: HttpRequest) -> MediaSender:
        self._count += 1
        name = f"whip:{self._count}"
        client = self._access.client(self._shared, reader.role, request.address, name)
        try:
            sender = MediaSender(client, name, wanted, self._publish_senders, self._forget)
        except (AccessError, RobotError, InvalidGraphName) as error:
            client.close()
            status = 403 if isinstance(error, AccessError) else 409
            raise Refused(400 if isinstance(error, InvalidGraphName) else status, str(error)) from error
        target = f"{request.path}?{request.query}"
        self._senders[sender] = PeerInfo("http", request.address, 0, target, request.headers)
        return sender

    def _forget(self, sender: MediaSender) -> None:
        if self._senders.pop(sender, None) is not None:
            self._publish_senders()

    def _publish_senders(self) -> None:
        fields = [each for sender in self._senders for each in sender.sending()]
        self._publisher.publish(Payload.from_value(self._publisher.type, {"senders": fields}))

    def reload_roles(self) -> None:
        """Apply new settings to every client, and end those that may no longer publish."""
        for sender, info in tuple(self._senders.items()):
            try:
                sender.take_role(self._access.admission.role_now(info, None))
            except (Refused, AccessError, RobotError) as error:
                sender.end(str(error))
        self._publish_senders()

    def close(self) -> None:
        """Leave the graph."""
        for sender in tuple(self._senders):
            sender.end("the server is going away")
        self._shared.close()


class MediaSender:
    """Client that sends its camera, its microphone or both.

    States: waiting until its peer is connected (``_since_ns`` is None), sending, closed (``_over``).

    Args:
        on_begin: called once when its peer is connected.
        on_close: called once when it is closed.

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
        client.tell_ended(lambda _kind, _name, reason: self.end(reason))
        if wanted.camera is not None:
            self._sinks["video"] = Camera(client, wanted.camera, self.end)
        if wanted.microphone is not None:
            self._sinks["audio"] = Microphone(client, wanted.microphone, self.end)
        self._peer: Peer | None = None
        self._tasks: dict[str, tuple[asyncio.Task[None], ...]] = {}
        self._over = False

    def takes(self, kind: str) -> bool:
        """Return True if tracks of a kind, ``audio`` or ``video``, are published."""
        return kind in self._sinks

    def watch(self, peer: Peer) -> None:
        """Publish the tracks of a peer until it ends."""
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

    def sending(self) -> Iterator[dict[str, object]]:
        """Return a ``MediaSender`` for each track being sent; none before the peer is connected."""
        if self._since_ns is not None:
            since = self._client.distro.time(self._since_ns)
            sender = {"client": self._name, "role": self._client.role.name, "since": since}
            for kind, sink in self._sinks.items():
                yield {"topic": sink.topic, "kind": kind, **sender}

    def take_role(self, role: Role) -> None:
        """Switch to another role. Raises AccessError if it may not publish."""
        self._client.take_role(role)
        for sink in self._sinks.values():
            sink.renew()

    def end(self, reason: str) -> None:
        """Close the sender and its peer."""
        if self._peer is not None and not self._peer.closed:
            self._peer.fail(reason)
        self.close()

    def close(self) -> None:
        """Stop publishing, and release the client's resources."""
        if self._over:
            return
        self._over = True
        for task in (each for tasks in self._tasks.values() for each in tasks):
            task.cancel()
        # Its peer and its sinks refer to it.
        self._peer = None
        self._sinks.clear()
        self._tasks.clear()
        self._client.close()
        self._on_close(self)
