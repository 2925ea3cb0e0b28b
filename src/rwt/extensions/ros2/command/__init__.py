"""`rwt ros2`: in place of rosbridge_suite, with its parameters, in `ros2 run` and `ros2 launch`."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import yaml

from rwt.cli.errors import CommandError

_EXAMPLES: Final = """\
examples:
  rwt ros2 install ~/rwt_ros2                     the ament package `rwt`, in a folder of yours
  export AMENT_PREFIX_PATH=~/rwt_ros2:$AMENT_PREFIX_PATH
  ros2 launch rwt rwt_launch.py port:=9091
  rwt ros2 serve --ros-args -r /cmd_vel:=/input/cmd_vel -r __ns:=/robot1
  rwt ros2 serve --ros-args -p port:=9091 -p topics_glob:="['/odom', '/scan']"
"""

#: Parameters of rosbridge_websocket and rosapi that are settings here.
_SETTINGS: Final = {
    "max_message_size": "max_message_size",
    "unregister_timeout": "unregister_timeout",
    "default_call_service_timeout": "default_call_service_timeout",
    "bson_only_mode": "bson_only_mode",
    "fragment_timeout": "limits.fragment_seconds",
    "websocket_ping_interval": "limits.ping_seconds",
    "websocket_ping_timeout": "limits.pong_seconds",
    "certfile": "tls.certfile",
    "keyfile": "tls.keyfile",
    "use_sim_time": "ros2.use_sim_time",
}

#: Parameters without an effect, each with the reason.
_NO_EFFECT: Final = {
    "retry_startup_delay": "the server ends if the port is in use; let launch respawn it",
    "delay_between_messages": "messages are sent as fast as each client reads them",
    "call_services_in_new_thread": "calls never block the server",
    "send_action_goals_in_new_thread": "goals never block the server",
    "websocket_external_port": "clients use the port that they connect to",
    "params_timeout": "nodes are given five seconds to answer about their parameters",
}

#: Parameters that limit names, each with the permissions of a role that they limit.
_GLOBS: Final = {
    "topics_glob": ("publish", "subscribe"),
    "services_glob": ("call", "provide"),
    "actions_glob": ("goals",),
    "params_glob": ("get_param", "set_param"),
}

#: Parameters with a rule of their own.
_ADDRESS: Final = {"port": "9090", "address": "", "url_path": "/", "ssl": "", "use_compression": ""}

_SERVE: Final = """\
#!/bin/sh
exec {python} -m rwt.cli ros2 serve "$@"
"""

_PACKAGE: Final = """\
<?xml version="1.0"?>
<package format="3">
  <name>rwt</name>
  <version>0.1.0</version>
  <description>Server of the rosbridge protocol, in place of rosbridge_suite</description>
  <maintainer email="rwt@localhost">rwt</maintainer>
  <license>see the Python package</license>
</package>
"""

_LAUNCH: Final = '''\
"""The server, with the parameters of rosbridge_websocket_launch.xml."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration

PARAMETERS = {parameters}


def generate_launch_description():
    arguments = [DeclareLaunchArgument(name, default_value="") for name in PARAMETERS]
    command = [{serve!r}, "--ros-args"]
    for name in PARAMETERS:
        command += ["-p", [name + ":=", LaunchConfiguration(name)]]
    return LaunchDescription([*arguments, ExecuteProcess(cmd=command, output="screen")])
'''


def add_ros2_command(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `ros2` to the command line."""
    parser = commands.add_parser("ros2", description=__doc__, epilog=_EXAMPLES)
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    install = verbs.add_parser("install", help="write the ament package `rwt`, for ros2 run and ros2 launch")
    install.add_argument("folder", type=Path, metavar="DIR", help="folder to add to AMENT_PREFIX_PATH")
    install.set_defaults(run=_install)
    serve = verbs.add_parser("serve", help="rwt serve --graph ros2, with the parameters of rosbridge_suite")
    serve.add_argument("--ros-args", action="store_true", help="as ros2 run writes it; has no effect")
    serve.add_argument(
        "-p", "--param", action="append", default=[], metavar="NAME:=VALUE", help="set a parameter"
    )
    serve.add_argument(
        "--params-file", action="append", default=[], type=Path, metavar="FILE", help="parameters as YAML"
    )
    serve.add_argument(
        "-r",
        "--remap",
        action="append",
        default=[],
        metavar="OLD:=NEW",
        help="remap a name, __ns or __node",
    )
    serve.set_defaults(run=_serve)


def _install(arguments: argparse.Namespace) -> int:
    folder = arguments.folder.absolute()
    serve = folder / "lib/rwt/serve"
    files = {
        folder / "share/ament_index/resource_index/packages/rwt": "",
        folder / "share/rwt/package.xml": _PACKAGE,
        folder / "share/rwt/launch/rwt_launch.py": _LAUNCH.format(
            parameters=[*_ADDRESS, *_SETTINGS, *_GLOBS, *_NO_EFFECT], serve=str(serve)
        ),
        serve: _SERVE.format(python=shlex.quote(sys.executable)),
    }
    try:
        for path, text in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        serve.chmod(0o755)
    except OSError as error:
        raise CommandError(f"{folder}: cannot be written: {error}") from error
    print(f"export AMENT_PREFIX_PATH={shlex.quote(str(folder))}:$AMENT_PREFIX_PATH")
    return 0


def _serve(arguments: argparse.Namespace) -> int:
    from rwt.cli import main  # The command line knows this module.

    options, warnings = serve_options(_parameters(arguments))
    if arguments.remap:
        options += ["--set", f"ros2.remap={json.dumps([_of_gateway(rule) for rule in arguments.remap])}"]
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)
    return main(["serve", "--graph", "ros2", *options])


def _of_gateway(rule: str) -> str:
    """Return a rule; `__node` without a node renames the node of rosbridge_suite."""
    return f"rosbridge_websocket:{rule}" if rule.startswith(("__node:=", "__name:=")) else rule


def _parameters(arguments: argparse.Namespace) -> dict[str, str]:
    parameters: dict[str, str] = {}
    for path in arguments.params_file:
        parameters |= _read_file(path)
    for written in arguments.param:
        name, separator, text = written.partition(":=")
        if not separator:
            raise CommandError(f"-p {written}: expected NAME:=VALUE", exit_code=2)
        parameters[name] = text
    return parameters


def _read_file(path: Path) -> dict[str, str]:
    try:
        nodes = yaml.safe_load(path.read_text(encoding="utf-8"))
        given = [values for node in nodes.values() for values in node["ros__parameters"].items()]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, AttributeError, KeyError, TypeError) as error:
        raise CommandError(f"{path}: not a file of parameters of ROS 2: {error}", exit_code=2) from error
    return {name: str(value) for name, value in given}


def serve_options(parameters: Mapping[str, str]) -> tuple[list[str], list[str]]:
    """Return the options of `rwt serve` for parameters of rosbridge_suite, and warnings.

    Raises:
        CommandError: a parameter is unknown, or a list of globs is invalid.
    """
    given = {name: text for name, text in parameters.items() if text.strip("'\"")}
    known = _ADDRESS.keys() | _SETTINGS.keys() | _GLOBS.keys() | _NO_EFFECT.keys()
    unknown = sorted(given.keys() - known)
    if unknown:
        raise CommandError(
            f"parameter {unknown[0]} is not one of rosbridge_suite's: {', '.join(sorted(known))}", exit_code=2
        )
    is_tls = "certfile" in given or _is_true(given.get("ssl", ""))
    port, path = given.get("port", _ADDRESS["port"]), given.get("url_path", "/").strip("/")
    options = [f"{'wss' if is_tls else 'ws'}://{given.get('address', '0.0.0.0')}:{port}/{path}".rstrip("/")]
    settings = {setting: given[name] for name, setting in _SETTINGS.items() if name in given}
    if _is_true(given.get("use_compression", "")):
        settings["deflate"] = "shared"
    settings |= _role(given)
    for name, value in settings.items():
        options += ["--set", f"{name}={value}"]
    return options, [f"{name} has no effect: {why}" for name, why in _NO_EFFECT.items() if name in given]


def _is_true(text: str) -> bool:
    return text.lower() in ("true", "1")


def _role(given: Mapping[str, str]) -> dict[str, str]:
    """Return the settings of a role that everybody has, if a parameter limits names."""
    if not _GLOBS.keys() & given.keys():
        return {}
    settings = {"auth.default_role": "rosbridge"}
    for parameter, permissions in _GLOBS.items():
        globs = _globs(parameter, given[parameter]) if parameter in given else ["*"]
        for permission in permissions:
            written = ", ".join(f'"{glob}"' for glob in globs)
            settings[f"roles.rosbridge.{permission}"] = f"[{written}]"
    return settings


def _globs(parameter: str, text: str) -> list[str]:
    try:
        found = yaml.safe_load(text)
    except yaml.YAMLError:
        found = None
    if not isinstance(found, list) or not all(isinstance(each, str) and '"' not in each for each in found):
        raise CommandError(
            f"{parameter}: expected a list such as ['/odom', '/camera/*'], not {text}", exit_code=2
        )
    return found
