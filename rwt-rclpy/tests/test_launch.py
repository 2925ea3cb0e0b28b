"""Launch files: what is visited when, which processes run with which arguments, and how they are ended."""

from __future__ import annotations

import asyncio
import importlib
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rwt_rclpy.companions.ament_index_python import get_package_share_directory
from rwt_rclpy.launch import LaunchDescription, LaunchService
from rwt_rclpy.launch.actions import (
    AppendEnvironmentVariable,
    DeclareLaunchArgument,
    ExecuteProcess,
    GroupAction,
    IncludeLaunchDescription,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
    SetEnvironmentVariable,
    SetLaunchConfiguration,
    Shutdown,
    TimerAction,
)
from rwt_rclpy.launch.conditions import IfCondition, LaunchConfigurationEquals, UnlessCondition
from rwt_rclpy.launch.event_handlers import (
    OnExecutionComplete,
    OnProcessExit,
    OnProcessIO,
    OnProcessStart,
    OnShutdown,
)
from rwt_rclpy.launch.ros_actions import (
    Node,
    PushRosNamespace,
    SetParameter,
    SetParametersFromFile,
    SetRemap,
)
from rwt_rclpy.launch.ros_parameters import ParameterValue
from rwt_rclpy.launch.ros_substitutions import ExecutableInPackage, FindPackageShare
from rwt_rclpy.launch.sources import PythonLaunchDescriptionSource
from rwt_rclpy.launch.substitutions import (
    Command,
    EnvironmentVariable,
    EqualsSubstitution,
    FileContent,
    IfElseSubstitution,
    LaunchConfiguration,
    NotSubstitution,
    PathJoinSubstitution,
    PythonExpression,
    ThisLaunchFileDir,
)

#: How long anything may take, in seconds: only what hangs takes so long.
PATIENCE = 60.0


@pytest.fixture(autouse=True)
def environment(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Takes back what launch files set."""
    before = dict(os.environ)
    yield
    os.environ.clear()
    os.environ.update(before)


def run(*entities: Any, code: int = 0, **arguments: str) -> LaunchService:
    """Run entities to their end."""
    service = LaunchService(noninteractive=True)
    service.context.launch_configurations.update(arguments)
    service.include_launch_description(LaunchDescription(entities))

    async def within_time() -> int:
        async with asyncio.timeout(PATIENCE):
            return await service.run_async()

    assert asyncio.run(within_time()) == code
    return service


def says(*what: Any) -> LogInfo:
    return LogInfo(msg=list(what))


def shell(script: str, **options: Any) -> ExecuteProcess:
    return ExecuteProcess(cmd=["sh", "-c", script], name="sh", **options)


def told(capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Output of the launch file itself, and of its processes."""
    lines = capsys.readouterr().out.splitlines()
    return [re.sub(r"^\[(INFO\] \[launch.user\]: |sh-\d+\] )", "", each) for each in lines if _counts(each)]


def _counts(line: str) -> bool:
    return line.startswith(("[INFO] [launch.user]", "[sh-"))


def test_substitutions_are_performed_when_the_launch_gets_there(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "word").write_text("hello")
    speed = LaunchConfiguration("speed")
    run(
        DeclareLaunchArgument("speed", default_value="2"),
        DeclareLaunchArgument("mode", default_value="fast", choices=["fast", "slow"]),
        says(PythonExpression([speed, " * pi > 6 and ", speed, " == 2"])),
        says(PathJoinSubstitution(["a", ["b", speed], "c"])),
        says(EnvironmentVariable("NOT_THERE", default_value="none"), FileContent(tmp_path / "word")),
        says(Command("printf said-"), IfElseSubstitution(EqualsSubstitution(speed, "2.0"), "yes", "no")),
        SetLaunchConfiguration("speed", "3"),
        says(speed, NotSubstitution("false")),
        LogInfo(msg="no", condition=IfCondition("false")),
        LogInfo(msg="unless", condition=UnlessCondition("0")),
        LogInfo(msg="equal", condition=LaunchConfigurationEquals("mode", "fast")),
    )
    assert told(capsys) == ["True", "a/b2/c", "nonehello", "said-yes", "3true", "unless", "equal"]


def test_what_a_group_sets_ends_with_it(capsys: pytest.CaptureFixture[str]) -> None:
    show = says(LaunchConfiguration("x", default="-"), EnvironmentVariable("RWT_TEST_X", default_value="-"))
    run(
        GroupAction(
            [
                SetLaunchConfiguration("x", "1"),
                SetEnvironmentVariable("RWT_TEST_X", "a"),
                AppendEnvironmentVariable("RWT_TEST_X", "b"),
                GroupAction([SetLaunchConfiguration("x", "2")], scoped=False),
                show,
                GroupAction([show], forwarding=False, launch_configurations={"x": "only"}),
            ]
        ),
        show,
    )
    assert told(capsys) == [f"2a{os.pathsep}b", f"onlya{os.pathsep}b", "--"]


def test_events_come_one_after_another_and_the_launch_ends_when_nothing_runs(
    capsys: pytest.CaptureFixture[str],
) -> None:
    first, second = shell("echo first"), shell("echo second >&2; exit 3")
    seen: list[object] = []
    run(
        first,
        RegisterEventHandler(OnProcessStart(target_action=first, on_start=[says("runs")])),
        RegisterEventHandler(OnProcessExit(target_action=first, on_exit=[says("ended"), second])),
        RegisterEventHandler(
            OnProcessIO(target_action=second, on_stderr=lambda event: seen.append(event.text))
        ),
        RegisterEventHandler(
            OnProcessExit(
                target_action=second,
                on_exit=lambda event, context: seen.append((event.process_name, event.returncode)),
            )
        ),
        RegisterEventHandler(
            OnExecutionComplete(
                target_action=second,
                on_completion=[
                    TimerAction(period=0.01, actions=[says("timer")]),
                    TimerAction(period=3600.0, actions=[says("never")]),
                    TimerAction(period=0.02, actions=[Shutdown(reason="enough")]),
                ],
            )
        ),
        RegisterEventHandler(OnShutdown(on_shutdown=lambda event, context: seen.append(event.reason))),
    )
    assert told(capsys) == ["runs", "first", "ended", "second", "timer"]
    assert seen == [b"second\n", ("sh-2", 3), "enough"]


def test_a_process_is_started_again_and_one_that_is_required_ends_the_others() -> None:
    flaky = shell("exit 1", respawn=True, respawn_delay=0.0, respawn_max_retries=2)
    exits: list[int] = []
    other = shell("exec sleep 1000")
    run(
        other,
        RegisterEventHandler(OnProcessStart(target_action=other, on_start=[flaky])),
        RegisterEventHandler(
            OnProcessExit(target_action=flaky, on_exit=lambda event, context: exits.append(event.returncode))
        ),
        RegisterEventHandler(OnExecutionComplete(target_action=flaky, on_completion=[Shutdown()])),
    )
    assert exits == [1, 1, 1] and other.return_code == -signal.SIGINT


def test_what_does_not_end_is_ended_by_more_force(capsys: pytest.CaptureFixture[str]) -> None:
    deaf = shell("trap '' INT TERM; echo ready; while :; do sleep 0.05; done", sigkill_timeout="0.1")
    polite = shell("trap '' INT; trap 'exit 0' TERM; echo ready; while :; do sleep 0.05; done")
    ready: list[bytes] = []

    def count(event: Any) -> list[Shutdown] | None:
        ready.append(event.text)
        return [Shutdown()] if len(ready) == 2 else None

    run(
        SetLaunchConfiguration("sigterm_timeout", "0.1"),
        deaf,
        polite,
        RegisterEventHandler(OnProcessIO(on_stdout=count)),
    )
    output = capsys.readouterr().out
    assert deaf.return_code == -signal.SIGKILL and polite.return_code == 0
    assert "process[sh-1] failed to terminate '0.1' seconds after receiving 'SIGTERM'" in output
    assert "process[sh-2] failed to terminate '0.1' seconds after receiving 'SIGINT'" in output


def arguments_of(node: Node, *before: Any, capsys: pytest.CaptureFixture[str]) -> list[str]:
    run(*before, node)
    lines = capsys.readouterr().out.splitlines()
    return [each.partition("] ")[2] for each in lines if each.startswith("[show")]


@pytest.fixture
def show(tmp_path: Path) -> str:
    """Program that prints its arguments."""
    script = tmp_path / "show"
    script.write_text('#!/bin/sh\nfor each in "$@"; do echo "$each"; done\n')
    script.chmod(0o755)
    return str(script)


def test_a_node_is_started_with_what_it_and_its_groups_say(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, show: str
) -> None:
    file = tmp_path / "parameters.yaml"
    file.write_text("/**:\n  ros__parameters:\n    a: 1\n")
    node = Node(
        executable=show,
        exec_name="show",
        name="talker",
        namespace="arm",
        arguments=["--fast"],
        ros_arguments=["--log-level", "debug"],
        parameters=[
            {"gain": LaunchConfiguration("gain"), "text": "1", "pid": {"p": 0.5, "list": ["a", "b"]}},
            {"as_text": ParameterValue(LaunchConfiguration("gain"), value_type=str), "on": True},
            str(file),
        ],
        remappings=[("chatter", ["/", LaunchConfiguration("gain")])],
    )
    given = arguments_of(
        node,
        SetLaunchConfiguration("gain", "2"),
        PushRosNamespace("anna"),
        PushRosNamespace("left"),
        SetParameter("use_sim_time", True),
        SetParametersFromFile(str(file)),
        SetRemap("tf", "/tf"),
        capsys=capsys,
    )
    assert given == [
        "--fast", "--ros-args", "--log-level", "debug", "-r", "__node:=talker", "-r", "__ns:=/anna/left/arm",
        "-p", "use_sim_time:=true", "--params-file", str(file), "-p", "gain:=2", "-p", "text:='1'",
        "-p", "pid.p:=0.5", "-p", "pid.list:=[a, b]", "-p", "as_text:='2'", "-p", "on:=true",
        "--params-file", str(file), "-r", "tf:=/tf", "-r", "chatter:=/2",
    ]  # fmt: skip


def test_a_namespace_is_left_alone_where_nobody_gives_one(
    capsys: pytest.CaptureFixture[str], show: str
) -> None:
    assert arguments_of(Node(executable=show), capsys=capsys) == ["--ros-args"]
    absolute = Node(executable=show, namespace="/bob")
    assert arguments_of(absolute, PushRosNamespace("anna"), capsys=capsys)[-1] == "__ns:=/bob"


def _five(context: Any) -> Any:
    return 5


def _fails(context: Any) -> Any:
    return 1 // 0


@pytest.mark.parametrize(
    "entity, said",
    [
        (DeclareLaunchArgument("speed"), "launch argument 'speed' is required: give speed:=VALUE"),
        (DeclareLaunchArgument("m", default_value="c", choices=["a", "b"]), "must be one of a, b"),
        (says(LaunchConfiguration("absent")), "launch configuration 'absent' does not exist"),
        (says(PythonExpression("1 +")), "Python expression '1 +' fails: SyntaxError"),
        (LogInfo(msg="x", condition=IfCondition("perhaps")), "must be true, 1, false or 0, got 'perhaps'"),
        (Node(package="absent_package", executable="x"), "no package 'absent_package'"),
        (PushRosNamespace("not a name"), "InvalidNamespaceException"),
        (IncludeLaunchDescription("/absent.launch.py"), "/absent.launch.py: no such launch file"),
        (IncludeLaunchDescription(__file__ + ".xml"), "no such launch file"),
        (ExecuteProcess(cmd=["/absent/program"]), "/absent/program cannot be started"),
        (OpaqueFunction(_five), "expected actions or launch descriptions, got 5"),
        (OpaqueFunction(_fails), "ZeroDivisionError"),
    ],
)
def test_what_cannot_be_is_said_and_ends_the_launch(
    entity: Any, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    other = shell("exec sleep 1000")
    run(other, RegisterEventHandler(OnProcessStart(target_action=other, on_start=[entity])), code=1)
    assert said in capsys.readouterr().out
    assert other.return_code == -signal.SIGINT


def test_launch_files_in_xml_and_absent_modules_say_what_instead(tmp_path: Path) -> None:
    file = tmp_path / "robot.launch.xml"
    file.write_text("<launch/>")
    with pytest.raises(Exception, match="only launch files in Python are read here"):
        PythonLaunchDescriptionSource(str(file)).get_launch_description(LaunchService().context)
    code = "import rwt_rclpy; rwt_rclpy.install()\nfrom launch_ros.actions import ComposableNodeContainer"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "components are C++" in ended.stderr and "ImportError" in ended.stderr


PACKAGE = {
    "package.xml": "<package><name>pair</name></package>",
    "setup.py": 'from setuptools import setup\nsetup(name="pair", entry_points={"console_scripts":'
    ' ["talk = pair.nodes:talk", "listen = pair.nodes:listen"]})',
    "pair/__init__.py": "",
    "pair/nodes.py": """
import rclpy
from rclpy.qos import QoSProfile, DurabilityPolicy
from std_msgs.msg import String

def talk():
    rclpy.init()
    node = rclpy.create_node("talker")
    word = node.declare_parameter("word", "nothing").value
    publisher = node.create_publisher(String, "chatter", 10)
    node.create_timer(0.05, lambda: publisher.publish(String(data=word)))
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        print("interrupted", flush=True)

def listen():
    rclpy.init()
    node = rclpy.create_node("listener")
    heard = rclpy.task.Future()
    node.create_subscription(String, "words", lambda message: heard.set_result(message.data), 10)
    rclpy.spin_until_future_complete(node, heard)
    print("heard", heard.result(), "in", node.get_namespace(), flush=True)
""",
    "launch/pair.launch.py": """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, Shutdown
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

def generate_launch_description():
    talker = PathJoinSubstitution([FindPackageShare("pair"), "launch", "talker.launch.py"])
    return LaunchDescription([
        DeclareLaunchArgument("word", description="what is said"),
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(talker),
            launch_arguments={"what": LaunchConfiguration("word")}.items(),
        ),
        Node(package="pair", executable="listen", namespace="anna", on_exit=Shutdown()),
    ])
""",
    "launch/talker.launch.py": """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument("what", default_value="silence"),
        Node(
            package="pair", executable="talk", parameters=[{"word": LaunchConfiguration("what")}],
            remappings=[("chatter", "/anna/words")],
        ),
    ])
""",
    "launch/waits.launch.py": """
from launch import LaunchDescription
from launch.actions import ExecuteProcess

def generate_launch_description():
    script = "trap 'echo got INT; exit 0' INT; echo ready; while :; do sleep 0.05; done"
    return LaunchDescription([ExecuteProcess(cmd=["sh", "-c", script])])
""",
}


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    for name, content in PACKAGE.items():
        file = tmp_path / "src" / "pair" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(content)
    return tmp_path


def command(workspace: Path, *arguments: str) -> list[str]:
    return [sys.executable, "-m", "rwt.cli", "launch", "--root", str(workspace), *arguments]


def test_nodes_of_a_package_meet_in_one_graph(workspace: Path) -> None:
    ended = subprocess.run(
        command(workspace, "pair", "pair.launch.py", "word:=hello"),
        capture_output=True,
        text=True,
        check=False,
        timeout=2 * PATIENCE,
        stdin=subprocess.DEVNULL,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "[listen-2] heard hello in /anna" in ended.stdout
    assert "process[listen-2] was required" in ended.stdout
    assert "[talk-1] interrupted" in ended.stdout


def test_arguments_are_shown_and_wrong_ones_refused(
    workspace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from rwt.cli import main

    here = ["launch", "--root", str(workspace)]
    assert main([*here, "--show-args", "pair", "pair.launch.py"]) == 0
    assert "word (required): what is said" in capsys.readouterr().out
    for words, said in (
        (["pair", "absent.launch.py"], "its launch files are pair.launch.py, talker.launch.py"),
        (["absent", "x.launch.py"], "no folder of package 'absent'"),
        (["a", "b", "c"], "expected a launch file"),
        ([str(workspace / "absent.py")], "no such launch file"),
    ):
        assert main([*here, *words]) != 0
        assert said in capsys.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_what_was_started(workspace: Path, number: signal.Signals) -> None:
    with subprocess.Popen(
        command(workspace, "pair", "waits.launch.py"),
        stdout=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as process:
        too_long = threading.Timer(2 * PATIENCE, process.kill)
        too_long.start()
        try:
            assert process.stdout is not None
            said = ""
            while "ready" not in said:
                line = process.stdout.readline()
                assert line, said
                said += line
            process.send_signal(number)
            said += process.stdout.read()
            assert process.wait() == 0
        finally:
            too_long.cancel()
            process.kill()
    assert "[sh-1] got INT" in said and "process has finished cleanly" in said


def test_packages_are_found_below_the_root(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # As launch files write it: the module of that name is the one that finds packages.
    importlib.import_module("ament_index_python.packages")
    monkeypatch.setenv("RWT_RCLPY_ROOT", str(workspace))
    cmake = workspace / "src" / "tools"
    (cmake / "scripts").mkdir(parents=True)
    (cmake / "package.xml").write_text("<package><name>tools</name></package>")
    (cmake / "CMakeLists.txt").write_text("install(PROGRAMS\n  scripts/show\n  DESTINATION lib/tools)")
    (cmake / "scripts" / "show").write_text("#!/bin/sh\n")
    context = LaunchService().context
    share = str(workspace / "src" / "pair")
    assert FindPackageShare("pair").perform(context) == share == get_package_share_directory("pair")
    assert ExecutableInPackage("show", "tools").perform(context) == str(cmake / "scripts" / "show")
    with pytest.raises(Exception, match="is a console script"):
        ExecutableInPackage("talk", "pair").perform(context)
    with pytest.raises(Exception, match="has no executable 'x' in Python; it has show"):
        ExecutableInPackage("x", "tools").perform(context)
    assert ThisLaunchFileDir().describe() == "ThisLaunchFileDir"
