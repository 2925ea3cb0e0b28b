"""ROS 1 master and parameter server, for a graph without ROS.

Its tables are those of the master's API; nodes of this process register like those of other programs.
"""

from __future__ import annotations

import logging
import os
import uuid
from collections import Counter, deque
from collections.abc import Callable
from functools import partial
from inspect import signature
from typing import TYPE_CHECKING, Final

import anyio

from rwt.extensions.ros1.parameters import is_below
from rwt.extensions.ros1.wire import rpc
from rwt_graph.backend import ParameterTree
from rwt_graph.errors import Ros1Error, WireError
from rwt_interfaces.distro import NOETIC
from rwt_participant.errors import NotFound, ParameterRejected

if TYPE_CHECKING:
    from rwt.extensions.ros1.wire.network import Network
    from rwt.extensions.ros1.wire.xmlrpc import Value

logger = logging.getLogger(__name__)

#: Maximum nodes that are called at once.
_MOST_CALLED: Final = 64

#: Maximum calls that wait, besides one for each node.
_MOST_WAITING: Final = 20_000

#: Maximum registrations and watched parameters, and characters of a name or address.
_MOST_ENTRIES: Final = 5000
_NAME_CHARS: Final = 1000

#: Maximum bytes of all parameters, which contain robot descriptions.
_PARAMETER_BYTES: Final = 32 * 1024 * 1024

Table = dict[str, dict[str, str]]
"""Addresses by node, by topic or service."""


class Notifications:
    """Calls that wait for nodes. A newer one replaces an older one of the same method and name.

    If too many wait, the oldest of a node gives way to its newest.

    Args:
        on_deaf: called with the address of a node that takes no calls; those that wait for it are dropped.
    """

    def __init__(self, network: Network, on_deaf: Callable[[str], None]) -> None:
        self._network = network
        self._on_deaf = on_deaf
        # By address, method and name; an address stays while it is called.
        self._calls: dict[str, dict[tuple[str, str], tuple[Value, ...]]] = {}
        self._count = 0
        self._queue: deque[str] = deque()
        self._limiter = anyio.CapacityLimiter(_MOST_CALLED)

    def add(self, uri: str, method: str, name: str, *params: Value) -> None:
        """Call a node soon, after the calls that wait for it."""
        calls = self._calls.get(uri)
        if calls is None:
            calls = self._calls[uri] = {}
            self._queue_up(uri)
        self.discard(uri, method, name)
        if calls and self._count >= _MOST_WAITING:
            self.discard(uri, *next(iter(calls)))
        calls[method, name] = params
        self._count += 1

    def discard(self, uri: str, method: str, name: str) -> None:
        """Forget a call that waits; no-op if there is none."""
        if self._calls.get(uri, {}).pop((method, name), None) is not None:
            self._count -= 1

    def _queue_up(self, uri: str) -> None:
        self._queue.append(uri)
        if len(self._queue) == 1:
            self._network.spawn(self._call_nodes, "calls of ROS 1 nodes")

    async def _call_nodes(self) -> None:
        """Start the call of each queued node, as soon as fewer than `_MOST_CALLED` are called.

        Acquiring the limiter lets the event loop go on, so that a turn starts one call at most: thousands may
        be due at once. The node stays first in the queue until its call has started; an empty queue means
        that this task does not run.
        """
        while self._queue:
            uri = self._queue[0]
            await self._limiter.acquire_on_behalf_of(uri)
            self._network.spawn(partial(self._call, uri), f"a call of {uri}")
            self._queue.popleft()

    async def _call(self, uri: str) -> None:
        """Carry out the oldest call of one node. If more wait, the node queues again, behind the others.

        A node that does not answer is given up: all its calls are dropped.
        """
        calls = self._calls[uri]
        try:
            if calls:  # They may have been discarded while the node was queued.
                method, name = next(iter(calls))
                params = calls[method, name]
                self.discard(uri, method, name)
                await rpc.call(uri, method, "/master", name, *params)
        except Ros1Error as error:
            logger.info("a node does not take a notification: %s", error)
            self._count -= len(calls)
            calls.clear()
            self._on_deaf(uri)
        finally:
            self._limiter.release_on_behalf_of(uri)
        if calls:
            self._queue_up(uri)
        else:
            del self._calls[uri]


class Master:
    """Tables and parameters of a master, and its answers to calls.

    Args:
        uri: address that nodes are given.
    """

    def __init__(self, network: Network, uri: str) -> None:
        self._publishers: Table = {}
        self._subscribers: Table = {}
        self._services: Table = {}
        # Number of registrations by node.
        self._entries: Counter[str] = Counter()
        self._types: dict[str, str] = {}
        self._nodes: dict[str, str] = {}
        self._watches: dict[tuple[str, str], str] = {}
        self._notifications = Notifications(network, self._on_deaf)
        self._parameters = tree = ParameterTree(max_bytes=_PARAMETER_BYTES)
        tree.set("/rosdistro", f"{NOETIC.name}\n")
        tree.set("/rosversion", f"{NOETIC.master_version}\n")
        tree.set("/run_id", str(uuid.uuid1()))
        methods: dict[str, Callable[..., Value]] = {
            "registerPublisher": self._register_publisher,
            "unregisterPublisher": partial(self._unregister, self._publishers),
            "registerSubscriber": self._register_subscriber,
            "unregisterSubscriber": partial(self._unregister, self._subscribers),
            "registerService": self._register_service,
            "unregisterService": partial(self._unregister, self._services),
            "lookupNode": self._lookup_node,
            "lookupService": self._lookup_service,
            "getPublishedTopics": self._published_topics,
            "getTopicTypes": lambda _: [1, "topic types", [[*each] for each in self._types.items()]],
            "getSystemState": lambda _: [1, "system state", self._state()],
            "getUri": lambda _: [1, "", uri],
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
        self._methods = {name: (handle, signature(handle)) for name, handle in methods.items()}

    def dispatch(self, method: str, params: tuple[Value, ...]) -> Value:
        if method not in self._methods:
            raise WireError(f"method {method[:80]} is not supported")
        handle, parameters = self._methods[method]
        names = params if method != "setParam" else params[:2]
        if not all(isinstance(each, str) and len(each) <= _NAME_CHARS for each in names):
            return [-1, f"the parameters of {method} are strings of at most {_NAME_CHARS} characters", 0]
        try:
            parameters.bind(*params)
        except TypeError:
            return [-1, f"{method} does not have {len(params)} parameters", 0]
        return handle(*params)

    # Registrations

    def _register(self, table: Table, name: str, node: str, uri: str, node_uri: str) -> None:
        if self._entries.total() >= _MOST_ENTRIES:
            raise WireError(f"the master has {_MOST_ENTRIES} registrations, which is the limit")
        earlier = self._nodes.get(node)
        if earlier is not None and earlier != node_uri:
            self._notifications.add(
                earlier, "shutdown", f"[{node}] Reason: new node registered with same name"
            )
            for each in (self._publishers, self._subscribers, self._services):
                for other in tuple(each):
                    self._remove(each, other, node)
        self._nodes[node] = node_uri
        if node not in table.setdefault(name, {}):
            self._entries[node] += 1
        table[name][node] = uri

    def _remove(self, table: Table, name: str, node: str) -> None:
        entries = table.get(name, {})
        uri = entries.pop(node, None)
        if uri is None:
            return
        self._entries[node] -= 1
        if not self._entries[node]:
            del self._entries[node], self._nodes[node]
        if table is self._publishers:
            self._update(name)
        elif table is self._subscribers:
            self._notifications.discard(uri, "publisherUpdate", name)
        if not entries:
            del table[name]
            if name not in self._publishers and name not in self._subscribers:
                self._types.pop(name, None)

    def _unregister(self, table: Table, caller: str, name: str, uri: str) -> Value:
        if table.get(name, {}).get(caller) != uri:
            return [1, f"{caller} is not registered for {name}", 0]
        self._remove(table, name, caller)
        return [1, "unregistered", 1]

    def _update(self, topic: str) -> None:
        """Report the publishers of a topic to its subscribers."""
        publishers = list(dict.fromkeys(self._publishers.get(topic, {}).values()))
        for uri in self._subscribers.get(topic, {}).values():
            self._notifications.add(uri, "publisherUpdate", topic, publishers)

    def _register_publisher(self, caller: str, topic: str, type: str, uri: str) -> Value:
        self._register(self._publishers, topic, caller, uri, uri)
        if type != "*" or topic not in self._types:
            self._types[topic] = type
        self._update(topic)
        return [1, "registered", list(self._subscribers.get(topic, {}).values())]

    def _register_subscriber(self, caller: str, topic: str, type: str, uri: str) -> Value:
        self._register(self._subscribers, topic, caller, uri, uri)
        if type != "*":
            self._types.setdefault(topic, type)
        return [1, "registered", list(dict.fromkeys(self._publishers.get(topic, {}).values()))]

    def _register_service(self, caller: str, service: str, service_uri: str, uri: str) -> Value:
        for other in tuple(self._services.get(service, ())):
            self._remove(self._services, service, other)
        self._register(self._services, service, caller, service_uri, uri)
        return [1, "registered", 1]

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
        return [1, f"subscribed to {name}", self._branch(name)]

    def _unsubscribe_param(self, caller: str, uri: str, key: str) -> Value:
        return [1, "unsubscribed", int(self._watches.pop((uri, _absolute(caller, key)), None) is not None)]

    def _report(self, setter: str, name: str, value: Value) -> None:
        """Report a change to the nodes that watch the name, or one above or below it."""
        for (uri, watched), caller in self._watches.items():
            if caller == setter:
                continue
            if is_below(name, watched):
                self._notifications.add(uri, "paramUpdate", name.rstrip("/") + "/", value)
            elif is_below(watched, name):
                self._notifications.add(uri, "paramUpdate", watched + "/", self._branch(watched))

    def _branch(self, name: str) -> Value:
        """Return a value or branch; an empty table if it does not exist."""
        return self._parameters.get(name) if self._parameters.has(name) else {}

    def _on_deaf(self, uri: str) -> None:
        for watch in [each for each in self._watches if each[0] == uri]:
            del self._watches[watch]


def _absolute(caller: str, key: str) -> str:
    """Return the absolute name of a parameter of a caller, without superfluous slashes."""
    if key.startswith("~"):
        key = f"{caller}/{key[1:]}"
    elif not key.startswith("/"):
        key = f"{caller.rpartition('/')[0]}/{key}"
    return "/" + "/".join(part for part in key.split("/") if part)
