"""`GET /metrics`: the counters of all gateways, collected on request.

Cardinality is bounded: gateways by the settings, topics by the counters, clients (totals only, by number) by
the connections, ops by the protocols.
"""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rwt.access.audit import LOG_LOSSES
from rwt.observability.build import build_id, version
from rwt.observability.prometheus import Kind, PrometheusText
from rwt.observability.supervision import Periodic
from rwt_interfaces.steps import Steps, finished

if TYPE_CHECKING:
    from rwt.access.gate.gate import Gate
    from rwt.access.graph_view import GraphView
    from rwt.access.quotas import WorkTotals
    from rwt.delivery.counters import EncodingCounts, TopicCounts
    from rwt.gateways.base import ConnectedClient, Gateway
    from rwt.observability.unmatched import GlobCheck
    from rwt.rosbridge.bridge import Bridge
    from rwt_graph.clock import Clock
    from rwt_participant.threads.pool import HandlerThreads
    from rwt_transports.endpoint import Traffic
    from rwt_transports.http.routes import HttpExtension, MetricFamily


class ServerMetrics:
    """Metrics of one server and of its HTTP extensions, collected on request.

    Attributes:
        globs: check of the globs in the settings; None without one.
    """

    def __init__(
        self,
        bridge: Bridge,
        extensions: Iterable[HttpExtension[GraphView]] = (),
        gateways: Iterable[Gateway] = (),
    ) -> None:
        self._bridge = bridge
        self._gateways: tuple[Gateway, ...] = (bridge, *gateways)
        self._of_nodes = [its.metrics for its in extensions if its.metrics is not None]
        self._problems = [its.problems for its in extensions if its.problems is not None]
        self.globs: GlobCheck | None = None
        self._loop_lag = LoopLag(bridge.shared.graph.clock, bridge.access.work)

    def include(self, count: Callable[[], Iterable[MetricFamily]]) -> None:
        """Add the metrics that `count` returns."""
        self._of_nodes.append(count)

    def text(self) -> bytes:
        """Return the page: metrics of the server, then of its nodes."""
        return finished(self.text_in_steps())

    def text_in_steps(self) -> Steps[bytes]:
        """Same as :meth:`text`, in steps: there may be thousands of topics."""
        page = PrometheusText()
        bridge = self._bridge
        counts = [GatewayCounts(gateway) for gateway in self._gateways]
        _write_totals(page, counts)
        goals = sum(peer.actions.goals_running for peer in bridge.clients)
        page.single("rwt_action_goals_running", "gauge", "Goals of rosbridge clients under way.", goals)
        help_ = "Lines that the log could not take."
        lost = bridge.access.audit.dropped_lines + LOG_LOSSES.lines
        page.single("rwt_lost_log_lines_total", "counter", help_, lost)
        _write_threads(page, bridge.shared.graph.handler_threads)
        _write_work(page, bridge)
        if bridge.access.gate is not None:
            _write_gate(page, bridge.access.gate)
        if self.globs is not None:
            help_ = "Globs of the settings, such as topics of gate rules, that match no name of the robot."
            page.single("rwt_unmatched_globs", "gauge", help_, len(self.globs.found))
        page.histogram(
            "rwt_loop_lag_seconds", "How late the event loop ran a timer.",
            LAG_BUCKETS, self._loop_lag.counts, self._loop_lag.total,
        )  # fmt: skip
        yield
        yield from _write_topics(page, counts)
        yield from _write_clients(page, counts)
        for count in self._of_nodes:
            for family in count():
                page.family(*family)
                yield
        write_process(page)
        return page.text()

    @property
    def work(self) -> float:
        """Seconds of work for clients per second, averaged over the last ten."""
        return self._loop_lag.rate_of_work

    @property
    def problems(self) -> list[str]:
        """What does not work at present, a sentence each."""
        gate = self._bridge.access.gate
        of_audit = gate.recorder.problems if gate is not None else ()
        of_log = ("log: lines are lost",) if LOG_LOSSES.is_losing else ()
        return [*of_log, *of_audit, *(problem for problems in self._problems for problem in problems())]

    @property
    def clients_beyond_rate(self) -> int:
        """Number of clients whose work currently exceeds their rate."""
        clients = (client for gateway in self._gateways for client in gateway.clients)
        return sum(client.graph.work.excess > 0.0 for client in clients)

    def close(self) -> None:
        """Stop measuring."""
        self._loop_lag.close()


class GatewayCounts:
    """Snapshot of the counters of one gateway; `counters` without the traffic of connected clients."""

    def __init__(self, gateway: Gateway) -> None:
        self.name = gateway.name
        self.fanouts = sorted(gateway.shared.fanouts.items())
        for _, fanout in self.fanouts:
            fanout.settle()
        self.counters = gateway.shared.counters
        self.clients = [(client, client.sink.traffic) for client in gateway.clients]


_OF_GATEWAY: Final[tuple[tuple[str, str, Callable[[GatewayCounts], int]], ...]] = (
    ("rwt_connections_total", "Clients that have connected.", lambda it: it.counters.clients),
    ("rwt_received_messages_total", "Messages from clients.",
     lambda it: it.counters.received + sum(client.messages for client, _ in it.clients)),
    ("rwt_received_bytes_total", "Bytes read from clients.",
     lambda it: it.counters.received_bytes + sum(traffic.received_bytes for _, traffic in it.clients)),
    ("rwt_sent_messages_total", "Messages to clients.",
     lambda it: it.counters.sent + sum(traffic.messages for _, traffic in it.clients)),
    ("rwt_sent_bytes_total", "Bytes written to clients.",
     lambda it: it.counters.sent_bytes + sum(traffic.bytes for _, traffic in it.clients)),
    ("rwt_service_calls_total", "Service calls of clients.", lambda it: it.counters.calls),
    ("rwt_action_goals_total", "Goals that clients sent.", lambda it: it.counters.goals),
    ("rwt_missed_deadlines_total", "Deadlines of `qos` that passed without a message.",
     lambda it: it.counters.missed_deadlines),
    ("rwt_clients", "Clients connected now.", lambda it: len(it.clients) + it.counters.present),
    ("rwt_service_calls_pending", "Calls of connected clients under way.",
     lambda it: sum(client.graph.calls_in_flight for client, _ in it.clients)),
)  # fmt: skip


def _write_threads(page: PrometheusText, threads: HandlerThreads) -> None:
    help_ = "Threads that run handlers of the robot's program."
    page.single("rwt_handler_threads", "gauge", help_, threads.busy)
    help_ = "Calls of handlers that wait for a thread."
    page.single("rwt_handler_threads_waiting", "gauge", help_, threads.waiting)
    help_ = "Calls of handlers that have had to wait for a thread."
    page.single("rwt_handler_thread_waits_total", "counter", help_, threads.waits)


def _write_totals(page: PrometheusText, gateways: list[GatewayCounts]) -> None:
    for name, help_, value in _OF_GATEWAY:
        page.family(name, _kind(name), help_, [({"gateway": its.name}, value(its)) for its in gateways])
    page.family(
        "rwt_refusals_total", "counter", "Messages that were refused, by op.",
        [
            ({"gateway": its.name, "op": op}, count)
            for its in gateways
            for op, count in sorted(its.counters.refusals.items())
        ],
    )  # fmt: skip
    page.family(
        "rwt_topic_client_subscriptions", "gauge", "Clients that listen to a topic.",
        [
            ({"gateway": its.name, "topic": name}, fanout.subscriptions)
            for its in gateways
            for name, fanout in its.fanouts
        ],
    )  # fmt: skip


def _kind(name: str) -> Kind:
    return "counter" if name.endswith("_total") else "gauge"


def _write_work(page: PrometheusText, bridge: Bridge) -> None:
    work = bridge.access.work
    page.family(
        "rwt_work_seconds_total", "counter", "Seconds of work for clients, by what it was for.",
        [({"kind": kind}, seconds) for kind, seconds in work.seconds.items()],
    )  # fmt: skip
    help_ = "Times that the work of a client beyond its rate waited for a turn of its own."
    page.single("rwt_work_waits_total", "counter", help_, work.waits)
    help_ = "Requests over HTTP that were refused, since their address was beyond its rate of work."
    page.single("rwt_work_refusals_total", "counter", help_, work.refused)


def _write_gate(page: PrometheusText, gate: Gate) -> None:
    page.family(
        "rwt_gate_events_total", "counter", "What the gate has decided and noted, by what became of it.",
        [({"decision": decision}, count) for decision, count in gate.recorder.counts.items()],
    )  # fmt: skip
    page.single("rwt_gate_stopped", "gauge", "1 while the emergency stop is on.", int(bool(gate.stopped_by)))
    help_ = "Lines of the audit that were not written: its queue was full, or the disk."
    page.single("rwt_gate_audit_dropped_lines_total", "counter", help_, gate.recorder.dropped_lines)


_OF_TOPIC: Final[tuple[tuple[str, str, Callable[[TopicCounts], int]], ...]] = (
    ("rwt_topic_received_messages_total", "Messages that clients published.", lambda it: it.received),
    ("rwt_topic_received_bytes_total", "Bytes of the messages that clients published.",
     lambda it: it.received_bytes),
)  # fmt: skip
_OF_ENCODING: Final[tuple[tuple[str, str, Callable[[EncodingCounts], int]], ...]] = (
    ("rwt_topic_encodes_total", "Messages encoded: once for all clients of one encoding.",
     lambda it: it.encodes),
    ("rwt_topic_sent_messages_total", "Messages handed to clients' connections.", lambda it: it.messages),
    ("rwt_topic_sent_bytes_total", "Bytes handed to clients' connections.", lambda it: it.bytes),
)  # fmt: skip
_OF_CLIENT: Final[tuple[tuple[str, str, Callable[[ConnectedClient[Any, Any], Traffic], float]], ...]] = (
    ("rwt_client_received_messages_total", "Messages from a client.", lambda client, _: client.messages),
    ("rwt_client_received_bytes_total", "Bytes read from a client.", lambda _, it: it.received_bytes),
    ("rwt_client_sent_messages_total", "Messages to a client.", lambda _, it: it.messages),
    ("rwt_client_sent_bytes_total", "Bytes written to a client.", lambda _, it: it.bytes),
    ("rwt_client_queued_messages", "Messages that wait for a client to read.",
     lambda _, it: it.queued_messages),
    ("rwt_client_queued_bytes", "Bytes that wait for a client to read.", lambda _, it: it.queued_bytes),
    ("rwt_client_kept_bytes", "Bytes of requests and latched samples kept for a client.",
     lambda client, _: client.graph.kept_bytes),
    ("rwt_client_work_seconds_total", "Seconds of work for a client.",
     lambda client, _: client.graph.work.seconds),
)  # fmt: skip


def _write_topics(page: PrometheusText, gateways: list[GatewayCounts]) -> Steps[None]:
    topics = [
        ({"gateway": its.name, "topic": name}, counts)
        for its in gateways
        for name, counts in sorted(its.counters.topics.items())
    ]
    for metric, help_, value in _OF_TOPIC:
        received = [(labels, value(counts)) for labels, counts in topics if counts.received]
        page.family(metric, "counter", help_, received)
        yield
    for metric, help_, value_of in _OF_ENCODING:
        sent = [
            ({**labels, "encoding": encoding}, value_of(its))
            for labels, counts in topics
            for encoding, its in sorted(counts.sent.items())
        ]
        page.family(metric, "counter", help_, sent)
        yield
    dropped = [
        ({**labels, "reason": reason.value}, count)
        for labels, counts in topics
        for reason, count in sorted(counts.dropped.items())
    ]
    help_ = "Messages that did not go to a client, by reason."
    page.family("rwt_topic_dropped_messages_total", "counter", help_, dropped)
    yield


def _write_clients(page: PrometheusText, gateways: list[GatewayCounts]) -> Steps[None]:
    clients = [
        ({"gateway": its.name, "client": str(client.number)}, client, traffic)
        for its in gateways
        for client, traffic in its.clients
    ]
    for name, help_, value in _OF_CLIENT:
        samples = [(labels, value(client, traffic)) for labels, client, traffic in clients]
        page.family(name, _kind(name), help_, samples)
        yield
    dropped = [
        ({**labels, "reason": reason.value}, count)
        for labels, _, traffic in clients
        for reason, count in sorted(traffic.dropped.items())
    ]
    help_ = "Messages dropped behind a client's connection."
    page.family("rwt_client_dropped_messages_total", "counter", help_, dropped)


_PROC: Final = Path("/proc/self")
_STARTED: Final = time.time()


def write_process(page: PrometheusText) -> None:
    """Write build, CPU time, and on Linux memory and open files, the latter three under the names of
    Prometheus' client libraries."""
    labels = {"version": version(), "build": build_id()}
    page.family("rwt_build_info", "gauge", "1, with version and build id.", [(labels, 1)])
    times = os.times()
    cpu = times.user + times.system
    page.single("process_cpu_seconds_total", "counter", "CPU time used, in seconds.", cpu)
    page.single("process_start_time_seconds", "gauge", "When the process began, Unix time.", _STARTED)
    try:
        pages = int((_PROC / "statm").read_text().split()[1])
        files = sum(1 for _ in (_PROC / "fd").iterdir())
    except OSError:
        return  # Not Linux.
    resident = pages * os.sysconf("SC_PAGE_SIZE")
    page.single("process_resident_memory_bytes", "gauge", "Resident memory, in bytes.", resident)
    page.single("process_open_fds", "gauge", "Open file descriptors.", files)


LAG_PERIOD: Final = 0.5
"""Seconds between two measurements."""
LAG_BUCKETS: Final = (0.001, 0.005, 0.02, 0.1, 0.5, 2.0)
"""Upper bounds of the buckets, in seconds."""


_LOOKS_OF_WORK: Final = 20
"""Number of measurements over which the rate of work is averaged."""


class LoopLag:
    """Histogram of the event loop lag, in seconds, and the rate of work for clients."""

    def __init__(self, clock: Clock, work: WorkTotals) -> None:
        self._clock = clock
        self._work = work
        self.counts = [0] * (len(LAG_BUCKETS) + 1)
        self.total = 0.0
        now = clock.monotonic()
        self._worked = deque([(now, self._seconds)], _LOOKS_OF_WORK)
        self._due = now + LAG_PERIOD
        self._looks = Periodic(clock, LAG_PERIOD, self._look)

    @property
    def _seconds(self) -> float:
        return sum(self._work.seconds.values())

    @property
    def rate_of_work(self) -> float:
        """Seconds of work for clients per second, averaged over the last measurements."""
        since, worked = self._worked[0]
        elapsed = self._clock.monotonic() - since
        return (self._seconds - worked) / elapsed if elapsed > 0.0 else 0.0

    def close(self) -> None:
        """Stop measuring."""
        self._looks.close()

    def _look(self) -> None:
        now = self._clock.monotonic()
        lag = max(0.0, now - self._due)
        self.total += lag
        self.counts[sum(lag > bound for bound in LAG_BUCKETS)] += 1
        self._worked.append((now, self._seconds))
        self._due = now + LAG_PERIOD
