"""A topic that a scripted robot publishes: by hand, at a rate, or as it was recorded."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import anyio

from rwt.testing.errors import ScriptError
from rwt.testing.expectations import PATIENCE, refuse_on_an_event_loop
from rwt_graph.nodes.endpoints import TopicPublisher
from rwt_participant.messages import MessageLike, to_payload

if TYPE_CHECKING:
    from rwt_graph.api import Graph
    from rwt_participant.timers import Timer

_LOOK = 0.005

#: Messages that are published in one turn of the event loop when many are due: a rate may be higher than this
#: machine can publish, and others want their turn, too.
_BATCH = 1000


class ScriptedTopic:
    """One topic of a scripted robot.

    Attributes:
        name: absolute name.
    """

    def __init__(self, graph: Graph, publisher: TopicPublisher) -> None:
        self.name = publisher.name
        self._graph = graph
        self._publisher = publisher
        self._playing: _Playing | None = None

    def publish(self, message: MessageLike | None = None) -> None:
        """Publish one message, None for one of defaults; from any thread.

        Raises:
            ScriptError: it does not fit the topic's type.
        """
        self.check((message,))
        self._publisher.publish({} if message is None else message)

    def play(
        self, messages: Sequence[tuple[float, MessageLike]], *, repeat: bool = False, length: float = 0.0
    ) -> None:
        """Publish messages at their times from now on, in seconds of the robot's clock, in place of others.

        Args:
            messages: each with its time from the beginning, which does not go back.
            repeat: begin again at the end.
            length: when that is, seconds from the beginning; the time of the last message by default.

        Raises:
            ScriptError: one does not fit the topic's type, times go back, or the repetition has no length.
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
            playing = self._playing = _Playing(self._graph, self._publisher, tuple(messages), repeat, length)
            self._run(playing.begin)

    def repeat(self, messages: Sequence[MessageLike], rate: float, *, again: bool = True) -> None:
        """Publish messages one after the other, `rate` a second, and then from the first again.

        Raises:
            ScriptError: one does not fit the topic's type, or the rate is not positive.
        """
        if rate <= 0:
            raise ScriptError(f"{self.name}: a rate must be greater than 0, not {rate}")
        timed = [(index / rate, message) for index, message in enumerate(messages)]
        self.play(timed, repeat=again, length=len(timed) / rate)

    def stop(self) -> None:
        """Publish nothing more by itself."""
        playing, self._playing = self._playing, None
        if playing is not None:
            playing.over = True
            self._run(playing.end)

    @property
    def subscriber_count(self) -> int:
        """How many subscribers there are now; all clients of one server are one."""
        return self._publisher.subscriber_count

    def wait_for_subscriber(self, within: float = PATIENCE) -> None:
        """Block until the topic has a subscriber.

        Raises:
            AssertionError: it had none after `within` seconds of real time.
            BlockingWait: called from a coroutine.
        """
        __tracebackhide__ = True
        refuse_on_an_event_loop("use `await topic.until_subscribed()`")
        deadline = time.monotonic() + within
        while not self.subscriber_count:
            if time.monotonic() >= deadline:
                raise AssertionError(self._nobody(within))
            time.sleep(_LOOK)

    async def until_subscribed(self, within: float = PATIENCE) -> None:
        """As :meth:`wait_for_subscriber`, for coroutines."""
        __tracebackhide__ = True
        deadline = time.monotonic() + within
        while not self.subscriber_count:
            if time.monotonic() >= deadline:
                raise AssertionError(self._nobody(within))
            await anyio.sleep(_LOOK)

    def check(self, messages: Sequence[MessageLike | None]) -> None:
        """Raise :exc:`ScriptError` if one of them does not fit the topic's type."""
        for message in messages:
            try:
                to_payload(self._publisher.type, {} if message is None else message, self._publisher.now_ns)
            except ValueError as error:
                raise ScriptError(f"{self.name} ({self._publisher.type.name}): {error}") from None

    def _run(self, call: Callable[[], None]) -> None:
        """On the graph's thread: now, or in the order of what this thread asks for."""
        if self._graph.on_graph_thread():
            call()
        else:
            self._graph.run_on_graph(call)

    def _nobody(self, within: float) -> str:
        return f"nobody subscribed to {self.name} within {within:g} s"


class _Playing:
    """One run through timed messages. All but `over` belongs to the graph's thread."""

    def __init__(
        self,
        graph: Graph,
        publisher: TopicPublisher,
        messages: tuple[tuple[float, MessageLike], ...],
        repeat: bool,
        length: float,
    ) -> None:
        self.over = False
        self._clock = graph.clock
        self._publisher = publisher
        self._messages = messages
        self._repeat = repeat
        self._length = length
        self._next = 0
        self._began = 0.0
        self._timer: Timer | None = None

    def begin(self) -> None:
        """Start; a message at time 0 is published at once."""
        self._began = self._clock.monotonic()
        self._go_on()

    def _go_on(self) -> None:
        for _ in range(_BATCH):
            if self.over:
                return
            rounds, index = divmod(self._next, len(self._messages))
            if rounds and not self._repeat:
                return
            at, message = self._messages[index]
            wait = self._began + rounds * self._length + at - self._clock.monotonic()
            # 1e-9: what is due now must not be late by the rounding.
            if wait > 1e-9:
                self._timer = self._clock.call_later(wait, self._go_on)
                return
            self._next += 1
            self._publisher.publish(message)
        self._timer = self._clock.call_later(0.0, self._go_on)

    def end(self) -> None:
        """Stop the clock's timer."""
        if self._timer is not None:
            self._timer.cancel()
