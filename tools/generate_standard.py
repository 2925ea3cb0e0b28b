"""Write the standard messages of all distributions as data files of `rwt_interfaces`.

The fields and constants come from the type stores of rosbags (a development dependency), the default values
and the places of constants among the fields, which those stores do not keep, from the tables below. Run it
after an upgrade of rosbags and commit what changed:

    python tools/generate_standard.py
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Container
from pathlib import Path
from typing import TYPE_CHECKING

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from rwt_interfaces import DISTROS

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Constdefs, Fielddefs, FieldDesc

ROOT = Path(__file__).parent.parent / "src" / "rwt_interfaces" / "standard"
STORES = {
    "humble": Stores.ROS2_HUMBLE,
    "jazzy": Stores.ROS2_JAZZY,
    "kilted": Stores.ROS2_KILTED,
    "lyrical": Stores.ROS2_LYRICAL,
    "noetic": Stores.ROS1_NOETIC,
}

#: Release from which a release's files hold the differences; all others are whole.
BASES = {"humble": "jazzy", "kilted": "jazzy", "lyrical": "kilted"}

#: Default values of ROS 2.
DEFAULTS = {
    ("geometry_msgs/msg/Quaternion", "x"): "0",
    ("geometry_msgs/msg/Quaternion", "y"): "0",
    ("geometry_msgs/msg/Quaternion", "z"): "0",
    ("geometry_msgs/msg/Quaternion", "w"): "1",
    ("sensor_msgs/msg/NavSatStatus", "status"): "-2",
    ("rcl_interfaces/msg/ParameterDescriptor", "read_only"): "false",
    ("rcl_interfaces/msg/ParameterDescriptor", "dynamic_typing"): "false",
    ("type_description_interfaces/msg/FieldType", "type_id"): "0",
    ("rosgraph_msgs/msg/TypeHash", "version"): "1",
}
#: Default values that are not in a distribution.
WITHOUT_DEFAULT = {("humble", "sensor_msgs/msg/NavSatStatus")}

#: Constants that stand behind a field, and with them those that follow; all others stand before the fields.
#: No message depends on it, but viewers compare definitions with those that they know (Lichtblick's common
#: definitions, @lichtblick/rosmsg-msgs-common), line by line.
BEHIND = {
    ("actionlib_msgs/msg/GoalStatus", "PENDING"): "status",
    ("sensor_msgs/msg/NavSatFix", "COVARIANCE_TYPE_UNKNOWN"): "position_covariance",
    ("sensor_msgs/msg/NavSatStatus", "SERVICE_GPS"): "status",
    ("sensor_msgs/msg/Range", "ULTRASOUND"): "header",
    ("shape_msgs/msg/SolidPrimitive", "BOX_X"): "dimensions",
    ("visualization_msgs/msg/MenuEntry", "FEEDBACK"): "command",
    ("visualization_msgs/msg/InteractiveMarkerControl", "INHERIT"): "orientation",
    ("visualization_msgs/msg/InteractiveMarkerControl", "NONE"): "orientation_mode",
}
BEHIND_IN_ROS2 = {
    ("visualization_msgs/msg/InteractiveMarkerFeedback", "KEEP_ALIVE"): "control_name",
    ("visualization_msgs/msg/InteractiveMarkerUpdate", "KEEP_ALIVE"): "seq_num",
}

#: Services of a tool, which are written by hand for both, and what ROS 1 has as primitives.
LEFT_OUT = {1: {"builtin_interfaces"}, 2: {"rosbag2_interfaces"}}

#: Messages that the registry derives from an action's definition.
DERIVED = ("Action", "ActionGoal", "ActionResult", "ActionFeedback", "Goal", "Result", "Feedback")

TIMES = {"builtin_interfaces/msg/Time": "time", "builtin_interfaces/msg/Duration": "duration"}


def type_text(description: FieldDesc, package: str, distro: str) -> str:
    """A field's type in definition syntax."""
    if description[0] == Nodetype.BASE:
        name, limit = description[1]
        return f"{name}<={limit}" if limit else name
    if description[0] == Nodetype.NAME:
        return message_name(description[1], package, distro)
    element, count = description[1]
    text = type_text(element, package, distro)
    if description[0] == Nodetype.ARRAY:
        return f"{text}[{count}]"
    return f"{text}[<={count}]" if count else f"{text}[]"


def message_name(name: str, package: str, distro: str) -> str:
    """Return the name by which a definition of `package` refers to another message."""
    if distro == "noetic" and name in TIMES:
        return TIMES[name]
    owner, _, short = name.split("/")
    # A bare `Header` means std_msgs/Header everywhere; say so.
    return short if owner == package and short != "Header" else f"{owner}/{short}"


def message_text(distro: str, name: str, constants: Constdefs, fields: Fielddefs) -> str:
    """One message in definition syntax."""
    package = name.split("/")[0]
    is_ros2 = DISTROS[distro].ros_version == 2
    places = BEHIND | BEHIND_IN_ROS2 if is_ros2 else BEHIND
    defaults = DEFAULTS if is_ros2 and (distro, name) not in WITHOUT_DEFAULT else {}
    standing: defaultdict[str, list[str]] = defaultdict(list)
    behind = ""
    for constant, kind, value in constants:
        behind = places.get((name, constant), behind)
        standing[behind].append(f"{kind} {constant}={value}")
    lines = standing[""]
    for field, description in fields:
        if field != "structure_needs_at_least_one_member":
            default = defaults.get((name, field))
            line = f"{type_text(description, package, distro)} {field}"
            lines.append(line if default is None else f"{line} {default}")
        lines += standing[field]
    return "".join(f"{line}\n" for line in lines)


def is_derived(name: str, names: Container[str]) -> bool:
    """True if a message is derived from an action's definition."""
    for suffix in sorted(DERIVED, key=len, reverse=True):
        base = name.removesuffix(suffix)
        if base != name:
            return f"{base}ActionGoal" in names
    return False


def sections(distro: str) -> dict[str, str]:
    """The section of each message of a distribution."""
    definitions = get_typestore(STORES[distro]).fielddefs
    left_out = LEFT_OUT[DISTROS[distro].ros_version]
    return {
        name: f"=== msg/{name.split('/')[2]}\n{message_text(distro, name, *definitions[name])}"
        for name in sorted(definitions)
        if name.split("/")[0] not in left_out and not is_derived(name, definitions)
    }


def generate(distro: str) -> dict[str, str]:
    """The data file of each package of a distribution, or its differences from the base."""
    if distro not in STORES:
        return {}
    found = sections(distro)
    base = sections(BASES[distro]) if distro in BASES else {}
    packages: defaultdict[str, str] = defaultdict(str)
    for name in sorted(found.keys() | base.keys()):
        package, _, short = name.split("/")
        if name not in found:
            packages[package] += f"=== msg/{short} removed\n"
        elif found[name] != base.get(name):
            packages[package] += found[name]
    return dict(packages)


def main() -> int:
    """Write every file, and say what was written."""
    for distro in STORES:
        (ROOT / distro).mkdir(exist_ok=True)
        for old in (ROOT / distro).glob("*.generated.txt"):
            old.unlink()
        packages = generate(distro)
        for package, text in packages.items():
            (ROOT / distro / f"{package}.generated.txt").write_text(text, "utf-8")
        print(f"{distro}: {len(packages)} packages")
    return 0


if __name__ == "__main__":
    sys.exit(main())
