"""Install the wheels on every Python of this machine that is new enough, and run the quick tests there.

    make pythons
    make pythons ARGS='--only 3.13'

Interpreters are those that uv finds (`uv python list --only-installed`) and those of pyenv; free-threaded
ones count as their own. Each gets an environment in build/pythons, with the wheels as they are built, what
they declare, and what the tests need.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).parents[1]
FOLDER: Final = ROOT / "build" / "pythons"
OLDEST: Final = (3, 11)
FOLDERS: Final = ("tests/core/rosbridge", "tests/core/graph", "tests/core/participant", "tests/core/tf2")
UV: Final = (sys.executable, "-m", "uv")


def main() -> int:
    """Try each; the exit code is 1 if any failed, 2 where there is none."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser("python -m tools.try_pythons", description=__doc__, formatter_class=form)
    parser.add_argument("--only", default="", metavar="VERSION", help="only these, such as 3.13 or 3.14t")
    options = parser.parse_args()
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    # Its shims run none of them unless they are told which.
    path = os.pathsep.join([*map(str, pyenv.glob("versions/*/bin")), os.environ.get("PATH", "")])
    listed = subprocess.run(
        [*UV, "python", "list", "--only-installed", "--output-format", "json"],
        check=True,
        capture_output=True,
        text=True,
        env={**os.environ, "PATH": path},
    )
    found = {
        name: path
        for name, path in chosen(json.loads(listed.stdout)).items()
        if name.startswith(options.only)
    }
    if not found:
        sys.stderr.write(
            f"try_pythons: uv finds no CPython {options.only or '3.11'} or later on this machine\n"
        )
        return 2
    FOLDER.mkdir(parents=True, exist_ok=True)
    wheels = _build(FOLDER / "wheels")
    outcomes = {name: try_python(name, path, wheels) for name, path in found.items()}
    print("\n".join(f"{name:6} {said}" for name, (said, _) in outcomes.items()))
    return 0 if all(passed for _, passed in outcomes.values()) else 1


def chosen(listed: Sequence[dict[str, Any]]) -> dict[str, str]:
    """The newest of each version that is not too old, such as `3.13` and `3.13t`, with its program."""
    newest: dict[str, tuple[tuple[int, ...], str]] = {}
    for each in listed:
        numbers = re.match(r"(\d+)\.(\d+)\.(\d+)", each["version"])
        if each["implementation"] != "cpython" or numbers is None or not each["path"]:
            continue
        version = tuple(map(int, numbers.groups()))
        name = f"{version[0]}.{version[1]}" + ("t" if each["variant"] == "freethreaded" else "")
        if version[:2] >= OLDEST and each["variant"] in ("default", "freethreaded"):
            newest[name] = max(newest.get(name, ((), "")), (version, each["path"]))
    return {name: path for name, (_, path) in sorted(newest.items())}


def try_python(name: str, path: str, wheels: Sequence[str]) -> tuple[str, bool]:
    """Install and test; returns what to say of it, and whether it passed."""
    environment = FOLDER / name
    python = str(environment / "bin" / "python")
    group = f"{ROOT / 'pyproject.toml'}:lowest"
    steps: dict[str, list[str]] = {
        "cannot make an environment": [*UV, "venv", "--quiet", "--clear", "--python", path, str(environment)],
        "cannot install": [*UV, "pip", "install", "--quiet", "--python", python, *wheels, "--group", group],
        "failed": [
            python,
            "-m",
            "pytest",
            "-q",
            "-o",
            "timeout=600",
            "-p",
            "no:cacheprovider",
            "-m",
            "not slow",
            *FOLDERS,
        ],
    }
    said = ""
    for problem, command in steps.items():
        # The wheel is what is tested: nothing of this folder's sources may come before it.
        clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=clean)
        said = (done.stdout.strip() or "done").splitlines()[-1]
        if done.returncode != 0:
            print(done.stdout[-8000:] + done.stderr[-8000:], flush=True)
            return f"{problem}: {(done.stderr.strip() or said).splitlines()[-1]}", False
    return said, True


def _build(out: Path) -> list[str]:
    """The wheels, with the extras that the quick tests use."""
    for folder in (ROOT, ROOT / "conformance"):
        command = [
            sys.executable,
            "-m",
            "build",
            "--no-isolation",
            "--wheel",
            "--outdir",
            str(out),
            str(folder),
        ]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    ours, suite = (next(out.glob(f"{name}-*.whl")) for name in ("robot_web_tools", "rosbridge_conformance"))
    return [f"{ours}[bson,mcap,trio,zenoh]", str(suite)]


if __name__ == "__main__":
    raise SystemExit(main())
