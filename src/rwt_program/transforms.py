"""Where frames of the robot are, as its transforms tell."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, Protocol, TypeVar

import anyio

from rwt_program.errors import CallFailed, RobotError, TransformUnavailable
from rwt_program.future import USUAL, Timeout, Within
from rwt_program.handles import Handle
from rwt_tf2 import Buffer, ExtrapolationError, Feed, LookupFailed, StampedTransform, Verdict, stamp_ns

T = TypeVar("T")

When = Any
"""A time: nanoseconds, the stamp of a message, or None for the latest."""

_MESSAGE: Final = "tf2_msgs/TFMessage"


class Subscribe(Protocol):
    """Subscribes to a topic: the verb of :class:`~rwt_program.api.RobotApi`."""

    def __call__(self, topic: str, callback: Callable[[Any], None], type: str, /) -> Handle:
        """Call `callback` with each message."""


class Transforms:
    """The robot's tree of frames, kept up to date from the first question on.

    Args:
        subscribe: how to hear `/tf` and `/tf_static`.
        timeout: seconds that a question waits for its answer by default; None waits as long as it takes.
        within: the clock that bounds it.

    Attributes:
        buffer: all that was heard; :class:`rwt_tf2.Buffer`.
    """

    _topics: str = "/tf or /tf_static"

    def __init__(
        self, subscribe: Subscribe, timeout: float | None, within: Within = anyio.move_on_after
    ) -> None:
        self.buffer = Buffer()
        self._hear = subscribe
        self._timeout = timeout
        self._within = within
        self._feed = Feed(self.buffer)
        self._changed: anyio.Event | None = None
        self._subscriptions: list[Handle] = []
        self._ended: CallFailed | None = None

    # -- listening -----------------------------------------------------------------------------------------

    async def start(self) -> None:
        """Listen to `/tf` and `/tf_static`, unless that has begun. Every question does so by itself."""
        if self._subscriptions:
            return
        try:
            await self._subscribe("/tf_static", _MESSAGE, static=True)
            await self._subscribe("/tf", _MESSAGE)
        except RobotError:
            self.close()
            raise

    def close(self) -> None:
        """Listen no more and forget everything; the next question begins with nothing."""
        self._unsubscribe()
        self.buffer = Buffer()
        self._feed = Feed(self.buffer)

    async def _subscribe(self, topic: str, type: str, *, static: bool = False) -> None:
        feed = self._feed

        def take(message: Any) -> None:
            feed.take(message, static=static)
            self._wake()

        subscription = self._hear(topic, take, type)
        self._subscriptions.append(subscription)
        await subscription.ready()

    def _unsubscribe(self) -> None:
        for subscription in self._subscriptions:
            subscription.close()
        self._subscriptions.clear()

    def end(self, error: CallFailed) -> None:
        """No transform comes any more: questions that wait fail with `error`, and those to come."""
        self._ended = error
        self._wake()

    def _wake(self) -> None:
        changed, self._changed = self._changed, None
        if changed is not None:
            changed.set()

    # -- questions -----------------------------------------------------------------------------------------

    async def lookup(
        self, target: str, source: str, time: When = None, *, timeout: Timeout = USUAL
    ) -> StampedTransform:
        """What takes points of the frame `source` to the frame `target`; waits until it is known.

        Args:
            time: nanoseconds, or a message's stamp; None for the latest that can be had.
            timeout: seconds; None waits as long as it takes. By default what the node or connection has.

        Returns:
            The transform, and of what time it is. `found.transform.apply(point)` takes a point,
            `found.transform.matrix()` is the 4 x 4 matrix.

        Raises:
            TransformUnavailable: it did not become known in time, or the time asked for is over; says why.
            ConnectionLost: there will be no connection any more.
        """
        wanted = _nanoseconds(time)
        return await self._ask(lambda: self.buffer.lookup_transform(target, source, wanted), wanted, timeout)

    async def lookup_full(
        self,
        target: str,
        target_time: When,
        source: str,
        source_time: When,
        fixed: str,
        *,
        timeout: Timeout = USUAL,
    ) -> StampedTransform:
        """:meth:`lookup` between two times, by way of a frame that did not move between them.

        Raises:
            TransformUnavailable: as :meth:`lookup`.
            ConnectionLost: there will be no connection any more.
        """
        there, here = _nanoseconds(target_time), _nanoseconds(source_time)
        return await self._ask(
            lambda: self.buffer.lookup_transform_full(target, there, source, here, fixed),
            there and here,
            timeout,
        )

    async def can_transform(self, target: str, source: str, time: When = None) -> Verdict:
        """Whether :meth:`lookup` would answer at once; the verdict is true or false and has a `reason`."""
        await self.start()
        return self.buffer.can_transform(target, source, _nanoseconds(time))

    async def _ask(self, question: Callable[[], T], time_ns: int | None, timeout: Timeout) -> T:
        await self.start()
        patience = self._timeout if timeout is USUAL else timeout
        failure: LookupFailed | None = None
        with self._within(patience):
            while self._ended is None:
                try:
                    return question()
                except LookupFailed as error:
                    failure = error
                    if time_ns and isinstance(error, ExtrapolationError) and not error.future:
                        break
                if self._changed is None:
                    self._changed = anyio.Event()
                await self._changed.wait()
        if self._ended is not None:
            raise self._ended
        raise TransformUnavailable(self._text(failure, patience)) from failure

    def _text(self, failure: LookupFailed | None, patience: float | None) -> str:
        waited = "" if patience is None else f" within {patience:g} s"
        if self._feed.taken:
            return f"the transform was not to be had{waited}: {failure}"
        return f"no transform came on {self._topics}{waited}: does the robot publish any?"


def _nanoseconds(time: When) -> int | None:
    if time is None or isinstance(time, int):
        return time
    return stamp_ns(time)
