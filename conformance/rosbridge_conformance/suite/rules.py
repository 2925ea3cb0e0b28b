"""Rules that cases test, by id, and the reasons why some have no case."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

_FOLDER = Path(__file__).parents[1]


@dataclass(frozen=True, slots=True)
class Rule:
    """One rule of the protocol as it is spoken in the field.

    Attributes:
        levels: as in `MUST` or `MUST/COMPAT`.
        text: what it says.
        no_case: why no case of the server suite checks it, or "".
    """

    id: str
    levels: str
    text: str
    no_case: str = ""


def load_rules() -> Mapping[str, Rule]:
    """All rules of `rules.json`, with the reasons of `coverage.json`."""
    texts = json.loads((_FOLDER / "rules.json").read_text(encoding="utf-8"))
    reasons = json.loads((_FOLDER / "coverage.json").read_text(encoding="utf-8"))["without_case"]
    return {
        key: Rule(key, entry["level"], entry["text"], reasons.get(key, "")) for key, entry in texts.items()
    }
