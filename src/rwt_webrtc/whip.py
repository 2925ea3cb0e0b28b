"""WHIP (RFC 9725): ``POST /whip?topic=…`` with an offer, and the client's camera becomes a topic.

Its pictures are published as `sensor_msgs/CompressedImage` (JPEG), by the client's role and through the gate.
A picture is made a message only when the one before is: what comes meanwhile is left out.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final, Never
from urllib.parse import parse_qsl

import anyio.to_thread
import numpy as np
from aiortc.mediastreams import MediaStreamError
from av import VideoFrame

from rwt_access.errors import AccessError
from rwt_delivery.shared_graph import SharedGraph
from rwt_graph.errors import InvalidGraphName
from rwt_interfaces.payload import Payload
from rwt_nodes.video.encoders.jpeg import encode_jpeg
from rwt_nodes.video.stream_request import MOST_AREA
from rwt_program.errors import RobotError
from rwt_protocol.transport import PeerInfo
from rwt_transports.errors import Refused, log_exception
from rwt_transports.http import Audience, HttpResponse, Route
from rwt_transports.webrtc.sdp import BadDescription, read_description
from rwt_transports.webrtc.signalling import SDP, answering, opened, resource_routes

if TYPE_CHECKING:
    from aiortc import MediaStreamTrack

    from rwt_access.access import Access
    from rwt_access.client_graph import ClientGraph, ClientPublisher
    from rwt_access.graph_view import GraphView
    from rwt_graph.api import Graph
    from rwt_protocol.transport import Sink
    from rwt_transports.http import HttpRequest
    from rwt_transports.webrtc.peer import Peer
    from rwt_transports.webrtc.signalling import Peers

PATH: Final = "/whip"
NODE: Final = "/whip"
TYPE: Final = "sensor_msgs/CompressedImage"
QUALITY: Final = 85
"""Of the JPEG pictures, 1 to 100, where none is asked for."""

logger = logging.getLogger("rwt_webrtc")


@dataclass(frozen=True, slots=True)
class MediaRequest:
    """What a query asks for.

    Attributes:
        topic: where the pictures are published.
        frame_id: the frame of reference that they name.
        quality: of the JPEG pictures.
    """

    topic: str
    frame_id: str = ""
    quality: int = QUALITY


def read_query(query: str) -> MediaRequest:
    """What a query string asks for.

    Raises:
        BadDescription: it cannot be used; says what is expected.
    """
    given = dict(parse_qsl(query, keep_blank_values=True))
    if not given.get("topic"):
        raise BadDescription("`topic` is missing: for example /whip?topic=/operator/camera")
    quality = given.get("quality", str(QUALITY))
    if not (quality.isascii() and quality.isdigit() and len(quality) < 4 and 1 <= int(quality) <= 100):
        raise BadDescription(f"`quality` must be a whole number from 1 to 100, got {quality!r:.100}")
    return MediaRequest(given["topic"], given.get("frame_id", "")[:256], int(quality))


class IncomingMedia:
    """The cameras of clients, as topics; satisfies what a server asks of a gateway when roles change.

    Args:
        graph: where they are published.
        access: who may do what.
        linger: seconds that a publisher outlives its last user.
    """

    def __init__(self, graph: Graph, access: Access, linger: float) -> None:
        self._access = access
        self._shared = SharedGraph(graph, NODE, linger, partial(access.audit.write, logging.INFO, "%s"))
        self._cameras: dict[Camera, PeerInfo] = {}
        self._count = 0

    def routes(self, peers: Peers) -> tuple[Route[GraphView], ...]:
        """The routes by which cameras come."""

        def page(request: HttpRequest, reader: GraphView) -> Awaitable[HttpResponse]:
            return answering(request, SDP, partial(self._offered, peers, reader))

        return (Route(PATH, page, Audience.ADMITTED, "POST"), *resource_routes(peers, PATH))

    async def _offered(self, peers: Peers, reader: GraphView, request: HttpRequest) -> HttpResponse:
        description = read_description(request.body, peers.terms.candidates)
        if sorted(description.media) not in (["video"], ["audio", "video"]):
            raise BadDescription(
                f"sections {', '.join(description.media) or 'none'} are offered, where one of video is wanted"
            )
        camera = self._camera(read_query(request.query), reader, request)

        async def answer(peer: Peer) -> str:
            camera.watch(peer)
            if "audio" in description.media:
                peer.connection.addTransceiver("audio", "inactive")  # There is nothing that would hear it.
            await peer.take_description(description, "offer")
            return await peer.describe()

        try:
            return opened(PATH, request, *await peers.open(_refuse, request.address, answer))
        except BaseException:
            camera.close()
            raise

    def _camera(self, wanted: MediaRequest, reader: GraphView, request: HttpRequest) -> Camera:
        self._count += 1
        name = f"whip:{self._count}"
        client = self._access.client(self._shared, reader.role, request.address, name)
        try:
            camera = Camera(client, wanted, self._forget)
        except (AccessError, RobotError, InvalidGraphName) as error:
            client.close()
            status = 403 if isinstance(error, AccessError) else 409
            raise Refused(400 if isinstance(error, InvalidGraphName) else status, str(error)) from error
        target = f"{request.path}?{request.query}"
        self._cameras[camera] = PeerInfo("http", request.address, 0, target, request.headers)
        return camera

    def _forget(self, camera: Camera) -> None:
        self._cameras.pop(camera, None)

    def reload_roles(self) -> None:
        """Let each camera publish as the settings allow now, and end those that may not."""
        for camera, info in tuple(self._cameras.items()):
            try:
                camera.take_role(self._access.admission.role_now(info, None).name, self._access)
            except (Refused, AccessError, RobotError) as error:
                camera.end(str(error))

    def close(self) -> None:
        """Leave the graph."""
        for camera in tuple(self._cameras):
            camera.end("the server is going away")
        self._shared.close()


def _refuse(sink: Sink, info: PeerInfo) -> Never:
    raise Refused(403, "data channels are offered at /webrtc")


class Camera:
    """One client's camera.

    Args:
        client: the graph as the client may act on it.
        wanted: what was asked for.
        on_close: called once when it has ended.

    Raises:
        AccessError: the client may not publish on the topic.
        RobotError: the topic has another type.
    """

    def __init__(self, client: ClientGraph, wanted: MediaRequest, on_close: Callable[[Camera], None]) -> None:
        self._client = client
        self._wanted = wanted
        self._on_close = on_close
        self._publisher: ClientPublisher = client.publisher(wanted.topic, TYPE)
        self._peer: Peer | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._newest: VideoFrame | None = None
        self._woken = asyncio.Event()
        self._over = False

    def watch(self, peer: Peer) -> None:
        """Publish what the peer's track brings, until the peer ends."""
        self._peer = peer
        peer.connection.on("track", self._begin)
        peer.when_ended(self.close)

    def _begin(self, track: MediaStreamTrack) -> None:
        if track.kind == "video" and not self._tasks and not self._over:
            loop = asyncio.get_running_loop()
            self._tasks = [loop.create_task(self._take(track)), loop.create_task(self._publish())]

    async def _take(self, track: MediaStreamTrack) -> None:
        """Take every picture as it comes; a later one replaces one that is not published yet."""
        try:
            while True:
                frame = await track.recv()
                if not isinstance(frame, VideoFrame):
                    continue
                if frame.width * frame.height > MOST_AREA:
                    self.end(f"pictures of {frame.width} x {frame.height}; the most is {MOST_AREA} pixels")
                    return
                self._newest = frame
                self._woken.set()
        except MediaStreamError:
            self.end("the camera has ended")

    async def _publish(self) -> None:
        clock = self._client.clock
        while True:
            await self._woken.wait()
            self._woken.clear()
            frame, self._newest = self._newest, None
            if frame is None:
                continue
            stamp = clock.time_ns()
            try:
                data, seconds = await anyio.to_thread.run_sync(_encode, frame, self._wanted.quality)
                self._client.work.add(seconds, "pictures")
                header = {
                    "stamp": self._client.distro.time(stamp),
                    "frame_id": self._wanted.frame_id,
                }
                message = {"header": header, "format": "jpeg", "data": data}
                self._publisher.publish(Payload.from_value(self._publisher.type, message))
            except AccessError as refused:
                logger.debug("a picture for %s was refused: %s", self._wanted.topic, refused)
            except Exception:
                log_exception("a camera's pictures could not be published on %s", self._wanted.topic)
                self.end("internal error")
                return

    def take_role(self, name: str, access: Access) -> None:
        """Publish as the role `name` from now on. Raises AccessError where that may not."""
        self._client.take_role(access.admission.roles[name])
        self._publisher = self._client.publisher(self._wanted.topic, TYPE)

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
        for task in self._tasks:
            task.cancel()
        self._client.close()
        self._on_close(self)


def _encode(frame: VideoFrame, quality: int) -> tuple[bytes, float]:
    """A picture as JPEG, and the processor's seconds that it took."""
    began = time.thread_time()
    pixels = np.asarray(frame.to_ndarray(format="rgb24"), np.uint8)
    data = encode_jpeg(pixels, quality)
    return data, time.thread_time() - began
