"""Parameters in Foxglove's protocol: read and set through rosapi's services, and watched.

A node's parameter is called `/node.name`, as in Foxglove's own bridge for ROS 2, and a global one `/name`.
Access is checked in the client's calls of rosapi.
"""

from __future__ import annotations

import json
import math
from base64 import b64decode
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, Final, TypeGuard

from msgspec import UNSET

from rwt.access.client_graph import ClientGraph
from rwt.access.errors import AccessError
from rwt.delivery.shared_graph import SharedGraph
from rwt.extensions.foxglove.errors import NotPossible
from rwt.extensions.foxglove.replies import FoxgloveReplies
from rwt.extensions.foxglove.wire.client_messages import GetParameters, Parameter, SetParameters
from rwt.extensions.foxglove.wire.server_messages import Level, text
from rwt_graph.api import Sample, Subscription
from rwt_graph.parameters.values import decode
from rwt_interfaces.distro import Distro
from rwt_interfaces.payload import Payload
from rwt_participant.errors import CallFailed, NotFound, RobotError
from rwt_participant.qos import QoS
from rwt_participant.timers import Timer
from rwt_transports.scheduler import MESSAGES, Scheduler

LIST: Final = "/rosapi/get_param_names"
GET: Final = "/rosapi/get_param"
SET: Final = "/rosapi/set_param"
DELETE: Final = "/rosapi/delete_param"

_MAX_CALLS: Final = 8
"""Maximum number of concurrent rosapi calls per client."""

_MAX_REQUESTS: Final = 16
"""Maximum number of pending requests per client."""

Done = Callable[["Payload | str"], None]
"""Receives the response of a service, or the reason why there is none."""


def to_client(name: str) -> str:
    """Return the name that clients see for a parameter's full name, `/node:name` or `/name`."""
    return name.replace(":", ".", 1)


def from_client(name: str, distro: Distro) -> str:
    """Return a parameter's full name from the client's name for it: a node's name has no dots."""
    return name.replace(".", ":", 1) if distro.parameters_belong_to_nodes and ":" not in name else name


def described(name: str, value: object) -> dict[str, object]:
    """Return a parameter as sent to clients; one without a value has been deleted."""
    if value is None:
        return {"name": to_client(name)}
    kind = _kind(value)
    known: dict[str, object] = {"name": to_client(name), "value": _plain(value)}
    return {**known, "type": kind} if kind else known


def _kind(value: object) -> str:
    """Return the kind of a value, which its JSON does not show: a whole number may be a float."""
    if isinstance(value, float):
        return "float64"
    if isinstance(value, list | tuple) and any(isinstance(each, float) for each in value):
        return "float64_array"
    return ""


def _plain(value: object) -> object:
    """Return a value as JSON: bytes as numbers, as in rosapi, and null for NaN and infinity."""
    if isinstance(value, bytes | bytearray):
        return list(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return value


def wanted_value(parameter: Parameter) -> object:
    """Return the value to set; UNSET to delete the parameter. Raises NotPossible for a wrong type."""
    value, kind = parameter.value, parameter.type
    if value is UNSET or kind is UNSET or kind is None:
        return value
    if kind == "float64" and _is_number(value):
        return float(value)
    if kind == "float64_array" and isinstance(value, list) and all(map(_is_number, value)):
        return [float(each) for each in value]
    if kind == "byte_array" and isinstance(value, str):
        try:
            return list(b64decode(value, validate=True))
        except ValueError:
            pass
    raise NotPossible(f"parameter {parameter.name[:200]}: its value is no {kind}")


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


MAX_NAMES: Final = 1000
"""Maximum number of parameters that one client may request at once, or watch."""


class ParameterRequests:
    """Parameters that one client reads, sets and watches; at most :data:`MAX_NAMES` at once."""

    def __init__(self, graph: ClientGraph, replies: FoxgloveReplies, scheduler: Scheduler) -> None:
        self._graph = graph
        self._replies = replies
        self._requests = 0
        self._calls = 0
        self._due: deque[Callable[[], None]] = deque()
        self._scheduler = scheduler
        self._has_turn = False
        self._closed = False
        self.watched: set[str] = set()
        self.watches_all = False

    # -- reading and setting -------------------------------------------------------------------------------

    def get(self, asked: GetParameters) -> None:
        """Send the values of these parameters, or of all if it names none. Raises NotPossible at a limit."""
        self._begin(len(asked.parameter_names))
        if asked.parameter_names:
            names = [from_client(name, self._graph.distro) for name in asked.parameter_names]
            self._read(names, partial(self._answer, asked.id))
            return

        def listed(outcome: Payload | str) -> None:
            if isinstance(outcome, str):
                self._end(f"parameters cannot be listed: {outcome}")
                return
            allows = self._graph.role.allows
            # Filtered here, too: the list has names that the role may see but not read.
            found = [name for name in getattr(outcome.value(), "names", ()) if allows("get_param", name)]
            self._read(found, partial(self._answer, asked.id))

        self._call(LIST, {}, listed)

    def set(self, asked: SetParameters) -> None:
        """Set parameters, and send the new values if the client gives an id. Raises NotPossible."""
        distro = self._graph.distro
        wanted = [(from_client(each.name, distro), wanted_value(each)) for each in asked.parameters]
        self._begin(len(wanted))
        failures: list[str] = []
        left = len(wanted)

        def done(name: str, outcome: Payload | str) -> None:
            nonlocal left
            left -= 1
            if reason := _failure(outcome):
                failures.append(f"{to_client(name)}: {reason}")
            if left:
                return
            if failures:
                self._refuse(f"parameters were not set: {'; '.join(failures[:5])}"[:1000])
            if asked.id is None:
                self._end()
            else:
                self._read([name for name, _ in wanted], partial(self._answer, asked.id))

        if not wanted:  # Otherwise the last reply answers.
            self._answer(asked.id, {})
        for name, value in wanted:
            if value is UNSET:
                self._call(DELETE, {"name": name}, partial(done, name))
            else:
                self._call(SET, {"name": name, "value": json.dumps(value)}, partial(done, name))

    def _read(self, names: Sequence[str], on_values: Callable[[Mapping[str, object]], None]) -> None:
        names = tuple(dict.fromkeys(names))
        values: dict[str, object] = {}
        left = len(names)

        def done(name: str, outcome: Payload | str) -> None:
            nonlocal left
            left -= 1
            if not _failure(outcome) and not isinstance(outcome, str):
                values[name] = json.loads(getattr(outcome.value(), "value", "null"))
            if not left:
                # In the order of the request: replies come in any order.
                on_values({name: values[name] for name in names if name in values})

        if not names:
            on_values({})
        for name in names:
            self._call(GET, {"name": name}, partial(done, name))

    def _answer(self, id: str | None, values: Mapping[str, object]) -> None:
        self._end()
        found = [described(name, value) for name, value in values.items() if value is not None]
        self._send(found, id)

    def _send(self, parameters: Sequence[dict[str, object]], id: str | None = None) -> None:
        frame = text("parameterValues", parameters=parameters, id=id)
        if reason := self._replies.too_large(frame.size):
            self._replies.say(Level.ERROR, f"parameter values: {reason}")
        elif not self._closed:  # The reply of a service may come after the end of the connection.
            self._replies.send(frame)

    def _begin(self, names: int) -> None:
        if names > MAX_NAMES:
            raise NotPossible(
                f"{names} parameters at once, and {MAX_NAMES} are the most: ask for all, or in parts"
            )
        if self._requests >= _MAX_REQUESTS:
            raise NotPossible(f"{self._requests} requests about parameters wait already: await their answers")
        self._requests += 1

    def _end(self, failure: str = "") -> None:
        self._requests -= 1
        if failure:
            self._refuse(failure)

    def _refuse(self, reason: str) -> None:
        if not self._closed:
            self._graph.counters.refuse("parameters")
            self._replies.say(Level.ERROR, reason)

    # -- calls ---------------------------------------------------------------------------------------------

    def _call(self, service: str, request: Mapping[str, object], done: Done) -> None:
        """Call a service of rosapi once fewer than :data:`_MAX_CALLS` calls of the client are pending."""
        self._due.append(partial(self._call_now, service, request, done))
        self._want_turn()

    def _want_turn(self) -> None:
        if self._due and self._calls < _MAX_CALLS and not self._has_turn and not self._closed:
            self._has_turn = True
            self._scheduler.wait(self._go_on)

    def _go_on(self) -> None:
        self._has_turn = False
        monotonic = self._graph.clock.monotonic
        began, worked = monotonic(), 0.0
        while self._due and self._calls < _MAX_CALLS and worked < MESSAGES.share and not self._closed:
            self._due.popleft()()
            worked = monotonic() - began
        # Counted for the client as the message that caused the calls, of which one may cause a thousand.
        self._scheduler.note(worked)
        self._graph.work.add(worked, "messages")
        self._want_turn()

    def _call_now(self, service: str, request: Mapping[str, object], done: Done) -> None:
        self._calls += 1
        answered = False

        def on_reply(outcome: Payload | CallFailed) -> None:
            nonlocal answered
            if answered:
                return
            answered = True
            self._calls -= 1
            done(str(outcome) if isinstance(outcome, CallFailed) else outcome)
            # Not from within the callback: a series of answers would nest as deeply.
            self._want_turn()

        try:
            self._graph.call_service(service, lambda type: Payload.from_value(type, request), on_reply)
        except (RobotError, AccessError) as error:
            on_reply(error if isinstance(error, CallFailed) else CallFailed(str(error)))

    # -- watching ------------------------------------------------------------------------------------------

    def watch(self, names: Sequence[str]) -> None:
        """Report changes of these parameters, or of all if none. Raises NotPossible at a limit."""
        if not names:
            self.watches_all = True
            return
        wanted = self.watched | {from_client(name, self._graph.distro) for name in names}
        if len(wanted) > MAX_NAMES:
            raise NotPossible(
                f"{len(wanted)} parameters are watched, and {MAX_NAMES} are the most:"
                " watch all, by naming none"
            )
        self.watched = wanted

    def unwatch(self, names: Iterable[str]) -> None:
        """Stop reporting these parameters, or all if it names none."""
        gone = {from_client(name, self._graph.distro) for name in names}
        if not gone:
            self.watches_all = False
        self.watched = self.watched - gone if gone else set()

    def changed(self, values: Mapping[str, object]) -> None:
        """Send the changes that the client watches and may read; None is a deleted parameter."""
        allows = self._graph.role.allows
        found = [
            described(name, value)
            for name, value in values.items()
            if (self.watches_all or name in self.watched) and allows("get_param", name)
        ]
        if found:
            self._send(found)

    def close(self) -> None:
        """Discard pending requests."""
        self._closed = True
        self._due.clear()
        self.watched = set()
        self.watches_all = False


def _failure(outcome: Payload | str) -> str:
    """Return the reason why a service of rosapi failed; empty if it succeeded."""
    if isinstance(outcome, str):
        return outcome
    answer = outcome.value()
    return "" if getattr(answer, "successful", True) else str(getattr(answer, "reason", "")) or "refused"


EVENTS: Final = "/parameter_events"
_EVENTS_TYPE: Final = "rcl_interfaces/ParameterEvent"
_QOS: Final = QoS(depth=1000)


class ParameterFeed:
    """Reports changed values of watched parameters by full name; None for a deleted parameter."""

    def __init__(self, shared: SharedGraph, tell: Callable[[Mapping[str, object]], None]) -> None:
        self._shared = shared
        self._tell = tell
        self._events: Subscription | None = None
        self._tree: dict[str, Callable[[], None]] = {}
        self._changed: set[str] = set()
        self._timer: Timer | None = None

    def watch(self, names: Iterable[str], *, everything: bool) -> None:
        """Watch these parameters instead; None: all of the nodes' and those that the tree has now."""
        graph = self._shared.graph
        # Names of nodes' parameters contain a colon, `/node:name`; the others are of the tree.
        wanted = {name for name in names if ":" not in name}
        of_nodes = everything or any(":" in name for name in names)
        if everything:
            wanted |= set(graph.parameters.names())
        if of_nodes and graph.distro.parameters_belong_to_nodes:
            if self._events is None:
                type = graph.registry.message(_EVENTS_TYPE)
                self._events = self._shared.participant.subscribe(EVENTS, self._on_event, type, _QOS)
        elif self._events is not None:
            self._events.close()
            self._events = None
        for name in self._tree.keys() - wanted:
            self._tree.pop(name)()
        for name in wanted - self._tree.keys():
            self._tree[name] = graph.parameters.watch(name, partial(self._on_tree, name))

    def close(self) -> None:
        """Stop watching."""
        self.watch((), everything=False)
        if self._timer is not None:
            self._timer.cancel()

    def _on_event(self, sample: Sample) -> None:
        try:
            event: Any = sample.payload.value()
            values = {
                f"{event.node}:{each.name}": decode(each.value)
                for group in ("new_parameters", "changed_parameters")
                for each in getattr(event, group)
            }
            values |= {f"{event.node}:{each.name}": None for each in event.deleted_parameters}
        except RobotError:
            return  # Another process published an invalid event, or a value of an unknown type.
        self._tell(values)

    def _on_tree(self, name: str, value: object) -> None:
        # It is not stored yet, and a node may still refuse it.
        self._changed.add(name)
        if self._timer is None:
            self._timer = self._shared.graph.clock.call_later(0.0, self._tell_of_tree)

    def _tell_of_tree(self) -> None:
        self._timer = None
        changed, self._changed = self._changed, set()
        # Read now, after the nodes have accepted or refused the values.
        tree = self._shared.graph.parameters
        values: dict[str, object] = {}
        for name in sorted(changed):
            try:
                values[name] = tree.get(name)
            except NotFound:
                values[name] = None
        self._tell(values)
