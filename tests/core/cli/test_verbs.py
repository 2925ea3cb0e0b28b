"""Each verb against the demo robot: what people see, what programs get, and how it fails."""

from __future__ import annotations

import ast
import base64
import io
import math
import re
import shlex
import sys
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
from tests.core.cli.conftest import Rwt, check_transcript, demo_server, impatient, transcript

_ADD = "example_interfaces/srv/AddTwoInts"
_TWIST = "geometry_msgs/msg/Twist"


@transcript("robot.txt")
def test_a_command_prints_what_the_transcript_says(rwt: Rwt, line: str, printed: str) -> None:
    check_transcript(rwt, line, printed)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("topic echo /nothing std_msgs/msg/String --once", "rwt: no message came on /nothing within {}\n"),
        ("topic echo /nothing std_msgs/msg/String --raw", "rwt: no message came on /nothing within {}\n"),
        ("topic echo /odom --filter False", "rwt: no message matched --filter on /odom within {}\n"),
        ("topic pub --once /alone std_msgs/msg/Empty", "Waiting for at least 1 matching subscription(s)"),
        ("topic pub --once /alone std_msgs/msg/Empty", "to /alone within {}; -w 0 publishes without waiting"),
        ("service echo /add_two_ints --once", "rwt: /add_two_ints/_service_event has no publisher yet: "),
        ("action send_goal /fibonacci '{{order: 40}}'", "canceling the goal"),
        ("tf echo map ghost --once",
         'rwt: the transform was not available within {}: frame "ghost" is not known; known are arm_'),
    ],
)  # fmt: skip
def test_what_does_not_come_in_time(rwt: Rwt, line: str, said: str) -> None:
    ended, waited = impatient(rwt, *shlex.split(line.format()), seconds=0.5)
    assert (ended.code, said.format(waited) in ended.err) == (4, True), ended.err


# -- topic -------------------------------------------------------------------------------------------------


def test_topic_list_counts(rwt: Rwt) -> None:
    assert int(rwt("topic", "list", "-c").out) == rwt("topic", "list", "-c", "--json").json["count"] > 10


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


def test_echo_as_csv(rwt: Rwt) -> None:
    values = rwt("topic", "echo", "/odom", "--once", "--csv").out.strip().split(",")
    assert values[2:4] == ["odom", "base_link"]
    assert len(values) == 4 + 7 + 36 + 6 + 36


def test_long_arrays_are_cut(rwt: Rwt) -> None:
    said = rwt("topic", "echo", "/scan", "--once", "--field", "ranges").out
    assert said.count("\n- ") == 128
    assert said.endswith("- '...'\n---\n")
    assert rwt("topic", "echo", "/scan", "--once", "--field", "ranges", "-f").out.count("- ") == 360
    assert rwt("topic", "echo", "/scan", "--once", "--field", "ranges", "-l", "3").out.count("\n") == 5
    assert "..." not in rwt("topic", "echo", "/scan", "--once", "--field", "ranges", "-l", "360").out


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


def test_qos_profiles_are_those_of_ros_2() -> None:
    def asked(*words: str) -> Qos | None:
        return qos_from(parser_for("topic").parse_args(["topic", "echo", "/a", *words]))

    assert asked() is None
    assert asked("--qos-profile", "sensor_data") == Qos(
        reliability="best_effort", durability="volatile", history="keep_last", depth=5
    )
    status = asked("--qos-profile", "action_status_default", "--qos-depth", "3")
    assert status == Qos(reliability="reliable", durability="transient_local", history="keep_last", depth=3)


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


@pytest.mark.parametrize(
    ("verb", "figure", "least", "most"),
    [("hz", "rate", 5, 40), ("bw", "mean_bytes", 500, 1000), ("delay", "delay", -1, 5)],
)
def test_a_measurement_is_plausible(rwt: Rwt, verb: str, figure: str, least: float, most: float) -> None:
    (record,) = rwt("topic", verb, "/odom", "-n", "1", "--interval", "0.5", "--json").records
    assert record["topic"] == "/odom" and least < record[figure] < most


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


# -- param -------------------------------------------------------------------------------------------------


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


@pytest.mark.parametrize(
    ("kind", "plumbing"),
    [
        ("topic", "/tf2_web_republisher/goal"),
        ("service", "/demo_robot/set_parameters"),
        ("service", "/demo_robot/get_parameter_types"),
        ("service", "/tf2_web_republisher/list_parameters"),
    ],
)
def test_plumbing_is_listed_on_request(rwt: Rwt, kind: str, plumbing: str) -> None:
    shown = rwt(kind, "list").out.splitlines()
    everything = rwt(kind, "list", f"--include-hidden-{kind}s").out.splitlines()
    assert plumbing in everything
    assert plumbing not in shown
    assert set(shown) < set(everything)
    assert rwt(kind, "type", plumbing).code == 0
