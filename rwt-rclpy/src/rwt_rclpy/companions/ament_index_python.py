"""`ament_index_python`: where packages are, among the folders that ``AMENT_PREFIX_PATH`` names or that hold
their source below the root."""

from __future__ import annotations

import os
from pathlib import Path

# Not its names: `ament_index_python.packages`, which is this module, too, takes the name `packages` in it.
from rwt_rclpy import running
from rwt_rclpy.companions.rosidl_runtime_py import get_interface_packages


class PackageNotFoundError(KeyError):
    """No folder of that package is known."""


def _prefixes() -> list[Path]:
    return [Path(each) for each in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if each]


def get_packages_with_prefixes() -> dict[str, str]:
    """Every package with its folder; the packages of interfaces, which have none, with an empty text."""
    found = dict(get_interface_packages())
    for prefix in _prefixes():
        share = prefix / "share"
        for folder in sorted(share.iterdir()) if share.is_dir() else ():
            if (folder / "package.xml").is_file():
                found[folder.name] = str(prefix)
    for package in running.packages(running.root()):
        if not found.get(package.name):
            found[package.name] = str(package.folder.resolve())
    return found


def get_package_prefix(package_name: str) -> str:
    """The folder of a package. Raises PackageNotFoundError, which says where was looked."""
    found = get_packages_with_prefixes().get(package_name)
    if not found:
        raise PackageNotFoundError(
            f"no folder of package {package_name!r} in AMENT_PREFIX_PATH or below {running.root().resolve()}"
        )
    return found


def get_package_share_directory(package_name: str, print_warning: bool = True) -> str:
    """Return the folder of a package: `share/NAME` of an installed one, the source folder of another."""
    prefix = Path(get_package_prefix(package_name))
    share = prefix / "share" / package_name
    return str(share if share.is_dir() else prefix)


def get_package_share_path(package_name: str) -> Path:
    """:func:`get_package_share_directory` as a path."""
    return Path(get_package_share_directory(package_name))


def get_resources(resource_type: str) -> dict[str, str]:
    """Return the resources of a type: packages, and packages of interfaces."""
    if resource_type == "packages":
        return get_packages_with_prefixes()
    return get_interface_packages() if resource_type == "rosidl_interfaces" else {}


def has_resource(resource_type: str, resource_name: str) -> bool:
    """True if the resource is registered."""
    return resource_name in get_resources(resource_type)


def get_resource(resource_type: str, resource_name: str) -> tuple[str, str]:
    """Return a resource and its place. Raises LookupError."""
    found = get_resources(resource_type)
    if resource_name not in found:
        raise LookupError(f"no {resource_type} {resource_name!r} is registered")
    return "", found[resource_name]
