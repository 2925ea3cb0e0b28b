"""CPU time that one client's input costs others, on a server with a crowded gate.

The gate has rules with globs, many topics and clients, as many pending requests for approval as it keeps, and
an audit. The inputs come from a seed, so that a run can be repeated.
"""

from __future__ import annotations

import json
import logging
import random
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import mkdtemp
from types import MappingProxyType
from typing import Final

from rwt.access.access import Access
from rwt.access.gate.approvals import MAX_OF_CREDENTIAL, MAX_PENDING
from rwt.rosapi import DISCLOSURES, Rosapi
from rwt.rosbridge import Bridge
from rwt.settings.models import Settings
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_graph.api import ServerGoal
from rwt_interfaces.registry import Registry
from rwt_participant.timers import Timer
from tests.core.rosbridge.recording_client import Client

MOST_SECONDS: Final = 0.05
"""CPU time that one input, or one turn after it, may take from other clients."""

STOP_SECONDS: Final = 0.02
"""CPU time that a stop may take until every driven topic has its stop message."""

MOST_CALLS: Final = 20_000
"""Python and C functions that one frame may call; 20,000 take less than 20 ms."""

TWIST: Final = "geometry_msgs/Twist"
NUMBERS: Final = "std_msgs/Float64MultiArray"

_RIGHTS: Final = {act: ["*"] for act in ("publish", "subscribe", "call", "goals", "get_param", "set_param")}
_ROLES: Final = {"viewer": {"read_only": True}, "driver": _RIGHTS, "agent": _RIGHTS}
_APPROVAL: Final = {"roles": ["admin"], "seconds": 3600}
_RULES: Final[Mapping[str, object]] = {
    "drive": {"topics": ["/cmd_vel", "/x/*"], "lease": {"seconds": 60}, "emergency": True, "stop": {},
              "fields": {"linear.x": {"max": 1.0, "rate": 2.0, "beyond": "clamp"}}},
    "arm": {"topics": ["/arm/*"], "type": NUMBERS,
            "fields": {"data[]": {"min": -1, "max": 1, "beyond": "clamp"}}},
    "asked": {"topics": ["/asked/*"], "type": "std_msgs/String", "services": ["/ask/*"],
              "actions": ["/act/*"], "approval": _APPROVAL},
    "numbers": {"topics": ["/numbers/*"], "type": NUMBERS, "roles": ["agent"], "approval": _APPROVAL},
    "limits": {"topics": ["/numbers/*"], "roles": ["driver"], "fields": {"data[]": {"max": 1}}},
    "tuned": {"parameters": ["/*limit*", "/*/x*"], "actions": ["/count"], "emergency": True},
}  # fmt: skip

Ops = list[dict[str, object]]

RECONNECT: Final = '{"op": "reconnect"}'
"""Frame that stands for another connection."""

_registry: Final = Registry()


class WorkClock(SimulatedClock):
    """Simulated clock on which CPU time of this thread counts, and that measures the turns.

    Attributes:
        longest: CPU time of the longest turn, in seconds.
    """

    def __init__(self) -> None:
        super().__init__(1_700_000_000 * 10**9)
        self.longest = 0.0

    def monotonic(self) -> float:
        return super().monotonic() + time.thread_time()

    def call_later(self, delay: float, call: Callable[[], None]) -> Timer:
        return super().call_later(delay, partial(self.turn, call))

    def turn(self, act: Callable[[], object]) -> None:
        """Do something, and measure it."""
        begin = time.thread_time()
        act()
        self.longest = max(self.longest, time.thread_time() - begin)


class World:
    """Robot behind a crowded gate.

    Attributes:
        clients: client of each role that sends the inputs.
        stopped: topics that have got the stop message.

    Args:
        topics: number of topics that a glob matches.
        clients: number of other clients.
        waiting: number of pending requests for approval.
        audit: file of the audit.
    """

    def __init__(self, topics: int, clients: int, waiting: int, audit: Path) -> None:
        logging.getLogger("rwt.bridge").setLevel(logging.CRITICAL)
        tokens = {
            f"{role}{number}": {"token": _token(f"{role}{number}"), "role": role}
            for role, count in {
                **dict.fromkeys((*_ROLES, "admin"), 1),
                "agent": 1 + MAX_PENDING // MAX_OF_CREDENTIAL,
            }.items()
            for number in range(count)
        }
        gate = {"rules": _RULES, "audit": {"file": audit}}
        settings = Settings.model_validate(
            {"auth": {"tokens": tokens, "default_role": "admin"}, "roles": _ROLES, "gate": gate}
        )
        self.clock = WorkClock()
        graph = MemoryGraph(_registry, self.clock)
        self.robot = Node(graph, "robot")
        self.access = Access(graph, settings, DISCLOSURES)
        self.bridge = Bridge(graph, settings, self.access)
        Rosapi(graph)
        self.robot.advertise_service("/ask/blink", "std_srvs/SetBool", lambda _: {"success": True})
        self.robot.parameters.declare("limit", 0.0)
        self.stopped: list[str] = []
        graph.participant("/counter").advertise_action(
            "/act/count", _registry.action("example_interfaces/Fibonacci"), _accept
        )
        self.robot.advertise("/cmd_vel", TWIST)
        graph.participant("/base").subscribe(
            "/cmd_vel", lambda sample: self.stopped.append(sample.topic), _registry.message(TWIST)
        )
        for number in range(topics):
            self.robot.advertise(f"/x/{number}", TWIST)
        self._waiting = waiting
        self._others = [
            self.client("agent", number % 50 + 1 if number < 1000 else 1) for number in range(clients)
        ]
        for number, client in enumerate(self._others):
            client.say("publish", topic=f"/x/{number}", type=TWIST, msg={"linear": {"x": 0.1}})
        self.ask()
        self.clients = {role: self.client(role, 0) for role in _ROLES}
        for each in (*self._others, *self.clients.values()):
            each.frames.clear()

    def client(self, role: str, number: int) -> Client:
        """Connect one more client."""
        return Client(self.bridge, headers={"authorization": f"Bearer {_token(f'{role}{number}')}"})

    def ask(self) -> None:
        """Fill the list of requests for approval."""
        assert self.access.gate is not None
        for number in range(self._waiting):
            client = self._others[number % len(self._others)]
            client.say("call_service", service="/ask/blink", args={"data": True}, id=f"{number}")

    def send(self, role: str, frame: str) -> None:
        """Send a frame, or connect anew."""
        if frame == RECONNECT:
            self.clients[role].leave()
            self.clients[role] = self.client(role, 0)
        self.clients[role].say_raw(frame)
        self.clients[role].frames.clear()

    def play(self, given: Input) -> None:
        """Send all frames of an input."""
        for frame in given.frames:
            self.send(given.role, frame)

    def stop(self) -> None:
        """Press the emergency stop for the robot's own program."""
        assert self.access.gate is not None
        self.access.gate.stop(None)

    def recover(self) -> None:
        """Release the stop, drive again, and request approval again."""
        assert self.access.gate is not None
        self.access.gate.release(None)
        self.clock.advance(2.0)
        for number, client in enumerate(self._others[:200]):
            client.say("publish", topic=f"/x/{number}", type=TWIST, msg={"linear": {"x": 0.1}})
        self.ask()
        for each in self._others:
            each.frames.clear()

    def close(self) -> None:
        """Close the audit."""
        self.access.close()


def _token(name: str) -> str:
    return f"{name}-token-of-the-test"


def _accept(goal: ServerGoal) -> None:
    goal.accept()


# -- inputs ------------------------------------------------------------------------------------------------

_NAMES: Final = (
    "/x/7", "/x/" + "a" * 200, "/x" + "/b" * 60, "/cmd_vel", "/x/*", "/" + "y/" * 3000 + "z", "~", "",
)  # fmt: skip
_LONG: Final = "\x1b[31m\n" * 20_000


def _call(service: str, **args: object) -> dict[str, object]:
    return {"op": "call_service", "service": service, "args": args}


def _publish(topic: str, type: str, **msg: object) -> dict[str, object]:
    return {"op": "publish", "topic": topic, "type": type, "msg": msg}


def _lists(chosen: random.Random) -> Ops:
    length = chosen.choice((10, 9_999, 10_001, 100_000, 400_000))
    value = chosen.choice((0.5, 5.0, 1e300, -0.0, 1, None))
    return [_publish(f"/arm/{chosen.randrange(5)}", NUMBERS, layout={}, data=[value] * length)]


def _commands(chosen: random.Random) -> Ops:
    speed = chosen.choice((0.5, 5.0, None, 1e308))
    return [
        _publish(chosen.choice(_NAMES), TWIST, linear={"x": speed}) for _ in range(chosen.choice((1, 20)))
    ]


def _topics(chosen: random.Random) -> Ops:
    name = chosen.choice((*_NAMES, f"/x/new{chosen.randrange(10**6)}"))
    return [{"op": "advertise", "topic": name, "type": TWIST}, {"op": "unadvertise", "topic": name}]


def _asked_messages(chosen: random.Random) -> Ops:
    text = chosen.choice(("a", "\u202e" * 5_000, "x" * 900_000, "x" * 1_200_000, _LONG))
    numbers = [chosen.choice((0, 0.5, 1e300))] * chosen.choice((10, 100_000, 200_000))
    number = chosen.randrange(30)
    return chosen.choice(
        (
            [_publish(f"/asked/{number}", "std_msgs/String", data=text)],
            [_publish(f"/numbers/{number}", NUMBERS, layout={}, data=numbers)],
        )
    )


def _asked_calls(chosen: random.Random) -> Ops:
    return [
        _call("/ask/blink", data=bool(chosen.randrange(2)), pad=None) for _ in range(chosen.choice((1, 25)))
    ]


def _asked_goals(chosen: random.Random) -> Ops:
    goal = {"op": "send_action_goal", "action": "/act/count", "action_type": "example_interfaces/Fibonacci"}
    return [{**goal, "args": {"order": 3}, "id": f"g{number}"} for number in range(chosen.choice((1, 25)))]


def _parameters(chosen: random.Random) -> Ops:
    table: object = {f"x{number}": number for number in range(chosen.choice((1, 900, 1_100, 40_000)))}
    for _ in range(chosen.choice((0, 3, 100))):
        table = {"x": table}
    name = chosen.choice(("/x", "/robot", "/", "/robot:limit", "/a" * 300, "/x/limit"))
    value = json.dumps(chosen.choice((table, [0.5] * 60_000, "x" * 300_000)))
    return [_call("/rosapi/set_param", name=name, value=value), _call("/rosapi/delete_param", name=name)]


def _leases(chosen: random.Random) -> Ops:
    service = chosen.choice(("take_lease", "release_lease", "pass_lease"))
    return [_call(f"/gate/{service}", topic=chosen.choice(_NAMES), to=chosen.choice(("rosbridge:5", _LONG)))]


def _answers(chosen: random.Random) -> Ops:
    id = chosen.choice((str(chosen.randrange(2000)), _LONG, "\u0660"))
    return [
        _call("/gate/approve", id=id, approve=bool(chosen.randrange(2)), seconds=chosen.choice((0, 1e308)))
    ]


def _state_topics(chosen: random.Random) -> Ops:
    topic = chosen.choice(("/gate/approvals", "/gate/leases", "/gate/stopped"))
    coding = chosen.choice(("none", "cbor", "cbor-raw", "png"))
    ask: dict[str, object] = {"op": "subscribe", "topic": topic, "compression": coding, "id": "s"}
    return [ask, {"op": "unsubscribe", "topic": topic, "id": "s"}] if chosen.randrange(2) else [ask]


def _stops(chosen: random.Random) -> Ops:
    return [
        _call("/gate/stop", reason=chosen.choice(("x", _LONG))),
        _call("/gate/release_stop", reason=_LONG),
    ]


def _connections(chosen: random.Random) -> Ops:
    some = chosen.choice((_commands, _asked_calls, _topics))
    return [*some(chosen), {"op": "reconnect"}]


SHAPES: Final[Mapping[str, Callable[[random.Random], Ops]]] = MappingProxyType(
    {
        "lists": _lists, "commands": _commands, "topics": _topics,
        "messages that require approval": _asked_messages, "calls that require approval": _asked_calls,
        "goals that require approval": _asked_goals, "parameters": _parameters, "leases": _leases,
        "answers": _answers, "topics of the gate": _state_topics, "stops": _stops,
        "connections": _connections,
    }
)  # fmt: skip
"""Kinds of inputs."""


@dataclass(frozen=True, slots=True)
class Input:
    """Frames that one client sends together."""

    shape: str
    role: str
    frames: tuple[str, ...]

    def __str__(self) -> str:
        first, *others = self.frames
        more = f" and {len(others)} more" if others else ""
        return f"{self.role}: {first[:140]}{'…' if len(first) > 140 else ''} ({len(first)} characters){more}"


def inputs(seed: int) -> Iterator[Input]:
    """Yield inputs without an end, the same for the same seed."""
    chosen = random.Random(seed)
    while True:
        shape = chosen.choice(tuple(SHAPES))
        yield Input(shape, chosen.choice(tuple(_ROLES)), tuple(map(json.dumps, SHAPES[shape](chosen))))


# -- costs -------------------------------------------------------------------------------------------------


def cost(world: World, given: Input) -> float:
    """Return the CPU time of an input's longest turn: of one of its ops, or of a turn after them."""
    world.clock.longest = 0.0
    for frame in given.frames:
        world.clock.turn(partial(world.send, given.role, frame))
    world.clock.advance(0.2)
    return world.clock.longest


def worst(seed: int, seconds: float) -> tuple[Mapping[str, tuple[float, Input]], float]:
    """Return the most expensive input of each kind that was found in that time, and the slowest stop."""
    world = World(10_000, 1_000, MAX_PENDING, Path(mkdtemp(prefix="gate-costs-")) / "audit.jsonl")
    found: dict[str, tuple[float, Input]] = {}
    slowest_stop = 0.0
    until = time.monotonic() + seconds
    for count, given in enumerate(inputs(seed), 1):
        if time.monotonic() > until:
            break
        new = cost(world, given)
        if new > MOST_SECONDS:
            new = min(new, cost(world, given))  # Other processes and the garbage collector take time, too.
        if given.shape not in found or found[given.shape][0] < new:
            found[given.shape] = (new, given)
        if count % 20 == 0:
            world.clock.longest = 0.0
            world.clock.turn(world.stop)
            slowest_stop = max(slowest_stop, world.clock.longest)
            world.recover()
    world.close()
    return found, slowest_stop
