"""`launch_ros.substitutions`: folders and files of packages."""

from __future__ import annotations

from rwt_rclpy.companions.ament_index_python import (
    PackageNotFoundError,
    get_package_prefix,
    get_package_share_directory,
)
from rwt_rclpy.launch.entities import LaunchContext, SomeSubstitutionsType, Substitution, text
from rwt_rclpy.launch.substitutions import PathJoinSubstitution, SubstitutionFailure
from rwt_rclpy.running import CannotRun, find_executable, root


class FindPackagePrefix(Substitution):
    """Folder of a package: its installation prefix, or its source."""

    def __init__(self, package: SomeSubstitutionsType) -> None:
        self.package = package

    def perform(self, context: LaunchContext) -> str:
        """Return the path. Raises SubstitutionFailure if there is no such package."""
        try:
            return self._find(text(context, self.package))
        except PackageNotFoundError as error:
            raise SubstitutionFailure(str(error.args[0])) from None

    def _find(self, package: str) -> str:
        return get_package_prefix(package)

    def __truediv__(self, other: SomeSubstitutionsType) -> PathJoinSubstitution:
        return PathJoinSubstitution([self, other])


FindPackage = FindPackagePrefix


class FindPackageShare(FindPackagePrefix):
    """Folder of a package's files: `share/NAME` of an installed one, the source folder of another."""

    def _find(self, package: str) -> str:
        return get_package_share_directory(package)


class ExecutableInPackage(Substitution):
    """File of an executable of a package."""

    def __init__(self, executable: SomeSubstitutionsType, package: SomeSubstitutionsType) -> None:
        self.executable = executable
        self.package = package

    def perform(self, context: LaunchContext) -> str:
        """Return the path. Raises SubstitutionFailure if there is none, or it is not a separate file."""
        package, executable = text(context, self.package), text(context, self.executable)
        try:
            found = find_executable(package, executable, root())
        except CannotRun as error:
            raise SubstitutionFailure(str(error)) from None
        if found.file is None:
            raise SubstitutionFailure(
                f"{executable} of {package} is a console script, which is a file only where it is installed;"
                f" start it by Node(package={package!r}, executable={executable!r})"
            )
        return str(found.file)
