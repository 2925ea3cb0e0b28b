"""Fan-out of samples: encode once per topic, encoding and spelling of the name; send to many clients."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from functools import partial
from typing import Final, Generic, Protocol, TypeVar

from rwt.delivery.counters import EncodingCounts, TopicCounts
from rwt.delivery.feed_members import FeedMembers
from rwt.delivery.throttle import Deliverable, Throttle
from rwt_graph.api import Sample, Subscription
from rwt_graph.clock import Clock
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.payload import Form
from rwt_interfaces.structs import MessageType
from rwt_protocol.codecs import Encoding
from rwt_protocol.frames import Burst, Frame
from rwt_transports.endpoint import Feed, Membership
from rwt_transports.scheduler import Scheduler

logger = logging.getLogger(__name__)

S = TypeVar("S", bound=Deliverable)

OnEnd = Callable[[str], None]
"""Function that ends a subscription for a reason, which it passes on to the subscriber."""

_MAX_DEFERRED: Final = 8
"""Maximum number of deferred samples per topic; beyond it, the oldest is encoded at once, or dropped if
another program sends them."""


class DeferredSamples:
    """Samples of one topic to send, each after the steps that prepare it, in the order in which they were
    added.

    The scheduler takes the steps. A program that causes them can take them with :meth:`steps` instead, so
    that they are its work and delay only it.

    Private attributes: ``_is_running`` is True from :meth:`add` until the scheduler has taken the last step.
    ``_added`` and ``_sent`` count samples, dropped ones included; their difference is what waits.

    Attributes:
        waiting: steps and send function of each deferred sample; read-only.
    """

    __slots__ = ("_added", "_has_failed", "_is_running", "_scheduler", "_sent", "waiting")

    def __init__(self, scheduler: Scheduler) -> None:
        self._scheduler = scheduler
        self.waiting: deque[tuple[Iterator[None], Callable[[], None]]] = deque()
        self._added = self._sent = 0
        self._has_failed = self._is_running = False

    def add(self, steps: Iterator[None], send: Callable[[], None]) -> None:
        """Call `send` after `steps` and all queued samples: before this returns, if that is
        fast."""
        self.waiting.append((steps, send))
        self._added += 1
        if not self._is_running:
            self._is_running = True
            self._scheduler.run(self._run())

    def steps(self) -> Iterator[None]:
        """Run the steps of all samples queued now, and send them."""
        last = self._added
        while self._sent < last and self.waiting:
            self._step()
            yield

    def finish_first(self) -> None:
        """Prepare and send the oldest sample now."""
        sent = self._sent
        while self._sent == sent and self.waiting:
            self._step()

    def drop_second(self) -> None:
        """Drop the oldest sample of which no step was taken."""
        # Not the first: its steps have begun, so its payload is in the middle of a conversion.
        del self.waiting[1]
        self._sent += 1

    def clear(self) -> None:
        """Drop all queued samples."""
        self.waiting.clear()
        self._sent = self._added

    def _step(self) -> object:
        """Take one step of the oldest sample, and send it after the last. Returns what is done with it."""
        steps, send = self.waiting[0]
        try:
            for _ in steps:
                return None
            self.waiting.popleft()
            self._sent += 1
            send()
        except Exception as error:
            if not isinstance(error, InvalidMessage):
                logger.exception("a sample could not be sent")
            elif not self._has_failed:
                self._has_failed = True  # A robot may send many such messages.
                logger.warning("samples that do not fit their type are not sent, such as one with %s", error)
            # A step raised: the sample is still queued. After a failed send, it is not.
            if self.waiting and self.waiting[0][0] is steps:
                self.waiting.popleft()
                self._sent += 1
        return steps, send

    def _run(self) -> Iterator[None]:
        while self.waiting:
            done = self._step()
            yield
            # Freed in a step of its own: for half a million numbers, that takes milliseconds.
            if done is not None:
                del done
                yield
        self._is_running = False


class _EncodedSample(Generic[S]):
    """Sample that is encoded on first use; the frame is shared by all throttles of the stream."""

    __slots__ = ("_frame", "_stream", "sample")

    def __init__(self, stream: EncodedStream[S], sample: S, frame: Frame | None = None) -> None:
        self._stream = stream
        self._frame = frame
        self.sample = sample

    def frame(self) -> Frame:
        if self._frame is None:
            self._frame = self._stream.encode(self.sample)
        counts = self._stream.counts
        counts.messages += 1
        counts.bytes += self._frame.size
        return self._frame

    def send(self, take: Callable[[Frame], None]) -> None:
        """Pass the frame to `take`: now if encoding is fast and no sample of the topic is deferred, otherwise
        in turn."""
        late = self._stream.late
        if late.waiting or (self._frame is None and self._stream.is_slow(self.sample)):
            # Behind deferred samples, even if this one is encoded: samples of a topic never change places.
            late.add(self._stream.prepare(self.sample), lambda: take(self.frame()))
        else:
            take(self.frame())


class EncodedStream(Generic[S]):
    """Clients of one topic that receive identical frames: same encoding, same spelling of the topic name.

    Clients see the name under which they subscribed (PUB-09), so `chatter` and `/chatter` are two streams. In
    protocols where clients number their subscriptions, the frame has a gap for the number
    (:class:`~rwt_protocol.frames.GapFrame`), which is filled in for each client.

    Each subscription has a throttle. They are of two kinds:

    * **open** throttles pass every sample. Frames go straight to their senders, and the frames of one turn of
      the event loop share a :class:`~rwt_protocol.frames.Burst`.
    * **limiting** throttles decide for each sample (:meth:`Throttle.offer`). The frame is encoded when the
      first one needs it.

    Clients behind one line (:class:`~rwt_transports.endpoint.FeedFlow`) are members of a feed, and have one
    throttle in common.

    Attributes by purpose:

    * Feeds: ``_own`` (throttles of clients with a line of their own), ``_memberships``, ``_members`` (by
      feed), ``_waiting`` (members that must not get the samples being deferred).
    * Throttles: ``_throttles`` (all that samples are offered to), ``_direct`` (``join`` and ``send`` of the
      open ones), ``_limiting`` (the others), ``_open_since`` (for each open throttle, the value of
      ``_sendings`` when it opened).
    * Burst: ``_burst`` (collects frames now; None if no throttle joined it), ``_apart`` (senders of the open
      throttles outside it).
    * Counters: ``_encoded`` and ``_encoded_bytes`` (through open throttles, since the last :meth:`settle`),
      ``_sendings`` (all before that), ``_sent_at`` (monotonic time of the last one).

    Attributes:
        counts: totals of this topic and encoding, shared with the topic's other streams of the encoding. Up
            to date after :meth:`settle`.
        steps: does the slow part of encoding a sample; None if encoding is fast, and the encoder has no
            generator `steps(sample)`.
        late: queue of samples whose encoding is deferred, shared by all streams of the topic.
    """

    def __init__(
        self,
        encode: Callable[[S], Frame],
        counts: EncodingCounts,
        clock: Clock,
        late: DeferredSamples,
        form: Form = "json",
    ) -> None:
        self._encode = encode
        self.late = late
        self.steps: Callable[[S], Iterator[None]] | None = getattr(encode, "steps", None)
        self._clock = clock
        self._monotonic = clock.monotonic
        self._sent_at = float("-inf")
        self._open_since: dict[Throttle, int] = {}
        self._sendings = 0
        self.counts = counts
        self.form = form
        self._own: list[Throttle] = []
        self._memberships: dict[Throttle, Membership] = {}
        self._members: dict[Feed, FeedMembers] = {}
        self._waiting: set[Throttle] = set()
        self._throttles: tuple[Throttle, ...] = ()
        self._direct: tuple[tuple[Callable[[Burst], bool], Callable[[Frame], None]], ...] = ()
        self._burst: Burst | None = None
        self._apart: list[Callable[[Frame], None]] = []
        self._limiting: tuple[Throttle, ...] = ()
        self._encoded = 0
        self._encoded_bytes = 0

    def __len__(self) -> int:
        return len(self._own) + len(self._memberships)

    @property
    def is_open(self) -> bool:
        """True if there is an open throttle, so that every sample is encoded."""
        return bool(self._direct)

    def add(self, throttle: Throttle) -> None:
        """Add a throttle, effective from the next sample."""
        membership = throttle.enter(self)
        if membership is None:
            self._own.append(throttle)
            self.arrange()
            return
        self._memberships[throttle] = membership
        if self.late.waiting:
            self._waiting.add(throttle)
        self.changed(throttle)

    def remove(self, throttle: Throttle) -> None:
        """Remove a throttle."""
        membership = self._memberships.pop(throttle, None)
        if membership is None:
            self._own.remove(throttle)
        else:
            self._waiting.discard(throttle)
            members = self._members[membership.feed]
            members.remove(throttle)
            if not members:
                del self._members[membership.feed]
        self.arrange()

    def changed(self, throttle: Throttle) -> None:
        """Apply the new configuration of a throttle."""
        membership = self._memberships.get(throttle)
        if membership is not None:
            members = self._members.get(membership.feed)
            if members is None:
                members = self._members[membership.feed] = FeedMembers(membership.feed, self._clock)
            members.put(throttle, membership, waits=throttle in self._waiting)
        self.arrange()

    def _let_in(self) -> None:
        """Let members have the common samples, who had to wait for older ones."""
        waiting, self._waiting = self._waiting, set()
        for throttle in waiting:
            self.changed(throttle)

    def arrange(self) -> None:
        """Sort the throttles anew, after one of them was reconfigured."""
        throttles = (*self._own, *(each for members in self._members.values() for each in members.throttles))
        for gone in self._open_since.keys() - set(throttles):
            del self._open_since[gone]
        self.settle()
        self._sort(throttles)

    def _sort(self, throttles: tuple[Throttle, ...]) -> None:
        """Split the throttles. Called after one was added, removed or reconfigured."""
        # A burst belongs to the throttles that joined it: a new throttle must not get frames from before.
        self._throttles = throttles
        self._note_sendings()
        self.end_burst()
        self._direct = tuple((throttle.join, throttle.send) for throttle in throttles if throttle.is_open)
        self._limiting = tuple(throttle for throttle in throttles if not throttle.is_open)

    def _note_sendings(self) -> None:
        """Tell throttles that are no longer open when they were last sent a sample (THR-06)."""
        for throttle in self._throttles:
            if throttle.is_open:
                self._open_since.setdefault(throttle, self._sendings)
            elif self._open_since.pop(throttle, self._sendings) < self._sendings:
                throttle.note_sent(self._sent_at)

    def settle(self) -> None:
        """Update `counts` with the samples sent through open throttles."""
        counts, receivers = self.counts, len(self._direct)
        counts.encodes += self._encoded
        counts.messages += self._encoded * receivers
        counts.bytes += self._encoded_bytes * receivers
        self._sendings += self._encoded
        self._encoded = self._encoded_bytes = 0

    def encode(self, sample: S) -> Frame:
        """Encode a sample now, and count it."""
        self.counts.encodes += 1
        return self._encode(sample)

    def is_slow(self, sample: S) -> bool:
        """True if encoding the sample takes steps."""
        return sample.payload.is_long or self.steps is not None

    def prepare(self, sample: S) -> Iterator[None]:
        """Do the slow part of encoding a sample, in steps."""
        if sample.payload.is_long:
            yield from sample.payload.prepare({self.form})
        if self.steps is not None:
            yield from self.steps(sample)

    def deliver_but_to(self, newer: Collection[object], sample: S) -> None:
        """Send a sample to every throttle except `newer`."""
        self.end_burst()
        self._offer(
            _EncodedSample(self, sample), [throttle for throttle in self._throttles if throttle not in newer]
        )

    def deliver(self, sample: S) -> None:
        """Send a sample to every throttle."""
        if self._waiting:
            self._let_in()
        # Frames in a burst have no lifespan: open throttles are offered the sample, too.
        if sample.expires_ns:
            self.end_burst()
            self._offer(_EncodedSample(self, sample), self._throttles)
            return
        frame: Frame | None = None
        direct = self._direct
        if direct:
            frame = self._encode(sample)
            # settle() multiplies by the number of receivers: this path runs for every message.
            self._encoded += 1
            self._encoded_bytes += frame.size
            self._sent_at = self._monotonic()
            burst = self._burst
            if burst is not None and not burst.is_sealed and burst.add(frame):
                for send in self._apart:
                    send(frame)
            else:
                self._begin_burst(frame)
        if self._limiting:
            self._offer(_EncodedSample(self, sample, frame), self._limiting)

    def _begin_burst(self, frame: Frame) -> None:
        """Send a frame to every open throttle, and begin a burst for the frames that follow in this turn.

        A burst of one frame costs more than the frame alone. All throttles join only if the previous burst
        grew. Otherwise only the first throttle joins, as a probe.
        """
        last = self._burst
        all_share = last is not None and len(last.frames) > 1
        if last is not None and not last.is_sealed:
            last.seal()
        burst = Burst(frame)
        apart = []
        for join, send in self._direct if all_share else self._direct[:1]:
            if not join(burst):
                send(frame)
                apart.append(send)
        if not all_share:
            for _, send in self._direct[1:]:
                send(frame)
                apart.append(send)
        self._apart = apart
        self._burst = burst if len(apart) < len(self._direct) else None

    def end_burst(self) -> None:
        """End the burst, so that what is sent to a client otherwise comes after it."""
        burst, self._burst = self._burst, None
        if burst is not None:
            burst.seal()

    def _offer(self, encoded: _EncodedSample[S], throttles: Iterable[Throttle]) -> None:
        for throttle in throttles:
            throttle.offer(encoded.sample, encoded.send)

    def replay(self, sample: S, throttle: Throttle) -> None:
        """Send a retained sample to one throttle (SUB-13)."""
        self.end_burst()
        throttle.offer(sample, _EncodedSample(self, sample).send)


class Source(Protocol):
    """Source of samples: a participant of the graph."""

    def subscribe(
        self, topic: str, on_sample: Callable[[Sample], None], type: MessageType | None = None
    ) -> Subscription:
        """Call `on_sample` with each sample of a topic."""


class Fanout:
    """Clients of one topic, served by a single graph subscription.

    A sample is delivered in one of two ways:

    * **immediately**: a small sample is encoded and sent within the publisher's call;
    * **deferred**: a long sample, or one whose encoder works in steps, is queued in ``late`` and sent once it
      is encoded. While the queue is not empty, later samples of the topic are queued behind it, to keep their
      order.

    A throttle that joins while samples are deferred does not receive those: they were published before it
    joined.

    The fan-out ends if the robot uses the topic with another type: every subscriber is told why, and leaves.

    Attributes by purpose:

    * Streams: ``_streams`` (by spelling and encoding), ``_active`` (as a tuple for the hot path),
      ``_is_stepped`` (True if an encoder works in steps); ``_takers`` (callbacks that get samples as they
      are).
    * Deferral: ``late`` (the queue), ``_late_samples`` (samples in it), ``_number`` (number of the newest
      deferred sample), ``_joined`` (throttles and takers that joined meanwhile: ``_number`` at that time).
    * End: ``_on_end`` (function of each throttle and taker that ends its subscription).

    Attributes:
        counts: totals of the topic. Up to date after :meth:`settle`.
    """

    def __init__(
        self,
        source: Source,
        topic: str,
        type: MessageType,
        counts: TopicCounts,
        clock: Clock,
        scheduler: Scheduler,
    ) -> None:
        self._source = source
        self._clock = clock
        self.topic = topic
        self.type = type
        self.counts = counts
        self._streams: dict[tuple[str, str], EncodedStream[Sample]] = {}
        self._active: tuple[EncodedStream[Sample], ...] = ()
        self._takers: list[Callable[[Sample], None]] = []
        self._is_stepped = False
        self.late = DeferredSamples(scheduler)
        self._late_samples = 0
        self._number = 0
        self._joined: dict[object, int] = {}
        self._on_end: dict[object, OnEnd] = {}
        self.subscription = self._subscribe()

    def _subscribe(self) -> Subscription:
        subscription = self._source.subscribe(self.topic, self._deliver, self.type)
        subscription.on_displaced = self._end
        return subscription

    def _end(self, reason: str) -> None:
        # A copy: each subscriber leaves, perhaps with others, and the last one closes the fan-out.
        for subscriber, on_end in tuple(self._on_end.items()):
            try:
                if subscriber in self._on_end:
                    on_end(reason)
            except Exception:
                logger.exception("a subscriber of %s failed on its end", self.topic)

    @property
    def subscriptions(self) -> int:
        """Number of subscriptions; spellings of the name count separately."""
        return sum(map(len, self._active)) + len(self._takers)

    def settle(self) -> None:
        """Update `counts`."""
        for stream in self._active:
            stream.settle()

    @property
    def is_empty(self) -> bool:
        """True if there are no subscribers."""
        return not (self._active or self._takers)

    def renew(self) -> None:
        """Replace the graph subscription.

        Remote publishers send their retained samples once per subscription. A client that joins while none is
        reachable needs a new subscription to get them when one returns.
        """
        # The new one first, so that the topic is subscribed to without a gap.
        old = self.subscription
        self.subscription = self._subscribe()
        old.close()

    def join(self, throttle: Throttle, name: str, encoding: Encoding, on_end: OnEnd) -> EncodedStream[Sample]:
        """Add a throttle to the stream of this spelling and encoding, which is created if needed.

        Args:
            on_end: called with the reason if the fan-out ends; it has to :meth:`leave`.
        """
        self._on_end[throttle] = on_end
        if self._late_samples:
            self._joined[throttle] = self._number  # Samples from before it joined reach it by replay() only.
        key = (name, encoding.name)
        stream = self._streams.get(key)
        if stream is None:
            stream = self._streams[key] = EncodedStream(
                encoding.publish_encoder(name),
                self.counts.encoding(encoding.name),
                self._clock,
                self.late,
                encoding.form,
            )
            self._update_active()
        stream.add(throttle)
        return stream

    def leave(self, throttle: Throttle, name: str, encoding: Encoding) -> None:
        """Remove a throttle from its stream; drop the stream if it is empty."""
        key = (name, encoding.name)
        stream = self._streams[key]
        stream.remove(throttle)
        del self._on_end[throttle]
        self._joined.pop(throttle, None)
        if not stream:
            del self._streams[key]
            self._update_active()

    def take_samples(self, take: Callable[[Sample], None], on_end: OnEnd) -> None:
        """Call `take` with each sample from now on, without encoding. Retained samples are in
        `subscription.history()`.

        Args:
            on_end: called with the reason if the fan-out ends; it has to call :meth:`end_samples`.
        """
        self._on_end[take] = on_end
        if self._late_samples:
            self._joined[take] = self._number
        self._takers.append(take)

    def end_samples(self, take: Callable[[Sample], None]) -> None:
        """Undo :meth:`take_samples`."""
        self._takers.remove(take)
        del self._on_end[take]
        self._joined.pop(take, None)

    def _update_active(self) -> None:
        self._active = tuple(self._streams.values())
        self._is_stepped = any(stream.steps is not None for stream in self._active)

    def close(self) -> None:
        """Discard deferred samples and close the graph subscription."""
        self.late.clear()
        self.subscription.close()

    def _deliver(self, sample: Sample) -> None:
        if sample.payload.is_long or self._is_stepped or self.late.waiting:
            self._send_late(sample)
            return
        for stream in self._active:
            stream.deliver(sample)
        # A copy: a taker may end itself, or add another.
        for take in tuple(self._takers):
            self._pass_on(take, sample)

    def _pass_on(self, take: Callable[[Sample], None], sample: Sample) -> None:
        try:
            take(sample)
        except Exception:
            logger.exception("a callback for the samples of %s failed", sample.topic)

    def _send_late(self, sample: Sample) -> None:
        """Defer a sample until it is encoded; later samples of the topic queue behind it."""
        self._late_samples += 1
        self._number += 1
        self.late.add(self._steps(sample), partial(self._send, sample, self._number))
        while self._late_samples > _MAX_DEFERRED:
            if sample.payload.is_long and sample.payload.is_relayed:
                # Another program sends faster than this one encodes, and cannot be slowed down.
                self.late.drop_second()
                self._late_samples -= 1
            else:
                self.late.finish_first()

    def _steps(self, sample: Sample) -> Iterator[None]:
        # Without an open throttle, the sample may reach nobody: then it is encoded when a throttle admits it.
        streams = [stream for stream in self._active if stream.is_open]
        try:
            if sample.payload.is_long:
                yield from sample.payload.prepare({stream.form for stream in streams})
            for stream in streams:
                if stream.steps is not None:
                    yield from stream.steps(sample)
        except Exception:
            self._late_samples -= 1  # Encoding failed: the sample is dropped.
            raise

    def _send(self, sample: Sample, number: int) -> None:
        self._late_samples -= 1
        newer = [joined for joined, after in self._joined.items() if after >= number]
        if not self._late_samples:
            # No deferred sample is left from before somebody joined.
            self._joined.clear()
        for stream in self._active:
            if newer:
                stream.deliver_but_to(newer, sample)
            else:
                stream.deliver(sample)
        for take in [take for take in self._takers if take not in newer]:
            self._pass_on(take, sample)
