"""No module needs what only this system has: on Windows and macOS each can be imported."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import ROOT

PROGRAM = Path(__file__).parent / "programs" / "other_system.py"


@pytest.mark.parametrize("system", ["win32", "darwin"])
def test_every_module_can_be_imported(system: str) -> None:
    command = [sys.executable, str(PROGRAM), system, str(ROOT / "src"), str(ROOT / "conformance")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    said = done.stdout.splitlines()
    assert said[:-1] == [] and int(said[-1].split()[0]) > 500, done.stdout


def test_a_module_that_needs_this_system_is_found(tmp_path: Path) -> None:
    package = tmp_path / "careless"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "locks.py").write_text("import fcntl\n")
    (package / "signals.py").write_text("import signal\n\nAGAIN = signal.SIGHUP\n")
    command = [sys.executable, str(PROGRAM), "win32", str(tmp_path)]
    said = subprocess.run(command, capture_output=True, text=True).stdout
    assert "careless.locks: ModuleNotFoundError" in said and "careless.signals: AttributeError" in said
