"""`rclpy.exceptions`: exceptions of rclpy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rwt_rclpy.parameters.parameter import Parameter


class NotInitializedException(Exception):
    """The context is not initialised, or was shut down."""

    def __init__(self, message: str | None = None) -> None:
        super().__init__("rclpy.init() has not been called." + (f" msg:{message}" if message else ""))


class NoTypeSupportImportedException(Exception):
    """The class has no type support."""

    def __init__(self) -> None:
        super().__init__("no type support: the class was not made from a definition")


class RCLError(RuntimeError):
    """Error that rcl would raise."""


class RMWError(RuntimeError):
    """Error that rmw would raise."""


class InvalidHandle(Exception):
    """The entity was destroyed."""


class NodeNameNonExistentError(RCLError):
    """The graph has no node of that name."""


class TimerCancelledError(RCLError):
    """The timer was cancelled."""


class UnsupportedEventTypeError(RCLError):
    """The middleware has no such event."""


class UnknownROSArgsError(RuntimeError):
    """An argument after ``--ros-args`` is unknown."""

    def __init__(self, arguments: Sequence[str]) -> None:
        super().__init__(f"{list(arguments)}")
        self.unknown_args = list(arguments)


class RCLInvalidROSArgsError(RCLError):
    """The value of an argument after ``--ros-args`` is invalid."""


class NameValidationException(Exception):
    """ROS does not allow the name.

    Attributes:
        name_type: kind of name.
        name: invalid name.
        error_msg: reason.
        invalid_index: position in the name.
    """

    def __init__(self, name_type: str, name: str, error_msg: str, invalid_index: int) -> None:
        super().__init__(f"Invalid {name_type}: {error_msg}:\n  '{name}'\n   {' ' * invalid_index}^")
        self.name_type = name_type
        self.name = name
        self.error_msg = error_msg
        self.invalid_index = invalid_index


class NameException(NameValidationException):
    """ROS does not allow a name of one kind."""

    kind = "name"

    def __init__(self, name: str, error_msg: str, invalid_index: int) -> None:
        super().__init__(self.kind, name, error_msg, invalid_index)


class InvalidNamespaceException(NameException):
    """ROS does not allow the namespace."""

    kind = "namespace"


class InvalidNodeNameException(NameException):
    """ROS does not allow the name for a node."""

    kind = "node name"


class InvalidTopicNameException(NameException):
    """ROS does not allow the name for a topic."""

    kind = "topic name"


class InvalidServiceNameException(NameException):
    """ROS does not allow the name for a service."""

    kind = "service name"


class ParameterException(Exception):
    """Base of the errors of parameters."""

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
    """ROS does not allow the name for a parameter."""

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
    """The parameter's range or a callback of the program rejected the value."""

    def __init__(self, parameter: str, value: Any, reason: str) -> None:
        super().__init__(f"Invalid parameter value ({value}) for parameter. Reason: {reason}", parameter)


class ParameterImmutableException(ParameterException):
    """The parameter is read-only."""

    def __init__(self, parameter_name: str) -> None:
        super().__init__("Attempted to modify read-only parameter", parameter_name)


class ParameterUninitializedException(ParameterException):
    """The parameter was declared without a value, and has none yet."""

    def __init__(self, parameter_name: str) -> None:
        super().__init__(f"The parameter '{parameter_name}' is not initialized", parameter_name)


class ROSInterruptException(Exception):
    """The context was shut down during a wait."""

    def __init__(self) -> None:
        super().__init__("rclpy.shutdown() has been called")
