"""The list of suites, and whether one can be run here."""

from __future__ import annotations

import importlib.util
import shutil
import sys
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final, Literal

import msgspec

HERE: Final = Path(__file__).parent
LIST: Final = HERE / "suites.toml"
#: The packages of modules that have another name.
_PACKAGES: Final = {"PIL": "pillow", "bson": "pymongo", "rwt_rclpy": "rwt-rclpy"}


class CannotRun(Exception):
    """A suite cannot be run. The text says what is missing and how to get it."""


class Suite(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One suite of `suites.toml`, whose head explains the fields."""

    title: str
    repository: str
    tried: str
    tools: tuple[str, ...] = ()
    python: tuple[str, ...] = ()
    checkout: tuple[str, ...] = ()
    ready: str = ""
    serve: tuple[str, ...] | None = None
    port: int = 0
    beside: dict[str, tuple[str, ...]] = {}
    each: str = ""
    run: tuple[str, ...] = ()
    environment: dict[str, str] = {}
    results: Literal["junit", "go", "exit"] = "exit"
    reports: str = ""
    expected_failures: dict[str, str] = {}
    sometimes: dict[str, str] = {}
    apart: dict[str, str] = {}
    by_hand: str = ""


def read_suites(file: Path = LIST) -> dict[str, Suite]:
    """Every suite by its name.

    Raises:
        CannotRun: the list is not what it should be.
    """
    try:
        return msgspec.convert(tomllib.loads(file.read_text("utf-8")), dict[str, Suite])
    except (OSError, tomllib.TOMLDecodeError, msgspec.ValidationError) as error:
        raise CannotRun(f"{file}: {error}") from error


def check(name: str, suite: Suite, checkout: Path | None, beside: Mapping[str, Path]) -> None:
    """Check that a suite can be run.

    Raises:
        CannotRun: it cannot.
    """
    if suite.by_hand:
        raise CannotRun(f"{name} cannot be run by a command. {suite.by_hand}")
    if suite.checkout:
        if checkout is None:
            raise CannotRun(f"{name} needs a checkout of {suite.repository}: name its folder with --checkout")
        _check_folder(checkout, suite.checkout, suite.repository, suite.ready)
    for other, files in suite.beside.items():
        if other not in beside:
            raise CannotRun(f"{name} needs a checkout of {other} too: --beside {other}=DIR")
        _check_folder(beside[other], files, other, "nothing")
    unknown = beside.keys() - suite.beside.keys()
    if unknown:
        wanted = ", ".join(suite.beside) or "none"
        raise CannotRun(f"{name} takes no {', '.join(sorted(unknown))} beside it; it takes {wanted}")
    for tool in suite.tools:
        if shutil.which(tool) is None:
            raise CannotRun(f"{name} needs the program {tool}, which is not on the PATH")
    missing = missing_packages(suite.python)
    if missing:
        raise CannotRun(f"{name} needs Python packages that are not installed: {install_line(missing)}")


def missing_packages(modules: Iterable[str]) -> tuple[str, ...]:
    """The packages, by the names that pip takes, of the modules that cannot be imported here."""
    return tuple(_PACKAGES.get(each, each) for each in modules if importlib.util.find_spec(each) is None)


def install_line(packages: Iterable[str]) -> str:
    """The command that installs packages into this Python."""
    return f"{sys.executable} -m pip install {' '.join(packages)}"


def _check_folder(folder: Path, files: tuple[str, ...], repository: str, ready: str) -> None:
    if not folder.is_dir():
        raise CannotRun(f"{folder}: no such folder; it should be a checkout of {repository}")
    missing = [each for each in files if not (folder / each).exists()]
    if missing:
        raise CannotRun(
            f"{folder}: has no {', '.join(missing)}. A checkout of {repository} has it after: {ready}"
        )
