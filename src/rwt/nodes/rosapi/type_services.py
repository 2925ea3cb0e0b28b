"""Services about types: names, fields and constants."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from rwt.nodes.rosapi.service import Answer, Service
from rwt.nodes.rosapi.typedefs import typedefs
from rwt_graph.disclosure import NOTHING
from rwt_graph.nodes.node import Node
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.names import KINDS, Kind
from rwt_interfaces.structs import MessageType
from rwt_participant.errors import ServiceFailed


def interfaces(node: Node, _: Any) -> Answer:
    """Return the names of all known messages, services and actions."""
    spell = node.graph.registry.distro.type_name
    return {
        "interfaces": sorted(spell(name, kind) for kind in KINDS for name in node.graph.registry.names(kind))
    }


def _details(kind: Kind, part: str) -> Callable[[Node, Any], Answer]:
    def answer(node: Node, request: Any) -> Answer:
        registry = node.graph.registry
        find = {"msg": registry.message, "srv": registry.service, "action": registry.action}[kind]
        try:
            known = find(request.type)
        except InterfaceError as error:
            raise ServiceFailed(str(error)) from error
        message = known if isinstance(known, MessageType) else getattr(known, part)
        return {"typedefs": typedefs(message, registry)}

    return answer


SERVICES: Final = (
    Service("message_details", "MessageDetails", _details("msg", ""), NOTHING),
    Service("service_request_details", "ServiceRequestDetails", _details("srv", "request"), NOTHING),
    Service("service_response_details", "ServiceResponseDetails", _details("srv", "response"), NOTHING),
    Service("action_goal_details", "ActionGoalDetails", _details("action", "goal"), NOTHING),
    Service("action_result_details", "ActionResultDetails", _details("action", "result"), NOTHING),
    Service("action_feedback_details", "ActionFeedbackDetails", _details("action", "feedback"), NOTHING),
    Service("interfaces", "Interfaces", interfaces, NOTHING),
)
