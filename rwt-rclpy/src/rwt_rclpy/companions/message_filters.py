"""`message_filters`: synchronisation of messages of several topics."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from rwt_rclpy.clocks.duration import S_TO_NS
from rwt_rclpy.clocks.time import Time

if TYPE_CHECKING:
    from rwt_rclpy.nodes.node import Node


def _stamp(message: Any) -> int:
    return int(message.header.stamp.sec * S_TO_NS + message.header.stamp.nanosec)


class SimpleFilter:
    """Base of filters, which pass messages to callbacks."""

    def __init__(self) -> None:
        self.callbacks: dict[int, tuple[Callable[..., Any], tuple[Any, ...]]] = {}

    def registerCallback(self, cb: Callable[..., Any], *args: Any) -> int:  # message_filters' name
        """Register a callback for each message, followed by `args`; return its number."""
        number = len(self.callbacks)
        self.callbacks[number] = (cb, args)
        return number

    def signalMessage(self, *msg: Any) -> None:  # message_filters' name
        """Pass messages to the callbacks."""
        for callback, args in tuple(self.callbacks.values()):
            callback(*msg, *args)


class Subscriber(SimpleFilter):
    """Filter with the messages of a topic; arguments as of `create_subscription`, without a callback."""

    def __init__(self, node: Node, msg_type: Any, topic: str, qos_profile: Any = 10, **kwargs: Any) -> None:
        super().__init__()
        self.node = node
        self.topic = topic
        self.sub = node.create_subscription(msg_type, topic, self.signalMessage, qos_profile, **kwargs)

    def getTopic(self) -> str:  # message_filters' name
        """Return the topic."""
        return self.topic


class Cache(SimpleFilter):
    """Cache of the last messages of a filter, by time.

    Args:
        f: filter.
        cache_size: number of kept messages.
        allow_headerless: True to keep messages without a header, by their time of arrival.
    """

    def __init__(
        self, f: SimpleFilter | None = None, cache_size: int = 1, allow_headerless: bool = False
    ) -> None:
        super().__init__()
        self.cache_size = cache_size
        self.allow_headerless = allow_headerless
        self._kept: list[tuple[int, Any]] = []
        if f is not None:
            f.registerCallback(self.add)

    def add(self, msg: Any) -> None:
        """Store a message."""
        if hasattr(msg, "header"):
            stamp = _stamp(msg)
        elif self.allow_headerless:
            from rwt_rclpy.clocks.timekeeper import current

            stamp = current().system_ns()
        else:
            raise ValueError("Cannot use message_filters with messages without a header")
        self._kept.append((stamp, msg))
        del self._kept[: -self.cache_size]
        self.signalMessage(msg)

    def getInterval(self, from_stamp: Time, to_stamp: Time) -> list[Any]:  # message_filters' name
        """Return the messages between two times, inclusive."""
        return [msg for stamp, msg in self._kept if from_stamp.nanoseconds <= stamp <= to_stamp.nanoseconds]

    def getElemAfterTime(self, stamp: Time) -> Any:  # message_filters' name
        """Return the first message at or after a time, or None."""
        return next((msg for at, msg in self._kept if at >= stamp.nanoseconds), None)

    def getElemBeforeTime(self, stamp: Time) -> Any:  # message_filters' name
        """Return the last message at or before a time, or None."""
        return next((msg for at, msg in reversed(self._kept) if at <= stamp.nanoseconds), None)

    def getLast(self) -> Any:  # message_filters' name
        """Return the last message, or None."""
        return self._kept[-1][1] if self._kept else None


class TimeSynchronizer(SimpleFilter):
    """Synchroniser of messages with equal stamps, one of each filter.

    Args:
        fs: filters.
        queue_size: maximum number of queued messages per filter.
    """

    def __init__(self, fs: Sequence[SimpleFilter], queue_size: int) -> None:
        super().__init__()
        self.queue_size = queue_size
        self.connectInput(fs)

    def connectInput(self, fs: Sequence[SimpleFilter]) -> None:  # message_filters' name
        """Connect to filters."""
        self.queues: list[dict[int, Any]] = [{} for _ in fs]
        for number, each in enumerate(fs):
            each.registerCallback(self._added, number)

    def _added(self, msg: Any, number: int) -> None:
        self.add(msg, self.queues[number], number)

    def _keep(self, msg: Any, queue: dict[int, Any], stamp: int) -> None:
        queue[stamp] = msg
        while len(queue) > self.queue_size:
            del queue[min(queue)]

    def add(self, msg: Any, my_queue: dict[int, Any], my_queue_index: int | None = None) -> None:
        """Store a message, and pass on complete sets."""
        stamp = _stamp(msg)
        self._keep(msg, my_queue, stamp)
        if all(stamp in queue for queue in self.queues):
            self.signalMessage(*(queue.pop(stamp) for queue in self.queues))


class ApproximateTimeSynchronizer(TimeSynchronizer):
    """Synchroniser of messages with close stamps.

    Args:
        fs: filters.
        queue_size: maximum number of queued messages per filter.
        slop: maximum difference of stamps in seconds.
        allow_headerless: True to use the time of arrival for messages without a header.
    """

    def __init__(
        self, fs: Sequence[SimpleFilter], queue_size: int, slop: float, allow_headerless: bool = False
    ) -> None:
        super().__init__(fs, queue_size)
        self.slop_ns = round(slop * S_TO_NS)
        self.allow_headerless = allow_headerless

    def add(self, msg: Any, my_queue: dict[int, Any], my_queue_index: int | None = None) -> None:
        """Store a message, and pass on the closest matching set."""
        if hasattr(msg, "header"):
            stamp = _stamp(msg)
        elif self.allow_headerless:
            from rwt_rclpy.clocks.timekeeper import current

            stamp = current().system_ns()
        else:
            raise ValueError("Cannot use message_filters with messages without a header")
        self._keep(msg, my_queue, stamp)
        near: list[list[int]] = []
        for queue in self.queues:
            stamps = [stamp] if queue is my_queue else [at for at in queue if abs(at - stamp) <= self.slop_ns]
            near.append(sorted(stamps, key=lambda at: abs(at - stamp)))
        for chosen in itertools.product(*near):
            if max(chosen) - min(chosen) <= self.slop_ns:
                self.signalMessage(*(queue.pop(at) for queue, at in zip(self.queues, chosen, strict=True)))
                return
