"""Changes of watched parameters, from `/parameter_events` and from the parameter tree."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from rwt_graph.parameters.values import decode
from rwt_participant.errors import NotFound, RobotError
from rwt_participant.qos import QoS

if TYPE_CHECKING:
    from rwt.delivery.shared_graph import SharedGraph
    from rwt_graph.api import Sample, Subscription
    from rwt_participant.timers import Timer

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
        tree = self._shared.graph.parameters
        values: dict[str, object] = {}
        for name in sorted(changed):
            try:
                values[name] = tree.get(name)
            except NotFound:
                values[name] = None
        self._tell(values)
