"""Publishers and subscriptions of a :class:`~rwt_graph.nodes.node.Node`, with typed messages."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import perf_counter

from rwt_graph import api
from rwt_graph.api import Graph, Sample
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import MessageType
from rwt_participant.errors import HandleClosed
from rwt_participant.handles import Publisher, Subscription
from rwt_participant.messages import (
    HELD_SECONDS,
    Message,
    MessageCallback,
    MessageLike,
    to_payload,
    warn_of_held_loop,
)
from rwt_participant.threads.outbox import Outbox


class TopicPublisher(Publisher):
    """Publisher of a program in the graph. `publish` may be called from any thread while the graph runs."""

    def __init__(self, graph: Graph, publisher: api.Publisher) -> None:
        self.name = publisher.topic
        self.type = publisher.type
        self._graph = graph
        self._publisher = publisher
        self.now_ns = graph.clock.time_ns
        self._outbox: Outbox[Payload] = Outbox(self.name, publisher.publish, graph.run_on_graph)

    def publish(self, message: MessageLike) -> None:
        """Publish one message; see :meth:`Publisher.publish`.

        The message is checked in the caller's thread, then queued for the graph's; messages of one thread
        stay in order. While the graph's thread is held, the newest messages are kept, and :attr:`dropped`
        counts the others.
        """
        if self._publisher.is_closed:
            raise HandleClosed(f"the publisher on {self.name} was closed")
        payload = to_payload(self.type, message, self.now_ns)
        if self._graph.on_graph_thread():
            self._publisher.publish(payload)
        else:
            self._outbox.put(payload, payload.kept_size)

    @property
    def dropped(self) -> int:
        """Messages of other threads that were dropped for newer ones: the graph's thread was held."""
        return self._outbox.dropped

    @property
    def subscriber_count(self) -> int:
        """Number of known subscribers; all clients of one server count as one."""
        return self._publisher.subscriber_count

    def close(self) -> None:
        self._graph.soon(self._publisher.close)


class TopicSubscription(Subscription):
    """Subscription of a program in the graph."""

    def __init__(
        self,
        graph: Graph,
        topic: str,
        listen: Callable[[Callable[[Sample], None]], api.Subscription],
        callback: MessageCallback | None,
        on_sample: Callable[[Sample], None] | None,
        queue_size: int,
        queue_bytes: int,
    ) -> None:
        super().__init__(topic, callback or on_sample, queue_size, queue_bytes, graph.clock.within)
        self._graph = graph
        if self._queue is None and callback is not None:
            on_sample = _timed(callback)
        self._subscription = listen(on_sample or self._put)
        if self._queue is not None and callback is not None:
            graph.spawn(partial(self._call_in_turn, self._queue, callback), f"subscriber of {topic}")

    def _put(self, sample: Sample) -> None:
        queue = self._queue
        assert queue is not None  # Only subscriptions with a queue put samples into it.
        # If no sample is queued, it is taken at once, so its size is not computed.
        queue.put(sample.detach(), sample.payload.kept_size if queue else 0)

    def _read(self, queued: Sample) -> Message | None:
        if queued.expires_ns and queued.expires_ns < self._graph.clock.time_ns():
            return None
        return queued.payload.value()

    @property
    def type(self) -> MessageType | None:
        return self._subscription.type

    def close(self) -> None:
        self._graph.soon(self._close)

    def _close(self) -> None:
        self._subscription.close()
        self._end(HandleClosed(f"the subscription to {self.name} was closed"))


def _timed(callback: MessageCallback) -> Callable[[Sample], None]:
    def receive(sample: Sample) -> None:
        message = sample.payload.value()
        began = perf_counter()
        callback(message)
        if (took := perf_counter() - began) >= HELD_SECONDS:
            warn_of_held_loop(callback, f"callback of {sample.topic}:", took)

    return receive
