"""`import rwt`: which names there are, and that none costs anything before it is used."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import rwt


def test_type_checkers_are_told_the_same_names() -> None:
    tree = ast.parse(Path(rwt.__file__).read_text(encoding="utf-8"))
    (checked,) = (node for node in tree.body if isinstance(node, ast.If))
    told = [alias.name for node in checked.body if isinstance(node, ast.ImportFrom) for alias in node.names]
    assert sorted(told) == sorted(rwt.__all__)


def test_a_name_that_is_not_there() -> None:
    with pytest.raises(AttributeError, match="module 'rwt' has no attribute 'Sever'"):
        _ = rwt.Sever


def test_importing_it_imports_nothing_else() -> None:
    program = "import sys; before = set(sys.modules); import rwt; print(*sorted(set(sys.modules) - before))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    others = {name for name in done.stdout.split() if name.partition(".")[0] not in sys.stdlib_module_names}
    assert others == {"rwt", "rwt.moved", "rwt_protocol", "rwt_protocol.extensions"}
    assert "asyncio" not in done.stdout.split()


@pytest.mark.parametrize(
    ("name", "without"),
    [
        # Of the transports, only the limits, whose defaults are those of the settings.
        ("Settings", "anyio websockets rwt_graph rwt_transports.listener rwt_transports.http rwt_client"),
        ("Server", "rwt_client rwt.extensions.testing rwt.extensions.demo zenoh numpy PIL"),
        ("Server", "rwt.extensions.recording"),
        ("Node", "rwt.rosbridge rwt_transports numpy"),
        ("connect", "rwt.rosbridge rwt_graph numpy"),
    ],
)
def test_a_name_imports_only_what_it_needs(name: str, without: str) -> None:
    program = f"import sys; from rwt import {name}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert set(without.split()) & set(done.stdout.split()) == set()
