"""The changelog and the version of a release."""

from __future__ import annotations

import datetime
from pathlib import Path

import pytest

from tools.build_release import ReleaseError
from tools.make_release import PROJECTS, dated, make_release, notes, with_version

ROOT = Path(__file__).parents[2]

CHANGES = """\
# Changelog

## [0.2.0] - unreleased

### Added

- A thing.

## [0.1.0] - 2026-01-02

- The first.
"""
DAY = datetime.date(2026, 11, 22)


def test_the_day_comes_to_the_version_that_is_released() -> None:
    found = dated(CHANGES, "0.2.0", DAY)
    assert found == CHANGES.replace("[0.2.0] - unreleased", "[0.2.0] - 2026-11-22")


@pytest.mark.parametrize(
    ("version", "said"),
    [("0.3.0", "says nothing under `## [0.3.0]`"), ("0.1.0", "has 0.1.0 as of 2026-01-02")],
)
def test_a_version_that_cannot_be_released(version: str, said: str) -> None:
    with pytest.raises(ReleaseError) as refusal:
        dated(CHANGES, version, DAY)
    assert said in str(refusal.value)


def test_notes_are_those_of_one_version() -> None:
    assert notes(CHANGES, "0.2.0") == "### Added\n\n- A thing."
    assert notes(CHANGES, "0.1.0") == "- The first."


def test_an_empty_section_is_none() -> None:
    with pytest.raises(ReleaseError):
        notes("## [1.0.0] - unreleased\n\n## [0.9.0] - 2026-01-01\n\n- This.\n", "1.0.0")


def test_only_the_version_of_the_project_changes() -> None:
    changed = []
    for project in PROJECTS:
        text = project.read_text(encoding="utf-8")
        before, after = text.splitlines(), with_version(text, "9.8.7").splitlines()
        changed.append([line for line, other in zip(after, before, strict=True) if line != other])
    server, *others = changed
    assert server == ['version = "9.8.7"', 'webrtc = ["rwt-webrtc==9.8.7"]']
    for version, dependencies in others:
        assert version == server[0]
        assert "==9.8.7" in dependencies


@pytest.mark.parametrize("version", ["", "1", "v1.0.0", "1.0", "1.0.0 ", "01.0.0-beta"])
def test_what_is_no_version_is_refused_first(version: str) -> None:
    with pytest.raises(ReleaseError) as refusal:
        make_release(version, dry_run=True)
    assert "is no version" in str(refusal.value)


def test_the_changelog_has_a_section_for_the_version_of_the_project() -> None:
    version = next(
        line.split('"')[1]
        for line in (ROOT / "pyproject.toml").read_text(encoding="utf-8").splitlines()
        if line.startswith("version = ")
    )
    assert notes((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), version)
