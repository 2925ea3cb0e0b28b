"""Parameters of one node, with the methods of `rclpy.node.Node` about them."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from typing import Any

from rwt_rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterAlreadyDeclaredException,
    ParameterImmutableException,
    ParameterNotDeclaredException,
    ParameterUninitializedException,
)
from rwt_rclpy.messages.loaded import message_class
from rwt_rclpy.names.validation import validate_parameter_name
from rwt_rclpy.parameters.parameter import (
    PARAMETER_SEPARATOR_STRING,
    Parameter,
    ParameterKind,
    parameter_value_to_python,
)

PreSet = Callable[[list[Parameter]], list[Parameter]]
OnSet = Callable[[list[Parameter]], Any]
PostSet = Callable[[list[Parameter]], object]


def result(reason: str = "") -> Any:
    """Return a `rcl_interfaces/SetParametersResult`; without a reason, it is successful."""
    return message_class("rcl_interfaces/SetParametersResult")(successful=not reason, reason=reason)


class NodeParameters:
    """Parameters of a node."""

    #: Tolerance of the comparison of doubles.
    PARAM_REL_TOL = 1e-6

    def __init__(
        self,
        overrides: dict[str, Parameter],
        allow_undeclared: bool,
        announce: Callable[[list[tuple[Parameter | None, Parameter]]], None],
    ) -> None:
        self._parameters: dict[str, Parameter] = {}
        self._descriptors: dict[str, Any] = {}
        self._parameter_overrides = overrides
        self._allow_undeclared_parameters = allow_undeclared
        self._rwt_announce = announce
        self._pre_set_parameters_callbacks: list[PreSet] = []
        self._on_set_parameters_callbacks: list[OnSet] = []
        self._post_set_parameters_callbacks: list[PostSet] = []

    # Declaring

    def declare_parameter(
        self, name: str, value: Any = None, descriptor: Any = None, ignore_override: bool = False
    ) -> Parameter:
        """Declare a parameter, with the value of the command line or else the given one.

        Raises:
            ParameterAlreadyDeclaredException: it was declared before.
            InvalidParameterException: its name is empty.
            InvalidParameterValueException: a range or a callback rejects the value.
            InvalidParameterTypeException: the value of the command line is of another type.
        """
        if value is None and descriptor is None:
            return self.declare_parameters("", [(name,)], ignore_override)[0]
        descriptor = descriptor or message_class("rcl_interfaces/ParameterDescriptor")()
        return self.declare_parameters("", [(name, value, descriptor)], ignore_override)[0]

    def declare_parameters(
        self, namespace: str, parameters: Sequence[tuple[Any, ...]], ignore_override: bool = False
    ) -> list[Parameter]:
        """Declare several parameters: name, value or type, and descriptor of each.

        Raises:
            TypeError: an item has another form.
            ValueError: one has neither a type nor a value.
        """
        declared: list[Parameter] = []
        descriptors: dict[str, Any] = {}
        for index, given in enumerate(parameters):
            parameter, descriptor = self._declaration(namespace, index, given, ignore_override)
            declared.append(parameter)
            descriptors[parameter.name] = descriptor
        known = [parameter.name for parameter in declared if parameter.name in self._parameters]
        if known:
            raise ParameterAlreadyDeclaredException(known)
        for parameter in declared:
            outcome = self._set_all([parameter], descriptors, declaring=True)
            if not outcome.successful:
                expected = ParameterKind(descriptors[parameter.name].type)
                if parameter.type_ is not expected and not descriptors[parameter.name].dynamic_typing:
                    raise InvalidParameterTypeException(parameter, expected.name)
                raise InvalidParameterValueException(parameter.name, parameter.value, outcome.reason)
        return [self._parameters[parameter.name] for parameter in declared]

    def _declaration(
        self, namespace: str, index: int, given: tuple[Any, ...], ignore_override: bool
    ) -> tuple[Parameter, Any]:
        if not 1 <= len(given) <= 3:
            raise TypeError(
                f"Invalid parameter tuple length at index {index} in parameters list: {given};"
                " expecting length between 1 and 3"
            )
        name = given[0]
        if not isinstance(name, str):
            raise TypeError(f"First element {name} at index {index} in parameters list is not a str.")
        name = f"{namespace}.{name}" if namespace else name
        validate_parameter_name(name)
        second = given[1] if len(given) > 1 else None
        descriptor_class = message_class("rcl_interfaces/ParameterDescriptor")
        descriptor: Any = given[2] if len(given) > 2 else descriptor_class()
        if not isinstance(descriptor, descriptor_class):
            raise TypeError(
                f"Third element {descriptor} at index {index} in parameters list is not a"
                " ParameterDescriptor."
            )
        if len(given) == 1:
            warnings.warn(
                f"parameter '{name}' is declared by its name alone, which is deprecated: give a value,"
                " a type, or a descriptor with dynamic_typing=True",
                stacklevel=4,
            )
            descriptor.dynamic_typing = True
        value = None
        if isinstance(second, ParameterKind):
            self._declare_type(name, second, descriptor)
        else:
            value = second
            if isinstance(value, message_class("rcl_interfaces/ParameterValue")):
                value = parameter_value_to_python(value)
            if not descriptor.dynamic_typing:
                kind = ParameterKind.from_parameter_value(value)
                if kind is ParameterKind.NOT_SET:
                    raise ValueError(
                        f"parameter '{name}': Cannot declare a statically typed parameter with default"
                        " value of type PARAMETER_NOT_SET; give its type, or set dynamic_typing=True"
                    )
                descriptor.type = kind.value
        if not ignore_override and name in self._parameter_overrides:
            value = self._parameter_overrides[name].value
        return Parameter(name, value=value), descriptor

    def _declare_type(self, name: str, kind: ParameterKind, descriptor: Any) -> None:
        if kind is ParameterKind.NOT_SET:
            raise ValueError(f"Cannot declare parameter {{{name}}} as statically typed of type NOT_SET")
        if descriptor.dynamic_typing:
            raise ValueError(f"parameter '{name}' has a type, and a descriptor with dynamic_typing=True")
        descriptor.type = kind.value

    def undeclare_parameter(self, name: str) -> None:
        """Undeclare a parameter.

        Raises:
            ParameterNotDeclaredException: it was not declared.
            ParameterImmutableException: it is read-only.
        """
        if name not in self._parameters:
            raise ParameterNotDeclaredException(name)
        if self._descriptors[name].read_only:
            raise ParameterImmutableException(name)
        del self._parameters[name], self._descriptors[name]

    def has_parameter(self, name: str) -> bool:
        """True if the parameter was declared."""
        return name in self._parameters

    # Getting

    def get_parameter_types(self, names: Sequence[str]) -> list[Any]:
        """Return the types of several parameters."""
        self._check_names(names)
        return [self.get_parameter_type(name) for name in names]

    def get_parameter_type(self, name: str) -> Any:
        """Return the number of a parameter's type. Raises ParameterNotDeclaredException."""
        if name in self._parameters:
            return self._parameters[name].type_.value
        if self._allow_undeclared_parameters:
            return ParameterKind.NOT_SET
        raise ParameterNotDeclaredException(name)

    def get_parameters(self, names: Sequence[str]) -> list[Parameter]:
        """Return several parameters."""
        self._check_names(names)
        return [self.get_parameter(name) for name in names]

    @staticmethod
    def _check_names(names: Sequence[str]) -> None:
        if not all(isinstance(name, str) for name in names):
            raise TypeError("All names must be instances of type str")

    def get_parameter(self, name: str) -> Parameter:
        """Return a parameter.

        Raises:
            ParameterNotDeclaredException: it was not declared.
            ParameterUninitializedException: it was declared with a type, and has no value yet.
        """
        found = self._parameters.get(name)
        if found is not None:
            if found.type_ is ParameterKind.NOT_SET and not self._descriptors[name].dynamic_typing:
                raise ParameterUninitializedException(name)
            return found
        if self._allow_undeclared_parameters:
            return Parameter(name, ParameterKind.NOT_SET, None)
        raise ParameterNotDeclaredException(name)

    def get_parameter_or(self, name: str, alternative_value: Parameter | None = None) -> Parameter:
        """Return a parameter, or an alternative if it has no value."""
        found = self._parameters.get(name)
        if found is None or found.type_ is ParameterKind.NOT_SET:
            return alternative_value or Parameter(name, ParameterKind.NOT_SET)
        return found

    def get_parameters_by_prefix(self, prefix: str) -> dict[str, Parameter]:
        """Return the parameters below a prefix, by the rest of their names."""
        start = f"{prefix}{PARAMETER_SEPARATOR_STRING}" if prefix else ""
        return {
            name[len(start) :]: value for name, value in self._parameters.items() if name.startswith(start)
        }

    def list_parameters(self, prefixes: Sequence[str], depth: int) -> Any:
        """Return names and prefixes as `rcl_interfaces/ListParametersResult`.

        Raises:
            TypeError: a prefix is not a str, or the depth not an int.
            ValueError: the depth is negative.
        """
        if not isinstance(prefixes, (list, tuple)) or not all(isinstance(each, str) for each in prefixes):
            raise TypeError("All prefixes must be instances of type str")
        if not isinstance(depth, int):
            raise TypeError("Depth must be instance of type int")
        if depth < 0:
            raise ValueError("Depth must be greater than or equal to zero")
        names = [name for name in self._parameters if self._is_listed(name, prefixes, depth)]
        above = (name.rpartition(PARAMETER_SEPARATOR_STRING)[0] for name in names)
        return message_class("rcl_interfaces/ListParametersResult")(
            names=names, prefixes=list(dict.fromkeys(each for each in above if each))
        )

    @staticmethod
    def _is_listed(name: str, prefixes: Sequence[str], depth: int) -> bool:
        separator = PARAMETER_SEPARATOR_STRING
        if not prefixes:
            return depth == 0 or name.count(separator) < depth
        return any(
            name == prefix
            or (
                name.startswith(prefix + separator)
                and (depth == 0 or name[len(prefix) + 1 :].count(separator) < depth)
            )
            for prefix in prefixes
        )

    # Setting

    def set_parameters(self, parameter_list: list[Parameter]) -> list[Any]:
        """Set parameters one after the other; return a result for each.

        Raises:
            ParameterNotDeclaredException: one was not declared; those before it are set.
        """
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> Any:
        """Set all of them or none.

        Raises:
            ParameterNotDeclaredException: one was not declared.
        """
        if self._pre_set_parameters_callbacks:
            changed: list[Parameter] = []
            for callback in self._pre_set_parameters_callbacks:
                changed.extend(callback(parameter_list))
            if not changed:
                return result(
                    "parameter list cannot be empty, this might be due to pre_set_parameters_callback"
                    " modifying the original parameters list."
                )
            parameter_list = changed
        if not all(isinstance(parameter, Parameter) for parameter in parameter_list):
            raise TypeError("parameter must be instance of type '<class 'rclpy.parameter.Parameter'>'")
        unknown = [each.name for each in parameter_list if each.name not in self._parameters]
        if unknown and not self._allow_undeclared_parameters:
            raise ParameterNotDeclaredException(unknown)
        return self._set_all(parameter_list)

    def _set_all(
        self,
        parameters: list[Parameter],
        descriptors: dict[str, Any] | None = None,
        *,
        declaring: bool = False,
    ) -> Any:
        for parameter in parameters:
            descriptor = (descriptors or self._descriptors).get(parameter.name)
            wrong = "" if descriptor is None else self._wrong(parameter, descriptor, read_only=not declaring)
            if wrong:
                return result(wrong)
        for callback in self._on_set_parameters_callbacks:
            answer = callback(parameters)
            if not isinstance(answer, message_class("rcl_interfaces/SetParametersResult")):
                return result("Callback returned an invalid type")
            if not answer.successful:
                return answer
        changes: list[tuple[Parameter | None, Parameter]] = []
        for parameter in parameters:
            name = parameter.name
            changes.append((self._parameters.get(name), parameter))
            if parameter.type_ is ParameterKind.NOT_SET and not declaring:
                self._parameters.pop(name, None)
                self._descriptors.pop(name, None)
                continue
            self._parameters[name] = parameter
            descriptor = (descriptors or {}).get(name) or self._descriptors.get(name)
            if descriptor is None:
                descriptor = message_class("rcl_interfaces/ParameterDescriptor")(dynamic_typing=True)
            descriptor.name = name
            if descriptor.dynamic_typing:
                descriptor.type = parameter.type_.value
            self._descriptors[name] = descriptor
        self._rwt_announce(changes)
        for post in self._post_set_parameters_callbacks:
            post(parameters)
        return result()

    def _wrong(self, parameter: Parameter, descriptor: Any, *, read_only: bool = True) -> str:
        """Return the reason for rejecting a value; empty if it is valid."""
        kind = parameter.type_
        if read_only and descriptor.read_only:
            return f"Trying to set a read-only parameter: {parameter.name}."
        if not descriptor.dynamic_typing:
            if kind is ParameterKind.NOT_SET:
                return "Static parameter cannot be undeclared" if self.has_parameter(parameter.name) else ""
            if kind.value != descriptor.type:
                expected = ParameterKind(descriptor.type)
                return f"Wrong parameter type, expected '{expected}' got '{kind}'"
        if kind is ParameterKind.INTEGER and descriptor.integer_range:
            return self._outside(parameter, descriptor.integer_range[0], exact=True)
        if kind is ParameterKind.DOUBLE and descriptor.floating_point_range:
            return self._outside(parameter, descriptor.floating_point_range[0], exact=False)
        return ""

    def _outside(self, parameter: Parameter, span: Any, *, exact: bool) -> str:
        def equal(one: float, other: float) -> bool:
            return one == other if exact else math.isclose(one, other, rel_tol=self.PARAM_REL_TOL)

        value = parameter.value
        low, high = sorted((span.from_value, span.to_value))
        if equal(value, low) or equal(value, high):
            return ""
        if not low < value < high:
            stop = "." if exact else ""
            return f"Parameter {parameter.name} out of range{stop} Min: {low}, Max: {high}, value: {value}"
        if span.step:
            nearest = low + round((value - low) / span.step) * span.step
            if not equal(nearest, value):
                what = "a valid step" if exact else "close enough to a valid step"
                return (
                    f"The parameter value for {parameter.name} is not {what}. Min: {low}, max: {high},"
                    f" value: {value}, step: {span.step}"
                )
        return ""

    # Descriptors

    def describe_parameter(self, name: str) -> Any:
        """Return a parameter's descriptor. Raises ParameterNotDeclaredException."""
        found = self._descriptors.get(name)
        if found is not None:
            return found
        if self._allow_undeclared_parameters:
            return message_class("rcl_interfaces/ParameterDescriptor")()
        raise ParameterNotDeclaredException(name)

    def describe_parameters(self, names: Sequence[str]) -> list[Any]:
        """Return the descriptors of several parameters."""
        return [self.describe_parameter(name) for name in names]

    def set_descriptor(self, name: str, descriptor: Any, alternative_value: Any = None) -> Any:
        """Set a parameter's descriptor, and another value if the current one does not fit it.

        Returns:
            Resulting value, as `rcl_interfaces/ParameterValue`.

        Raises:
            ParameterNotDeclaredException: it was not declared.
            ParameterImmutableException: it is read-only.
            ParameterValueException: neither value fits.
        """
        if name not in self._parameters:
            if not self._allow_undeclared_parameters:
                raise ParameterNotDeclaredException(name)
            return self.get_parameter(name).get_parameter_value()
        if self.describe_parameter(name).read_only:
            raise ParameterImmutableException(name)
        current = self._parameters[name]
        if alternative_value is None:
            chosen = current
        else:
            message = message_class("rcl_interfaces/Parameter")(name=name, value=alternative_value)
            chosen = Parameter.from_parameter_msg(message)
        if descriptor.dynamic_typing:
            descriptor.type = chosen.type_.value
        wrong = self._wrong(chosen, descriptor, read_only=False)
        if wrong:
            raise InvalidParameterValueException(name, chosen.value, wrong)
        descriptor.name = name
        self._descriptors[name] = descriptor
        self._parameters[name] = chosen
        return chosen.get_parameter_value()

    # Callbacks, the last added first

    def add_pre_set_parameters_callback(self, callback: PreSet) -> None:
        """Add a callback that may change values before they are checked."""
        self._pre_set_parameters_callbacks.insert(0, callback)

    def add_on_set_parameters_callback(self, callback: OnSet) -> None:
        """Add a callback that may reject values."""
        self._on_set_parameters_callbacks.insert(0, callback)

    def add_post_set_parameters_callback(self, callback: PostSet) -> None:
        """Add a callback for set values."""
        self._post_set_parameters_callbacks.insert(0, callback)

    def remove_pre_set_parameters_callback(self, callback: PreSet) -> None:
        """Remove a callback. Raises ValueError if it was not added."""
        self._pre_set_parameters_callbacks.remove(callback)

    def remove_on_set_parameters_callback(self, callback: OnSet) -> None:
        """Remove a callback. Raises ValueError if it was not added."""
        self._on_set_parameters_callbacks.remove(callback)

    def remove_post_set_parameters_callback(self, callback: PostSet) -> None:
        """Remove a callback. Raises ValueError if it was not added."""
        self._post_set_parameters_callbacks.remove(callback)
