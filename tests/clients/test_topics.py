"""Publishing and subscribing, as each client library does it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.clients.conftest import Program

pytestmark = pytest.mark.clients

#: The names of a time's halves in what a server of the distribution sends.
TIME_FIELDS = {"jazzy": ("sec", "nanosec"), "noetic": ("secs", "nsecs")}


def type_name(distro: str, two_part: str) -> str:
    return two_part.replace("/", "/msg/") if distro == "jazzy" else two_part


def vector(x: float = 0, y: float = 0, z: float = 0) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}


def test_a_message_reaches_the_other_client_as_it_was_sent(client: Program) -> None:
    observed = client.observe("publish_and_subscribe")
    assert observed == ["one", 'zwei "äöü" \\ /', "三 \N{ROBOT FACE} \0\n", ""]


def test_a_publisher_hears_itself(client: Program) -> None:
    assert client.observe("own_publication_comes_back") == ["mine"]


def test_types_may_have_three_parts(client: Program) -> None:
    assert client.observe("three_part_type") == ["modern"]


def test_a_relative_name_is_delivered_under_that_name(client: Program) -> None:
    assert client.observe("relative_name") == ["near"]


def test_a_subscription_may_leave_the_type_out(client: Program) -> None:
    assert client.observe("type_inferred") == ["known"]


def test_missing_fields_are_filled_in(client: Program) -> None:
    assert client.observe("partial_message") == {"linear": vector(x=1.5), "angular": vector()}


def test_values_arrive_in_their_wire_forms(client: Program) -> None:
    observed = client.observe("values")
    assert [each for each in observed if each[0] != "Float32"] == [
        ["Float64", 0.1],
        ["Float64", None],
        ["Float64", 3],
        ["Int64", 9007199254740991],
        ["Int64", -9007199254740991],
        ["Bool", True],
        ["UInt8MultiArray", "AQL/"],
        ["UInt8MultiArray", "AQL/"],
        ["UInt8MultiArray", ""],
        ["Int8MultiArray", [-1, 2]],
        ["Float64MultiArray", [1, None, 2.5]],
        ["ColorRGBA", {"r": 1, "g": 0, "b": 0, "a": 0}],
    ]


def test_a_float32_arrives_as_the_number_that_it_holds(client: Program) -> None:
    assert ["Float32", 0.10000000149011612] in client.observe("values")


def test_sixty_four_bit_integers_are_exact(roslibpy: Program) -> None:
    assert roslibpy.observe("exact_integers") == [2**63 - 1, -(2**63), 2**53 + 1, 2**64 - 1]


def test_a_header_without_stamp_gets_the_servers_time(client: Program, distro: str) -> None:
    observed = client.observe("header_is_stamped")
    seconds, nanoseconds = TIME_FIELDS[distro]
    sequence = {"seq"} if distro == "noetic" else set()
    header = observed["empty"]["header"]
    assert header.keys() == {"stamp", "frame_id"} | sequence
    assert header["frame_id"] == ""
    stamp = header["stamp"][seconds] + header["stamp"][nanoseconds] / 1e9
    assert stamp == pytest.approx(observed["now"], abs=5)
    given = observed["given"]["header"]
    assert given["stamp"] == {seconds: 12, nanoseconds: 34}
    assert given["frame_id"] == "map"
    assert observed["given"]["point"] == vector()


def test_the_librarys_own_header_is_understood(roslibpy: Program, distro: str) -> None:
    observed = roslibpy.observe(f"library_header {distro}")
    seconds, nanoseconds = TIME_FIELDS[distro]
    assert observed["header"]["stamp"] == {seconds: 12, nanoseconds: 34}
    assert observed["header"]["frame_id"] == "map"
    assert observed["point"] == vector(x=1)


def test_times_are_understood_in_either_spelling(client: Program, distro: str) -> None:
    seconds, nanoseconds = TIME_FIELDS[distro]
    observed = client.observe("time_in_either_spelling")
    assert observed == [{seconds: 1, nanoseconds: 2}, {seconds: 3, nanoseconds: 4}]


def test_messages_that_do_not_fit_the_type_are_dropped_whole(client: Program) -> None:
    assert client.observe("bad_messages_are_dropped") == ["first", "last"]


def test_a_publisher_of_another_type_changes_nothing(client: Program, distro: str) -> None:
    assert client.observe("type_conflict") == {
        "received": ["still text"],
        "type": {"values": type_name(distro, "std_msgs/String")},
    }


def test_a_burst_is_throttled(client: Program) -> None:
    observed = client.observe("throttled")
    assert [each["received"] for each in observed] == [["0"], ["0", "9"], ["0", "8", "9"]]
    # From before the burst to the last delivery, at one message each 300 ms.
    for each in observed:
        assert each["milliseconds"] >= 299 * (len(each["received"]) - 1)


def test_the_last_latched_message_reaches_late_subscribers_once(client: Program) -> None:
    assert client.observe("latched") == [["kept", "new"], ["kept", "new"]]


def test_two_subscriptions_of_one_client_are_one_delivery(roslib: Program) -> None:
    observed = roslib.observe("two_subscriptions")
    assert observed == {"unsubscribed": ["0", "1"], "kept": ["0", "1", "2", "3"]}


def test_nothing_comes_after_unsubscribing(client: Program) -> None:
    assert client.observe("unsubscribe") == {"left": ["one"], "stays": ["one", "two"]}


def test_many_messages_keep_their_order(client: Program) -> None:
    assert client.observe("many_in_order") == 500


def test_a_message_of_a_megabyte_passes(client: Program) -> None:
    assert client.observe("large_message") == {"length": 2**20, "same": True}


def test_a_message_is_not_held_back(roslib: Program) -> None:
    # A socket that waits to be acknowledged before it sends again holds each of these back for 40 ms.
    assert roslib.observe("delivery_time")[2] < 25


def test_subscriptions_and_advertisements_live_again_after_a_reconnect(client: Program) -> None:
    assert client.observe("reconnect") == ["before", "after"]


def test_setting_the_level_disturbs_nothing(client: Program) -> None:
    observed, complaints = client.answer("set_level")
    assert observed == ["none", "error", "warning", "info"]
    # At level info each success is told (STA-04). roslibpy asks for it, and has no handler for what it asked.
    assert all('No handler registered for operation "status"' in complaint for complaint in complaints)


def test_a_client_that_has_set_a_level_hears_what_was_refused(roslib1: Program) -> None:
    observed = roslib1.observe("status_after_set_level")
    assert observed["before"] == []
    [status] = observed["after"]
    assert status["event"] == observed["refused"]
    assert status["level"] == "error"
    assert "bogus" in status["text"]
    assert observed["silenced"] == []


def test_the_robot_publishes_all_that_it_promises(roslib: Program) -> None:
    observed = roslib.observe("robot_topics")
    grid = observed["/map"]
    assert len(grid["data"]) == grid["info"]["width"] * grid["info"]["height"] > 0
    scan = observed["/scan"]
    assert len(scan["ranges"]) > 10
    assert all(isinstance(distance, float | int) for distance in scan["ranges"] if distance is not None)
    assert observed["/odom"]["header"]["frame_id"] == "odom"
    assert len(observed["/odom"]["pose"]["covariance"]) == 36
    assert {"odom"} <= {each["header"]["frame_id"] for each in observed["/tf"]["transforms"]} | {"map"}
    assert observed["/tf_static"]["transforms"]
    assert 0 <= observed["/battery_state"]["percentage"] <= 1
    joints = observed["/joint_states"]
    assert len(joints["name"]) == len(joints["position"]) > 0
    assert observed["/diagnostics"]["status"][0]["name"]
    assert isinstance(observed["/chatter"]["data"], str)
    assert "<robot" in observed["/robot_description"]["data"]


def test_a_page_drives_the_robot_and_letting_go_stops_it(client: Program) -> None:
    observed = client.observe("drive")
    (x_before, y_before), (x_after, y_after) = observed["before"], observed["after"]
    # 0.3 m/s for the second of commands and the half second after it, less the time to gather speed.
    assert 0.2 < math.hypot(x_after - x_before, y_after - y_before) < 0.6
    assert observed["fastest"] == pytest.approx(0.3, abs=0.05)
    assert observed["speed"] == 0
