"""`launch.conditions`: conditions of actions."""

from __future__ import annotations

from rwt_rclpy.launch.entities import Condition as Condition
from rwt_rclpy.launch.entities import LaunchContext, LaunchError, SomeText, text, truth

InvalidConditionExpressionError = LaunchError


class IfCondition(Condition):
    """Condition: an expression is true."""

    def __init__(self, predicate_expression: SomeText) -> None:
        super().__init__(predicate=lambda context: truth(context, predicate_expression))


class UnlessCondition(Condition):
    """Condition: an expression is false."""

    def __init__(self, predicate_expression: SomeText) -> None:
        super().__init__(predicate=lambda context: not truth(context, predicate_expression))


class LaunchConfigurationEquals(Condition):
    """Condition: a configuration has a value; None: it does not exist."""

    def __init__(self, launch_configuration_name: str, expected_value: SomeText | None) -> None:
        def equals(context: LaunchContext) -> bool:
            value = context.launch_configurations.get(launch_configuration_name)
            expected = None if expected_value is None else text(context, expected_value)
            return bool(value == expected)

        super().__init__(predicate=equals)


class LaunchConfigurationNotEquals(LaunchConfigurationEquals):
    """Condition: a configuration has another value."""

    def evaluate(self, context: LaunchContext) -> bool:
        """True if the values differ."""
        return not super().evaluate(context)
