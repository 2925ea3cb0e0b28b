"""Peers that disappear without closing their connections: on a second host, whose cable is pulled."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import anyio
import pytest

from rwt.extensions.ros1 import Ros1Graph
from rwt.extensions.ros1.wire.links import QUEUE_BYTES
from rwt_transports.drivers import sockets
from tests.core.access.network import Cable, why_no_cables
from tests.extensions.ros1.live.conftest import Ros
from tests.extensions.ros1.live.test_topics import PUBLISH, SUBSCRIBE
from tests.waiting import until

pytestmark = pytest.mark.anyio

SPEAK = PUBLISH.replace("/chatter", "/speech")


@pytest.fixture
def cable() -> Iterator[Cable]:
    reason = why_no_cables()
    if reason:
        pytest.skip(reason)
    with Cable() as made:
        yield made


@pytest.fixture
def ros(tmp_path: Path, cable: Cable) -> Iterator[Ros]:
    """ROS 1 with a master that the second host reaches."""
    with closing(Ros(tmp_path, cable.here)) as made:
        made.start_master()
        yield made


@pytest.mark.timeout(240)
async def test_half_open_connections_are_closed_and_made_again(
    ros: Ros, cable: Cable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sockets, "KEEPALIVE_SECONDS", 1)
    monkeypatch.setattr(sockets, "UNACKNOWLEDGED_SECONDS", 3)
    monkeypatch.setenv("ROS_IP", cable.here)
    program = ros.program(prefix=cable.there_runs, environment={"ROS_IP": cable.there})
    program.run(SUBSCRIBE.replace("m.data", "m.data[:10]") + SPEAK)
    heard: list[str] = []
    async with Ros1Graph(master=ros.uri) as graph:
        node = graph.node("both")
        node.subscribe("/speech", lambda each: heard.append(each.data), "std_msgs/String")
        publisher = node.advertise("/chatter", "std_msgs/String")
        assert graph.session is not None
        ours = graph.session.nodes["/both"]
        publication, subscription = ours.publications["/chatter"], ours.subscriptions["/speech"]
        await until(lambda: publication.links and subscription.connected)
        (link,) = publication.links

        cable.pull()
        with anyio.fail_after(60):
            while publication.links or subscription.connected:
                publisher.publish({"data": "x" * 1_000_000})
                assert link.traffic.queued_bytes <= QUEUE_BYTES + 2_000_000
                await anyio.sleep(0.05)
        assert link.ended.is_set()

        # Only this side: rospy notices its own half-open connections after two minutes and a half.
        cable.plug()
        with anyio.fail_after(90):
            while "again" not in heard:
                program.run("publisher.publish('again')")
                await anyio.sleep(0.2)
