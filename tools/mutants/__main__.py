"""Draw changes of the source with a seed, and count those that the tests of the same areas notice.

Each change is tried in a process that is forked before the project is imported, with the tests that run the
changed line, until one fails. `--tests` names another checkout, whose tests are tried on the source of this
one, and `--unnoticed` a result: does this set of tests notice what another one did not?

Example: python -m tools.mutants --seed 27 --count 400 --json build/mutants.json
"""

from __future__ import annotations

import argparse
import importlib.abc
import importlib.machinery
import importlib.util
import json
import os
import random
import select
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import CodeType, ModuleType
from typing import Final

import pytest

from tools.mutants.coverage_of_tests import Covered, measure
from tools.mutants.sites import Mutant, mutants, mutated

ROOT: Final = Path(__file__).parents[2]
FOLDERS: Final = ("src/rwt_protocol", "src/rwt/delivery", "src/rwt/rosbridge", "src/rwt_transports")
TESTS: Final = (
    "tests/core/protocol",
    "tests/core/rosbridge",
    "tests/core/transports",
    "tests/contract/transports",
)
WARM: Final = (
    "hypothesis",
    "anyio",
    "msgspec",
    "numpy",
    "pydantic",
    "trio",
    "websockets",
    "PIL.Image",
    "asyncio",
)
"""Packages that each forked process would import."""

MOST_TESTS: Final = 80
MUTANT_SECONDS: Final = 120.0
"""Limit for all tests of a change; a change with which they take longer is noticed."""

TEST_SECONDS: Final = 30

CONTROLS: Final = 10
"""Trials without a change, which must pass; otherwise each change would seem noticed."""

NOTICED: Final = ("noticed", "too slow")


class _Loader(importlib.machinery.SourceFileLoader):
    """Loader of a module with a change."""

    changed: CodeType

    def get_code(self, fullname: str) -> CodeType:
        return self.changed


class _Finder(importlib.abc.MetaPathFinder):
    """Finder of the one changed module."""

    def __init__(self, name: str, file: Path, code: CodeType) -> None:
        self._name, self._file, self._code = name, file, code

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != self._name:
            return None
        loader = _Loader(fullname, str(self._file))
        loader.changed = self._code
        is_package = self._file.name == "__init__.py"
        places = [str(self._file.parent)] if is_package else None
        return importlib.util.spec_from_file_location(
            fullname, self._file, loader=loader, submodule_search_locations=places
        )


def draw(root: Path, count: int, seed: int) -> list[Mutant]:
    """Return changes drawn from all of the folders, each with the same chance."""
    modules = sorted(str(file.relative_to(root)) for each in FOLDERS for file in (root / each).rglob("*.py"))
    every = [mutant for module in modules for mutant in mutants(root, module)]
    return random.Random(seed).sample(every, count)


def _try(root: Path, tests: Path, mutant: Mutant, chosen: Sequence[str]) -> int:
    """Run the tests with the change; the exit code of pytest. Called in a forked process."""
    if mutant.number >= 0:
        file = root / mutant.module
        parts = Path(mutant.module).relative_to("src").with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        code: CodeType = compile(mutated(root, mutant), str(file), "exec")
        sys.meta_path.insert(0, _Finder(name, file, code))
    os.chdir(tests)
    sys.path[:0] = [str(root / "src"), str(root / "conformance"), str(tests)]
    options = ["-x", "-q", "-p", "no:cacheprovider", f"--timeout={TEST_SECONDS}", f"--rootdir={tests}"]
    # The packages of WARM are imported already.
    options += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]
    return int(pytest.main([*options, *chosen]))


def _verdicts(
    root: Path, tests: Path, drawn: Sequence[Mutant], covered: Covered, processes: int
) -> Iterator[tuple[Mutant, str]]:
    waiting = list(reversed(drawn))
    running: dict[int, tuple[Mutant, int, float]] = {}
    while waiting or running:
        while waiting and len(running) < processes:
            mutant = waiting.pop()
            chosen = covered.tests(mutant.module, mutant.line, MOST_TESTS)
            if not chosen:
                yield mutant, "not covered"
                continue
            child = os.fork()
            if child == 0:
                os.setsid()
                nowhere = os.open(os.devnull, os.O_RDWR)
                for each in (0, 1, 2):
                    os.dup2(nowhere, each)
                status = 70
                try:
                    status = _try(root, tests, mutant, chosen)
                finally:
                    os._exit(status)
            running[child] = (mutant, os.pidfd_open(child), time.monotonic() + MUTANT_SECONDS)
        select.select([watched for _, watched, _ in running.values()], [], [], 0.5)
        for child, (mutant, watched, end) in list(running.items()):
            late = time.monotonic() > end
            if late:
                os.killpg(child, signal.SIGKILL)
            ended, status = os.waitpid(child, 0 if late else os.WNOHANG)
            if not ended:
                continue
            os.close(watched)
            del running[child]
            code = os.waitstatus_to_exitcode(status)
            yield mutant, "too slow" if late else "survived" if code == 0 else "noticed"


def main() -> int:
    """Draw, try, and print the changes that nothing notices, and counts."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=27)
    parser.add_argument("--count", type=int, default=400, help="number of changes [400]")
    parser.add_argument("--tests", type=Path, default=ROOT, help="checkout with the tests [this one]")
    parser.add_argument(
        "--unnoticed", type=Path, metavar="FILE", help="only try what survived in this result"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the verdicts to a file, too")
    parser.add_argument("--coverage", type=Path, metavar="FILE", help="file that keeps what the tests cover")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    drawn = draw(ROOT, options.count, options.seed)
    if options.unnoticed is not None:
        before: dict[str, str] = json.loads(options.unnoticed.read_text(encoding="utf-8"))
        drawn = [each for each in drawn if before.get(each.name) not in NOTICED]
    tests = options.tests.resolve()
    folders = [each for each in TESTS if (tests / each).exists()]
    kept = options.coverage or tests / "build" / "mutants" / "coverage.json"
    covered = measure(ROOT, FOLDERS, tests, folders, kept.resolve())
    for each in WARM:
        importlib.import_module(each)
    unchanged = [replace(each, number=-1, fault="unchanged") for each in drawn[:CONTROLS]]
    for mutant, verdict in _verdicts(ROOT, tests, unchanged, covered, options.processes):
        if verdict in NOTICED:
            raise SystemExit(f"the tests fail without a change: {mutant.name}")
    verdicts: dict[str, str] = {}
    for number, (mutant, verdict) in enumerate(_verdicts(ROOT, tests, drawn, covered, options.processes), 1):
        verdicts[mutant.name] = verdict
        print(f"{number:4}/{len(drawn)} {verdict:11} {mutant.name}", flush=True)
    if options.json is not None:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(json.dumps(verdicts, indent=1) + "\n", encoding="utf-8")
    noticed = sum(1 for each in verdicts.values() if each in NOTICED)
    print(f"{len(verdicts)} changes, seed {options.seed}: {noticed} noticed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
