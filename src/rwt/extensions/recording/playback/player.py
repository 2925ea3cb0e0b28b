"""Player of a recording in a graph, at any speed, paused, looped or stepped."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import Any, Final

import anyio

from rwt.extensions.recording.errors import RecordingUnreadable
from rwt.extensions.recording.playback.clock import ClockTopic, PlaybackClock
from rwt.extensions.recording.playback.publications import (
    Publications,
    add_recorded_types,
    offer_recorded_services,
)
from rwt.extensions.recording.playback.read_ahead import ReadAhead
from rwt.extensions.recording.recording import RecordedMessage, Recording
from rwt_graph.api import Graph, Participant, ServiceCall
from rwt_graph.clock import END_OF_TIME_NS, Playback
from rwt_graph.topic_selection import EVERYTHING, TopicSelection
from rwt_interfaces import InvalidMessage, Payload
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.timers import Timer
from rwt_protocol.states import StateEnum

logger = logging.getLogger(__name__)

NODE: Final = "/rosbag2_player"

SLOWEST: Final = 0.001
FASTEST: Final = 1000.0
"""Range of playback rates."""

BATCH: Final = 200
"""Maximum number of messages published in one turn of the event loop."""


Answer = dict[str, object]


@dataclass(frozen=True, slots=True)
class PlayOptions:
    """Options of playback.

    Attributes:
        rate: recorded seconds per second.
        start, end: seconds from the beginning of the recording; `end` None is its end.
        loop: True to repeat at the end, unless the recording has no duration.
        paused: True to begin paused.
        remap: published names by recorded name.
        clock_hz: rate of `/clock`; 0 for none.
        answer_services: True to answer service calls as recorded.
    """

    rate: float = 1.0
    start: float = 0.0
    end: float | None = None
    loop: bool = False
    paused: bool = False
    selection: TopicSelection = EVERYTHING
    remap: Mapping[str, str] = field(default_factory=dict)
    clock_hz: float = 0.0
    answer_services: bool = True


class _PlayerState(StateEnum):
    PAUSED = "PLAYING", "CLOSED"
    PLAYING = "PAUSED", "CLOSED"
    CLOSED = "CLOSED"


class Player(Playback):
    """Node that publishes the messages of a recording in order and at the times of the recording.

    Life cycle::

        PAUSED ────────── resume() ──────────> PLAYING ── close() ──> CLOSED
         │^── pause(), end without a loop ────────┘                     ^
         └───────────────────────── close() ────────────────────────────┘

    * **PAUSED**: time stands still at ``_anchor_ns``; :meth:`play_next` advances it.
    * **PLAYING**: time runs from ``_anchor_ns``, which it had at ``_anchor_at``; ``_timer`` runs until the
      next message is due.
    * **CLOSED**: the player has left the graph.

    It is driven by the graph's clock: with a :class:`PlaybackClock` messages have the stamps that they were
    recorded with; with a :class:`~rwt_graph.clock.SimulatedClock` each `advance` plays that much of the
    recording, and no event loop is needed. Everything here belongs to the graph's own thread.

    Args:
        graph: graph of any backend; the types of the recording are added to its registry.
        recording: open recording; it is read by another thread, and must stay open until `close`.

    Attributes:
        node: node that publishes, and whose services control playback.
        start_ns: time of the recording at which playback begins, in nanoseconds since the epoch.
        end_ns: time at which playback ends.
        rate: recorded seconds per second.
        seeks: number of jumps in time, including those to the beginning of a loop.
        played: number of messages published so far.
        publications: topics of the recording.
        finished: set at the end if playback does not loop; a seek does not clear it.

    Raises:
        ValueError: `rate`, `start` or `end` is out of range.
    """

    node = NODE

    def __init__(self, graph: Graph, recording: Recording, options: PlayOptions | None = None) -> None:
        self._clock = graph.clock
        self._recording = recording
        self._options = options = options or PlayOptions()
        self.rate = checked_rate(options.rate)
        self.start_ns, self.end_ns = _bounds(recording, options)
        self.played = 0
        self.finished = anyio.Event()
        add_recorded_types(graph.registry, recording)
        self._participant = graph.participant(NODE)
        self.publications = Publications(
            graph, self._participant, recording, options.selection, options.remap
        )
        self._ahead: ReadAhead | None = None
        self._failure = ""
        self._next: RecordedMessage | None = None
        self._timer: Timer | None = None
        self._state = _PlayerState.PAUSED
        self._rounds = 0  # how often the end was reached
        self.seeks = 0
        self._place(self.start_ns)
        if isinstance(self._clock, PlaybackClock):
            self._clock.follow(self, lambda: min(self.position_ns, self.end_ns))
        self._services = PlayerServices(graph, self._participant, self)
        if options.answer_services:
            offer_recorded_services(graph, self._participant, recording, options.selection)
        self._clock_topic: ClockTopic | None = None
        if options.clock_hz > 0:
            self._clock_topic = ClockTopic(graph, self._participant, options.clock_hz)
        self._keep_earlier(self.start_ns)
        self._read_from(self.start_ns)
        if not options.paused:
            self.resume()

    @property
    def paused(self) -> bool:
        """True unless it is playing."""
        return self._state is not _PlayerState.PLAYING

    @property
    def losses(self) -> tuple[str, ...]:
        """Return a description of what could not be played so far; empty if there was nothing."""
        damaged, unreadable = self._recording.damaged, self.publications.unreadable
        found = [f"{name}: {why}" for name, why in self.publications.skipped.items()]
        if self._recording.end_ns >= END_OF_TIME_NS:
            found.append("what is said to be after the 19th of January 2038, where ROS time ends")
        if damaged:
            found.append(f"{damaged} damaged places of the recording")
        if unreadable:
            found.append(f"{unreadable} messages that do not fit their types")
        failure = self._failure if self._ahead is None else self._ahead.failure
        if failure:
            found.append(f"the rest of the recording: {failure}")
        return tuple(found)

    # -- time ----------------------------------------------------------------------------------------------

    @property
    def position_ns(self) -> int:
        """Current time of the recording, in nanoseconds since the epoch."""
        if self.paused:
            return self._anchor_ns
        gone = round((self._clock.monotonic() - self._anchor_at) * self.rate * NANOSECONDS)
        position = self._anchor_ns + gone
        # Late messages are published late; time does not overtake them.
        return position if self._next is None else min(position, self._next.log_time)

    def _place(self, position_ns: int) -> None:
        self._anchor_ns = position_ns
        self._anchor_at = self._clock.monotonic()

    # -- control -------------------------------------------------------------------------------------------

    def resume(self) -> None:
        """Resume playback; no-op after :meth:`close`."""
        if self._state is _PlayerState.PAUSED:
            self._place(self._anchor_ns)
            self._state = self._state.become(_PlayerState.PLAYING)
            self._arm()

    def pause(self) -> None:
        """Pause playback."""
        if not self.paused:
            self._place(self.position_ns)
            self._state = self._state.become(_PlayerState.PAUSED)
            self._disarm()

    def toggle_paused(self) -> None:
        """Pause or resume."""
        if self.paused:
            self.resume()
        else:
            self.pause()

    def set_rate(self, rate: float) -> None:
        """Change the rate.

        Raises:
            ValueError: the rate is not a number from 0.001 to 1000.
        """
        checked = checked_rate(rate)
        self._place(self.position_ns)
        self.rate = checked
        self._arm()

    def play_next(self) -> bool:
        """Publish the next message while paused. Returns False while playing or at the end."""
        if not self.paused or self._next is None:
            return False
        self._place(self._next.log_time)
        if not self._publish_next():
            self._end_reached()
        return True

    def burst(self, count: int) -> int:
        """Call :meth:`play_next` up to `count` times (0: until the end, also if looping); return the number
        of messages.
        """
        return sum(1 for _ in self.steps(count))

    def steps(self, count: int) -> Iterator[None]:
        """:meth:`burst`, one message for each turn of the iterator."""
        rounds, done = self._rounds, 0
        while (not count or done < count) and self._rounds == rounds and self.play_next():
            done += 1
            yield

    def seek(self, time_ns: int) -> bool:
        """Jump to a time of the recording. Returns False if it is outside of the played range.

        Latched topics publish again what was retained at that time.
        """
        if not self.start_ns <= time_ns <= self.end_ns:
            return False
        self._jump(time_ns)
        return True

    def _jump(self, time_ns: int) -> None:
        self.seeks += 1
        self._next = None
        self._place(time_ns)
        self._keep_earlier(time_ns)
        self._read_from(time_ns)
        self._arm()

    def close(self) -> None:
        """Stop and leave the graph; the caller closes the recording. Idempotent."""
        self._state = self._state.become(_PlayerState.CLOSED)
        self._next = None
        self._disarm()
        if self._ahead is not None:
            self._ahead.close()
            self._failure = self._ahead.failure
            self._ahead = None
        if self._clock_topic is not None:
            self._clock_topic.close()
        self._participant.close()

    def __enter__(self) -> Player:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    # -- playing -------------------------------------------------------------------------------------------

    def _arm(self) -> None:
        self._disarm()
        if not self.paused:
            due = self.end_ns if self._next is None else self._next.log_time
            gone = (due - self._anchor_ns) / NANOSECONDS / self.rate
            delay = max(0.0, self._anchor_at + gone - self._clock.monotonic())
            self._timer = self._clock.call_later(delay, self._play_due)

    def _disarm(self) -> None:
        timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()

    def _play_due(self) -> None:
        """Publish the messages that are due, in several turns of the event loop if there are many."""
        for _ in range(BATCH):
            if self.paused:
                return  # A subscriber may have paused or closed the player.
            if self._next is None or not self._is_due(self._next.log_time):
                break
            self._publish_next()
        if self._next is None and self._is_due(self.end_ns):
            self._end_reached()
        else:
            self._arm()

    def _is_due(self, log_time: int) -> bool:
        gone = (self._clock.monotonic() - self._anchor_at) * self.rate * NANOSECONDS
        return log_time <= self._anchor_ns + round(gone)

    def _publish_next(self) -> bool:
        """Publish the next message. Returns False if it was the last."""
        message = self._next
        assert message is not None and self._ahead is not None  # Callers check that there is one.
        self._next = self._ahead.next()
        self._publish(message)
        return self._next is not None

    def _publish(self, message: RecordedMessage) -> None:
        clock = self._clock if isinstance(self._clock, PlaybackClock) else None
        if clock is not None:
            clock.hold(message.publish_time)
        try:
            self.played += self.publications.publish(message)
        finally:
            if clock is not None:
                clock.hold(None)

    def _end_reached(self) -> None:
        self._rounds += 1
        if self._state is _PlayerState.CLOSED:
            return  # A subscriber closed the player.
        if self._options.loop and self.start_ns < self.end_ns:
            self._jump(self.start_ns)
            return
        self._place(self.end_ns)
        if not self.paused:
            self._state = self._state.become(_PlayerState.PAUSED)
        self._disarm()
        self.finished.set()

    def _read_from(self, time_ns: int) -> None:
        if self._ahead is not None:
            self._ahead.close()
        messages = self._recording.messages(self.publications.topics, time_ns, self.end_ns + 1)
        self._ahead = ReadAhead(messages)
        self._next = self._ahead.next()

    def _keep_earlier(self, time_ns: int) -> None:
        """Publish again what late subscribers would have received at a time: the newest retained messages."""
        kept = self.publications.kept()
        if not kept or time_ns <= self._recording.start_ns:
            return
        newest: dict[str, deque[RecordedMessage]] = {
            topic: deque(maxlen=depth) for topic, depth in kept.items()
        }
        try:
            for message in self._recording.messages(kept, self._recording.start_ns, time_ns):
                newest[message.topic].append(message)
        except RecordingUnreadable as error:
            logger.warning("not all that was kept before could be read: %s", error)
        earlier = [message for messages in newest.values() for message in messages]
        for message in sorted(earlier, key=lambda message: message.log_time):
            self._publish(message)


def _bounds(recording: Recording, options: PlayOptions) -> tuple[int, int]:
    if recording.start_ns >= END_OF_TIME_NS:
        raise ValueError("the recording begins after the 19th of January 2038, where ROS time ends")
    # In the index of a damaged file, the end may be before the beginning.
    last = max(recording.start_ns, min(recording.end_ns, END_OF_TIME_NS - 1))
    length = (last - recording.start_ns) / NANOSECONDS
    if not 0 <= options.start <= length:
        raise ValueError(
            f"the recording is {length:.3f} s long: it cannot be played from {options.start} s on"
        )
    begin = recording.start_ns + round(options.start * NANOSECONDS)
    if options.end is None:
        return begin, last
    if not options.end >= options.start:  # also what is no number
        raise ValueError(f"playing cannot end at {options.end} s, before it begins at {options.start} s")
    return begin, last if options.end >= length else recording.start_ns + round(options.end * NANOSECONDS)


def checked_rate(rate: float) -> float:
    """Check a rate, and return it."""
    if not SLOWEST <= rate <= FASTEST:
        raise ValueError(f"a recording is played at a rate from {SLOWEST} to {FASTEST:g}, not {rate}")
    return rate


class PlayerServices:
    """Server of `/rosbag2_player/pause` and the other services."""

    def __init__(self, graph: Graph, participant: Participant, player: Player) -> None:
        self._player = player
        self._clock = graph.clock
        self._participant = participant
        handlers: dict[tuple[str, str], Callable[[Any], Answer | None]] = {
            ("pause", "Pause"): lambda _: player.pause(),
            ("resume", "Resume"): lambda _: player.resume(),
            ("toggle_paused", "TogglePaused"): lambda _: player.toggle_paused(),
            ("is_paused", "IsPaused"): lambda _: {"paused": player.paused},
            ("get_rate", "GetRate"): lambda _: {"rate": player.rate},
            ("set_rate", "SetRate"): self._set_rate,
            ("play_next", "PlayNext"): lambda _: {"success": player.play_next()},
            ("seek", "Seek"): lambda asked: {"success": player.seek(graph.distro.time_ns(asked.time))},
        }
        for (name, kind), handler in handlers.items():
            self._offer(graph, f"{NODE}/{name}", kind, partial(_answer_at_once, handler))
        self._offer(graph, f"{NODE}/burst", "Burst", self._burst)

    def _offer(
        self, graph: Graph, name: str, kind: str, answer: Callable[[Any, Callable[[Answer], None]], None]
    ) -> None:
        interface = graph.registry.service(f"rosbag2_interfaces/{kind}")

        def on_call(call: ServiceCall) -> None:
            try:
                request = call.request.value()
            except InvalidMessage as error:
                call.fail(str(error))
                return
            answer(request, lambda said: call.reply(Payload.from_value(interface.response, said)))

        self._participant.advertise_service(name, interface, on_call)

    def _burst(self, asked: Any, reply: Callable[[Answer], None]) -> None:
        """Publish in several turns of the event loop: a burst may be a whole long recording."""
        steps = self._player.steps(asked.num_messages)

        def turn(done: int) -> None:
            taken = sum(1 for _ in islice(steps, BATCH))
            if taken == BATCH:
                self._clock.call_later(0.0, partial(turn, done + taken))
            else:
                reply({"actually_burst": done + taken})

        turn(0)

    def _set_rate(self, asked: Any) -> Answer:
        try:
            self._player.set_rate(asked.rate)
        except ValueError:
            return {"success": False}
        return {"success": True}


def _answer_at_once(
    handler: Callable[[Any], Answer | None], request: Any, reply: Callable[[Answer], None]
) -> None:
    reply(handler(request) or {})
