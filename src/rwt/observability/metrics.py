"""`GET /metrics`: everything that the bridge counts, collected when it is asked for.

Cardinality is bounded: topics by what the ledger remembers, clients (by number, totals only) by those that
are connected, ops by the protocol.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

from rwt.observability.loop_lag import BUCKETS
from rwt.observability.process_metrics import write_process
from rwt.observability.prometheus import Exposition, Labels
from rwt_access.audit import LostLines

if TYPE_CHECKING:
    from rwt_bridge.bridge import Bridge
    from rwt_bridge.peer import Peer
    from rwt_delivery.counters import EncodingCounts, Ledger, TopicCounts
    from rwt_protocol.transport import Traffic
    from rwt_transports.http import MetricFamily


def metrics(bridge: Bridge, of_nodes: Iterable[MetricFamily] = ()) -> bytes:
    """The page, with the metrics of nodes after those of the bridge."""
    page = Exposition()
    for fanout in bridge.fanouts.values():
        fanout.settle()
    clients = [(peer, peer.sink.traffic) for peer in bridge.peers]
    _write_totals(page, bridge, clients)
    _write_topics(page, bridge.ledger)
    _write_clients(page, clients)
    for family in of_nodes:
        page.family(*family)
    write_process(page)
    return page.text()


def _write_totals(page: Exposition, bridge: Bridge, clients: list[tuple[Peer, Traffic]]) -> None:
    ledger, peers = bridge.ledger, bridge.peers
    received = ledger.received + sum(peer.messages for peer in peers)
    received_bytes = ledger.received_bytes + sum(traffic.received_bytes for _, traffic in clients)
    sent = ledger.sent + sum(traffic.messages for _, traffic in clients)
    sent_bytes = ledger.sent_bytes + sum(traffic.bytes for _, traffic in clients)
    for name, help_, value in (
        ("rwt_connections_total", "Clients that have connected.", ledger.clients),
        ("rwt_received_messages_total", "Messages from clients.", received),
        ("rwt_received_bytes_total", "Bytes read from clients.", received_bytes),
        ("rwt_sent_messages_total", "Messages to clients.", sent),
        ("rwt_sent_bytes_total", "Bytes written to clients.", sent_bytes),
        ("rwt_service_calls_total", "Service calls of clients.", ledger.calls),
        ("rwt_action_goals_total", "Goals that clients sent.", ledger.goals),
        ("rwt_missed_deadlines_total", "Deadlines of `qos` that passed without a message.",
         ledger.missed_deadlines),
        ("rwt_lost_log_lines_total", "Lines that the log could not take.", LostLines.count),
    ):  # fmt: skip
        page.single(name, "counter", help_, value)
    page.family(
        "rwt_refusals_total", "counter", "Messages that were refused, by op.",
        [({"op": op}, count) for op, count in sorted(ledger.refusals.items())],
    )  # fmt: skip
    page.single("rwt_clients", "gauge", "Clients connected now.", len(peers))
    page.single("rwt_service_calls_pending", "gauge", "Calls under way.", sum(len(p.calls) for p in peers))
    page.single("rwt_action_goals_running", "gauge", "Goals under way.", sum(len(p.goals) for p in peers))
    page.family(
        "rwt_topic_client_subscriptions", "gauge", "Clients that listen to a topic.",
        [({"topic": name}, fanout.subscriptions) for name, fanout in sorted(bridge.fanouts.items())],
    )  # fmt: skip
    _write_dials(page, bridge)
    page.histogram(
        "rwt_loop_lag_seconds", "How late the event loop ran a timer.",
        BUCKETS, bridge.loop_lag.counts, bridge.loop_lag.total,
    )  # fmt: skip


def _write_dials(page: Exposition, bridge: Bridge) -> None:
    """How each dial-out goes; nothing where there are none."""
    page.family(
        "rwt_dial_waiting_connections", "gauge", "Connections that wait at a hub for a client.",
        [({"hub": relay.url}, relay.idle) for relay in bridge.dials],
    )  # fmt: skip
    page.family(
        "rwt_dial_clients", "gauge", "Clients that came through a hub.",
        [({"hub": relay.url}, relay.clients) for relay in bridge.dials],
    )  # fmt: skip
    page.family(
        "rwt_dial_failures", "gauge", "Attempts in a row that a hub did not answer.",
        [({"hub": relay.url}, relay.failures) for relay in bridge.dials],
    )  # fmt: skip


def _write_topics(page: Exposition, ledger: Ledger) -> None:
    topics = sorted(ledger.topics.items())

    def of_topic(value: Callable[[TopicCounts], int]) -> Iterator[tuple[Labels, float]]:
        return (({"topic": name}, value(counts)) for name, counts in topics if counts.received)

    def of_encoding(value: Callable[[EncodingCounts], int]) -> Iterator[tuple[Labels, float]]:
        for name, counts in topics:
            for encoding, sent in sorted(counts.sent.items()):
                yield {"topic": name, "encoding": encoding}, value(sent)

    page.family(
        "rwt_topic_received_messages_total", "counter", "Messages that clients published.",
        of_topic(lambda counts: counts.received),
    )  # fmt: skip
    page.family(
        "rwt_topic_received_bytes_total", "counter", "Bytes of the messages that clients published.",
        of_topic(lambda counts: counts.received_bytes),
    )  # fmt: skip
    page.family(
        "rwt_topic_encodes_total", "counter", "Messages encoded: once for all clients of one encoding.",
        of_encoding(lambda sent: sent.encodes),
    )  # fmt: skip
    page.family(
        "rwt_topic_sent_messages_total", "counter", "Messages handed to clients' connections.",
        of_encoding(lambda sent: sent.messages),
    )  # fmt: skip
    page.family(
        "rwt_topic_sent_bytes_total", "counter", "Bytes handed to clients' connections.",
        of_encoding(lambda sent: sent.bytes),
    )  # fmt: skip
    page.family(
        "rwt_topic_dropped_messages_total", "counter", "Messages that did not go to a client, by reason.",
        [
            ({"topic": name, "reason": reason.value}, count)
            for name, counts in topics
            for reason, count in sorted(counts.dropped.items())
        ],
    )  # fmt: skip


def _write_clients(page: Exposition, clients: list[tuple[Peer, Traffic]]) -> None:
    def of_client(value: Callable[[Peer, Traffic], int]) -> Iterator[tuple[Labels, float]]:
        return (({"client": str(peer.number)}, value(peer, traffic)) for peer, traffic in clients)

    page.family(
        "rwt_client_received_messages_total", "counter", "Messages from a client.",
        of_client(lambda peer, _: peer.messages),
    )  # fmt: skip
    page.family(
        "rwt_client_received_bytes_total", "counter", "Bytes read from a client.",
        of_client(lambda _, traffic: traffic.received_bytes),
    )  # fmt: skip
    page.family(
        "rwt_client_sent_messages_total", "counter", "Messages to a client.",
        of_client(lambda _, traffic: traffic.messages),
    )  # fmt: skip
    page.family(
        "rwt_client_sent_bytes_total", "counter", "Bytes written to a client.",
        of_client(lambda _, traffic: traffic.bytes),
    )  # fmt: skip
    page.family(
        "rwt_client_queued_messages", "gauge", "Messages that wait for a client to read.",
        of_client(lambda _, traffic: traffic.queued_messages),
    )  # fmt: skip
    page.family(
        "rwt_client_queued_bytes", "gauge", "Bytes that wait for a client to read.",
        of_client(lambda _, traffic: traffic.queued_bytes),
    )  # fmt: skip
    page.family(
        "rwt_client_dropped_messages_total", "counter", "Messages dropped behind a client's connection.",
        [
            ({"client": str(peer.number), "reason": reason.value}, count)
            for peer, traffic in clients
            for reason, count in sorted(traffic.dropped.items())
        ],
    )  # fmt: skip
