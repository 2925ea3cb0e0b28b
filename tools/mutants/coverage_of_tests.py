"""The tests that run each line of some modules."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coverage
import pytest


@dataclass(frozen=True)
class Covered:
    """Tests by what they run.

    Attributes:
        seconds: duration of each test that passed, by its ID.
        lines: IDs of the tests that run a line, by file and line.
    """

    seconds: Mapping[str, float]
    lines: Mapping[str, Mapping[int, Sequence[str]]]

    def tests(self, module: str, line: int, most: int) -> list[str]:
        """Return tests that run a line, the quickest of each file first.

        Lines that only the import of the module runs count as run by all of its tests.

        Args:
            most: maximum number of tests.
        """
        lines = self.lines.get(module, {})
        found = {test for test in lines.get(line, ()) if test in self.seconds}
        found = found or {test for tests in lines.values() for test in tests if test in self.seconds}
        by_file: dict[str, list[str]] = {}
        for test in sorted(found, key=lambda each: (self.seconds[each], each)):
            by_file.setdefault(test.partition("::")[0], []).append(test)
        turns = (tests[turn] for turn in range(most) for tests in by_file.values() if turn < len(tests))
        return [test for test, _ in zip(turns, range(most), strict=False)]


class _Contexts:
    """Plugin of pytest that tells the tracer which test runs."""

    def __init__(self, tracer: coverage.Coverage) -> None:
        self._tracer = tracer
        self.seconds: dict[str, float] = {}
        self.failed: set[str] = set()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self._tracer.switch_context(item.nodeid)
        result = yield
        self._tracer.switch_context("")
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration
        if not report.passed:
            self.failed.add(report.nodeid)


def measure(source: Path, folders: Sequence[str], tests: Path, paths: Sequence[str], file: Path) -> Covered:
    """Run tests in a process of their own, and return what they cover; `file` keeps it for the next call."""
    if not file.exists():
        arguments = [str(source), json.dumps(list(folders)), json.dumps(list(paths)), str(file)]
        environment = {
            **os.environ,
            "PYTHONPATH": os.environ.get("PYTHONPATH", "") + f":{Path(__file__).parents[2]}",
        }
        subprocess.run(
            [sys.executable, "-m", "tools.mutants.coverage_of_tests", *arguments],
            cwd=tests,
            env=environment,
            check=True,
        )
    found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    names: list[str] = found["tests"]
    lines = {
        module: {int(line): [names[each] for each in tests] for line, tests in by_line.items()}
        for module, by_line in found["lines"].items()
    }
    return Covered(found["seconds"], lines)


def _main(source: str, folders: str, paths: str, file: str) -> None:
    root = Path(source)
    tracer = coverage.Coverage(data_file=None, source=[str(root / each) for each in json.loads(folders)])
    contexts = _Contexts(tracer)
    tracer.start()
    pytest.main(["-q", "-p", "no:cacheprovider", "--no-header", *json.loads(paths)], plugins=[contexts])
    tracer.stop()
    data = tracer.get_data()
    seconds = {test: each for test, each in contexts.seconds.items() if test not in contexts.failed}
    names = {test: number for number, test in enumerate(seconds)}
    lines = {
        os.path.relpath(each, root): {
            line: [names[test] for test in tests if test in names]
            for line, tests in data.contexts_by_lineno(each).items()
        }
        for each in data.measured_files()
    }
    Path(file).parent.mkdir(parents=True, exist_ok=True)
    Path(file).write_text(
        json.dumps({"tests": list(names), "seconds": seconds, "lines": lines}), encoding="utf-8"
    )


if __name__ == "__main__":
    _main(*sys.argv[1:])
