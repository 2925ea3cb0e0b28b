"""Global tree of parameters: all parameters of ROS 1, and those of ROS 2 that were set without a node.

Values are JSON values. A dictionary is a branch: setting `/robot` to `{"speed": 1}` creates `/robot/speed`,
and vice versa. A node that declared a parameter watches its name, and may reject a value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from decimal import Decimal
from itertools import chain
from math import inf
from typing import Final, TypeAlias, TypeVar
from uuid import UUID

import msgspec

from rwt_graph.accounts import Charges
from rwt_graph.parameters.values import INT64_MAX, INT64_MIN
from rwt_participant.errors import NotFound, ParameterRejected
from rwt_participant.messages import ParameterValue

T = TypeVar("T")

#: Called with a value before it is stored; raises `ParameterRejected` to reject it.
Watch: TypeAlias = Callable[[ParameterValue], object]


#: Default limits of a tree: levels, names and bytes.
MOST_DEPTH: Final = 32
MOST_NAMES: Final = 20_000
MOST_BYTES: Final = 8 * 1024 * 1024

#: Bytes charged for each value of a client in addition to its size, to limit the number of names.
_SET: Final = 256

#: Overhead of a value or a key in bytes, about what Python needs for it.
_NODE: Final = 64


class _TooDeep(Exception):
    """The value has too many levels."""


def measured(value: ParameterValue, max_depth: float = inf) -> tuple[int, int]:
    """Return the number of names in a value, and its size in bytes.

    The value is traversed level by level: a call for each of many small tables would be far slower.

    Raises:
        _TooDeep: it has more than `max_depth` levels of tables and lists.
        ParameterRejected: it has an integer beyond 64 bits.
    """
    names = size = depth = 0
    in_tables, in_lists = [value], list[ParameterValue]()
    while in_tables or in_lists:
        deeper = list[ParameterValue](), list[ParameterValue]()
        for level, is_in_list in ((in_tables, False), (in_lists, True)):
            size += _NODE * len(level) + _texts_and_numbers(level)
            tables = [each for each in level if type(each) is dict]
            keys = list(chain.from_iterable(tables))
            size += _NODE * len(keys) + sum(map(_length, keys))
            if not is_in_list:  # Tables in a list have keys, but no names in the tree.
                names += len(keys)
            deeper[is_in_list].extend(chain.from_iterable(table.values() for table in tables))
            lists = [each for each in level if type(each) is list]
            deeper[True].extend(chain.from_iterable(lists))
            if depth >= max_depth and (tables or lists):
                raise _TooDeep
        in_tables, in_lists = deeper
        depth += 1
    return names, size


def _texts_and_numbers(values: list[ParameterValue]) -> int:
    """Return the size of strings and octets. Raises :exc:`ParameterRejected` for integers beyond 64 bits."""
    kinds = set(map(type, values))
    if int in kinds:
        numbers = [each for each in values if type(each) is int]
        if min(numbers) < INT64_MIN or max(numbers) > INT64_MAX:
            raise ParameterRejected("an integer parameter must fit 64 bits")
    if kinds.isdisjoint((str, bytes, bytearray)):
        return 0
    return sum(_length(each) for each in values if isinstance(each, str | bytes | bytearray))


def _copied(value: ParameterValue) -> ParameterValue:
    if isinstance(value, str | int | float):
        return value
    try:
        return msgspec.to_builtins(value, builtin_types=_KEPT, str_keys=True)
    except TypeError:  # A program of the robot has set an object without a JSON form.
        return _copied_one_by_one(value)


_KEPT: Final = (bytes, bytearray, datetime, Decimal, UUID)
"""Scalars besides those of JSON that are stored unchanged."""


def _copied_one_by_one(value: ParameterValue) -> ParameterValue:
    if isinstance(value, Mapping):
        return {str(key): _copied_one_by_one(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_copied_one_by_one(item) for item in value]
    return value


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
        max_depth: maximum levels of tables and lists below the root, including those of the name.
        max_names: maximum number of names, including those of branches.
        max_bytes: maximum size: the text in names and values, and 64 for each name and value.

    Attributes:
        names_set: current number of names.
        bytes: current size.
    """

    def __init__(
        self,
        *,
        max_depth: int = MOST_DEPTH,
        max_names: int = MOST_NAMES,
        max_bytes: int = MOST_BYTES,
    ) -> None:
        self.names_set = 0
        self.bytes = _NODE
        self._max_depth = max_depth
        self._max_names = max_names
        self._max_bytes = max_bytes
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
        """Return True if a value or a branch has that name."""
        try:
            self._find(name)
        except NotFound:
            return False
        return True

    def get(self, name: str) -> ParameterValue:
        """Return a copy of a value, or of a branch as a dictionary. Raises :exc:`NotFound`."""
        return _copied(self._find(name))

    def read(self, name: str, read: Callable[[ParameterValue], T]) -> T:
        """Return the result of a function of a value or branch, which must not change or keep it.

        The value is not copied. Raises :exc:`NotFound`.
        """
        return read(self._find(name))

    def set(self, name: str, value: ParameterValue) -> None:
        """Set a value; a dictionary replaces the branch.

        Raises:
            ParameterRejected: a node that watches it, or a name below it, rejected it; the root would not be
                a table; or a limit of the tree would be exceeded.
        """
        parts = _parts(name)
        if not parts and not isinstance(value, Mapping):
            raise ParameterRejected("the root of the parameters is a table: a table alone can replace it")
        try:
            if len(parts) > self._max_depth:
                raise _TooDeep
            value = _copied(value)
            taken = measured(value, self._max_depth - len(parts))
        except (_TooDeep, RecursionError):
            raise ParameterRejected(
                f"parameter {name[:80]} is nested deeper than {self._max_depth} levels"
            ) from None
        room = self._require_room(parts, taken)
        affected = self._affected(name, value)
        for watched, new in affected:
            for watch in tuple(self._watches[watched]):
                watch(new)
        if affected:  # A watch may have set a parameter itself.
            room = self._require_room(parts, taken)
        full = "/" + "/".join(parts)
        self._charges.put(full, _SET + 2 * _NODE + _length(full) + taken[1])
        if self._is_branch(parts):
            self._charges.drop_below(full.rstrip("/") + "/")
        self.names_set, self.bytes = room
        if not parts:
            self._root = value if isinstance(value, dict) else {}
            return
        branch, missing = self._deepest(parts)
        for part in reversed(missing[1:]):
            value = {part: value}
        branch[missing[0]] = value

    def _is_branch(self, parts: list[str]) -> bool:
        if not parts:
            return bool(self._root)
        branch, missing = self._deepest(parts)
        return len(missing) == 1 and isinstance(branch.get(missing[0]), dict)

    def _deepest(self, parts: list[str]) -> tuple[dict[str, ParameterValue], list[str]]:
        branch = self._root
        for index, part in enumerate(parts[:-1]):
            deeper = branch.get(part)
            if not isinstance(deeper, dict):
                return branch, parts[index:]
            branch = deeper
        return branch, parts[-1:]

    def _require_room(self, parts: list[str], taken: tuple[int, int]) -> tuple[int, int]:
        """Return the totals with a value of that many names and bytes. Raises :exc:`ParameterRejected`."""
        count, size = taken
        if parts:
            branch, missing = self._deepest(parts)
            old = {missing[0]: branch[missing[0]]} if missing[0] in branch else {}
            less, freed = measured(old)
            count += self.names_set - less + len(missing)
            # Count each name, and the table that contains it.
            size += self.bytes - freed + sum(2 * _NODE + _length(name) for name in missing)
        for what, has, most in (("names", count, self._max_names), ("bytes", size, self._max_bytes)):
            if has > most:
                raise ParameterRejected(
                    f"the parameters would hold {has} {what}, and {most} is the limit for all of them,"
                    " which no setting changes: delete some"
                )
        return count, size

    def _affected(self, name: str, value: ParameterValue) -> list[tuple[str, ParameterValue]]:
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
        """Return the full names of all values, sorted."""
        return tuple(sorted(_leaves("", self._root)))

    def watch(self, name: str, watch: Watch) -> Callable[[], None]:
        """Call `watch` before a value of that name is stored; returns a function that ends this."""
        watches = self._watches.setdefault(name, [])
        watches.append(watch)

        def unwatch() -> None:
            if watch in watches:
                watches.remove(watch)
            if not watches:
                self._watches.pop(name, None)

        return unwatch
