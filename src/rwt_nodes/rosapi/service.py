"""A row of the tables of services in this folder."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rwt_graph.disclosure import Disclosure
    from rwt_graph.program.node import Node

Answer = dict[str, object]
"""The fields of a response."""


@dataclass(frozen=True, slots=True)
class Service:
    """One service.

    Attributes:
        name: below ``/rosapi/``.
        type: of the distribution's package of rosapi, without the package.
        handler: makes the answer of the node to a request.
        reveals: what a client learns and changes by it. There is no default: a service that reveals nothing
            of the robot says so, with :data:`rwt_graph.disclosure.NOTHING`.
    """

    name: str
    type: str
    handler: Callable[[Node, Any], Answer | Awaitable[Answer]]
    reveals: Disclosure
