"""What a restricted client sees of the answers of rosapi and of the nodes' parameter services (API-13).

rosapi is a node like any other and knows no clients, so its answers are narrowed on their way to the client.
The services are told by their types, whatever their names.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Final

import msgspec

from rwt_graph.errors import InvalidGraphName
from rwt_graph.names import namespace_of, resolve
from rwt_interfaces.payload import Payload

if TYPE_CHECKING:
    from rwt_access.roles import Act, Role
    from rwt_graph.api import Graph
    from rwt_interfaces.structs import ServiceType

Narrow = Callable[[Payload], Payload]
"""From the service's response to the one that the client gets."""


class View:
    """What one role sees of one graph."""

    def __init__(self, role: Role, graph: Graph) -> None:
        self._role = role
        self._graph = graph

    def topic(self, name: str) -> bool:
        """Whether a topic is shown."""
        return self._role.sees_topic(name)

    def service(self, name: str) -> bool:
        """Whether a service is shown."""
        return self._role.sees_service(name)

    def action(self, name: str) -> bool:
        """Whether an action is shown."""
        return self._role.sees_action(name)

    def parameter(self, name: str) -> bool:
        """Whether a parameter is shown."""
        return self._role.sees_parameter(name)

    def node(self, name: str) -> bool:
        """Whether a node is shown: when anything that it takes part in is."""
        return name in self._nodes

    @cached_property
    def _nodes(self) -> frozenset[str]:
        return frozenset(
            node.name
            for node in self._graph.nodes()
            if any(map(self.topic, (*node.publishing, *node.subscribing)))
            or any(map(self.service, node.services))
        )


Sees = Callable[[View, str], bool]

#: Response fields that hold names, by type; those in one group are aligned by index, the first has the names.
_NAMES: Final[Mapping[str, tuple[tuple[Sees, tuple[str, ...]], ...]]] = {
    "rosapi/Topics": ((View.topic, ("topics", "types")),),
    "rosapi/TopicsForType": ((View.topic, ("topics",)),),
    "rosapi/TopicsAndRawTypes": ((View.topic, ("topics", "types", "typedefs_full_text")),),
    "rosapi/Services": ((View.service, ("services",)),),
    "rosapi/ServicesForType": ((View.service, ("services",)),),
    "rosapi/ServiceProviders": ((View.node, ("providers",)),),
    "rosapi/GetActionServers": ((View.action, ("action_servers",)),),
    "rosapi/Nodes": ((View.node, ("nodes",)),),
    "rosapi/NodeDetails": (
        (View.topic, ("subscribing",)),
        (View.topic, ("publishing",)),
        (View.service, ("services",)),
    ),
    "rosapi/GetParamNames": ((View.parameter, ("names",)),),
    "rosapi/SearchParam": ((View.parameter, ("global_name",)),),
}

#: Request fields that name what is asked about, by type; what is hidden is answered as if it were not there.
_SUBJECTS: Final[Mapping[str, tuple[Sees, str]]] = {
    "rosapi/TopicType": (View.topic, "topic"),
    "rosapi/Publishers": (View.topic, "topic"),
    "rosapi/Subscribers": (View.topic, "topic"),
    "rosapi/ServiceType": (View.service, "service"),
    "rosapi/ServiceNode": (View.service, "service"),
    "rosapi/ServiceHost": (View.service, "service"),
    "rosapi/ActionType": (View.action, "action"),
    "rosapi/HasParam": (View.parameter, "name"),
}

#: Request fields that name parameters to read or write, by type.
_PARAMETERS: Final[Mapping[str, tuple[Act, str]]] = {
    "rosapi/GetParam": ("get_param", "name"),
    "rosapi/SetParam": ("set_param", "name"),
    "rosapi/DeleteParam": ("set_param", "name"),
    "rcl_interfaces/GetParameters": ("get_param", "names"),
    "rcl_interfaces/GetParameterTypes": ("get_param", "names"),
    "rcl_interfaces/DescribeParameters": ("get_param", "names"),
    "rcl_interfaces/SetParameters": ("set_param", "parameters"),
    "rcl_interfaces/SetParametersAtomically": ("set_param", "parameters"),
}


def narrowed(role: Role, graph: Graph, service: str, type: ServiceType, request: Payload) -> Narrow | None:
    """How the response to `request` has to be narrowed for `role`; None where it goes out as it is.

    Raises:
        Refused: the request reads or writes a parameter that the role may not.
    """
    if role.unrestricted:
        return None
    kind = type.name.replace("rosapi_msgs/", "rosapi/")
    if kind in _PARAMETERS:
        act, field = _PARAMETERS[kind]
        for name in _parameters(service, getattr(request.value(), field)):
            role.require(act, name)
    view = View(role, graph)
    if kind in _SUBJECTS:
        sees, field = _SUBJECTS[kind]
        if sees(view, _absolute(getattr(request.value(), field))):
            return None
        return lambda response: Payload.from_json(response.type, b"{}")
    if kind in _NAMES:
        return lambda response: _seen(view, _NAMES[kind], response)
    if kind == "rcl_interfaces/ListParameters":
        return lambda response: _listed(view, namespace_of(service), response)
    return None


def _seen(view: View, groups: Iterable[tuple[Sees, tuple[str, ...]]], response: Payload) -> Payload:
    """The response without the names that the view hides."""
    value = response.value()
    kept: dict[str, object] = {}
    for sees, fields in groups:
        names = getattr(value, fields[0])
        if isinstance(names, str):
            kept[fields[0]] = names if sees(view, names) else ""
            continue
        rows = [index for index, name in enumerate(names) if sees(view, name)]
        for field in fields:
            column = getattr(value, field)
            kept[field] = [column[index] for index in rows]
    return Payload.from_value(response.type, msgspec.structs.replace(value, **kept))


def _listed(view: View, node: str, response: Payload) -> Payload:
    """A node's list of its parameters without those that the view hides."""
    value = response.value()
    result: msgspec.Struct = value.result  # type: ignore[attr-defined]  # compiled from the definition
    names = [name for name in result.names if view.parameter(f"{node}:{name}")]  # type: ignore[attr-defined]  # likewise
    shown = msgspec.structs.replace(result, names=names)
    return Payload.from_value(response.type, msgspec.structs.replace(value, result=shown))


def _parameters(service: str, asked: str | Iterable[object]) -> Iterable[str]:
    """The full names of the parameters in a request: of rosapi one name, of a node's own service a list."""
    if isinstance(asked, str):
        return (_absolute(asked),)
    node = namespace_of(service)
    return [f"{node}:{one if isinstance(one, str) else getattr(one, 'name', '')}" for one in asked]


def _absolute(name: str) -> str:
    """The absolute name; what cannot be one is compared as it is, and names nothing."""
    node, colon, parameter = name.partition(":")
    try:
        return f"{resolve(node)}{colon}{parameter}"
    except InvalidGraphName:
        return name
