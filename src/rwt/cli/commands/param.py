"""`rwt param`: read and change the parameters of the robot's nodes."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rwt.cli.console.message_argument import STDIN, read_value
from rwt.cli.console.output import Output, write_file
from rwt.cli.entities import absolute_name, ask_rosapi, unknown
from rwt.cli.errors import CALLED_WRONGLY, FAILED, CommandError, cannot_read
from rwt.cli.parser import Commands
from rwt.cli.verbs import Arguments, Verb, add_family, argument, arguments, flag, gather
from rwt_participant.errors import NotFound, ParameterRejected
from rwt_participant.spelling import did_you_mean

if TYPE_CHECKING:
    from rwt.cli.console.yaml_text import YamlValue
    from rwt_client import Robot
    from rwt_participant.messages import Message, ParameterValue

PARAMETERS: Final = "ros__parameters"
"""Key between a node and its parameters in ROS 2 parameter files."""
_KINDS: Final = (
    "not set", "boolean", "integer", "double", "string", "byte array", "boolean array", "integer array",
    "double array", "string array",
)  # fmt: skip
"""Names of parameter types, indexed by ``rcl_interfaces/msg/ParameterType``."""
_CONSTRAINTS: Final = {
    "min": "Min value", "max": "Max value", "step": "Step", "constraints": "Additional constraints",
}  # fmt: skip

_ANY_NODE: Final = ("/**", "**")

_NODE: Final = argument("node", metavar="NODE", help="for example /demo_robot")
_NODE_OR_PARAMETER: Final = argument(
    "node", metavar="NODE", help="for example /demo_robot; or /node:parameter in one word"
)
_NAME: Final = arguments(
    _NODE_OR_PARAMETER,
    argument("parameter", metavar="PARAMETER", nargs="?", help="for example max_speed"),
)


def add_param_command(commands: Commands) -> None:
    """Add `param` to the command line."""
    add_family(commands, "param", "The parameters of the robot's nodes.", VERBS)


# -- names -------------------------------------------------------------------------------------------------


def _by_node(names: tuple[str, ...]) -> dict[str, list[str]]:
    """Group parameters by node; those of ROS 1, which belong to no node, under the empty name."""
    found: dict[str, list[str]] = {}
    for name in sorted(names):
        node, colon, parameter = name.rpartition(":")
        found.setdefault(node, []).append(parameter if colon else name)
    return found


async def _of_node(robot: Robot, node: str) -> list[str]:
    names = await ask_rosapi(robot.params.names)
    found = _by_node(names)
    if node in found:
        return found[node]
    if not robot.types.registry.distro.parameters_belong_to_nodes:
        return [name.removeprefix(f"{node}/") for name in sorted(names) if name.startswith(f"{node}/")]
    known = await ask_rosapi(robot.api.nodes)
    if node in known:
        return []
    raise unknown("node", node, known)


def _full(robot: Robot, node: str, parameter: str) -> str:
    """Return the name of a parameter in rosapi's form (API-08)."""
    separator = ":" if robot.types.registry.distro.parameters_belong_to_nodes else "/"
    return f"{node}{separator}{parameter}"


def _addressed(robot: Robot, words: list[str]) -> str:
    """Return the name of a parameter from `NODE PARAMETER`, `/node:parameter` or, on ROS 1, `/parameter`."""
    if len(words) == 2:
        return _full(robot, absolute_name(words[0]), words[1])
    return absolute_name(words[0])


# -- list, get, set, delete --------------------------------------------------------------------------------


async def _list(robot: Robot, arguments: Arguments, output: Output) -> None:
    """List the parameters, of one node or all.

    example:
      rwt param list /demo_robot

    --json prints:
      {"/demo_robot": ["max_speed", …]}; on ROS 1 the names of all stand under ""
    """
    if arguments.node is None:
        found = _by_node(await ask_rosapi(robot.params.names))
    else:
        found = {absolute_name(arguments.node): await _of_node(robot, absolute_name(arguments.node))}
    if output.json:
        output.record(found)
        return
    for node, parameters in found.items():
        if node and arguments.node is None:
            output.line(f"{output.styled(node, 'name')}:")
        for parameter in parameters:
            shown = output.escape_terminal(parameter)
            output.line(f"  {shown}" if node else shown)


async def _get(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Print a parameter's value.

    example:
      rwt param get /demo_robot max_speed

    --json prints:
      {"name": "/demo_robot:max_speed", "value": 0.8}
    """
    from rwt.cli.console.yaml_text import flow

    name = _addressed(robot, _given(arguments.node, arguments.parameter))
    try:
        value = await ask_rosapi(lambda: robot.params.get(name))
    except NotFound as error:
        raise CommandError(str(error), FAILED) from error
    text = flow(value) if arguments.hide_type else f"{_kind(value)} value is: {_shown(value, output)}"
    output.answer({"name": name, "value": value}, text)


def _given(*words: str | None) -> list[str]:
    return [word for word in words if word is not None]


def _shown(value: ParameterValue, output: Output) -> str:
    """Return a value as the ``ros2`` tool prints it; on a terminal without control characters."""
    from rwt.cli.console.yaml_text import flow

    if isinstance(value, str):
        return "\n".join(map(output.escape_terminal, value.split("\n")))
    return str(value) if isinstance(value, bool) else flow(value)


def _kind(value: ParameterValue) -> str:
    if isinstance(value, list):
        return f"{_kind(value[0])} array" if value else "Array"
    return {bool: "Boolean", int: "Integer", float: "Double", str: "String"}.get(type(value), "Value")


async def _set(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Set a parameter.

    example:
      rwt param set /demo_robot max_speed 0.5

    --json prints:
      {"name": "/demo_robot:max_speed", "value": 0.5}
    """
    words = _given(arguments.node, arguments.parameter, arguments.value)
    name, value = _addressed(robot, words[:-1]), read_value(words[-1], "the value")
    try:
        await robot.params.set(name, value)
    except ParameterRejected as error:
        raise CommandError(f"setting {name} failed: {error}", FAILED) from error
    output.answer({"name": name, "value": value}, "Set parameter successful")


async def _delete(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Remove a parameter.

    example:
      rwt param delete /my_node my_parameter

    --json prints:
      {"name": "/my_node:my_parameter", "deleted": true}
    """
    name = _addressed(robot, _given(arguments.node, arguments.parameter))
    await robot.params.delete(name)
    output.answer({"name": name, "deleted": True}, "Deleted parameter successfully")


# -- describe ----------------------------------------------------------------------------------------------


async def _describe(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Print the descriptions of a node's parameters.

    example:
      rwt param describe /demo_robot max_speed

    --json prints:
      [{"name": "max_speed", "type": "double", "description": …, "min": 0.0, "max": 2.0}]; also "step",
      "read_only" and "constraints", each only where the node declares it
    """
    node = absolute_name(arguments.node)
    if not robot.types.registry.distro.parameters_belong_to_nodes:
        raise CommandError("ROS 1 parameters have no descriptions: use `rwt param get`", FAILED)
    known = await _of_node(robot, node)
    for name in arguments.parameters:
        if name not in known:
            raise CommandError(f"{node} has no parameter {name}{did_you_mean(name, known)}", FAILED)
    answer = await robot.call(
        f"{node}/describe_parameters",
        {"names": arguments.parameters},
        "rcl_interfaces/srv/DescribeParameters",
    )
    descriptions = [_description(descriptor) for descriptor in answer.descriptors]
    if output.json:
        output.record(descriptions)
        return
    for described in descriptions:
        _print_description(described, output)


def _description(descriptor: Message) -> dict[str, object]:
    kind = _KINDS[descriptor.type] if descriptor.type < len(_KINDS) else "unknown"
    found = {
        "description": descriptor.description or None,
        "read_only": descriptor.read_only or None,
        "constraints": descriptor.additional_constraints or None,
    }
    for limits in [*descriptor.floating_point_range, *descriptor.integer_range][:1]:
        found |= {"min": limits.from_value, "max": limits.to_value, "step": limits.step or None}
    declared = {key: value for key, value in found.items() if value is not None}
    return {"name": descriptor.name, "type": kind, **declared}


def _print_description(described: Mapping[str, object], output: Output) -> None:
    output.line(f"Parameter name: {output.styled(str(described['name']), 'name')}")
    output.line(f"  Type: {described['type']}")
    if "description" in described:
        output.line(f"  Description: {output.escape_terminal(str(described['description']))}")
    if "read_only" in described:
        output.line("  Read only: true")
    if not _CONSTRAINTS.keys().isdisjoint(described):
        output.line("  Constraints:")
    for key, heading in _CONSTRAINTS.items():
        if key in described:
            output.line(f"    {heading}: {output.escape_terminal(str(described[key]))}")


# -- dump, load --------------------------------------------------------------------------------------------


async def _dump(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Print a node's parameters in the format that `load` reads.

    example:
      rwt param dump /demo_robot > demo_robot.yaml

    --json prints:
      {"node": "/demo_robot", "parameters": {"max_speed": 0.8, …}}
    """
    from rwt.cli.console.yaml_text import block

    node = absolute_name(arguments.node)
    names = await _of_node(robot, node)
    values = await gather([partial(robot.params.get, _full(robot, node, name), "") for name in names])
    flat: dict[str, YamlValue] = dict(zip(names, values, strict=True))
    if output.json:
        output.record({"node": node, "parameters": flat})
        return
    text = block({node: {PARAMETERS: _nested(flat)}})
    if arguments.output is None:
        output.text(text)
    else:
        write_file(arguments.output, text)


def _nested(flat: Mapping[str, YamlValue]) -> dict[str, YamlValue]:
    """Nest `a.b` as `b` within `a`, unless `a` is a parameter itself."""
    found: dict[str, YamlValue] = {}
    for name, value in flat.items():
        *above, last = name.split(".")
        if any(".".join(above[:depth]) in flat for depth in range(1, len(above) + 1)):
            found[name] = value
            continue
        inner = found
        for part in above:
            next_inner = inner.setdefault(part, {})
            assert isinstance(next_inner, dict)  # No parameter has the name of a group.
            inner = next_inner
        inner[last] = value
    return found


async def _load(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Set a node's parameters from a file.

    example:
      rwt param load /demo_robot demo_robot.yaml

    --json prints:
      {"node": "/demo_robot", "set": 9, "failed": []}
    """
    node = absolute_name(arguments.node)
    parameters = _in_file(_text(arguments.file), node, arguments.file)
    failures = []
    for parameter, value in parameters.items():
        refused = await _load_one(robot, _full(robot, node, parameter), value)
        if refused:
            failures.append(f"{parameter}: {refused}")
        if not output.json:
            outcome = f"failed: {refused}" if refused else "successful"
            output.line(output.escape_terminal(f"Set parameter {parameter} {outcome}"))
    if output.json:
        output.record({"node": node, "set": len(parameters) - len(failures), "failed": failures})
    if failures:
        raise CommandError(f"{len(failures)} of {len(parameters)} parameters of {node} were not set", FAILED)


async def _load_one(robot: Robot, name: str, value: YamlValue) -> str:
    """Set a parameter. Return the reason of a failure; empty if the parameter has the value afterwards, as a
    read-only one may."""
    try:
        await robot.params.set(name, value)
    except ParameterRejected as error:
        try:
            return "" if await robot.params.get(name) == value else str(error)
        except NotFound:
            return str(error)
    return ""


def _text(file: str) -> str:
    if file == STDIN:
        return sys.stdin.read()
    try:
        return Path(file).read_text(encoding="utf-8")
    except OSError as error:
        raise cannot_read(file, error) from error
    except UnicodeDecodeError as error:
        raise CommandError(f"{file}: not UTF-8 text", CALLED_WRONGLY) from error


def _in_file(text: str, node: str, file: str) -> dict[str, YamlValue]:
    """Return the parameters of a node in a file by dotted names: those of `/**`, then its own."""
    content = read_value(text, file)
    if not isinstance(content, dict):
        raise CommandError(f"{file}: expected `{node}:` with `{PARAMETERS}:` below it", CALLED_WRONGLY)
    found: dict[str, YamlValue] = {}
    wanted = (*_ANY_NODE, node.removeprefix("/"), node)
    for name in wanted:
        section = content.get(name)
        if section is None:
            continue
        parameters = section.get(PARAMETERS) if isinstance(section, dict) else None
        if not isinstance(parameters, dict):
            raise CommandError(f"{file}: expected `{PARAMETERS}:` below `{name}:`", CALLED_WRONGLY)
        found.update(_flat(parameters))
    if not any(name in content for name in wanted):
        raise CommandError(
            f"{file}: no parameters for {node}{did_you_mean(node, content) or f'; it has {list(content)}'}",
            CALLED_WRONGLY,
        )
    return found


def _flat(nested: Mapping[str, YamlValue], above: str = "") -> dict[str, YamlValue]:
    found: dict[str, YamlValue] = {}
    for name, value in nested.items():
        if isinstance(value, dict):
            found.update(_flat(value, f"{above}{name}."))
        else:
            found[f"{above}{name}"] = value
    return found


VERBS = (
    Verb(
        "list", _list, argument("node", metavar="NODE", nargs="?", help="only list parameters of this node")
    ),
    Verb("get", _get, arguments(_NAME, flag("--hide-type", help="only print the value"))),
    Verb(
        "set",
        _set,
        arguments(
            _NODE_OR_PARAMETER,
            argument("parameter", metavar="PARAMETER", help="for example max_speed"),
            argument(
                "value", metavar="VALUE", nargs="?", help="value in YAML, for example 0.5, true or [1, 2]"
            ),
        ),
    ),
    Verb("delete", _delete, _NAME),
    Verb(
        "describe",
        _describe,
        arguments(
            _NODE, argument("parameters", metavar="PARAMETER", nargs="+", help="for example max_speed")
        ),
    ),
    Verb(
        "dump",
        _dump,
        arguments(_NODE, argument("-o", "--output", type=Path, metavar="FILE", help="write to this file")),
    ),
    Verb(
        "load",
        _load,
        arguments(
            _NODE, argument("file", metavar="FILE", help="file of `rwt param dump`; `-` reads standard input")
        ),
    ),
)
