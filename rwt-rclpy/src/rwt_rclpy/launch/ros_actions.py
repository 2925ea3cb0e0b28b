"""`launch_ros.actions`: nodes, and settings for all nodes of a group."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NoReturn

from rwt_rclpy.launch.entities import (
    Action,
    LaunchContext,
    LaunchDescriptionEntity,
    LaunchError,
    SomeSubstitutionsType,
    SomeText,
    text,
)
from rwt_rclpy.launch.processes import ExecuteProcess
from rwt_rclpy.launch.ros_parameters import arguments_of
from rwt_rclpy.names.validation import validate_namespace, validate_node_name
from rwt_rclpy.running import find_executable, is_python, root

#: Names of configurations with settings for later nodes, as in ROS.
_NAMESPACE, _PARAMETERS, _REMAPPINGS = "ros_namespace", "global_params", "ros_remaps"


def _joined(base: str | None, namespace: str | None) -> str | None:
    """Return a namespace below another, absolute; None if there is none."""
    if base is None and namespace is None:
        return None
    absolute = namespace or ""
    if not absolute.startswith("/"):
        absolute = f"{(base or '').rstrip('/')}/{absolute}"
    absolute = absolute.rstrip("/") or "/"
    validate_namespace(absolute)
    return absolute


class Node(ExecuteProcess):
    """Action that starts a node of a package's source, or of a file.

    Args:
        executable: name in the package, or file without a package.
        package: package below the root.
        name, namespace: name and namespace of the node; by default those of its program.
        parameters: dictionaries, files, or both; the last value counts.
        remappings: pairs of a name and its replacement.
        arguments: further arguments.
        ros_arguments: further ROS arguments.
        exec_name: name of the process; by default the executable.
        process: further arguments of :class:`ExecuteProcess`.
    """

    def __init__(
        self,
        *,
        executable: SomeSubstitutionsType,
        package: SomeSubstitutionsType | None = None,
        name: SomeSubstitutionsType | None = None,
        namespace: SomeSubstitutionsType | None = None,
        exec_name: SomeSubstitutionsType | None = None,
        parameters: Iterable[Any] | None = None,
        remappings: Iterable[tuple[SomeText, SomeText]] | None = None,
        ros_arguments: Iterable[SomeText] | None = None,
        arguments: Iterable[SomeText] | None = None,
        **process: Any,
    ) -> None:
        if "cmd" in process:
            raise LaunchError("a Node is started by its executable; for a command use ExecuteProcess(cmd=…)")
        super().__init__(cmd=[], name=executable if exec_name is None else exec_name, **process)
        self._package, self._node_executable = package, executable
        self._node_name, self._namespace = name, namespace
        self._parameters = list(parameters or ())
        self._remappings = list(remappings or ())
        self._ros_arguments, self._arguments = list(ros_arguments or ()), list(arguments or ())
        #: Absolute name of the node, or its known part; available after the start.
        self.node_name = ""

    def execute(self, context: LaunchContext) -> list[LaunchDescriptionEntity] | None:
        """Start the node. Raises LaunchError or CannotRun for a missing executable or an invalid name."""
        self._cmd = [*self._program(context), *self._arguments, "--ros-args", *self._ros_arguments]
        self._cmd.extend(self._own(context))
        return super().execute(context)

    def _program(self, context: LaunchContext) -> Iterator[str]:
        executable = text(context, self._node_executable)
        here = [sys.executable, "-m", "rwt_rclpy"]
        if self._package is not None:
            package = text(context, self._package)
            find_executable(package, executable, root())
            yield from (*here, package, executable)
        elif is_python(Path(executable)):
            yield from (*here, executable)
        else:
            yield executable

    def _own(self, context: LaunchContext) -> Iterator[str]:
        """Return the node's ROS arguments, its own and those of its groups."""
        held = context.launch_configurations
        given = None if self._namespace is None else text(context, self._namespace)
        namespace = _joined(held.get(_NAMESPACE), given)
        name = None if self._node_name is None else text(context, self._node_name)
        if name is not None:
            validate_node_name(name)
            yield from ("-r", f"__node:={name}")
        if namespace is not None:
            yield from ("-r", f"__ns:={namespace}")
        self.node_name = f"{(namespace or '').rstrip('/')}/{name or '<node_name_unspecified>'}"
        yield from held.get(_PARAMETERS, ())
        yield from arguments_of(context, self._parameters)
        for old, new in (*held.get(_REMAPPINGS, ()), *self._remappings):
            yield from ("-r", f"{text(context, old)}:={text(context, new)}")


class LifecycleNode(Node):
    """Action that starts a node with a lifecycle, whose transitions are requested by its services."""

    def __init__(self, *, name: SomeSubstitutionsType, namespace: SomeSubstitutionsType, **node: Any) -> None:
        if node.pop("autostart", False):
            raise LaunchError("autostart is not available here: call the node's service change_state")
        super().__init__(name=name, namespace=namespace, **node)


class PushRosNamespace(Action):
    """Action that puts later nodes of a group into a namespace, below the current one."""

    def __init__(self, namespace: SomeSubstitutionsType, **action: Any) -> None:
        super().__init__(**action)
        self.namespace = namespace

    def execute(self, context: LaunchContext) -> None:
        """Set the namespace. Raises InvalidNamespaceException."""
        held = context.launch_configurations
        held[_NAMESPACE] = _joined(held.get(_NAMESPACE), text(context, self.namespace))


PushROSNamespace = PushRosNamespace


class _ForLaterNodes(Action):
    """Action that adds arguments for later nodes of a group."""

    kept_as = _PARAMETERS

    def execute(self, context: LaunchContext) -> None:
        """Add it."""
        held = context.launch_configurations
        # A new list: the previous one belongs to the outer group.
        held[self.kept_as] = [*held.get(self.kept_as, ()), *self._given(context)]

    def _given(self, context: LaunchContext) -> Iterable[Any]:
        raise NotImplementedError


class SetParameter(_ForLaterNodes):
    """Action that sets a parameter of later nodes of a group."""

    def __init__(self, name: SomeSubstitutionsType, value: Any, **action: Any) -> None:
        super().__init__(**action)
        self.name = name
        self.value = value

    def _given(self, context: LaunchContext) -> Iterable[str]:
        return arguments_of(context, [{text(context, self.name): self.value}])


class SetUseSimTime(SetParameter):
    """Action that sets `use_sim_time` of later nodes of a group."""

    def __init__(self, value: bool | SomeText = True, **action: Any) -> None:
        super().__init__("use_sim_time", value, **action)


class SetParametersFromFile(_ForLaterNodes):
    """Action that sets parameters of later nodes of a group from a file."""

    def __init__(self, filename: SomeSubstitutionsType, **action: Any) -> None:
        super().__init__(**action)
        self.filename = filename

    def _given(self, context: LaunchContext) -> Iterable[str]:
        return arguments_of(context, [self.filename])


class SetRemap(_ForLaterNodes):
    """Action that adds a remapping for later nodes of a group."""

    kept_as = _REMAPPINGS

    def __init__(self, src: SomeText, dst: SomeText, **action: Any) -> None:
        super().__init__(**action)
        self.src = src
        self.dst = dst

    def _given(self, context: LaunchContext) -> Iterable[tuple[str, str]]:
        return [(text(context, self.src), text(context, self.dst))]


_COMPONENTS = "components are C++; run them on a machine with ROS, and join it over Zenoh or rosbridge"
_ABSENT = {
    "ComposableNodeContainer": _COMPONENTS,
    "LoadComposableNodes": _COMPONENTS,
    "LifecycleTransition": "call the node's service change_state",
    "RosTimer": "use launch.actions.TimerAction, whose seconds are this machine's",
    "SetROSLogDir": "the lines of nodes are shown, and go to no files",
}


def __getattr__(name: str) -> NoReturn:
    if name in _ABSENT:
        raise ImportError(
            f"launch_ros.actions.{name} is not available without ROS: {_ABSENT[name]}", name=name
        )
    raise AttributeError(f"launch_ros.actions has no {name} here")
