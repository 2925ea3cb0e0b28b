"""Programs in different processes and languages through one server, and servers and clients that go away."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.clients.conftest import Program, StartProgram, StartServer

pytestmark = pytest.mark.clients

PAIRS = [("roslib2", "roslibpy"), ("roslibpy", "roslib2"), ("roslib1", "roslibpy"), ("roslib2", "roslib1")]


@pytest.mark.usefixtures("distro")
@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_one_program_talks_and_another_listens(
    first: str, second: str, request: pytest.FixtureRequest
) -> None:
    talker: Program = request.getfixturevalue(first)
    listener: Program = request.getfixturevalue(second)
    talker.start(f"talk /{first}/{second}")
    assert listener.observe(f"listen /{first}/{second}") == ["grüße", "二", "3"]
    assert talker.finish() == ("said", [])


@pytest.mark.usefixtures("distro")
@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_one_program_serves_and_another_calls(
    first: str, second: str, request: pytest.FixtureRequest
) -> None:
    provider: Program = request.getfixturevalue(first)
    caller: Program = request.getfixturevalue(second)
    provider.start(f"serve /{first}/for_{second}")
    assert caller.observe(f"call_other /{first}/for_{second}") == {"values": {"sum": 11}}
    assert provider.finish() == ({"a": 5, "b": 6}, [])


@pytest.mark.parametrize("distro", ["jazzy"], indirect=True)
def test_an_action_of_one_program_runs_the_goals_of_another(roslib2: Program, roslibpy: Program) -> None:
    roslib2.start("act /together/counts")
    observed = roslibpy.observe("send_goals /together/counts")
    assert observed == {
        "succeeded": {"result": {"sequence": [0, 1, 7]}, "status": 4, "feedback": [[0], [0, 1]]},
        "aborted": {"result": {"sequence": []}, "status": 6, "feedback": [[0]]},
        "canceled": {"result": {"sequence": [0, 5]}, "status": 5, "feedback": [[0]]},
    }
    assert roslib2.finish() == (
        {"goals": [{"order": 7}, {"order": -1}, {"order": 100}], "cancels": 1},
        [],
    )


@pytest.mark.parametrize("distro", ["jazzy"], indirect=True)
def test_a_killed_provider_fails_the_pending_call(roslib2: Program, start_program: StartProgram) -> None:
    with start_program("roslibpy", roslib2.url) as provider:
        provider.start("serve_for_ever /together/stuck")
        roslib2.start("call_other /together/stuck")
        assert provider.printed() == "called"
        provider.kill()
        observed, complaints = roslib2.finish()
    assert complaints == []
    assert isinstance(observed["failed"], str)
    assert "Timeout" not in observed["failed"]


@pytest.mark.parametrize("library", ["roslib2", "roslib1"])
def test_a_server_that_ends_closes_its_clients_with_1001(
    library: str, start_server: StartServer, start_program: StartProgram
) -> None:
    with start_server("jazzy") as server, start_program(library, server.url) as program:
        program.start("server_goes_away")
        with start_program("roslibpy", server.url) as watcher:
            watcher.observe(f"hear_one /{library}/ready")
        assert server.end() == 0
        assert program.finish() == ({"code": 1001, "wasClean": True}, [])
