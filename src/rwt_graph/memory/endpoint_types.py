"""Message types of endpoints in other processes."""

from __future__ import annotations

import logging

from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType

logger = logging.getLogger(__name__)


class EndpointTypes:
    """Types of ROS 2's endpoints in other processes. A type that cannot be exchanged is logged once."""

    def __init__(self, registry: Registry) -> None:
        self._registry = registry
        self._logged: set[tuple[str, str]] = set()

    def find(self, name: str, type_hash: str, topic: str, node: str) -> MessageType | None:
        """Return a type; None if it is unknown here, or its definition has another hash.

        Args:
            type_hash: `RIHS01_…`; empty over DDS if the other process does not announce one.
            topic, node: those of the endpoint, for the log.
        """
        try:
            known = self._registry.message(name)
        except InterfaceError:
            why = "its definition is not known here: give it with --interfaces"
        else:
            if type_hash in ("", known.announced_hash):
                return known
            why = f"the other process defines it otherwise ({type_hash})"
        if (name, type_hash) not in self._logged:
            self._logged.add((name, type_hash))
            where = f"{topic} of node {node}" if node else topic
            logger.warning("%s cannot be exchanged, it has type %s: %s", where, name, why)
        return None
