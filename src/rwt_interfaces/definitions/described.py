"""Definitions from ROS 2's descriptions of types, as `~/get_type_description` returns them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from rwt_interfaces.definitions.hashes import FILLER, NUMBERS, FieldType, Individual
from rwt_interfaces.definitions.model import Field, MessageDefinition, WrittenType
from rwt_interfaces.definitions.parser import format_message
from rwt_interfaces.errors import DefinitionError

_NESTED: Final = 1
#: Primitives by type number: `char` and `uint8` have the same one.
_PRIMITIVES: Final = {number: name for name, number in NUMBERS.items() if name != "char"}
_BOUNDED_STRINGS: Final = {21: "string", 22: "wstring"}
#: Type numbers of one kind of array.
_KIND: Final = 48


def texts_of(types: Iterable[Individual], files: Mapping[str, str]) -> dict[str, str]:
    """Return the definitions of described messages, by two-part name.

    Args:
        types: descriptions of a message and of those that it contains.
        files: texts of `.msg` files by full name. They have constants, defaults and comments, which
            descriptions lack; a message without a file gets the text of its description.

    Raises:
        DefinitionError: a name or a field has a form that no `.msg` file has.
    """
    texts = {}
    for each in types:
        package, _, short = _split(each["type_name"])
        texts[f"{package}/{short}"] = files.get(each["type_name"]) or _text(each)
    return texts


def _split(name: str) -> tuple[str, str, str]:
    match name.split("/"):
        case [package, folder, short]:
            return package, folder, short
    raise DefinitionError(f"{name[:80]!r} is not the name of a type of ROS 2")


def _text(individual: Individual) -> str:
    fields = tuple(Field(field["name"], _type(field["type"])) for field in individual["fields"])
    is_empty = fields == (FILLER,)
    return format_message(MessageDefinition("", () if is_empty else fields))


def _type(described: FieldType) -> WrittenType:
    kind, number = divmod(described["type_id"], _KIND)
    bound = None
    if number == _NESTED:
        package, _, short = _split(described["nested_type_name"])
        name = f"{package}/{short}"
    elif number in _BOUNDED_STRINGS:
        name, bound = _BOUNDED_STRINGS[number], described["string_capacity"]
    elif number in _PRIMITIVES:
        name = _PRIMITIVES[number]
    else:
        raise DefinitionError(f"type number {described['type_id']} is of no `.msg` file")
    capacity = described["capacity"]
    match kind:
        case 0:
            return WrittenType(name, bound)
        case 1:
            return WrittenType(name, bound, is_array=True, length=capacity)
        case 2:
            return WrittenType(name, bound, is_array=True, bound=capacity)
        case 3:
            return WrittenType(name, bound, is_array=True)
    raise DefinitionError(f"type number {described['type_id']} is of no `.msg` file")
