"""The global tree of parameters: all parameters of ROS 1, and those of ROS 2 that were set without a node.

A value is anything JSON can say. A dictionary is a branch: `/robot` set to `{"speed": 1}` makes
`/robot/speed`, and the other way round. A node that declared a parameter watches its name, and may refuse a
value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TypeAlias

from rwt_program.errors import NotFound
from rwt_program.messages import ParameterValue

#: Sees a value before it is stored; raises `ParameterRejected` to refuse it.
Watch: TypeAlias = Callable[[ParameterValue], None]


def _copied(value: ParameterValue) -> ParameterValue:
    """A value that shares nothing that can change with the one given."""
    if isinstance(value, Mapping):
        return {str(key): _copied(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_copied(item) for item in value]
    return value


def _parts(name: str) -> list[str]:
    return [part for part in name.split("/") if part]


def _leaves(name: str, value: ParameterValue) -> Iterator[str]:
    if isinstance(value, dict) and value:
        for key, item in value.items():
            yield from _leaves(f"{name}/{key}", item)
    elif name:
        yield name


class ParameterTree:
    """Nested dictionaries behind slashed names, with watches."""

    def __init__(self) -> None:
        self._root: dict[str, ParameterValue] = {}
        self._watches: dict[str, list[Watch]] = {}

    def _find(self, name: str) -> ParameterValue:
        value: ParameterValue = self._root
        for part in _parts(name):
            if not isinstance(value, dict) or part not in value:
                raise NotFound(f"parameter {name} is not set")
            value = value[part]
        return value

    def has(self, name: str) -> bool:
        """Whether a value or a branch has that name."""
        try:
            self._find(name)
        except NotFound:
            return False
        return True

    def get(self, name: str) -> ParameterValue:
        """The value, or a branch as a dictionary; a copy.

        Raises:
            NotFound: it is not set.
        """
        return _copied(self._find(name))

    def set(self, name: str, value: ParameterValue) -> None:
        """Set a value; a dictionary replaces the branch.

        Raises:
            ParameterRejected: a node that watches it, or something below it, refused.
        """
        value = _copied(value)
        for watched, new in self._affected(name, value):
            for watch in tuple(self._watches[watched]):
                watch(new)
        parts = _parts(name)
        if not parts:
            self._root = value if isinstance(value, dict) else {}
            return
        branch = self._root
        for part in parts[:-1]:
            deeper = branch.get(part)
            if not isinstance(deeper, dict):
                deeper = branch[part] = {}
            branch = deeper
        branch[parts[-1]] = value

    def _affected(self, name: str, value: ParameterValue) -> list[tuple[str, ParameterValue]]:
        """The watched names that `set` gives a value, and that value."""
        prefix = "/" + "/".join(_parts(name))
        affected = []
        for watched in self._watches:
            if watched == prefix:
                affected.append((watched, value))
            elif watched.startswith(prefix.rstrip("/") + "/"):
                inner = value
                for part in _parts(watched[len(prefix) :]):
                    if not isinstance(inner, dict) or part not in inner:
                        break
                    inner = inner[part]
                else:
                    affected.append((watched, inner))
        return affected

    def delete(self, name: str) -> None:
        """Remove a value or a branch.

        Raises:
            NotFound: it is not set.
        """
        self._find(name)
        parts = _parts(name)
        if not parts:
            self._root = {}
            return
        branch = self._find("/".join(parts[:-1]))
        if isinstance(branch, dict):
            del branch[parts[-1]]

    def names(self) -> tuple[str, ...]:
        """The full names of all values, sorted."""
        return tuple(sorted(_leaves("", self._root)))

    def watch(self, name: str, watch: Watch) -> Callable[[], None]:
        """Call `watch` before a value of that name is stored; what is returned ends it."""
        watches = self._watches.setdefault(name, [])
        watches.append(watch)

        def unwatch() -> None:
            if watch in watches:
                watches.remove(watch)
            if not watches:
                self._watches.pop(name, None)

        return unwatch


__all__ = ["ParameterTree", "ParameterValue", "Watch"]
