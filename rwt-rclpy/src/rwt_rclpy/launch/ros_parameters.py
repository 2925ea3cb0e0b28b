"""`launch_ros.parameter_descriptions`: parameters of nodes in launch files."""

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
    """Value with an explicit type, instead of that inferred from its text."""

    def __init__(self, value: Any, *, value_type: Any = None) -> None:
        self.value = value
        self.value_type = value_type

    def evaluate(self, context: LaunchContext) -> object:
        """Return the value. Raises LaunchError if its text does not fit the type."""
        if self.value_type is str:
            return text(context, self.value)
        found = _value(context, self.value)
        if self.value_type is float and isinstance(found, int) and not isinstance(found, bool):
            return float(found)
        if isinstance(self.value_type, type) and type(found) is not self.value_type:
            raise LaunchError(f"expected a parameter value of {self.value_type.__name__}, got {found!r}")
        return found


class Parameter:
    """Parameter of a node."""

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
    """File of parameters; with `allow_substs`, ``$(var NAME)`` and ``$(env NAME)`` are replaced."""

    def __init__(self, param_file: SomeSubstitutionsType, *, allow_substs: bool | SomeText = False) -> None:
        self.param_file = param_file
        self.allow_substs = allow_substs

    def evaluate(self, context: LaunchContext) -> Path:
        """Return the path of the file. Raises LaunchError if it is missing or not supported."""
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
    """Return the value of a parameter; evaluated substitutions are parsed as YAML, as in ROS."""
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
            return _read(text(context, given))  # As in ROS: parts of one text.
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
    """Return the parameters of a nested dictionary, each with its value as YAML in one line."""
    for key, value in given.items():
        name = f"{before}{text(context, key)}"
        if isinstance(value, Mapping):
            yield from _flattened(context, value, f"{name}.")
        else:
            line = yaml.safe_dump(_value(context, value), default_flow_style=True, width=1 << 30)
            yield name, line.removesuffix("\n").removesuffix("\n...")


def arguments_of(context: LaunchContext, parameters: Iterable[Any]) -> Iterator[str]:
    """Return the command line for a node's parameters: dictionaries, files and single ones, in order.

    Raises:
        LaunchError: one of them is of another type, or invalid.
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
