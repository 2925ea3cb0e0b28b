"""Output of programs: normalised, recorded, and compared with reviewed differences."""

from __future__ import annotations

import difflib
import json
import os
import re
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

HERE: Final = Path(__file__).parent
ROOT: Final = HERE.parent
#: Distributions whose real rclpy is recorded: the first in full, others where their output differs from it.
REAL: Final = ("jazzy", "kilted")

#: Output of programs by name.
Outputs = dict[str, str]

_NORMAL: Final = (
    (re.compile(r"<[\w.<>]*?(\w+) object at 0x[0-9a-fA-F]+>"), r"<\1 object>"),
    (re.compile(r"0x[0-9a-fA-F]{4,}"), "0xADDRESS"),
    (re.compile(r"\[\d{9,}\.\d+\]"), "[TIME]"),
    (re.compile(r"\b1[5-9]\d{8}[.]?\d{6,9}\b"), "TIME"),
    (re.compile(r"(/[\w.+-]+)+/([\w.-]+\.(py|cpp|c|so))(:\d+)?"), r"PATH/\2"),
    (re.compile(r"(, at \.?PATH/[\w.]+)+"), ""),  # Where rcl has found an error.
)


def normalised(status: int, text: str) -> str:
    """Return an output without addresses, times and paths, with the exit status if it is not 0."""
    for pattern, replacement in _NORMAL:
        text = pattern.sub(replacement, text)
    lines = [
        line.rstrip() for line in text.splitlines() if "\x1b[" not in line
    ]  # Fast DDS colours its errors.
    if (
        status not in (0, -11) and "the program ends by" not in text
    ):  # The real one may crash when its objects outlive the context.
        lines.append(f"exit status {status}")
    return "\n".join(lines)


@dataclass(frozen=True, slots=True)
class Rclpy:
    """Interpreter with an rclpy, this project's or the real one.

    Attributes:
        python: path of the interpreter.
        environment: variables of its processes.
        options: options of `differential.player` and `differential.cases` for it.
    """

    python: str
    environment: dict[str, str]
    options: tuple[str, ...] = ()

    def command(self, module: str) -> list[str]:
        """Return the command of a module."""
        return [self.python, "-u", "-m", f"differential.{module}", *self.options]

    def play(self, names: list[str], jobs: int) -> Outputs:
        """Return the outputs of programs."""
        played = subprocess.run(
            [*self.command("player"), "--jobs", str(jobs), *names],
            env=self.environment,
            stdout=subprocess.PIPE,
            check=True,
            text=True,
        )
        rows = [json.loads(line) for line in played.stdout.splitlines()]
        return {name: normalised(status, text) for name, status, text in rows}


def our_rclpy(distro: str) -> Rclpy:
    """Return this project's rclpy with the defaults of its users."""
    path = os.pathsep.join([str(ROOT), *(each for each in sys.path if each)])
    inherited = {name: value for name, value in os.environ.items() if name != "ROS_PYTHON_CHECK_FIELDS"}
    environment = {**inherited, "PYTHONPATH": path, "ROS_DISTRO": distro, "RCUTILS_COLORIZED_OUTPUT": "0"}
    return Rclpy(sys.executable, environment, ("--ours",))


def real_rclpy(place: Path, distro: str) -> Rclpy:
    """Return the real rclpy of an environment."""
    place = place.absolute()
    environment = {
        "PATH": os.environ.get("PATH", ""),
        "HOME": os.environ.get("HOME", "/"),
        "PYTHONPATH": str(ROOT),
        "AMENT_PREFIX_PATH": str(place),
        "LD_LIBRARY_PATH": str(place / "lib"),
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(place / "log"),
        "ROS_DISTRO": distro,
        "RCUTILS_COLORIZED_OUTPUT": "0",
        "ROS_DOMAIN_ID": os.environ.get("ROS_DOMAIN_ID", "90"),
    }
    return Rclpy(str(place / "bin" / "python"), environment)


def real_version(place: Path) -> str:
    """Return the version of the real rclpy."""
    found = next(place.glob("lib/python3*/site-packages/ros_rclpy-*.dist-info"), None)
    return "" if found is None else found.name.removeprefix("ros_rclpy-").removesuffix(".dist-info")


#: Outcome of `steps.fails` with the text of an exception, and a line of a logger.
_WITHOUT_TEXT: Final = re.compile(r"( raises \w+):.*")
_LOG_LINE: Final = re.compile(r"\[\w+ *\] \[TIME\]")
_HEADING: Final = re.compile(r"^== ([\w.]+)\n", re.MULTILINE)


def _sections(text: str) -> Outputs:
    parts = _HEADING.split(text)[1:]
    return {name: body.rstrip("\n") for name, body in zip(parts[::2], parts[1::2], strict=True)}


def read_recorded(distro: str, names: list[str] | None = None) -> Outputs:
    """Return the recorded outputs of the real rclpy."""
    found: Outputs = {}
    for release in dict.fromkeys((REAL[0], distro)):
        for file in sorted((HERE / "recorded" / release).glob("*.txt")):
            found.update(_sections(file.read_text("utf-8")))
    if not names:
        return found
    return {name: text for name, text in found.items() if name in names or name.partition(".")[0] in names}


def record(distro: str, place: Path, outputs: Outputs) -> None:
    """Keep outputs of the real rclpy, beside those that are not played again."""
    everything = {each: read_recorded(each) for each in REAL}
    everything[distro].update(outputs)
    # What differs from the first release changes with it.
    for release in REAL if distro == REAL[0] else (distro,):
        _write(release, everything[release], {} if release == REAL[0] else everything[REAL[0]])
    (HERE / "recorded" / distro / "version").write_text(f"rclpy {real_version(place)}, {distro}\n", "utf-8")


def _write(distro: str, outputs: Outputs, first: Outputs) -> None:
    """Write the outputs that differ from those of the first release."""
    folder = HERE / "recorded" / distro
    folder.mkdir(parents=True, exist_ok=True)
    for area in {name.partition(".")[0] for name in outputs}:
        own = {
            name: text
            for name, text in sorted(outputs.items())
            if name.partition(".")[0] == area and text != first.get(name)
        }
        file = folder / f"{area}.txt"
        if own:
            file.write_text("\n".join(f"== {name}\n{body}\n" for name, body in own.items()), "utf-8")
        else:
            file.unlink(missing_ok=True)


@dataclass(frozen=True, slots=True)
class Difference:
    """Program that prints something else here."""

    name: str
    distro: str
    real: str
    ours: str

    def text(self) -> str:
        """Return the difference line by line."""
        lines = difflib.unified_diff(
            self.real.splitlines(),
            self.ours.splitlines(),
            f"{self.name} real {self.distro}",
            "ours",
            "",
            "",
            1,
        )
        return "\n".join(line.rstrip() for line in lines)

    @property
    def kind(self) -> str:
        """Class of the difference: behaviour, or only the text of an exception or of a log line."""
        lines = [
            [_WITHOUT_TEXT.sub(r"\1", line) for line in each.splitlines()] for each in (self.real, self.ours)
        ]
        if lines[0] == lines[1]:
            return "text of an exception"
        without = [[each for each in text if not _LOG_LINE.match(each)] for text in lines]
        return "log" if without[0] == without[1] else "behaviour"

    @property
    def file(self) -> Path:
        """File of the review: its reason, and what is printed here."""
        return HERE / "reviewed" / f"{self.name}.txt"

    def accept(self, reason: str) -> None:
        """Write the review."""
        before = _sections(self.file.read_text("utf-8")) if self.file.is_file() else {}
        kept = {"reason": reason, **before, self.distro: self.ours}
        self.file.write_text("\n".join(f"== {name}\n{body}\n" for name, body in kept.items()), "utf-8")

    @property
    def reviewed(self) -> bool:
        """True if a reason accepts just this output."""
        if not self.file.is_file():
            return False
        sections = _sections(self.file.read_text("utf-8"))
        return bool(sections.get("reason")) and sections.get(self.distro) == self.ours


@dataclass(slots=True)
class Result:
    """Result of a comparison for one distribution.

    Attributes:
        same: names of the programs that print the same.
        reviewed: differences with a reason.
        unreviewed: differences without one.
        stale: reviews of programs that print the same.
    """

    distro: str
    same: list[str] = field(default_factory=list)
    reviewed: list[Difference] = field(default_factory=list)
    unreviewed: list[Difference] = field(default_factory=list)
    stale: list[str] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """True if every difference is reviewed, and every review is of a difference."""
        return not self.unreviewed and not self.stale

    def table(self) -> str:
        """Return the counts by area as a table."""
        columns = [self.same, *([one.name for one in each] for each in (self.reviewed, self.unreviewed))]
        counts = [Counter(name.partition(".")[0] for name in each) for each in columns]
        rows = [
            ("area", "the same", "reviewed", "differ"),
            ("---", *("---:" for _ in counts)),
            *((area, *(each[area] for each in counts)) for area in sorted(set().union(*counts))),
        ]
        return "\n".join(f"| {' | '.join(map(str, row))} |" for row in rows)

    def kinds(self) -> str:
        """Return the counts of unreviewed and reviewed differences by class as one line."""
        rows = (("differ", self.unreviewed), ("reviewed", self.reviewed))
        return "; ".join(
            f"{name}: {', '.join(f'{number} in {kind}' for kind, number in sorted(counts.items())) or 'none'}"
            for name, each in rows
            for counts in [Counter(one.kind for one in each)]
        )

    def summary(self) -> str:
        """Return the counts as one line."""
        total = len(self.same) + len(self.reviewed) + len(self.unreviewed)
        text = (
            f"{self.distro}: {len(self.same)} of {total} programs print the same, {len(self.reviewed)} differ"
            f" for a reviewed reason, {len(self.unreviewed)} differ"
        )
        return (
            f"{text}; reviews of programs that no longer differ: {', '.join(self.stale)}"
            if self.stale
            else text
        )


def compare_ours(distro: str, real: Outputs, names: list[str]) -> Result:
    """Compare this rclpy's outputs; programs that differ are played again alone, without delays by others."""
    ours = our_rclpy(distro)
    result = compare(distro, real, ours.play(names, 6))
    for difference in result.unreviewed[:20]:
        again = compare(distro, real, ours.play([difference.name], 1))
        if not again.unreviewed:
            result.unreviewed.remove(difference)
            result.same += again.same
            result.reviewed += again.reviewed
    return result


def _without_own_texts(real: str, ours: str) -> str:
    """Return an output without our texts of exceptions for which the real one has none to match on."""
    given, own = real.splitlines(), ours.splitlines()
    if len(given) != len(own):
        return ours
    return "\n".join(
        line if line.endswith(":") and each.startswith(f"{line} ") else each
        for line, each in zip(given, own, strict=True)
    )


def compare(distro: str, real: Outputs, ours: Outputs) -> Result:
    """Compare the outputs of the programs that were played with both."""
    result = Result(distro)
    for name in sorted(set(real) & set(ours)):
        difference = Difference(name, distro, real[name], _without_own_texts(real[name], ours[name]))
        if difference.real != difference.ours:
            (result.reviewed if difference.reviewed else result.unreviewed).append(difference)
            continue
        result.same.append(name)
        if difference.file.is_file() and distro in _sections(difference.file.read_text("utf-8")):
            result.stale.append(name)
    return result
