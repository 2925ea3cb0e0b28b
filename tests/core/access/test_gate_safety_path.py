"""The safety path: a stop, and the end of a lease, wait for no data, whatever clients do."""

from __future__ import annotations

import gc
import json
import time
import tracemalloc
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import anyio
import pytest

from rwt.access.errors import QuotaExceeded
from rwt.access.gate.rules import Rules
from rwt.access.gate.stop_path import MAX_DRIVEN
from rwt.access.graph_view import GraphView
from rwt.access.settings import GateSettings
from rwt.composition.pages import guarded
from rwt.extensions.foxglove.gateway import FoxgloveGateway
from rwt.extensions.http.gateway import HttpGateway
from rwt.extensions.http.part import HttpSettings
from rwt.extensions.mcp.gateway import McpGateway
from rwt.extensions.mcp.settings import McpSettings
from rwt.gateways.request_looks import RequestLooks
from rwt.gateways.visitors import peer_of
from rwt.rosapi import Rosapi
from rwt_graph.api import GoalEvents, Sample, ServerGoal
from rwt_graph.clock import SteadyClock
from rwt_graph.memory.topics import MemoryPublisher
from rwt_interfaces.payload import Payload
from rwt_transports.http.routes import Audience, Handler, HttpRequest, HttpResponse, Route
from tests.call_counts import count_calls
from tests.core.access.gated_robot import CLIENT, GATE, TWIST, GatedRobot, call, drive, errors, token
from tests.extensions.foxglove.viewer import Viewer
from tests.held import held

EVERY_DRIVE: Mapping[str, Any] = {
    "topics": ["/cmd_vel", "/x/*"],
    "lease": {"seconds": 60},
    "emergency": True,
    "stop": {},
}
RULES = {"drive": {"topics": ["/cmd_vel"], "emergency": True, "stop": {}}}


def _crowded(topics: int) -> GatedRobot:
    robot = GatedRobot({"drive": EVERY_DRIVE})
    driver = robot.client("admin")
    drive(driver, 0.5)
    for number in range(topics):
        if number % 900 == 0:
            attacker = robot.client("admin")
        attacker.say("advertise", topic=f"/x/{number}", type=TWIST)
    robot.take()
    return robot


# -- work --------------------------------------------------------------------------------------------------


def _subscribed(clients: int) -> GatedRobot:
    robot = GatedRobot({"drive": EVERY_DRIVE})
    for _ in range(clients):
        robot.client("operator").say("subscribe", topic="/gate/stopped")
    drive(robot.client("admin"), 0.5)
    robot.take()
    return robot


def _with_history(events: int) -> GatedRobot:
    """Robot with clients, stops, leases, and requests for approval, that many of each."""
    asked = {"topics": ["/asked"], "type": "std_msgs/String", "approval": {"roles": ["admin"]}}
    robot = GatedRobot({"drive": {**EVERY_DRIVE, "lease": {"seconds": 0.5}}, "asked": asked})
    robot.node.advertise("/x/shared", TWIST)
    driver = robot.client("admin")
    for number in range(events):
        client = robot.client("agent")
        drive(client, 0.1, "/x/shared")
        client.say("publish", topic="/asked", type="std_msgs/String", msg={"data": str(number)})
        drive(driver, 0.5)
        robot.gate.stop(None)
        robot.gate.release(None)
        drive(driver, 0.0)
    robot.clock.advance(5.0)
    drive(driver, 0.5)
    robot.take()
    return robot


@pytest.mark.parametrize(
    ("make", "few", "many"),
    [
        pytest.param(_crowded, 300, 4000, id="topics and clients"),
        pytest.param(_subscribed, 10, 500, id="connected clients"),
        pytest.param(_with_history, 5, 150, id="history"),
    ],
)
def test_the_work_of_a_stop_does_not_grow(make: Callable[[int], GatedRobot], few: int, many: int) -> None:
    counts = []
    for size in (few, many):
        robot = make(size)
        counts.append(count_calls(partial(robot.gate.stop, None)))
        assert robot.take()[0] == (0.0, GATE)
    assert counts[1] < 1.1 * counts[0]


def test_the_work_at_the_end_of_a_lease_does_not_grow() -> None:
    counts = []
    for make, size in ((_with_history, 5), (_with_history, 150), (_crowded, 100), (_crowded, 2000)):
        robot = make(size)
        lease = next(topic.lease for topic in robot.gate.topics if topic.name == "/cmd_vel")
        assert lease is not None
        counts.append(count_calls(partial(lease.release, None, "silence")))
        assert robot.take()[0] == (0.0, GATE)
    assert max(counts) < 1.2 * min(counts)


def test_the_rest_is_stopped_in_turns() -> None:
    robot = _crowded(1000)
    told: list[str] = []
    for number in range(1000):
        robot.graph.participant("/base").subscribe(f"/x/{number}", lambda sample: told.append(sample.topic))
    robot.gate.stop(None)
    assert 0 < len(told) < 300
    robot.clock.advance(0.001)
    assert len(told) == len(set(told)) == 1000


def test_what_is_driven_after_a_release_is_not_stopped_by_a_late_turn() -> None:
    robot = _crowded(1000)
    robot.gate.stop(None)
    robot.gate.release(None)
    told = robot.hear("/x/999")
    assert drive(robot.client(), 0.5, "/x/999") == ""
    robot.clock.advance(0.001)
    assert [each.linear.x for each in told] == [0.5]


def test_a_new_topic_examines_a_fixed_number_of_others() -> None:
    few, many = _crowded(100), _crowded(3000)
    counts = []
    for robot in (few, many):
        client = robot.client("admin")
        counts.append(count_calls(partial(client.say, "advertise", topic="/x/new", type=TWIST)))
    assert counts[1] < 1.2 * counts[0]
    for robot in (few, few, many):  # A client that leaves costs as much as it has.
        actor = robot.gate.join("", robot.access.admission.roles["operator"], "")
        counts.append(count_calls(partial(robot.gate.leave, actor)))
    # The first one also calls what Python caches, such as the checks of abstract classes.
    assert counts[3] == counts[4]


def test_long_names_of_clients_are_not_kept() -> None:
    rules = Rules(GateSettings.model_validate({"rules": {"drive": EVERY_DRIVE}}))
    before = held(rules)
    assert rules.of("publish", "/x/" + "n" * 10_000) == rules.all
    assert held(rules) == before


_OPS: Mapping[str, Callable[[str], dict[str, Any]]] = {
    "publish": lambda name: {"op": "publish", "topic": name, "msg": {}},
    "call": lambda name: {"op": "call_service", "service": name, "args": {}},
    "goal": lambda name: {"op": "send_action_goal", "action": name, "action_type": "x/Y", "args": {}},
    "take lease": lambda name: _asked("take_lease", topic=name),
    "request lease": lambda name: _asked("request_lease", topic=name),
    "pass lease": lambda name: _asked("pass_lease", topic="/cmd_vel", to=name),
    "approve": lambda name: _asked("approve", id=name, approve=True),
    "release": lambda name: _asked("release_stop", reason=name),
    "parameter": lambda name: _asked("set_param", "/rosapi", name=name, value="1"),
}


def _asked(service: str, node: str = "/gate", **args: object) -> dict[str, Any]:
    return {"op": "call_service", "service": f"{node}/{service}", "args": args}


@pytest.mark.parametrize("verb", _OPS)
def test_no_verb_keeps_long_names(verb: str) -> None:
    asked = {"topics": ["/x/*"], "services": ["/x/*"], "parameters": ["*"], "actions": ["*"]}
    robot = GatedRobot({"drive": EVERY_DRIVE, "asked": {**asked, "approval": {"roles": ["admin"]}}})
    Rosapi(robot.graph)
    client = robot.client()
    size, sent = 20_000, 100

    def send(first: int) -> None:
        for number in range(first, first + sent):
            op = _OPS[verb](f"/x/{number}".ljust(size, "n"))
            client.say(op.pop("op"), **op)
            client.heard()
        robot.clock.advance(100.0)

    send(0)  # Fills what is loaded or compiled once.
    tracemalloc.start()
    try:
        send(sent)
        gc.collect()
        kept = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert kept < size * sent / 4


def test_one_timer_repeats_all_stop_messages() -> None:
    robot = _crowded(500)
    robot.clock.advance(2.0)
    before = robot.clock.pending()
    robot.gate.stop(None)
    robot.clock.advance(0.01)
    assert robot.clock.pending() == before
    robot.take()
    robot.clock.advance(1.0)
    assert 9 <= len(robot.take()) <= 11


def _busy(goals: int) -> tuple[GatedRobot, list[str]]:
    """Return a robot with running goals of two actions, and the list of those that are told to cancel."""
    robot = GatedRobot({"drive": EVERY_DRIVE, "acts": {"actions": ["/a/*"], "emergency": True}})
    told: list[str] = []

    def execute(goal: ServerGoal) -> None:
        goal.accept()
        goal.on_cancel = lambda: told.append(goal.action)

    client = robot.client("admin")
    fibonacci = robot.graph.registry.action("example_interfaces/Fibonacci")
    for name, count in (("/a/many", goals), ("/a/one", 1)):
        robot.graph.participant("/worker").advertise_action(name, fibonacci, execute)
        for _ in range(count):
            robot.graph.participant("/own").send_goal(
                name, Payload.from_value(fibonacci.goal, {}), GoalEvents(lambda *_: None)
            )
        client.say("send_action_goal", action=name, action_type=fibonacci.name, args={})
    drive(client, 0.5)
    robot.take()
    return robot, told


def test_the_work_of_a_stop_does_not_grow_with_goals() -> None:
    counts = []
    for goals in (400, 998):
        robot, told = _busy(goals)
        counts.append(count_calls(partial(robot.gate.stop, None)))
        assert robot.take() == [(0.0, GATE)]
        assert told[:2] == ["/a/many", "/a/one"], "each action's oldest goal comes first"
        assert len(told) < 300
        robot.clock.advance(0.01)
        assert len(told) == goals + 3
    assert counts[1] < 1.05 * counts[0]


def test_urgent_timers_run_ahead_of_those_of_data() -> None:
    clock = SteadyClock()
    ran: list[str] = []

    def busy() -> None:
        ran.append("data")
        time.sleep(0.002)

    async def run() -> None:
        for _ in range(200):
            clock.call_later(0.0, busy)
        clock.call_urgently(0.001, lambda: ran.append("urgent"))
        with anyio.move_on_after(0.1):
            await clock.drive()

    anyio.run(run)
    assert ran.index("urgent") <= 2


# -- order and isolation -----------------------------------------------------------------------------------


def test_what_the_lease_holder_drives_is_stopped_first() -> None:
    robot = GatedRobot({"drive": EVERY_DRIVE, "free": {"topics": ["/free/*"], "emergency": True, "stop": {}}})
    order: list[str] = []

    def note(sample: Sample) -> None:
        order.append(sample.topic)

    for name in ("/cmd_vel", *(f"/free/{number}" for number in range(2 * MAX_DRIVEN))):
        robot.graph.participant("/base").subscribe(name, note, robot.graph.registry.message(TWIST))
    attacker, driver = robot.client("admin"), robot.client()
    for number in range(2 * MAX_DRIVEN):
        drive(attacker, 0.1, f"/free/{number}")
    drive(driver, 0.5)
    order.clear()
    call(driver, "/gate/stop")
    assert order[0] == "/cmd_vel"


def test_an_exception_of_one_topic_does_not_keep_the_stop_from_others(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    robot = GatedRobot({"drive": EVERY_DRIVE, "acts": {"actions": ["/count"], "emergency": True}})
    client = robot.client("admin")
    drive(client, 0.1, "/x/broken")
    drive(client, 0.5)
    publish = MemoryPublisher.publish

    def fail(publisher: MemoryPublisher, payload: Payload) -> None:
        if publisher.topic == "/x/broken":
            raise OSError("the network is down")
        publish(publisher, payload)

    monkeypatch.setattr(MemoryPublisher, "publish", fail)
    robot.take()
    answer = call(client, "/gate/stop")
    assert robot.take() == [(0.0, GATE)]
    assert not answer["success"]
    assert "these were not stopped: /x/broken: OSError: the network is down" in answer["message"]
    assert "the gate could not stop /x/broken" in caplog.text
    said = [each for each in caplog.messages if each.startswith("gate: stop:")]
    assert said == [
        "gate: stop: /x/broken: not stopped: OSError: the network is down",
        "gate: stop: stopped by rosbridge:1 (role admin)",
    ]
    assert "the emergency stop is on" in drive(client, 0.5)
    # It is repeated until it succeeds.
    monkeypatch.undo()
    robot.clock.advance(0.2)
    assert call(client, "/gate/stop")["success"]


def test_a_press_while_stopped_does_nothing() -> None:
    robot = GatedRobot(RULES)
    client = robot.client()
    drive(client, 0.5)
    call(client, "/gate/stop", reason="first")
    robot.take()
    assert call(client, "/gate/stop", reason="second")["success"]
    assert robot.take() == []
    assert robot.gate.stopped_reason == "first"


# -- types -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("op", ["advertise", "publish", "subscribe"])
def test_a_client_does_not_give_a_guarded_topic_its_type(op: str) -> None:
    robot = GatedRobot({"drive": {**EVERY_DRIVE, "topics": ["/late"]}})
    attacker = robot.client()
    attacker.say(op, topic="/late", type="std_msgs/String", msg={"data": ""})
    assert "its type is not known" in str(attacker.heard())
    told = robot.hear("/late")
    assert drive(attacker, 0.5, "/late") == ""
    assert call(attacker, "/gate/stop")["success"]
    assert [each.linear.x for each in told] == [0.5, 0.0]


def test_a_rule_states_the_type_of_its_topics() -> None:
    robot = GatedRobot({"drive": {**EVERY_DRIVE, "topics": ["/late"], "type": "geometry_msgs/msg/Twist"}})
    attacker, driver = robot.client("admin"), robot.client()
    attacker.say("advertise", topic="/late", type="std_msgs/String")
    assert "/late is of type geometry_msgs/msg/Twist (gate.rules.drive.type)" in str(attacker.heard())
    assert drive(driver, 0.5, "/late") == ""
    robot = GatedRobot({"drive": {**EVERY_DRIVE, "topics": ["/late/*"], "type": "geometry_msgs/msg/Twist"}})
    assert drive(robot.client(), 0.5, "/late/one") == "", (
        "the rule states the type of names under a glob, too"
    )
    with pytest.raises(ValueError, match=r"`gate.rules.drive.type`: .*no_msgs/None"):
        GatedRobot({"drive": {**EVERY_DRIVE, "type": "no_msgs/None"}})


def test_an_unrestricted_client_does_not_block_a_topic_by_a_type_that_the_rules_do_not_fit() -> None:
    robot = GatedRobot({"drive": {**EVERY_DRIVE, "topics": ["/late"], "fields": {"linear.x": {"max": 1}}}})
    admin = robot.client("admin")
    admin.say("advertise", topic="/late", type="std_msgs/String")
    assert "do not fit std_msgs/String" in str(admin.heard())
    robot.node.subscribe("/late", lambda message: None, type=TWIST)
    assert drive(admin, 0.5, "/late") == ""


def test_a_topic_with_a_fault_is_named_in_the_answer_to_a_stop() -> None:
    robot = GatedRobot({"drive": {**EVERY_DRIVE, "topics": ["/late"], "fields": {"linear.x": {"max": 1}}}})
    robot.node.advertise("/late", "std_msgs/String")
    client = robot.client()
    client.say("publish", topic="/late", type="std_msgs/String", msg={"data": ""})
    assert "the rules of /late cannot be applied" in errors(client)
    answer = call(client, "/gate/stop")
    assert (answer["success"], "these were not stopped: /late:" in answer["message"]) == (False, True)


# -- a client's own limits -----------------------------------------------------------------------------------


def _press(robot: GatedRobot, client: Any, op: str) -> None:
    if op == "call_service":
        client.say("call_service", service="gate/stop", args={"reason": "now"})
    else:
        client.say("publish", topic="/gate/stop", type="std_msgs/Empty", msg={})
    assert robot.gate.stopped_by, client.heard()


@pytest.mark.parametrize("op", ["call_service", "publish"])
def test_a_stop_is_ahead_of_what_waits_of_its_client(op: str) -> None:
    robot = GatedRobot(RULES)
    client = robot.client()
    drive(client, 0.5)
    client.peer._wait_unread(b'{"op": "publish", "topic": "/cmd_vel", "msg": {}}', False)
    _press(robot, client, op)
    assert robot.take() == [(0.5, CLIENT), (0.0, GATE)]


@pytest.mark.parametrize(
    "text", ['{"op": "publish", "topic": "/a", "msg": {"data": "/gate/stop"}}', "/gate/stop"]
)
def test_only_a_stop_is_ahead_of_what_waits(text: str) -> None:
    robot = GatedRobot(RULES)
    client = robot.client()
    client.peer._wait_unread(b"{}", False)
    before = client.peer.messages
    client.say_raw(text)
    assert (client.peer.messages, len(client.peer._waiting)) == (before, 2)


@pytest.mark.parametrize("op", ["call_service", "publish"])
def test_a_stop_has_no_rate_and_no_quota(op: str) -> None:
    robot = GatedRobot(RULES)
    limits = {"messages_per_second": 1, "messages_burst": 1, "calls": 1, "advertisements": 1}
    robot.access.limits = robot.access.limits.model_copy(update=limits)
    client = robot.client()
    graph = client.peer.graph
    trigger = robot.graph.registry.service("std_srvs/Trigger")
    robot.graph.participant("/base").advertise_service("/never", trigger, lambda call: None)
    graph.call_service("/never", lambda type: Payload.from_value(type, {}), lambda reply: None)
    graph.advertise("/elsewhere", TWIST, "mark")
    with pytest.raises(QuotaExceeded):
        graph.advertise("/elsewhere_too", TWIST, "another mark")
    assert graph.calls_in_flight == 1
    _press(robot, client, op)
    assert client.close_code is None
    client.say("call_service", service="/gate/stop", args={})
    assert client.close_code is not None, "only the press itself is free"


def test_foxglove_stops_ahead_of_what_waits() -> None:
    robot = GatedRobot(RULES)
    gateway = FoxgloveGateway(robot.graph, robot.access)
    viewer = Viewer(gateway, headers={"authorization": f"Bearer {token('operator')}"})
    client: Any = viewer.endpoint
    number = next(id for id, each in client.listing.services.items() if each.name == "/gate/stop")
    client._wait_unread(b"{}", False)
    frame = b"\x02" + number.to_bytes(4, "little") + (1).to_bytes(4, "little") + (4).to_bytes(4, "little")
    client.receive(frame + b"json" + json.dumps({"reason": "now"}).encode(), True)
    assert robot.gate.stopped_by.startswith("foxglove:1")


def _request(path: str, body: bytes = b"{}", role: str = "operator") -> HttpRequest:
    headers = {"authorization": f"Bearer {token(role)}", "content-type": "application/json"}
    return HttpRequest("POST", path, "", headers, body, address="192.0.2.1")


def _page(robot: GatedRobot, route: Route[GraphView]) -> Handler:
    """Return the page of a route as the server has it."""
    assert route.stop is not None
    looks = RequestLooks(robot.access, robot.bridge.scheduler)
    return guarded(robot.access, route.page, Audience.ADMITTED, press=partial(looks.press, route.stop))


@pytest.mark.parametrize(
    "path", ["/api/services/gate/stop", "/api/services/%2fgate%2Fstop", "/api/topics/gate/stop"]
)
def test_a_stop_over_http_has_no_rate_of_work(path: str) -> None:
    robot = GatedRobot(RULES)
    gateway = HttpGateway(robot.graph, robot.access, HttpSettings())
    prefix = path[: path.index("/", 5)]
    route = next(each for each in gateway.http.routes if each.path == f"{prefix}/*" and each.method == "POST")
    page = _page(robot, route)

    def ask(path: str) -> int:
        answered: list[HttpResponse] = []

        async def run() -> None:
            answer = page(_request(path))
            answered.append(answer if isinstance(answer, HttpResponse) else await answer)

        anyio.run(run)
        return answered[0].status

    robot.access.reader(peer_of(_request(path))).work.add(1000.0, "pages")
    assert ask(f"{prefix}/other") == 429
    assert not robot.gate.stopped_by
    assert ask(path) in (200, 204)
    assert robot.gate.stopped_by.startswith("http:1")
    assert ask(path) == 429, "while it is stopped, a press is a request like any other"


@pytest.mark.parametrize(
    ("role", "method", "arguments", "pressed_by"),
    [
        ("operator", "POST", {"service": "/gate/stop", "request": {"reason": "now"}}, "mcp:arm"),
        ("operator", "POST", {"service": "gate/stop/"}, "mcp:arm"),
        ("operator", "GET", {"service": "/gate/stop"}, ""),
        ("operator", "POST", {"service": "/gate/release_stop"}, ""),
        ("operator", "POST", {"service": "/gate/stop", "request": {"reason": 5}}, ""),
        ("operator", "POST", {"service": "/gate/stop", "reason": "now"}, ""),
        ("agent", "POST", {"service": "/gate/stop"}, ""),
        ("supervisor", "POST", {"service": "/gate/stop"}, "mcp:arm"),
        ("nobody", "POST", {"service": "/gate/stop"}, ""),
    ],
)
def test_a_stop_of_an_agent_does_not_wait_for_the_sdk(
    role: str, method: str, arguments: dict[str, object], pressed_by: str
) -> None:
    robot = GatedRobot(RULES, emergency={"stop_roles": ["operator", "supervisor"]})
    supervisor = robot.access.admission.role_of_token(peer_of(_request("/mcp", role="supervisor")))
    assert supervisor is not None
    supervisor.globs = {**supervisor.globs, "call": ()}
    gateway = McpGateway(robot.graph, robot.access, McpSettings())
    meta = {"io.modelcontextprotocol/clientInfo": {"name": "arm", "version": "1"}}
    params = {"name": "call_service", "arguments": arguments, "_meta": meta}
    body = json.dumps({"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": params}).encode()
    request = replace(_request("/mcp", body, role), method=method)
    route = next(each for each in gateway.http.routes if each.method == method)
    answer = _page(robot, route)(request)
    if isinstance(answer, Coroutine):
        with pytest.raises(RuntimeError, match="event loop"):
            answer.send(None)  # The rest needs the event loop, for the SDK.
    assert robot.gate.stopped_by.partition(" ")[0] == pressed_by
