"""Scripted sessions with servers, compared byte for byte with the recordings of them.

A deliberate change shows as a diff of ``recorded/`` after ``python -m tests.traces --record``.
"""

from __future__ import annotations

import difflib
from itertools import islice

import pytest

from tests.traces.session import SESSIONS, played
from tests.traces.transcript import RECORDED, file_of

pytestmark = pytest.mark.slow

_DIFF_LINES = 200


@pytest.mark.parametrize("name", SESSIONS)
def test_a_session_is_as_recorded(name: str) -> None:
    recorded = file_of(name).read_text(encoding="utf-8").split("\n")
    diff = difflib.unified_diff(recorded, played(name).split("\n"), "recorded", "played", lineterm="")
    shown = [line[:2000] for line in islice(diff, _DIFF_LINES)]
    if shown:
        pytest.fail("\n".join(shown), pytrace=False)


def test_each_recording_is_of_a_session() -> None:
    assert {path.stem for path in RECORDED.glob("*.txt")} == set(SESSIONS)
