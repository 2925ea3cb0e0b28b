"""Inquiries about unknown types, which the nodes that use them answer by `~/get_type_description`."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from rwt.extensions.ros2.type_supports.described_types import DescribedTypes
from rwt_graph.backend import NodeResources
from rwt_interfaces.errors import InterfaceError, InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_participant.errors import CallFailed

if TYPE_CHECKING:
    from rwt.extensions.ros2.services import Ros2Services
    from rwt_graph.clock import Clock
    from rwt_interfaces.registry import Registry
    from rwt_participant.timers import Timer

logger = logging.getLogger(__name__)

#: Seconds for which a node's service may be undiscovered, and for which an answer is awaited.
PATIENCE_SECONDS: Final = 3.0
_ANSWER_SECONDS: Final = 5.0

#: Maximum unanswered questions, and nodes that are asked for one type.
MOST_OPEN: Final = 8
_MOST_NODES: Final = 20

_SERVICE: Final = "get_type_description"


@dataclass(eq=False, slots=True)
class _Inquiry:
    """Question about one type.

    Attributes:
        nodes: nodes that use the type and have not been asked; the one that is asked is `asking`.
        expires: time at which the inquiry fails, unless the service of a node is known by then.
        reason: why the last node that was asked has not described it.
        has_ended: True if it has failed, or if the type was described.
    """

    name: str
    type_hash: str
    expires: float
    nodes: dict[str, None] = field(default_factory=dict)
    asking: str = ""
    reason: str = "no node describes it"
    has_ended: bool = False
    is_described: bool = False


class Inquiries:
    """Inquiries of one graph, on its thread.

    Args:
        types: types of the graph, to which the answers are added.
        owner: node that asks.
        on_end: called after one or more types were learned, or could not be.
    """

    def __init__(
        self,
        types: DescribedTypes,
        services: Ros2Services,
        registry: Registry,
        clock: Clock,
        on_end: Callable[[], None],
    ) -> None:
        self._types = types
        self._services = services
        self._registry = registry
        self._clock = clock
        self._on_end = on_end
        self._inquiries: dict[tuple[str, str], _Inquiry] = {}
        self._owner: NodeResources | None = None
        self._timer: Timer | None = None

    def open(self, owner: NodeResources) -> None:
        """Begin to ask; questions may be waiting."""
        self._owner = owner
        self.follow()

    def close(self) -> None:
        """Ask nothing more."""
        self._owner = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def ask(self, name: str, type_hash: str, node: str) -> None:
        """Ask a node about a type that is unknown, or known with another hash.

        Args:
            type_hash: `RIHS01_…`; without, no node can be asked.
            node: absolute name; empty if it is not known yet.
        """
        inquiry = self._inquiries.setdefault((name, type_hash), _Inquiry(name, type_hash, 0.0))
        if not type_hash:
            inquiry.has_ended = True
            inquiry.reason = "its node announces no type hash, as before ROS 2 Iron"
        elif "/msg/" not in name:
            inquiry.has_ended = True
            inquiry.reason = "ROS 2 describes no actions to others"
        elif not inquiry.is_described and len(inquiry.nodes) < _MOST_NODES:
            inquiry.has_ended = False
            inquiry.expires = self._clock.monotonic() + PATIENCE_SECONDS
            if node:
                inquiry.nodes[node] = None

    def reason(self, name: str, type_hash: str) -> str:
        """Return why a type could not be learned; empty if it was, or while nodes are being asked."""
        inquiry = self._inquiries.get((name, type_hash))
        return inquiry.reason if inquiry and inquiry.has_ended and not inquiry.is_described else ""

    def follow(self) -> None:
        """Ask what can be asked: after each reading of the ROS graph."""
        waiting = [each for each in self._inquiries.values() if not each.has_ended]
        room = MOST_OPEN - sum(bool(each.asking) for each in waiting)
        now = self._clock.monotonic()
        has_ended = False
        for inquiry in waiting:
            if inquiry.asking:
                continue
            node = next((each for each in inquiry.nodes if self._is_offered(each)), "")
            if node:
                if room > 0:
                    room -= 1
                    self._send(inquiry, node)
            elif now >= inquiry.expires:
                inquiry.has_ended = has_ended = True
        if has_ended:
            self._on_end()
        self._look_again()

    def _look_again(self) -> None:
        if self._timer is None and self._owner is not None:
            ends = [i.expires for i in self._inquiries.values() if not (i.has_ended or i.asking)]
            if ends:
                delay = max(0.05, min(ends) - self._clock.monotonic())
                self._timer = self._clock.call_later(delay, self._expire)

    def _expire(self) -> None:
        self._timer = None
        self.follow()

    def _is_offered(self, node: str) -> bool:
        return self._owner is not None and self._services.info(f"{node}/{_SERVICE}") is not None

    def _send(self, inquiry: _Inquiry, node: str) -> None:
        owner = self._owner
        if owner is None:
            return
        inquiry.asking = node
        del inquiry.nodes[node]
        request = self._registry.service("type_description_interfaces/GetTypeDescription").request
        question = {
            "type_name": inquiry.name,
            "type_hash": inquiry.type_hash,
            "include_type_sources": True,
        }
        payload = Payload.from_value(request, question)
        on_reply = partial(self._answered, inquiry)
        self._services.call(f"{node}/{_SERVICE}", payload, on_reply, _ANSWER_SECONDS, owner)

    def _answered(self, inquiry: _Inquiry, answer: Payload | CallFailed) -> None:
        node, inquiry.asking = inquiry.asking, ""
        if self._owner is None:
            return
        if not any(each.asking == node for each in self._inquiries.values()):
            self._services.forget_client(self._owner, f"{node}/{_SERVICE}")
        reason = self._learn(inquiry, answer)
        if reason:
            inquiry.reason = f"{node} does not describe it: {reason}"
            # Another node may be asked at once, and is waited for no longer than the first one.
            self.follow()
            return
        inquiry.has_ended = inquiry.is_described = True
        logger.info("learned %s from the description of %s", inquiry.name, node)
        self._on_end()
        self.follow()

    def _learn(self, inquiry: _Inquiry, answer: Payload | CallFailed) -> str:
        """Add a description; return why that is not possible, or an empty text."""
        if isinstance(answer, CallFailed):
            return str(answer)
        try:
            response: Any = answer.value()
            if not response.successful:
                return str(response.failure_reason)
            self._types.add(inquiry.name, inquiry.type_hash, response.type_description, response.type_sources)
        except (InterfaceError, InvalidMessage) as error:
            return str(error)
        return ""
