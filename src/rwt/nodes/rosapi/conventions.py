"""Differences between the rosapi of the ROS distributions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True, kw_only=True)
class Conventions:
    """rosapi of one distribution.

    Attributes:
        package: package of the service types.
        has_version: True if `get_ros_version` is offered. Clients recognise ROS 1 by its absence.
        has_idl_names: True if scalars have the names of IDL (API-04).
        reports_failures: True if responses about parameters have ``successful`` and ``reason``. Otherwise the
            call fails.
        fails_for_unknown_nodes: True if ``node_details`` fails for an unknown node. Otherwise its lists are
            empty (API-14).
    """

    package: str
    has_version: bool
    has_idl_names: bool
    reports_failures: bool
    fails_for_unknown_nodes: bool


CONVENTIONS: Final[Mapping[str, Conventions]] = {
    "jazzy": Conventions(
        package="rosapi_msgs",
        has_version=True,
        has_idl_names=True,
        reports_failures=True,
        fails_for_unknown_nodes=True,
    ),
    "noetic": Conventions(
        package="rosapi",
        has_version=False,
        has_idl_names=False,
        reports_failures=False,
        fails_for_unknown_nodes=False,
    ),
}
"""Conventions by the name of the distribution."""
