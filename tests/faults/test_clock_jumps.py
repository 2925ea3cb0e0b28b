"""The wall clock is set back or forth by a day: stamps follow it, and nothing that is timed does."""

from __future__ import annotations

import pytest

from rwt import Settings
from rwt.rosbridge import Bridge
from rwt_graph import MemoryGraph
from rwt_graph.clock import SimulatedClock
from tests.core.rosbridge.recording_client import Client

DAY_NS = 86_400 * 1_000_000_000
START_NS = 1_700_000_000 * 1_000_000_000


class JumpingClock(SimulatedClock):
    """A wall clock that somebody sets; steady time knows nothing of it."""

    def __init__(self) -> None:
        super().__init__(START_NS)
        self.jump_ns = 0

    def time_ns(self) -> int:
        return super().time_ns() + self.jump_ns


@pytest.fixture
def clock() -> JumpingClock:
    return JumpingClock()


@pytest.fixture
def bridge(clock: JumpingClock) -> Bridge:
    return Bridge(MemoryGraph(clock=clock), Settings())


@pytest.fixture(params=[-DAY_NS, DAY_NS], ids=["back", "forth"])
def jump(request: pytest.FixtureRequest) -> int:
    found: int = request.param
    return found


def test_stamps_follow_the_wall(bridge: Bridge, clock: JumpingClock, jump: int) -> None:
    client = Client(bridge)
    client.say("subscribe", topic="/p", type="geometry_msgs/PoseStamped")
    for _ in range(2):
        client.say("publish", topic="/p", msg={})
        clock.jump_ns = jump
    before, after = (message["header"]["stamp"]["sec"] for message in client.heard_of("/p"))
    assert (before, after) == (START_NS // 10**9, (START_NS + jump) // 10**9)


def test_a_throttled_topic_keeps_its_pace(bridge: Bridge, clock: JumpingClock, jump: int) -> None:
    client = Client(bridge)
    client.say("subscribe", topic="/t", type="std_msgs/Int32", throttle_rate=100)
    for number in range(100):
        if number == 50:
            clock.jump_ns = jump
        client.say("publish", topic="/t", msg={"data": number})
        clock.advance(0.01)
    assert len(client.heard_of("/t")) == 10


def test_a_call_times_out_when_its_time_has_gone_by_and_not_before(
    bridge: Bridge, clock: JumpingClock, jump: int
) -> None:
    provider, caller = Client(bridge), Client(bridge)
    provider.say("advertise_service", service="/slow", type="std_srvs/SetBool")
    caller.say("call_service", service="/slow", id="c", timeout=2.0, args={"data": True})
    clock.jump_ns = jump
    clock.advance(1.9)
    assert caller.heard() == []
    clock.advance(0.2)
    (reply,) = caller.heard()
    assert (reply["id"], reply["result"]) == ("c", False)


def test_fragments_outlive_a_jump(bridge: Bridge, clock: JumpingClock, jump: int) -> None:
    client = Client(bridge)
    client.say("subscribe", topic="/t", type="std_msgs/String")
    client.say("fragment", id="f", num=0, total=2, data='{"op":"publish","topic":"/t",')
    clock.jump_ns = jump
    clock.advance(1)
    client.say("fragment", id="f", num=1, total=2, data='"msg":{"data":"whole"}}')
    assert client.heard_of("/t") == [{"data": "whole"}]
