"""Work that clients cause has a rate; requests stay charged until the program has ended them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import anyio
import anyio.lowlevel
import pytest

from rwt.access.access import Access
from rwt.access.quotas import WorkLimit
from rwt.composition.pages import guarded
from rwt.gateways.base import client_scheduler
from rwt.rosbridge.bridge import Bridge
from rwt.settings.models import Settings
from rwt_graph import Node
from rwt_graph.api import Sample
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_interfaces.distro import JAZZY
from rwt_interfaces.registry import Registry
from rwt_participant.goals import ReceivedGoal
from rwt_participant.messages import Message
from rwt_transports.endpoint import PeerInfo
from rwt_transports.http.routes import Audience, HttpRequest, HttpResponse
from rwt_transports.scheduler import MESSAGES
from tests.conftest import REGISTRIES
from tests.core.rosbridge.recording_client import Client

ADDRESS = "192.0.2.1"
#: One message makes the server work so long.
LONG = 0.06
TEXT = "x" * 1100


class BusyClock(SimulatedClock):
    """A clock on which work takes time."""

    def __init__(self) -> None:
        super().__init__(1_700_000_000_000_000_000)
        self.worked = 0.0

    def monotonic(self) -> float:
        return super().monotonic() + self.worked


class Server:
    """A bridge in which a message on `/t` makes a listener work.

    Attributes:
        heard: the texts of the messages, in the order in which they were worked on.
    """

    def __init__(self, **limits: object) -> None:
        self.clock = BusyClock()
        self.graph = MemoryGraph(Registry(JAZZY), self.clock)
        settings = Settings.model_validate({"limits": {"work_burst": 0.1, "work_per_second": 0.5, **limits}})
        self.access = Access(self.graph, settings)
        self.bridge = Bridge(self.graph, settings, self.access)
        self.heard: list[str] = []
        self.graph.participant("/listener").subscribe("/t", self._work)

    def _work(self, sample: Sample) -> None:
        string: Any = sample.payload.value()
        text: str = string.data
        self.clock.worked += 0.4 * MESSAGES.share if text.startswith("short") else LONG
        self.heard.append(text)

    def client(self, address: str = ADDRESS) -> Client:
        return Client(self.bridge, address)

    def work_of(self, address: str) -> WorkLimit:
        return self.access.reader(PeerInfo("http", address)).work


def _ask(server: Server, page: Any = None, address: str = ADDRESS) -> HttpResponse:
    """Ask for a page."""
    handler = guarded(server.access, page or (lambda request, reader: HttpResponse()), Audience.ADMITTED)
    response = handler(HttpRequest("GET", "/", address=address))
    assert isinstance(response, HttpResponse)
    return response


def _read(client: Client, *texts: str) -> None:
    """Messages in one read of the connection."""
    client.received += 1
    for text in texts:
        op = {"op": "publish", "topic": "/t", "type": "std_msgs/String", "msg": {"data": text}}
        client.endpoint.receive(json.dumps(op).encode(), False)


@contextmanager
def _turn(server: Server) -> Iterator[None]:
    """Run the block in one turn of the event loop, and then the next turn."""
    yield
    server.clock.advance(0.0)


def _exhaust(server: Server, client: Client) -> None:
    """Cause more work than the rate allows."""
    for number in range(3):
        with _turn(server):
            _read(client, f"exhausting {number}")
    server.heard.clear()


def _exhausted(server: Server, count: int) -> list[Client]:
    """Clients that have caused more work than the rate allows."""
    clients = [server.client() for _ in range(count)]
    for client in clients:
        _exhaust(server, client)
    return clients


@pytest.fixture
def server() -> Server:
    return Server()


def test_all_work_is_counted_for_the_client_its_address_and_the_server(server: Server) -> None:
    client, other = server.client(), server.client()
    _read(client, "a")
    _read(other, "b", "c")
    server.clock.advance(1.0)
    assert client.peer.graph.work.seconds == pytest.approx(LONG)
    assert other.peer.graph.work.seconds == pytest.approx(2 * LONG)
    assert server.work_of(ADDRESS).seconds == pytest.approx(3 * LONG)
    assert server.access.work.seconds["messages"] == pytest.approx(3 * LONG)


def test_small_work_is_counted_with_the_next_and_at_the_end(server: Server) -> None:
    client = server.client()
    _read(client, "short")
    assert client.peer.graph.work.seconds == 0.0
    _read(client, "short", "short")
    assert client.peer.graph.work.seconds == pytest.approx(1.2 * MESSAGES.share)
    _read(client, "short")
    client.leave()
    assert server.work_of(ADDRESS).seconds == pytest.approx(1.6 * MESSAGES.share)


def test_beyond_its_rate_one_client_of_them_all_has_a_turn(server: Server) -> None:
    clients = [server.client() for _ in range(4)]
    _exhaust(server, clients[0])
    honest = server.client("192.0.2.2")
    with _turn(server):
        for number, client in enumerate(clients):
            _read(client, f"of {number}")
        _read(honest, "honest")
    # That the address is beyond its rate is seen by each of them when its own work is counted.
    assert server.heard.index("honest") <= 4
    server.heard.clear()
    waits = server.access.work.waits
    with _turn(server):
        for number, client in enumerate(clients):
            _read(client, f"again of {number}")
        _read(honest, "honest")
        assert server.heard == ["again of 0"], "one turn for all of them, which it has overfilled"
    assert server.heard[1:] == ["honest", "again of 1", "again of 2", "again of 3"], "the honest one first"
    assert server.access.work.waits - waits == 3


def test_a_client_alone_beyond_its_rate_loses_nothing(server: Server) -> None:
    client = server.client()
    _exhaust(server, client)
    for number in range(5):
        with _turn(server):
            _read(client, f"short {number}", f"short {number}b")
    assert len(server.heard) == 10
    assert server.access.work.waits == 0


def test_what_came_first_is_done_first_by_those_who_wait(server: Server) -> None:
    clients = _exhausted(server, 3)
    with _turn(server):
        for name, client in zip("abc", clients, strict=True):
            _read(client, *(f"short {name}{number}" for number in range(4)))
    for _ in range(20):
        server.clock.advance(0.0)
    for name in "abc":
        own = [text for text in server.heard if text[6] == name]
        assert own == [f"short {name}{number}" for number in range(4)]


def test_a_client_that_leaves_while_it_waits_does_nothing_more(server: Server) -> None:
    one, two = _exhausted(server, 2)
    with _turn(server):
        _read(one, "one")
        _read(two, "two")
        two.leave()
    server.clock.advance(0.0)
    assert server.heard == ["one"]


def test_clients_of_this_machine_have_a_rate_each_and_none_together(server: Server) -> None:
    one, two = server.client("127.0.0.1"), server.client("127.0.0.1")
    _exhaust(server, one)
    assert one.peer.graph.work.excess > 0.0
    assert two.peer.graph.work.excess == 0.0
    assert server.work_of("127.0.0.1").excess == 0.0


def test_a_network_of_ipv6_is_one_address(server: Server) -> None:
    _exhaust(server, server.client("2001:db8::1"))
    assert server.work_of("2001:db8::2").excess > 0.0
    assert server.work_of("2001:db8:0:1::1").excess == 0.0


@pytest.mark.parametrize(
    ("rate", "seconds"), [(0.5, 10.0), (0, 0.0)], ids=["after a while", "without a rate"]
)
def test_within_the_rate_nothing_waits(rate: float, seconds: float) -> None:
    server = Server(work_per_second=rate)
    one, two = _exhausted(server, 2)
    server.clock.advance(seconds)
    with _turn(server):
        _read(one, "short one")
        _read(two, "short two")
        assert server.heard == ["short one", "short two"]
    assert server.access.work.seconds["messages"] == pytest.approx(6 * LONG)


def test_pages_are_counted_and_refused_beyond_the_rate(server: Server) -> None:

    def page(request: HttpRequest, reader: object) -> HttpResponse:
        server.clock.worked += 0.2
        return HttpResponse(b"page")

    ask = partial(_ask, server, page)
    assert ask().status == 200
    refused = ask()
    assert refused.status == 429
    assert isinstance(refused.body, bytes)
    assert b"more than 0.5 seconds of work a second (limits.work_per_second)" in refused.body
    assert refused.headers["Retry-After"] == "1"
    assert ask("192.0.2.2").status == 200
    assert [ask("127.0.0.1").status for _ in range(5)] == [200] * 5
    server.clock.advance(1.0)
    assert ask().status == 200
    assert server.access.work.refused == 1
    assert server.access.work.seconds["pages"] == pytest.approx(8 * 0.2)


@pytest.mark.anyio
async def test_a_page_waits_for_a_turn_that_is_not_full(server: Server) -> None:
    scheduler = client_scheduler(server.clock)
    handler = guarded(
        server.access, lambda request, reader: HttpResponse(b"page"), Audience.ADMITTED, scheduler=scheduler
    )
    request = HttpRequest("GET", "/", address=ADDRESS)
    assert isinstance(handler(request), HttpResponse)
    scheduler.note(1.0)
    waiting = handler(request)
    assert not isinstance(waiting, HttpResponse)
    answers: list[HttpResponse] = []

    async def wait() -> None:
        answers.append(await waiting)

    async with anyio.create_task_group() as tasks:
        tasks.start_soon(wait)
        await anyio.wait_all_tasks_blocked()
        assert not answers
        server.clock.advance(0.0)
    assert answers[0].body == b"page"


def test_messages_and_pages_are_one_account(server: Server) -> None:
    _exhaust(server, server.client())
    assert _ask(server).status == 429


def _latch(client: Client, numbers: range) -> None:
    for number in numbers:
        msg = {"data": TEXT}
        client.say("publish", topic=f"/l{number}", type="std_msgs/String", msg=msg, latch=True)


def test_what_is_kept_stays_charged_while_clients_of_other_addresses_come() -> None:
    server = Server(kept_bytes=4000)
    client = server.client()
    server.client("192.0.2.7")  # until now nothing was charged to the first address
    _latch(client, range(3))
    client.leave()
    server.client("192.0.2.8")
    again = server.client()
    again.say("set_level", level="error")
    _latch(again, range(3, 7))
    assert "limits.kept_bytes" in str(again.heard())


# -- charges of requests that a program of the robot still holds ---------------------------------------------

KEPT = 12_500
NAME = "x" * 3000
GOALS = "control_msgs/FollowJointTrajectory"


def _graph(registry: Registry) -> tuple[MemoryGraph, SimulatedClock]:
    clock = SimulatedClock(1_700_000_000 * 10**9)
    return MemoryGraph(registry, clock), clock


def _client(graph: MemoryGraph, **limits: int) -> Client:
    bridge = Bridge(graph, Settings.model_validate({"limits": {"kept_bytes": KEPT, **limits}}))
    client = Client(bridge, "192.0.2.1")
    client.say("set_level", level="error")
    return client


async def _settled() -> None:
    """Let tasks that were started come to where they wait."""
    for _ in range(50):
        await anyio.lowlevel.checkpoint()


@pytest.mark.anyio
async def test_a_call_that_timed_out_is_charged_until_its_coroutine_has_ended() -> None:
    graph, clock = _graph(REGISTRIES["jazzy"])
    ends, begun = anyio.Event(), 0

    async def slow(asked: Message) -> dict[str, object]:
        nonlocal begun
        begun += 1
        await ends.wait()
        return {}

    async with graph:
        Node(graph, "robot").advertise_service("/slow", "rcl_interfaces/SetParameters", slow)
        client = _client(graph)

        def call(id_: str) -> None:
            args = {"parameters": [{"name": NAME}]}
            client.say("call_service", service="/slow", args=args, id=id_, timeout=0.5)

        for number in range(3):
            call(str(number))
            await _settled()
            clock.advance(1.0)
            assert "Timeout" in str(client.heard())
        assert begun == 3
        call("one too many")
        await _settled()
        assert "limits.kept_bytes" in str(client.heard()) and begun == 3
        ends.set()
        await _settled()
        call("again")
        await _settled()
        assert begun == 4


@pytest.mark.anyio
async def test_small_calls_are_counted_until_their_coroutines_end() -> None:
    graph, clock = _graph(REGISTRIES["jazzy"])
    ends = anyio.Event()

    async def slow(asked: Message) -> dict[str, object]:
        await ends.wait()
        return {}

    async with graph:
        Node(graph, "robot").advertise_service("/slow", "std_srvs/Trigger", slow)
        client = _client(graph, calls=5)
        for number in range(6):
            client.say("call_service", service="/slow", id=str(number), timeout=0.5)
            await _settled()
            clock.advance(1.0)
        assert "limits.calls" in str(client.heard())
        ends.set()
        await _settled()
        client.say("call_service", service="/slow", id="again")
        await _settled()
        assert client.heard()[-1]["result"] is True


class ActionRobot:
    """A robot of ROS 1 with an action that ends its goals when it is told to."""

    def __init__(self, graph: MemoryGraph) -> None:
        self.ends = anyio.Event()
        self.begun = 0
        Node(graph, "robot").advertise_action("/arm", GOALS, self._run)

    async def _run(self, goal: ReceivedGoal) -> dict[str, object]:
        self.begun += 1
        await self.ends.wait()
        return {}


def _send(client: Client, id_: str, name: str = NAME) -> None:
    msg = {"goal_id": {"id": id_}, "goal": {"trajectory": {"joint_names": [name]}}}
    client.say("publish", topic="/arm/goal", type=f"{GOALS}ActionGoal", msg=msg)


@pytest.mark.anyio
async def test_goals_that_are_sent_as_messages_are_charged_until_they_end() -> None:
    graph, _ = _graph(REGISTRIES["noetic"])
    async with graph:
        robot = ActionRobot(graph)
        client = _client(graph)
        client.say("subscribe", topic="/arm/result", type=f"{GOALS}ActionResult")
        for number in range(5):
            _send(client, f"goal {number}")
        await _settled()
        rejected = [heard["msg"]["status"] for heard in client.heard() if heard["op"] == "publish"]
        assert [status["goal_id"]["id"] for status in rejected] == ["goal 3", "goal 4"]
        assert all(status["status"] == 5 and "limits.kept_bytes" in status["text"] for status in rejected)
        assert robot.begun == 3
        robot.ends.set()
        await _settled()
        _send(client, "goal 5")
        await _settled()
        assert robot.begun == 4


@pytest.mark.anyio
async def test_goals_go_on_being_charged_to_the_address_of_who_has_left() -> None:
    graph, _ = _graph(REGISTRIES["noetic"])
    async with graph:
        robot = ActionRobot(graph)
        bridge = Bridge(graph, Settings.model_validate({"limits": {"kept_bytes": KEPT}}))
        for number in range(8):
            client = Client(bridge, "192.0.2.1")
            for each in range(3):
                _send(client, f"{number} {each}")
            client.leave()
        await _settled()
        assert 12 <= robot.begun <= 13, "four times what one may have"
        robot.ends.set()
        await _settled()
        _send(Client(bridge, "192.0.2.1"), "later")
        await _settled()
        assert robot.begun >= 13


@pytest.mark.anyio
async def test_ended_goals_and_their_ids_are_bounded() -> None:
    graph, clock = _graph(REGISTRIES["noetic"])
    async with graph:
        robot = ActionRobot(graph)
        robot.ends.set()
        client = _client(graph)
        client.say("subscribe", topic="/arm/status", type="actionlib_msgs/GoalStatusArray")
        for number in range(150):
            _send(client, f"goal {number}", "x")
            if number % 10 == 0:
                await _settled()
        await _settled()
        clock.advance(0.6)
        (*_, last) = [heard["msg"]["status_list"] for heard in client.heard() if heard["op"] == "publish"]
        assert len(last) == 100 and last[-1]["goal_id"]["id"] == "goal 149"
        begun = robot.begun
        _send(client, "i" * 300)
        await _settled()
        assert robot.begun == begun == 150
