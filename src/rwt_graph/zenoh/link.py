"""An open session, and what this process declares over it: who we are on the wire."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING

from rwt_graph.zenoh.rmw.gid import gid_of
from rwt_graph.zenoh.rmw.tokens import Endpoint, Kind, Token

if TYPE_CHECKING:
    import zenoh

    from rwt_graph.memory.node_resources import Owner
    from rwt_graph.zenoh.session import RunOnGraph


class NodeNumbers:
    """The numbers that tell the nodes and entities of a session apart."""

    def __init__(self) -> None:
        self._next = count()
        self._nodes: dict[Owner, int] = {}

    def entity(self) -> int:
        """A new one."""
        return next(self._next)

    def node(self, owner: Owner) -> int:
        """That of a node; given at the first question."""
        number = self._nodes.get(owner)
        if number is None:
            number = self._nodes[owner] = self.entity()
        return number

    def forget(self, owner: Owner) -> None:
        """The node is gone."""
        self._nodes.pop(owner, None)


@dataclass(frozen=True, slots=True)
class Presence:
    """A declared token and the GID that goes with it."""

    gid: bytes
    _token: zenoh.LivelinessToken
    _own_gids: set[bytes]

    def end(self) -> None:
        """Be known no more."""
        self._own_gids.discard(self.gid)
        self._token.undeclare()


class Link:
    """One open session.

    Attributes:
        id: the session's, as tokens write it.
        own_gids: of every entity declared here; Zenoh's caches give us our own samples back.
    """

    def __init__(
        self, session: zenoh.Session, domain: int, numbers: NodeNumbers, run_on_graph: RunOnGraph
    ) -> None:
        self.session = session
        self.domain = domain
        self.id = str(session.zid())
        self.run_on_graph = run_on_graph
        self.own_gids: set[bytes] = set()
        self._numbers = numbers
        self._liveliness = session.liveliness()

    def count_others(self) -> int:
        """How many peers and routers this process is connected to."""
        info = self.session.info
        return len(info.peers_zid()) + len(info.routers_zid())

    def declare_node(self, owner: Owner) -> Presence:
        """Make a node known."""
        number = self._numbers.node(owner)
        return self._declare(Token(self.domain, self.id, number, number, Kind.NODE, owner.name))

    def declare(self, kind: Kind, owner: Owner, endpoint: Endpoint) -> Presence:
        """Make an endpoint of a node known."""
        node, entity = self._numbers.node(owner), self._numbers.entity()
        return self._declare(Token(self.domain, self.id, node, entity, kind, owner.name, endpoint))

    def _declare(self, token: Token) -> Presence:
        key = token.key()
        gid = gid_of(key)
        self.own_gids.add(gid)
        return Presence(gid, self._liveliness.declare_token(key), self.own_gids)


__all__ = ["Link", "NodeNumbers", "Presence"]
