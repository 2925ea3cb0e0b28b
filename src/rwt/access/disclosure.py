"""Filtering of services that reveal the graph, for clients of restricted roles (API-13).

A service does not know which client calls it. Its response is filtered on the way to the client, as declared
in :mod:`rwt_graph.disclosure`. Declarations belong to service types, so they apply to every name, and to
services in other processes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Final

import msgspec

from rwt.access.errors import NotAllowed
from rwt.access.graph_view import GraphView, canonical
from rwt_graph.disclosure import AsksAbout, Disclosure, Kind, Lists, ListsProviders, Reads, Writes
from rwt_graph.names import namespace_of
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.names import two_part
from rwt_interfaces.payload import Payload
from rwt_participant.errors import CallFailed, NotFound

if TYPE_CHECKING:
    from rwt.access.roles import Act
    from rwt_graph.parameters.tree import ParameterTree
    from rwt_interfaces.structs import ServiceType

Disclosures = Mapping[str, Disclosure]
"""Declarations of what services reveal, by the name of their type."""

OutcomeFilter = Callable[["Payload | CallFailed"], "Payload | CallFailed"]
"""Filter of the outcome of a call."""

#: Maximum number of characters of a parameter's name, of all names of a table, and of a table as JSON text:
#: names within names grow with the square of their depth.
_MAX_NAME: Final = 1000
_MAX_CHARACTERS: Final = 100_000
_MAX_TABLE: Final = 320_000

#: Packages whose services reveal the graph: without a declaration their services are not called.
_ABOUT_THE_GRAPH: Final = ("rosapi/", "rosapi_msgs/", "rcl_interfaces/")

#: Services that list the whole graph: a role caches its filtered copy of the last response.
_LISTINGS: Final = frozenset(
    f"/rosapi/{name}" for name in ("topics", "topics_and_raw_types", "services", "nodes", "action_servers")
)

#: Name that does not exist in any graph, since ROS does not allow it.
_NO_NAME: Final = "/!"


def restrict(
    view: GraphView, disclosures: Disclosures, service: str, type: ServiceType, request: Payload
) -> tuple[Payload, OutcomeFilter | None]:
    """Return a client's request as it may be sent, and the filter of its outcome; None for no filter.

    A hidden name in a request is replaced by one that does not exist: the service itself then answers as for
    unknown names.

    Raises:
        NotAllowed: the role may not read or write a parameter in the request, or the service reveals the
            graph without a declaration.
    """
    disclosure = disclosures.get(type.name)
    if disclosure is None:
        if service.startswith("/rosapi/") or type.name.startswith(_ABOUT_THE_GRAPH):
            raise NotAllowed(
                f"{service} does not declare what it reveals, so only roles that may do everything call it"
            )
        return request, None
    lists: list[Lists] = []
    hidden = ""
    for part in disclosure:
        if isinstance(part, Lists):
            lists.append(part)
            continue
        if isinstance(part, ListsProviders):
            return request, partial(_providers, view, part, request)
        asked = getattr(request.value(), part.field)
        if isinstance(part, AsksAbout):
            if not _sight(view, part.kind)(canonical(asked)):
                hidden = canonical(asked)
                changed = msgspec.structs.replace(request.value(), **{part.field: _NO_NAME})
                request = Payload.from_value(request.type, changed)
            continue
        act: Act = "get_param" if isinstance(part, Reads) else "set_param"
        for name in _parameters(service, asked):
            view.role.require(act, name)
    if not lists and not hidden:
        return request, None

    def filtered(outcome: Payload | CallFailed) -> Payload | CallFailed:
        if isinstance(outcome, CallFailed):
            return outcome.__class__(str(outcome).replace(_NO_NAME, hidden)) if hidden else outcome
        return _without(view, lists, service, outcome) if lists else outcome

    return request, filtered


def setting_parameters(disclosures: Disclosures) -> frozenset[str]:
    """Return the types of services whose calls set parameters."""
    return frozenset(
        type for type, parts in disclosures.items() if any(isinstance(part, Writes) for part in parts)
    )


def written_parameters(
    disclosures: Disclosures, service: str, type: ServiceType, request: Payload
) -> tuple[list[str], str]:
    """Return what a call sets, as declared for the service type.

    Returns:
        The full names of the parameters, and the value as JSON text; empty if its type has another form.
    """
    names: list[str] = []
    text = ""
    for part in disclosures.get(type.name, ()):
        if isinstance(part, Writes):
            names += _parameters(service, getattr(request.value(), part.field))
            text = getattr(request.value(), part.json) if part.json else text
    return names, text


def affected_parameters(tree: ParameterTree, name: str, text: str, most: int) -> list[str] | None:
    """Return the parameters that setting or deleting one changes: itself, those above it and those below it.

    In a tree of parameters, a table replaces everything below its name. Parameters of nodes on ROS 2 have
    no tree.

    Args:
        name: full name of the parameter.
        text: new value as JSON text; empty to delete it.
        most: maximum number of parameters.

    Returns:
        None if there are more, or if their names are too long.
    """
    if ":" in name:
        return [name]
    if len(name) > _MAX_NAME:
        return None
    parts = [part for part in name.split("/") if part]
    names = ["/" + "/".join(parts[:count]) for count in range(len(parts), 0, -1)] or ["/"]
    values: list[tuple[str, object]] = []
    with suppress(NotFound):
        tree.read(name, lambda value: values.append((names[0].rstrip("/"), value)))
    if text.lstrip().startswith("{"):  # Only a table has parameters below it.
        if len(text) > _MAX_TABLE:
            return None
        with suppress(ValueError, RecursionError):
            values.append((names[0].rstrip("/"), json.loads(text)))
    characters = 0
    while values:
        above, value = values.pop()
        for key, each in value.items() if isinstance(value, Mapping) else ():
            names.append(f"{above}/{key}")
            values.append((names[-1], each))
            characters += len(names[-1])
            if len(names) > most or characters > _MAX_CHARACTERS:
                return None
    return names


def _sight(view: GraphView, kind: Kind) -> Callable[[str], bool]:
    """Return the function that returns True for a visible name of a kind."""
    role = view.role
    sights: dict[Kind, Callable[[str], bool]] = {
        "topic": role.sees_topic,
        "service": view.sees_service,
        "action": role.sees_action,
        "parameter": role.sees_parameter,
        "node": view.sees_node,
    }
    return sights[kind]


def _without(view: GraphView, lists: Iterable[Lists], service: str, response: Payload) -> Payload:
    """Return a response without hidden names.

    rosapi responds with the same object until the graph changes, so its filtered copy is cached, too.
    """
    kept = view.role.answers.get(service)
    if kept is not None and kept[0] is response:
        return kept[1]
    value = response.value()
    for part in lists:
        prefix = f"{namespace_of(service)}:" if part.of_node else ""
        value = _without_hidden(view, part.kind, prefix, value, part.fields)
    shown = Payload.from_value(response.type, value)
    if service in _LISTINGS:
        view.role.answers[service] = (response, shown)
    return shown


def _providers(
    view: GraphView, part: ListsProviders, request: Payload, outcome: Payload | CallFailed
) -> Payload | CallFailed:
    """Return the nodes that provide the visible services of a name or type."""
    if isinstance(outcome, CallFailed):
        return outcome
    asked = getattr(request.value(), part.field)
    name = canonical(asked)
    try:
        type = two_part(asked)
    except InterfaceError:
        type = ""  # Not the name of a type.
    shown = {each.node for each in view.services() if each.name == name or each.type.name == type}
    listed = [node for node in getattr(outcome.value(), part.lists) if node in shown]
    return Payload.from_value(outcome.type, msgspec.structs.replace(outcome.value(), **{part.lists: listed}))


def _without_hidden(
    view: GraphView, kind: Kind, prefix: str, value: msgspec.Struct, fields: tuple[str, ...]
) -> msgspec.Struct:
    inner, dot, rest = fields[0].partition(".")
    if dot:
        part = _without_hidden(view, kind, prefix, getattr(value, inner), (rest,))
        return msgspec.structs.replace(value, **{inner: part})
    names, sees = getattr(value, fields[0]), _sight(view, kind)
    if isinstance(names, str):
        return value if sees(names) else msgspec.structs.replace(value, **{fields[0]: ""})
    rows = [index for index, name in enumerate(names) if sees(prefix + name)]
    columns = {field: getattr(value, field) for field in fields}
    kept = {field: [column[index] for index in rows] for field, column in columns.items()}
    return msgspec.structs.replace(value, **kept)


def _parameters(service: str, asked: str | Iterable[object]) -> Iterable[str]:
    """Return the full names of the parameters in a request: one for rosapi, several for a node's service."""
    if isinstance(asked, str):
        return (canonical(asked),)
    node = namespace_of(service)
    return [f"{node}:{one if isinstance(one, str) else getattr(one, 'name', '')}" for one in asked]
