"""Types that other nodes define in their connection headers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

from rwt_graph.errors import WireError
from rwt_interfaces import field_types
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.registry import Registry

if TYPE_CHECKING:
    from rwt_interfaces.structs import MessageType

#: Maximum characters and lines with a field or constant of a definition with its nested ones, lines of all
#: definitions, and messages in one. A line costs up to 3 kB of memory.
_DEFINITION_CHARS: Final = 256 * 1024
_DEFINITION_LINES: Final = 1000
ALL_LINES: Final = 60_000
_MOST_PARTS: Final = 500

#: Maximum fields of a message with those of nested messages, and of their values in arrays of fixed lengths.
_MOST_LEAVES: Final = 2000

_SEPARATOR: Final = "\n" + "=" * 80 + "\n"


class WireTypes:
    """Types of one graph, by name and MD5 sum.

    A definition of an unknown name is added to the registry. One that contradicts the registry has a registry
    of its own: both exist at once, and types that are in use do not change.
    """

    def __init__(self, registry: Registry) -> None:
        self._registry = registry
        self._found: dict[tuple[str, str], MessageType] = {}
        self._lines = 0

    def known(self, name: str) -> MessageType | None:
        """Return the type of that name in the registry; None if it is unknown."""
        if self._registry.known_definition(name) is None:
            return None
        try:
            return self._registry.message(name)
        except InterfaceError:
            return None

    def find(self, name: str, md5: str, definition: str) -> MessageType:
        """Return the type of a connection header.

        Raises:
            WireError: the definition is missing, invalid, too large, or has another MD5 sum.
        """
        found = self._found.get((name, md5))
        if found is None:
            found = self.known(name)
            if found is None or found.md5 != md5:
                found = self._defined(name, md5, definition)
            self._found[name, md5] = found
        return found

    def _defined(self, name: str, md5: str, definition: str) -> MessageType:
        lines = sum(
            not line.lstrip().startswith(("#", "=")) for line in definition.split("\n") if line.strip()
        )
        if len(definition) > _DEFINITION_CHARS or lines > _DEFINITION_LINES:
            raise WireError(f"the definition of {name[:80]} is too large")
        lines += 1  # For the message itself.
        if self._lines + lines > ALL_LINES:
            raise WireError(f"the definition of {name[:80]} is not used: {ALL_LINES} lines of others are")
        parts = _parts(name, definition)
        own = Registry(self._registry.distro)
        try:
            for part, text in parts.items():
                own.add_text(text, part)
            found = own.message(name)
            if found.md5 != md5:
                raise WireError(
                    f"the definition of {name} has the MD5 sum {found.md5}, the header says {md5}"
                )
            if max(_sizes(found, {})) > _MOST_LEAVES:
                raise WireError(f"the definition of {name[:80]} is too large: it has {_MOST_LEAVES} values")
            self._lines += lines  # Only of what is kept: a publisher with an invalid definition tries again.
            return self._adopted(name, parts, own) or found
        except InterfaceError as error:
            raise WireError(f"the definition of {name[:80]} is invalid: {error}") from error

    def _adopted(self, name: str, parts: Iterable[str], own: Registry) -> MessageType | None:
        """Add the definitions to the registry, unless one of them contradicts it."""
        unknown: set[str] = set()
        for part in parts:
            known = self.known(part)
            if known is None:
                unknown.add(part)
            elif known.md5 != own.message(part).md5:
                return None
        if name not in unknown:
            return None
        self._registry.add_messages(map(own.definition, unknown))
        return self._registry.message(name)


def _sizes(type: MessageType, known: dict[str, tuple[int, int]]) -> tuple[int, int]:
    """Return the number of fields of a message with nested ones, and of nested values in fixed arrays."""
    if type.name not in known:
        leaves = values = 0
        for slot in type.slots:
            match slot.type:
                case field_types.Message(type=inner):
                    sizes = _sizes(inner, known)
                case field_types.Array(element=field_types.Message(type=inner), length=length):
                    sizes = _sizes(inner, known)
                    sizes = sizes[0], sizes[1] * (length or 0)
                case _:
                    sizes = 1, 1
            leaves, values = leaves + sizes[0], values + sizes[1]
        known[type.name] = leaves, values
    return known[type.name]


def _parts(name: str, definition: str) -> dict[str, str]:
    """Return the texts of a definition with its nested ones, by name."""
    first, *others = definition.split(_SEPARATOR)
    if len(others) >= _MOST_PARTS:
        raise WireError(f"the definition of {name[:80]} contains more than {_MOST_PARTS} messages")
    parts = {name: first}
    for other in others:
        head, _, text = other.partition("\n")
        parts[head.removeprefix("MSG:").strip()] = text
    return parts
