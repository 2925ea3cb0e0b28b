"""Each verb against the demo robot: what people see, what programs get, and how it fails."""

from __future__ import annotations

import ast
import base64
import io
import math
import re
import shlex
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from rwt import Server
from rwt.cli import main, parser_for
from rwt.cli.commands.topic.echo import qos_from
from rwt.cli.console.output import Output
from rwt.cli.console.plot import Plot
from rwt.cli.console.yaml_text import read_yaml
from rwt_interfaces.distro import JAZZY
from rwt_interfaces.registry import Registry
from rwt_protocol.ops import Qos
from tests.core.cli.conftest import Rwt, demo_server, impatient

_ADD = "example_interfaces/srv/AddTwoInts"
_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
_TWIST = "geometry_msgs/msg/Twist"
_MARKER = "visualization_msgs/msg/InteractiveMarkerFeedback"


# -- topic -------------------------------------------------------------------------------------------------


def test_topic_list(rwt: Rwt) -> None:
    names = rwt("topic", "list").out.splitlines()
    assert {"/odom", "/scan", "/cmd_vel"} <= set(names)
    assert names == sorted(names)
    assert f"/cmd_vel [{_TWIST}]" in rwt("topic", "list", "-t").out.splitlines()
    assert {"name": "/cmd_vel", "type": _TWIST} in rwt("topic", "list", "--json").json


def test_topic_list_counts(rwt: Rwt) -> None:
    assert int(rwt("topic", "list", "-c").out) == rwt("topic", "list", "-c", "--json").json["count"] > 10


def test_topic_list_verbosely(rwt: Rwt) -> None:
    published, _, subscribed = rwt("topic", "list", "-v").out.partition("Subscribed topics:")
    assert " * /odom [nav_msgs/msg/Odometry] 1 publisher\n" in published
    assert f" * /cmd_vel [{_TWIST}] 1 subscriber\n" in subscribed
    (odom,) = (each for each in rwt("topic", "list", "-v", "--json").json if each["name"] == "/odom")
    assert (odom["publishers"], odom["subscribers"]) == (1, 0)


def test_topic_info(rwt: Rwt) -> None:
    assert rwt("topic", "info", "odom").out == (
        "Type: nav_msgs/msg/Odometry\nPublisher count: 1\nSubscription count: 0\n"
    )
    said = rwt("topic", "info", "/odom", "--verbose").out
    assert "Node name: demo_robot\nNode namespace: /\n" in said
    assert "Endpoint type: PUBLISHER" in said
    assert rwt("topic", "info", "/odom", "--json").json == {
        "name": "/odom",
        "type": "nav_msgs/msg/Odometry",
        "publishers": ["/demo_robot"],
        "subscribers": [],
    }


def test_topic_type_and_find(rwt: Rwt) -> None:
    assert rwt("topic", "type", "/scan").out == "sensor_msgs/msg/LaserScan\n"
    for spelling in ("sensor_msgs/msg/LaserScan", "sensor_msgs/LaserScan"):
        assert rwt("topic", "find", spelling).out == "/scan\n"
    assert rwt("topic", "find", "sensor_msgs/LaserScan", "--json").json == ["/scan"]
    assert rwt("topic", "find", "sensor_msgs/LaserScan", "-c").out == "1\n"


def test_echo_as_yaml(rwt: Rwt) -> None:
    text, end, rest = rwt("topic", "echo", "/odom", "--once").out.partition("---\n")
    message = read_yaml(text)
    assert isinstance(message, dict)
    assert list(message) == ["header", "child_frame_id", "pose", "twist"]
    assert (end, rest) == ("---\n", "")


def test_echo_as_json_lines(rwt: Rwt) -> None:
    first, second = rwt("topic", "echo", "/odom", "-n", "2", "--json").records
    assert first["header"]["frame_id"] == "odom"
    assert first["header"]["stamp"] != second["header"]["stamp"]


def test_echo_one_field(rwt: Rwt) -> None:
    assert rwt("topic", "echo", "odom", "--once", "--field", "header.frame_id").out == "odom\n---\n"
    assert rwt("topic", "echo", "odom", "--once", "--field", "pose.covariance[0]", "--json").json >= 0
    assert rwt("topic", "echo", "odom", "--once", "--field", "header.stamp.sec", "--json").json > 0
    assert rwt("topic", "echo", "/tf", "--once", "--field", "transforms[0].header.frame_id").out in (
        "odom\n---\n",
        "map\n---\n",
    )


def test_echo_on_one_line(rwt: Rwt) -> None:
    line, end = rwt("topic", "echo", "/odom", "--once", "--flow-style").out.splitlines()
    assert line.startswith("{header: {stamp: {sec: ")
    assert end == "---"


def test_echo_as_csv(rwt: Rwt) -> None:
    values = rwt("topic", "echo", "/odom", "--once", "--csv").out.strip().split(",")
    assert values[2:4] == ["odom", "base_link"]
    assert len(values) == 4 + 7 + 36 + 6 + 36


def test_echo_without_arrays_and_strings(rwt: Rwt) -> None:
    said = rwt("topic", "echo", "/scan", "--once", "--no-arr", "--no-str").out
    assert "ranges: '<sequence type: float32, length: 360>'" in said
    assert "frame_id: '<string length: <5>>'" in said
    fixed = rwt("topic", "echo", "/odom", "--once", "--no-arr").out
    assert "covariance: '<array type: float64[36]>'" in fixed


def test_long_arrays_are_cut(rwt: Rwt) -> None:
    said = rwt("topic", "echo", "/scan", "--once", "--field", "ranges").out
    assert said.count("\n- ") == 128
    assert said.endswith("- '...'\n---\n")
    assert rwt("topic", "echo", "/scan", "--once", "--field", "ranges", "-f").out.count("- ") == 360
    assert rwt("topic", "echo", "/scan", "--once", "--field", "ranges", "-l", "3").out.count("\n") == 5


def test_echo_only_what_a_filter_lets_through(rwt: Rwt) -> None:
    # Six that come 50 ms after each other do not all fall into the same tenths of a second.
    words = ("topic", "echo", "/odom", "-n", "6", "--json", "--field", "header.stamp.nanosec")
    records = rwt(*words, "--filter", "m.header.stamp.nanosec // 10**8 % 2 == 0").records
    assert [nanosec // 10**8 % 2 for nanosec in records] == [0] * 6


def test_echo_as_a_plot(rwt: Rwt) -> None:
    rwt("topic", "pub", "--once", "/cmd_vel", _TWIST, "{linear: {x: 0.3}}")
    last = rwt("topic", "echo", "/odom", "--plot", "-n", "3", "--field", "pose.pose").out.splitlines()
    assert {line.split()[0] for line in last if " … " in line} >= {"position.x", "orientation.w"}
    scan, _ = rwt("topic", "echo", "/scan", "--plot", "--once", "--field", "ranges").out.splitlines()
    assert scan.startswith("value  ") and len(set("▁▂▃▄▅▆▇█") & set(scan)) > 3


def test_a_plot_of_any_numbers() -> None:
    plot = Plot()
    for value in (0.0, math.nan, 1e308, -1e308, math.inf):
        (line,) = plot.lines({"a": {"b": value}, "header": {"stamp": 1}, "text": "x", "none": []})
    assert line.startswith("a.b  ▅?█▁?") and line.endswith("inf (-1e+308 … 1e+308)")
    assert Plot().lines("text") == []
    assert len(Plot().lines({f"{n}": n for n in range(100)})) == 20


def test_echo_undecoded(rwt: Rwt) -> None:
    (octets,) = rwt("topic", "echo", "/odom", "--raw", "--once", "--json").records
    odometry: Any = Registry(JAZZY).message("nav_msgs/Odometry").from_cdr(base64.b64decode(octets))
    assert odometry.child_frame_id == "base_link"
    text, end, _ = rwt("topic", "echo", "/odom", "--raw", "--once").out.partition("\n---\n")
    assert isinstance(ast.literal_eval(text), bytes)
    assert end
    silent, waited = impatient(rwt, "topic", "echo", "/silent", "std_msgs/msg/String", "--raw")
    assert (silent.code, silent.err) == (4, f"rwt: no message came on /silent within {waited}\n")


def test_qos_profiles_are_those_of_ros_2() -> None:
    def asked(*words: str) -> Qos | None:
        return qos_from(parser_for("topic").parse_args(["topic", "echo", "/a", *words]))

    assert asked() is None
    assert asked("--qos-profile", "sensor_data") == Qos(
        reliability="best_effort", durability="volatile", history="keep_last", depth=5
    )
    status = asked("--qos-profile", "action_status_default", "--qos-depth", "3")
    assert status == Qos(reliability="reliable", durability="transient_local", history="keep_last", depth=3)


def test_echo_that_hears_nothing_in_time(rwt: Rwt) -> None:
    ended, waited = impatient(rwt, "topic", "echo", "/nothing", "std_msgs/msg/String", "--once")
    assert (ended.code, ended.err) == (4, f"rwt: no message came on /nothing within {waited}\n")


def test_echo_of_which_nothing_passes_the_filter(rwt: Rwt) -> None:
    ended, waited = impatient(rwt, "topic", "echo", "/odom", "--once", "--filter", "False")
    assert (ended.code, ended.err) == (4, f"rwt: no message matched --filter on /odom within {waited}\n")


def test_pub_as_the_ros2_documentation_writes_it(rwt: Rwt) -> None:
    ended = rwt("topic", "pub", "--once", "/cmd_vel", _TWIST, "{linear: {x: 0.0}, angular: {z: 0.5}}")
    assert ended.code == 0
    assert ended.out.startswith("publisher: beginning loop\npublishing #1: geometry_msgs.msg.Twist(linear=")
    assert "z=0.5))" in ended.out


def test_pub_so_many_times(rwt: Rwt) -> None:
    ended = rwt("topic", "pub", "-t", "3", "-r", "50", "-p", "2", "/cmd_vel", "{}", "--json")
    assert [record["number"] for record in ended.records] == [2]
    assert ended.records[0]["message"]["linear"] == {"x": 0.0, "y": 0.0, "z": 0.0}


def test_pub_stamps_headers(rwt: Rwt) -> None:
    ended = rwt("topic", "pub", "-w", "0", "--once", "/h", "std_msgs/msg/Header", "stamp: now", "--json")
    assert ended.records[0]["message"]["stamp"]["sec"] > 1_000_000_000
    ended = rwt(
        "topic", "pub", "-w", "0", "--once", "/p", "geometry_msgs/PoseStamped", "header: auto", "--json"
    )
    assert ended.records[0]["message"]["header"]["stamp"]["sec"] > 1_000_000_000


def test_pub_reads_standard_input(rwt: Rwt, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("data: from a pipe\n"))
    ended = rwt("topic", "pub", "-w", "0", "--once", "/piped", "std_msgs/msg/String", "-")
    assert "std_msgs.msg.String(data='from a pipe')" in ended.out


def test_pub_that_nobody_hears(rwt: Rwt) -> None:
    ended, waited = impatient(rwt, "topic", "pub", "--once", "/alone", "std_msgs/msg/Empty")
    assert ended.code == 4
    assert "Waiting for at least 1 matching subscription(s)" in ended.err
    assert f"no subscription to /alone within {waited}; -w 0 publishes without waiting" in ended.err


def test_rates(rwt: Rwt) -> None:
    said = rwt("topic", "hz", "/odom", "-n", "1", "--interval", "0.4").out
    assert said.startswith("average rate: ")
    assert "\n\tmin: " in said
    (record,) = rwt("topic", "hz", "/odom", "-n", "1", "--interval", "0.4", "--json").records
    assert 5 < record["rate"] < 40


def test_bandwidth_of_several(rwt: Rwt) -> None:
    said = rwt("topic", "bw", "/odom", "/scan", "-n", "1", "--interval", "0.4").out
    assert said.startswith("topic: /odom\n")
    assert "topic: /scan\n" in said
    assert "\tMessage size mean: " in said
    (record,) = rwt("topic", "bw", "/odom", "-n", "1", "--interval", "0.5", "--json").records
    assert 500 < record["mean_bytes"] < 1000


def test_delay(rwt: Rwt) -> None:
    (record,) = rwt("topic", "delay", "/odom", "-n", "1", "--interval", "0.4", "--json").records
    assert -1 < record["delay"] < 5


def test_top(rwt: Rwt) -> None:
    head, columns, *rows = rwt("top", "/odom", "/map", "--interval", "0.5").out.splitlines()
    assert re.fullmatch(
        r"2 topics, [\d.]+ KB/s; \d+ nodes; \d+ clients, \d+% of a processor used for them", head
    )
    assert columns.split() == ["Hz", "a", "second", "topic", "type"]
    assert rows[0].split()[3:] == ["/odom", "nav_msgs/msg/Odometry"]
    assert rows[1].split() == ["0.0", "0", "B", "/map", "nav_msgs/msg/OccupancyGrid"]  # kept, not published
    assert "/demo_robot" in rows[2]
    first, second = rwt("top", "/odom", "--json", "-n", "2", "--interval", "0.5").records
    assert "/demo_robot" in first["nodes"]
    assert first["clients"] >= 1
    assert 0 <= first["work"] < 10
    assert second["topics"][0]["rate"] > 0


def test_rates_of_a_silent_topic(rwt: Rwt) -> None:
    ended = rwt("topic", "hz", "/cmd_vel", "-n", "1", "--interval", "0.1")
    assert ended.out == "no messages on /cmd_vel yet\n"
    (record,) = rwt("topic", "hz", "/cmd_vel", "-n", "1", "--interval", "0.1", "--json").records
    assert record == {"topic": "/cmd_vel", "messages": 0}


# -- service -----------------------------------------------------------------------------------------------


def test_service_list_type_find(rwt: Rwt) -> None:
    assert "/add_two_ints" in rwt("service", "list").out.splitlines()
    assert f"/add_two_ints [{_ADD}]" in rwt("service", "list", "-t").out.splitlines()
    assert {"name": "/add_two_ints", "type": _ADD} in rwt("service", "list", "--json").json
    assert rwt("service", "type", "add_two_ints").out == f"{_ADD}\n"
    assert rwt("service", "find", _ADD).out == "/add_two_ints\n"
    assert int(rwt("service", "list", "-c").out) > 20


def test_service_info(rwt: Rwt) -> None:
    said = rwt("service", "info", "/add_two_ints", "-v").out
    assert said.startswith(f"Type: {_ADD}\nClients count: ")
    assert said.endswith("Services count: 1\n    /demo_robot\n")
    assert rwt("service", "info", "/add_two_ints", "--json").json["servers"] == ["/demo_robot"]


def test_service_echo_says_who_would_have_to_publish(rwt: Rwt) -> None:
    ended, _ = impatient(rwt, "service", "echo", "/add_two_ints", "--once")
    assert ended.code == 4
    assert ended.err.startswith("rwt: /add_two_ints/_service_event has no publisher yet: ")


def test_service_call(rwt: Rwt) -> None:
    for words in ((_ADD, "{a: 1, b: 2}"), ("{a: 1, b: 2}",), ("a: 1\nb: 2",), ('{"a": 1, "b": 2}',)):
        assert rwt("service", "call", "/add_two_ints", *words).out == (
            "requester: making request: example_interfaces.srv.AddTwoInts_Request(a=1, b=2)\n\n"
            "response:\nexample_interfaces.srv.AddTwoInts_Response(sum=3)\n\n"
        )
    assert rwt("service", "call", "/add_two_ints", _ADD, "--json").json == {"sum": 0}


# -- action ------------------------------------------------------------------------------------------------


def test_action_list_type_info(rwt: Rwt) -> None:
    kind = "example_interfaces/action/Fibonacci"
    arm = "/arm_controller/follow_joint_trajectory"
    actions = (arm, "/fibonacci", "/navigate_to_pose", "/tf2_web_republisher")
    assert rwt("action", "list").out == "".join(f"{name}\n" for name in actions)
    assert f"/fibonacci [{kind}]" in rwt("action", "list", "-t").out
    assert rwt("action", "list", "-c", "--json").json == {"count": 4}
    assert rwt("action", "type", "/fibonacci").out == f"{kind}\n"
    assert rwt("action", "info", "/fibonacci").out == (
        f"Action: /fibonacci\nType: {kind}\nAction clients: 0\nAction servers: 1\n    /demo_robot\n"
    )
    info = rwt("action", "info", "/fibonacci", "--json").json
    assert info == {"name": "/fibonacci", "type": kind, "clients": [], "servers": ["/demo_robot"]}


def test_action_find(rwt: Rwt) -> None:
    assert rwt("action", "find", "example_interfaces/Fibonacci").out == "/fibonacci\n"
    assert rwt("action", "find", "example_interfaces/action/Fibonacci", "-c", "--json").json == {"count": 1}


def test_action_info_as_ros2_prints_it(rwt: Rwt) -> None:
    said = rwt("action", "info", "/fibonacci", "-t").out
    assert "Action clients: 0\nAction servers: 1\n" in said
    assert said.endswith("    /demo_robot [example_interfaces/action/Fibonacci]\n")
    assert rwt("action", "info", "/fibonacci", "-c").out.endswith("Action servers: 1\n")


def test_send_goal(rwt: Rwt) -> None:
    said = rwt("action", "send_goal", "/fibonacci", "example_interfaces/action/Fibonacci", "{order: 1}").out
    assert said == (
        "Sending goal:\n    order: 1\n\nResult:\n    sequence:\n    - 0\n    - 1\n\n"
        "Goal finished with status: SUCCEEDED\n"
    )


def test_send_goal_with_feedback(rwt: Rwt) -> None:
    records = rwt("action", "send_goal", "/fibonacci", "order: 2", "--feedback", "--json").records
    assert records == [
        {"feedback": {"sequence": [0, 1, 1]}},
        {"status": "SUCCEEDED", "result": {"sequence": [0, 1, 1]}},
    ]


def test_a_goal_that_takes_too_long_is_canceled(rwt: Rwt) -> None:
    ended, _ = impatient(rwt, "action", "send_goal", "/fibonacci", "{order: 40}", seconds=0.5)
    assert ended.code == 4
    assert "canceling the goal" in ended.err


# -- param -------------------------------------------------------------------------------------------------


def test_param_list(rwt: Rwt) -> None:
    assert "/demo_robot:\n  camera_rate\n  command_timeout\n" in rwt("param", "list").out
    assert rwt("param", "list", "/demo_robot").out.startswith("  camera_rate\n")
    assert "max_speed" in rwt("param", "list", "--json").json["/demo_robot"]


def test_param_get_and_set(rwt: Rwt) -> None:
    before = rwt("param", "get", "/demo_robot", "scan_noise", "--hide-type").out.strip()
    try:
        assert rwt("param", "set", "/demo_robot", "scan_noise", "0.25").out == "Set parameter successful\n"
        assert rwt("param", "get", "demo_robot", "scan_noise").out == "Double value is: 0.25\n"
        assert rwt("param", "get", "/demo_robot:scan_noise", "--json").json == {
            "name": "/demo_robot:scan_noise",
            "value": 0.25,
        }
    finally:
        assert rwt("param", "set", "/demo_robot:scan_noise", before).code == 0


def test_param_describe(rwt: Rwt) -> None:
    said = rwt("param", "describe", "/demo_robot", "max_speed", "use_sim_time")
    assert said.out.startswith(
        "Parameter name: max_speed\n  Type: double\n  Description: Fastest the robot drives"
    )
    assert "Parameter name: use_sim_time\n  Type: boolean\n" in said.out
    (described,) = rwt("param", "describe", "/demo_robot", "max_speed", "--json").json
    assert (described["name"], described["type"]) == ("max_speed", "double")


@pytest.mark.parametrize(
    ("descriptor", "said"),
    [
        ({"name": "n", "type": 2, "integer_range": [{"from_value": 0, "to_value": 9, "step": 3}]},
         "Type: integer\n  Constraints:\n    Min value: 0\n    Max value: 9\n    Step: 3\n"),
        ({"name": "x", "type": 3, "read_only": True, "additional_constraints": "even"},
         "Type: double\n  Read only: true\n  Constraints:\n    Additional constraints: even\n"),
        ({"name": "s", "type": 99}, "Type: unknown\n"),
    ],
)  # fmt: skip
def test_what_a_node_declares_of_a_parameter(rwt: Rwt, descriptor: dict[str, object], said: str) -> None:
    server, name = Server("ws://127.0.0.1:0"), str(descriptor["name"])
    server.node("far").parameters.declare(name, 1)
    server.node("lab").advertise_service(
        "/far/describe_parameters",
        "rcl_interfaces/srv/DescribeParameters",
        lambda _: {"descriptors": [descriptor]},
    )
    with server:
        printed = rwt("param", "describe", "/far", name, "--url", server.urls[0]).out
    assert printed == f"Parameter name: {name}\n  {said}"


def test_param_dump_and_load(rwt: Rwt, tmp_path: Path) -> None:
    file = tmp_path / "demo.yaml"
    assert rwt("param", "dump", "/demo_robot", "-o", str(file)).out == ""
    assert file.read_text() == rwt("param", "dump", "/demo_robot").out
    dumped = rwt("param", "dump", "/demo_robot", "--json").json["parameters"]
    file.write_text(file.read_text().replace("max_speed: 0.8", "max_speed: 0.3"))
    try:
        ended = rwt("param", "load", "/demo_robot", str(file))
        assert ended.code == 0, ended.err
        assert "Set parameter max_speed successful\n" in ended.out
        assert rwt("param", "get", "/demo_robot", "max_speed").out == "Double value is: 0.3\n"
    finally:
        rwt("param", "set", "/demo_robot", "max_speed", str(dumped["max_speed"]))


@pytest.mark.parametrize(
    ("text", "code", "expected"),
    [
        (
            "/demo_robot:\n  ros__parameters:\n    max_speed: fast\n",
            1,
            "1 of 1 parameters of /demo_robot were not set",
        ),
        ("/other:\n  ros__parameters:\n    a: 1\n", 2, "no parameters for /demo_robot; it has ['/other']"),
        ("/demo_robot:\n  a: 1\n", 2, "expected `ros__parameters:` below `/demo_robot:`"),
        ("[1]", 2, "expected `/demo_robot:`"),
        ("a: [", 2, "line 1, column 4"),
    ],
)
def test_param_file_that_cannot_be_loaded(
    rwt: Rwt, tmp_path: Path, text: str, code: int, expected: str
) -> None:
    file = tmp_path / "demo.yaml"
    file.write_text(text)
    ended = rwt("param", "load", "/demo_robot", str(file))
    assert ended.code == code
    assert expected in ended.err


def test_param_file_for_any_node_and_with_groups(rwt: Rwt, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "/**:\n  ros__parameters:\n    group:\n      no_such: 1\n"
    monkeypatch.setattr(sys, "stdin", io.StringIO(text))
    ended = rwt("param", "load", "/demo_robot", "-", "--json")
    assert (ended.code, ended.json["set"]) == (1, 0)
    assert ended.json["failed"][0].startswith("group.no_such: ")


# -- node --------------------------------------------------------------------------------------------------


def test_node_list_and_info(rwt: Rwt) -> None:
    assert {"/demo_robot", "/rosapi"} <= set(rwt("node", "list").out.splitlines())
    assert "/demo_robot" in rwt("node", "list", "--json").json
    said = rwt("node", "info", "demo_robot").out
    assert said.startswith(
        f"/demo_robot\n  Subscribers:\n    /arm_controller/joint_trajectory: {_TRAJECTORY}\n"
        f"    /cmd_vel: {_TWIST}\n"
        f"    /goal_marker/feedback: {_MARKER}\n\n  Publishers:\n"
    )
    assert f"  Service Servers:\n    /add_two_ints: {_ADD}\n" in said
    assert "    /fibonacci: example_interfaces/action/Fibonacci\n" in said.partition("  Action Servers:\n")[2]
    info = rwt("node", "info", "/demo_robot", "--json").json
    assert info["subscribers"] == [
        {"name": "/arm_controller/joint_trajectory", "type": _TRAJECTORY},
        {"name": "/cmd_vel", "type": _TWIST},
        {"name": "/goal_marker/feedback", "type": _MARKER},
    ]


# -- all ---------------------------------------------------------------------------------------------------


def test_ros_1(rwt: Rwt) -> None:
    with demo_server("--distro", "noetic") as url:
        there = ("--url", url)
        assert rwt("topic", "type", "/odom", *there).out == "nav_msgs/Odometry\n"
        assert rwt("param", "get", "/demo_robot/max_speed", *there).out == "Double value is: 0.8\n"
        assert rwt("param", "get", "/demo_robot", "max_speed", *there).out == "Double value is: 0.8\n"
        assert "max_speed" in rwt("param", "dump", "/demo_robot", "--json", *there).json["parameters"]
        assert rwt("service", "call", "/add_two_ints", "{a: 1, b: 2}", "--json", *there).json == {"sum": 3}
        goal = rwt("action", "send_goal", "/fibonacci", "{order: 0}", "--json", *there).records[-1]
        assert goal == {"status": "SUCCEEDED", "result": {"sequence": [0, 1]}}
        assert rwt("action", "info", "/fibonacci", "--json", *there).json["servers"] == ["/demo_robot"]
        assert "secs:" in rwt("topic", "echo", "/odom", "--once", *there).out


_FIELD = "topic echo /odom --once --field"
_PUB = "topic pub --once"


@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        *(
            (f"topic {verb} /odm", 1, "rwt: the robot knows no topic /odm; did you mean /odom?")
            for verb in ("type", "info", "echo --once", "hz", "bw", "delay")
        ),
        (f"{_FIELD} pose.pos", 2, "geometry_msgs/PoseWithCovariance has no field pos; did you mean pose?"),
        (f"{_FIELD} pose..x", 2, "expected names and indices"),
        (f"{_FIELD} child_frame_id.x", 2, "string has no fields"),
        (f"{_FIELD} child_frame_id[0]", 2, "string is not an array"),
        (f"{_FIELD} header.stamp.secs", 2, "did you mean sec?"),
        (f"{_FIELD} pose.covariance[40]", 1, "--field pose.covariance[40]: there are only 36 items in this"),
        ("topic echo /odom --filter 'm.pose >'", 2, "'m.pose >' is not a Python expression"),
        ("topic echo /odom --filter m.poses", 2, "--filter: AttributeError: "),
        ("topic echo /odom --plot --csv", 2, "not allowed with argument"),
        ("topic echo /odom --raw --field pose", 2, "--raw cannot be combined with --field"),
        ("topic echo /odom --fild x", 2, "rwt topic echo: unknown option '--fild'; did you mean --field?"),
        ("topic echo /odom --qos-history keep_lst", 2, "did you mean keep_last?"),
        ("topic echo", 2, "TOPIC"),
        ("topic echo /a -n none", 2, "expected a whole number from 1 to 999999999, got 'none'"),
        ("topic delay /chatter -n 1", 1, "std_msgs/msg/String has no header"),
        (f"{_PUB} /cmd_vel '{{liner: {{x: 1}}}}'", 2, 'has no field "liner"; it has linear, angular'),
        (f"{_PUB} /cmd_vel '{{linear: {{x: fast}}}}'", 2, 'linear.x: expected float64, got "fast"'),
        (f"{_PUB} /cmd_vel '{{linear: {{x: 1}}'", 2, "the message: line 1, column 1: { has no closing }"),
        (f"{_PUB} /cmd_vel {_TWIST} 3", 2, "expected fields"),
        (f"{_PUB} /cmd_vel {_TWIST} {{linear: 1}}", 2, "put the message in quotes"),
        (f"{_PUB} /new std_msgs/msg/Strin {{}}", 1, "did you mean std_msgs/String?"),
        (f"{_PUB} /new {{}}", 1, "the robot knows no topic /new"),
        (f"{_PUB} /cmd_vel std_msgs/msg/String {{}}", 1, "geometry_msgs"),
        ("topic pub /a -r 0", 2, "expected times a second from 1e-06 to 1e+06, got '0'"),
        ("topic lst", 2, "unknown command 'lst'; did you mean list?"),
        ("topic list --jsn=1", 2, "rwt topic list: unknown option '--jsn'; did you mean --json?"),
        ("topic list more", 2, "rwt topic list: unexpected argument 'more'"),
        ("topic list --url ws://127.0.0.1:1", 3, "127.0.0.1"),
        ("topic list --url tcp://127.0.0.1:1", 3, "127.0.0.1"),
        ("topic list --url nothing:x", 2, "nothing:x"),
        ("topic list --url ws://", 2, "ws://"),
        ("service info /add_two_int", 1, "did you mean /add_two_ints?"),
        ("service call /add_two_ints std_srvs/srv/Trigger {}", 1, "AddTwoInts, not std_srvs/Trigger"),
        (
            "service call /ad_two_ints '{a: 1}'",
            1,
            "no service /ad_two_ints; did you mean /add_two_ints?",
        ),
        ("service call /add_two_ints '{a: 1.5}'", 2, "1.5"),
        ("service call /rosapi/topic_type rosapi/srv/TopicType '{topic: [1]}'", 2, "expected string"),
        ("action send_goal /fibonacci tf2_msgs/action/LookupTransform {}", 1, "/fibonacci has type"),
        ("action send_goal /fibonaci '{order: 1}'", 1, "did you mean /fibonacci?"),
        ("param list /demo_robt", 1, "did you mean /demo_robot?"),
        ("param set /demo_robot max_speed fast", 1, "expected double, got string"),
        ("param get /demo_robot max_sped", 1, "did you mean /demo_robot:max_speed?"),
        ("param delete /demo_robot max_speed", 1, "max_speed"),
        (
            "param describe /demo_robot max_sped",
            1,
            "/demo_robot has no parameter max_sped; did you mean",
        ),
        ("param load /demo_robot /no/such/file", 2, "/no/such/file: cannot be read: No such file"),
        ("node info /demo_robo", 1, "did you mean /demo_robot?"),
        ("serve --dmo", 2, "rwt serve: unknown option '--dmo'; did you mean --demo?"),
        ("--verson topic list", 2, "rwt: unknown option '--verson'; did you mean --version?"),
        ("tpic", 2, "unknown command 'tpic'; did you mean topic?"),
        ("help tpic", 2, "unknown command 'tpic'; did you mean topic?"),
        ("play run.mcap", 2, "unknown command 'play'; did you mean `rwt bag play`?"),
        ("delay", 2, "unknown command 'delay'; did you mean `rwt topic delay`?"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_failure_is_one_line_with_its_exit_code(rwt: Rwt, line: str, code: int, said: str) -> None:
    ended = rwt(*shlex.split(line))
    assert (ended.code, said in ended.err, ended.err.count("\n")) == (code, True, 1), ended.err
    assert ended.err.count("did you mean") <= 1
    assert ended.out == ""


def test_a_token_is_shown_and_needed(rwt: Rwt, monkeypatch: pytest.MonkeyPatch) -> None:
    token = "0123456789abcdef0123"
    settings = ("--set", f"auth.tokens.me.token={token}", "--set", "auth.tokens.me.role=admin")
    with demo_server(*settings) as url:
        assert rwt("topic", "type", "/odom", "--url", url).code == 3
        assert rwt("topic", "type", "/odom", "--url", url, "--token", "x" * 20).code == 3
        assert rwt("topic", "type", "/odom", "--url", url, "--token", token).code == 0
        monkeypatch.setenv("RWT_TOKEN", token)
        assert rwt("topic", "type", "/odom", "--url", url).code == 0
        assert rwt("topic", "list", "--url", "tcp://127.0.0.1:1").code == 2
        assert rwt("topic", "list", "--token", "two words").code == 2


def test_a_robot_without_rosapi(rwt: Rwt) -> None:
    with demo_server("--set", "nodes=") as url:
        ended = rwt("topic", "list", "--url", url)
        assert (ended.code, "rosapi does not answer" in ended.err) == (1, True)


@pytest.mark.parametrize("words", [(), ("topic",), ("interface",), ("bag",), ("config",), ("completion",)])
def test_a_command_without_its_verb_prints_its_help(rwt: Rwt, words: tuple[str, ...]) -> None:
    bare, asked = rwt(*words), rwt(*words, "--help")
    assert (bare.code, bare.out, bare.err) == (0, asked.out, "")
    assert bare.out.startswith(" ".join(["usage: rwt", *words, "["]))
    assert rwt("help", *words).out == bare.out


def test_help_of_a_verb(rwt: Rwt) -> None:
    assert rwt("help", "topic", "echo").out == rwt("topic", "echo", "--help").out


def test_what_a_robot_is_called_is_no_command_to_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    stream = io.StringIO()
    people = Output(stream, people=True, colour=True, json=False)
    people.columns([("/a\x1b[2J", "b")], ("name", None))
    people.line(people.styled("/c\x07", "name"))
    assert stream.getvalue() == "\x1b[36m/a\ufffd[2J\x1b[0m  b\n\x1b[36m/c\ufffd\x1b[0m\n"
    assert people.escape_terminal("1,\x1b[2J") == "1,\ufffd[2J"
    plain = Output(stream, people=False, colour=False, json=False)
    assert plain.escape_terminal("1,\x1b[2J") == "1,\x1b[2J"
    assert plain.styled("/a", "name") == "/a"
    assert main(["topic", "echo", "/a", "--url", "no\x1b[2J\nurl"]) == 2
    errors = capsys.readouterr().err
    assert "\x1b" not in errors
    assert len(errors.splitlines()) == 1


def test_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert (ended.value.code, capsys.readouterr().out) == (0, f"rwt {version('robot-web-tools')}\n")
