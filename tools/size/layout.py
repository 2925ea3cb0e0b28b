"""Packages of the project, as pyproject.toml lists them for the wheels."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]


def wheel_packages(project: Path) -> dict[str, Path]:
    """Return the folders of the packages in the wheel of a project, by the name of the package."""
    tools = tomllib.loads(project.read_text(encoding="utf-8")).get("tool", {})
    wheel = tools.get("hatch", {}).get("build", {}).get("targets", {}).get("wheel", {})
    listed = wheel.get("packages") or [init.parent for init in project.parent.glob("src/*/__init__.py")]
    return {folder.name: folder for folder in (project.parent / each for each in listed)}


@dataclass(frozen=True)
class Layout:
    """Folders of the packages.

    Attributes:
        root: folder with the project's pyproject.toml.
    """

    root: Path = ROOT

    @cached_property
    def wheel(self) -> tuple[str, ...]:
        """Names of the top-level packages in the project's wheel."""
        return tuple(sorted(wheel_packages(self.root / "pyproject.toml")))

    @cached_property
    def projects(self) -> Mapping[str, Mapping[str, Path]]:
        """Packages of each distribution: of the project itself, and of those in folders ``rwt-*``."""
        files = (self.root / "pyproject.toml", *sorted(self.root.glob("rwt-*/pyproject.toml")))
        return {str(each.parent.relative_to(self.root)): wheel_packages(each) for each in files}

    @cached_property
    def packages(self) -> Mapping[str, Path]:
        """Packages of all distributions."""
        return {name: folder for project in self.projects.values() for name, folder in project.items()}

    @cached_property
    def tests(self) -> tuple[Path, ...]:
        """Folders of tests."""
        return tuple(filter(Path.is_dir, (self.root / each / "tests" for each in self.projects)))

    def environment(self) -> dict[str, str]:
        """Return an environment for processes that import the packages of this checkout, with no settings."""
        kept = {name: value for name, value in os.environ.items() if not name.startswith("RWT_")}
        folders = {str(folder.parent): None for folder in self.packages.values()}
        path = [*folders, str(self.root), *filter(None, [kept.get("PYTHONPATH")])]
        return {**kept, "PYTHONPATH": os.pathsep.join(path)}


def source_files(packages: Mapping[str, Path]) -> Iterator[tuple[str, Path]]:
    """Yield the dotted name and the file of each module; a package is the module of its ``__init__.py``."""
    for package, folder in packages.items():
        for path in sorted(folder.rglob("*.py")):
            parts = (package, *path.relative_to(folder).with_suffix("").parts)
            yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts), path


def within(path: str, folders: Iterable[Path]) -> bool:
    """Return true if the file lies in one of the folders."""
    return any(Path(path).is_relative_to(folder) for folder in folders)
