"""Resources that a small machine needs, measured in this checkout."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from bench import small


@pytest.fixture(autouse=True)
def from_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the programs find the project where this interpreter does."""
    paths = ":".join(path for path in sys.path if path)
    monkeypatch.setattr(small, "environment", lambda: {"PYTHONPATH": paths})


def test_a_server_and_a_client_need_neither_numpy_nor_pillow() -> None:
    program = f"import sys; sys.modules['numpy'] = sys.modules['PIL'] = None\n{small.ALONE}"
    subprocess.run([sys.executable, "-c", program], check=True, timeout=100)


def test_starts_are_measured() -> None:
    used = small.to_first_client((sys.executable, "-m", "rwt.cli"))
    assert used.seconds > 0
    assert used.memory > 1


@pytest.mark.timeout(60)
def test_memory_is_measured() -> None:
    assert small.memory_of(sys.executable, ("-c", small.ROBOT), "/odom", 0.01) > 1
    with small.running_program(sys.executable, ("-m", "rwt.cli", "serve", "ws://127.0.0.1:0")) as server:
        assert small.client_memory(sys.executable, f"ws://{server.host}:{server.port}") > 1


def test_a_program_that_fails_is_no_result(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="ended with 3"):
        small.whole_process((sys.executable, "-c", "raise SystemExit(3)"))
