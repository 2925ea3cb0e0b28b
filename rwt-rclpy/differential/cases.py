"""Answers cases that `differential.generated` generates, one line of JSON each.

It runs in the interpreter of ROS as well, and therefore imports nothing of this project but for `--ours`.
"""

from __future__ import annotations

import importlib
import json
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent


def _outcome(function: Callable[..., Any], *arguments: Any, **options: Any) -> str:
    try:
        return repr(function(*arguments, **options))
    except Exception as error:
        return f"raises {type(error).__name__}"


def _value(case: Any) -> Any:
    """Return the value of a case; bytes are written as {"bytes": [numbers]}."""
    if isinstance(case, dict):
        return bytes(case["bytes"])
    return [_value(each) for each in case] if isinstance(case, list) else case


def messages(package: str, name: str, fields: dict[str, Any]) -> list[str]:
    """Assign fields of a message, and serialise it."""
    from rclpy.serialization import deserialize_message, serialize_message

    kind = getattr(importlib.import_module(f"{package}.msg"), name)
    message = kind()
    answers = [_outcome(setattr, message, field, _value(value)) for field, value in fields.items()]
    accepted = {
        field: _value(fields[field]) for field, each in zip(fields, answers, strict=True) if each == "None"
    }
    text, read = repr(message), repr(deserialize_message(serialize_message(message), kind))
    return [
        *answers,
        text,
        "the same" if read == text else read,
        _outcome(lambda: kind(**accepted) == message),
    ]


def qos(offered: dict[str, Any], requested: dict[str, Any]) -> list[str]:
    """Create two profiles, and compare them as those of a publisher and a subscription."""
    from rclpy.duration import Duration
    from rclpy.qos import QoSProfile, qos_check_compatible

    def profile(policies: dict[str, Any]) -> Any:
        return QoSProfile(
            **{
                name: Duration(nanoseconds=value["ns"]) if isinstance(value, dict) else value
                for name, value in policies.items()
            }
        )

    def check() -> tuple[int, str]:
        result, reason = qos_check_compatible(profile(offered), profile(requested))
        return int(result), reason

    return [*(_outcome(lambda p=each: str(profile(p))) for each in (offered, requested)), _outcome(check)]


def names(name: str, other: str) -> list[str]:
    """Validate and expand a name in any role."""
    from rclpy.expand_topic_name import expand_topic_name
    from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden
    from rclpy.validate_full_topic_name import validate_full_topic_name
    from rclpy.validate_namespace import validate_namespace
    from rclpy.validate_node_name import validate_node_name
    from rclpy.validate_parameter_name import validate_parameter_name
    from rclpy.validate_topic_name import validate_topic_name

    return [
        *(
            _outcome(function, name)
            for function in (
                validate_node_name, validate_namespace, validate_topic_name, validate_full_topic_name,
                validate_parameter_name, topic_or_service_is_hidden,
            )
        ),
        _outcome(validate_topic_name, name, is_service=True),
        _outcome(expand_topic_name, name, "node", "/ns"),
        _outcome(expand_topic_name, "a", name, "/" + other),
        _outcome(expand_topic_name, "~/a", "node", name),
    ]  # fmt: skip


@contextmanager
def _initialised(arguments: list[str]) -> Iterator[Any]:
    import rclpy

    rclpy.init(args=arguments)
    try:
        made = rclpy.create_node("node", namespace="ns", start_parameter_services=False, enable_rosout=False)
        yield made
        made.destroy_node()
    finally:
        rclpy.try_shutdown()


def _overrides(node: Any) -> str:
    return str(
        {name: (each.type_.name, each.value) for name, each in sorted(node._parameter_overrides.items())}
    )


def yaml(text: str) -> list[str]:
    """Start a node with a file of parameters."""

    def start() -> str:
        with tempfile.NamedTemporaryFile("w", suffix=".yaml", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            with _initialised(["--ros-args", "--params-file", file.name]) as node:
                return _overrides(node)

    return [_outcome(start)]


def arguments(*given: str) -> list[str]:
    """Start a node with arguments."""
    from rclpy.utilities import remove_ros_args

    def start() -> list[str]:
        with _initialised(list(given)) as node:
            return [
                node.get_fully_qualified_name(),
                *(node.resolve_topic_name(each) for each in ("a", "/b", "~/a", "c/a")),
                *(node.resolve_service_name(each) for each in ("a", "~/b")),
                _overrides(node),
            ]

    return [_outcome(start), _outcome(remove_ros_args, ["program", *given])]


AREAS = {function.__name__: function for function in (messages, qos, names, yaml, arguments)}


def main() -> None:
    """Answer one case per line of the standard input."""
    if "--ours" in sys.argv:
        import rwt_rclpy

        rwt_rclpy.install([HERE / "interfaces"])
    warnings.simplefilter("ignore")
    for line in sys.stdin:
        area, case = json.loads(line)
        print(json.dumps(AREAS[area](*case)), flush=True)


if __name__ == "__main__":
    main()
