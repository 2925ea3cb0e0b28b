"""Small changes of a module's source."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tools.mutants.sites import mutants, mutated

SOURCE = '''"""Module."""
from typing import Final

MOST: Final[int] = 3


def f(a: int, b: int = 2) -> int | None:
    """Return something."""
    if a < b and not a:
        raise ValueError(f"{a} of {MOST}")
    g(b"x")
    return a + b
'''


def test_each_change_is_made_alone(tmp_path: Path) -> None:
    (tmp_path / "m.py").write_text(SOURCE)
    found = mutants(tmp_path, "m.py")
    whole = ast.unparse(ast.parse(SOURCE)).splitlines()
    for mutant in found:
        changed = ast.unparse(mutated(tmp_path, mutant)).splitlines()
        assert len(set(whole) - set(changed)) == 1, mutant.name
    assert {(each.line, each.fault) for each in found} == {
        (4, "3 -> 4"),
        (7, "2 -> 3"),
        (9, "a < b and (not a) -> a < b or not a"),
        (9, "a < b -> a <= b"),
        (9, "not a -> a"),
        (10, "raise ValueError(f'{a} of {MOST}') -> pass"),
        (10, "' of ' -> 'X of '"),
        (11, "g(b'x') -> pass"),
        (11, "b'x' -> b'Xx'"),
        (12, "return a + b -> return None"),
        (12, "a + b -> a - b"),
    }


def test_an_unknown_change_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "m.py").write_text("x = 1\n")
    (only,) = mutants(tmp_path, "m.py")
    (tmp_path / "m.py").write_text("")
    with pytest.raises(LookupError, match="1 -> 2"):
        mutated(tmp_path, only)
