"""`rosidl_runtime_py`: messages from and to YAML, dictionaries and names."""

from __future__ import annotations

import array
import tempfile
from collections import OrderedDict
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import yaml

from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.names import KINDS
from rwt_rclpy.messages.classes import Message
from rwt_rclpy.messages.loaded import classes, message_class
from rwt_rclpy.messages.slot_types import AbstractNestedType, NamespacedType

_ELLIPSIS: Final = "..."
Kind = Literal["msg", "srv", "action"]

# Messages out


def message_to_ordereddict(
    msg: Any, *, truncate_length: int | None = None, no_arr: bool = False, no_str: bool = False
) -> OrderedDict[str, Any]:
    """Return a message as dictionaries, lists and scalars; long values may be shortened or omitted."""
    return OrderedDict(
        (field, _plain(getattr(msg, field), kind, truncate_length, no_arr, no_str))
        for field, kind in msg.get_fields_and_field_types().items()
    )


def _plain(value: Any, kind: str, most: int | None, no_arr: bool, no_str: bool) -> Any:
    if isinstance(value, bytes):
        return value if len(value) == 1 else _shortened(list(value), most)
    if isinstance(value, str):
        if no_str:
            return f"<string length: <{len(value)}>>"
        return value if most is None or len(value) <= most else value[:most] + _ELLIPSIS
    if isinstance(value, (list, tuple, array.array, np.ndarray)):
        if no_arr:
            return (
                f"<{kind}, length: {len(value)}>"
                if "[" in kind
                else f"<sequence type: {kind}, length: {len(value)}>"
            )
        items = value.tolist() if isinstance(value, (array.array, np.ndarray)) else value
        return _shortened([_plain(item, kind, most, no_arr, no_str) for item in items], most)
    if isinstance(value, Message):
        return message_to_ordereddict(value, truncate_length=most, no_arr=no_arr, no_str=no_str)
    return value


def _shortened(items: list[Any], most: int | None) -> list[Any]:
    return items if most is None or len(items) <= most else [*items[:most], _ELLIPSIS]


def message_to_yaml(
    msg: Any,
    *,
    truncate_length: int | None = None,
    no_arr: bool = False,
    no_str: bool = False,
    flow_style: bool = False,
) -> str:
    """Return a message as YAML."""
    plain = message_to_ordereddict(msg, truncate_length=truncate_length, no_arr=no_arr, no_str=no_str)
    text = yaml.safe_dump(
        _unordered(plain), sort_keys=False, allow_unicode=True, width=2**31, default_flow_style=flow_style
    )
    return str(text)


def _unordered(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _unordered(inner) for key, inner in value.items()}
    return [_unordered(item) for item in value] if isinstance(value, list) else value


def message_to_csv(
    msg: Any, *, truncate_length: int | None = None, no_arr: bool = False, no_str: bool = False
) -> str:
    """Return the values of a message, separated by commas."""
    values: list[str] = []

    def collect(value: Any) -> None:
        if isinstance(value, dict):
            for inner in value.values():
                collect(inner)
        elif isinstance(value, list):
            for inner in value:
                collect(inner)
        else:
            values.append(str(value))

    collect(message_to_ordereddict(msg, truncate_length=truncate_length, no_arr=no_arr, no_str=no_str))
    return ",".join(values)


# Messages in


def set_message_fields(
    msg: Any, values: Any, expand_header_auto: bool = False, expand_time_now: bool = False
) -> list[Any]:
    """Set fields of a message from a dictionary, or from a list in the order of the fields.

    Args:
        msg: the message.
        values: by field name; nested messages by dictionaries.
        expand_header_auto: True if a header may be ``auto``.
        expand_time_now: True if a time may be ``now``.

    Returns:
        Functions that set these times to the current time.

    Raises:
        AttributeError: the message has no such field.
        TypeError: a value does not fit its field.
    """
    later: list[Any] = []
    _set(msg, values, expand_header_auto, expand_time_now, later)
    return later


def _set(msg: Any, values: Any, auto: bool, now: bool, later: list[Any]) -> None:
    names = list(msg.get_fields_and_field_types())
    if isinstance(values, (list, tuple)):
        values = dict(zip(names, values, strict=False))
    if not isinstance(values, dict):
        raise TypeError(f"{type(msg).__name__}: expected a dictionary of {', '.join(names)}, got {values!r}")
    for name, value in values.items():
        if name not in names:
            raise AttributeError(f"{type(msg).__name__} has no field {name!r}; it has {', '.join(names)}")
        present = getattr(msg, name)
        if auto and value == "auto" and isinstance(present, message_class("std_msgs/Header")):
            later.append(lambda stamp, present=present: setattr(present, "stamp", stamp))
        elif now and value == "now" and isinstance(present, message_class("builtin_interfaces/Time")):
            later.append(lambda stamp, name=name: setattr(msg, name, stamp))
        elif isinstance(present, Message):
            _set(present, value, auto, now, later)
        else:
            setattr(msg, name, _fitting(msg, name, value, present, (auto, now, later)))


def _fitting(msg: Any, name: str, value: Any, present: Any, rest: tuple[bool, bool, list[Any]]) -> Any:
    kind = dict(zip(msg.get_fields_and_field_types(), msg.SLOT_TYPES, strict=True))[name]
    if isinstance(kind, AbstractNestedType):
        element = kind.value_type
        if isinstance(element, NamespacedType):
            made = []
            for each in value:
                item = message_class(f"{element.namespaces[0]}/{element.name}")()
                _set(item, each, *rest)
                made.append(item)
            return made
        if isinstance(present, np.ndarray):
            return np.array(value, present.dtype)
        if isinstance(present, array.array) and present.typecode in "fd":
            return array.array(present.typecode, [float(each) for each in value])
        return list(value) if not isinstance(value, (bytes, array.array)) else value
    try:
        return value if isinstance(value, type(present)) else type(present)(value)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{type(msg).__name__}.{name}: {error}") from None


# Names


def get_interface(identifier: str) -> Any:
    """Return the class of ``pkg/msg/Name`` and similar names.

    Raises:
        ValueError: the name has another form.
        ModuleNotFoundError: there is no such package.
        AttributeError: the package has no such interface.
    """
    parts = identifier.split("/")
    if len(parts) != 3 or not all(parts):
        raise ValueError(f"{identifier!r} is not the name of an interface: expected pkg/msg/Name")
    package, kind, _ = parts
    if kind not in KINDS:
        raise ValueError(f"{identifier!r}: {kind!r} is none of {', '.join(KINDS)}")
    if package not in get_interface_packages():
        raise ModuleNotFoundError(f"No module named '{package}'", name=package)
    try:
        return classes().by_type_name(identifier)
    except InterfaceError as error:
        raise AttributeError(str(error)) from None


def _of_kind(identifier: str, kind: Kind) -> Any:
    parts = identifier.split("/")
    if len(parts) == 2:
        identifier = f"{parts[0]}/{kind}/{parts[1]}"
    elif len(parts) == 3 and parts[1] != kind:
        raise ValueError(f"expected the full name of a {kind}, such as pkg/{kind}/Name, got {identifier!r}")
    return get_interface(identifier)


def get_message(identifier: str) -> Any:
    """Return the class of a message, also for ``pkg/Name``."""
    return _of_kind(identifier, "msg")


def get_service(identifier: str) -> Any:
    """Return the class of a service."""
    return _of_kind(identifier, "srv")


def get_action(identifier: str) -> Any:
    """Return the class of an action."""
    return _of_kind(identifier, "action")


def import_message_from_namespaced_type(message_type: NamespacedType) -> Any:
    """Return the class of a nested message's type."""
    return classes().by_type_name("/".join(message_type.namespaced_name()))


def is_message(interface: Any) -> bool:
    """True if a class is a message."""
    return isinstance(interface, type) and issubclass(interface, Message)


def is_service(interface: Any) -> bool:
    """True if a class is a service."""
    return hasattr(interface, "Request") and hasattr(interface, "Response")


def is_action(interface: Any) -> bool:
    """True if a class is an action."""
    return all(hasattr(interface, part) for part in ("Goal", "Result", "Feedback"))


def get_interface_packages() -> dict[str, str]:
    """Return the packages with interfaces, which have no folders."""
    names = classes().registry.names
    return {name.partition("/")[0]: "" for kind in KINDS for name in names(kind)}


def _interfaces(kinds: Iterable[Kind], package_names: Iterable[str]) -> dict[str, list[str]]:
    wanted, known = set(package_names), get_interface_packages()
    unknown = wanted - set(known)
    if unknown:
        raise LookupError(f"Unknown package {', '.join(sorted(unknown))}")
    found: dict[str, list[str]] = {}
    for kind in kinds:
        for full in classes().registry.names(kind):
            package, _, name = full.partition("/")
            if not wanted or package in wanted:
                found.setdefault(package, []).append(f"{kind}/{name}")
    return found


def get_interfaces(package_names: Iterable[str] = ()) -> dict[str, list[str]]:
    """Return the interfaces by package, such as ``msg/Name``. Raises LookupError for an unknown package."""
    return _interfaces(KINDS, package_names)


def get_message_interfaces(package_names: Iterable[str] = ()) -> dict[str, list[str]]:
    """Return the messages by package."""
    return _bare(_interfaces(("msg",), package_names))


def get_service_interfaces(package_names: Iterable[str] = ()) -> dict[str, list[str]]:
    """Return the services by package."""
    return _bare(_interfaces(("srv",), package_names))


def get_action_interfaces(package_names: Iterable[str] = ()) -> dict[str, list[str]]:
    """Return the actions by package."""
    return _bare(_interfaces(("action",), package_names))


def _bare(found: dict[str, list[str]]) -> dict[str, list[str]]:
    return {package: [name.partition("/")[2] for name in names] for package, names in found.items()}


def get_interface_path(interface_name: str) -> str:
    """Return a file with the text of an interface, which is removed at the end of the program.

    Raises:
        LookupError: there is no such interface.
    """
    package, kind, name = interface_name.split("/")
    known = classes().registry
    full = f"{package}/{name}"
    if kind == "srv":
        service = known.service(full)
        parts = [service.request, service.response]
    elif kind == "action":
        action = known.action(full)
        parts = [action.goal, action.result, action.feedback]
    else:
        parts = [known.message(full)]
    path = Path(_folder().name) / package / kind / f"{name}.{kind}"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n---\n".join(part.definition.text for part in parts), "utf-8")
    return str(path)


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="interfaces_")


__path__: list[str] = []
