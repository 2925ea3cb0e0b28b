"""`launch_ros.parameter_descriptions`: the parameters of nodes, from launch files to command lines."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from rwt_rclpy.launch.entities import (
    LaunchContext,
    LaunchError,
    SomeSubstitutionsType,
    SomeText,
    Substitution,
    text,
    truth,
)
from rwt_rclpy.names import bounded_yaml


class ParameterValue:
    """A value of a type that is said, rather than of what its text looks like."""

    def __init__(self, value: Any, *, value_type: Any = None) -> None:
        self.value = value
        self.value_type = value_type

    def evaluate(self, context: LaunchContext) -> object:
        """The value. Raises LaunchError when its text is none of that type."""
        if self.value_type is str:
            return text(context, self.value)
        found = _value(context, self.value)
        if self.value_type is float and isinstance(found, int) and not isinstance(found, bool):
            return float(found)
        if isinstance(self.value_type, type) and type(found) is not self.value_type:
            raise LaunchError(f"expected a parameter value of {self.value_type.__name__}, got {found!r}")
        return found


class Parameter:
    """One parameter of a node."""

    def __init__(
        self,
        name: SomeSubstitutionsType,
        value: Any,
        *,
        value_type: Any = None,
        description: SomeSubstitutionsType = "",
    ) -> None:
        self.name = name
        self.value = ParameterValue(value, value_type=value_type)


class ParameterFile:
    """A file of parameters; with `allow_substs`, ``$(var NAME)`` and ``$(env NAME)`` in it are replaced."""

    def __init__(self, param_file: SomeSubstitutionsType, *, allow_substs: bool | SomeText = False) -> None:
        self.param_file = param_file
        self.allow_substs = allow_substs

    def evaluate(self, context: LaunchContext) -> Path:
        """The path of the file. Raises LaunchError when there is none, or it needs what is not here."""
        path = Path(text(context, self.param_file))
        if not path.is_file():
            raise LaunchError(f"{path}: no such file of parameters")
        if truth(context, self.allow_substs):
            raise LaunchError(
                f"{path}: substitutions in files of parameters are not available here; give the parameters"
                " that need them in the launch file"
            )
        return path


def _value(context: LaunchContext, value: Any) -> object:
    """A parameter's value: what substitutions come to is read as YAML, as ROS does."""
    if isinstance(value, ParameterValue):
        return value.evaluate(context)
    if isinstance(value, (str, bool, int, float, bytes)):
        return value
    if isinstance(value, Substitution):
        return _read(text(context, value))
    if isinstance(value, Sequence):
        given = list(value)
        if any(isinstance(each, Substitution) for each in given) and all(
            isinstance(each, (str, Substitution)) for each in given
        ):
            return _read(text(context, given))  # As ROS has it: the parts of one text.
        return [_value(context, each) for each in given]
    raise LaunchError(f"{value!r} is no value of a parameter")


def _read(said: str) -> object:
    try:
        return bounded_yaml.load(said) if said else ""
    except yaml.YAMLError as error:
        raise LaunchError(
            f"{said!r} is no YAML; for a text use ParameterValue(…, value_type=str): {error}"
        ) from None


def _flattened(
    context: LaunchContext, given: Mapping[Any, Any], before: str = ""
) -> Iterator[tuple[str, str]]:
    """The parameters of a dictionary, which may be nested, each with its value as YAML of one line."""
    for key, value in given.items():
        name = f"{before}{text(context, key)}"
        if isinstance(value, Mapping):
            yield from _flattened(context, value, f"{name}.")
        else:
            line = yaml.safe_dump(_value(context, value), default_flow_style=True, width=1 << 30)
            yield name, line.removesuffix("\n").removesuffix("\n...")


def arguments_of(context: LaunchContext, parameters: Iterable[Any]) -> Iterator[str]:
    """The command line of a node's parameters: dictionaries, files and single ones, in order.

    Raises:
        LaunchError: one of them is none of these, or has no such value.
    """
    for given in parameters:
        if isinstance(given, Parameter):
            given = {text(context, given.name): given.value}
        if isinstance(given, Mapping):
            for name, value in _flattened(context, given):
                yield from ("-p", f"{name}:={value}")
        else:
            file = given if isinstance(given, ParameterFile) else ParameterFile(given)
            yield from ("--params-file", str(file.evaluate(context)))
