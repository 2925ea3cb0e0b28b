"""Services both ways, as each client library does it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.clients.conftest import Program

pytestmark = pytest.mark.clients

UNKNOWN = {"failed": "Service /no_such_service does not exist"}
ADD_TYPE = {"jazzy": "example_interfaces/srv/AddTwoInts", "noetic": "example_interfaces/AddTwoInts"}


def total(number: int) -> dict[str, dict[str, int]]:
    return {"values": {"sum": number}}


def test_a_call_is_answered(client: Program) -> None:
    observed = client.observe("call")
    # The arguments by position are a list, which roslibpy cannot send.
    assert observed.pop("positional", total(42)) == total(42)
    assert observed == {"named": total(3), "partial": total(4), "empty": total(0), "relative": total(-3)}


def test_a_call_of_an_unknown_service_fails(client: Program) -> None:
    assert client.observe("call_unknown") == UNKNOWN


def test_a_call_with_bad_arguments_fails_and_says_which(client: Program) -> None:
    observed = client.observe("call_bad_arguments")
    assert "bogus" in observed["unknown_field"]["failed"]
    assert "one" in observed["wrong_type"]["failed"]
    assert observed["afterwards"] == total(1)


def test_a_client_provides_a_service(client: Program, distro: str) -> None:
    assert client.observe("provide_success") == {
        "answer": total(42),
        "defaults": total(0),
        "type": {"values": ADD_TYPE[distro]},
    }


def test_a_provider_that_refuses_fails_the_call(client: Program) -> None:
    observed = client.observe("provide_failure")
    assert isinstance(observed["failed"], str)


def test_an_answer_of_the_wrong_type_fails_the_call(client: Program) -> None:
    observed = client.observe("provide_bad_answer")
    assert "sum" in observed["failed"]


def test_a_client_calls_its_own_service(client: Program) -> None:
    assert client.observe("provide_on_own_connection") == total(7)


def test_an_unadvertised_service_is_gone(client: Program) -> None:
    observed = client.observe("provider_unadvertises")
    assert observed == {"failed": f"Service /{client.name}/leaves does not exist"}


def test_a_provider_that_disconnects_fails_the_call(roslib: Program) -> None:
    observed = roslib.observe("provider_disconnects")
    assert isinstance(observed["during"]["failed"], str)
    assert observed["during"]["failed"]
    assert observed["afterwards"] == {"failed": f"Service /{roslib.name}/dies does not exist"}


def test_an_exception_in_a_handler_fails_the_call(roslib2: Program) -> None:
    observed = roslib2.observe("provide_exception")
    assert isinstance(observed["failed"], str)


@pytest.mark.parametrize("distro", ["jazzy"], indirect=True)
def test_a_provider_that_stays_silent_fails_the_call_in_time(roslibpy: Program) -> None:
    observed, complaints = roslibpy.answer("provide_exception")
    assert observed == {"failed": "Timeout exceeded while waiting for service response"}
    # The library logs what its handler raised, and sends nothing.
    [complaint] = complaints
    assert "RuntimeError('no power')" in complaint


def test_a_handler_may_be_asynchronous(roslib2: Program) -> None:
    assert roslib2.observe("provide_async") == total(7)


def test_the_reason_of_a_rejection_reaches_the_caller(roslib2: Program) -> None:
    observed = roslib2.observe("provide_async_rejects")
    assert "Error: no power" in observed["failed"]


def test_answers_may_come_in_any_order(roslib2: Program) -> None:
    assert roslib2.observe("provide_in_any_order") == [total(10 * number) for number in range(10)]


def test_the_callers_time_out_holds(roslib2: Program) -> None:
    observed = roslib2.observe("call_times_out")
    assert observed["answer"] == {"failed": "Timeout exceeded while waiting for service response"}
    assert observed["seconds"] >= 0.25
