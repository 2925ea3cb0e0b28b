"""Topic of a scripted robot: published by hand, at a rate, or as recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rwt.extensions.testing.errors import ScriptError, check_messages
from rwt.extensions.testing.expectations import TIMEOUT_SECONDS, block_until, wait_until
from rwt_graph.api import Graph
from rwt_graph.clock import Clock
from rwt_graph.nodes.endpoints import TopicPublisher
from rwt_participant.messages import MessageLike
from rwt_participant.timers import Timer

#: Maximum number of messages per turn of the event loop, so that a rate above what the machine can publish
#: does not block it.
_BATCH = 1000


class ScriptedTopic:
    """Topic of a scripted robot.

    Attributes:
        name: absolute name.
    """

    def __init__(self, graph: Graph, publisher: TopicPublisher) -> None:
        self.name = publisher.name
        self._graph = graph
        self._publisher = publisher
        self._playing: _Playing | None = None

    def publish(self, message: MessageLike | None = None) -> None:
        """Publish one message, from any thread; None for a default message.

        Raises:
            ScriptError: the message does not fit the topic's type.
        """
        self.check((message,))
        self._publisher.publish({} if message is None else message)

    def play(
        self, messages: Sequence[tuple[float, MessageLike]], *, repeat: bool = False, length: float = 0.0
    ) -> None:
        """Publish messages at their times, in seconds of the robot's clock from now, replacing earlier ones.

        Args:
            messages: pairs of time and message, in order of time.
            repeat: True to begin again at the end.
            length: duration of one repetition in seconds; default: the time of the last message.

        Raises:
            ScriptError: a message does not fit the topic's type, times go back, or the repetition has no
                length.
        """
        self.check(tuple(message for _, message in messages))
        times = [at for at, _ in messages]
        if any(at < 0 for at in times) or times != sorted(times):
            raise ScriptError(f"{self.name}: the times of recorded messages must not be negative or go back")
        length = length or (times[-1] if times else 0.0)
        if repeat and length <= 0:
            raise ScriptError(f"{self.name}: what is repeated must have a length of more than 0 s")
        self.stop()
        if messages:
            playing = self._playing = _Playing(
                self._graph.clock, self._publisher, tuple(messages), repeat, length
            )
            self._graph.soon(playing.begin)

    def repeat(self, messages: Sequence[MessageLike], rate: float, *, again: bool = True) -> None:
        """Publish messages in turn, `rate` per second, from the first again after the last.

        Raises:
            ScriptError: a message does not fit the topic's type, or the rate is not positive.
        """
        if rate <= 0:
            raise ScriptError(f"{self.name}: a rate must be greater than 0, not {rate}")
        timed = [(index / rate, message) for index, message in enumerate(messages)]
        self.play(timed, repeat=again, length=len(timed) / rate)

    def stop(self) -> None:
        """Stop publishing periodically."""
        playing, self._playing = self._playing, None
        if playing is not None:
            playing.over = True
            self._graph.soon(playing.end)

    @property
    def subscriber_count(self) -> int:
        """Number of subscribers; all clients of one server count as one."""
        return self._publisher.subscriber_count

    def wait_for_subscriber(self, within: float = TIMEOUT_SECONDS) -> None:
        """Block until the topic has a subscriber.

        Raises:
            AssertionError: no subscriber within `within` seconds of real time.
            BlockingWait: called from a coroutine.
        """
        __tracebackhide__ = True
        instead = "use `await topic.until_subscribed()`"
        block_until(lambda: self.subscriber_count > 0, within, lambda: self._nobody(within), instead)

    async def until_subscribed(self, within: float = TIMEOUT_SECONDS) -> None:
        """Like :meth:`wait_for_subscriber`, for coroutines."""
        __tracebackhide__ = True
        await wait_until(lambda: self.subscriber_count > 0, within, lambda: self._nobody(within))

    def check(self, messages: Sequence[MessageLike | None]) -> None:
        """Raise :exc:`ScriptError` if a message does not fit the topic's type."""
        check_messages(self._publisher.type, messages, self._publisher.now_ns, self.name)

    def _nobody(self, within: float) -> str:
        return f"{self.name} has no subscriber within {within:g} s"


@dataclass(eq=False)
class _Playing:
    """Single run through timed messages. All but `over` is confined to the graph's thread."""

    clock: Clock
    publisher: TopicPublisher
    messages: tuple[tuple[float, MessageLike], ...]
    repeat: bool
    length: float
    over: bool = False
    next: int = 0
    began: float = 0.0
    timer: Timer | None = None

    def begin(self) -> None:
        """Start. A message at time 0 is published at once."""
        self.began = self.clock.monotonic()
        self._go_on()

    def _go_on(self) -> None:
        for _ in range(_BATCH):
            if self.over:
                return
            rounds, index = divmod(self.next, len(self.messages))
            if rounds and not self.repeat:
                return
            at, message = self.messages[index]
            wait = self.began + rounds * self.length + at - self.clock.monotonic()
            # 1e-9 absorbs rounding errors: a message that is due now is sent now.
            if wait > 1e-9:
                self.timer = self.clock.call_later(wait, self._go_on)
                return
            self.next += 1
            self.publisher.publish(message)
        self.timer = self.clock.call_later(0.0, self._go_on)

    def end(self) -> None:
        if self.timer is not None:
            self.timer.cancel()
