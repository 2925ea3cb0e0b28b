"""Scripted sessions with servers, compared byte for byte with the recordings of them.

A deliberate change shows as a diff of ``recorded/`` and ``frozen_texts.txt`` after
``python -m tests.traces --record``.
"""

from __future__ import annotations

import difflib
import sys
from itertools import islice

import pytest

from tests.traces.frozen import FROZEN, frozen_texts
from tests.traces.session import SESSIONS, played
from tests.traces.transcript import RECORDED, file_of

pytestmark = pytest.mark.slow

#: Texts of argparse differ between versions of Python.
_RECORDED_WITH = (3, 11)
_DIFF_LINES = 200


@pytest.mark.parametrize("name", SESSIONS)
def test_a_session_is_as_recorded(name: str) -> None:
    if name == "command.help" and sys.version_info[:2] != _RECORDED_WITH:
        pytest.skip("argparse of another Python")
    recorded = file_of(name).read_text(encoding="utf-8").split("\n")
    diff = difflib.unified_diff(recorded, played(name).split("\n"), "recorded", "played", lineterm="")
    shown = [line[:2000] for line in islice(diff, _DIFF_LINES)]
    if shown:
        pytest.fail("\n".join(shown), pytrace=False)


def test_each_recording_is_of_a_session() -> None:
    assert {path.stem for path in RECORDED.glob("*.txt")} == set(SESSIONS)


def test_texts_on_the_wire_are_frozen() -> None:
    texts = frozen_texts(path.read_text(encoding="utf-8") for path in RECORDED.glob("*.txt"))
    assert FROZEN.read_text(encoding="utf-8").splitlines() == texts
