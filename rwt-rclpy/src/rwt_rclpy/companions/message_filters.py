"""`message_filters`: synchronisation of messages of several topics."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from rwt_rclpy.clocks.clock import ROSClock
from rwt_rclpy.clocks.duration import Duration
from rwt_rclpy.clocks.time import Time
from rwt_rclpy.logs.logger import get_logger

if TYPE_CHECKING:
    from rwt_rclpy.nodes.node import Node


def _time_of(message: Any, allow_headerless: bool) -> Time | None:
    """Return the stamp of a message, for one without the current time, or None if that is not allowed."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is not None:
        return stamp if isinstance(stamp, Time) else Time.from_msg(stamp)
    if allow_headerless:
        return ROSClock().now()
    get_logger("message_filters").warning(
        f"{type(message).__name__} has no header and is dropped: allow_headerless is False"
    )
    return None


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
    """Filter with the messages of a topic; options as of `create_subscription`, and its attributes."""

    def __init__(self, node: Node, msg_type: Any, topic: str, /, **kwargs: Any) -> None:
        super().__init__()
        self.node = node
        self.topic = topic
        kwargs.setdefault("qos_profile", 10)
        self.sub = node.create_subscription(msg_type, topic, self.callback, **kwargs)

    def callback(self, msg: Any) -> None:
        """Pass a message to the callbacks."""
        self.signalMessage(msg)

    def getTopic(self) -> str:  # message_filters' name
        """Return the topic."""
        return self.topic

    def __getattr__(self, key: str) -> Any:
        return getattr(self.sub, key)


class Cache(SimpleFilter):
    """Cache of the last messages of a filter, by time.

    Args:
        f: filter.
        cache_size: number of kept messages.
        allow_headerless: True to keep messages without a header, by their time of arrival.
    """

    def __init__(self, f: SimpleFilter, cache_size: int = 1, allow_headerless: bool = False) -> None:
        super().__init__()
        self.cache_size = cache_size
        self.allow_headerless = allow_headerless
        self.cache_msgs: list[Any] = []
        self.cache_times: list[Time] = []
        self.connectInput(f)

    def connectInput(self, f: SimpleFilter) -> None:  # message_filters' name
        """Connect to a filter."""
        self.incoming_connection = f.registerCallback(self.add)

    def add(self, msg: Any) -> None:
        """Store a message."""
        time = _time_of(msg, self.allow_headerless)
        if time is None:
            return
        self.cache_msgs.append(msg)
        self.cache_times.append(time)
        del self.cache_msgs[: -self.cache_size], self.cache_times[: -self.cache_size]
        self.signalMessage(msg)

    def _where(self, chosen: Callable[[Time], bool]) -> list[Any]:
        return [msg for msg, time in zip(self.cache_msgs, self.cache_times, strict=True) if chosen(time)]

    def getInterval(self, from_stamp: Time, to_stamp: Time) -> list[Any]:  # message_filters' name
        """Return the messages between two times, inclusive. Raises AssertionError if the first is later."""
        assert from_stamp <= to_stamp
        return self._where(lambda time: from_stamp <= time <= to_stamp)

    def getElemAfterTime(self, stamp: Time) -> Any:  # message_filters' name
        """Return the first message at or after a time, or None."""
        return next(iter(self._where(lambda time: time >= stamp)), None)

    def getElemBeforeTime(self, stamp: Time) -> Any:  # message_filters' name
        """Return the last message at or before a time, or None."""
        return next(reversed(self._where(lambda time: time <= stamp)), None)

    def getLastestTime(self) -> Time | None:  # message_filters' name
        """Return the time of the last message, or None."""
        return self.cache_times[-1] if self.cache_times else None

    def getOldestTime(self) -> Time | None:  # message_filters' name
        """Return the time of the first message, or None."""
        return self.cache_times[0] if self.cache_times else None

    def getLast(self) -> Any:  # message_filters' name
        """Return the first message that is not older than the last one, or None."""
        return self.getElemAfterTime(self.cache_times[-1]) if self.cache_times else None


class TimeSynchronizer(SimpleFilter):
    """Synchroniser of messages with equal stamps, one of each filter.

    Args:
        fs: filters.
        queue_size: maximum number of queued messages per filter.
    """

    def __init__(self, fs: Sequence[SimpleFilter], queue_size: int) -> None:
        super().__init__()
        self.queue_size = queue_size
        self.lock = threading.Lock()
        self.connectInput(fs)

    def connectInput(self, fs: Sequence[SimpleFilter]) -> None:  # message_filters' name
        """Connect to filters."""
        self.queues: list[dict[int, Any]] = [{} for _ in fs]
        self.input_connections = [
            each.registerCallback(self.add, queue, number)
            for number, (each, queue) in enumerate(zip(fs, self.queues, strict=True))
        ]

    def _keep(self, msg: Any, queue: dict[int, Any], stamp: int) -> None:
        queue[stamp] = msg
        while len(queue) > self.queue_size:
            del queue[min(queue)]

    def add(self, msg: Any, my_queue: dict[int, Any], my_queue_index: int | None = None) -> None:
        """Store a message, and pass on complete sets."""
        stamp = Time.from_msg(msg.header.stamp).nanoseconds
        with self.lock:
            self._keep(msg, my_queue, stamp)
            if all(stamp in queue for queue in self.queues):
                self.signalMessage(*(queue.pop(stamp) for queue in self.queues))


class ApproximateTimeSynchronizer(TimeSynchronizer):
    """Synchroniser of messages with close stamps.

    Args:
        fs: filters.
        queue_size: maximum number of queued messages per filter.
        slop: limit of the difference of stamps in seconds; they differ by less.
        allow_headerless: True to use the time of arrival for messages without a header.
    """

    def __init__(
        self, fs: Sequence[SimpleFilter], queue_size: int, slop: float, allow_headerless: bool = False
    ) -> None:
        super().__init__(fs, queue_size)
        self.slop = Duration(seconds=slop)
        self.allow_headerless = allow_headerless

    def add(self, msg: Any, my_queue: dict[int, Any], my_queue_index: int | None = None) -> None:
        """Store a message, and pass on the closest matching set."""
        time = _time_of(msg, self.allow_headerless)
        if time is None:
            return
        stamp, slop = time.nanoseconds, self.slop.nanoseconds
        with self.lock:
            self._keep(msg, my_queue, stamp)
            near = []
            for queue in self.queues:
                limit = 0 if queue is my_queue else slop
                near.append(
                    sorted((at for at in queue if abs(at - stamp) <= limit), key=lambda at: abs(at - stamp))
                )
            for chosen in itertools.product(*near):
                if max(chosen) - min(chosen) < slop:
                    self.signalMessage(
                        *(queue.pop(at) for queue, at in zip(self.queues, chosen, strict=True))
                    )
                    return
