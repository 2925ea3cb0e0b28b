"""Grade every server and client library that can run here, by version, and write docs/reference/matrix.md.

    make matrix                           # everything that needs no checkout of somebody else's
    make matrix ARGS='--only roslibpy'    # what has this in its name; other rows stay as they are
    make matrix ARGS='--only rosbridge_suite --checkout ../rosbridge_suite'
    make matrix ARGS='--only "real rclpy" --workspace ~/suite_ws/install'    # for build/rclpy-kilted

What there is stands in tools/matrix.toml, results in docs/reference/matrix.json. npm and PyPI packages are
installed in build/matrix.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).parents[1]
SUBJECTS: Final = ROOT / "tools" / "matrix.toml"
RESULTS: Final = ROOT / "docs" / "reference" / "matrix.json"
PAGE: Final = ROOT / "docs" / "reference" / "matrix.md"
INSTALLED: Final = ROOT / "build" / "matrix"
ADAPTERS: Final = ROOT / "conformance" / "rosbridge_conformance" / "adapters"

ROS2: Final = ROOT / "build" / "rclpy-kilted"
_ROS2_ENVIRONMENT: Final = {
    "AMENT_PREFIX_PATH": str(ROS2),
    "LD_LIBRARY_PATH": str(ROS2 / "lib"),
    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "ROS_DISTRO": "kilted",
    "ROS_VERSION": "2",
}

_GRACE: Final = 10.0
"""Seconds in which a server has to end when it is asked to."""

Subject = Mapping[str, Any]
"""A table of matrix.toml."""

_HEAD = """\
# Servers and clients, graded

This page is made by `make matrix`, which installs every version named here and runs the
[conformance suite](../how-to/conformance.md) against it. Numbers are cases that passed out of those asked;
what a server or a library does not claim to offer is not asked.
[What grades mean](../how-to/conformance.md#verdicts-and-grades).
"""


class MatrixError(Exception):
    """A subject cannot be installed, started or graded; the text says which, and why."""


def main() -> int:
    """Grade what is asked for, and write both files."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        "python -m tools.generate_matrix", description=__doc__, formatter_class=form
    )
    parser.add_argument(
        "--only", default="", metavar="TEXT", help="only what has this in its name and version"
    )
    parser.add_argument("--checkout", type=Path, help="your checkout of rosbridge_suite, branch ros2")
    parser.add_argument(
        "--workspace", type=Path, help="your workspace of rosbridge_suite, as `make bench-ros2` takes it"
    )
    parser.add_argument(
        "--page", action="store_true", help="write the page again from the results; grade nothing"
    )
    options = parser.parse_args()
    failed = 0
    for kind, subject in [] if options.page else _asked(options.only):
        title = title_of(subject)
        needed = subject.get("needs", "")
        if needed and getattr(options, needed) is None:
            print(f"{title}: needs --{needed}; its row stays as it is")
            continue
        try:
            report = _grade(kind, subject, options)
        except MatrixError as error:
            sys.stderr.write(f"generate_matrix: {title}: {error}\n")
            failed += 1
            continue
        # Another run may have written meanwhile.
        results = _results() | {title: summary(report)}
        _write(results)
        print(f"{title}: {results[title]['grade']}", flush=True)
    _write(_results())
    return 1 if failed else 0


def _results() -> dict[str, Any]:
    if not RESULTS.exists():
        return {}
    found: dict[str, Any] = json.loads(RESULTS.read_text(encoding="utf-8"))
    return found


def _write(results: Mapping[str, Any]) -> None:
    text = json.dumps(results, indent=1, sort_keys=True, ensure_ascii=False)
    RESULTS.write_text(f"{text}\n", encoding="utf-8")
    PAGE.write_text(page(subjects(), results), encoding="utf-8")


def subjects() -> dict[str, list[Subject]]:
    """The tables of matrix.toml: `servers`, `clients`, and `absent` ones."""
    return tomllib.loads(SUBJECTS.read_text(encoding="utf-8"))


def title_of(subject: Subject) -> str:
    """Return the title of a row."""
    return f"{subject['name']}, {subject['version']}"


def summary(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parts of a suite's report that the page needs."""
    judged = [entry for entry in report["results"] if entry["verdict"] in ("pass", "non-strict", "fail")]
    return {
        "suite": report["suite"],
        "grade": report["grade"],
        "conformance": _counts([entry for entry in judged if entry["level"] != "HARDEN"]),
        "robustness": _counts([entry for entry in judged if entry["level"] == "HARDEN"]),
        "failed": [
            [entry["id"], entry["level"], _reason(entry)] for entry in judged if entry["verdict"] == "fail"
        ],
    }


def page(tables: Mapping[str, Sequence[Subject]], results: Mapping[str, Any]) -> str:
    """The whole page."""
    return "\n".join(_lines(tables, results)) + "\n"


def _lines(tables: Mapping[str, Sequence[Subject]], results: Mapping[str, Any]) -> Iterator[str]:
    yield _HEAD
    for heading, kind in (("Servers", "servers"), ("Client libraries", "clients")):
        yield f"## {heading}\n"
        yield "| | version | runs on | thread settings | grade | conformance | robustness | failed | suite |"
        yield "|---|---|---|---|---|--:|--:|--:|---|"
        for subject in tables[kind]:
            yield _row(subject, results.get(title_of(subject)))
        yield ""
    yield "Not here:\n"
    yield from (f"- {subject['name']}: {subject['why']}." for subject in tables["absent"])
    for kind in ("servers", "clients"):
        for subject in tables[kind]:
            yield from _failures(subject, results.get(title_of(subject)))


def _row(subject: Subject, result: Mapping[str, Any] | None) -> str:
    runs_on, threads = subject.get("on", "-"), subject.get("threads", "-")
    name = f"| {subject['name']} | {subject['version']} | {runs_on} | {threads} "
    if result is None:
        how = (
            f"`make matrix ARGS='--only rosbridge_suite --{subject['needs']} …'`"
            if "needs" in subject
            else "`make matrix`"
        )
        return f"{name}| not yet: {how} | | | | |"
    passed, hard = ("/".join(map(str, result[each])) for each in ("conformance", "robustness"))
    return (
        f"{name}| **{result['grade']}** | {passed} | {hard} | {len(result['failed'])} | {result['suite']} |"
    )


def _failures(subject: Subject, result: Mapping[str, Any] | None) -> Iterator[str]:
    """Why a subject failed what it failed: cases of one reason in one row."""
    if result is None or not result["failed"]:
        return
    yield f"\n## What fails in {title_of(subject)}\n\n| cases | level | |\n|---|---|---|"
    by_reason: dict[tuple[str, str], list[str]] = {}
    for case, level, reason in result["failed"]:
        by_reason.setdefault((reason, level), []).append(f"`{case}`")
    for (reason, level), cases in sorted(by_reason.items(), key=lambda row: row[1]):
        yield f"| {', '.join(cases)} | {level} | {reason} |"


def _counts(entries: Sequence[Mapping[str, Any]]) -> list[int]:
    return [sum(entry["verdict"] != "fail" for entry in entries), len(entries)]


def _reason(entry: Mapping[str, Any]) -> str:
    fault = entry["fault"]
    why = entry["expected_failure"] or (f"expected {fault['expected']}, got {fault['got']}" if fault else "")
    return " ".join(str(why).replace("|", "\\|").replace("<", "&lt;").split())


def _asked(only: str) -> Iterator[tuple[str, Subject]]:
    tables = subjects()
    for kind in ("servers", "clients"):
        yield from ((kind, subject) for subject in tables[kind] if only in title_of(subject))


def _grade(kind: str, subject: Subject, options: argparse.Namespace) -> Any:
    """The suite's report of a subject."""
    INSTALLED.mkdir(parents=True, exist_ok=True)
    report = INSTALLED / f"{_folder(subject).name}.json"
    report.unlink(missing_ok=True)
    suite = [sys.executable, "-m", "rosbridge_conformance"]
    asked = ["--target", str(subject["target"]), "--json", str(report), *subject.get("suite", ())]
    if kind == "clients":
        _run([*suite, "client", "--jobs", "6", *asked, "--", *_program(subject)], accepted=(0, 1))
    else:
        with _server(subject, options) as url:
            _run([*suite, url, *asked], accepted=(0, 1))
    return json.loads(report.read_text(encoding="utf-8"))


def _folder(subject: Subject) -> Path:
    """Return the folder in which a subject is installed; its report and log are beside it."""
    return INSTALLED / re.sub(r"[^\w.-]+", "-", title_of(subject))


def _program(subject: Subject) -> list[str]:
    """The program around a client library, which is installed first."""
    folder = _folder(subject)
    if "npm" in subject:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "package.json").write_text('{"private": true}')
        package = f"library@npm:{subject['npm']}"
        _run(["npm", "install", "--no-audit", "--no-fund", "--silent", "--prefix", str(folder), package])
        return ["node", str(ADAPTERS / "roslib.mjs"), str(folder), "library"]
    if "pypi" in subject:
        python = str(folder / "bin" / "python")
        _run([sys.executable, "-m", "venv", str(folder)])
        _run([python, "-m", "pip", "install", "--quiet", str(subject["pypi"])])
        return [python, str(ADAPTERS / "roslibpy_adapter.py")]
    return [str(part).format(python=sys.executable) for part in subject["start"]]


@contextmanager
def _server(subject: Subject, options: argparse.Namespace) -> Iterator[str]:
    """The URL of a server, which says it in a line of its own once it listens."""
    python = str(ROS2 / "bin" / "python") if subject.get("needs") == "workspace" else sys.executable
    places = {"python": python, "checkout": options.checkout, "workspace": options.workspace}
    command = [str(part).format(**places) for part in subject["start"]]
    environment = {**os.environ, **_ROS2_ENVIRONMENT} if python != sys.executable else None
    with (
        Path(f"{_folder(subject)}.log").open("w") as log,
        subprocess.Popen(
            command, cwd=ROOT, stdout=subprocess.PIPE, stderr=log, text=True, env=environment
        ) as server,
    ):
        assert server.stdout is not None
        said = next((line for line in server.stdout if line.startswith("listening on ")), "")
        try:
            if not said:
                raise MatrixError(f"`{' '.join(command)}` ended before it listened: see {log.name}")
            yield said.split()[-1]
        finally:
            server.terminate()
            try:
                server.wait(_GRACE)
            except subprocess.TimeoutExpired:
                server.kill()  # rosbridge_suite ignores SIGTERM while its timers are late.


def _run(command: Sequence[str], accepted: Sequence[int] = (0,)) -> None:
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode not in accepted:
        raise MatrixError(f"`{' '.join(command)}` failed:\n{(done.stdout + done.stderr).strip()[-2000:]}")


if __name__ == "__main__":
    raise SystemExit(main())
