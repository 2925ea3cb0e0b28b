"""`ament_index_python`: folders of packages, in ``AMENT_PREFIX_PATH`` or as
source below the root."""

from __future__ import annotations

import os
from pathlib import Path

# Imported under other names: `ament_index_python.packages` is this module, too.
from rwt_rclpy import running
from rwt_rclpy.companions.rosidl_runtime_py import get_interface_packages


class PackageNotFoundError(KeyError):
    """The package has no known folder."""


def _prefixes() -> list[Path]:
    return [Path(each) for each in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if each]


def get_packages_with_prefixes() -> dict[str, str]:
    """Return all packages with their folders; packages of interfaces have an empty one."""
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
    """Return the folder of a package. Raises PackageNotFoundError with the searched folders."""
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
    """Return :func:`get_package_share_directory` as a path."""
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
    """Return the content of a resource and its folder. Raises LookupError."""
    found = get_resources(resource_type)
    if resource_name not in found:
        raise LookupError(f"no {resource_type} {resource_name!r} is registered")
    return "", found[resource_name]
