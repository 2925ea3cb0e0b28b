"""Transforms of a robot: lookup and broadcasting."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Final, TypeAlias, TypeVar

import anyio

from rwt_participant.errors import CallFailed, InvalidMessage, RobotError, TransformUnavailable
from rwt_participant.future import USUAL, Timeout, Within
from rwt_participant.handles import Handle, Publisher
from rwt_tf2 import (
    Buffer,
    ExtrapolationError,
    Feed,
    InvalidTransform,
    LookupFailed,
    StampedTransform,
    Transform,
    Verdict,
    stamp_ns,
    write_transform,
)

T = TypeVar("T")

When = Any
"""Time: nanoseconds, the stamp of a message, or None for the latest."""

_MESSAGE: Final = "tf2_msgs/TFMessage"


SubscribeVerb: TypeAlias = Callable[[str, Callable[[Any], None], str], Handle]
"""Verb `subscribe` of :class:`~rwt_participant.api.RobotApi`, with topic, callback and type."""


AdvertiseVerb: TypeAlias = Callable[..., Publisher]
"""Verb `advertise` of :class:`~rwt_participant.api.RobotApi`."""


class Transforms:
    """Tree of frames of a robot, kept up to date from the first lookup, and broadcaster of transforms.

    Args:
        subscribe: subscribes to `/tf` and `/tf_static`.
        time_ns: returns the default time of transforms.
        timeout: default timeout of lookups in seconds; None waits without limit.
    """

    _topics: str = "/tf or /tf_static"

    def __init__(
        self,
        subscribe: SubscribeVerb,
        advertise: AdvertiseVerb,
        time_ns: Callable[[], int],
        timeout: float | None,
        within: Within = anyio.move_on_after,
    ) -> None:
        self.buffer = Buffer()
        self._hear = subscribe
        self._advertise = advertise
        self._time_ns = time_ns
        self._timeout = timeout
        self._within = within
        self._feed = Feed(self.buffer)
        self._changed: anyio.Event | None = None
        self._subscriptions: list[Handle] = []
        self._ended: CallFailed | None = None
        self._moving: Publisher | None = None
        self._fixed: Publisher | None = None
        self._fixed_transforms: dict[str, StampedTransform] = {}

    # -- listening -----------------------------------------------------------------------------------------

    async def start(self) -> None:
        """Subscribe to `/tf` and `/tf_static`; every lookup does so, too. No-op if it has started."""
        if self._subscriptions:
            return
        try:
            await self._subscribe("/tf_static", _MESSAGE, static=True)
            await self._subscribe("/tf", _MESSAGE)
        except RobotError:
            self.close()
            raise

    def close(self) -> None:
        """Unsubscribe and discard all transforms; the next lookup starts again."""
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
        """Fail pending and future lookups with `error`: no more transforms will arrive."""
        self._ended = error
        self._wake()

    def _wake(self) -> None:
        changed, self._changed = self._changed, None
        if changed is not None:
            changed.set()

    # -- broadcasting ----------------------------------------------------------------------------------------

    def send_transform(
        self, parent: str, child: str, transform: Transform, time: When = None, *, static: bool = False
    ) -> None:
        """Broadcast the transform of a frame.

        Args:
            parent: frame that `transform` leads to, such as `odom`.
            child: frame that it leads from, such as `base_link`; each has one parent.
            time: nanoseconds, or a message's stamp; None is now, by the clock of a node's graph or of a
                client's computer.
            static: publish once on `/tf_static`, where it is retained for late joiners with the other static
                transforms of this program. Other transforms are published on `/tf`; repeat them at 10 Hz or
                more.

        Raises:
            InvalidMessage: a frame is empty or its own parent, a number is not finite, or the rotation is not
                a unit quaternion; the text names the frame.
            NotConnected: of a client: there is no connection now. A static transform is sent after
                reconnecting.
        """
        now = self._time_ns() if time is None else _nanoseconds(time)
        self.send_transforms([StampedTransform(parent, child, now or 0, transform)], static=static)

    def send_transforms(self, transforms: Iterable[StampedTransform], *, static: bool = False) -> None:
        """Broadcast several transforms in one message; see :meth:`send_transform`.

        Raises:
            InvalidMessage: one of them is invalid; none is sent.
            NotConnected: of a client: there is no connection now.
        """
        try:
            checked = [each.checked() for each in transforms]
        except InvalidTransform as error:
            raise InvalidMessage("transforms", str(error)) from None
        if not static:
            if self._moving is None:
                self._moving = self._advertise("/tf", _MESSAGE)
            self._moving.publish(_message(checked))
            return
        self._fixed_transforms.update({each.child: each for each in checked})
        self.send_static_again()

    def send_static_again(self) -> None:
        """Publish the static transforms again, if there are any."""
        if not self._fixed_transforms:
            return
        if self._fixed is None:
            self._fixed = self._advertise("/tf_static", _MESSAGE, latch=True)
        self._fixed.publish(_message(self._fixed_transforms.values()))

    # -- lookups ---------------------------------------------------------------------------------------------

    async def lookup(
        self, target: str, source: str, time: When = None, *, timeout: Timeout = USUAL
    ) -> StampedTransform:
        """Wait for the transform that takes points of the frame `source` to the frame `target`.

        Args:
            time: nanoseconds, or a message's stamp; None for the latest available.
            timeout: seconds; None waits without limit. By default that of the node or the connection.

        Returns:
            Transform and its time. `found.transform.apply(point)` transforms a point,
            `found.transform.matrix()` is the 4 x 4 matrix.

        Raises:
            TransformUnavailable: it did not become available in time, or `time` is older than the history;
                with the reason.
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
        """Look up a transform between two times, through a frame that did not move between them.

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
        """Return a verdict that is true if :meth:`lookup` would return at once, and has a `reason`."""
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
        waited = "" if patience is None else f" within {patience:g} s"
        text = f"no transform came on {self._topics}{waited}: does the robot publish any?"
        if self._feed.taken:
            text = f"the transform was not available{waited}: {failure}"
        raise TransformUnavailable(text) from failure


def _nanoseconds(time: When) -> int | None:
    if time is None or isinstance(time, int):
        return time
    return stamp_ns(time)


def _message(transforms: Iterable[StampedTransform]) -> dict[str, object]:
    return {"transforms": [write_transform(each) for each in transforms]}
