"""Services of a node for parameters, loggers and type descriptions."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rwt_rclpy.endpoints.qos import qos_profile_parameters
from rwt_rclpy.exceptions import ParameterNotDeclaredException, ParameterUninitializedException
from rwt_rclpy.logs import output
from rwt_rclpy.messages.loaded import classes, message_class
from rwt_rclpy.parameters.parameter import Parameter, ParameterKind

if TYPE_CHECKING:
    from rwt_rclpy.nodes.node import Node

Handler = Callable[[Any, Any], Any]


class ParameterService:
    """`rclpy.parameter_service`: the six parameter services of a node."""

    def __init__(self, node: Node) -> None:
        self._node = node
        handlers: dict[str, tuple[str, Handler]] = {
            "describe_parameters": ("DescribeParameters", self._describe),
            "get_parameters": ("GetParameters", self._get),
            "get_parameter_types": ("GetParameterTypes", self._types),
            "list_parameters": ("ListParameters", self._list),
            "set_parameters": ("SetParameters", self._set),
            "set_parameters_atomically": ("SetParametersAtomically", self._set_atomically),
        }
        for name, (kind, handler) in handlers.items():
            service = classes().service(f"rcl_interfaces/{kind}")
            node.create_service(
                service, f"{node._rwt_service_prefix()}/{name}", handler, qos_profile=qos_profile_parameters
            )

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
                results.append(_refused(error))
        response.results = results
        return response

    def _set_atomically(self, request: Any, response: Any) -> Any:
        try:
            response.result = self._node.set_parameters_atomically(
                [Parameter.from_parameter_msg(message) for message in request.parameters]
            )
        except ParameterNotDeclaredException as error:
            response.result = _refused(error)
        return response


def _refused(error: Exception) -> Any:
    return message_class("rcl_interfaces/SetParametersResult")(successful=False, reason=str(error))


class LoggingService:
    """`rclpy.logging_service`: `~/get_logger_levels` and `~/set_logger_levels`."""

    def __init__(self, node: Node) -> None:
        names = classes()
        base = node._rwt_service_prefix()
        node.create_service(
            names.service("rcl_interfaces/GetLoggerLevels"), f"{base}/get_logger_levels", self._get
        )
        node.create_service(
            names.service("rcl_interfaces/SetLoggerLevels"), f"{base}/set_logger_levels", self._set
        )

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
