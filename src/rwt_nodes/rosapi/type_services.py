"""What the known types look like."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

from rwt_graph.errors import ServiceFailed
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.names import KINDS
from rwt_nodes.rosapi.typedefs import typedefs

if TYPE_CHECKING:
    from rwt_interfaces.registry import Registry
    from rwt_interfaces.structs import MessageType

Answer = dict[str, object]
T = TypeVar("T")


class TypeServices:
    """Handlers of the services that ask about types; an unknown type fails the call."""

    def __init__(self, registry: Registry) -> None:
        self._registry = registry

    def message_details(self, request: Any) -> Answer:
        """A message, and the messages in it."""
        return self._details(_known(self._registry.message, request.type))

    def service_request_details(self, request: Any) -> Answer:
        """The request of a service."""
        return self._details(_known(self._registry.service, request.type).request)

    def service_response_details(self, request: Any) -> Answer:
        """The response of a service."""
        return self._details(_known(self._registry.service, request.type).response)

    def action_goal_details(self, request: Any) -> Answer:
        """The goal of an action."""
        return self._details(_known(self._registry.action, request.type).goal)

    def action_result_details(self, request: Any) -> Answer:
        """The result of an action."""
        return self._details(_known(self._registry.action, request.type).result)

    def action_feedback_details(self, request: Any) -> Answer:
        """The feedback of an action."""
        return self._details(_known(self._registry.action, request.type).feedback)

    def interfaces(self, _: Any) -> Answer:
        """The names of all messages, services and actions that are known."""
        spell = self._registry.distro.type_name
        return {
            "interfaces": sorted(spell(name, kind) for kind in KINDS for name in self._registry.names(kind))
        }

    def _details(self, message: MessageType) -> Answer:
        return {"typedefs": typedefs(message, self._registry)}


def _known(find: Callable[[str], T], name: str) -> T:
    try:
        return find(name)
    except InterfaceError as error:
        raise ServiceFailed(str(error)) from error
