"""Definitions from ROS 2's descriptions of types."""

from __future__ import annotations

import pytest

from rwt_interfaces.definitions.described import texts_of
from rwt_interfaces.definitions.hashes import Description, description
from rwt_interfaces.errors import DefinitionError
from rwt_interfaces.registry import Registry

REGISTRY = Registry()


def described(name: str) -> Description:
    message = REGISTRY.message(name)
    return description(message.definition, REGISTRY)


def registry_of(found: Description, files: dict[str, str] | None = None) -> Registry:
    types = [found["type_description"], *found["referenced_type_descriptions"]]
    own = Registry()
    for name, text in texts_of(types, files or {}).items():
        own.add_text(text, name)
    return own


def test_every_standard_message_has_the_same_hash_when_it_is_made_from_its_description() -> None:
    for name in REGISTRY.names("msg"):
        assert registry_of(described(name)).message(name).rihs01 == REGISTRY.message(name).rihs01, name


def test_every_kind_of_field_is_made_again() -> None:
    REGISTRY.add_text(
        """
string<=5 bounded
wstring<=6 wide
string<=7[] texts
wstring[3] three
float64[4] fixed
byte[<=8] octets
char letter
geometry_msgs/Point[<=2] points
geometry_msgs/Point[2] pair
""",
        "my_msgs/Fields",
    )
    own = registry_of(described("my_msgs/Fields"))
    assert own.definition("my_msgs/Fields").fields == tuple(
        # A `char` and a `uint8` have the same number.
        field if field.name != "letter" else type(field)("letter", type(field.type)("uint8"))
        for field in REGISTRY.definition("my_msgs/Fields").fields
    )


def test_a_file_has_the_constants_and_defaults_that_a_description_lacks() -> None:
    REGISTRY.add_text("int8 BIG=7\nint8 size 3\n", "my_msgs/Size")
    plain = registry_of(described("my_msgs/Size")).definition("my_msgs/Size")
    assert (plain.constants, plain.fields[0].default) == ((), None)
    files = {"my_msgs/msg/Size": "int8 BIG=7\nint8 size 3\n"}
    assert registry_of(described("my_msgs/Size"), files).definition("my_msgs/Size") == REGISTRY.definition(
        "my_msgs/Size"
    )


@pytest.mark.parametrize(
    ("name", "type_id"), [("x", 9), ("a/b/c/d", 9), ("", 9), ("my_msgs/msg/X", 12), ("my_msgs/msg/X", 255)]
)
def test_what_is_no_message_is_rejected(name: str, type_id: int) -> None:
    field_type = {"type_id": type_id, "capacity": 0, "string_capacity": 0, "nested_type_name": ""}
    individual = {"type_name": name, "fields": [{"name": "x", "type": field_type}]}
    with pytest.raises(DefinitionError):
        texts_of([individual], {})  # type: ignore[list-item]
