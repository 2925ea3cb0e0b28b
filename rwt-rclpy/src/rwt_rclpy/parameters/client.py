"""`rclpy.parameter_client`: parameters of another node."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from rwt_rclpy.endpoints.qos import QoSProfile, qos_profile_parameter_events, qos_profile_services_default
from rwt_rclpy.execution.task import Future
from rwt_rclpy.messages.loaded import message_class
from rwt_rclpy.parameters.parameter import Parameter, parameter_dict_from_yaml_file
from rwt_rclpy.parameters.services import service_class

if TYPE_CHECKING:
    from rwt_rclpy.nodes.node import Node

OnDone = Callable[[Future], object]


_SERVICES = (
    "get_parameters", "list_parameters", "set_parameters", "get_parameter_types", "describe_parameters",
    "set_parameters_atomically",
)  # fmt: skip


class AsyncParameterClient:
    """Client of another node's parameter services.

    Args:
        node: node that calls.
        remote_node_name: node whose parameters are accessed.
    """

    def __init__(
        self,
        node: Node,
        remote_node_name: str,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: Any = None,
    ) -> None:
        self.remote_node_name = remote_node_name
        self.node = node
        self._clients = {
            each: node.create_client(
                service_class(each),
                f"{remote_node_name}/{each}",
                qos_profile=qos_profile,
                callback_group=callback_group,
            )
            for each in _SERVICES
        }

    def services_are_ready(self) -> bool:
        """True if the node offers all parameter services."""
        return all(client.service_is_ready() for client in self._clients.values())

    def wait_for_services(self, timeout_sec: float | None = None) -> bool:
        """Wait until the node offers all parameter services. Returns False after the timeout."""
        end = None if timeout_sec is None else time.monotonic() + timeout_sec
        for client in self._clients.values():
            left = None if end is None else max(0.0, end - time.monotonic())
            if not client.wait_for_service(left):
                return False
        return True

    def _call(self, name: str, callback: OnDone | None, **fields: Any) -> Future:
        client = self._clients[name]
        future = client.call_async(client.srv_type.Request(**fields))
        if callback is not None:
            future.add_done_callback(callback)
        return future

    def list_parameters(
        self, prefixes: Sequence[str] | None = None, depth: int | None = None, callback: OnDone | None = None
    ) -> Future:
        """List the names below some prefixes."""
        return self._call("list_parameters", callback, prefixes=list(prefixes or ()), depth=depth or 0)

    def get_parameters(self, names: Sequence[str], callback: OnDone | None = None) -> Future:
        """Get values."""
        return self._call("get_parameters", callback, names=list(names))

    def set_parameters(self, parameters: Sequence[Any], callback: OnDone | None = None) -> Future:
        """Set values, one after the other."""
        return self._call("set_parameters", callback, parameters=_messages(parameters))

    def describe_parameters(self, names: Sequence[str], callback: OnDone | None = None) -> Future:
        """Get descriptors."""
        return self._call("describe_parameters", callback, names=list(names))

    def get_parameter_types(self, names: Sequence[str], callback: OnDone | None = None) -> Future:
        """Get types."""
        return self._call("get_parameter_types", callback, names=list(names))

    def set_parameters_atomically(self, parameters: Sequence[Any], callback: OnDone | None = None) -> Future:
        """Set values atomically."""
        return self._call("set_parameters_atomically", callback, parameters=_messages(parameters))

    def delete_parameters(self, names: Sequence[str], callback: OnDone | None = None) -> Future:
        """Undeclare parameters."""
        return self.set_parameters([Parameter(name, Parameter.Type.NOT_SET) for name in names], callback)

    def load_parameter_file(
        self, parameter_file: str, use_wildcard: bool = False, callback: OnDone | None = None
    ) -> Future:
        """Set the values of a file for the node. Raises RuntimeError if the file has none."""
        found = parameter_dict_from_yaml_file(parameter_file, use_wildcard)
        return self.set_parameters(list(found.values()), callback)

    def load_parameter_file_atomically(
        self, parameter_file: str, use_wildcard: bool = False, callback: OnDone | None = None
    ) -> Future:
        """Set the values of a file for the node atomically."""
        found = parameter_dict_from_yaml_file(parameter_file, use_wildcard)
        return self.set_parameters_atomically(list(found.values()), callback)

    def on_parameter_event(
        self, callback: OnDone, qos_profile: QoSProfile = qos_profile_parameter_events
    ) -> Any:
        """Call a function with each `rcl_interfaces/ParameterEvent` of any node."""
        event = message_class("rcl_interfaces/ParameterEvent")
        return self.node.create_subscription(event, "/parameter_events", callback, qos_profile)


def _messages(parameters: Sequence[Any]) -> list[Any]:
    return [each.to_parameter_msg() if isinstance(each, Parameter) else each for each in parameters]
