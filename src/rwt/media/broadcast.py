"""One encoder for equal requests, and a queue of images for each viewer.

An image is encoded only when a viewer has room for it, in a worker thread, and once. Messages that cannot
be encoded yet do not queue: the latest replaces the one before. So a slow viewer gets fewer images, none of
them old; and without viewers nothing is encoded and nothing is subscribed to.
"""

from __future__ import annotations

import logging
import os
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Final, TypeVar

import anyio
import anyio.to_thread

from rwt.media.errors import VideoError

if TYPE_CHECKING:
    from rwt.media.encoders.encoded import Encoded, Encoder
    from rwt.media.stream_metrics import Counts
    from rwt.media.stream_request import StreamRequest
    from rwt_graph import Node
    from rwt_graph.api import Sample
    from rwt_interfaces.payload import Payload
    from rwt_transports.http.routes import Work

T = TypeVar("T")

logger = logging.getLogger("rwt.nodes.video")

#: Images of a video that may wait for a viewer. An image by itself never waits: the next replaces it.
_MOST_WAITING: Final = 4
#: Seconds without room for an image after which a viewer has to make place for another.
STALLED_SECONDS: Final = 5.0
#: Seconds from one key frame for a slow viewer to the next; they are large, and every viewer gets them.
_KEY_PAUSE: Final = 0.5


class Viewer:
    """A viewer's queue of images: short, and a key frame takes the place of all others.

    Attributes:
        work: to which its share of the encoder's work is charged.
        failure: why there are no more images; None while there may be some.
        when_ended: called once when it has ended; None: nobody wants to know.
    """

    def __init__(self, broadcast: Broadcast, work: Work) -> None:
        self._broadcast = broadcast
        self.work = work
        self._waiting: deque[Encoded] = deque()
        self._begun = False  # what cannot be shown by itself makes no sense before a key frame
        self._woken = anyio.Event()
        self._over = False
        self._handed_over: float | None = None  # when the viewer's connection was given an image to send
        self.failure: VideoError | None = None
        self.when_ended: Callable[[], None] | None = None

    @property
    def can_accept(self) -> bool:
        """Whether an image that is made now would not have to wait behind old ones."""
        waiting = self._waiting
        return not waiting or (waiting[-1].track is not None and len(waiting) < _MOST_WAITING)

    def put(self, image: Encoded) -> None:
        """Queue an image, or drop what the viewer has no room for."""
        if image.key:
            self._drop(len(self._waiting))
            self._begun = True
        elif not self._begun or len(self._waiting) >= _MOST_WAITING:
            # What follows a gap cannot be decoded, so the rest of the queue is of no use either.
            self._drop(len(self._waiting) + 1)
            self._begun = False
            self._broadcast.ask_for_key()
            return
        self._waiting.append(image)
        self._woken.set()

    def _drop(self, count: int) -> None:
        self._waiting.clear()
        self._broadcast.counts.dropped += count

    async def next(self) -> Encoded | None:
        """The next image, waiting for it; None when there will be no more."""
        self._handed_over = None
        while not self._waiting:
            if self._over:
                return None
            await self._woken.wait()
            self._woken = anyio.Event()
        image = self._waiting.popleft()
        self._handed_over = self._broadcast.now()
        self._broadcast.wake()
        return image

    def count_sent(self, image: Encoded) -> None:
        """Count an image that was handed to the network."""
        self._broadcast.counts.sent += 1
        self._broadcast.counts.sent_bytes += len(image.data)

    def ask_for_key(self) -> None:
        """Ask for an image that can be shown without any other, since some did not arrive."""
        self._broadcast.ask_for_key()

    @property
    def has_stalled(self) -> bool:
        """Whether the network has not taken one image for a long time."""
        return self._handed_over is not None and self._broadcast.now() - self._handed_over >= STALLED_SECONDS

    def leave(self) -> None:
        """Leave the broadcast."""
        self._broadcast.leave(self)

    def cut(self, reason: str) -> None:
        """End the stream at once, without what is queued."""
        logger.info("a viewer of %s is sent nothing more: %s", self._broadcast.request.topic, reason)
        self._waiting.clear()
        self.leave()

    def end(self, failure: VideoError | None = None) -> None:
        """End the stream after the images that are queued already."""
        if not self._over:
            self.failure = failure
            self._over = True
            self._woken.set()
            if self.when_ended is not None:
                self.when_ended()


class EncoderThreads:
    """Where images are made: a thread for each core, since more would only take turns, and one for all
    those that are only made for viewers beyond their rate of work."""

    def __init__(self) -> None:
        self._limiter = anyio.CapacityLimiter(max(1, os.cpu_count() or 1))
        self._beyond_rate = anyio.Lock()

    async def run(self, encode: Callable[[], T], viewers: Sequence[Work]) -> T:
        """Run `encode` in a thread, and charge the processor's time to the viewers in equal parts.

        Raises what `encode` raises.
        """
        seconds = 0.0

        def work() -> T:
            nonlocal seconds
            began = time.thread_time()
            try:
                return encode()
            finally:
                seconds = time.thread_time() - began

        try:
            if viewers and all(viewer.excess for viewer in viewers):
                async with self._beyond_rate:
                    return await anyio.to_thread.run_sync(work, limiter=self._limiter)
            return await anyio.to_thread.run_sync(work, limiter=self._limiter)
        finally:
            for viewer in viewers:
                viewer.add(seconds / len(viewers), "pictures")


class Broadcast:
    """What equal requests share: the subscription, the encoder and the images.

    Args:
        node: whose subscription it is.
        request: what is wanted, of the very topic to subscribe to.
        make_encoder: makes the encoder, in a worker thread: it loads libraries.
        threads: the worker threads that all broadcasts share.
        counts: what is counted.
        on_end: called once when the last viewer has left, or when there is nothing to see.
        now: seconds that never go back. Real time, as viewers have it, whatever clock the robot has.

    Attributes:
        now: as given.
        viewers: everyone who watches.
        pixels: of one image of the video, once its encoder is there; 0 for images by themselves.
    """

    def __init__(
        self,
        node: Node,
        request: StreamRequest,
        make_encoder: Callable[[], Encoder],
        threads: EncoderThreads,
        counts: Counts,
        on_end: Callable[[Broadcast], None],
        now: Callable[[], float],
    ) -> None:
        self.request = request
        self.counts = counts
        self.viewers: list[Viewer] = []
        self.pixels = 0
        self.now = now
        self._log = node.log
        self._make_encoder = make_encoder
        self._encoder: Encoder | None = None
        self._threads = threads
        self._on_end = on_end
        self._newest: Payload | None = None  # not encoded yet
        self._last: Payload | None = None  # encoded
        self._shown: Encoded | None = None
        self._key_wanted = True
        self._key_asked = False
        self._key_at = now()
        self._woken = anyio.Event()
        self._over = False
        node.graph.spawn(self._run, f"pictures of {request.topic}")
        # Last: what is kept for late joiners comes at once.
        self._subscription = node.subscribe_samples(request.topic, qos=request.qos, on_sample=self._take)

    def join(self, work: Work) -> Viewer:
        """A new viewer, who gets the last image at once if there is one.

        Args:
            work: what its share of the encoder's work is charged to.
        """
        viewer = Viewer(self, work)
        self.viewers.append(viewer)
        if self._shown is not None and self._shown.track is None:
            viewer.put(self._shown)
        elif self._last is not None:
            # A video is entered at a key frame, and the topic may be silent: the last one is made again.
            self._key_wanted = True
            self._newest = self._newest or self._last
        self.wake()
        return viewer

    def leave(self, viewer: Viewer) -> None:
        """The last viewer who leaves stops the encoder and the subscription."""
        if viewer in self.viewers:
            self.viewers.remove(viewer)
            viewer.end()
            if not self.viewers:
                self.end()

    def end(self, failure: VideoError | None = None) -> None:
        """Stop, and let every viewer go."""
        if self._over:
            return
        self._over = True
        self._subscription.close()
        for viewer in self.viewers:
            viewer.end(failure)
        self._on_end(self)
        self.wake()

    def wake(self) -> None:
        """Wake the encoder's task: a message, a viewer or room in a queue is new."""
        self._woken.set()

    def ask_for_key(self) -> None:
        """Ask for a key frame for a viewer who lost some, soon but not at once: it costs every viewer."""
        self._key_asked = True

    def _takes_key(self, now: float) -> bool:
        """Whether the next image is a key frame."""
        key = self._key_wanted or (self._key_asked and now >= self._key_at + _KEY_PAUSE)
        if key:
            self._key_wanted = self._key_asked = False
        return key

    def _take(self, sample: Sample) -> None:
        """Take a message; it replaces one that was not encoded for lack of room."""
        if self._newest is not None:
            self.counts.skipped += 1
        self._newest = sample.payload.detach()
        self.wake()

    async def _run(self) -> None:
        try:
            await self._make_images()
        finally:
            # Here and not when garbage is collected: an encoder may hold a hundred megabytes.
            self._encoder = self._newest = self._last = self._shown = None

    async def _make_images(self) -> None:
        while not self._over:
            payload = self._newest
            if payload is None or not any(viewer.can_accept for viewer in self.viewers):
                await self._woken.wait()
                self._woken = anyio.Event()
                continue
            self._newest, self._last = None, payload
            try:
                encoded = await self._encode(payload)
            except VideoError as error:
                self._unreadable(error)
            except Exception:
                logger.exception("the pictures of %s could not be encoded", self.request.topic)
                self.counts.failed += 1
                self.end(VideoError("internal error"))
            else:
                self._show(encoded)

    def _unreadable(self, error: VideoError) -> None:
        """Count an unreadable image. Cameras send some now and then; after a first one the stream ends."""
        self.counts.failed += 1
        if self.counts.complaint != str(error):
            # Once: viewers who come again and again must not fill the log.
            self.counts.complaint = str(error)
            self._log.warning(f"{self.request.topic}: {error}")
        if self._shown is None:
            self.end(error)

    async def _encode(self, payload: Payload) -> Encoded | None:
        now = self.now()
        key, at_ms = self._takes_key(now), int(now * 1000)

        def work() -> Encoded | None:
            if self._encoder is None:
                self._encoder = self._make_encoder()
            return self._encoder.encode(payload, at_ms, key=key)

        encoded = await self._threads.run(work, tuple(viewer.work for viewer in self.viewers))
        if encoded is None and key:
            self._key_wanted = True
        return encoded

    def _show(self, image: Encoded | None) -> None:
        if image is None:
            self.counts.skipped += 1
            return
        self.counts.encoded += 1
        self._shown = image
        if image.key:
            self._key_at = self.now()
        for viewer in tuple(self.viewers):
            viewer.put(image)
