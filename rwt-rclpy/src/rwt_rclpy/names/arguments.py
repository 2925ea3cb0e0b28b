"""Command line of a ROS 2 node: everything between ``--ros-args`` and ``--``.

The options are those of ROS 2's design article "ROS Command Line Arguments".
"""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import yaml

from rwt_rclpy.exceptions import RCLInvalidROSArgsError, UnknownROSArgsError
from rwt_rclpy.names import bounded_yaml
from rwt_rclpy.names.validation import expand_topic_name
from rwt_rclpy.parameters.parameter import ParameterKind

LEVELS: Final = {"unset": 0, "debug": 10, "info": 20, "warn": 30, "error": 40, "fatal": 50}
_SWITCHES: Final = {
    "--enable-rosout-logs": ("rosout", True),
    "--disable-rosout-logs": ("rosout", False),
    "--enable-stdout-logs": ("stdout", True),
    "--disable-stdout-logs": ("stdout", False),
    "--enable-external-lib-logs": ("external", True),
    "--disable-external-lib-logs": ("external", False),
}
#: Names of rules are stricter than others: tokens contain no double underscore.
_TOKEN: Final = r"(?!\d)(?!\w*__)\w+"
_NAME: Final = re.compile(rf"(?:~?/)?{_TOKEN}(?:/{_TOKEN})*", re.ASCII)
_REMAPPED: Final = re.compile(
    rf"(?:({_TOKEN}):)?(?:(rostopic|rosservice)://)?(__node|__name|__ns|{_NAME.pattern})", re.ASCII
)
_SPECIAL: Final = {
    "__node": ("node", re.compile(_TOKEN, re.ASCII)),
    "__name": ("node", re.compile(_TOKEN, re.ASCII)),
    "__ns": ("ns", re.compile(rf"/(?:{_TOKEN}(?:/{_TOKEN})*)?", re.ASCII)),
}
_KINDS: Final = {None: "name", "rostopic": "topic", "rosservice": "service"}
_PARAMETER_NAME: Final = re.compile(r"[^\s]+\Z")
_WITH_VALUE: Final = frozenset(
    {"-r", "--remap", "-p", "--param", "--params-file", "--log-level", "--log-config-file", "-e", "--enclave",
     "--log-file-name"}
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Remap:
    """Rule ``[node:]from:=to``.

    Attributes:
        node: node that it applies to; empty for all.
        kind: kind of name: ``topic``, ``service``, both (``name``), ``node`` or ``ns``.
        old: name; empty for rules of ``node`` and ``ns``.
        new: replacement.
    """

    node: str
    kind: str
    old: str
    new: str


@dataclass(slots=True)
class RosArguments:
    """Parsed command line.

    Attributes:
        remaps: rules; the first match counts.
        parameters: values by node pattern and name, later ones win.
        log_levels: level by logger; the empty name is the default.
        rosout: True to publish logs on ``/rosout``.
        stdout: True to print logs.
        unknown: unknown ROS arguments.
        others: arguments outside of ``--ros-args``.
        log_config_file: configuration of a logging backend, which is not used.
        below: arguments of the program, whose parameters those of a node override.
    """

    remaps: list[Remap] = field(default_factory=list)
    parameters: list[tuple[str, str, Any]] = field(default_factory=list)
    log_levels: dict[str, int] = field(default_factory=dict)
    rosout: bool = True
    stdout: bool = True
    unknown: list[str] = field(default_factory=list)
    others: list[str] = field(default_factory=list)
    log_config_file: Path | None = None
    enclave: str = "/"
    below: RosArguments | None = None

    def refuse_unknown(self) -> None:
        """Raise :exc:`UnknownROSArgsError` if there is an unknown ROS argument."""
        if self.unknown:
            raise UnknownROSArgsError(self.unknown)

    def node_name(self, name: str) -> str:
        """Return the name of a node after ``__node:=``."""
        return self._renamed("node", name, name)

    def namespace(self, name: str, namespace: str) -> str:
        """Return the namespace of a node after ``__ns:=``."""
        return self._renamed("ns", name, namespace)

    def _renamed(self, kind: str, node: str, old: str) -> str:
        return next((rule.new for rule in self.remaps if rule.kind == kind and rule.node in ("", node)), old)

    def remap(self, full_name: str, kind: str, node: str, namespace: str) -> str | None:
        """Return the remapped name for a node; None if no rule matches."""
        for rule in self.remaps:
            if rule.kind not in ("name", kind) or rule.node not in ("", node):
                continue
            if expand_topic_name(rule.old, node, namespace) == full_name:
                return expand_topic_name(rule.new, node, namespace)
        return None

    def parameters_of(self, full_node_name: str) -> dict[str, Any]:
        """Return the values that a node's parameters get.

        Patterns count in the order in which they first appear, as in rcl, and the later ones win. Of the
        values of one pattern, rcl keeps the last one of each type, and takes the first type that has one.
        """
        by_pattern: dict[str, dict[str, Any]] = {}
        for pattern, parameter, value in self.parameters:
            values = by_pattern.setdefault(pattern or "/**", {})
            if parameter not in values or _kind(value) <= _kind(values[parameter]):
                values[parameter] = value
        found = {} if self.below is None else self.below.parameters_of(full_node_name)
        for pattern, values in by_pattern.items():
            if _names_node(pattern, full_node_name):
                found.update(values)
        return found


def _kind(value: Any) -> int:
    """Rank of a value's type; unset ones come last."""
    return ParameterKind.from_parameter_value(value).value or len(ParameterKind)


def _names_node(pattern: str, full: str) -> bool:
    if "*" not in pattern:
        return pattern.strip("/") == full.strip("/")
    # `**` is any number of tokens, `*` is one.
    parts = [
        "(?:/[^/]+)*" if token == "**" else "/" + fnmatch.translate(token)[4:-3].replace(".*", "[^/]*")
        for token in pattern.strip("/").split("/")
    ]
    return re.fullmatch("".join(parts), full) is not None


def parse_arguments(arguments: Sequence[str], *, ros_first: bool = False) -> RosArguments:
    """Parse a command line.

    Args:
        arguments: command line, with or without the program's name.
        ros_first: True if they begin inside ``--ros-args``, like a node's `cli_args`.

    Raises:
        RCLInvalidROSArgsError: the value of an argument is invalid.
    """
    found = RosArguments()
    within = ros_first
    rest = list(arguments)
    while rest:
        argument = rest.pop(0)
        if not within:
            if argument == "--ros-args":
                within = True
                continue
            try:
                found.remaps.append(parse_remap(argument))  # Deprecated, but supported by rcl.
            except RCLInvalidROSArgsError:
                found.others.append(argument)
        elif argument == "--":
            within = False
        elif argument != "--ros-args":
            _take(found, argument, rest)
    return found


def remove_ros_args(arguments: Sequence[str]) -> list[str]:
    """Return the arguments of a command line that are not ROS's. Raises UnknownROSArgsError."""
    found = parse_arguments(arguments)
    found.refuse_unknown()
    return found.others


def _take(found: RosArguments, argument: str, rest: list[str]) -> None:
    if argument in _SWITCHES:
        name, value = _SWITCHES[argument]
        if name != "external":
            setattr(found, name, value)
        return
    name, given, text = argument.partition("=")
    if given and name.startswith("--log-level"):
        rest.insert(0, text)
        argument = name
    if argument not in _WITH_VALUE:
        found.unknown.append(argument)
        return
    if not rest:
        raise RCLInvalidROSArgsError(f"{argument}: no value follows")
    value_text = rest.pop(0)
    if argument in ("-r", "--remap"):
        found.remaps.append(parse_remap(value_text))
    elif argument in ("-p", "--param"):
        found.parameters.append(_parse_parameter(value_text))
    elif argument == "--params-file":
        found.parameters.extend(read_parameter_file(Path(value_text)))
    elif argument in ("-e", "--enclave"):
        found.enclave = value_text
    elif argument == "--log-config-file":
        found.log_config_file = Path(value_text)
    elif argument == "--log-level":
        logger, separator, level = value_text.rpartition(":=")
        if level.lower() not in LEVELS or (separator and not logger):
            raise RCLInvalidROSArgsError(
                f"--log-level {value_text}: expected one of {', '.join(LEVELS)}, perhaps after LOGGER:="
            )
        found.log_levels[logger if separator else ""] = LEVELS[level.lower()]


def parse_remap(text: str) -> Remap:
    """Parse a rule ``[node:]from:=to``. Raises RCLInvalidROSArgsError."""
    left, _, new = text.partition(":=")
    found = _REMAPPED.fullmatch(left)
    if found is None:
        raise RCLInvalidROSArgsError(
            f"failed to initialize rcl: Couldn't parse remap rule: '-r {text}'. Error:"
            " expected [NODE:]FROM:=TO"
        )
    node, scheme, old = found.groups()
    kind, pattern = _SPECIAL.get(old, (_KINDS[scheme], _NAME))
    if not pattern.fullmatch(new):
        raise RCLInvalidROSArgsError(
            f"Failed to parse ROS arguments: the remap rule '{text}': '{new}' is invalid as a {kind}"
        )
    return Remap(node or "", kind, "" if old in _SPECIAL else old, new)


def _parse_parameter(text: str) -> tuple[str, str, Any]:
    left, separator, value = text.partition(":=")
    if not separator or not left:
        raise RCLInvalidROSArgsError(
            f"failed to initialize rcl: Couldn't parse parameter override rule: '-p {text}'."
            " Error: expected NAME:=VALUE"
        )
    node, colon, name = left.partition(":")
    if not colon:
        node, name = "", left
    if not _PARAMETER_NAME.match(name):
        raise RCLInvalidROSArgsError(f"Failed to parse ROS arguments: '{name}' is not a name of a parameter")
    return node, name, parse_value(value)


def parse_value(text: str) -> Any:
    """Return a parameter's value by the rules of rcl. Raises RCLInvalidROSArgsError."""
    try:
        value = bounded_yaml.load_parameters(text)
    except yaml.YAMLError as error:
        raise RCLInvalidROSArgsError(f"the value {text[:200]!r} cannot be read: {error}") from None
    if not text or isinstance(value, dict):
        raise RCLInvalidROSArgsError(f"the value {text[:200]!r} is not a scalar or a list")
    return value


def read_parameter_file(path: Path) -> list[tuple[str, str, Any]]:
    """Return the parameters of a YAML file: node pattern, name and value of each.

    Raises:
        RCLInvalidROSArgsError: the file is missing, or not of the form ``NODE: {ros__parameters: …}``.
    """
    try:
        tree = bounded_yaml.load_parameters(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise RCLInvalidROSArgsError(f"--params-file {path}: {error}") from None
    if tree is None:
        return []
    if not isinstance(tree, dict) or "ros__parameters" in tree:
        raise RCLInvalidROSArgsError(f"--params-file {path}: expected NODE: with ros__parameters: below it")
    found: list[tuple[str, str, Any]] = []
    _collect_nodes(tree, "", found, path)
    return found


def _collect_nodes(tree: dict[Any, Any], prefix: str, found: list[tuple[str, str, Any]], path: Path) -> None:
    for key, value in tree.items():
        if key == "ros__parameters":
            if not isinstance(value, dict):
                raise RCLInvalidROSArgsError(f"--params-file {path}: {prefix}: ros__parameters has no names")
            _collect_parameters(value, "", prefix, found)
        elif isinstance(value, dict):
            _collect_nodes(value, f"{prefix}/{str(key).strip('/')}", found, path)
        else:
            raise RCLInvalidROSArgsError(
                f"--params-file {path}: {prefix}/{key}: expected ros__parameters: below the node's name"
            )


def _collect_parameters(
    tree: dict[Any, Any], prefix: str, node: str, found: list[tuple[str, str, Any]]
) -> None:
    for key, value in tree.items():
        name = f"{prefix}.{key}" if prefix else str(key)
        if isinstance(value, dict) and value:
            _collect_parameters(value, name, node, found)
        else:
            found.append((node, name, None if value == {} else value))
