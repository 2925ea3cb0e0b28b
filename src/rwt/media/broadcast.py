"""Broadcast of an image topic: one encoder for equal requests, and a queue of images for each viewer.

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
from typing import Any, Final, Generic, TypeVar

import anyio
import anyio.to_thread

from rwt.media.encoders.encoded import Encoded, Encoder
from rwt.media.errors import StreamEnded, VideoError
from rwt.media.stream_metrics import Counts
from rwt.media.stream_request import COMPRESSED, RAW, StreamRequest
from rwt_graph import Node
from rwt_graph.api import Sample
from rwt_interfaces.payload import Payload
from rwt_participant.handles import Handle
from rwt_protocol.states import StateEnum
from rwt_transports.http.routes import WorkAccount

T = TypeVar("T")

logger = logging.getLogger("rwt.media")

#: Images of a video that may wait for a viewer. An image by itself never waits: the next replaces it.
_MOST_WAITING: Final = 4
#: Age of a queued frame above which a viewer continues at a new key frame.
_LATE_SECONDS: Final = 0.3
#: Seconds without room for an image after which a viewer may be replaced by another.
STALLED_SECONDS: Final = 5.0
#: Minimum seconds between key frames for slow viewers: they are large, and every viewer gets them.
_KEY_PAUSE_SECONDS: Final = 0.5


class Listener(Generic[T]):
    """Queue of what an encoder makes, for one of its clients.

    Args:
        most: maximum length of the queue, of which the newest item replaces the oldest.

    Attributes:
        work: account to which its share of the encoder's work is charged.
        failure: reason why the stream ended; None if it did not fail.
        when_ended: called once when the stream has ended.
    """

    def __init__(self, work: WorkAccount, leave: Callable[[Any], None], most: int | None = None) -> None:
        self.work = work
        self.failure: VideoError | None = None
        self.when_ended: Callable[[], None] | None = None
        self._leave = leave
        self._waiting: deque[T] = deque(maxlen=most)
        self._woken = anyio.Event()
        self._over = False

    def put(self, item: T) -> None:
        """Queue an item."""
        self._waiting.append(item)
        self._woken.set()

    async def next(self) -> T | None:
        """Wait for the next item; None at the end of the stream."""
        while not self._waiting:
            if self._over:
                return None
            await self._woken.wait()
            self._woken = anyio.Event()
        return self._waiting.popleft()

    def leave(self) -> None:
        """Leave the stream."""
        self._leave(self)

    def end(self, failure: VideoError | None = None) -> None:
        """End the stream after the queued items."""
        if not self._over:
            self.failure = failure
            self._over = True
            self._woken.set()
            if self.when_ended is not None:
                self.when_ended()


AnyListener = TypeVar("AnyListener", bound=Listener[Any])


class _StreamState(StateEnum):
    STARTING = "RUNNING", "ENDED"
    RUNNING = "ENDED"
    ENDED = ()


class SharedStream(Generic[AnyListener]):
    """Stream of an encoder, until the last listener leaves.

    Life cycle::

        STARTING ── first result ──> RUNNING ── end() ──> ENDED
           └──────────────── end() ───────────────────────^

    * **STARTING**: nothing has been encoded. A message that cannot be decoded ends the stream: its topic has
      the wrong format.
    * **RUNNING**: something has been encoded.
    * **ENDED**: the subscriptions are closed. A worker thread may still be encoding.

    Args:
        on_end: called once when the last listener has left, or when the stream has failed.

    Attributes:
        listeners: present listeners.
    """

    def __init__(self, on_end: Callable[[], object]) -> None:
        self.listeners: list[AnyListener] = []
        self._on_end = on_end
        self._subscriptions: tuple[Handle, ...] = ()
        self._woken = anyio.Event()
        self._state = _StreamState.STARTING

    @property
    def is_over(self) -> bool:
        """True once the stream has ended."""
        return self._state is _StreamState.ENDED

    def note_encoded(self) -> None:
        """Note that a message was encoded: the first one begins the stream."""
        if self._state is _StreamState.STARTING:
            self._state = self._state.become(_StreamState.RUNNING)

    def leave(self, listener: AnyListener) -> None:
        """Remove a listener; the last one stops the encoder and the subscriptions."""
        if listener in self.listeners:
            self.listeners.remove(listener)
            listener.end()
            if not self.listeners:
                self.end()

    def end(self, failure: VideoError | None = None) -> None:
        """Stop, and end every listener's stream."""
        if self.is_over:
            return
        self._state = self._state.become(_StreamState.ENDED)
        for subscription in self._subscriptions:
            subscription.close()
        for listener in self.listeners:
            listener.end(failure)
        self._on_end()
        self.wake()

    def wake(self) -> None:
        """Wake the encoder's task: there is a new message, a new listener or room in a queue."""
        self._woken.set()


class Viewer(Listener["Encoded"]):
    """Short queue of images for one viewer; a key frame replaces all others.

    Attributes:
        bitrate: bits per second that its link carries; None if unknown.
    """

    def __init__(self, broadcast: Broadcast, work: WorkAccount) -> None:
        super().__init__(work, broadcast.leave)
        self._broadcast = broadcast
        self._begun = False  # what cannot be shown by itself makes no sense before a key frame
        self._handed_over: float | None = None  # when the viewer's connection was given an image to send
        self.bitrate: int | None = None

    @property
    def can_accept(self) -> bool:
        """True if an image encoded now would not be queued behind old ones."""
        waiting = self._waiting
        return not waiting or (waiting[-1].track is not None and len(waiting) < _MOST_WAITING)

    def put(self, image: Encoded) -> None:
        """Queue an image, or drop what does not fit in the queue."""
        if image.key:
            self._drop(len(self._waiting))
            self._begun = True
        elif not self._begun or len(self._waiting) >= _MOST_WAITING:
            # Frames after a gap cannot be decoded: drop the rest of the queue, too.
            self._drop(len(self._waiting) + 1)
            self._begun = False
            self._broadcast.ask_for_key()
            return
        super().put(image)

    def _drop(self, count: int) -> None:
        self._waiting.clear()
        self._broadcast.counts.dropped += count

    async def next(self) -> Encoded | None:
        """Wait for the next image; None at the end of the stream."""
        self._handed_over = None
        image = await super().next()
        if image is not None:
            self._handed_over = self._broadcast.now()
            self._broadcast.wake()
        return image

    def skip_late(self) -> None:
        """Drop queued images if the first is old, and continue at a new key frame."""
        if self._waiting and self._broadcast.now() - self._waiting[0].at_ms / 1000 > _LATE_SECONDS:
            self._drop(len(self._waiting))
            self._begun = False
            self._broadcast.ask_for_key(at_once=len(self._broadcast.listeners) == 1)

    def count_sent(self, octets: int) -> None:
        """Count an image that was sent, in so many bytes."""
        self._broadcast.counts.sent += 1
        self._broadcast.counts.sent_bytes += octets

    def ask_for_key(self) -> None:
        """Request a key frame, after images were lost."""
        self._broadcast.ask_for_key()

    @property
    def has_stalled(self) -> bool:
        """True if the network has not accepted an image for a long time."""
        return self._handed_over is not None and self._broadcast.now() - self._handed_over >= STALLED_SECONDS

    def cut(self, reason: str) -> None:
        """End the stream now, without the queued images."""
        logger.info("a viewer of %s is sent nothing more: %s", self._broadcast.request.topic, reason)
        self._waiting.clear()
        self.end(StreamEnded(reason))
        self.leave()


class EncoderThreads:
    """Worker threads of encoders, one per core; work of viewers over their rate runs one at a time."""

    def __init__(self) -> None:
        self._limiter = anyio.CapacityLimiter(max(1, os.cpu_count() or 1))
        self._beyond_rate = anyio.Lock()

    async def run(self, encode: Callable[[], T], viewers: Sequence[WorkAccount]) -> T:
        """Run `encode` in a thread, and charge its CPU time to the viewers in equal parts."""
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


class _KeyFrames:
    """Requests for key frames of one video; the first frame is one.

    Args:
        now: seconds of a steady clock.
    """

    __slots__ = ("_is_asked", "_is_wanted", "_sent_at")

    def __init__(self, now: float) -> None:
        self._is_wanted = True
        self._is_asked = False
        self._sent_at = now

    def want(self) -> None:
        """Make the next frame a key frame."""
        self._is_wanted = True

    def ask(self) -> None:
        """Make a frame a key frame soon: many requests share one, since every viewer gets it."""
        self._is_asked = True

    def take(self, now: float) -> bool:
        """Return True if the next frame is a key frame; the requests are used up."""
        key = self._is_wanted or (self._is_asked and now >= self._sent_at + _KEY_PAUSE_SECONDS)
        if key:
            self._is_wanted = self._is_asked = False
        return key

    def note_sent(self, now: float) -> None:
        """Note that a key frame was sent to the viewers."""
        self._sent_at = now


class Broadcast(SharedStream[Viewer]):
    """Subscription, encoder and images shared by equal requests; :class:`SharedStream` has its life cycle.

    A task encodes while a message is new and a viewer has room; it is woken by :meth:`wake`.

    Attributes by purpose:

    * Messages: ``_newest`` (not encoded yet; the next message replaces it), ``_last``
      (encoded).
    * Images: ``_encoder`` (created with the first message), ``_shown`` (the last image).
    * Key frames of a video: ``_key_frames``.

    Args:
        request: request of the viewers, with the topic to subscribe to.
        make_encoder: creates the encoder, in a worker thread since it loads libraries.
        now: returns the seconds of a steady clock. Real time, as for the viewers, whatever clock the robot
            has.
    """

    def __init__(
        self,
        node: Node,
        request: StreamRequest,
        make_encoder: Callable[[], Encoder],
        threads: EncoderThreads,
        counts: Counts,
        on_end: Callable[[], object],
        now: Callable[[], float],
    ) -> None:
        super().__init__(on_end)
        self.request = request
        self.counts = counts
        self.now = now
        self._log = node.log
        self._make_encoder = make_encoder
        self._encoder: Encoder | None = None
        self._threads = threads
        self._newest: Payload | None = None
        self._last: Payload | None = None
        self._shown: Encoded | None = None
        self._key_frames = _KeyFrames(now())
        node.graph.spawn(self._run, f"pictures of {request.topic}")
        # Last: retained samples arrive at once.
        self._subscriptions = (node.subscribe_samples(request.topic, qos=request.qos, on_sample=self._take),)

    def join(self, work: WorkAccount) -> Viewer:
        """Add a viewer, which receives the last image at once if there is one."""
        viewer = Viewer(self, work)
        self.listeners.append(viewer)
        if self._shown is not None and self._shown.track is None:
            viewer.put(self._shown)
        elif self._last is not None:
            # A video starts at a key frame, and the topic may be silent: encode the last message again.
            self._key_frames.want()
            self._newest = self._newest or self._last
        self.wake()
        return viewer

    def ask_for_key(self, *, at_once: bool = False) -> None:
        """Request a key frame for a viewer that lost images; it is delayed, since every viewer gets it."""
        self._key_frames.ask()
        if at_once:
            self._key_frames.want()
        self.wake()

    def _take(self, sample: Sample) -> None:
        """Store a message, in place of one that was not encoded for lack of room."""
        # Subscribed without a type, which would hold the topic's against the robot: viewers choose the topic.
        name = sample.payload.type.name
        if name not in (RAW, COMPRESSED):
            self.end(VideoError(f"{sample.topic} is a {name} now; pictures are {RAW} and {COMPRESSED}"))
            return
        if self._newest is not None:
            self.counts.skipped += 1
        self._newest = sample.payload.detach()
        self.wake()

    async def _run(self) -> None:
        try:
            await self._make_images()
        finally:
            # Now, not at garbage collection: an encoder may hold a hundred megabytes.
            self._encoder = self._newest = self._last = self._shown = None

    async def _make_images(self) -> None:
        while not self.is_over:
            payload = self._newest
            if payload is None or not any(viewer.can_accept for viewer in self.listeners):
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
        """Count an image that cannot be decoded.

        Cameras send some now and then, so only one before the first image ends the stream.
        """
        self.counts.failed += 1
        if self.counts.complaint != str(error):
            # Once: viewers that reconnect repeatedly must not fill the log.
            self.counts.complaint = str(error)
            self._log.warning(f"{self.request.topic}: {error}")
        if self._state is _StreamState.STARTING:
            self.end(error)

    async def _encode(self, payload: Payload) -> Encoded | None:
        now = self.now()
        key, at_ms = self._key_frames.take(now), int(now * 1000)
        bitrate = min((each.bitrate for each in self.listeners if each.bitrate is not None), default=None)

        def work() -> Encoded | None:
            if self._encoder is None:
                self._encoder = self._make_encoder()
            if bitrate is not None:
                self._encoder.bitrate = bitrate
            return self._encoder.encode(payload, at_ms, key=key)

        encoded = await self._threads.run(work, tuple(viewer.work for viewer in self.listeners))
        if encoded is None and key:
            self._key_frames.want()
        return encoded

    def _show(self, image: Encoded | None) -> None:
        if image is None:
            self.counts.skipped += 1
            return
        self.counts.encoded += 1
        self.note_encoded()
        self._shown = image
        if image.key:
            self._key_frames.note_sent(self.now())
        for viewer in tuple(self.listeners):
            viewer.put(image)
