"""The node `/rosapi`: the table of its services."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

from rwt_graph.program.node import Node
from rwt_nodes.rosapi.graph_services import GraphServices
from rwt_nodes.rosapi.parameter_services import ParameterServices
from rwt_nodes.rosapi.type_services import TypeServices

if TYPE_CHECKING:
    from rwt_graph.api import Graph

Answer = dict[str, object]
Handler = Callable[[Any], Answer | Awaitable[Answer]]


class Rosapi:
    """Serves rosapi for one graph, from construction until `close`."""

    def __init__(self, graph: Graph) -> None:
        self._node = Node(graph, "rosapi")
        package = graph.distro.rosapi_package
        for service, (type_name, handler) in self._table(graph).items():
            self._node.advertise_service(f"/rosapi/{service}", f"{package}/{type_name}", handler)

    def close(self) -> None:
        """Withdraw the services."""
        self._node.close()

    def __enter__(self) -> Rosapi:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _table(self, graph: Graph) -> dict[str, tuple[str, Handler]]:
        """Service name → type and handler."""
        live = GraphServices(graph)
        types = TypeServices(graph.registry)
        params = ParameterServices(self._node)
        table: dict[str, tuple[str, Handler]] = {
            "topics": ("Topics", live.topics),
            "topics_for_type": ("TopicsForType", live.topics_for_type),
            "topics_and_raw_types": ("TopicsAndRawTypes", live.topics_and_raw_types),
            "topic_type": ("TopicType", live.topic_type),
            "publishers": ("Publishers", live.publishers),
            "subscribers": ("Subscribers", live.subscribers),
            "services": ("Services", live.services),
            "services_for_type": ("ServicesForType", live.services_for_type),
            "service_type": ("ServiceType", live.service_type),
            "service_providers": ("ServiceProviders", live.service_providers),
            "service_node": ("ServiceNode", live.service_node),
            "service_host": ("ServiceHost", live.service_host),
            "nodes": ("Nodes", live.nodes),
            "node_details": ("NodeDetails", live.node_details),
            "action_servers": ("GetActionServers", live.action_servers),
            "action_type": ("ActionType", live.action_type),
            "get_time": ("GetTime", live.get_time),
            "message_details": ("MessageDetails", types.message_details),
            "service_request_details": ("ServiceRequestDetails", types.service_request_details),
            "service_response_details": ("ServiceResponseDetails", types.service_response_details),
            "action_goal_details": ("ActionGoalDetails", types.action_goal_details),
            "action_result_details": ("ActionResultDetails", types.action_result_details),
            "action_feedback_details": ("ActionFeedbackDetails", types.action_feedback_details),
            "interfaces": ("Interfaces", types.interfaces),
            "get_param_names": ("GetParamNames", params.get_param_names),
            "get_param": ("GetParam", params.get_param),
            "set_param": ("SetParam", params.set_param),
            "has_param": ("HasParam", params.has_param),
            "delete_param": ("DeleteParam", params.delete_param),
            "search_param": ("SearchParam", params.search_param),
        }
        if graph.distro.rosapi_has_version:
            table["get_ros_version"] = ("GetROSVersion", live.get_ros_version)
        return table
