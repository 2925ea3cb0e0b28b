"""Life cycles of objects: named states, and which may follow which."""

from __future__ import annotations

from enum import Enum
from typing import Self, TypeVar

S = TypeVar("S", bound="StateEnum")


class StateEnum(Enum):
    """States of a life cycle; the value of each is the names of those that may follow it."""

    following: frozenset[str]

    def __new__(cls, *following: str) -> Self:
        """Return a new state."""
        state = object.__new__(cls)
        # A number, because members of the same value would be one.
        state._value_ = len(cls.__members__)
        state.following = frozenset(following)
        return state

    def become(self, state: S) -> S:
        """Return `state`, which must be one that may follow."""
        assert state._name_ in self.following, f"{self} -> {state}"
        return state
