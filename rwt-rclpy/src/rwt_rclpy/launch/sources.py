"""`launch.launch_description_sources`: sources of launch descriptions."""

from __future__ import annotations

import runpy
from pathlib import Path

from rwt_rclpy.companions.ament_index_python import PackageNotFoundError, get_package_share_directory
from rwt_rclpy.launch.entities import (
    LaunchContext,
    LaunchDescription,
    LaunchError,
    SomeSubstitutionsType,
    text,
)

#: Function of a launch file that returns its description.
_FUNCTION = "generate_launch_description"


def find_launch_file(first: str, second: str | None = None) -> Path:
    """Return a launch file by its path, or by package and file name, anywhere in the package.

    Raises:
        LaunchError: there is no such package or file, or several of that name.
    """
    if second is None:
        return Path(first)
    try:
        folder = Path(get_package_share_directory(first))
    except PackageNotFoundError as error:
        raise LaunchError(str(error.args[0])) from None
    found = sorted(folder.rglob(second))
    if len(found) != 1:
        there = sorted(each.name for each in folder.rglob("*launch*.py"))
        raise LaunchError(
            f"package {first} in {folder} has {len(found) or 'no'} files {second!r}; its launch files are"
            f" {', '.join(there) or 'none'}"
        )
    return found[0]


def description_of_file(path: Path) -> LaunchDescription:
    """Return the description of a launch file in Python.

    Raises:
        LaunchError: the file is not valid; the text gives the reason.
        Exception: exception of the file's own code.
    """
    if not path.is_file():
        raise LaunchError(f"{path}: no such launch file")
    if path.suffix != ".py":
        raise LaunchError(
            f"{path}: only launch files in Python are read here; write it as one, with {_FUNCTION}()"
        )
    function = runpy.run_path(str(path), run_name="launch_file").get(_FUNCTION)
    if not callable(function):
        raise LaunchError(f"{path}: a launch file has a function {_FUNCTION}(), and this one has none")
    description = function()
    if not isinstance(description, LaunchDescription):
        raise LaunchError(f"{path}: {_FUNCTION}() gave {description!r}; it must give a LaunchDescription")
    return description


class LaunchDescriptionSource:
    """Source with a given description.

    Attributes:
        location: path of its file.
    """

    def __init__(
        self, launch_description: LaunchDescription | None = None, location: SomeSubstitutionsType = ""
    ) -> None:
        self._description = launch_description
        self._location = location
        self.location = str(location) if isinstance(location, (str, Path)) else ""

    def get_launch_description(self, context: LaunchContext) -> LaunchDescription:
        """Return the description, which is read once. Raises LaunchError."""
        self.location = text(context, self._location)
        if self._description is None:
            self._description = description_of_file(Path(self.location))
        return self._description


class PythonLaunchDescriptionSource(LaunchDescriptionSource):
    """Source: a launch file in Python."""

    def __init__(self, launch_file_path: SomeSubstitutionsType) -> None:
        super().__init__(None, launch_file_path)


class AnyLaunchDescriptionSource(PythonLaunchDescriptionSource):
    """Source: a launch file in Python; XML and YAML are not supported."""
