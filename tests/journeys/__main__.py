"""Journeys of new users: scripts of the commands in the docs, replayed; prints their number and time.

python -m tests.journeys                  all, with the commands of this Python
python -m tests.journeys --clone          in a fresh clone and environment (needs the network)
python -m tests.journeys operator http

Programs in the scripts are those of the docs: `block PAGE TEXT` prints the code block of a page that has a
text. A script whose needs are not installed exits with 77 and is skipped, as with `needs mujoco`.
"""

from __future__ import annotations

import argparse
import io
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.docs.processes import commands_folder
from tests.processes import ROOT, free_port

SKIPPED: Final = 77
"""Exit code of a script without something that it needs."""

FOLDER: Final = Path(__file__).parent
JOURNEYS: Final = tuple(sorted(path.stem for path in FOLDER.glob("*.sh")))

#: The trace of commands goes to the descriptor 9.
_PRELUDE: Final = """set -euo pipefail
exec 9>trace; BASH_XTRACEFD=9; PS4='+ '
# A code block of the docs; and the end of a script without something that it needs.
block() {
  { set +x; } 9>/dev/null
  PYTHONPATH="$ROOT" "$PYTHON" -m tests.journeys.block "$@" | sed "s/9090/$PORT/g"
  set -x
}
needs() {
  { set +x; } 9>/dev/null
  for each; do
    python -c "import $each" 2>/dev/null || command -v "$each" >/dev/null || { echo "needs $each"; exit 77; }
  done
  set -x
}
# A command in the background, until its server answers; and its end.
server() {
  { set +x; } 9>/dev/null
  "$@" >server.log 2>&1 & echo $! > rwt.pid
  until curl -fs http://127.0.0.1:$PORT/healthz >health; do kill -0 "$(cat rwt.pid)"; sleep 0.1; done
  set -x
}
ended() { { set +x; } 9>/dev/null; while kill -0 "$(cat rwt.pid)" 2>/dev/null; do sleep 0.1; done; set -x; }
logged() { { set +x; } 9>/dev/null; until grep -q "$1" "${2:-server.log}"; do sleep 0.1; done; set -x; }
fails() { { set +x; } 9>/dev/null; if "$@"; then echo "succeeded: $*" >&2; exit 1; fi; set -x; }
trap 'kill $(cat ./*.pid 2>/dev/null) 2>/dev/null || true; wait' EXIT
set -x
"""


@dataclass(frozen=True, slots=True)
class Journey:
    """Replay of one journey.

    Attributes:
        code: exit code of the script; 77: something that it needs is not installed; 124: it took 300 seconds.
        commands: number of commands that were run.
        seconds: duration.
        cpu: CPU seconds of all its programs, which depend less on other programs of the machine.
        output: what the commands printed.
    """

    code: int
    commands: int
    seconds: float
    cpu: float
    output: str


def replay(name: str, folder: Path, path: str) -> Journey:
    """Replay a journey in an empty folder, with the commands of a `PATH`, on a free port."""
    port = str(free_port())
    script = _PRELUDE + (FOLDER / f"{name}.sh").read_text(encoding="utf-8").replace("9090", port)
    environment = {
        **os.environ,
        "PATH": path,
        "RWT_URL": f"ws://127.0.0.1:{port}",
        "PYTHONPATH": "",
        "ROOT": str(ROOT),
        "PYTHON": sys.executable,
        "PORT": port,
    }
    if str(ROOT / "src") in os.environ.get("PYTHONPATH", ""):
        environment["PYTHONPATH"] = os.environ["PYTHONPATH"]
    began, cpu = time.monotonic(), _cpu_seconds()
    done = subprocess.run(
        ["timeout", "300", "bash", "-c", script],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    took, cpu = time.monotonic() - began, _cpu_seconds() - cpu
    trace = (folder / "trace").read_text(encoding="utf-8").splitlines()
    commands = [line for line in trace if line.startswith("+ ")]
    log = folder / "server.log"
    output = done.stdout + (f"\nserver:\n{log.read_text()}" if done.returncode and log.exists() else "")
    return Journey(done.returncode, len(commands), took, cpu, output)


def _cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def local_path(folder: Path) -> str:
    """Return a `PATH` with the commands of this Python, and an npm that offers the installed packages."""
    commands = commands_folder(folder)
    npm = commands / "npm"
    npm.write_text(f'#!/bin/sh\nexec ln -sfn "{ROOT}/tests/clients/node/node_modules" node_modules\n')
    npm.chmod(0o755)
    return f"{commands}{os.pathsep}{os.environ['PATH']}"


def _cloned(folder: Path) -> str:
    """Clone and install the project, as the docs have it; returns the `PATH` with its commands."""
    clone, environment = folder / "robot-web-tools", folder / "venv"
    for command in (
        ["git", "clone", "--quiet", str(ROOT), str(clone)],
        ["npm", "ci", "--silent", "--prefix", str(clone / "web")],
        ["npm", "run", "--silent", "--prefix", str(clone / "web"), "build"],
        [sys.executable, "-m", "venv", str(environment)],
        [
            str(environment / "bin/pip"),
            "install",
            "--quiet",
            f"{clone}[mcap,mcp]",
            *(str(clone / f"rwt-{name}") for name in ("webrtc", "rclpy", "lerobot", "mavlink")),
            str(clone / "conformance"),
            *("mujoco", "pytest", "roslibpy"),
        ],
    ):
        subprocess.run(command, check=True)
    return f"{environment / 'bin'}{os.pathsep}{os.environ['PATH']}"


def main(argv: Sequence[str] | None = None) -> int:
    """Replay journeys and print a table; 1 if one failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.journeys", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(JOURNEYS)} (default: all)")
    parser.add_argument("--clone", action="store_true", help="in a fresh clone and environment")
    arguments = parser.parse_args(argv)
    assert isinstance(sys.stdout, io.TextIOWrapper)
    sys.stdout.reconfigure(line_buffering=True)
    failed = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        began = time.monotonic()
        path = _cloned(folder) if arguments.clone else local_path(folder / "bin")
        sys.stdout.write(f"{'set up':14} {time.monotonic() - began:6.1f} s\n")
        for each in arguments.names or JOURNEYS:
            place = folder / each
            place.mkdir()
            journey = replay(each, place, path)
            failed += journey.code not in (0, SKIPPED)
            took = f"{journey.seconds:6.1f} s {journey.cpu:6.1f} s CPU"
            words = f"{took}  {journey.commands:3} commands  exit code {journey.code}"
            sys.stdout.write(f"{each:14} {words}\n{journey.output if journey.code else ''}")
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
