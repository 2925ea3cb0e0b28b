"""Every attack that is played has its row in docs/explanation/robustness.md, and each row is of one."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import pytest

from tests.faults.attacks.__main__ import described
from tests.faults.attacks.attacker import ATTACKS

_PAGE: Final = Path(__file__).parents[2] / "docs/explanation/robustness.md"
_ROW: Final = re.compile(r"^\| (.+) \| \d+ \| \d+ \| \d+ \|$", re.MULTILINE)


@pytest.fixture(scope="module")
def rows() -> list[str]:
    return _ROW.findall(_PAGE.read_text())


@pytest.mark.parametrize("attack", ATTACKS)
def test_an_attack_has_its_row(attack: str, rows: list[str]) -> None:
    assert described(attack) in rows, "make it with python -m tests.faults.attacks --rows NAME"


def test_each_row_is_of_an_attack(rows: list[str]) -> None:
    assert sorted(rows) == sorted(map(described, ATTACKS))
