"""Descriptions of types and their fields in the form of C, from definitions.

rcl keeps a copy of each, from which a node answers `~/get_type_description`; a middleware on DDS announces
the fields to tools.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
from collections.abc import Callable, Collection
from typing import Final

from rwt.extensions.ros2.type_supports import c_structures as c
from rwt.extensions.ros2.type_supports.fast_cdr import MESSAGE_BYTES
from rwt_interfaces.definitions.hashes import Description, FieldDescription, FieldType, Individual
from rwt_interfaces.registry import Registry

#: Type numbers of RIHS01, without those of arrays, and the ones of `rosidl_typesupport_introspection_c`.
_INTROSPECTED: Final = {
    2: 9, 3: 8, 4: 11, 5: 10, 6: 13, 7: 12, 8: 15, 9: 14,
    10: 1, 11: 2, 15: 6, 16: 7, 17: 16, 18: 17, 21: 16, 22: 17, 1: 18,
}  # fmt: skip
_MESSAGE: Final = 18

#: Number of each kind of array of a type: 48 of fixed length, 96 bounded, 144 unbounded.
_KIND: Final = 48
_FIXED, _BOUNDED = 1, 2


class DescribedInC:
    """Description of a type as rcl reads it; its memory lives as long as the object.

    Args:
        description: description of the type with those that it contains.
        registry: definitions, for default values.

    Attributes:
        address: address of the `TypeDescription`.
    """

    def __init__(self, description: Description, registry: Registry) -> None:
        self._kept: list[object] = []
        self._registry = registry
        others = [self._individual(each) for each in description["referenced_type_descriptions"]]
        contained, array = c.sequence(others)
        whole = c.TypeDescription(self._individual(description["type_description"]), contained)
        self._kept += [others, array, whole]
        self.address = ctypes.addressof(whole)

    def _individual(self, described: Individual) -> c.DescribedType:
        definition = self._registry.known_definition(described["type_name"])
        defaults = {field.name: field.default for field in definition.fields} if definition else {}
        fields = [
            c.DescribedField(
                c.string(field["name"]),
                _field_type(field["type"]),
                c.string(_literal(defaults.get(field["name"]))),
            )
            for field in described["fields"]
        ]
        listed, array = c.sequence(fields)
        self._kept += [fields, array]
        return c.DescribedType(c.string(described["type_name"]), listed)


def _field_type(described: FieldType) -> c.DescribedFieldType:
    return c.DescribedFieldType(
        described["type_id"],
        described["capacity"],
        described["string_capacity"],
        c.string(described["nested_type_name"]),
    )


def _literal(default: object) -> str:
    return "" if default is None else str(default)


class Introspected:
    """Fields of a type as a middleware announces them; the memory lives as long as the object.

    The middleware keeps the first description of a name for as long as the process lives. Another one of the
    same name is made with a name of its own: readers and writers compare fields, not these names.

    Args:
        description: description of the type with those that it contains.
        make: makes a support of type introspection, given the address of its `MessageMembers`.
        announced: fingerprint of the first type of each name in this process.

    Attributes:
        address: address of the type support of the type.
        is_first: True if no other type of its name was made in this process.
    """

    def __init__(
        self,
        description: Description,
        make: Callable[[int], c.MessageSupport],
        announced: dict[str, str],
    ) -> None:
        self._make = make
        self._announced = announced
        whole = description["type_description"]
        self._types = {each["type_name"]: each for each in description["referenced_type_descriptions"]}
        self._types[whole["type_name"]] = whole
        self._addresses: dict[str, int] = {}
        self._kept: list[object] = []
        self.address = self._support(whole["type_name"])
        self.is_first = announced[whole["type_name"]] == self._fingerprint(whole["type_name"])

    @property
    def addresses(self) -> Collection[int]:
        """Addresses of the type supports of the type and of those that it contains."""
        return self._addresses.values()

    def _support(self, name: str) -> int:
        if name not in self._addresses:
            package, folder, short = name.split("/")
            fields = [self._field(field) for field in self._types[name]["fields"]]
            array = (c.IntrospectedField * len(fields))(*fields)
            fingerprint = self._fingerprint(name)
            if self._announced.setdefault(name, fingerprint) != fingerprint:
                short = f"{short}_{fingerprint[:16]}"
            members = c.IntrospectedMessage(
                f"{package}__{folder}".encode(),
                short.encode(),
                len(fields),
                MESSAGE_BYTES,
                False,
                ctypes.addressof(array),
                None,
                None,
            )
            support = self._make(ctypes.addressof(members))
            self._kept += [fields, array, members, support]
            self._addresses[name] = ctypes.addressof(support)
        return self._addresses[name]

    def _fingerprint(self, name: str) -> str:
        """Return a hash of a type and those that it contains."""
        individual = self._types[name]
        contained = {field["type"]["nested_type_name"] for field in individual["fields"]} - {""}
        parts = [json.dumps(individual), *map(self._fingerprint, sorted(contained))]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()

    def _field(self, field: FieldDescription) -> c.IntrospectedField:
        described = field["type"]
        kind, number = divmod(described["type_id"], _KIND)
        is_nested = _INTROSPECTED[number] == _MESSAGE
        return c.IntrospectedField(
            field["name"].encode(),
            _INTROSPECTED[number],
            described["string_capacity"],
            self._support(described["nested_type_name"]) if is_nested else None,
            False,
            kind > 0,
            described["capacity"] if kind in (_FIXED, _BOUNDED) else 0,
            kind == _BOUNDED,
        )
