"""`rclpy.exceptions`: what rclpy raises, under the names that programs catch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rwt_rclpy.parameters.parameter import Parameter


class NotInitializedException(Exception):
    """The context is not initialised, or was shut down."""

    def __init__(self, message: str | None = None) -> None:
        super().__init__(
            "the context is not initialized: call rclpy.init() first" + (f" ({message})" if message else "")
        )


class NoTypeSupportImportedException(Exception):
    """The class has no type behind it."""

    def __init__(self) -> None:
        super().__init__("no type support: the class was not made from a definition")


class RCLError(RuntimeError):
    """Error that rcl would raise."""


class RMWError(RuntimeError):
    """Error that rmw would raise."""


class InvalidHandle(Exception):
    """The entity was destroyed."""


class NodeNameNonExistentError(RCLError):
    """No node of that name is in the graph."""


class TimerCancelledError(RCLError):
    """The timer was cancelled."""


class UnsupportedEventTypeError(RCLError):
    """The middleware has no such event."""


class UnknownROSArgsError(RuntimeError):
    """An argument after ``--ros-args`` that ROS does not have."""

    def __init__(self, arguments: Sequence[str]) -> None:
        super().__init__(f"Found unknown ROS arguments: {list(arguments)}")
        self.unknown_args = list(arguments)


class RCLInvalidROSArgsError(RCLError):
    """An argument after ``--ros-args`` whose value cannot be read."""


class NameValidationException(Exception):
    """A name that ROS does not allow.

    Attributes:
        name_type: what kind of name it is.
        name: the name.
        error_msg: what is wrong.
        invalid_index: where in the name.
    """

    def __init__(self, name_type: str, name: str, error_msg: str, invalid_index: int) -> None:
        super().__init__(f"Invalid {name_type}: {error_msg}:\n  '{name}'\n   {' ' * invalid_index}^")
        self.name_type = name_type
        self.name = name
        self.error_msg = error_msg
        self.invalid_index = invalid_index


class _NameException(NameValidationException):
    kind = "name"

    def __init__(self, name: str, error_msg: str, invalid_index: int) -> None:
        super().__init__(self.kind, name, error_msg, invalid_index)


class InvalidNamespaceException(_NameException):
    """A namespace that ROS does not allow."""

    kind = "namespace"


class InvalidNodeNameException(_NameException):
    """A name of a node that ROS does not allow."""

    kind = "node name"


class InvalidTopicNameException(_NameException):
    """A name of a topic that ROS does not allow."""

    kind = "topic name"


class InvalidServiceNameException(_NameException):
    """A name of a service that ROS does not allow."""

    kind = "service name"


class ParameterException(Exception):
    """Base of what is wrong with parameters."""

    def __init__(self, error_msg: str, parameters: object) -> None:
        super().__init__(f"{error_msg}: {parameters}")


class ParameterNotDeclaredException(ParameterException):
    """The parameter was not declared."""

    def __init__(self, parameters: object) -> None:
        super().__init__("Invalid access to undeclared parameter(s)", parameters)


class ParameterAlreadyDeclaredException(ParameterException):
    """The parameter was declared before."""

    def __init__(self, parameters: object) -> None:
        super().__init__("Parameter(s) already declared", parameters)


class InvalidParameterException(ParameterException):
    """A name of a parameter that ROS does not allow."""

    def __init__(self, parameter_name: str) -> None:
        super().__init__("Invalid parameter name", parameter_name)


class InvalidParameterTypeException(ParameterException):
    """The parameter has another type."""

    def __init__(self, desired_parameter: Parameter, expected_type: object) -> None:
        super().__init__(
            f"'{desired_parameter.name}' was declared with type '{expected_type}'; "
            f"{desired_parameter.value!r} is of type '{desired_parameter.type_.name}'",
            desired_parameter.name,
        )


class InvalidParameterValueException(ParameterException):
    """The parameter's range or a callback of the program refused the value."""

    def __init__(self, parameter: str, value: Any, reason: str) -> None:
        super().__init__(f"Invalid parameter value ({value}) for parameter. Reason: {reason}", parameter)


class ParameterImmutableException(ParameterException):
    """The parameter is read-only."""

    def __init__(self, parameter_name: str) -> None:
        super().__init__("Attempted to modify read-only parameter", parameter_name)


class ParameterUninitializedException(ParameterException):
    """The parameter was declared without a value, and has got none."""

    def __init__(self, parameter_name: str) -> None:
        super().__init__("the parameter has no value yet", parameter_name)


class ROSInterruptException(Exception):
    """The context was shut down during a wait."""

    def __init__(self) -> None:
        super().__init__("rclpy.shutdown() has been called")
