"""Topics as resources: the latched message, the next one, all messages as events, and publishing."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Final

import anyio

from rwt.access.access import Access
from rwt.access.client_graph import ClientGraph, ClientPublisher
from rwt.access.graph_view import GraphView
from rwt.delivery.drop_notices import DropNotices
from rwt.delivery.throttle import Room, Throttle
from rwt.extensions.http.clients import Clients, HttpClient, ReaderStream
from rwt.extensions.http.events import SAMPLES, STREAM_BYTES, event
from rwt.extensions.http.problems import HttpProblem
from rwt.extensions.http.representations import CBOR, EVENTS, JSON, chosen, payload_response, value_response
from rwt.extensions.http.requests import IN_STEPS, MAX_WAIT_SECONDS, Query, name_below, payload_of
from rwt_graph.api import Sample
from rwt_participant.qos import LATCHED, Durability, QoS
from rwt_transports.endpoint import DropReason
from rwt_transports.http.routes import HttpRequest, HttpResponse

PATH: Final = "/api/topics/"

WAIT_SECONDS: Final = 5.0
"""Default time to wait for the next message if none is retained, in seconds."""

_MARK: Final = object()
"""Tag of the advertisements of this gateway's clients."""

MAX_THROTTLE: Final = 3600.0
"""Maximum interval between two events, in seconds."""

MAX_EVENTS: Final = 10_000
"""Maximum size of a reader's event queue."""

_EVENTS: Final = 100
"""Default size of a reader's event queue."""


_INSTEAD: Final = "read faster, ask for fewer with ?throttle=SECONDS, or let more wait with ?queue=COUNT"


class TopicPages:
    """Routes of topics."""

    def __init__(self, clients: Clients, access: Access) -> None:
        self._clients = clients
        self._log = partial(access.audit.write, logging.INFO, "%s")

    def get(self, request: HttpRequest, reader: GraphView) -> HttpResponse | Awaitable[HttpResponse]:
        """Return the latched message, the next one, or all messages as events.

        ``?wait=SECONDS`` waits for the next message; ``?wait=0`` only returns a latched one.
        """
        name = name_below(request.path, PATH, "topic")
        media = chosen(request, (JSON, CBOR, EVENTS))
        with self._clients.client_of(request, reader) as client:
            query = Query(request, ("wait", "type", "throttle", "queue"))
            throttle = query.seconds("throttle", 0.0, MAX_THROTTLE)
            depth = query.count("queue", _EVENTS, MAX_EVENTS)
            if media == EVENTS:
                last = request.headers.get("last-event-id", "")
                stream = TopicEvents(
                    client,
                    name,
                    query.text("type"),
                    throttle=throttle,
                    depth=depth,
                    max_bytes=STREAM_BYTES,
                    log=self._log,
                )
                # Ids are nanoseconds since the epoch; with an id in another form, everything is replayed.
                stream.replay(int(last) if last.isascii() and last.isdecimal() and len(last) < 20 else -1)
                return stream.response(request)
            longest = MAX_WAIT_SECONDS
            seconds = query.seconds("wait", min(WAIT_SECONDS, longest), longest)
            if "wait" not in query or not seconds:
                # Subscribing checks the right to read the topic, also if no message is retained.
                fanout = client.graph.subscribe(name, query.text("type"))
                kept = (*fanout.subscription.history(), *client.graph.startup_samples(fanout))
                client.graph.unsubscribe(fanout)
                if kept:
                    # Several may be retained: one per publisher, or more with a longer history.
                    return _message(request, reader, max(kept, key=lambda sample: sample.stamp_ns))
        if not seconds:
            raise HttpProblem("no-message", f"no message of {name} is kept for late readers")
        # A coroutine, which runs after this block has ended and holds the client itself.
        return self._next(request, reader, name, query.text("type"), seconds)

    async def _next(
        self, request: HttpRequest, reader: GraphView, name: str, type: str | None, seconds: float
    ) -> HttpResponse:
        with self._clients.client_of(request, reader) as client, self._clients.waiting(client):
            sample = await _next_sample(client.graph, name, type, seconds)
        if sample is None:
            raise HttpProblem("timeout", f"no message of {name} came within {seconds:g} s")
        return _message(request, reader, sample)

    async def publish(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """Publish the body as one message."""
        name = name_below(request.path, PATH, "topic")
        query = Query(request, ("type", "latch"))
        type, is_latched = query.text("type"), query.flag("latch")
        with self._clients.client_of(request, reader) as client:
            publisher = _publisher(client.graph, name, type, is_latched)
            payload = await payload_of(publisher.type, request, client.graph.clock.time_ns)
            if len(request.body) >= IN_STEPS:
                # Decoding took turns: meanwhile the role may have changed, and the publisher been replaced.
                publisher = _publisher(client.graph, name, payload.type.name, is_latched)
            with client.graph.notices() as notices:
                publisher.publish(payload)
            publisher.counts.received += 1
            publisher.counts.received_bytes += len(request.body)
        # Report a command that the gate has changed.
        return value_response(request, {"gate": notices}) if notices else HttpResponse(status=204)


def _publisher(graph: ClientGraph, name: str, type: str | None, is_latched: bool) -> ClientPublisher:
    if not is_latched:
        return graph.publisher(name, type, _MARK)
    return graph.publisher(name, type, _MARK, LATCHED, _lacks_latch)


def _lacks_latch(qos: QoS) -> str:
    return "" if qos.durability is Durability.TRANSIENT_LOCAL else "it keeps nothing for late readers"


def _message(request: HttpRequest, reader: GraphView, sample: Sample) -> HttpResponse:
    type = reader.registry.type_name(sample.payload.type)
    seconds, nanoseconds = divmod(sample.stamp_ns, 1_000_000_000)
    headers = {"ROS-Type": type, "ROS-Time": f"{seconds}.{nanoseconds:09d}"}
    return payload_response(request, sample.payload, headers)


async def _next_sample(graph: ClientGraph, name: str, type: str | None, seconds: float) -> Sample | None:
    fanout = graph.subscribe(name, type)
    came = anyio.Event()
    found: list[Sample] = []
    ended: list[str] = []

    def take(sample: Sample) -> None:
        if not found:  # Others may follow before the waiting task runs.
            found.append(sample.detach())
            came.set()

    def leave() -> None:
        fanout.end_samples(take)
        graph.unsubscribe(fanout)

    def on_end(reason: str) -> None:
        leave()
        ended.append(reason)
        came.set()

    fanout.take_samples(take, on_end)
    try:
        with anyio.move_on_after(seconds):
            await came.wait()
    finally:
        if not ended:
            leave()
    if ended:
        raise HttpProblem("conflict", ended[0])
    return found[0] if found else None


class TopicEvents(ReaderStream):
    """Event stream of one reader of a topic, with at least `throttle` seconds between two events.

    Raises:
        RobotError, AccessError: as :meth:`rwt.access.client_graph.ClientGraph.subscribe`.
    """

    def __init__(
        self,
        client: HttpClient,
        name: str,
        type: str | None,
        *,
        throttle: float,
        depth: int,
        max_bytes: int,
        log: Callable[[str], None],
    ) -> None:
        super().__init__(client, depth, max_bytes, lambda graph: graph.may_subscribe(name))
        self._name = name
        self._has_left = False
        graph = client.graph
        self._fanout = graph.subscribe(name, type)
        self._drops = DropNotices(name, self._fanout.counts, graph.counters, graph.clock, self._notify, log)
        room = Room(max_bytes)
        self._throttle = Throttle(graph.clock, self.queue, self._drops.withheld, self._drop, room)
        self._throttle.configure(throttle, 1 if throttle else 0)
        self._stream = self._fanout.join(self._throttle, name, SAMPLES, self._end)

    def replay(self, after_ns: int) -> None:
        """Send the retained samples that were published after a time."""
        kept = (*self._fanout.subscription.history(), *self._client.graph.startup_samples(self._fanout))
        for sample in kept:
            if sample.stamp_ns > after_ns:
                self._stream.replay(sample, self._throttle)

    def _drop(self, reason: DropReason) -> None:
        self._dropped += 1
        self._drops.dropped(reason)

    def _notify(self, text: str) -> None:
        self.queue.tell(event({"topic": self._name, "dropped": self._dropped, "instead": _INSTEAD}, "drops"))

    def _end(self, reason: str) -> None:
        """End the stream with an event that says why: the robot gives the topic another type."""
        self.queue.tell(event({"topic": self._name, "reason": reason}, "end"))
        self._release()
        self.queue.end()

    def _close(self) -> None:
        self._release()
        super()._close()

    def _release(self) -> None:
        """Leave the topic. Idempotent."""
        if self._has_left:
            return
        self._has_left = True
        self._throttle.close()
        self._drops.close()
        self._fanout.leave(self._throttle, self._name, SAMPLES)
        self._client.graph.unsubscribe(self._fanout)
        del self._throttle, self._drops, self._stream  # They refer to this stream.
