"""Write src/rwt_interfaces/jazzy.pyi and noetic.pyi: types of the standard messages for type checkers.

Run it after a change of the standard interfaces: ``python tools/generate_message_stubs.py``. A test compares.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from rwt_interfaces import JAZZY, NOETIC, Distro, Registry, field_types
from rwt_interfaces.definitions.model import Constant
from rwt_interfaces.field_types import FieldType
from rwt_interfaces.structs import MessageType, python_name

TARGET = Path(__file__).parents[1] / "src" / "rwt_interfaces"

_HEAD = '''\
"""The standard messages of {name}; this file is made by `tools/generate_message_stubs.py`."""

import builtins
from typing import ClassVar

import msgspec
'''
_STEP = "    "


def stubs(distro: Distro) -> str:
    """The file of one distribution."""
    registry = Registry(distro)
    names = {kind: registry.names(kind) for kind in ("msg", "srv", "action")}
    packages = sorted({name.partition("/")[0] for each in names.values() for name in each})
    lines = [_HEAD.format(name=distro.name)]
    if distro.has_time_primitives:
        lines += _times()
    for package in packages:
        lines += ["", f"class {package}:"]
        for line in _package(registry, package, names):
            lines.append(f"{_STEP}{line}" if line else "")
    return "\n".join(lines) + "\n"


def _times() -> Iterator[str]:
    """ROS 1's primitives, which belong to no package."""
    for primitive in ("Time", "Duration"):
        yield from _class(primitive, [("secs", "builtins.int"), ("nsecs", "builtins.int")], ())


def _package(registry: Registry, package: str, names: dict[str, tuple[str, ...]]) -> Iterator[str]:
    prefix = f"{package}/"
    for name in names["msg"]:
        if name.startswith(prefix):
            yield from _message(registry.message(name), name.removeprefix(prefix))
    owned = sorted({name for kind in ("srv", "action") for name in names[kind] if name.startswith(prefix)})
    for name in owned:
        if name in names["msg"]:
            continue  # The message of that name is found first.
        yield ""
        yield f"class {name.removeprefix(prefix)}:"
        for part, message in _parts(registry, name, names):
            yield from _indented(_message(message, part))


def _parts(
    registry: Registry, name: str, names: dict[str, tuple[str, ...]]
) -> Iterator[tuple[str, MessageType]]:
    if name in names["srv"]:
        service = registry.service(name)
        yield from (("Request", service.request), ("Response", service.response))
    if name in names["action"]:
        action = registry.action(name)
        yield from (("Goal", action.goal), ("Result", action.result), ("Feedback", action.feedback))


def _message(message: MessageType, name: str) -> Iterator[str]:
    if message.time is not None:
        return _class(name, [(key, "builtins.int") for key in message.time.keys], ())
    fields = [(slot.attribute, _type(slot.type)) for slot in message.slots]
    return _class(name, fields, message.definition.constants)


def _class(name: str, fields: list[tuple[str, str]], constants: Iterable[Constant]) -> Iterator[str]:
    lines = [
        f"{python_name(each.name)}: ClassVar[builtins.{type(each.value).__name__}]" for each in constants
    ]
    lines += [f"{field}: {held} = ..." for field, held in fields]
    yield ""
    yield f"class {name}(msgspec.Struct):{'' if lines else ' ...'}"
    yield from _indented(lines)


def _type(field_type: FieldType) -> str:
    match field_type:
        case field_types.Bool():
            return "builtins.bool"
        case field_types.Int():
            return "builtins.int"
        case field_types.Float():
            return "builtins.float"
        case field_types.String():
            return "builtins.str"
        case field_types.Octets():
            return "builtins.bytes"
        case field_types.Time():
            return _time(field_type)
        case field_types.Message(type=nested):
            return nested.name.replace("/", ".")
        case field_types.Array(element=element):
            return f"builtins.list[{_type(element)}]"


def _time(field_type: field_types.Time) -> str:
    name = "Duration" if field_type.is_duration else "Time"
    return f"builtin_interfaces.{name}" if field_type.keys[0] == "sec" else name


def _indented(lines: Iterable[str]) -> Iterator[str]:
    for line in lines:
        yield f"{_STEP}{line}" if line else ""


def main() -> None:
    """Write the files."""
    for distro in (JAZZY, NOETIC):
        (TARGET / f"{distro.name}.pyi").write_text(stubs(distro), encoding="utf-8")


if __name__ == "__main__":
    main()
