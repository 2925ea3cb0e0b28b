"""Open Zenoh session, and the liveliness tokens of this process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import count
from typing import TypeVar

import zenoh

from rwt.extensions.zenoh.rmw.keys import dds_type
from rwt.extensions.zenoh.rmw.tokens import EntityKind, Token, TokenEndpoint, gid_of
from rwt_graph.backend import NodeResources
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType, ServiceType
from rwt_participant.qos import DEFAULT_QOS, QoS

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Presence:
    """Declared liveliness token with its GID."""

    gid: bytes
    _token: zenoh.LivelinessToken
    _own_gids: set[bytes]

    def end(self) -> None:
        self._own_gids.discard(self.gid)
        self._token.undeclare()


class ZenohLink:
    """Open session.

    Attributes:
        id: session id, as in tokens.
        own_gids: GIDs of all entities declared here, to ignore the process's own samples from its caches.
    """

    def __init__(
        self,
        session: zenoh.Session,
        domain: int,
        registry: Registry,
        run_on_graph: Callable[[Callable[[], None]], None],
    ) -> None:
        self._registry = registry
        self.session = session
        self.domain = domain
        self.id = str(session.zid())
        self.run_on_graph = run_on_graph
        self.own_gids: set[bytes] = set()
        self._next = count()
        self._nodes: dict[NodeResources, int] = {}
        self._liveliness = session.liveliness()

    def callback(
        self, function: Callable[[T], None], done: Callable[[], None] | None = None
    ) -> zenoh.handlers.Callback[T]:
        """Return a callback for Zenoh's receiving thread that calls `function` on the graph's thread.

        Args:
            done: called there after the last item.
        """

        def receive(item: T) -> None:
            self.run_on_graph(partial(function, item))

        drop = None if done is None else partial(self.run_on_graph, done)
        return zenoh.handlers.Callback(receive, drop, indirect=False)

    def declare_node(self, owner: NodeResources) -> Presence:
        number = self._node(owner)
        return self._declare(Token(self.domain, self.id, number, number, EntityKind.NODE, owner.name))

    def forget_node(self, owner: NodeResources) -> None:
        """Release the number of a node that left."""
        self._nodes.pop(owner, None)

    def _node(self, owner: NodeResources) -> int:
        number = self._nodes.get(owner)
        if number is None:
            number = self._nodes[owner] = next(self._next)
        return number

    def endpoint(self, name: str, type: MessageType | ServiceType, qos: QoS = DEFAULT_QOS) -> TokenEndpoint:
        """Return a topic or service of this process, as tokens and keys name it."""
        return TokenEndpoint(name, dds_type(self._registry.type_name(type)), type.announced_hash, qos)

    def declare(self, kind: EntityKind, owner: NodeResources, endpoint: TokenEndpoint) -> Presence:
        node, entity = self._node(owner), next(self._next)
        return self._declare(Token(self.domain, self.id, node, entity, kind, owner.name, endpoint))

    def _declare(self, token: Token) -> Presence:
        key = token.key()
        gid = gid_of(key)
        self.own_gids.add(gid)
        return Presence(gid, self._liveliness.declare_token(key), self.own_gids)
