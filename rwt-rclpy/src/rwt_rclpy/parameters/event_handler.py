"""`rclpy.parameter_event_handler`: callbacks for changes of parameters of any node."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rwt_rclpy.endpoints.qos import QoSProfile, qos_profile_parameter_events
from rwt_rclpy.messages.loaded import message_class

if TYPE_CHECKING:
    from rwt_rclpy.nodes.node import Node

OnParameter = Callable[[Any], object]


@dataclass(eq=False)
class ParameterCallbackHandle:
    """Callback for one parameter of one node."""

    parameter_name: str
    node_name: str
    callback: OnParameter


@dataclass(eq=False)
class ParameterEventCallbackHandle:
    """Callback for all events."""

    callback: OnParameter


class ParameterEventHandler:
    """Handler of changes of parameters, from `/parameter_events`.

    Args:
        node: node that subscribes.
    """

    class Callbacks:
        """Callbacks, the last added first."""

        def __init__(self) -> None:
            self.parameter_callbacks: dict[tuple[str, str], list[ParameterCallbackHandle]] = {}
            self.event_callbacks: list[ParameterEventCallbackHandle] = []

        def event_callback(self, event: Any) -> None:
            """Pass an event to matching callbacks."""
            for (name, node), handles in tuple(self.parameter_callbacks.items()):
                if node != event.node:
                    continue
                for parameter in (*event.new_parameters, *event.changed_parameters):
                    if parameter.name == name:
                        for handle in tuple(handles):
                            handle.callback(parameter)
            for each in tuple(self.event_callbacks):
                each.callback(event)

        def add_parameter_callback(
            self, parameter_name: str, node_name: str, callback: OnParameter
        ) -> ParameterCallbackHandle:
            """Add a callback for a parameter."""
            handle = ParameterCallbackHandle(parameter_name, node_name, callback)
            self.parameter_callbacks.setdefault((parameter_name, node_name), []).insert(0, handle)
            return handle

        def remove_parameter_callback(self, handle: ParameterCallbackHandle) -> None:
            """Remove a callback. Raises RuntimeError if it was not added."""
            key = (handle.parameter_name, handle.node_name)
            handles = self.parameter_callbacks.get(key, [])
            if handle not in handles:
                raise RuntimeError("Callback doesn't exist")
            handles.remove(handle)
            if not handles:
                del self.parameter_callbacks[key]

        def add_parameter_event_callback(self, callback: OnParameter) -> ParameterEventCallbackHandle:
            """Add a callback for all events."""
            handle = ParameterEventCallbackHandle(callback)
            self.event_callbacks.insert(0, handle)
            return handle

        def remove_parameter_event_callback(self, handle: ParameterEventCallbackHandle) -> None:
            """Remove a callback. Raises RuntimeError if it was not added."""
            if handle not in self.event_callbacks:
                raise RuntimeError("Callback doesn't exist")
            self.event_callbacks.remove(handle)

    def __init__(self, node: Node, qos_profile: QoSProfile = qos_profile_parameter_events) -> None:
        self.node = node
        self.qos_profile = qos_profile
        self._callbacks = ParameterEventHandler.Callbacks()
        self.parameter_event_subscription = node.create_subscription(
            message_class("rcl_interfaces/ParameterEvent"),
            "/parameter_events",
            self._callbacks.event_callback,
            qos_profile,
        )

    def destroy(self) -> None:
        """Destroy the handler."""
        self.node.destroy_subscription(self.parameter_event_subscription)

    def add_parameter_callback(
        self, parameter_name: str, node_name: str, callback: OnParameter
    ) -> ParameterCallbackHandle:
        """Add a callback for `rcl_interfaces/Parameter` of a parameter of a node."""
        return self._callbacks.add_parameter_callback(parameter_name, self._resolve_path(node_name), callback)

    def remove_parameter_callback(self, handle: ParameterCallbackHandle) -> None:
        """Remove a callback. Raises RuntimeError if it was not added."""
        self._callbacks.remove_parameter_callback(handle)

    def add_parameter_event_callback(self, callback: OnParameter) -> ParameterEventCallbackHandle:
        """Add a callback for all `rcl_interfaces/ParameterEvent`."""
        return self._callbacks.add_parameter_event_callback(callback)

    def remove_parameter_event_callback(self, handle: ParameterEventCallbackHandle) -> None:
        """Remove a callback. Raises RuntimeError if it was not added."""
        self._callbacks.remove_parameter_event_callback(handle)

    def _resolve_path(self, node_path: str | None = None) -> str:
        if not node_path:
            return self.node.get_fully_qualified_name()
        if node_path.startswith("/"):
            return node_path
        return f"{self.node.get_namespace().rstrip('/')}/{node_path}"

    @staticmethod
    def get_parameter_from_event(event: Any, parameter_name: str, node_name: str) -> Any:
        """Return a parameter of an event as `rcl_interfaces/Parameter`; None if it is not in it."""
        if event.node != node_name:
            return None
        for parameter in (*event.new_parameters, *event.changed_parameters):
            if parameter.name == parameter_name:
                return parameter
        return None

    @staticmethod
    def get_parameters_from_event(event: Any) -> Any:
        """Return the parameters of an event in order."""
        yield from (*event.new_parameters, *event.changed_parameters)
