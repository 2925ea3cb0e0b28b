"""Execution of ROS 2 programs: a file, a module, or an executable of a package's source."""

from __future__ import annotations

import ast
import importlib
import os
import re
import runpy
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rwt_interfaces.definitions.package_directories import package_name
from rwt_participant.errors import RobotError
from rwt_rclpy.modules import MODULES


class CannotRun(RobotError):
    """The program does not exist; the text names it and the searched folders."""


def run_file(path: Path, arguments: Sequence[str]) -> None:
    """Run a file like `python FILE ARGUMENTS…`.

    Raises:
        CannotRun: there is no such file.
    """
    if not path.is_file():
        raise CannotRun(f"{path}: no such file; give a Python file, or a package and one of its executables")
    sys.argv = [str(path), *arguments]
    sys.path.insert(0, str(path.resolve().parent))
    runpy.run_path(str(path), run_name="__main__")


def run_program(program: Sequence[str]) -> None:
    """Run the program of a command line: a file, or a package below :func:`root` and an executable.

    Raises:
        CannotRun: there is no such program.
    """
    first = Path(program[0])
    if first.suffix == ".py" or first.is_file():
        run_file(first, program[1:])
    elif len(program) > 1:
        run_executable(program[0], program[1], program[2:], root())
    else:
        raise CannotRun(f"{first}: no such file; after the name of a package give one of its executables")


def run_module(name: str, arguments: Sequence[str]) -> None:
    """Run a module like `python -m NAME ARGUMENTS…`."""
    sys.argv = [name, *arguments]
    runpy.run_module(name, run_name="__main__", alter_sys=True)


#: Variable with the root of packages, inherited by started programs.
_ROOT: Final = "RWT_RCLPY_ROOT"
#: Variable with the folders of interfaces, for started processes.
_INTERFACES: Final = "RWT_RCLPY_INTERFACES"


def root() -> Path:
    """Return the root of packages: RWT_RCLPY_ROOT, or the current folder."""
    return Path(os.environ.get(_ROOT) or ".")


def use_root(folder: Path) -> None:
    """Set the root of packages, also for started programs."""
    os.environ[_ROOT] = str(folder.resolve())


def interface_folders(given: Sequence[str]) -> list[str]:
    """Add folders of interfaces to the inherited ones, also for started programs; return all."""
    before = [each for each in os.environ.get(_INTERFACES, "").split(os.pathsep) if each]
    folders = [*before, *(each for each in map(os.path.abspath, given) if each not in before)]
    if folders:
        os.environ[_INTERFACES] = os.pathsep.join(folders)
    return folders


@dataclass(frozen=True, slots=True)
class Executable:
    """Program that `ros2 run` would start.

    Attributes:
        name: name.
        function: ``module:function`` of a console script; empty for a file.
        file: file of the program, if it is one.
    """

    name: str
    function: str = ""
    file: Path | None = None


@dataclass(frozen=True, slots=True)
class Package:
    """Source of a package: a folder with a ``package.xml`` or a ``setup.py``."""

    folder: Path

    @property
    def name(self) -> str:
        """Name of the package from its manifest, ``setup.py`` or folder."""
        if (self.folder / "package.xml").is_file():
            return package_name(self.folder)
        named = _argument(self.folder / "setup.py", "name")
        return named if isinstance(named, str) else self.folder.name

    @property
    def executables(self) -> dict[str, Executable]:
        """Return the console scripts of ``setup.py``, and the programs that ``CMakeLists.txt`` installs."""
        setup = self.folder / "setup.py"
        scripts = console_scripts(setup) if setup.is_file() else {}
        found = {name: Executable(name, function) for name, function in scripts.items()}
        for group in _PROGRAMS.findall(self._cmake):
            for path in group.split():
                file = self.folder / path.strip('"')
                found[file.name] = Executable(file.name, file=file)
        return found

    @property
    def python_folder(self) -> Path:
        """Folder on Python's path from which its modules are imported."""
        found = _PYTHON_PACKAGE.search(self._cmake)
        if found is None:
            return self.folder
        inner = (found[2] or found[1]).replace("${PROJECT_NAME}", self.name)
        return (self.folder / inner).parent

    @property
    def _cmake(self) -> str:
        file = self.folder / "CMakeLists.txt"
        return file.read_text("utf-8", errors="replace") if file.is_file() else ""


_PROGRAMS: Final = re.compile(r"install\s*\(\s*PROGRAMS\s+([^)]*?)\s+DESTINATION\s")
_PYTHON_PACKAGE: Final = re.compile(
    r'ament_python_install_package\s*\(\s*"?([^\s")]+)"?(?:\s+PACKAGE_DIR\s+"?([^\s")]+)"?)?'
)


def packages(root: Path) -> Iterator[Package]:
    """Return the packages below a folder, without hidden folders."""
    for folder, folders, files in os.walk(root):
        folders[:] = sorted(each for each in folders if not each.startswith(".") and each != "node_modules")
        if "package.xml" in files or "setup.py" in files:
            yield Package(Path(folder))


def find_executable(package: str, executable: str, root: Path) -> Executable:
    """Return an executable of a package below a folder.

    Raises:
        CannotRun: there is no such package or executable.
    """
    for found in packages(root):
        if found.name != package:
            continue
        known = found.executables
        if executable not in known:
            names = ", ".join(sorted(known)) or "none"
            raise CannotRun(
                f"package {package} in {found.folder} has no executable {executable!r} in Python; it has"
                f" {names}. One in C++ runs on a machine with ROS, which joins over Zenoh or rosbridge"
            )
        return known[executable]
    raise CannotRun(f"no package {package!r} with a package.xml or setup.py below {root.resolve()}")


def run_executable(package: str, executable: str, arguments: Sequence[str], root: Path) -> None:
    """Run an executable like `ros2 run PACKAGE EXECUTABLE`, from the package's source.

    The modules of the other packages below the folder can be imported, as in a workspace that is built, but
    for those that are here: the source of `tf2_ros` would ask for C++ that nobody has built.

    Args:
        package: name of a package below `root`.
        executable: a console script, or an installed program.
        arguments: command line of the program.
        root: root of packages.

    Raises:
        CannotRun: there is no such package or executable.
    """
    found = find_executable(package, executable, root)
    own_first = sorted(packages(root), key=lambda each: each.name != package)
    sys.path[:0] = [
        str(each.python_folder.resolve()) for each in own_first if each.name == package or not _is_here(each)
    ]
    if found.file is not None:
        run_file(found.file, arguments)
        return
    module, _, function = found.function.partition(":")
    sys.argv = [executable, *arguments]
    outcome = getattr(importlib.import_module(module), function)()
    if outcome:
        raise SystemExit(outcome)


def _is_here(package: Package) -> bool:
    """True if the source of a package has modules with the name of a module of this project."""
    names = {each.partition(".")[0] for each in MODULES}
    return any((package.python_folder / name / "__init__.py").is_file() for name in names)


def is_python(file: Path) -> bool:
    """True if a file is a program in Python, by its name or its first line."""
    if file.suffix == ".py" or not file.is_file():
        return file.suffix == ".py"
    with file.open("rb") as opened:
        first = opened.readline(200)
    return first.startswith(b"#!") and b"python" in first


def _call_of_setup(setup: Path) -> tuple[ast.Call | None, dict[str, ast.expr]]:
    """Return the call of `setup(…)` in a file, and the values of its variables."""
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
    """Return an argument of `setup()` in a file, without running the file; None if it is not a constant."""
    call, variables = _call_of_setup(setup)
    for keyword in [] if call is None else call.keywords:
        if keyword.arg != name:
            continue
        try:
            return _plain(keyword.value, variables, _MOST_NESTED)
        except ValueError:
            return None
    return None


#: Maximum nesting of an argument of `setup()`.
_MOST_NESTED = 30


def _plain(value: ast.expr, variables: dict[str, ast.expr], depth: int) -> object:
    """Return the value of an expression of constants and names of constants, without executing it.

    Raises:
        ValueError: the expression has other parts.
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


def console_scripts(setup: Path) -> dict[str, str]:
    """Return the executables of a ``setup.py``, each with its ``module:function``."""
    points = _argument(setup, "entry_points")
    lines = points.get("console_scripts", []) if isinstance(points, dict) else []
    pairs = (line.partition("=") for line in lines if isinstance(line, str))
    return {name.strip(): target.strip() for name, _, target in pairs}
