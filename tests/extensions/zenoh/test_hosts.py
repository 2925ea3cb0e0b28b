"""Servers as processes, on two hosts and on one, when things go wrong between them."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.core.access.network import Cable, why_no_cables
from tests.extensions.zenoh.two_hosts import Client, Served, client, serving
from tests.waiting import wait_until
from tests.zenoh_links import free_endpoint

CUT_SECONDS = 5.0
BACK_SECONDS = 2.0

#: A peer that says nothing is taken for gone later than by default, and later than such a cut is over.
_LONG_LEASE = "{ transport: { link: { tx: { lease: 30000 } } } }"


@pytest.fixture
def net() -> Iterator[Cable]:
    if reason := why_no_cables():
        pytest.skip(reason)
    with Cable() as made:
        yield made


@dataclass(slots=True)
class Scene:
    """A robot's client at one server, and a page at another."""

    robot: Client
    page: Client
    gateway: Served
    ticks: int = 0
    calls: list[str] = field(default_factory=list)

    def begin(self) -> None:
        """Offer everything at the robot, and wait until the page hears it."""
        self.robot.send(op="advertise", topic="/state", type="std_msgs/String", latch=True)
        self.robot.send(op="publish", topic="/state", msg={"data": "kept"})
        self.robot.send(op="advertise", topic="/tick", type="std_msgs/Int32")
        for service in ("/go", "/never"):
            self.robot.send(op="advertise_service", service=service, type="std_srvs/Trigger")
        self.page.send(op="subscribe", topic="/state", type="std_msgs/String")
        self.page.send(op="subscribe", topic="/tick", type="std_msgs/Int32")
        wait_until(lambda: self.tick() and "kept" in self.page.on("/state") and bool(self.ticked(1)))
        self.page.send(op="call_service", service="/never", id="never", timeout=600)
        wait_until(lambda: any(op.get("service") == "/never" for op in self.robot.read()))

    def tick(self) -> bool:
        """Publish the next number, and answer calls."""
        self.ticks += 1
        self.robot.send(op="publish", topic="/tick", msg={"data": self.ticks})
        self.robot.serve()
        time.sleep(0.02)
        return True

    def ticked(self, since: int) -> list[int]:
        """The numbers from one on that the page has heard."""
        return [number for number in self.page.on("/tick") if number >= since]

    def gone(self) -> bool:
        """Return True if a call of the page succeeds; asks again after each that failed."""
        answers = [self.page.answer(id) for id in self.calls]
        if any(answer is not None and answer["result"] for answer in answers):
            return True
        if all(answer is not None for answer in answers):
            self.calls.append(f"go{len(self.calls)}")
            self.page.send(op="call_service", service="/go", id=self.calls[-1], timeout=60)
        return False

    def back(self, late: Client) -> float:
        """Seconds until topics, kept samples and services are back, for a client that comes now too."""
        begin, first = time.monotonic(), self.ticks + 1
        late.send(op="subscribe", topic="/state", type="std_msgs/String")
        wait_until(
            lambda: self.tick() and bool(self.ticked(first)) and self.gone() and "kept" in late.on("/state")
        )
        return time.monotonic() - begin


@pytest.fixture
def scene(net: Cable, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Scene]:
    file = tmp_path / "zenoh.json5"
    file.write_text(request.param)
    options = ("--zenoh-config", str(file))
    place = f"tcp/{net.there}:7447"
    with (
        serving(tmp_path, "robot", "--zenoh-listen", place, *options, prefix=net.there_runs) as robot,
        serving(tmp_path, "gateway", "--zenoh-connect", place, *options) as gateway,
        client(robot) as robots,
        client(gateway) as page,
    ):
        made = Scene(robots, page, gateway)
        made.begin()
        yield made


def cut(net: Cable, scene: Scene) -> None:
    """Five seconds without a cable, in which the robot goes on."""
    net.pull()
    until_then = time.monotonic() + CUT_SECONDS
    while time.monotonic() < until_then:
        scene.tick()
    net.plug()


@pytest.mark.timeout(90)
@pytest.mark.parametrize("scene", [_LONG_LEASE], indirect=True)
def test_a_cut_shorter_than_the_lease_loses_nothing_of_what_is_sent_slowly(scene: Scene, net: Cable) -> None:
    scene.page.send(op="call_service", service="/never", id="default")
    cut(net, scene)
    with client(scene.gateway) as late:
        took = scene.back(late)
    assert took < BACK_SECONDS
    # The link has outlived it: so has a call, as long as its own timeout lets it.
    failed = scene.page.answer("default")
    assert failed is not None
    assert (failed["result"], failed["values"]) == (
        False,
        "Timeout exceeded while waiting for service response",
    )
    assert scene.page.answer("never") is None
    assert scene.ticked(1) == sorted(set(scene.ticked(1)))


@pytest.mark.timeout(90)
@pytest.mark.parametrize("scene", ["{}"], indirect=True)
def test_a_cut_longer_than_the_lease_heals_by_itself(scene: Scene, net: Cable) -> None:
    cut(net, scene)
    failed = scene.page.answer("never")
    assert failed is not None, "a call to the other host is still open"
    assert failed["result"] is False
    assert failed["values"] in (
        "Service /never went away without an answer",
        "Service /never was unadvertised",
    )
    with client(scene.gateway) as late:
        took = scene.back(late)
    assert took < BACK_SECONDS
    assert scene.ticked(1) == sorted(set(scene.ticked(1)))


@pytest.mark.timeout(60)
@pytest.mark.parametrize("scene", ["{}"], indirect=True)
def test_a_server_ends_on_a_signal_while_its_peer_cannot_be_reached(scene: Scene, net: Cable) -> None:
    net.pull()
    scene.gateway.process.send_signal(signal.SIGINT)
    assert scene.gateway.process.wait(20) == 0


@pytest.mark.timeout(60)
def test_a_router_that_is_started_again_joins_its_clients_again(tmp_path: Path) -> None:
    place = free_endpoint()
    router = ("--set", "zenoh.mode=router", "--zenoh-listen", place)
    as_client = ("--set", "zenoh.mode=client", "--zenoh-connect", place)
    with ExitStack() as stack:
        with serving(tmp_path, "router", *router):
            one = stack.enter_context(serving(tmp_path, "one", *as_client))
            two = stack.enter_context(serving(tmp_path, "two", *as_client))
            robot, page = (stack.enter_context(client(each)) for each in (one, two))
            scene = Scene(robot, page, two)
            scene.begin()
        began = time.monotonic()
        wait_until(lambda: page.answer("never") is not None)
        assert time.monotonic() - began < 20, "an open call has not failed"
        (tmp_path / "router.sock").unlink()
        stack.enter_context(serving(tmp_path, "router", *router))
        with client(two) as late:
            scene.back(late)


@pytest.mark.timeout(60)
def test_a_peer_that_is_stopped_does_not_hold_up_the_others(tmp_path: Path) -> None:
    place = free_endpoint()
    with (
        serving(tmp_path, "robot", "--zenoh-listen", place) as robot,
        serving(tmp_path, "good", "--zenoh-connect", place) as good,
        serving(tmp_path, "stopped", "--zenoh-connect", place) as stopped,
        client(robot) as source,
        client(good) as page,
        client(stopped) as frozen,
    ):
        source.send(op="advertise", topic="/big", type="std_msgs/String")
        for each in (page, frozen):
            each.send(op="subscribe", topic="/big", type="std_msgs/String")
        load = "x" * 100_000

        def heard_by_both() -> bool:
            source.send(op="publish", topic="/big", msg={"data": "start"})
            time.sleep(0.02)
            return bool(page.on("/big") and frozen.on("/big"))

        def page_has(count: int) -> None:
            wait_until(lambda: len(page.on("/big")) >= count)

        wait_until(heard_by_both)
        stopped.process.send_signal(signal.SIGSTOP)
        try:
            worst, begin = 0.0, len(page.on("/big"))
            # Far more than the buffers of a link hold.
            for number in range(1, 301):
                sent = time.monotonic()
                source.send(op="publish", topic="/big", msg={"data": f"{number} {load}"})
                page_has(begin + number)
                worst = max(worst, time.monotonic() - sent)
            assert worst < 2.0
        finally:
            stopped.process.send_signal(signal.SIGCONT)
        # It catches up with what the link held, and hears what comes from now on.
        wait_until(lambda: heard_by_both() and "start" in frozen.on("/big")[-3:])


def test_two_versions_of_a_type_are_told_apart_and_named(tmp_path: Path) -> None:
    place = free_endpoint()
    folders = []
    for name, text in (("old", "int32 speed\n"), ("new", "float64 speed\nstring unit\n")):
        folder = tmp_path / name / "robot_msgs" / "msg"
        folder.mkdir(parents=True)
        (folder / "Drive.msg").write_text(text)
        folders.append(str(tmp_path / name))
    with (
        serving(tmp_path, "old-server", "--zenoh-listen", place, "--interfaces", folders[0]) as old,
        serving(tmp_path, "new-server", "--zenoh-connect", place, "--interfaces", folders[1]) as new,
        client(old) as robot,
        client(new) as page,
    ):
        robot.send(op="advertise", topic="/drive", type="robot_msgs/Drive")
        robot.send(op="advertise", topic="/word", type="std_msgs/String")
        wait_until(lambda: new.said("the other process defines it otherwise (RIHS01_"))
        assert new.said("/drive of node /rosbridge_websocket cannot be exchanged")
        page.send(op="subscribe", topic="/drive", type="robot_msgs/Drive")
        page.send(op="subscribe", topic="/word", type="std_msgs/String")

        def heard() -> bool:
            robot.send(op="publish", topic="/drive", msg={"speed": 1})
            robot.send(op="publish", topic="/word", msg={"data": "hello"})
            time.sleep(0.02)
            return bool(page.on("/word"))

        wait_until(heard)
        assert not [op for op in page.heard if op.get("topic") == "/drive"]
        for server in (old, new):
            assert server.process.poll() is None
            assert not server.said("Traceback")
