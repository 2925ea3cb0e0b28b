"""`launch.substitutions`: texts that are evaluated during the launch."""

from __future__ import annotations

import importlib
import os
import shlex
import shutil
import subprocess
import uuid
from pathlib import Path
from typing import Any

from rwt_rclpy.launch.entities import (
    LaunchContext,
    LaunchError,
    SomeSubstitutionsType,
    SomeText,
    Substitution,
    normalize_to_list_of_substitutions,
    text,
    truth,
)
from rwt_rclpy.launch.logging import get_logger


class SubstitutionFailure(LaunchError):
    """A substitution cannot be evaluated."""


class TextSubstitution(Substitution):
    """Constant text."""

    def __init__(self, *, text: str) -> None:
        self.text = text

    def perform(self, context: LaunchContext) -> str:
        """Return the text."""
        return self.text


class LaunchConfiguration(Substitution):
    """Value of an argument, or of a configuration set by an action."""

    def __init__(self, variable_name: SomeSubstitutionsType, *, default: SomeText | None = None) -> None:
        self.variable_name = variable_name
        self.default = default

    def describe(self) -> str:
        """Return the name."""
        return f"LaunchConfiguration({self.variable_name!r})"

    def perform(self, context: LaunchContext) -> str:
        """Return the value. Raises SubstitutionFailure if there is none, and no default."""
        name = text(context, self.variable_name)
        if name in context.launch_configurations:
            return str(context.launch_configurations[name])
        if self.default is None:
            known = ", ".join(sorted(context.launch_configurations)) or "none"
            raise SubstitutionFailure(f"launch configuration {name!r} does not exist; there is {known}")
        return text(context, self.default)


class EnvironmentVariable(Substitution):
    """Value of an environment variable."""

    def __init__(self, name: SomeSubstitutionsType, *, default_value: SomeText | None = None) -> None:
        self.name = name
        self.default_value = default_value

    def perform(self, context: LaunchContext) -> str:
        """Return the value. Raises SubstitutionFailure if there is none, and no default."""
        name = text(context, self.name)
        value = context.environment.get(name)
        if value is not None:
            return value
        if self.default_value is None:
            raise SubstitutionFailure(f"environment variable {name!r} does not exist")
        return text(context, self.default_value)


class PathJoinSubstitution(Substitution):
    """Joined parts of a path, each a text, a substitution or a list of them."""

    def __init__(self, substitutions: Any) -> None:
        self.substitutions = list(substitutions)

    def perform(self, context: LaunchContext) -> str:
        """Return the path."""
        return str(Path(*(text(context, each) for each in self.substitutions)))

    def __truediv__(self, other: SomeSubstitutionsType) -> PathJoinSubstitution:
        return PathJoinSubstitution([*self.substitutions, other])


class PythonExpression(Substitution):
    """Value of a Python expression; `math` and named modules are available."""

    def __init__(
        self, expression: SomeSubstitutionsType, python_modules: SomeSubstitutionsType = ("math",)
    ) -> None:
        self.expression = expression
        self.python_modules = normalize_to_list_of_substitutions(python_modules)

    def perform(self, context: LaunchContext) -> str:
        """Return the value as text. Raises SubstitutionFailure if the expression fails."""
        expression = text(context, self.expression)
        names: dict[str, Any] = {}
        try:
            for each in self.python_modules:
                module = importlib.import_module(text(context, each))
                if module.__name__ == "math":
                    names.update(vars(module))
                names[module.__name__] = module
            return str(eval(expression, {}, names))
        except Exception as error:
            raise SubstitutionFailure(
                f"Python expression {expression!r} fails: {type(error).__name__}: {error}"
            ) from error


class Command(Substitution):
    """Output of a command."""

    def __init__(self, command: SomeSubstitutionsType, *, on_stderr: SomeSubstitutionsType = "fail") -> None:
        self.command = command
        self.on_stderr = on_stderr

    def perform(self, context: LaunchContext) -> str:
        """Run the command. Raises SubstitutionFailure on failure, or output with `on_stderr` "fail"."""
        command = text(context, self.command)
        on_stderr = text(context, self.on_stderr)
        if on_stderr not in ("fail", "ignore", "warn", "capture"):
            raise SubstitutionFailure(f"on_stderr must be fail, ignore, warn or capture, got {on_stderr!r}")
        complaints = subprocess.STDOUT if on_stderr == "capture" else subprocess.PIPE
        try:
            ended = subprocess.run(
                shlex.split(command), stdout=subprocess.PIPE, stderr=complaints, text=True, check=False
            )
        except OSError as error:
            raise SubstitutionFailure(f"command {command!r} cannot be run: {error}") from error
        if ended.returncode or (ended.stderr and on_stderr == "fail"):
            raise SubstitutionFailure(
                f"command {command!r} ended with {ended.returncode} and said: {ended.stderr or ended.stdout}"
            )
        if ended.stderr and on_stderr == "warn":
            get_logger("launch").warning(f"command {command!r} said: {ended.stderr}")
        return ended.stdout


class FindExecutable(Substitution):
    """Path of a program on the PATH."""

    def __init__(self, *, name: SomeSubstitutionsType) -> None:
        self.name = name

    def perform(self, context: LaunchContext) -> str:
        """Return the path. Raises SubstitutionFailure if there is no such program."""
        name = text(context, self.name)
        found = shutil.which(name, path=context.environment.get("PATH"))
        if found is None:
            raise SubstitutionFailure(f"executable {name!r} is not on the PATH")
        return found


class FileContent(Substitution):
    """Content of a file."""

    def __init__(self, path: SomeSubstitutionsType) -> None:
        self.path = path

    def perform(self, context: LaunchContext) -> str:
        """Return the content. Raises SubstitutionFailure if the file cannot be read."""
        path = Path(text(context, self.path))
        try:
            return path.read_text("utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise SubstitutionFailure(f"{path} cannot be read: {error}") from error


class AnonName(Substitution):
    """Unique name from a given one; the same for equal names in one launch."""

    def __init__(self, name: SomeSubstitutionsType) -> None:
        self.name = name

    def perform(self, context: LaunchContext) -> str:
        """Return the name."""
        name = text(context, self.name)
        return str(context.launch_configurations.setdefault(f"anon{name}", f"{name}_{uuid.uuid4().hex}"))


class LocalSubstitution(Substitution):
    """Value of `context.locals`, by a Python expression."""

    def __init__(self, expression: str, description: str | None = None) -> None:
        self.expression = expression

    def perform(self, context: LaunchContext) -> str:
        """Return the value as text."""
        return str(eval(f"context.locals.{self.expression}", {}, {"context": context}))


class ThisLaunchFile(Substitution):
    """Path of the current launch file."""

    def perform(self, context: LaunchContext) -> str:
        """Return the path. Raises SubstitutionFailure outside of a file."""
        path = context.get_locals_as_dict().get("current_launch_file_path")
        if path is None:
            raise SubstitutionFailure("ThisLaunchFile is used outside of a launch file")
        return str(path)


class ThisLaunchFileDir(ThisLaunchFile):
    """Folder of the current launch file."""

    def perform(self, context: LaunchContext) -> str:
        """Return the path. Raises SubstitutionFailure outside of a file."""
        return os.path.dirname(super().perform(context))


class _OfTwo(Substitution):
    """Base of comparisons of two texts."""

    def __init__(self, left: SomeText, right: SomeText) -> None:
        self.left = left
        self.right = right

    def perform(self, context: LaunchContext) -> str:
        """Return `true` or `false`."""
        return str(self._holds(context)).lower()

    def _holds(self, context: LaunchContext) -> bool:
        raise NotImplementedError


class EqualsSubstitution(_OfTwo):
    """True if two strings are equal, as numbers or booleans if both are such."""

    def _holds(self, context: LaunchContext) -> bool:
        left, right = (text(context, each) for each in (self.left, self.right))
        for read in (_as_truth, float):
            try:
                return bool(read(left) == read(right))
            except ValueError:
                continue
        return left == right


def _as_truth(said: str) -> bool:
    return bool(("false", "true").index(said.strip().lower()))


class NotEqualsSubstitution(EqualsSubstitution):
    """True if two strings differ."""

    def _holds(self, context: LaunchContext) -> bool:
        return not super()._holds(context)


class AndSubstitution(_OfTwo):
    """True if both are true."""

    def _holds(self, context: LaunchContext) -> bool:
        return truth(context, self.left) and truth(context, self.right)


class OrSubstitution(_OfTwo):
    """True if one is true."""

    def _holds(self, context: LaunchContext) -> bool:
        return truth(context, self.left) or truth(context, self.right)


class NotSubstitution(Substitution):
    """True if the value is false."""

    def __init__(self, value: SomeText) -> None:
        self.value = value

    def perform(self, context: LaunchContext) -> str:
        """Return `true` or `false`."""
        return str(not truth(context, self.value)).lower()


class AnySubstitution(Substitution):
    """True if any value is true."""

    def __init__(self, *args: SomeText) -> None:
        self.args = args

    def perform(self, context: LaunchContext) -> str:
        """Return `true` or `false`."""
        return str(self._holds([truth(context, each) for each in self.args])).lower()

    def _holds(self, all_of_them: list[bool]) -> bool:
        return any(all_of_them)


class AllSubstitution(AnySubstitution):
    """True if all values are true."""

    def _holds(self, all_of_them: list[bool]) -> bool:
        return all(all_of_them)


class IfElseSubstitution(Substitution):
    """One of two texts, by a condition."""

    def __init__(self, condition: SomeText, if_value: SomeText = "", else_value: SomeText = "") -> None:
        self.condition = condition
        self.values: dict[bool, SomeText] = {True: if_value, False: else_value}

    def perform(self, context: LaunchContext) -> str:
        """Return the text that the condition selects."""
        return text(context, self.values[truth(context, self.condition)])
