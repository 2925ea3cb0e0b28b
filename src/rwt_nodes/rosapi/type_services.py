"""Services about types: their fields, constants and names."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, TypeVar

from rwt_graph.disclosure import NOTHING
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.names import KINDS
from rwt_nodes.rosapi.service import Answer, Service
from rwt_nodes.rosapi.typedefs import typedefs
from rwt_program.errors import ServiceFailed

if TYPE_CHECKING:
    from rwt_graph.program.node import Node
    from rwt_interfaces.structs import MessageType

T = TypeVar("T")


def message_details(node: Node, request: Any) -> Answer:
    """A message, and the messages in it."""
    return _details(node, _known(node.graph.registry.message, request.type))


def service_request_details(node: Node, request: Any) -> Answer:
    """The request of a service."""
    return _details(node, _known(node.graph.registry.service, request.type).request)


def service_response_details(node: Node, request: Any) -> Answer:
    """The response of a service."""
    return _details(node, _known(node.graph.registry.service, request.type).response)


def action_goal_details(node: Node, request: Any) -> Answer:
    """The goal of an action."""
    return _details(node, _known(node.graph.registry.action, request.type).goal)


def action_result_details(node: Node, request: Any) -> Answer:
    """The result of an action."""
    return _details(node, _known(node.graph.registry.action, request.type).result)


def action_feedback_details(node: Node, request: Any) -> Answer:
    """The feedback of an action."""
    return _details(node, _known(node.graph.registry.action, request.type).feedback)


def interfaces(node: Node, _: Any) -> Answer:
    """The names of all messages, services and actions that are known."""
    spell = node.graph.registry.distro.type_name
    return {
        "interfaces": sorted(spell(name, kind) for kind in KINDS for name in node.graph.registry.names(kind))
    }


def _details(node: Node, message: MessageType) -> Answer:
    return {"typedefs": typedefs(message, node.graph.registry)}


def _known(find: Callable[[str], T], name: str) -> T:
    try:
        return find(name)
    except InterfaceError as error:
        raise ServiceFailed(str(error)) from error


SERVICES: Final = (
    Service("message_details", "MessageDetails", message_details, NOTHING),
    Service("service_request_details", "ServiceRequestDetails", service_request_details, NOTHING),
    Service("service_response_details", "ServiceResponseDetails", service_response_details, NOTHING),
    Service("action_goal_details", "ActionGoalDetails", action_goal_details, NOTHING),
    Service("action_result_details", "ActionResultDetails", action_result_details, NOTHING),
    Service("action_feedback_details", "ActionFeedbackDetails", action_feedback_details, NOTHING),
    Service("interfaces", "Interfaces", interfaces, NOTHING),
)
