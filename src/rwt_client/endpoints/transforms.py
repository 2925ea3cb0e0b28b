"""Where frames of the robot are, as its transforms tell."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeVar

import anyio

from rwt_client.errors import ConnectionLost
from rwt_client.events import ConnectionEvent
from rwt_program.errors import RobotError, TransformUnavailable
from rwt_tf2 import Buffer, ExtrapolationError, Feed, LookupFailed, StampedTransform, Verdict, stamp_ns

if TYPE_CHECKING:
    from rwt_client.endpoints.subscriptions import Subscription
    from rwt_client.robot import Robot

logger = logging.getLogger("rwt_client")

T = TypeVar("T")

When = Any
"""A time: nanoseconds, the stamp of a message, or None for the latest."""

REPUBLISHER: Final = "/republish_tfs"

_DEFAULT: Any = object()
_MESSAGE = "tf2_msgs/TFMessage"
_ARRAY = "tf2_web_republisher/TFArray"


@dataclass(frozen=True, slots=True)
class _Thresholds:
    """What is asked of the republisher; see :meth:`Transforms.start_compact`."""

    rate: float
    linear: float
    angular: float

    def request(self) -> dict[str, object]:
        """Without a target, which asks for the tree."""
        return {"rate": self.rate, "trans_thres": self.linear, "angular_thres": self.angular}


class Transforms:
    """The robot's tree of frames, kept up to date from the first question on.

    Attributes:
        buffer: all that was heard; :class:`rwt_tf2.Buffer`.
    """

    def __init__(
        self, robot: Robot, background: Callable[[Callable[[], Any]], object], timeout: float | None
    ) -> None:
        self.buffer = Buffer()
        self._robot = robot
        self._background = background
        self._timeout = timeout
        self._feed = Feed(self.buffer)
        self._changed = anyio.Event()
        self._subscriptions: list[Subscription] = []
        self._stop_listening: Callable[[], None] | None = None
        self._thresholds: _Thresholds | None = None
        self._closed = False

    # -- listening -------------------------------------------------------------------------------------------

    async def start(self) -> None:
        """Listen to `/tf` and `/tf_static`, unless that has begun. Every question does so by itself."""
        if self._stop_listening is not None:
            return
        self._stop_listening = self._robot.on_event(self._on_event)
        try:
            await self._subscribe("/tf_static", _MESSAGE, static=True)
            await self._subscribe("/tf", _MESSAGE)
        except RobotError:
            self.close()
            raise

    async def start_compact(self, rate: float = 10.0, linear: float = 0.01, angular: float = 0.01) -> None:
        """Have the robot's tf2_web_republisher send what changes, in CBOR, instead of all of `/tf`.

        No frame, as seen from the root of its tree, is then off by more than the thresholds at the time of a
        message. Only the latest transforms are known: answers are those, whatever time was asked for. This
        needs a server of this project.

        Args:
            rate: messages a second, at most.
            linear: metres.
            angular: radians.

        Raises:
            CallFailed: the server has no republisher.
        """
        self.close()
        self._thresholds = _Thresholds(rate, linear, angular)
        try:
            await self._follow()
        except RobotError:
            self._thresholds = None
            raise
        self._stop_listening = self._robot.on_event(self._on_event)

    def close(self) -> None:
        """Listen no more and forget everything; the next question begins anew."""
        if self._stop_listening is not None:
            self._stop_listening()
            self._stop_listening = None
        self._unsubscribe()
        self._thresholds = None
        self.buffer = Buffer()
        self._feed = Feed(self.buffer)

    async def _follow(self) -> None:
        """Ask for a topic of our own and subscribe to it."""
        assert self._thresholds is not None  # Only the compact way follows.
        answer = await self._robot.call(
            REPUBLISHER, self._thresholds.request(), "tf2_web_republisher/RepublishTFs"
        )
        self._unsubscribe()
        await self._subscribe(answer.topic_name, _ARRAY, static=True)

    async def _subscribe(self, topic: str, type_name: str, *, static: bool = False) -> None:
        feed = self._feed

        def take(message: Any) -> None:
            feed.take(message, static=static)
            self._changed.set()

        binary = self._robot.takes_binary and self._thresholds is not None
        subscription = await self._robot.subscribe(
            topic, type_name, take, compression="cbor" if binary else "none"
        )
        self._subscriptions.append(subscription)

    def _unsubscribe(self) -> None:
        for subscription in self._subscriptions:
            subscription.close()
        self._subscriptions.clear()

    def _on_event(self, event: ConnectionEvent) -> None:
        if event.kind == "closed":
            self._closed = True
            self._changed.set()
        elif event.kind == "restored" and self._thresholds is not None:
            # The topic of the connection that was lost has gone with it.
            self._background(self._follow_again)

    async def _follow_again(self) -> None:
        try:
            await self._follow()
        except RobotError as error:
            logger.warning("the robot's transforms are not heard any more: %s", error)

    # -- questions -------------------------------------------------------------------------------------------

    async def lookup(
        self, target: str, source: str, time: When = None, *, timeout: float | None = _DEFAULT
    ) -> StampedTransform:
        """What takes points of the frame `source` to the frame `target`; waits until it is known.

        Args:
            time: nanoseconds, or a message's stamp; None for the latest that can be had.
            timeout: seconds; None waits for ever. By default what :func:`rwt_client.connect` was told.

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
        timeout: float | None = _DEFAULT,
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

    async def _ask(self, question: Callable[[], T], time_ns: int | None, timeout: float | None) -> T:
        await self.start()
        patience = self._timeout if timeout is _DEFAULT else timeout
        failure: LookupFailed | None = None
        with anyio.move_on_after(patience):
            while not self._closed:
                self._changed = anyio.Event() if self._changed.is_set() else self._changed
                try:
                    return question()
                except LookupFailed as error:
                    failure = error
                    if time_ns and isinstance(error, ExtrapolationError) and not error.future:
                        break
                await self._changed.wait()
        if self._closed:
            raise ConnectionLost("the connection was closed before the transform was known")
        raise TransformUnavailable(self._text(failure, patience)) from failure

    def _text(self, failure: LookupFailed | None, patience: float | None) -> str:
        waited = "" if patience is None else f" within {patience:g} s"
        if self._feed.taken:
            return f"the transform was not to be had{waited}: {failure}"
        where = "/tf or /tf_static" if self._thresholds is None else "the republisher's topic"
        return f"no transform came on {where}{waited}: does the robot publish any?"


def _nanoseconds(time: When) -> int | None:
    if time is None or isinstance(time, int):
        return time
    return stamp_ns(time)
