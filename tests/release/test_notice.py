"""NOTICE names the origin, version and licence of every package whose definitions come along."""

from __future__ import annotations

from pathlib import Path

import pytest

from rwt_interfaces import DISTROS, standard

ROOT = Path(__file__).parents[2]
STANDARD = ROOT / "src" / "rwt_interfaces" / "standard"
OURS = {"rwt_gate_msgs", "rwt_recorder_msgs"}
LICENCES = {"BSD", "BSD-3-Clause", "Apache-2.0"}


def rows() -> dict[str, list[tuple[str, ...]]]:
    """The table of NOTICE: (ROS, repository, version, licence) of each package."""
    lines = (ROOT / "NOTICE").read_text(encoding="utf-8").splitlines()
    begin = next(number for number, line in enumerate(lines) if line.startswith("package "))
    table: dict[str, list[tuple[str, ...]]] = {}
    for line in lines[begin + 1 :]:
        package, *rest = line.split()
        table.setdefault(package, []).append(tuple(rest))
    return table


@pytest.mark.parametrize(
    "file", sorted(STANDARD.rglob("*.txt")), ids=lambda file: f"{file.parent.name}/{file.name}"
)
def test_every_package_of_definitions_is_named(file: Path) -> None:
    package, distro = file.name.split(".")[0], file.parent.name
    if package in OURS:
        assert f"Those of {package} are this project's own." in (ROOT / "NOTICE").read_text(encoding="utf-8")
        return
    if all(body is None for body in standard.split(file.read_text("utf-8")).values()):
        return  # Only names what the release does not have.
    named = {ros for ros, *_ in rows()[package]}
    assert named & {distro, "both"} or distro == "both", f"NOTICE does not name {package} of {distro}"


def test_rows_are_whole() -> None:
    for package, found in rows().items():
        for ros, repository, version, licence in found:
            assert ros == "both" or ros in DISTROS, package
            assert repository.count("/") == 1, package
            assert all(part.isdigit() for part in version.split(".")), package
            assert licence in LICENCES, package


def test_no_package_is_named_that_is_not_there() -> None:
    assert set(rows()) | OURS == {file.name.split(".")[0] for file in STANDARD.rglob("*.txt")}
