"""Types of other nodes: from the registry, and messages that nodes describe."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from rwt_interfaces.definitions.described import texts_of
from rwt_interfaces.definitions.hashes import FieldType, Individual
from rwt_interfaces.errors import DefinitionError, InterfaceError
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType, ServiceType

#: Maximum fields of one description, with those of nested messages, and of all descriptions. A field costs up
#: to 3 kB of memory.
_MOST_FIELDS: Final = 1000
ALL_FIELDS: Final = 60_000


class DescribedTypes:
    """Types of one graph, by name and hash.

    A described message of an unknown name is added to the registry. One that contradicts the registry has a
    registry of its own: both exist at once, and types that are in use do not change.
    """

    def __init__(self, registry: Registry) -> None:
        self._registry = registry
        self._described: dict[tuple[str, str], MessageType] = {}
        self._fields = 0

    def message(self, name: str, type_hash: str) -> MessageType | None:
        """Return a message; None if it is unknown, or known with another hash.

        Args:
            type_hash: `RIHS01_…`; empty if the other process does not announce one.
        """
        known = self.known(name)
        if known is not None and type_hash in ("", known.rihs01):
            return known
        return self._described.get((name, type_hash))

    def service(self, name: str, request_hash: str, response_hash: str) -> ServiceType | None:
        """Return a service; None if it is unknown, or a part of it is known with another hash."""
        try:
            known = self._registry.service(name)
        except InterfaceError:
            return None
        matches = request_hash in ("", known.request.rihs01) and response_hash in ("", known.response.rihs01)
        return known if matches else None

    def known(self, name: str) -> MessageType | None:
        """Return a message of the registry; None if it has none of that name."""
        if self._registry.known_definition(name) is None:
            return None
        try:
            return self._registry.message(name)
        except InterfaceError:
            return None

    def add(self, name: str, type_hash: str, description: Any, sources: Any) -> None:
        """Add a described message.

        Args:
            name: full name.
            description: a `type_description_interfaces/TypeDescription`.
            sources: its `TypeSource` messages.

        Raises:
            InterfaceError: the description is invalid, too large, or has another hash.
        """
        types = list(_individuals(description))
        fields = sum(len(each["fields"]) + 1 for each in types)
        if fields > _MOST_FIELDS or self._fields + fields > ALL_FIELDS:
            raise DefinitionError(
                f"its description has {fields} fields, after {self._fields} of others: "
                f"the limits are {_MOST_FIELDS} and {ALL_FIELDS}"
            )
        files = {each.type_name: each.raw_file_contents for each in sources if each.encoding == "msg"}
        try:
            self._add(name, type_hash, texts_of(types, files))
        except InterfaceError:
            # A file may be of another version than the type, or use what this program's parser does not know.
            self._add(name, type_hash, texts_of(types, {}))
        self._fields += fields

    def _add(self, name: str, type_hash: str, texts: dict[str, str]) -> None:
        own = Registry(self._registry.distro)
        for message, text in texts.items():
            own.add_text(text, message)
        found = own.message(name)
        if found.rihs01 != type_hash:
            raise DefinitionError(f"its description has the hash {found.rihs01}")
        known = {message: self.known(message) for message in texts}
        if all(each is None or each.rihs01 == own.message(message).rihs01 for message, each in known.items()):
            self._registry.add_messages(
                own.definition(message) for message in texts if known[message] is None
            )
            found = self._registry.message(name)
        self._described[name, type_hash] = found


def _individuals(description: Any) -> Iterator[Individual]:
    for each in (description.type_description, *description.referenced_type_descriptions):
        yield {
            "type_name": each.type_name,
            "fields": [{"name": field.name, "type": _field_type(field.type)} for field in each.fields],
        }


def _field_type(described: Any) -> FieldType:
    return {
        "type_id": described.type_id,
        "capacity": described.capacity,
        "string_capacity": described.string_capacity,
        "nested_type_name": described.nested_type_name,
    }
