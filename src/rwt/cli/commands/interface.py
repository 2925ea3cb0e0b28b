"""`rwt interface`: list and show definitions, and generate types for Python and TypeScript from them."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rwt.cli.console.output import Output, note, write_file
from rwt.cli.entities import ask_rosapi
from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt.cli.parser import Commands
from rwt.cli.type_lookup import find_types, known_names, live_types, of_package, offline_registry
from rwt.cli.verbs import (
    Arguments,
    LocalVerb,
    add_family,
    add_robot_options,
    argument,
    arguments,
    connecting,
    flag,
    run_async,
)
from rwt_interfaces.definitions.model import Field, MessageDefinition
from rwt_interfaces.definitions.parser import format_type
from rwt_interfaces.distro import DISTROS, JAZZY
from rwt_interfaces.names import three_part
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import ActionType, ServiceType

if TYPE_CHECKING:
    from rwt_interfaces.codegen.type_selection import InterfaceType, TypeSelection

_HEADINGS: Final = {"msg": "Messages", "srv": "Services", "action": "Actions"}


def add_interface_command(commands: Commands) -> None:
    """Add `interface` to the command line."""
    description = "Messages, services and actions: of the standard set, of folders, or of a robot."
    verbs = [
        replace(verb, add_arguments=arguments(verb.add_arguments, _add_source, add_robot_options))
        for verb in VERBS
    ]
    add_family(commands, "interface", description, verbs)


def _add_source(parser: argparse.ArgumentParser) -> None:
    source = parser.add_argument_group("the definitions")
    source.add_argument(
        "--interfaces",
        action="append",
        type=Path,
        default=[],
        metavar="DIR",
        help="folder with .msg, .srv and .action files; may be given several times",
    )
    source.add_argument(
        "--distro",
        choices=sorted(DISTROS),
        default=JAZZY.name,
        help="distribution of the standard types (default jazzy)",
    )
    source.add_argument("--live", action="store_true", help="ask the robot (implied by --url)")


def _is_live(arguments: Arguments) -> bool:
    if arguments.live or arguments.url:
        if arguments.interfaces:
            raise CommandError("--interfaces cannot be combined with --live and --url", CALLED_WRONGLY)
        return True
    return False


def _registry(arguments: Arguments) -> Registry:
    return offline_registry(DISTROS[arguments.distro], arguments.interfaces)


# -- list --------------------------------------------------------------------------------------------------


def _add_kinds(parser: argparse.ArgumentParser) -> None:
    for kind, heading in _HEADINGS.items():
        what = heading.lower()
        parser.add_argument(
            f"-{kind[0]}", f"--only-{kind}s", action="store_true", dest=kind, help=f"only {what}"
        )


def _kinds(arguments: Arguments) -> list[str]:
    return [kind for kind in _HEADINGS if getattr(arguments, kind)] or [*_HEADINGS]


def _names(arguments: Arguments) -> list[str]:
    if _is_live(arguments):
        return _live_names(arguments)
    return known_names(_registry(arguments))


def _list(arguments: Arguments, output: Output) -> None:
    """List messages, services and actions.

    example:
      rwt interface list -m

    --json prints:
      {"messages": ["geometry_msgs/msg/Twist", …], "services": […], "actions": […]}, or those asked for
    """
    names = _names(arguments)
    if arguments.package:
        names = of_package(names, arguments.package)
    by_kind = {kind: [name for name in names if name.split("/")[1] == kind] for kind in _kinds(arguments)}
    if output.json:
        output.record({_HEADINGS[kind].lower(): of_kind for kind, of_kind in by_kind.items()})
        return
    for kind, of_kind in by_kind.items():
        output.line(output.styled(f"{_HEADINGS[kind]}:", "heading"))
        for name in of_kind:
            output.line(f"    {output.styled(name, 'type')}")


def _packages(arguments: Arguments, output: Output) -> None:
    """List the packages that have messages, services or actions.

    example:
      rwt interface packages -s

    --json prints:
      ["example_interfaces", …]
    """
    kinds = _kinds(arguments)
    packages = sorted({name.split("/")[0] for name in _names(arguments) if name.split("/")[1] in kinds})
    output.names(packages, "type")


def _package(arguments: Arguments, output: Output) -> None:
    """List the types of a package.

    example:
      rwt interface package geometry_msgs

    --json prints:
      ["geometry_msgs/msg/Accel", …]
    """
    output.names(of_package(_names(arguments), arguments.package), "type")


def _live_names(arguments: Arguments) -> list[str]:
    async def ask() -> list[str]:
        async with connecting(arguments) as robot:
            # ROS 1 robots list only messages, with two-part names.
            return sorted(three_part(name, "msg") for name in await ask_rosapi(robot.api.interfaces))

    return run_async(ask)


# -- show --------------------------------------------------------------------------------------------------


def _type(arguments: Arguments) -> tuple[Registry, InterfaceType]:
    if "/" not in arguments.type:
        raise CommandError(
            f"expected a type, for example geometry_msgs/msg/Twist, got {arguments.type!r}; "
            "`rwt interface package PACKAGE` has the types of a package",
            CALLED_WRONGLY,
        )
    registry, (found,) = _types(arguments, [arguments.type])
    return registry, found


def _proto(arguments: Arguments, output: Output) -> None:
    """Print a message, request or goal with its defaults, to be filled in and sent.

    example:
      rwt interface proto geometry_msgs/msg/Twist

    --json prints:
      {"linear": {"x": 0.0, "y": 0.0, "z": 0.0}, "angular": {…}}
    """
    from rwt.cli.console.message_format import Formatting, plain
    from rwt.cli.console.yaml_text import block

    _, found = _type(arguments)
    if isinstance(found, ServiceType):
        message_type = found.request
    else:
        message_type = found.goal if isinstance(found, ActionType) else found
    value = plain(message_type, message_type.struct(), Formatting(json=output.json))
    if output.json:
        output.record(value)
    else:
        quote = "" if arguments.no_quotes else '"'
        output.text(f"{quote}{block(value)}{quote}\n" if quote else block(value))


def _show(arguments: Arguments, output: Output) -> None:
    """Print a definition with those that it contains.

    example:
      rwt interface show geometry_msgs/msg/Twist

    --json prints:
      {"name": "geometry_msgs/msg/Twist", "parts": {"message": [{"name": "linear", "type": …}, …]}}; the
      parts of a service are "request" and "response", of an action "goal", "result" and "feedback"
    """
    registry, found = _type(arguments)
    parts = _parts(found)
    if output.json:
        fields = {name: [_field(field) for field in part.fields] for name, part in parts.items()}
        output.record({"name": registry.type_name(found), "parts": fields})
        return
    sections = []
    for part in parts.values():
        comments = not arguments.no_comments
        sections.append("\n".join(_lines(registry, part, "", comments, arguments.all_comments)))
    output.line("\n---\n".join(sections).replace("\n\n---\n", "\n---\n"))


def _parts(found: InterfaceType) -> dict[str, MessageDefinition]:
    if isinstance(found, ServiceType):
        return {"request": found.request.definition, "response": found.response.definition}
    if isinstance(found, ActionType):
        parts = {"goal": found.goal, "result": found.result, "feedback": found.feedback}
        return {name: part.definition for name, part in parts.items()}
    return {"message": found.definition}


def _field(field: object) -> dict[str, object]:
    assert isinstance(field, Field)  # Definitions have no other fields.
    record: dict[str, object] = {"name": field.name, "type": format_type(field.type)}
    return record if field.default is None else {**record, "default": field.default}


def _lines(
    registry: Registry, definition: MessageDefinition, indent: str, comments: bool, nested_comments: bool
) -> Iterator[str]:
    """Yield the lines of a definition; below each field that is a message its definition, after a tab."""
    messages = {field.name: field.type.name for field in definition.fields if not field.type.is_primitive}
    for line in definition.text.rstrip("\n").split("\n"):
        code, _, _ = line.partition("#")
        if not comments:
            line = code.rstrip() if "=" not in code else line
            if not line:
                continue
        yield f"{indent}{line}"
        words = code.split()
        if len(words) > 1 and "=" not in code and words[1] in messages:
            nested = registry.definition(messages[words[1]])
            yield from _lines(registry, nested, f"{indent}\t", comments and nested_comments, nested_comments)


def _types(arguments: Arguments, words: list[str]) -> tuple[Registry, list[InterfaceType]]:
    """Return the types that words name, with their registry; with --live and no words, all of the graph."""
    if not _is_live(arguments):
        registry = _registry(arguments)
        return registry, find_types(registry, words)

    async def ask() -> tuple[Registry, list[InterfaceType]]:
        async with connecting(arguments, definitions=True) as robot:
            types = await live_types(robot, words)
            # Look them up again: a type compiled before the last definition arrived may contain an older one.
            return robot.types.registry, types

    return run_async(ask)


# -- generate ----------------------------------------------------------------------------------------------


def _generate(arguments: Arguments, output: Output) -> None:
    """Generate types for your program: pydantic models or TypeScript interfaces.

    example:
      rwt interface generate --lang python geometry_msgs nav_msgs/msg/Odometry --out messages.py
      rwt interface generate --lang typescript --live --out messages.ts      all types of a robot

    --json prints:
      {"types": ["geometry_msgs/msg/Twist", …], "file": "messages.py"}, and the code if there is no --out
    """
    from rwt_interfaces.codegen.type_selection import selection
    from rwt_interfaces.definitions.package_directories import interface_files

    if not arguments.name and not _is_live(arguments) and not arguments.interfaces:
        raise CommandError("expected types or packages, --interfaces DIR or --live", CALLED_WRONGLY)
    words = arguments.name
    if not words and arguments.interfaces:
        _registry(arguments)  # Raises for invalid folders.
        words = sorted({file.package for folder in arguments.interfaces for file in interface_files(folder)})
    registry, types = _types(arguments, words)
    if _is_live(arguments):
        types = find_types(registry, [registry.type_name(each) for each in types])
    chosen = selection(registry, types)
    code = _code(arguments.lang, chosen)
    if arguments.out is not None:
        write_file(arguments.out, code)
    every: list[InterfaceType] = [*chosen.messages, *chosen.services, *chosen.actions]
    names = [registry.type_name(each) for each in every]
    if output.json:
        written = {"file": str(arguments.out)} if arguments.out is not None else {"code": code}
        output.record({"types": names, **written})
    elif arguments.out is None:
        output.text(code)
    else:
        note(f"{arguments.out}: {len(names)} types")


def _code(language: str, chosen: TypeSelection) -> str:
    if language == "python":
        from rwt_interfaces.codegen.python import python_stubs

        return python_stubs(chosen)
    from rwt_interfaces.codegen.typescript import typescript_stubs

    return typescript_stubs(chosen)


_TYPE: Final = argument("type", metavar="TYPE", help="for example geometry_msgs/msg/Twist")

VERBS: Final = (
    LocalVerb(
        "list",
        _list,
        arguments(
            argument("package", metavar="PACKAGE", nargs="?", help="only types of this package"), _add_kinds
        ),
    ),
    LocalVerb("packages", _packages, _add_kinds),
    LocalVerb("package", _package, argument("package", metavar="PACKAGE", help="for example geometry_msgs")),
    LocalVerb(
        "show",
        _show,
        arguments(
            _TYPE,
            flag("--no-comments", help="without comments"),
            flag("--all-comments", help="include the comments of nested definitions"),
        ),
    ),
    LocalVerb("proto", _proto, arguments(_TYPE, flag("--no-quotes", help="omit the quotes around it"))),
    LocalVerb(
        "generate",
        _generate,
        arguments(
            argument(
                "name",
                metavar="NAME",
                nargs="*",
                help="type or package (with --live, default: all types of the live graph)",
            ),
            argument("--lang", choices=("python", "typescript"), required=True, help="the language"),
            argument("-o", "--out", type=Path, metavar="FILE", help="write to this file"),
        ),
    ),
)
