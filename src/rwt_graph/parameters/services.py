"""Six standard parameter services of a ROS 2 node, and its `/parameter_events`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Final, NamedTuple

from rwt_graph.disclosure import Disclosure, Lists, Reads, Writes
from rwt_graph.nodes.endpoints import TopicPublisher
from rwt_graph.parameters.node_parameters import NodeParameters
from rwt_graph.parameters.values import ParameterType, decode, encode, type_of
from rwt_interfaces.distro import Distro
from rwt_participant.errors import NotFound, ParameterRejected
from rwt_participant.messages import Message, MessageLike, ParameterValue
from rwt_participant.qos import QoS

_PACKAGE: Final = "rcl_interfaces"
#: ROS 2's profile of `/parameter_events`.
EVENTS_QOS = QoS(depth=1000)


class ParameterServices:
    """Parameter services of one node."""

    def __init__(self, parameters: NodeParameters) -> None:
        self._parameters = parameters

    def handlers(self) -> Iterable[tuple[str, str, Callable[[Message], MessageLike]]]:
        """Yield name below the node, type and handler of each service."""
        for service in _SERVICES:
            yield service.name, f"{_PACKAGE}/{service.type}", partial(service.handler, self)

    def _value(self, name: str) -> ParameterValue:
        try:
            return self._parameters.get(name)
        except NotFound:
            return None

    def _describe(self, request: Message) -> MessageLike:
        return {"descriptors": [self._descriptor(name) for name in request.names]}

    def _descriptor(self, name: str) -> dict[str, object]:
        if not self._parameters.has(name):
            return {"name": name}
        declaration = self._parameters.declaration(name)
        return {
            "name": name,
            "type": int(type_of(self._parameters.get(name))),
            "description": declaration.description,
            "read_only": declaration.read_only,
            "dynamic_typing": declaration.type is ParameterType.NOT_SET,
        }

    def _get(self, request: Message) -> MessageLike:
        return {"values": [encode(self._value(name)) for name in request.names]}

    def _types(self, request: Message) -> MessageLike:
        return {"types": [int(type_of(self._value(name))) for name in request.names]}

    def _list(self, request: Message) -> MessageLike:
        names = [name for name in self._parameters.names() if _listed(name, request.prefixes, request.depth)]
        prefixes = sorted({name.rpartition(".")[0] for name in names if "." in name})
        return {"result": {"names": names, "prefixes": prefixes}}

    def _set(self, request: Message) -> MessageLike:
        return {"results": [_outcome(partial(self._set_one, p)) for p in request.parameters]}

    def _set_one(self, parameter: Message) -> None:
        value = decode(parameter.value)
        if value is None:
            self._parameters.delete(parameter.name)
        else:
            self._parameters.set(parameter.name, value)

    def _set_atomically(self, request: Message) -> MessageLike:
        def set_all() -> None:
            self._parameters.set_all([(p.name, decode(p.value)) for p in request.parameters])

        return {"result": _outcome(set_all)}


class _Service(NamedTuple):
    """Name below the node, type in its package, handler and disclosure of a service."""

    name: str
    type: str
    handler: Callable[[ParameterServices, Message], MessageLike]
    reveals: Disclosure


_SERVICES: Final = (
    _Service("describe_parameters", "DescribeParameters", ParameterServices._describe, (Reads("names"),)),
    _Service("get_parameters", "GetParameters", ParameterServices._get, (Reads("names"),)),
    _Service("get_parameter_types", "GetParameterTypes", ParameterServices._types, (Reads("names"),)),
    _Service(
        "list_parameters",
        "ListParameters",
        ParameterServices._list,
        tuple(Lists("parameter", (f"result.{field}",), of_node=True) for field in ("names", "prefixes")),
    ),
    _Service("set_parameters", "SetParameters", ParameterServices._set, (Writes("parameters"),)),
    _Service(
        "set_parameters_atomically",
        "SetParametersAtomically",
        ParameterServices._set_atomically,
        (Writes("parameters"),),
    ),
)

DISCLOSURES: Final[Mapping[str, Disclosure]] = MappingProxyType(
    {f"{_PACKAGE}/{service.type}": service.reveals for service in _SERVICES}
)
"""Disclosure of each service, by the two-part name of its type."""


def _listed(name: str, prefixes: Iterable[str], depth: int) -> bool:
    """Return True if `list_parameters` includes the name; `depth` counts levels below a prefix, 0 for all."""
    wanted = tuple(prefixes)
    if not wanted:
        return depth == 0 or name.count(".") < depth
    for prefix in wanted:
        if name == prefix:
            return True
        if name.startswith(prefix + "."):
            below = name[len(prefix) + 1 :]
            if depth == 0 or below.count(".") < depth:
                return True
    return False


def _outcome(change: Callable[[], None]) -> dict[str, object]:
    try:
        change()
    except ParameterRejected as error:
        return {"successful": False, "reason": str(error)}
    return {"successful": True}


class ParameterEvents:
    """Publisher of one node's changes on `/parameter_events`."""

    def __init__(self, node: str, distro: Distro, publisher: TopicPublisher) -> None:
        self._node = node
        self._distro = distro
        self._publisher = publisher

    def stored(self, name: str, old: ParameterValue, new: ParameterValue) -> None:
        """Publish a change: `old` is None for a new parameter, `new` for a deleted one."""
        if new is None and old is None:
            return  # Declared without a value.
        if new is None:
            group = "deleted_parameters"
        else:
            group = "new_parameters" if old is None else "changed_parameters"
        self._publisher.publish(
            {
                "stamp": self._distro.time(self._publisher.now_ns()),
                "node": self._node,
                group: [{"name": name, "value": encode(new)}],
            }
        )
