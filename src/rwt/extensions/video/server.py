"""Node that serves images and video: its pages, and the encoders that viewers share."""

from __future__ import annotations

import importlib.util
from collections.abc import Awaitable, Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Final, NamedTuple

import anyio
import anyio.from_thread

from rwt.extensions.video.responses import (
    MP4,
    MULTIPART,
    VIDEO_SCRIPT,
    WEBM,
    QualityLadder,
    multipart,
    timestamp,
    topic_list,
    video_stream,
    viewer_page,
)
from rwt.media.broadcast import Broadcast, EncoderThreads, Viewer
from rwt.media.encoders.encoded import Encoded, Encoder
from rwt.media.errors import ImageUnreadable, RequestRefused, StreamEnded
from rwt.media.stream_metrics import StreamMetrics
from rwt.media.stream_request import COMPRESSED, RAW, StreamRequest, Video, read_request
from rwt_graph import Graph, Node
from rwt_transports.errors import Refused
from rwt_transports.http.routes import (
    Audience,
    HttpExtension,
    HttpRequest,
    HttpResponse,
    MetricFamily,
    Reader,
    Route,
    page_policy,
)
from rwt_transports.shared_pool import Holder, PoolFull, PoolRow, Share, SharedPool

INFO: Final = "sensor_msgs/CameraInfo"

VIEWERS: Final = PoolRow("viewers of images", "limits.video_viewers", "viewers of images")
ENCODERS: Final = PoolRow("image encoders", "limits.video_encoders", "different image streams")
PIXELS: Final = PoolRow("pixels of videos", "limits.video_pixels", "pixels per image of all videos")

_SMALLER: Final = "`width` and `height` make a video smaller"


class _EncoderShares(NamedTuple):
    """Shares of one encoder. They count to that of its viewers' clients which has fewest encoders."""

    encoder: Share
    pixels: Share


class VisibleTopics:
    """Topics of a graph that one reader may subscribe to.

    The pages of this package have no other access to the graph, so they cannot reveal a hidden topic.
    """

    def __init__(self, graph: Graph, reader: Reader) -> None:
        self._graph = graph
        self.reader = reader

    def of_types(self, *types: str) -> list[str]:
        """Return the topics of some types (two-part names), sorted."""
        return sorted(
            topic.name
            for topic in self._graph.topics()
            if topic.type is not None and topic.type.name in types and self.reader.may_subscribe(topic.name)
        )

    def type_of(self, topic: str) -> str | None:
        """Return the two-part type name of a topic; None if it is hidden, unknown or without a type."""
        info = self._graph.topic(topic) if self.reader.may_subscribe(topic) else None
        return info.type.name if info is not None and info.type is not None else None

    def require(self, topic: str) -> None:
        """Check that the reader may subscribe to a topic, whether it exists or not.

        Raises:
            RequestRefused: the reader may not (403).
        """
        if not self.reader.may_subscribe(topic):
            raise RequestRefused(403, f"you may not subscribe to {topic}")

    def resolve(self, request: StreamRequest) -> StreamRequest | None:
        """Return the request with the topic to subscribe to; None if there is none yet.

        Compressed images have a topic below the raw ones, as in image_transport. It is used on request, and
        if there is no raw topic (where web_video_server shows nothing).

        Raises:
            RequestRefused: the topic has no images (400).
        """
        own = self.type_of(request.topic)
        below = "compressedDepth" if request.transport == "compressedDepth" else "compressed"
        compressed = f"{request.topic}/{below}"
        has_compressed = self.type_of(compressed) == COMPRESSED
        wants_compressed = request.prefers_compressed or request.transport != "raw"
        if has_compressed and (wants_compressed or own is None):
            return replace(request, topic=compressed, transport="raw")
        if own is None:
            return None
        if own not in (RAW, COMPRESSED):
            raise RequestRefused(400, f"{request.topic} is a {own}; pictures are {RAW} and {COMPRESSED}")
        passes_on = request.prefers_compressed and own == COMPRESSED
        return replace(request, transport="raw", prefers_compressed=passes_on)

    def not_found(self, topic: str) -> RequestRefused:
        """Return the error for a missing topic, with the topics that exist."""
        known = ", ".join(self.of_types(RAW, COMPRESSED)) or "none"
        return RequestRefused(404, f"there is no topic {topic}; image topics are: {known}")


NAME: Final = "web_video_server"
#: Seconds to wait for a topic that is not there yet, and for a snapshot's image.
PATIENCE: Final = 5.0
_LOOK_EVERY: Final = 0.1

#: As web_video_server has them: an image of a moment ago must not come from a cache.
_NO_CACHE: Final[Mapping[str, str]] = MappingProxyType(
    {
        "Cache-Control": "no-cache, no-store, must-revalidate, pre-check=0, post-check=0, max-age=0",
        "Pragma": "no-cache",
    }
)

_Page = Callable[[HttpRequest, StreamRequest, VisibleTopics], Awaitable[HttpResponse]]
"""A page that shows the topic of a request, which its reader may see."""


class WebVideoServer:
    """Node that serves image topics over HTTP, with the paths and parameters of web_video_server.

    Args:
        most_viewers: maximum number of viewers, which clients share.
        most_encoders: maximum number of different streams, which clients share.
        most_pixels: maximum sum of the pixels of all different videos, VP9 counted twice; an encoder uses up
            to fifty bytes for each. Clients share it.
        now: returns the seconds of a steady clock in real time, to detect stalled viewers.

    Attributes:
        http: pages, list of image topics and metrics, for :func:`rwt.serve`.
    """

    def __init__(
        self,
        graph: Graph,
        most_viewers: int = 100,
        most_encoders: int = 16,
        most_pixels: int = 1_500_000,
        now: Callable[[], float] = anyio.current_time,
    ) -> None:
        self._node = Node(graph, NAME)
        self._now = now
        self._viewers = SharedPool(VIEWERS, most_viewers)
        self._encoders = SharedPool(ENCODERS, most_encoders)
        self._pixels = SharedPool(PIXELS, most_pixels)
        self._broadcasts: dict[StreamRequest, Broadcast] = {}
        self._encoder_shares: dict[StreamRequest, _EncoderShares] = {}
        self._viewer_shares: dict[Viewer, Share] = {}
        self._stream_metrics = StreamMetrics()
        self._threads = EncoderThreads()
        pages = (("/stream", self._stream), ("/stream_viewer", self._viewer), ("/snapshot", self._snapshot))
        self.http: Final = HttpExtension(
            tuple(Route(path, partial(self._answer, page), Audience.ADMITTED) for path, page in pages),
            self._section,
            self._metrics,
        )

    def close(self) -> None:
        """End every stream, and leave the graph."""
        for broadcast in tuple(self._broadcasts.values()):
            broadcast.end()
        self._node.close()

    async def find(self, stream: StreamRequest, reader: Reader) -> StreamRequest:
        """Return the request with its topic resolved.

        Raises:
            RequestRefused: the topic does not exist, or the reader may not see it.
            Refused: a limit is reached.
        """
        topics = VisibleTopics(self._node.graph, reader)
        topics.require(stream.topic)
        return await self._resolved(stream, topics)

    def watch(self, stream: StreamRequest, reader: Reader, former: Viewer | None = None) -> Viewer:
        """Add a viewer for a request from :meth:`find`, until its `leave`; equal requests share an encoder.

        Args:
            former: viewer that it replaces, and which leaves next.

        Raises:
            Refused: a limit is reached.
        """
        return self._join(reader, stream, former)

    def _section(self, request: HttpRequest, reader: Reader) -> str:
        topics = VisibleTopics(self._node.graph, reader)
        return topic_list(topics.of_types(RAW, COMPRESSED), topics.of_types(INFO), request.query)

    def _metrics(self) -> Iterator[MetricFamily]:
        return self._stream_metrics.families(
            (request.topic, request.type, len(broadcast.listeners))
            for request, broadcast in self._broadcasts.items()
        )

    # -- pages ---------------------------------------------------------------------------------------------

    async def _answer(self, page: _Page, request: HttpRequest, reader: Reader) -> HttpResponse:
        try:
            stream = read_request(request.query)
            topics = VisibleTopics(self._node.graph, reader)
            topics.require(stream.topic)
            return await page(request, stream, topics)
        except RequestRefused as refused:
            return HttpResponse(f"{refused}\n".encode(), refused.status, headers=_NO_CACHE)
        except Refused as refused:
            headers = {**_NO_CACHE, **refused.headers}
            return HttpResponse(f"{refused}\n".encode(), refused.status, headers=headers)

    async def _stream(
        self, request: HttpRequest, stream: StreamRequest, topics: VisibleTopics
    ) -> HttpResponse:
        stream = await self._resolved(stream, topics)
        if not isinstance(stream.coding, Video):
            ladder = QualityLadder(stream, self._now())
            images = multipart(partial(self._join_while_allowed, topics.reader), ladder, self._now)
            return HttpResponse(images, content_type=MULTIPART, headers=_NO_CACHE, is_live=True)
        join = partial(self._join_while_allowed, topics.reader, stream)
        media_type = MP4 if stream.type == "h264" else WEBM
        return HttpResponse(video_stream(join), content_type=media_type, headers=_NO_CACHE, is_live=True)

    async def _viewer(
        self, request: HttpRequest, stream: StreamRequest, topics: VisibleTopics
    ) -> HttpResponse:
        _check_codec(stream)
        video = isinstance(stream.coding, Video)
        page = viewer_page(stream.topic, request.query, video=video)
        headers = {**_NO_CACHE, **page_policy(VIDEO_SCRIPT if video else "")}
        return HttpResponse(page, content_type="text/html; charset=utf-8", headers=headers)

    async def _snapshot(
        self, request: HttpRequest, stream: StreamRequest, topics: VisibleTopics
    ) -> HttpResponse:
        if isinstance(stream.coding, Video):
            raise RequestRefused(400, f"a snapshot is a picture: `type` mjpeg or png, not {stream.type}")
        stream = await self._resolved(stream, topics)
        image = await self._one_image(stream, topics.reader)
        headers = {**_NO_CACHE, "X-Timestamp": timestamp(image)}
        return HttpResponse(image.data, content_type=image.media_type, headers=headers)

    async def _one_image(self, stream: StreamRequest, reader: Reader) -> Encoded:
        viewer, image = self._join(reader, stream), None
        try:
            with anyio.move_on_after(PATIENCE):
                image = await viewer.next()
        finally:
            viewer.leave()
        if image is not None:
            viewer.count_sent(len(image.data))
            return image
        if isinstance(viewer.failure, StreamEnded):
            raise RequestRefused(503, str(viewer.failure))
        if viewer.failure is not None:
            raise RequestRefused(422, f"{stream.topic}: {viewer.failure}")
        raise RequestRefused(504, f"no picture came on {stream.topic} within {PATIENCE:g} s")

    # -- sharing -------------------------------------------------------------------------------------------

    async def _resolved(self, stream: StreamRequest, topics: VisibleTopics) -> StreamRequest:
        _check_codec(stream)
        until = anyio.current_time() + PATIENCE
        while (resolved := topics.resolve(stream)) is None:
            if anyio.current_time() >= until:
                raise topics.not_found(stream.topic)
            await anyio.sleep(_LOOK_EVERY)
        self._check_room(resolved, topics.reader.holder)
        return resolved

    def _check_room(self, stream: StreamRequest, holder: Holder) -> None:
        """Check that there is room for one more viewer of `stream`.

        Raises:
            Refused: a limit is reached.
        """
        self._end_stalled()
        self._viewers.check(holder)
        if stream not in self._broadcasts:
            self._encoders.check(holder)
            if isinstance(stream.coding, Video):
                try:
                    self._pixels.check(holder, _counted(stream, (stream.width or 0) * (stream.height or 0)))
                except PoolFull as full:
                    raise PoolFull(f"{full.reason}; {_SMALLER}") from None

    def _end_stalled(self) -> None:
        """End viewers whose connection accepts nothing, if others need their place."""
        if self._viewers.is_full:
            for viewer in tuple(self._viewer_shares):
                if viewer.has_stalled:
                    viewer.leave()

    def _reserve(self, stream: StreamRequest, pixels: int) -> None:
        """Reserve pixels for a video whose size the encoder has learned from its first image.

        Runs in the thread of the encoder.

        Raises:
            ImageUnreadable: the videos together would exceed `limits.video_pixels`.
        """
        anyio.from_thread.run_sync(self._reserve_now, stream, _counted(stream, pixels))

    def _reserve_now(self, stream: StreamRequest, pixels: int) -> None:
        shares = self._encoder_shares.get(stream)
        if shares is None:
            return  # All viewers have left meanwhile.
        try:
            self._pixels.grow(shares.pixels, pixels)
        except PoolFull as full:
            raise ImageUnreadable(f"{full.reason}; {_SMALLER}") from None

    def _join(self, reader: Reader, stream: StreamRequest, former: Viewer | None = None) -> Viewer:
        """Add a viewer, with the share of the former one if it replaces one. Raises Refused."""
        share = None if former is None else self._viewer_shares.get(former)
        if share is None:
            self._end_stalled()
        taken = share or self._viewers.take(reader.holder, _ignore)
        try:
            broadcast = self._broadcasts.get(stream) or self._begin(stream, reader.holder)
        except BaseException:
            if share is None:
                self._viewers.release(taken)
            raise
        viewer = broadcast.join(reader.work)
        if former is not None:
            self._viewer_shares.pop(former, None)
        taken.end = viewer.cut
        self._viewer_shares[viewer] = taken
        viewer.when_ended = partial(self._left, stream, viewer)
        self._count_encoder(stream)
        return viewer

    def _begin(self, stream: StreamRequest, holder: Holder) -> Broadcast:
        """Start the encoder of a stream. Raises Refused."""
        displace = partial(self._displace, stream)
        shares = _EncoderShares(self._encoders.take(holder, displace), self._pixels.take(holder, displace, 0))
        self._encoder_shares[stream] = shares
        try:
            broadcast = self._broadcasts[stream] = Broadcast(
                self._node,
                stream,
                partial(_make_encoder, stream, partial(self._reserve, stream)),
                self._threads,
                self._stream_metrics.of(stream.topic, stream.type),
                partial(self._ended, stream),
                self._now,
            )
        except BaseException:
            self._ended(stream)
            raise
        return broadcast

    def _ended(self, stream: StreamRequest) -> None:
        self._broadcasts.pop(stream, None)
        shares = self._encoder_shares.pop(stream, None)
        if shares is not None:
            self._encoders.release(shares.encoder)
            self._pixels.release(shares.pixels)

    def _displace(self, stream: StreamRequest, reason: str) -> None:
        broadcast = self._broadcasts.get(stream)
        if broadcast is not None:
            broadcast.end(StreamEnded(reason))

    def _left(self, stream: StreamRequest, viewer: Viewer) -> None:
        share = self._viewer_shares.pop(viewer, None)
        if share is not None:
            self._viewers.release(share)
        self._count_encoder(stream)

    def _count_encoder(self, stream: StreamRequest) -> None:
        """Count an encoder to that of its viewers' clients which has fewest: another one cannot lose it."""
        broadcast, shares = self._broadcasts.get(stream), self._encoder_shares.get(stream)
        if broadcast is None or shares is None:
            return
        present = shares.encoder.holder
        holders = {
            share.holder: self._encoders.held(share.holder) - (share.holder == present)
            for viewer in broadcast.listeners
            if (share := self._viewer_shares.get(viewer)) is not None
        }
        if holders:
            fewest = min(holders, key=lambda holder: (holders[holder], holder != present))
            self._encoders.move(shares.encoder, fewest)
            self._pixels.move(shares.pixels, fewest)

    def _join_while_allowed(
        self, reader: Reader, stream: StreamRequest, former: Viewer | None = None
    ) -> Viewer:
        viewer = self._join(reader, stream, former)
        try:
            end = reader.while_allowed((stream.topic,), viewer.cut)
        except Refused as refused:
            viewer.cut(refused.reason)
            return viewer

        def ended() -> None:
            end()
            self._left(stream, viewer)

        viewer.when_ended = ended
        return viewer


def _ignore(reason: str) -> None:
    """No-op: end of a share whose viewer is just being added."""


def _counted(stream: StreamRequest, pixels: int) -> int:
    """Return the pixels that a video counts as; twice for VP9, since its encoder uses twice the memory."""
    return 2 * pixels if stream.type == "vp9" else pixels


def _check_codec(stream: StreamRequest) -> None:
    if isinstance(stream.coding, Video) and importlib.util.find_spec("av") is None:
        raise RequestRefused(
            501,
            f"{stream.type} needs PyAV on the server: pip install 'robot-web-tools[video]';"
            " mjpeg and png need nothing",
        )


def _make_encoder(stream: StreamRequest, reserve: Callable[[int], None]) -> Encoder:
    """Create the encoder of a request. Runs in a worker thread, because it loads libraries."""
    if isinstance(stream.coding, Video):
        from rwt.media.encoders.video import VideoEncoder

        return VideoEncoder(stream, stream.coding, reserve)
    from rwt.media.encoders.image import ImageEncoder

    return ImageEncoder(stream, stream.coding)
