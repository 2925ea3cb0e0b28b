"""Life cycles: only the states that are named may follow."""

from __future__ import annotations

import pytest

from rwt_protocol.states import StateEnum


class Door(StateEnum):
    OPEN = "SHUT"
    SHUT = "OPEN", "LOCKED"
    LOCKED = "SHUT"


def test_only_named_states_follow() -> None:
    assert len(Door) == 3, "states with the same followers are two"
    assert Door.OPEN.become(Door.SHUT).become(Door.LOCKED) is Door.LOCKED
    with pytest.raises(AssertionError, match=r"Door\.LOCKED -> Door\.OPEN"):
        Door.LOCKED.become(Door.OPEN)
