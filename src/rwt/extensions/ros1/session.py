"""Common state of the nodes of one graph on ROS 1: sockets, address, master."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import anyio

from rwt.extensions.ros1.node import Ros1Node
from rwt.extensions.ros1.registrar import Registrar
from rwt.extensions.ros1.wire import rpc
from rwt.extensions.ros1.wire.network import Network
from rwt.extensions.ros1.wire.types import WireTypes
from rwt_graph.errors import Ros1Error

if TYPE_CHECKING:
    from rwt.extensions.ros1.wire.addresses import Address
    from rwt.extensions.ros1.wire.xmlrpc import Value
    from rwt_graph.backend import DistributedGraph, NodeResources

logger = logging.getLogger(__name__)

#: Part of the reason with which a master shuts down a node whose name a newer one has registered.
_NAME_TAKEN: Final = "new node registered with same name"

#: Maximum different warnings about other programs, and seconds between those beyond.
_MOST_WARNINGS: Final = 50
_WARNING_SECONDS: Final = 1.0

#: Seconds between attempts to connect publishers.
_ATTEMPT_SECONDS: Final = 0.002


class Session:
    """Membership of one graph in ROS 1.

    Attributes:
        master: URI of the master.
        address: address of this process.
        nodes: nodes of this process that ROS 1 sees, by the name that this process uses.
        has_master: False while the master does not answer; None before the first answer.
        monitor: node without registrations, which asks the master and follows the parameters.
        on_forgotten: called when the master has lost the registrations.
        on_parameter: called with key and value of a parameter that another node has changed.
    """

    def __init__(self, graph: DistributedGraph, master: str, address: Address) -> None:
        self.graph = graph
        self.run_on_graph = graph.run_on_graph
        self.master = master
        self.address = address
        self.network = Network(graph)
        self._warnings: dict[str, None] = {}
        self._next_warning = self._next_attempt = 0.0
        self.types = WireTypes(graph.registry)
        self.nodes: dict[str, Ros1Node] = {}
        self.registrar = Registrar(self)
        self.monitor = Ros1Node(self, f"/rwt_graph_{os.getpid()}")
        self.has_master: bool | None = None
        self.on_forgotten: Callable[[], None] = self.registrar.repeat
        self.on_parameter: Callable[[str, Value], None] = lambda _key, _value: None

    # Nodes

    def node_of(self, owner: NodeResources) -> Ros1Node:
        """Return the node of a participant, made on first use; participants of one name are one node."""
        node = self.nodes.get(owner.name)
        if node is None:
            node = self.nodes[owner.name] = Ros1Node(self, owner.name)
            node.spawn(node.keep_opening, f"node {owner.name} on ROS 1")
        return node

    def own_uris(self) -> set[str]:
        """Return the addresses of the nodes of this process."""
        return {node.uri for node in self.nodes.values()}

    def own_names(self) -> set[str]:
        """Return the names of the nodes of this process on ROS 1."""
        return {node.name for node in self.nodes.values()}

    def on_shutdown(self, node: Ros1Node, caller: str, reason: str) -> None:
        """Take a node off ROS 1, as `rosnode kill` requests; rename it if a newer one has taken its name."""
        if _NAME_TAKEN in reason and not node.is_renamed:
            name = node.name
            node.rename()
            logger.warning(
                "another node %s was started on ROS 1; this one is called %s there now", name, node.name
            )
            self.registrar.repeat_of(node)
            return
        logger.warning(
            "node %s leaves ROS 1, as %s requested; start it again with another name if a node took its name",
            node.name,
            caller[:200],
        )
        node.is_evicted = True
        for registration in tuple(self.registrar.confirmed):
            if registration.node is node:
                self.registrar.remove(registration)

    def sweep(self) -> None:
        """Close connections of peers that are silent."""
        for node in (self.monitor, *self.nodes.values()):
            node.sweep()

    async def wait_to_connect(self) -> None:
        """Wait until another publisher may be connected: many at once would hold the event loop."""
        now = time.monotonic()
        self._next_attempt = max(now, self._next_attempt + _ATTEMPT_SECONDS)
        if self._next_attempt > now:
            await anyio.sleep(self._next_attempt - now)

    def warn_once(self, text: str) -> None:
        """Log a text, unless it was logged lately, or others fill the log."""
        if text in self._warnings:
            return
        now = time.monotonic()
        if len(self._warnings) >= _MOST_WARNINGS:
            if now < self._next_warning:
                return
            del self._warnings[next(iter(self._warnings))]
        self._warnings[text] = None
        self._next_warning = now + _WARNING_SECONDS
        logger.warning("%s", text)

    def withdraw_warning(self, text: str) -> None:
        """Let a text be logged again: its cause has ended."""
        self._warnings.pop(text, None)

    # Master

    async def call_master(self, method: str, caller: str, *params: Value) -> Value:
        """Call the master; raises Ros1Error."""
        return await rpc.call(self.master, method, caller, *params)

    async def try_master(self, method: str, *params: Value) -> Value:
        """Return what the master knows, None if it refuses.

        Raises:
            Ros1Error: it does not answer.
        """
        body = await rpc.fetch(self.master, method, self.monitor.name, *params)
        try:
            return await rpc.value_of(self.master, method, body)
        except Ros1Error:
            return None

    def on_master_error(self, error: Ros1Error) -> None:
        """Report once that the master does not answer."""
        if self.has_master is not False:
            logger.warning("%s; it is tried again until it answers", error)
            self._notify("The ROS 1 master does not answer; connections to its nodes continue", False)
        self.has_master = False

    def on_master_answer(self) -> None:
        """Register everything again after the master was away."""
        if self.has_master is False:
            logger.warning("the ROS 1 master at %s answers; everything is registered again", self.master)
            self.on_forgotten()
            self._notify("The ROS 1 master answers; everything is registered again", True)
        self.has_master = True

    def _notify(self, text: str, is_connected: bool) -> None:
        for observer in tuple(self.graph.observers):
            observer(text, is_connected)

    async def keep_sweeping(self) -> None:
        """Sweep every second."""
        while True:
            await anyio.sleep(1)
            self.sweep()

    def close(self) -> None:
        """Close all connections."""
        for node in (self.monitor, *self.nodes.values()):
            node.close()
        self.nodes.clear()
