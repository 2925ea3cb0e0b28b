"""From one sample in the graph to the frames of many clients: one encode per topic and encoding."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Final, Protocol

from rwt.delivery.deferred_sends import DeferredSends
from rwt_graph.errors import TypeConflict
from rwt_protocol.frames import Burst, Frame

if TYPE_CHECKING:
    from rwt.delivery.counters import EncodingCounts, TopicCounts
    from rwt.delivery.throttle import Gate
    from rwt_graph.api import Participant, Sample, Subscription
    from rwt_graph.clock import Clock
    from rwt_interfaces.payload import Form
    from rwt_interfaces.structs import MessageType
    from rwt_protocol.payloads import Sample as ProtocolSample
    from rwt_transports.turns import Turns


Encode = Callable[["ProtocolSample"], Frame]
"""From a sample of one topic to its frame. One that takes long has a method ``steps(sample)``, too, after
which the call is quick."""


class SampleEncoding(Protocol):
    """How a gateway's clients get samples.

    Attributes:
        name: of the encoding.
        form: what of a message its frames are made of.
    """

    @property
    def name(self) -> str:
        """See above."""

    @property
    def form(self) -> Form:
        """See above."""

    @property
    def publish_encoder(self) -> Callable[[str], Encode]:
        """From how a client calls the topic to an encoder for its samples."""


logger = logging.getLogger(__name__)

_MOST_LATE: Final = 8
"""Samples of one topic that wait for their frames; if there are more, those of the oldest are made at
once."""


class _Encoded:
    """One sample in one encoding, encoded when the first gate lets it through."""

    __slots__ = ("_channel", "_frame", "sample")

    def __init__(self, channel: EncodedStream, sample: Sample, frame: Frame | None = None) -> None:
        self._channel = channel
        self._frame = frame
        self.sample = sample

    def frame(self) -> Frame:
        if self._frame is None:
            self._frame = self._channel.encode(self.sample)
        counts = self._channel.counts
        counts.messages += 1
        counts.bytes += self._frame.size
        return self._frame

    def send(self, take: Callable[[Frame], None]) -> None:
        """Give the frame to `take`: at once if it is made quickly and nothing of the topic waits, else when
        it is made."""
        late = self._channel.late
        if late.waiting or (self._frame is None and self._channel.is_slow(self.sample)):
            late.add(self._channel.prepare(self.sample), lambda: take(self.frame()))
        else:
            take(self.frame())


class EncodedStream:
    """The clients of one topic that get the very same frames: same encoding, same spelling of its name.

    A client hears the name that it asked for (PUB-09), so `chatter` and `/chatter` are two channels. In a
    protocol where clients number their subscriptions, the frames have a gap for that number
    (:class:`~rwt_protocol.frames.GapFrame`), which is filled on the way to each.

    Attributes:
        counts: what went through, together with the topic's other channels of this encoding; up to date
            after :meth:`settle`.
        form: what is encoded from.
        steps: makes the frame of a sample in steps, before it is delivered; None where that is quick.
        late: sends what takes long to encode, of all channels of the topic.
    """

    def __init__(
        self,
        encode: Encode,
        counts: EncodingCounts,
        monotonic: Callable[[], float],
        late: DeferredSends,
        form: Form = "json",
    ) -> None:
        self._encode = encode
        self.late = late
        self.steps: Callable[[Sample], Iterator[None]] | None = getattr(encode, "steps", None)
        self._monotonic = monotonic
        self._sent_at = float("-inf")
        self._open_since: dict[Gate, int] = {}
        self._sendings = 0
        self.counts = counts
        self.form = form
        self._gates: list[Gate] = []
        self._direct: tuple[tuple[Callable[[Burst], bool], Callable[[Frame], None]], ...] = ()
        self._burst: Burst | None = None
        self._apart: list[Callable[[Frame], None]] = []
        self._gated: tuple[Gate, ...] = ()
        self._encoded = 0
        self._encoded_bytes = 0

    def __len__(self) -> int:
        return len(self._gates)

    @property
    def is_open(self) -> bool:
        """Whether every sample goes to somebody."""
        return bool(self._direct)

    def add(self, gate: Gate) -> None:
        """Let a gate take part from the next sample on."""
        self._gates.append(gate)
        self.sort()

    def remove(self, gate: Gate) -> None:
        """Take a gate out."""
        self._gates.remove(gate)
        self._open_since.pop(gate, None)
        self.sort()

    def sort(self) -> None:
        """Divide the gates into open and throttled ones, after one has joined, left or changed."""
        self.settle()
        self._note_sendings()
        self._end_burst()
        self._direct = tuple((gate.join, gate.send) for gate in self._gates if gate.is_open)
        self._gated = tuple(gate for gate in self._gates if not gate.is_open)

    def _note_sendings(self) -> None:
        """Tell gates that are open no longer when a sample last went past them."""
        for gate in self._gates:
            if gate.is_open:
                self._open_since.setdefault(gate, self._sendings)
            elif self._open_since.pop(gate, self._sendings) < self._sendings:
                gate.note_sent(self._sent_at)

    def settle(self) -> None:
        """Bring `counts` up to date with what went through the open gates."""
        counts, receivers = self.counts, len(self._direct)
        counts.encodes += self._encoded
        counts.messages += self._encoded * receivers
        counts.bytes += self._encoded_bytes * receivers
        self._sendings += self._encoded
        self._encoded = self._encoded_bytes = 0

    def encode(self, sample: Sample) -> Frame:
        """The frame of one sample, made now."""
        self.counts.encodes += 1
        return self._encode(sample)

    def is_slow(self, sample: Sample) -> bool:
        """Whether the frame of a sample is made in steps."""
        return sample.payload.is_long or self.steps is not None

    def prepare(self, sample: Sample) -> Iterator[None]:
        """Make what takes long of the frame of a sample, in steps."""
        if sample.payload.is_long:
            yield from sample.payload.prepare({self.form})
        if self.steps is not None:
            yield from self.steps(sample)

    def deliver_but_to(self, newer: Collection[object], sample: Sample) -> None:
        """Send one sample through every gate but those."""
        self._end_burst()
        self._offer(_Encoded(self, sample), [gate for gate in self._gates if gate not in newer])

    def deliver(self, sample: Sample) -> None:
        """Send one sample through every gate."""
        if sample.expires_ns:
            self._end_burst()
            self._offer(_Encoded(self, sample), self._gates)
            return
        frame: Frame | None = None
        direct = self._direct
        if direct:
            frame = self._encode(sample)
            # Multiplied by the receivers in settle(): here each instruction is paid for by every message.
            self._encoded += 1
            self._encoded_bytes += frame.size
            self._sent_at = self._monotonic()
            burst = self._burst
            if burst is not None and not burst.is_sealed and burst.add(frame):
                for send in self._apart:
                    send(frame)
            else:
                self._begin_burst(frame)
        if self._gated:
            self._offer(_Encoded(self, sample, frame), self._gated)

    def _begin_burst(self, frame: Frame) -> None:
        """Send a frame to every open gate, in a burst that later ones of this turn are added to.

        A burst of one frame costs more than the frame. So all gates share one only while the last one grew;
        otherwise the first gate alone has one, which shows whether it would have grown.
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

    def _end_burst(self) -> None:
        burst, self._burst = self._burst, None
        if burst is not None:
            burst.seal()

    def _offer(self, encoded: _Encoded, gates: Iterable[Gate]) -> None:
        for gate in gates:
            gate.offer(encoded)

    def replay(self, sample: Sample, gate: Gate) -> None:
        """Send one kept sample to one gate (SUB-13)."""
        self._end_burst()
        gate.offer(_Encoded(self, sample))


class SampleStream:
    """Somebody who takes the samples of a topic as they are in the graph, beside those who get frames.

    Args:
        take: called with each sample, at once. What it raises is logged, and nobody else goes without.
    """

    form: Final = "json"
    is_open: Final = False  # No form is made in advance for whoever may ask for none.
    steps: Final = None

    def __init__(self, take: Callable[[Sample], None]) -> None:
        self._take = take

    def __len__(self) -> int:
        return 1

    def settle(self) -> None:
        """Nothing is counted here."""

    def deliver_but_to(self, newer: Collection[object], sample: Sample) -> None:
        """Hand one sample on, unless it takes part for less long."""
        if self not in newer:
            self.deliver(sample)

    def deliver(self, sample: Sample) -> None:
        """Hand one sample on."""
        try:
            self._take(sample)
        except Exception:
            logger.exception("what takes samples of %s failed", sample.topic)


class Fanout:
    """All clients of one topic, behind one subscription in the graph.

    Attributes:
        counts: what is counted of the topic; up to date after :meth:`settle`.
        late: sends what takes long to encode.
    """

    def __init__(
        self,
        participant: Participant,
        topic: str,
        type: MessageType,
        counts: TopicCounts,
        clock: Clock,
        turns: Turns,
    ) -> None:
        self._participant = participant
        self._clock = clock
        self.topic = topic
        self.type = type
        self.counts = counts
        self._channels: dict[tuple[str, str], EncodedStream] = {}
        self._streams: list[SampleStream] = []
        self._active: tuple[EncodedStream | SampleStream, ...] = ()
        self._is_stepped = False
        self.late = DeferredSends(turns)
        self._late_samples = 0
        self._number = 0  # of samples that were late
        self._joined: dict[object, int] = {}  # after the sample of that number, which is late
        self.subscription: Subscription = participant.subscribe(topic, self._deliver, type)

    @property
    def subscriptions(self) -> int:
        """How many clients listen, those of each spelling of the name counted by themselves."""
        return sum(map(len, self._active))

    def settle(self) -> None:
        """Bring `counts` up to date."""
        for channel in self._active:
            channel.settle()

    @property
    def is_empty(self) -> bool:
        """Whether nobody listens any more."""
        return not self._active

    def check_type(self, type: MessageType) -> None:
        """Raise `TypeConflict` unless this topic's type is `type` (SUB-03)."""
        if type.name != self.type.name:
            raise TypeConflict(self.topic, type.name, self.type.name)

    def renew(self) -> None:
        """Subscribe anew: to whoever joins while no publisher can be reached, those that come back over the
        network are to tell what they keep, which they tell each subscription once."""
        old = self.subscription
        self.subscription = self._participant.subscribe(self.topic, self._deliver, self.type)
        old.close()

    def join(self, gate: Gate, name: str, encoding: SampleEncoding) -> EncodedStream:
        """Add a gate to the channel of that spelling and encoding."""
        if self._late_samples:
            self._joined[gate] = self._number  # Of what came before, it is sent what is replayed to it.
        key = (name, encoding.name)
        channel = self._channels.get(key)
        if channel is None:
            channel = self._channels[key] = EncodedStream(
                encoding.publish_encoder(name),
                self.counts.encoding(encoding.name),
                self._clock.monotonic,
                self.late,
                encoding.form,
            )
            self._note_channels()
        channel.add(gate)
        return channel

    def leave(self, gate: Gate, name: str, encoding: SampleEncoding) -> None:
        """Take a gate out of its channel."""
        key = (name, encoding.name)
        channel = self._channels[key]
        channel.remove(gate)
        self._joined.pop(gate, None)
        if not channel:
            del self._channels[key]
            self._note_channels()

    def take_samples(self, take: Callable[[Sample], None]) -> SampleStream:
        """Have `take` called with each sample from now on, without a frame being made for it; those that the
        topic keeps are in `subscription.history()`."""
        stream = SampleStream(take)
        if self._late_samples:
            self._joined[stream] = self._number
        self._streams.append(stream)
        self._note_channels()
        return stream

    def end_samples(self, stream: SampleStream) -> None:
        """End what :meth:`take_samples` began."""
        self._streams.remove(stream)
        self._joined.pop(stream, None)
        self._note_channels()

    def _note_channels(self) -> None:
        self._active = (*self._channels.values(), *self._streams)
        self._is_stepped = any(channel.steps is not None for channel in self._active)

    def close(self) -> None:
        """Leave the graph's topic."""
        self.late.clear()
        self.subscription.close()

    def _deliver(self, sample: Sample) -> None:
        if sample.payload.is_long or self._is_stepped or self.late.waiting:
            self._send_late(sample)
            return
        for channel in self._active:
            channel.deliver(sample)

    def _send_late(self, sample: Sample) -> None:
        """Deliver a sample that takes long to encode, and what comes behind it, when its forms are made."""
        self._late_samples += 1
        self._number += 1
        self.late.add(self._steps(sample), partial(self._send, sample, self._number))
        while self._late_samples > _MOST_LATE:
            self.late.finish_first()

    def _steps(self, sample: Sample) -> Iterator[None]:
        channels = [channel for channel in self._active if channel.is_open]
        try:
            if sample.payload.is_long:
                yield from sample.payload.prepare({channel.form for channel in channels})
            for channel in channels:
                if channel.steps is not None:
                    yield from channel.steps(sample)
        except Exception:
            self._late_samples -= 1  # It is not sent.
            raise

    def _send(self, sample: Sample, number: int) -> None:
        self._late_samples -= 1
        newer = [gate for gate, after in self._joined.items() if after >= number]
        if not self._late_samples:
            self._joined.clear()
        for channel in self._active:
            if newer:
                channel.deliver_but_to(newer, sample)
            else:
                channel.deliver(sample)
