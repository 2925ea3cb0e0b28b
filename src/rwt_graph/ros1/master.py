"""ROS 1 master and parameter server, for a graph without ROS.

Its tables are those of the master's API; nodes of this process register like those of other programs.
"""

from __future__ import annotations

import logging
import os
import uuid
from collections.abc import Callable
from inspect import signature
from typing import TYPE_CHECKING, Final

import anyio

from rwt_graph.errors import Ros1Error, WireError
from rwt_graph.parameters.tree import ParameterTree
from rwt_graph.ros1.parameters import is_below
from rwt_graph.ros1.wire import rpc
from rwt_interfaces.distro import NOETIC
from rwt_participant.errors import NotFound, ParameterRejected

if TYPE_CHECKING:
    from rwt_graph.ros1.wire.sockets import Sockets
    from rwt_graph.ros1.wire.xmlrpc import Value

logger = logging.getLogger(__name__)

#: Maximum registrations and watched parameters, and characters of a name or address.
_MOST_ENTRIES: Final = 5000
_NAME_CHARS: Final = 1000

#: Maximum bytes of all parameters, which contain robot descriptions.
_PARAMETER_BYTES: Final = 32 * 1024 * 1024

#: Maximum notifications that are sent at once.
_MOST_CALLS: Final = 64

Table = dict[str, dict[str, str]]
"""Addresses by node, by topic or service."""


class Master:
    """Master that listens for calls.

    Args:
        host: host in the address that nodes are given.
        bind: address on which it listens.

    Raises:
        OSError: the port is in use.
    """

    def __init__(self, sockets: Sockets, host: str, bind: str, port: int) -> None:
        self._sockets = sockets
        self._publishers: Table = {}
        self._subscribers: Table = {}
        self._services: Table = {}
        self._entries = 0
        self._types: dict[str, str] = {}
        self._nodes: dict[str, str] = {}
        self._watches: dict[tuple[str, str], str] = {}
        # Calls that wait for each node, by method and name: a newer one replaces an older one.
        self._pending: dict[str, dict[tuple[str, str], tuple[Value, ...]]] = {}
        self._calls = anyio.CapacityLimiter(_MOST_CALLS)
        self._parameters = tree = ParameterTree(max_bytes=_PARAMETER_BYTES)
        tree.set("/rosdistro", f"{NOETIC.name}\n")
        tree.set("/rosversion", f"{NOETIC.master_version}\n")
        tree.set("/run_id", str(uuid.uuid1()))
        self._methods: dict[str, Callable[..., Value]] = {
            "registerPublisher": self._register_publisher,
            "unregisterPublisher": self._unregister_publisher,
            "registerSubscriber": self._register_subscriber,
            "unregisterSubscriber": self._unregister_subscriber,
            "registerService": self._register_service,
            "unregisterService": self._unregister_service,
            "lookupNode": self._lookup_node,
            "lookupService": self._lookup_service,
            "getPublishedTopics": self._published_topics,
            "getTopicTypes": lambda _: [1, "topic types", [[*each] for each in self._types.items()]],
            "getSystemState": lambda _: [1, "system state", self._state()],
            "getUri": lambda _: [1, "", self.uri],
            "getPid": lambda _: [1, "", os.getpid()],
            "setParam": self._set_param,
            "getParam": self._get_param,
            "deleteParam": self._delete_param,
            "hasParam": lambda caller, key: [1, key, self._parameters.has(_absolute(caller, key))],
            "searchParam": self._search_param,
            "getParamNames": lambda _: [1, "parameter names", list(self._parameters.names())],
            "subscribeParam": self._subscribe_param,
            "unsubscribeParam": self._unsubscribe_param,
        }
        self._server = rpc.RpcServer(sockets, bind, self._dispatch, port)
        self.port = self._server.port
        self.uri = f"http://{host}:{self.port}/"

    def _dispatch(self, method: str, params: tuple[Value, ...]) -> Value:
        if method == "system.multicall":
            return self._call_all(params)
        handle = self._methods.get(method)
        if handle is None:
            raise WireError(f"method {method[:80]} is not supported")
        names = params if method != "setParam" else params[:2]
        if not all(isinstance(each, str) and len(each) <= _NAME_CHARS for each in names):
            return [-1, f"the parameters of {method} are strings of at most {_NAME_CHARS} characters", 0]
        try:
            signature(handle).bind(*params)
        except TypeError:
            return [-1, f"{method} does not have {len(params)} parameters", 0]
        return handle(*params)

    def _call_all(self, params: tuple[Value, ...]) -> Value:
        results: list[Value] = []
        for each in params[0] if params and isinstance(params[0], list) else []:
            match each:
                case {"methodName": str(method), "params": list(given)} if method != "system.multicall":
                    try:
                        results.append([self._dispatch(method, tuple(given))])
                    except WireError as error:
                        results.append({"faultCode": -1, "faultString": str(error)})
                case _:
                    results.append({"faultCode": -1, "faultString": "malformed call"})
        return results

    # Calls of nodes

    def _notify(self, uri: str, method: str, name: str, *params: Value) -> None:
        """Call a node soon, after the calls that wait for it."""
        calls = self._pending.get(uri)
        if calls is None:
            calls = self._pending[uri] = {}
            self._sockets.spawn(lambda: self._call_node(uri), f"calls of {uri}")
        calls.pop((method, name), None)
        calls[method, name] = params

    async def _call_node(self, uri: str) -> None:
        try:
            while calls := self._pending[uri]:
                method, name = key = next(iter(calls))
                params = calls.pop(key)
                async with self._calls:
                    await rpc.call(uri, method, "/master", name, *params)
        except Ros1Error as error:
            logger.info("a node does not take a notification: %s", error)
            for watch in [each for each in self._watches if each[0] == uri]:
                del self._watches[watch]
        finally:
            del self._pending[uri]

    # Registrations

    def _register(self, table: Table, name: str, node: str, uri: str, node_uri: str) -> None:
        if self._entries >= _MOST_ENTRIES:
            raise WireError(f"the master has {_MOST_ENTRIES} registrations, which is the limit")
        earlier = self._nodes.get(node)
        if earlier is not None and earlier != node_uri:
            self._notify(earlier, "shutdown", f"[{node}] Reason: new node registered with same name")
            for each in (self._publishers, self._subscribers, self._services):
                for other in tuple(each):
                    self._remove(each, other, node)
        self._nodes[node] = node_uri
        self._entries += node not in table.setdefault(name, {})
        table[name][node] = uri

    def _remove(self, table: Table, name: str, node: str) -> None:
        entries = table.get(name, {})
        if entries.pop(node, None) is not None:
            self._entries -= 1
            if table is self._publishers:
                self._update(name)
        if not entries:
            table.pop(name, None)

    def _unregister(self, table: Table, name: str, node: str, uri: str) -> Value:
        if table.get(name, {}).get(node) != uri:
            return [1, f"{node} is not registered for {name}", 0]
        self._remove(table, name, node)
        tables = (self._publishers, self._subscribers, self._services)
        if not any(node in entries for each in tables for entries in each.values()):
            self._nodes.pop(node, None)
        return [1, "unregistered", 1]

    def _update(self, topic: str) -> None:
        """Report the publishers of a topic to its subscribers."""
        publishers = list(dict.fromkeys(self._publishers.get(topic, {}).values()))
        for uri in self._subscribers.get(topic, {}).values():
            self._notify(uri, "publisherUpdate", topic, publishers)

    def _register_publisher(self, caller: str, topic: str, type: str, uri: str) -> Value:
        self._register(self._publishers, topic, caller, uri, uri)
        if type != "*" or topic not in self._types:
            self._types[topic] = type
        self._update(topic)
        return [1, "registered", list(self._subscribers.get(topic, {}).values())]

    def _unregister_publisher(self, caller: str, topic: str, uri: str) -> Value:
        return self._unregister(self._publishers, topic, caller, uri)

    def _register_subscriber(self, caller: str, topic: str, type: str, uri: str) -> Value:
        self._register(self._subscribers, topic, caller, uri, uri)
        if type != "*":
            self._types.setdefault(topic, type)
        return [1, "registered", list(dict.fromkeys(self._publishers.get(topic, {}).values()))]

    def _unregister_subscriber(self, caller: str, topic: str, uri: str) -> Value:
        return self._unregister(self._subscribers, topic, caller, uri)

    def _register_service(self, caller: str, service: str, service_uri: str, uri: str) -> Value:
        for other in tuple(self._services.get(service, ())):
            self._remove(self._services, service, other)
        self._register(self._services, service, caller, service_uri, uri)
        return [1, "registered", 1]

    def _unregister_service(self, caller: str, service: str, service_uri: str) -> Value:
        return self._unregister(self._services, service, caller, service_uri)

    def _lookup_node(self, _caller: str, node: str) -> Value:
        uri = self._nodes.get(node)
        return [-1, f"unknown node [{node}]", ""] if uri is None else [1, "node api", uri]

    def _lookup_service(self, _caller: str, service: str) -> Value:
        for uri in self._services.get(service, {}).values():
            return [1, "rosrpc URI", uri]
        return [-1, "no provider", ""]

    def _published_topics(self, _caller: str, below: str) -> Value:
        prefix = below.rstrip("/") + "/"
        return [1, "current topics", [[t, self._types[t]] for t in self._publishers if t.startswith(prefix)]]

    def _state(self) -> Value:
        tables = (self._publishers, self._subscribers, self._services)
        return [[[name, list(entries)] for name, entries in table.items()] for table in tables]

    # Parameters

    def _set_param(self, caller: str, key: str, value: Value) -> Value:
        name = _absolute(caller, key)
        try:
            self._parameters.set(name, value)
        except ParameterRejected as error:
            return [-1, str(error), 0]
        self._report(caller, name, value)
        return [1, f"parameter {name} set", 0]

    def _get_param(self, caller: str, key: str) -> Value:
        try:
            return [1, key, self._parameters.get(_absolute(caller, key))]
        except NotFound:
            return [-1, f"Parameter [{key}] is not set", 0]

    def _delete_param(self, caller: str, key: str) -> Value:
        name = _absolute(caller, key)
        try:
            self._parameters.delete(name)
        except (NotFound, ParameterRejected) as error:
            return [-1, str(error), 0]
        self._report(caller, name, {})
        return [1, f"parameter {name} deleted", 0]

    def _search_param(self, caller: str, key: str) -> Value:
        first, _, rest = key.partition("/")
        within = caller
        while first:
            if self._parameters.has(f"{within}/{first}"):
                return [1, "found", f"{within}/{first}" + (f"/{rest}" if rest else "")]
            if not within:
                break
            within = within.rpartition("/")[0]
        return [-1, f"cannot find parameter [{key}]", 0]

    def _subscribe_param(self, caller: str, uri: str, key: str) -> Value:
        name = _absolute(caller, key)
        if len(self._watches) >= _MOST_ENTRIES:
            return [-1, f"{_MOST_ENTRIES} parameters are watched, which is the limit", 0]
        self._watches[uri, name] = caller
        return [1, f"subscribed to {name}", self._parameters.get(name) if self._parameters.has(name) else {}]

    def _unsubscribe_param(self, caller: str, uri: str, key: str) -> Value:
        return [1, "unsubscribed", int(self._watches.pop((uri, _absolute(caller, key)), None) is not None)]

    def _report(self, setter: str, name: str, value: Value) -> None:
        """Report a change to the nodes that watch the name, or one above or below it."""
        for (uri, watched), caller in self._watches.items():
            if caller == setter:
                continue
            if is_below(name, watched):
                self._notify(uri, "paramUpdate", name.rstrip("/") + "/", value)
            elif is_below(watched, name):
                inner = self._parameters.get(watched) if self._parameters.has(watched) else {}
                self._notify(uri, "paramUpdate", watched + "/", inner)

    def close(self) -> None:
        """Stop listening."""
        self._server.close()


def _absolute(caller: str, key: str) -> str:
    """Return the absolute name of a parameter of a caller, without superfluous slashes."""
    if key.startswith("~"):
        key = f"{caller}/{key[1:]}"
    elif not key.startswith("/"):
        key = f"{caller.rpartition('/')[0]}/{key}"
    return "/" + "/".join(part for part in key.split("/") if part)
