"""Processes of tests: the command `rwt`, and ports for them."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]

LONGEST: Final = 20.0
"""Seconds; far more than a command takes to end."""


def free_port() -> int:
    """A port that nobody listens on now."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port: int = listener.getsockname()[1]
    return port


def rwt_command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "rwt.cli", *arguments]


def ended(*arguments: str, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    """`rwt …` after its end."""
    return subprocess.run(
        rwt_command(*arguments),
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=LONGEST,
        check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
    )


@contextmanager
def running(
    *arguments: str,
    ready: str = "listening on ",
    stderr: int | None = subprocess.PIPE,
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """`rwt …`, and the rest of the line of its output that begins with `ready`.

    A process that still runs at the end gets SIGTERM, and must exit with 0. Of the variables of `rwt` it has
    those of `environment` alone.
    """
    own = {name: value for name, value in os.environ.items() if not name.startswith("RWT_")}
    process = subprocess.Popen(
        rwt_command(*arguments),
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=stderr,
        text=True,
        env={**own, "PYTHONPATH": str(ROOT / "src"), **(environment or {})},
    )
    try:
        assert process.stdout is not None
        lines = []
        for line in process.stdout:
            if line.startswith(ready):
                yield process, line.removeprefix(ready).strip()
                break
            lines.append(line)
        else:
            raise AssertionError(
                f"{' '.join(arguments)}: not {ready!r} but {lines} {process.communicate()[1]}"
            )
        if process.poll() is None:
            process.terminate()
            process.communicate(timeout=LONGEST)
            assert process.returncode == 0, arguments
    finally:
        process.kill()
        process.communicate()
