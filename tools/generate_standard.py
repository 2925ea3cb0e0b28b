"""Write the standard messages of both distributions as data files of `rwt_interfaces`.

The fields and constants come from the type stores of rosbags (a development dependency), the default values,
which those stores do not keep, from the table below. Run it after an upgrade of rosbags and commit what
changed:

    python tools/generate_standard.py
"""

from __future__ import annotations

import sys
from collections import defaultdict
from pathlib import Path

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

ROOT = Path(__file__).parent.parent / "src" / "rwt_interfaces" / "standard"
STORES = {"jazzy": Stores.ROS2_JAZZY, "noetic": Stores.ROS1_NOETIC}

#: Default values of ROS 2, as the packages of jazzy have them.
DEFAULTS = {
    ("jazzy", "geometry_msgs/msg/Quaternion", "x"): "0",
    ("jazzy", "geometry_msgs/msg/Quaternion", "y"): "0",
    ("jazzy", "geometry_msgs/msg/Quaternion", "z"): "0",
    ("jazzy", "geometry_msgs/msg/Quaternion", "w"): "1",
    ("jazzy", "sensor_msgs/msg/NavSatStatus", "status"): "-2",
    ("jazzy", "rcl_interfaces/msg/ParameterDescriptor", "read_only"): "false",
    ("jazzy", "rcl_interfaces/msg/ParameterDescriptor", "dynamic_typing"): "false",
    ("jazzy", "type_description_interfaces/msg/FieldType", "type_id"): "0",
}

#: Internals of ROS 2 itself, which no program outside it exchanges, and what ROS 1 has as primitives.
LEFT_OUT = {"jazzy": {"rmw_dds_common", "rosbag2_interfaces"}, "noetic": {"builtin_interfaces"}}

#: Messages that the registry derives from an action's definition.
DERIVED = ("Action", "ActionGoal", "ActionResult", "ActionFeedback", "Goal", "Result", "Feedback")

TIMES = {"builtin_interfaces/msg/Time": "time", "builtin_interfaces/msg/Duration": "duration"}


def type_text(description: tuple, package: str, distro: str) -> str:
    """A field's type in definition syntax."""
    kind, rest = description
    if kind == Nodetype.BASE:
        name, limit = rest
        return f"{name}<={limit}" if limit else name
    if kind == Nodetype.NAME:
        if distro == "noetic" and rest in TIMES:
            return TIMES[rest]
        owner, _, name = rest.split("/")
        return name if owner == package and name != "Header" else f"{owner}/{name}"
    element, count = rest
    text = type_text(element, package, distro)
    if kind == Nodetype.ARRAY:
        return f"{text}[{count}]"
    return f"{text}[<={count}]" if count else f"{text}[]"


def message_text(distro: str, name: str, constants: list, fields: list) -> str:
    """One message in definition syntax."""
    package = name.split("/")[0]
    lines = [f"{kind} {constant}={value}" for constant, kind, value in constants]
    for field, description in fields:
        if field == "structure_needs_at_least_one_member":
            continue
        default = DEFAULTS.get((distro, name, field))
        lines.append(
            f"{type_text(description, package, distro)} {field}" + (f" {default}" if default else "")
        )
    return "".join(f"{line}\n" for line in lines)


def is_derived(name: str, names: set[str]) -> bool:
    """Whether a message is one of those that an action's definition gives."""
    for suffix in sorted(DERIVED, key=len, reverse=True):
        base = name.removesuffix(suffix)
        if base != name:
            return f"{base}ActionGoal" in names
    return False


def main() -> int:
    """Write every file, and say what was written."""
    for distro, store in STORES.items():
        folder = ROOT / distro
        for old in folder.glob("*.generated.txt"):
            old.unlink()
        definitions = get_typestore(store).fielddefs
        packages: dict[str, list[str]] = defaultdict(list)
        for name in sorted(definitions):
            package, _, short = name.split("/")
            if package not in LEFT_OUT[distro] and not is_derived(name, set(definitions)):
                packages[package].append(f"=== msg/{short}\n{message_text(distro, name, *definitions[name])}")
        for package, sections in packages.items():
            (folder / f"{package}.generated.txt").write_text("".join(sections), "utf-8")
        print(f"{distro}: {sum(map(len, packages.values()))} messages of {len(packages)} packages")
    return 0


if __name__ == "__main__":
    sys.exit(main())
