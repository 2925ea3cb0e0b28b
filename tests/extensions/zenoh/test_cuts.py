"""A link that is cut, and is there again: what two graphs know and hear of each other afterwards."""

from __future__ import annotations

from collections.abc import AsyncIterator

import anyio
import anyio.abc
import pytest

from rwt.extensions.zenoh import ZenohGraph
from rwt_participant.errors import ProviderGone
from rwt_participant.qos import LATCHED
from tests.waiting import PATIENCE, until
from tests.zenoh_links import QUICK, free_endpoint

pytestmark = pytest.mark.anyio


class Wire:
    """A TCP connection to an endpoint, which can be cut and mended."""

    def __init__(self, endpoint: str) -> None:
        self.endpoint = free_endpoint()
        self._target = int(endpoint.rpartition(":")[2])
        self._whole = True
        self._streams: list[anyio.abc.SocketStream] = []

    async def run(self, *, task_status: anyio.abc.TaskStatus[None]) -> None:
        """Pass on what comes, until cancelled."""
        port = int(self.endpoint.rpartition(":")[2])
        async with await anyio.create_tcp_listener(local_host="127.0.0.1", local_port=port) as listener:
            task_status.started()
            await listener.serve(self._pass_on)

    async def _pass_on(self, near: anyio.abc.SocketStream) -> None:
        async with near:
            if not self._whole:
                return
            async with await anyio.connect_tcp("127.0.0.1", self._target) as far:
                self._streams = [near, far]
                async with anyio.create_task_group() as tasks:
                    for source, target in ((near, far), (far, near)):
                        tasks.start_soon(self._copy, source, target, tasks.cancel_scope)

    async def _copy(
        self, source: anyio.abc.SocketStream, target: anyio.abc.SocketStream, scope: anyio.CancelScope
    ) -> None:
        try:
            while True:
                await target.send(await source.receive())
        except (anyio.EndOfStream, anyio.BrokenResourceError, anyio.ClosedResourceError):
            scope.cancel()

    async def cut(self) -> None:
        """Close it, and let no new one through."""
        self._whole = False
        for stream in self._streams:
            await stream.aclose()

    def mend(self) -> None:
        """Let new connections through."""
        self._whole = True


@pytest.fixture
async def wire() -> AsyncIterator[tuple[ZenohGraph, ZenohGraph, Wire]]:
    endpoint = free_endpoint()
    made = Wire(endpoint)
    async with anyio.create_task_group() as tasks:
        await tasks.start(made.run)
        async with (
            ZenohGraph(listen=[endpoint], config=QUICK) as a,
            ZenohGraph(connect=[made.endpoint], config=QUICK) as b,
        ):
            yield a, b, made
        tasks.cancel_scope.cancel()


async def test_a_cut_heals_by_itself(wire: tuple[ZenohGraph, ZenohGraph, Wire]) -> None:
    a, b, link = wire
    node = a.node("robot")
    state = node.advertise("state", "std_msgs/String", qos=LATCHED)
    state.publish({"data": "before"})
    node.advertise_service("go", "std_srvs/Trigger", lambda _: {"message": "gone"})
    heard: list[str] = []
    page = b.node("page")
    page.subscribe("/state", lambda message: heard.append(message.data))
    await until(lambda: heard == ["before"])
    await link.cut()
    await until(lambda: [n.name for n in b.nodes()] == ["/page"] and b.service("/go") is None)
    await until(lambda: [n.name for n in a.nodes()] == ["/robot"])
    state.publish({"data": "meanwhile"})
    link.mend()
    await until(lambda: heard == ["before", "meanwhile"])
    await until(lambda: b.service("/go") is not None and state.subscriber_count == 1)
    assert (await page.call("/go", timeout=PATIENCE)).message == "gone"
    # Whoever subscribes now is given what was kept, too, and nobody anything twice.
    late: list[str] = []
    page.subscribe("/state", lambda message: late.append(message.data))
    await until(lambda: late == ["meanwhile"])
    state.publish({"data": "after"})
    await until(lambda: late[-1] == "after")
    assert heard == ["before", "meanwhile", "after"]


async def test_kept_samples_are_there_again_when_nothing_was_published_meanwhile(
    wire: tuple[ZenohGraph, ZenohGraph, Wire],
) -> None:
    a, b, link = wire
    a.node("robot").advertise("/map", "std_msgs/String", qos=LATCHED).publish({"data": "hall"})
    heard: list[str] = []
    page = b.node("page")
    page.subscribe("/map", lambda message: heard.append(message.data))
    await until(lambda: heard == ["hall"])
    await link.cut()
    await until(lambda: len(b.nodes()) == 1)
    link.mend()
    await until(lambda: len(b.nodes()) == 2)
    late: list[str] = []
    page.subscribe("/map", lambda message: late.append(message.data))
    await until(lambda: late == ["hall"])
    assert heard == ["hall"]


async def test_calls_that_are_open_when_the_link_is_cut_fail(
    wire: tuple[ZenohGraph, ZenohGraph, Wire],
) -> None:
    a, b, link = wire
    started = anyio.Event()

    async def never(_request: object) -> None:
        started.set()
        await anyio.sleep_forever()

    a.node("robot").advertise_service("/never", "std_srvs/Trigger", never)
    await until(lambda: b.service("/never") is not None)
    caller = b.node("page")
    async with anyio.create_task_group() as tasks:
        tasks.start_soon(link_cut_after, started, link)
        with pytest.raises(
            ProviderGone, match=r"^Service /never (was unadvertised|went away without an answer)$"
        ):
            await caller.call("/never")


async def link_cut_after(started: anyio.Event, link: Wire) -> None:
    """Cut the link once the call has arrived."""
    await started.wait()
    await link.cut()


async def test_kept_samples_come_again_to_who_subscribes_with_a_type_while_others_stay(
    wire: tuple[ZenohGraph, ZenohGraph, Wire],
) -> None:
    """With a type the topic outlives its publisher here, and Zenoh's subscriber with it."""
    a, b, link = wire
    a.node("robot").advertise("/map", "std_msgs/String", qos=LATCHED).publish({"data": "hall"})
    heard: list[str] = []
    page = b.node("page")
    page.subscribe("/map", lambda message: heard.append(message.data), "std_msgs/String")
    await until(lambda: heard == ["hall"])
    await link.cut()
    await until(lambda: len(b.nodes()) == 1)
    meanwhile: list[str] = []
    page.subscribe("/map", lambda message: meanwhile.append(message.data), "std_msgs/String")
    link.mend()
    await until(lambda: meanwhile == ["hall"])
    late: list[str] = []
    page.subscribe("/map", lambda message: late.append(message.data), "std_msgs/String")
    assert late == ["hall"]
    assert heard == ["hall"]
