"""A robot behind a gate, on a clock that the test moves, with clients whose wire is a list."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from rwt import Settings
from rwt.access.access import Access
from rwt.access.gate.gate import Gate
from rwt.extensions.http.gateway import HttpGateway
from rwt.extensions.http.part import HttpSettings
from rwt.gateways.visitors import peer_of
from rwt.rosapi import DISCLOSURES
from rwt.rosbridge import Bridge
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_graph.api import Sample
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.registry import Registry
from rwt_transports.http.routes import HttpRequest, HttpResponse
from tests.core.rosbridge.recording_client import Client

ROLES = ("operator", "supervisor", "agent", "admin")
RIGHTS = {
    act: ["*"] for act in ("publish", "subscribe", "call", "provide", "goals", "get_param", "set_param")
}
DRIVE: Mapping[str, Any] = {"topics": ["/cmd_vel"], "lease": {"seconds": 0.5}, "stop": {}}
TWIST = "geometry_msgs/Twist"
FIBONACCI = "example_interfaces/Fibonacci"


def token(role: str) -> str:
    """The token of a role."""
    return f"{role}-token-of-the-test"


def settings_of(gate: Mapping[str, Any], auth: Mapping[str, Any] | None = None, **others: object) -> Settings:
    """Settings with a token for each role, all of which but `admin` may do what `RIGHTS` says."""
    tokens = {role: {"token": token(role), "role": role} for role in ROLES}
    tokens["operator2"] = {"token": token("operator2"), "role": "operator"}
    roles = {role: RIGHTS for role in ROLES if role != "admin"}
    values = {"auth": {"tokens": tokens, **(auth or {})}, "roles": roles, "gate": gate, **others}
    return Settings.model_validate(values)


@cache
def _registry(distro: str) -> Registry:
    """One for all robots: its types are compiled once."""
    return Registry(DISTROS[distro])


class GatedRobot:
    """A robot that notes what it is told on `/cmd_vel`.

    Attributes:
        heard: the velocities forwards, each with the node that published it.
        samples: all of them whole.
        level: minimum severity of the `status` messages to its clients.
    """

    level = "warning"

    def __init__(
        self,
        rules: Mapping[str, Any],
        distro: str = "jazzy",
        clock: SimulatedClock | None = None,
        auth: Mapping[str, Any] | None = None,
        **gate: Any,
    ) -> None:
        self.clock = clock or SimulatedClock(1_700_000_000 * 10**9)
        self.graph = MemoryGraph(_registry(distro), self.clock)
        self.node = Node(self.graph, "robot")
        self.heard: list[tuple[float, str]] = []
        self.samples: list[Sample] = []
        self.graph.participant("/base").subscribe(
            "/cmd_vel", self._on_sample, self.graph.registry.message(TWIST)
        )
        settings = settings_of({"rules": rules, **gate}, auth or {})
        self.access = Access(self.graph, settings, DISCLOSURES)
        self.bridge = Bridge(self.graph, settings, self.access)

    def _on_sample(self, sample: Sample) -> None:
        value: Any = sample.payload.value()
        self.heard.append((value.linear.x, sample.node))
        self.samples.append(sample)

    @property
    def gate(self) -> Gate:
        """Of the server."""
        assert self.access.gate is not None
        return self.access.gate

    def take(self) -> list[tuple[float, str]]:
        """Return the messages received since the last call."""
        heard, self.heard = self.heard, []
        return heard

    def client(self, role: str = "operator", user_agent: str = "") -> Client:
        """One more client."""
        headers = {"authorization": f"Bearer {token(role)}", "user-agent": user_agent}
        client = Client(self.bridge, headers=headers)
        client.say("set_level", level=self.level)
        return client

    def clients(self, *roles: str) -> list[Client]:
        """More clients, one for each role."""
        return [self.client(role) for role in roles]

    def hear(self, topic: str, type: str = TWIST, **options: Any) -> list[Any]:
        """Return a list to which the messages of a topic are added."""
        heard: list[Any] = []
        self.node.subscribe(topic, heard.append, type=type, **options)
        return heard

    def latest(self, topic: str, seconds: float = 0.1) -> Any:
        """Return what a late subscriber of a topic of the gate receives, after some time."""
        self.clock.advance(seconds)
        info = self.graph.topic(topic)
        assert info is not None and info.type is not None
        heard: list[Any] = []
        self.node.subscribe(topic, heard.append, type=info.type.name).close()
        return heard[-1]

    def offer(self, *services: str, type: str = "std_srvs/SetBool") -> list[Any]:
        """Offer services that succeed, and return a list to which their requests are added."""
        done: list[Any] = []

        def serve(request: Any) -> dict[str, object]:
            done.append(request)
            return {} if type == "turtlesim/Spawn" else {"success": True}

        for service in services:
            self.node.advertise_service(service, type, serve)
        return done

    def accept_goals(self, action: str) -> tuple[list[int], list[str]]:
        """Offer an action whose goals run on; return lists of their orders, and of ids that are cancelled."""
        orders: list[int] = []
        cancelled: list[str] = []

        def on_goal(goal: Any) -> None:
            orders.append(goal.goal.value().order)
            goal.on_cancel = lambda: cancelled.append(goal.id)
            goal.accept()

        kind = self.graph.registry.action(FIBONACCI)
        self.graph.participant("/counter").advertise_action(action, kind, on_goal)
        return orders, cancelled


class HttpClient:
    """A client of the HTTP gateway without a connection."""

    def __init__(self, robot: GatedRobot, gateway: Any = None) -> None:
        self._access = robot.access
        self._routes = (gateway or HttpGateway(robot.graph, robot.access, HttpSettings())).http.routes

    def request(self, method: str, path: str, body: bytes = b"{}", role: str = "operator") -> HttpResponse:
        """Send a request that is answered at once."""
        headers = {"authorization": f"Bearer {token(role)}", "content-type": "application/json"}
        request = HttpRequest(method, path, "", headers, body, address="127.0.0.1")
        page = next(
            each.page
            for each in self._routes
            if each.method == method and path.startswith(each.path.removesuffix("*"))
        )
        answer: Any = page(request, self._access.reader(peer_of(request)))
        if isinstance(answer, HttpResponse):
            return answer
        try:
            answer.send(None)
        except StopIteration as done:
            response: HttpResponse = done.value
            return response
        raise AssertionError("this request waits")


def errors(client: Client) -> str:
    """Return the errors that a client is told, empty if none."""
    told = (each for each in client.heard() if each["op"] == "status" and each["level"] == "error")
    return " ".join(str(each["msg"]) for each in told)


def drive(client: Client, speed: float, topic: str = "/cmd_vel", **fields: object) -> str:
    """Publish a velocity; returns the error that the client is told, empty if none."""
    client.say("publish", topic=topic, type=TWIST, msg={"linear": {"x": speed, **fields}, "angular": {}})
    return errors(client)


def call(client: Client, service: str, **args: object) -> dict[str, Any]:
    """Call a service that answers at once; returns its answer."""
    client.say("call_service", service=service, args=args)
    (answer,) = (each for each in client.heard() if each["op"] == "service_response")
    assert answer["result"], answer
    values: dict[str, Any] = answer["values"]
    return values


CLIENT = "/rosbridge_websocket"
GATE = "/gate"
