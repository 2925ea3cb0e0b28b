"""What a service reveals of the graph, declared where the service is, so that a policy can read it as data.

A declaration is a tuple of these; the empty tuple reveals nothing of the robot (types, time, versions). A
service without a declaration is one whose answers have not been considered.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

Kind = Literal["topic", "service", "action", "node", "parameter"]
"""What a name in a request or a response names."""


@dataclass(frozen=True, slots=True)
class Lists:
    """The response lists names.

    Attributes:
        kind: what they name.
        fields: response fields aligned by index, the first of which holds the names; or one field that holds
            a single name.
        of_node: whether the names are those of parameters of the service's own node, without its name before
            them; the field is then a path such as ``result.names``.
    """

    kind: Kind
    fields: tuple[str, ...]
    of_node: bool = False


@dataclass(frozen=True, slots=True)
class AsksAbout:
    """The request asks about one name; about a hidden one the answer is that of a name that does not exist.

    Attributes:
        kind: what it names.
        field: of the request.
    """

    kind: Kind
    field: str


@dataclass(frozen=True, slots=True)
class ListsProviders:
    """The response lists the nodes that offer a service, which the request names or whose type it names.

    Attributes:
        field: of the request.
        lists: field of the response.
    """

    field: str
    lists: str


@dataclass(frozen=True, slots=True)
class Reads:
    """The request reads parameters: of rosapi one full name, of a node's own service a list of names.

    Attributes:
        field: of the request.
    """

    field: str


@dataclass(frozen=True, slots=True)
class Writes:
    """The request writes or deletes parameters; as :class:`Reads`.

    Attributes:
        field: of the request.
    """

    field: str


Disclosure = tuple[Lists | ListsProviders | AsksAbout | Reads | Writes, ...]
"""All that one service reveals and changes."""

NOTHING: Final[Disclosure] = ()
"""Of services that reveal nothing of the robot."""
