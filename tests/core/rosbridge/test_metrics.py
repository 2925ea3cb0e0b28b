"""GET /metrics: the format by an independent parser, the numbers by what was done."""

from __future__ import annotations

import json
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import anyio
import anyio.to_thread
import pytest
from prometheus_client.parser import text_string_to_metric_families
from websockets.asyncio.client import connect as connect_websocket

from rwt import Server, Settings
from rwt.access.quotas import WORK_KINDS
from rwt.composition.pages import routes
from rwt.delivery.counters import MAX_TOPICS, Counters, TopicCounts
from rwt.observability.metrics import ServerMetrics
from rwt.observability.prometheus import PrometheusText
from rwt.rosbridge.bridge import Bridge
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_transports.endpoint import DropReason, PeerInfo, Traffic
from rwt_transports.http.routes import HttpRequest, HttpResponse
from tests.core.rosbridge.recording_client import Client

INT = "std_msgs/Int32"


class Page:
    """A page of metrics, parsed."""

    def __init__(self, text: bytes) -> None:
        self.kinds: dict[str, str] = {}
        self.values: dict[tuple[str, frozenset[tuple[str, str]]], float] = {}
        for family in text_string_to_metric_families(text.decode()):
            assert family.documentation
            self.kinds[family.name] = family.type
            for sample in family.samples:
                key = (sample.name, frozenset(sample.labels.items()))
                assert key not in self.values
                self.values[key] = sample.value

    def value(self, name: str, **labels: str) -> float | None:
        """A sample; where a gateway counts it, and none is named, that of rosbridge."""
        of_rosbridge = self.values.get((name, frozenset({"gateway": "rosbridge", **labels}.items())))
        return (
            of_rosbridge if of_rosbridge is not None else self.values.get((name, frozenset(labels.items())))
        )


@pytest.fixture
def metrics(bridge: Bridge) -> ServerMetrics:
    return ServerMetrics(bridge)


@pytest.fixture
def page(metrics: ServerMetrics) -> Callable[[], Page]:
    def read() -> Page:
        text = metrics.text()
        return Page(text)

    return read


def _publish(client: Client, count: int, topic: str = "/n") -> None:
    for number in range(count):
        client.say("publish", topic=topic, type=INT, msg={"data": number})


# -- the format --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ['say "hi"', "back\\slash", "two\nlines", "\\n", "ü€😀", "{} =,#"])
def test_labels_and_help_survive_whatever_they_hold(text: str) -> None:
    page = PrometheusText()
    page.family("x_total", "counter", text, [({"a": text, "b": "2"}, 3)])
    (family,) = text_string_to_metric_families(page.text().decode())
    (sample,) = family.samples
    assert sample.labels == {"a": text, "b": "2"} and sample.value == 3
    assert family.documentation == text


def test_the_text_itself() -> None:
    page = PrometheusText()
    page.single("a_total", "counter", "Help.", 3)
    page.family("nothing", "gauge", "Not there.", [])
    page.family("b", "gauge", "Help.", [({"l": "x"}, 1.5), ({"l": "y"}, float("inf"))])
    page.histogram("h", "Help.", (0.1, 1.0), (2, 0, 1), 5.25)
    assert page.text() == (
        b"# HELP a_total Help.\n# TYPE a_total counter\na_total 3\n"
        b'# HELP b Help.\n# TYPE b gauge\nb{l="x"} 1.5\nb{l="y"} +Inf\n'
        b'# HELP h Help.\n# TYPE h histogram\nh_bucket{le="0.1"} 2\nh_bucket{le="1.0"} 2\n'
        b'h_bucket{le="+Inf"} 3\nh_sum 5.25\nh_count 3\n'
    )


# -- the numbers -------------------------------------------------------------------------------------------


def test_topics(client: Client, other: Client, page: Callable[[], Page]) -> None:
    client.say("subscribe", topic="/n", type=INT)
    other.say("subscribe", topic="/n", throttle_rate=60_000)
    _publish(other, 5)
    size = sum(len(b'{"data": %d}' % number) for number in range(5))
    sent = sum(frame.size for frame, _ in client.frames + other.frames)
    read = page()
    assert read.value("rwt_topic_received_messages_total", topic="/n") == 5
    assert read.value("rwt_topic_received_bytes_total", topic="/n") == size
    assert read.value("rwt_topic_encodes_total", topic="/n", encoding="none") == 5
    assert read.value("rwt_topic_sent_messages_total", topic="/n", encoding="none") == 6
    assert read.value("rwt_topic_sent_bytes_total", topic="/n", encoding="none") == sent
    assert read.value("rwt_topic_dropped_messages_total", topic="/n", reason="throttle") == 4
    assert read.value("rwt_topic_client_subscriptions", topic="/n") == 2
    other.say("unsubscribe", topic="/n")
    client.say("unsubscribe", topic="/n")
    read = page()
    assert read.value("rwt_topic_client_subscriptions", topic="/n") is None
    assert read.value("rwt_topic_sent_messages_total", topic="/n", encoding="none") == 6


def test_clients(client: Client, other: Client, page: Callable[[], Page]) -> None:
    client.say("subscribe", topic="/n", type=INT)
    client.traffic = Traffic(3, 400, 2, 300, {DropReason.BACKLOG: 7}, 50)
    read = page()
    assert read.value("rwt_clients") == 2
    assert read.value("rwt_client_received_messages_total", client="1") == 1
    assert read.value("rwt_client_received_bytes_total", client="1") == 50
    assert read.value("rwt_client_sent_messages_total", client="1") == 3
    assert read.value("rwt_client_sent_bytes_total", client="1") == 400
    assert read.value("rwt_client_queued_messages", client="1") == 2
    assert read.value("rwt_client_queued_bytes", client="1") == 300
    assert read.value("rwt_client_dropped_messages_total", client="1", reason="backlog") == 7
    assert read.value("rwt_client_sent_messages_total", client="2") == 0


def test_totals_outlive_their_clients(client: Client, other: Client, page: Callable[[], Page]) -> None:
    client.traffic = Traffic(3, 400, received_bytes=60)
    other.traffic = Traffic(1, 50)
    client.say("unsubscribe", topic="/n")
    before = page()
    client.leave()
    after = page()
    for name in ("received_messages", "received_bytes", "sent_messages", "sent_bytes"):
        assert before.value(f"rwt_{name}_total") == after.value(f"rwt_{name}_total")
    assert after.value("rwt_sent_bytes_total") == 450 and after.value("rwt_received_bytes_total") == 60
    assert after.value("rwt_connections_total") == 2 and after.value("rwt_clients") == 1
    assert after.value("rwt_client_sent_messages_total", client="1") is None


def test_calls_and_refusals(client: Client, other: Client, page: Callable[[], Page]) -> None:
    other.say("advertise_service", service="/s", type="std_srvs/Trigger")
    client.say("call_service", service="/s")
    client.say("call_service", service="/nowhere")
    client.say("subscribe", topic=5)
    client.say("nonsense\n")
    client.say_raw("}{")
    read = page()
    assert read.value("rwt_service_calls_total") == 1
    assert read.value("rwt_service_calls_pending") == 1
    assert read.value("rwt_refusals_total", op="call_service") == 1
    assert read.value("rwt_refusals_total", op="subscribe") == 1
    assert read.value("rwt_refusals_total", op="unknown") == 3


def test_loop_lag(page: Callable[[], Page], clock: SimulatedClock, metrics: ServerMetrics) -> None:
    clock.advance(2.1)
    read = page()
    assert read.value("rwt_loop_lag_seconds_count") == 4
    assert read.value("rwt_loop_lag_seconds_bucket", le="0.001") == 4
    clock.suspend(1.4)  # The next look was due in 0.4 s.
    clock.advance(0.0)
    read = page()
    assert read.value("rwt_loop_lag_seconds_bucket", le="0.5") == 4
    assert read.value("rwt_loop_lag_seconds_bucket", le="2.0") == 5
    assert read.value("rwt_loop_lag_seconds_sum") == pytest.approx(1.0)


def test_the_process(page: Callable[[], Page]) -> None:
    read = page()
    assert read.kinds["process_cpu_seconds"] == "counter"
    for name in ("process_cpu_seconds_total", "process_resident_memory_bytes", "process_open_fds"):
        assert (read.value(name) or 0) > 0


def test_topics_that_clients_invent_are_not_remembered_for_ever() -> None:
    counters = Counters()
    used = counters.use_topic("/used")
    for number in range(2 * MAX_TOPICS):
        counters.release_topic(counters.use_topic(f"/invented{number}"))
    assert len(counters.topics) == MAX_TOPICS
    assert counters.topics["/used"] is used


def test_the_topic_longest_out_of_use_is_forgotten_first() -> None:
    counters = Counters()
    for number in range(MAX_TOPICS):
        counters.release_topic(counters.use_topic(f"/{number}"))
    again = counters.use_topic("/0")
    counters.use_topic("/new")
    assert "/1" not in counters.topics
    assert counters.topics["/0"] is again
    counters.release_topic(again)
    for number in range(MAX_TOPICS - 2):
        counters.use_topic(f"/newer{number}")
    assert "/0" in counters.topics
    counters.use_topic("/newest")
    assert "/0" not in counters.topics


class Counting(dict[str, TopicCounts]):
    """A table that notes when somebody walks through it."""

    walks = 0

    def items(self) -> Any:
        self.walks += 1
        return super().items()

    def __iter__(self) -> Iterator[str]:
        self.walks += 1
        return super().__iter__()


def test_a_new_topic_among_many_in_use_costs_no_walk_through_them() -> None:
    counters = Counters()
    table = counters.topics = Counting()
    for number in range(3 * MAX_TOPICS):
        counters.use_topic(f"/{number}")
    assert len(table) == 3 * MAX_TOPICS
    assert table.walks == 0


def _get(url: str) -> tuple[Mapping[str, str], bytes]:
    with urllib.request.urlopen(url.replace("ws", "http", 1) + "/metrics", timeout=60) as response:
        return dict(response.headers), response.read()


@pytest.mark.anyio
async def test_over_http_with_a_client_on_the_same_port(anyio_backend: Any) -> None:
    async with (
        Server("ws://127.0.0.1:0") as server,
        connect_websocket(server.urls[0], compression=None) as wire,
    ):
        await wire.send(json.dumps({"op": "subscribe", "topic": "/n", "type": INT}))
        await wire.send(json.dumps({"op": "publish", "topic": "/n", "msg": {"data": 1}}))
        message = await wire.recv()
        headers, body = await anyio.to_thread.run_sync(_get, server.urls[0])
    read = Page(body)
    assert headers["Content-Type"] == "text/plain; version=0.0.4; charset=utf-8"
    assert read.value("rwt_client_sent_messages_total", client="1") == 1
    # The answer to the handshake is among the bytes.
    assert len(message) < (read.value("rwt_client_sent_bytes_total", client="1") or 0) < len(message) + 500
    assert read.value("rwt_client_received_messages_total", client="1") == 2


@pytest.mark.anyio
async def test_health_follows_the_graph(anyio_backend: str) -> None:
    graph = MemoryGraph()
    bridge = Bridge(graph, Settings())
    handler = routes(bridge, ServerMetrics(bridge)).find("GET", "/healthz")
    assert callable(handler)

    def ask() -> tuple[int, object]:
        response = handler(HttpRequest("GET", "/healthz"))
        assert isinstance(response, HttpResponse) and isinstance(response.body, bytes)
        return response.status, json.loads(response.body)["status"]

    async with graph:
        assert ask() == (200, "ok")
    assert ask() == (503, "stopped")


def test_work_is_told_by_kind_and_by_client(bridge: Bridge, page: Callable[[], Page]) -> None:
    client = Client(bridge)
    client.peer.graph.work.add(0.25, "messages")
    bridge.access.reader(PeerInfo("http", "192.0.2.1")).work.add(0.5, "pictures")
    bridge.access.work.waits, bridge.access.work.refused = 3, 4
    read = page()
    kinds = {kind: read.value("rwt_work_seconds_total", kind=kind) for kind in WORK_KINDS}
    assert kinds == {"messages": 0.25, "pages": 0.0, "pictures": 0.5}
    assert read.value("rwt_client_work_seconds_total", client="1") == 0.25
    assert (read.value("rwt_work_waits_total"), read.value("rwt_work_refusals_total")) == (3, 4)


def test_pages_say_how_busy_the_server_is(
    bridge: Bridge, metrics: ServerMetrics, clock: SimulatedClock
) -> None:
    found = routes(bridge, metrics)

    def ask(path: str) -> bytes:
        handler = found.find("GET", path)
        assert callable(handler)
        response = handler(HttpRequest("GET", path))
        assert isinstance(response, HttpResponse) and isinstance(response.body, bytes)
        return response.body

    client = Client(bridge)
    clock.advance(100.0)
    assert b"takes 0% of a processor.</p>" in ask("/")
    client.peer.graph.work.add(3.0, "messages")
    health = json.loads(ask("/healthz"))
    assert health["work"] == pytest.approx(0.3, rel=0.1)
    assert health["clients_beyond_rate"] == 1
    assert b"of a processor; 1 beyond limits.work_per_second wait for each other.</p>" in ask("/")
    clock.advance(100.0)
    health = json.loads(ask("/healthz"))
    assert (health["work"], health["clients_beyond_rate"]) == (0.0, 0)


def test_the_page_is_made_in_steps(client: Client, metrics: ServerMetrics) -> None:
    for number in range(20):
        _publish(client, 1, f"/topic{number}")
    assert len([*metrics.text_in_steps()]) > 10
