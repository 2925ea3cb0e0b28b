"""The global tree of parameters: all parameters of ROS 1, and those of ROS 2 that were set without a node.

A value is anything JSON can say. A dictionary is a branch: `/robot` set to `{"speed": 1}` makes
`/robot/speed`, and the other way round. A node that declared a parameter watches its name, and may refuse a
value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Final, TypeAlias

from rwt_graph.parameters.accounts import Charges
from rwt_graph.parameters.values import INT64_MAX, INT64_MIN
from rwt_program.errors import NotFound, ParameterRejected
from rwt_program.messages import ParameterValue

#: Sees a value before it is stored; raises `ParameterRejected` to refuse it.
Watch: TypeAlias = Callable[[ParameterValue], None]


#: What a tree holds at most unless another bound is given: levels, names and bytes.
MOST_DEPTH: Final = 32
MOST_NAMES: Final = 20_000
MOST_BYTES: Final = 8 * 1024 * 1024

#: What each value that a client has set is charged with beside its size: so that nobody can take all names.
_SET: Final = 256

#: What a value or a key is counted with besides its text, in bytes: about what Python takes for it.
_NODE: Final = 64


def _copied(value: ParameterValue, depth: int) -> ParameterValue:
    """A value that shares nothing that can change with the one given, and is at most so many levels deep.

    Raises:
        ParameterRejected: it is deeper, or has a number of more than 64 bits.
    """
    if depth < 0 or (depth == 0 and isinstance(value, Mapping | list | tuple)):
        raise _TooDeep
    if isinstance(value, Mapping | list | tuple):
        if isinstance(value, Mapping):
            return {str(key): _copied(item, depth - 1) for key, item in value.items()}
        return [_copied(item, depth - 1) for item in value]
    if type(value) is int and not INT64_MIN <= value <= INT64_MAX:
        raise ParameterRejected("an integer parameter must fit 64 bits")
    return value


class _TooDeep(Exception):
    """A value has more levels than may be."""


def measured(value: ParameterValue) -> tuple[int, int]:
    """How many names are in a value, and how many bytes it counts."""
    if isinstance(value, dict):
        parts = [measured(item) for item in value.values()]
        names = sum(_NODE + _length(name) for name in value)
        return len(value) + sum(count for count, _ in parts), _NODE + names + sum(size for _, size in parts)
    if isinstance(value, list):
        # Tables in a list have keys, and no names.
        return 0, _NODE + sum(measured(item)[1] for item in value)
    return 0, _NODE + (_length(value) if isinstance(value, str | bytes | bytearray) else 0)


def _length(text: str | bytes | bytearray) -> int:
    return len(text) if text.isascii() else len(text) * 4


def _parts(name: str) -> list[str]:
    return [part for part in name.split("/") if part]


def _leaves(name: str, value: ParameterValue) -> Iterator[str]:
    if isinstance(value, dict) and value:
        for key, item in value.items():
            yield from _leaves(f"{name}/{key}", item)
    elif name:
        yield name


class ParameterTree:
    """Nested dictionaries behind slashed names, with watches.

    Args:
        most_depth: levels of tables and lists that a value may be below the root, its name's included.
        most_names: names that may be set at a time, those of branches too.
        most_bytes: what the tree may count: the text in names and values, and 64 for each name and value.

    Attributes:
        names_set: how many names are set.
        bytes: what the tree counts.
    """

    def __init__(
        self,
        *,
        most_depth: int = MOST_DEPTH,
        most_names: int = MOST_NAMES,
        most_bytes: int = MOST_BYTES,
    ) -> None:
        self.names_set = 0
        self.bytes = _NODE
        self._most_depth = most_depth
        self._most_names = most_names
        self._most_bytes = most_bytes
        self._root: dict[str, ParameterValue] = {}
        self._watches: dict[str, list[Watch]] = {}
        self._charges = Charges()

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
        return _copied(self._find(name), self._most_depth)

    def set(self, name: str, value: ParameterValue) -> None:
        """Set a value; a dictionary replaces the branch.

        Raises:
            ParameterRejected: a node that watches it, or something below it, refused; the root would be no
                table; or the tree would hold more than it may.
        """
        parts = _parts(name)
        if not parts and not isinstance(value, Mapping):
            raise ParameterRejected("the root of the parameters is a table: a table alone can replace it")
        try:
            value = _copied(value, self._most_depth - len(parts))
        except _TooDeep:
            raise ParameterRejected(
                f"parameter {name[:80]} is nested deeper than {self._most_depth} levels"
            ) from None
        self._require_room(parts, value)
        for watched, new in self._affected(name, value):
            for watch in tuple(self._watches[watched]):
                watch(new)
        # Placed only now: a watch may have set something itself.
        count, size = self._require_room(parts, value)
        full = "/" + "/".join(parts)
        self._charges.put(full, _SET + measured({full: value})[1])
        if self._is_branch(parts):
            self._charges.drop_below(full.rstrip("/") + "/")
        self.names_set, self.bytes = count, size
        if not parts:
            self._root = value if isinstance(value, dict) else {}
            return
        branch, missing = self._deepest(parts)
        for part in reversed(missing[1:]):
            value = {part: value}
        branch[missing[0]] = value

    def _is_branch(self, parts: list[str]) -> bool:
        """Whether there are values below a name."""
        if not parts:
            return bool(self._root)
        branch, missing = self._deepest(parts)
        return len(missing) == 1 and isinstance(branch.get(missing[0]), dict)

    def _deepest(self, parts: list[str]) -> tuple[dict[str, ParameterValue], list[str]]:
        """The last branch on the way to a name, and the part of the name that is below it."""
        branch = self._root
        for index, part in enumerate(parts[:-1]):
            deeper = branch.get(part)
            if not isinstance(deeper, dict):
                return branch, parts[index:]
            branch = deeper
        return branch, parts[-1:]

    def _require_room(self, parts: list[str], value: ParameterValue) -> tuple[int, int]:
        """What the tree holds with a value: names and bytes. Raises :exc:`ParameterRejected`."""
        if not parts:
            count, size = measured(value)
        else:
            branch, missing = self._deepest(parts)
            old = {missing[0]: branch[missing[0]]} if missing[0] in branch else {}
            for part in reversed(missing):
                value = {part: value}
            (less, freed), (more, taken) = measured(old), measured(value)
            count, size = self.names_set - less + more, self.bytes - freed + taken
        for what, has, most in (("names", count, self._most_names), ("bytes", size, self._most_bytes)):
            if has > most:
                raise ParameterRejected(f"the parameters would hold {has} {what}, and {most} is the limit")
        return count, size

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
            ParameterRejected: it is the root.
        """
        parts = _parts(name)
        if not parts:
            raise ParameterRejected("the root of the parameters cannot be deleted; delete what is below it")
        self._find(name)
        full = "/" + "/".join(parts)
        self._charges.drop(full)
        if self._is_branch(parts):
            self._charges.drop_below(full + "/")
        branch, (key,) = self._deepest(parts)
        names, freed = measured({key: branch.pop(key)})
        self.names_set, self.bytes = self.names_set - names, self.bytes + _NODE - freed

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
