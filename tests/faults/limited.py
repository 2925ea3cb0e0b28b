"""Programs with limited memory and time: an attack that succeeds fails its test, and not the test run."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

ADDRESS_BYTES: Final = 3 * 2**30
"""Limit of the address space. Libraries reserve far more of it than they use."""

_RUN: Final = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, ({address}, {address}))
resource.setrlimit(resource.RLIMIT_CPU, ({seconds}, {seconds}))
{imports}
def peak():
    return next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
code, before = 1, peak()
try:
    code = {call}
finally:
    sys.stdout.flush()
    print(before, peak(), "CPU", resource.getrusage(resource.RUSAGE_SELF).ru_utime, file=sys.stderr)
raise SystemExit(code)
"""


@dataclass(frozen=True, slots=True)
class Ended:
    """Result of a program.

    Attributes:
        code: its exit status; negative for a signal, such as that of the limit of time.
        output: standard output and error.
        grown_bytes: growth of its memory during the call.
    """

    code: int
    output: str
    grown_bytes: int


def run_limited(call: str, imports: str = "", *, seconds: int = 10, folder: Path | None = None) -> Ended:
    """Evaluate an expression in a new process and return how that ended.

    Args:
        call: expression; its value is the exit status.
        imports: statements before it, which are not measured.
        seconds: limit of processor time.
    """
    program = _RUN.format(address=ADDRESS_BYTES, seconds=seconds, imports=imports, call=call)
    ended = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        errors="replace",
        timeout=10 * seconds,
        check=False,
        cwd=folder,
    )
    sizes = [int(found) * 1024 for found in re.findall(r"VmHWM:\s+(\d+) kB", ended.stderr)]
    grown = sizes[-1] - sizes[-2] if len(sizes) > 1 else ADDRESS_BYTES
    return Ended(ended.returncode, ended.stdout + ended.stderr, grown)


def run_command(words: Sequence[str], *, seconds: int = 10) -> Ended:
    """Run the command `rwt` in a new process with limits."""
    return run_limited(f"main({list(words)!r})", "from rwt.cli import main", seconds=seconds)
