"""Services: calling and offering."""

from __future__ import annotations

from typing import Any

import anyio
import anyio.lowlevel
import pytest

from rwt_client import ConnectionLost, NotConnected
from rwt_participant.errors import (
    CallFailed,
    InvalidMessage,
    ServiceFailed,
    TimedOut,
    WrongType,
)
from tests.core.client.worlds import scripted, world

pytestmark = pytest.mark.anyio

ADD = "example_interfaces/AddTwoInts"


async def test_a_call_is_answered(transport: str) -> None:
    async with world(transport) as it:
        it.node.advertise_service("/add", ADD, lambda request: {"sum": request.a + request.b})
        response = await it.robot.call("/add", {"a": 1, "b": 2})
        assert response.sum == 3
        by_class = it.robot.types["example_interfaces/AddTwoInts_Request"](a=3, b=4)
        assert (await it.robot.call("/add", by_class, ADD)).sum == 7


async def test_a_type_that_the_service_does_not_have() -> None:
    async with world() as it:
        it.node.advertise_service("/add", ADD, lambda request: {"sum": 1})
        for _ in range(2):
            with pytest.raises(WrongType, match=r"^/add has type example_interfaces/AddTwoInts, not std"):
                await it.robot.call("/add", {}, "std_srvs/Trigger")
        assert (await it.robot.call("/add", {}, "rospy_tutorials/AddTwoInts")).sum == 1, "the same fields"
        with pytest.raises(WrongType):
            await it.node.call("/add", {}, "std_srvs/Trigger")


async def test_a_service_is_listed_with_the_type_that_the_robot_reports() -> None:
    async with world() as it:
        it.node.advertise_service("/add", ADD, lambda request: {"sum": 1})
        await it.robot.call("/add", {}, "rospy_tutorials/AddTwoInts")
        listed = {each.name: each.type for each in await it.robot.services()}
        assert listed["/add"] == "example_interfaces/srv/AddTwoInts"


async def test_the_type_of_a_service_that_is_offered_anew() -> None:
    async with world() as it:
        first = it.node.advertise_service("/s", ADD, lambda request: {"sum": 1})
        await it.robot.call("/s", {}, ADD)
        first.close()
        it.node.advertise_service("/s", "std_srvs/Trigger", lambda request: {"success": True})
        assert (await it.robot.call("/s", {}, "std_srvs/Trigger")).success


async def test_an_answer_that_does_not_fit_is_told() -> None:
    async with scripted() as (server, robot):
        server.answers["/add"] = {"sum": "three"}
        with pytest.raises(InvalidMessage, match="sum: expected int64"):
            await robot.call("/add", {}, ADD)


async def test_without_a_connection_a_call_fails_at_once_and_one_under_way_with_it() -> None:
    async with scripted(reconnect=None) as (server, robot):
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(_expect_loss, robot)
            await server.hears("call_service")
            server.hang_up(reason="the cable was pulled")
        with pytest.raises(ConnectionLost):
            await robot.call("/add", {}, ADD)


async def _expect_loss(robot: Any) -> None:
    with pytest.raises(ConnectionLost, match=r"lost: the cable was pulled, before /add answered"):
        await robot.call("/add", {}, ADD)


class TestInVirtualTime:
    @pytest.fixture
    def anyio_backend(self, virtual_time: object) -> object:
        return virtual_time

    async def test_a_call_without_an_answer_ends_in_time(self) -> None:
        async with scripted(timeout=7.0) as (server, robot):
            before = anyio.current_time()
            with pytest.raises(TimedOut, match=r"^/add gave no answer within 7 s$"):
                await robot.call("/add", {}, ADD)
            assert anyio.current_time() - before == pytest.approx(7.0)
            with pytest.raises(TimedOut, match=r"within 0.5 s"):
                await robot.call("/add", {}, ADD, timeout=0.5)
            # The answer that comes too late hurts nobody.
            late = server.ops("call_service")[0]
            server.say({"op": "service_response", "service": "/add", "values": {"sum": 1}, "id": late["id"]})
            server.answers["/add"] = {"sum": 2}
            assert (await robot.call("/add", {}, ADD)).sum == 2

    async def test_a_call_may_wait_for_a_connection(self) -> None:
        async with scripted() as (server, robot):
            server.hang_up()
            with pytest.raises(NotConnected):
                while True:
                    await robot.call("/add", {}, ADD, timeout=0.001) if not robot.connected else None
                    await anyio.lowlevel.checkpoint()
            server.answers["/add"] = {"sum": 5}
            assert (await robot.call("/add", {}, ADD, repeat=True)).sum == 5


# -- offering ------------------------------------------------------------------------------------------------


async def test_a_coroutine_may_answer_and_calls_run_side_by_side() -> None:
    async with world() as it:
        both = 0

        async def meet(request: Any) -> dict[str, object]:
            nonlocal both
            both += 1
            while both < 2:
                await anyio.lowlevel.checkpoint()
            return {"success": True}

        await it.robot.advertise_service("/meet", "std_srvs/Trigger", meet)
        await it.arrives(lambda: it.graph.service("/meet"))
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(it.node.call, "/meet")
            tasks.start_soon(it.node.call, "/meet")
        assert both == 2


def _fails(request: Any) -> None:
    raise ServiceFailed("the battery is empty")


def _crashes(request: Any) -> None:
    raise ZeroDivisionError("secret detail")


def _misfits(request: Any) -> dict[str, object]:
    return {"succes": True}


@pytest.mark.parametrize(
    ("handler", "reason"),
    [
        (_fails, "^the battery is empty$"),
        (_crashes, "^the service's handler failed; its program's log says why$"),
        (_misfits, "Trigger_Response has no field .succes."),
    ],
)
async def test_the_caller_is_told_why_there_is_no_answer(handler: Any, reason: str) -> None:
    async with world() as it:
        await it.robot.advertise_service("/beep", "std_srvs/Trigger", handler)
        await it.arrives(lambda: it.graph.service("/beep"))
        with pytest.raises(CallFailed, match=reason):
            await it.node.call("/beep")


async def test_arguments_by_position_are_understood() -> None:
    async with scripted() as (server, robot):
        await robot.advertise_service("/add", ADD, lambda request: {"sum": request.a + request.b})
        await server.hears("advertise_service")
        server.say({"op": "call_service", "service": "/add", "id": "c1", "args": [1, 2]})
        answer = await server.hears("service_response")
        assert (answer["values"], answer["result"]) == ({"sum": 3}, True)
        server.say({"op": "call_service", "service": "/add", "id": "c2", "args": {"a": "x"}})
        answer = await server.hears("service_response", 2)
        assert (answer["values"], answer["result"]) == ('a: expected int64, got "x"', False)


async def test_an_offer_takes_the_place_of_another_of_that_name() -> None:
    async with scripted() as (server, robot):
        await robot.advertise_service("/beep", "std_srvs/Trigger", lambda request: {"message": "old"})
        await robot.advertise_service("/beep", "std_srvs/Trigger", lambda request: {"message": "new"})
        await server.hears("advertise_service", 2)
        server.say({"op": "call_service", "service": "/beep", "id": "c1"})
        assert (await server.hears("service_response"))["values"]["message"] == "new"
