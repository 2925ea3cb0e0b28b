"""Values of messages, as both sides of a test can compare them."""

from __future__ import annotations

from typing import Any, Final

#: Messages of `test_msgs`, which has every kind of field.
TYPES: Final = [
    *(
        "Arrays",
        "BasicTypes",
        "BoundedPlainSequences",
        "BoundedSequences",
        "Builtins",
        "Constants",
        "Defaults",
    ),
    *("Empty", "MultiNested", "Nested", "Strings", "UnboundedSequences", "WStrings"),
]


def comparable(value: Any) -> Any:
    """Return a message as `tests.extensions.ros2.live.program.plain` does."""
    if hasattr(value, "__struct_fields__"):
        return {name: comparable(getattr(value, name)) for name in value.__struct_fields__}
    if isinstance(value, (bytes, bytearray, memoryview)):
        return list(value)
    if isinstance(value, str):
        return value
    if hasattr(value, "__len__"):
        return [comparable(each) for each in value]
    return value if isinstance(value, bool) else int(value) if float(value).is_integer() else float(value)
