"""Declarations of what a service reveals of the graph, as data for access policies.

A declaration is a tuple of these; the empty tuple reveals nothing of the robot (types, time, versions). A
service without a declaration has not been assessed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

Kind = Literal["topic", "service", "action", "node", "parameter"]
"""Kind of a name in a request or a response."""


@dataclass(frozen=True, slots=True)
class Lists:
    """Disclosure of names in the response.

    Attributes:
        fields: response fields aligned by index, the first of which holds the names; or one field that holds
            a single name.
        of_node: True if the names are parameters of the service's own node, without the node's name as
            prefix; the field is then a path such as ``result.names``.
    """

    kind: Kind
    fields: tuple[str, ...]
    of_node: bool = False


@dataclass(frozen=True, slots=True)
class AsksAbout:
    """Request about one name; for a hidden one, the response is that for an unknown name."""

    kind: Kind
    field: str


@dataclass(frozen=True, slots=True)
class ListsProviders:
    """Disclosure of the nodes that offer a service; the request names the service or its type."""

    field: str
    lists: str


@dataclass(frozen=True, slots=True)
class Reads:
    """Request that reads parameters: one full name for rosapi, a list of names for a node's own service."""

    field: str


@dataclass(frozen=True, slots=True)
class Writes:
    """Request that writes or deletes parameters; as :class:`Reads`.

    Attributes:
        json: field with the value as JSON text; empty if the request has none.
    """

    field: str
    json: str = ""


Disclosure = tuple[Lists | ListsProviders | AsksAbout | Reads | Writes, ...]
"""Everything that one service reveals and changes."""

NOTHING: Final[Disclosure] = ()
"""Disclosure of services that reveal nothing of the robot."""
