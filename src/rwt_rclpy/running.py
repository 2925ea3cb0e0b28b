"""Running programs that were written for ROS 2: a file, a module, or an executable of a package's source."""

from __future__ import annotations

import ast
import importlib
import os
import runpy
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from rwt_program.errors import RobotError


class CannotRun(RobotError):
    """There is no such program; says what was looked for and where."""


def run_file(path: Path, arguments: Sequence[str]) -> None:
    """Run a file as `python FILE ARGUMENTS…` does.

    Raises:
        CannotRun: there is no such file.
    """
    if not path.is_file():
        raise CannotRun(f"{path}: no such file; give a Python file, or a package and one of its executables")
    sys.argv = [str(path), *arguments]
    sys.path.insert(0, str(path.resolve().parent))
    runpy.run_path(str(path), run_name="__main__")


def run_module(name: str, arguments: Sequence[str]) -> None:
    """Run a module as `python -m NAME ARGUMENTS…` does."""
    sys.argv = [name, *arguments]
    runpy.run_module(name, run_name="__main__", alter_sys=True)


def run_executable(package: str, executable: str, arguments: Sequence[str], root: Path) -> None:
    """Run an executable as `ros2 run PACKAGE EXECUTABLE` does, from the package's source.

    Args:
        package: the name of a package with a ``setup.py`` below `root`.
        executable: one of its console scripts.
        arguments: the command line of the program.
        root: where packages are looked for.

    Raises:
        CannotRun: there is no such package or executable.
    """
    for setup in setup_files(root):
        if _name(setup) != package:
            continue
        scripts = console_scripts(setup)
        if executable not in scripts:
            known = ", ".join(sorted(scripts)) or "none"
            raise CannotRun(
                f"package {package} in {setup.parent} has no executable {executable!r}; it has {known}"
            )
        module, _, function = scripts[executable].partition(":")
        sys.path.insert(0, str(setup.parent))
        sys.argv = [executable, *arguments]
        outcome = getattr(importlib.import_module(module), function)()
        if outcome:
            raise SystemExit(outcome)
        return
    raise CannotRun(f"no package {package!r} with a setup.py below {root.resolve()}")


def setup_files(root: Path) -> Iterator[Path]:
    """Every ``setup.py`` below a folder; hidden folders are not entered."""
    for folder, folders, files in os.walk(root):
        folders[:] = sorted(each for each in folders if not each.startswith(".") and each != "node_modules")
        if "setup.py" in files:
            yield Path(folder) / "setup.py"


def _call_of_setup(setup: Path) -> tuple[ast.Call | None, dict[str, ast.expr]]:
    """The call of `setup(…)` in a file, and what its variables are given."""
    tree = ast.parse(setup.read_text("utf-8"), str(setup))
    variables = {
        target.id: node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) == "setup":
            return node, variables
    return None, variables


def _argument(setup: Path, name: str) -> object:
    """What a file gives `setup()` for an argument, without running the file; None when it is not plain."""
    call, variables = _call_of_setup(setup)
    for keyword in [] if call is None else call.keywords:
        if keyword.arg != name:
            continue
        try:
            return _plain(keyword.value, variables, _MOST_NESTED)
        except ValueError:
            return None
    return None


#: How deep an argument of `setup()` may be nested to be read.
_MOST_NESTED = 30


def _plain(value: ast.expr, variables: dict[str, ast.expr], depth: int) -> object:
    """What an expression of constants and of names that are given constants comes to; nothing is run.

    Raises:
        ValueError: it is of anything else.
    """
    if depth == 0:
        raise ValueError("nested too deep")
    below = depth - 1
    match value:
        case ast.Constant():
            return value.value
        case ast.Name() if value.id in variables:
            return _plain(variables[value.id], variables, below)
        case ast.List() | ast.Tuple():
            return [_plain(each, variables, below) for each in value.elts]
        case ast.Dict():
            return {
                _plain(key, variables, below): _plain(each, variables, below)
                for key, each in zip(value.keys, value.values, strict=True)
                if key is not None
            }
        case ast.BinOp(op=ast.Add()):
            left, right = (_plain(each, variables, below) for each in (value.left, value.right))
            if isinstance(left, str) and isinstance(right, str):
                return left + right
            if isinstance(left, list) and isinstance(right, list):
                return left + right
        case ast.JoinedStr():
            return "".join(str(_plain(each, variables, below)) for each in value.values)
        case ast.FormattedValue():
            return _plain(value.value, variables, below)
    raise ValueError(f"{ast.dump(value)[:80]} is not plain")


def _name(setup: Path) -> str:
    name = _argument(setup, "name")
    return name if isinstance(name, str) else setup.parent.name


def console_scripts(setup: Path) -> dict[str, str]:
    """The executables that a ``setup.py`` names, each with its ``module:function``."""
    points = _argument(setup, "entry_points")
    lines = points.get("console_scripts", []) if isinstance(points, dict) else []
    pairs = (line.partition("=") for line in lines if isinstance(line, str))
    return {name.strip(): target.strip() for name, _, target in pairs}
