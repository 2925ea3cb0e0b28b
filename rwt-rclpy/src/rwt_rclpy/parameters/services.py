"""Services of a node for parameters, loggers and type descriptions."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rwt_rclpy.endpoints.qos import qos_profile_parameters
from rwt_rclpy.exceptions import ParameterNotDeclaredException, ParameterUninitializedException
from rwt_rclpy.logs import output
from rwt_rclpy.messages.loaded import classes, message_class
from rwt_rclpy.parameters.node_parameters import result
from rwt_rclpy.parameters.parameter import Parameter, ParameterKind

if TYPE_CHECKING:
    from rwt_rclpy.nodes.node import Node

Handler = Callable[[Any, Any], Any]


def service_class(name: str) -> type:
    """Return the class of a service of `rcl_interfaces`: `GetParameters` for `get_parameters`."""
    return classes().service(f"rcl_interfaces/{name.title().replace('_', '')}")


class ParameterService:
    """`rclpy.parameter_service`: the six parameter services of a node."""

    def __init__(self, node: Node) -> None:
        self._node = node
        handlers: dict[str, Handler] = {
            "describe_parameters": self._describe,
            "get_parameters": self._get,
            "get_parameter_types": self._types,
            "list_parameters": self._list,
            "set_parameters": self._set,
            "set_parameters_atomically": self._set_atomically,
        }
        for name, handler in handlers.items():
            full = f"{node._rwt_full_name}/{name}"
            node.create_service(service_class(name), full, handler, qos_profile=qos_profile_parameters)

    def _describe(self, request: Any, response: Any) -> Any:
        try:
            response.descriptors = [self._node.describe_parameter(name) for name in request.names]
        except ParameterNotDeclaredException:
            response.descriptors = []
        return response

    def _get(self, request: Any, response: Any) -> Any:
        try:
            response.values = [self._node.get_parameter(name).get_parameter_value() for name in request.names]
        except (ParameterNotDeclaredException, ParameterUninitializedException):
            response.values = []
        return response

    def _types(self, request: Any, response: Any) -> Any:
        try:
            types = [self._node.get_parameter_type(name) for name in request.names]
        except ParameterNotDeclaredException:
            types = []
        response.types = [each.value if isinstance(each, ParameterKind) else each for each in types]
        return response

    def _list(self, request: Any, response: Any) -> Any:
        response.result = self._node.list_parameters(list(request.prefixes), int(request.depth))
        return response

    def _set(self, request: Any, response: Any) -> Any:
        results = []
        for message in request.parameters:
            try:
                results.append(self._node.set_parameters_atomically([Parameter.from_parameter_msg(message)]))
            except ParameterNotDeclaredException as error:
                results.append(result(str(error)))
        response.results = results
        return response

    def _set_atomically(self, request: Any, response: Any) -> Any:
        try:
            response.result = self._node.set_parameters_atomically(
                [Parameter.from_parameter_msg(message) for message in request.parameters]
            )
        except ParameterNotDeclaredException as error:
            response.result = result(str(error))
        return response


class LoggingService:
    """`rclpy.logging_service`: `~/get_logger_levels` and `~/set_logger_levels`."""

    def __init__(self, node: Node) -> None:
        for name, handler in (("get_logger_levels", self._get), ("set_logger_levels", self._set)):
            node.create_service(service_class(name), f"{node._rwt_full_name}/{name}", handler)

    def _get(self, request: Any, response: Any) -> Any:
        level = message_class("rcl_interfaces/LoggerLevel")
        response.levels = [level(name=name, level=int(output.get_level(name))) for name in request.names]
        return response

    def _set(self, request: Any, response: Any) -> Any:
        outcome = message_class("rcl_interfaces/SetLoggerLevelsResult")
        results = []
        for each in request.levels:
            try:
                output.set_level(each.name, each.level)
            except ValueError:
                reason = "Failed reason: Invalid logger level."
                results.append(outcome(successful=False, reason=reason))
            else:
                results.append(outcome(successful=True))
        response.results = results
        return response
