"""Run tests of a checkout, such as rclpy's own, on the real rclpy and on this one, and print a table by file.

The checkout is the user's: `python -m differential.upstream CHECKOUT/rclpy/test --distro jazzy --real DIR`.
Each file runs in a process of its own, as in ROS's build.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from differential import outcomes
from differential.comparison import REAL, Rclpy, our_rclpy, real_rclpy

#: Seconds for one test, and for one file.
LONGEST_S, LONGEST_FILE_S = 60, 300
#: Tests of a checkout's style.
LINTERS = ("test_copyright", "test_flake8", "test_mypy", "test_pep257", "test_xmllint")


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of a test.

    Attributes:
        result: `passed`, `skipped` or `failed`.
        why: last line of the failure.
    """

    result: str
    why: str


def run_file(rclpy: Rclpy, file: Path) -> dict[str, Outcome]:
    """Return the outcomes of the tests of a file by name; a test that ends its process has none."""
    with tempfile.TemporaryDirectory() as folder:
        # Without the package's own __init__, which loads a build of rclpy.
        copy = Path(folder, "test")
        shutil.copytree(file.parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
        if (copy / "__init__.py").exists():
            (copy / "__init__.py").write_text("", "utf-8")
        written = Path(folder, "outcomes")
        written.touch()
        options = ["-q", "-p", "no:cacheprovider", "-p", "differential.outcomes", f"--timeout={LONGEST_S}"]
        with suppress(subprocess.TimeoutExpired):  # Tests without an outcome did not pass.
            subprocess.run(
                [rclpy.python, "-m", "pytest", *options, str(copy / file.name), "--rootdir", folder],
                env={**rclpy.environment, outcomes.FILE: str(written)},
                cwd=folder,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=LONGEST_FILE_S,
                check=False,
            )
        rows = [json.loads(line) for line in written.read_text("utf-8").splitlines()]
    found: dict[str, Outcome] = {}
    for name, result, why in rows:
        if name not in found or found[name].result == "passed":
            found[name] = Outcome(result, why)
    return found


def with_path(rclpy: Rclpy, places: list[Path]) -> Rclpy:
    """Return an interpreter that also imports from these folders."""
    path = os.pathsep.join([rclpy.environment["PYTHONPATH"], *(str(each.absolute()) for each in places)])
    return replace(rclpy, environment={**rclpy.environment, "PYTHONPATH": path})


def compare_tests(files: list[Path], real: Rclpy | None, ours: Rclpy) -> Iterator[tuple[str, int, list[str]]]:
    """Yield each file with the number of tests to pass, and those that fail here with the reason.

    Tests to pass are those that pass on the real rclpy, or all that are not skipped without one.
    """
    for file in files:
        here = run_file(ours, file)
        there = here if real is None else run_file(real, file)
        wanted = [
            name
            for name, each in there.items()
            if each.result == "passed" or (real is None and each.result == "failed")
        ]
        missing = Outcome("failed", "no outcome")
        failing = {name: here.get(name, missing) for name in wanted}
        yield (
            file.name,
            len(wanted),
            [f"{name}: {each.why}" for name, each in failing.items() if each.result != "passed"],
        )


def main() -> int:
    """Run the tests; returns 1 if less than 95 % of those that pass on the real one pass here."""
    parser = argparse.ArgumentParser(prog="python -m differential.upstream", description=__doc__)
    parser.add_argument("tests", type=Path, nargs="+", help="folders of a checkout with tests, or files")
    parser.add_argument("--distro", choices=REAL, default="jazzy")
    parser.add_argument("--real", type=Path, metavar="DIR", help="environment with the real rclpy's wheels")
    parser.add_argument(
        "--path",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="import from it for the real one",
    )
    options = parser.parse_args()
    files = [
        file
        for each in options.tests
        for file in ([each] if each.is_file() else sorted(each.rglob("test_*.py")))
        if file.stem not in LINTERS
    ]
    ours = our_rclpy(options.distro)
    packages = next(options.real.absolute().glob("lib/python3*/site-packages")) if options.real else ""
    ours = replace(
        ours, environment={**ours.environment, outcomes.OURS: "1", outcomes.PACKAGES: str(packages)}
    )
    real = with_path(real_rclpy(options.real, options.distro), options.path) if options.real else None
    total = passed = 0
    rows, failures = [], []
    for name, wanted, failing in compare_tests(files, real, ours):
        total, passed = total + wanted, passed + wanted - len(failing)
        rows.append(f"| {name} | {wanted} | {wanted - len(failing)} |")
        failures += [f"{name}::{each}" for each in failing]
        print(rows[-1], flush=True)
    print(f"| all | {total} | {passed} |", *failures, sep="\n")
    return 0 if passed >= 0.95 * total else 1


if __name__ == "__main__":
    sys.exit(main())
