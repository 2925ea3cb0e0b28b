"""The publishers and subscriptions of a :class:`~rwt_graph.nodes.node.Node`, which take typed messages."""

from __future__ import annotations

import inspect
import logging
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import anyio

from rwt_graph import api
from rwt_graph.api import Graph, Participant, Sample
from rwt_participant.errors import HandleClosed, TimedOut
from rwt_participant.handles import Publisher, Subscription
from rwt_participant.messages import Message, MessageCallback, MessageLike, is_coroutine_function, to_payload
from rwt_participant.qos import QoS

if TYPE_CHECKING:
    from rwt_interfaces.structs import MessageType

logger = logging.getLogger(__name__)


class TopicPublisher(Publisher):
    """Publishes on one topic. `publish` may be called from any thread while the graph runs."""

    def __init__(self, graph: Graph, publisher: api.Publisher) -> None:
        self.name = publisher.topic
        self.type = publisher.type
        self._graph = graph
        self._publisher = publisher
        self.now_ns = graph.clock.time_ns

    def publish(self, message: MessageLike) -> None:
        """Send one message to every subscriber.

        The message is checked here, in the caller's thread; from another thread than the graph's it is then
        handed over, and messages of one thread stay in order.

        Raises:
            InvalidMessage: the message does not fit the topic's type.
        """
        payload = to_payload(self.type, message, self.now_ns)
        if self._graph.on_graph_thread():
            self._publisher.publish(payload)
        else:
            self._graph.run_on_graph(partial(self._publisher.publish, payload))

    @property
    def subscriber_count(self) -> int:
        """How many subscribers are known now."""
        return self._publisher.subscriber_count

    def close(self) -> None:
        """Leave the topic; messages kept for late joiners go with the publisher."""
        if self._graph.on_graph_thread():
            self._publisher.close()
        else:
            self._graph.run_on_graph(self._publisher.close)


class SampleQueue:
    """Samples for a coroutine: bounded in number and bytes, the newest are kept.

    Args:
        topic: whose samples these are, for the log.
        size: samples that may wait.
        most_bytes: what those may take that came while others waited; the newest stays however big it is.
        time_ns: the graph's clock.

    Attributes:
        dropped: how many samples gave way to newer ones.
    """

    def __init__(self, topic: str, size: int, most_bytes: int, time_ns: Callable[[], int]) -> None:
        self._topic = topic
        self._time_ns = time_ns
        self._samples: deque[tuple[Sample, int]] = deque()
        self._most = max(1, size)
        self._most_bytes = most_bytes
        self._bytes = 0
        self._arrived: anyio.Event | None = None
        self._closed = False
        self._has_warned = False
        self.dropped = 0

    def put(self, sample: Sample) -> None:
        """Add a sample; the oldest make room."""
        # Where the reader keeps up nothing waits, and nothing has to be measured.
        size = self._room_for(sample) if self._samples else 0
        self._samples.append((sample.detach(), size))
        self._wake()

    def _room_for(self, sample: Sample) -> int:
        """What a sample takes, once there is room for it."""
        samples, size = self._samples, sample.payload.kept_size
        self._bytes += size
        while samples and (len(samples) >= self._most or self._bytes > self._most_bytes):
            if len(samples) < self._most and not self._has_warned:
                self._has_warned = True
                logger.warning(
                    "messages of %s are dropped: more than %d bytes wait for their subscriber;"
                    " `queue_bytes` of what subscribes allows more",
                    self._topic,
                    self._most_bytes,
                )
            self._bytes -= samples.popleft()[1]
            self.dropped += 1
        return size

    def _wake(self) -> None:
        arrived, self._arrived = self._arrived, None
        if arrived is not None:
            arrived.set()

    async def get(self) -> Sample | None:
        """The oldest sample that has not expired, waiting for one; None after `close`."""
        while True:
            if self._samples:
                sample, size = self._samples.popleft()
                self._bytes -= size
                if not sample.expires_ns or sample.expires_ns >= self._time_ns():
                    return sample
                continue
            if self._closed:
                return None
            if self._arrived is None:
                self._arrived = anyio.Event()
            await self._arrived.wait()

    def close(self) -> None:
        """Let readers end; what was not read is dropped."""
        self._closed = True
        self._samples.clear()
        self._bytes = 0
        self._wake()


class TopicSubscription(Subscription):
    """Receives one topic, through a callback or as an asynchronous iterator.

    Attributes:
        name: absolute name of the topic.
    """

    def __init__(
        self,
        graph: Graph,
        participant: Participant,
        topic: str,
        callback: MessageCallback | None,
        on_sample: Callable[[Sample], None] | None,
        interface: MessageType | None,
        qos: QoS,
        queue_size: int,
        queue_bytes: int,
    ) -> None:
        self.name = topic
        self._graph = graph
        self._has_callback = callback is not None
        self._queue: SampleQueue | None
        receive = on_sample or _at_once(callback)
        if receive is None:
            self._queue = SampleQueue(topic, queue_size, queue_bytes, graph.clock.time_ns)
            receive = self._queue.put
        else:
            self._queue = None
        self._subscription: api.Subscription = participant.subscribe(topic, receive, interface, qos)
        if self._queue is not None and callback is not None:
            graph.spawn(partial(self._call_in_turn, self._queue, callback), f"subscriber of {topic}")

    async def _call_in_turn(self, queue: SampleQueue, callback: MessageCallback) -> None:
        while (sample := await queue.get()) is not None:
            try:
                returned = callback(sample.payload.value())
                if inspect.isawaitable(returned):
                    await returned
            except Exception:
                logger.exception("a subscriber of %s failed", self.name)

    @property
    def type(self) -> MessageType | None:
        """The topic's type; None while there is none."""
        return self._subscription.type

    @property
    def dropped(self) -> int:
        """How many messages the queue of a coroutine callback or iterator had no room for."""
        return 0 if self._queue is None else self._queue.dropped

    async def get(self, timeout: float | None = None) -> Message:
        """The next message.

        Args:
            timeout: seconds of the graph's clock; None waits as long as it takes.

        Raises:
            TimedOut: none came in time.
            HandleClosed: the subscription was closed.
            RuntimeError: the subscription has a callback, which receives the messages already.
        """
        with self._graph.clock.within(timeout):
            try:
                return await anext(self)
            except StopAsyncIteration:
                raise HandleClosed(f"the subscription to {self.name} was closed") from None
        raise TimedOut(f"no message came on {self.name} within {timeout:g} s")

    async def __anext__(self) -> Message:
        if self._queue is None or self._has_callback:
            raise RuntimeError(f"the subscription to {self.name} has a callback: use `topic` to iterate")
        sample = await self._queue.get()
        if sample is None:
            raise StopAsyncIteration
        return sample.payload.value()

    def close(self) -> None:
        """Leave the topic; no callback is begun after this, iterators end."""
        if not self._graph.on_graph_thread():
            self._graph.run_on_graph(self.close)
            return
        self._subscription.close()
        if self._queue is not None:
            self._queue.close()


def _at_once(callback: MessageCallback | None) -> Callable[[Sample], None] | None:
    """The sample callback of a plain function; None for a callback that needs a queue."""
    if callback is None or is_coroutine_function(callback):
        return None

    def receive(sample: Sample) -> None:
        callback(sample.payload.value())

    return receive
