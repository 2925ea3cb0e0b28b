"""Which rules of the gate hold for a name and a role."""

from __future__ import annotations

import fnmatch
import re
from typing import TYPE_CHECKING, Final, Literal

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from rwt.access.settings.gate import GateRule

GatedAct = Literal["publish", "call", "goal", "set_param"]
"""What the gate looks at; everything else is the role's matter alone."""

_KEYS: Final[Mapping[GatedAct, str]] = {
    "publish": "topics",
    "call": "services",
    "goal": "actions",
    "set_param": "parameters",
}

#: Names come from clients, so what is remembered of them is bounded; at the bound all of it is forgotten.
_MOST_NAMES: Final = 4096


class Rule:
    """One rule.

    Attributes:
        key: in the settings, such as `gate.rules.drive`.
        settings: what it asks for.
    """

    __slots__ = ("_patterns", "_roles", "key", "settings")

    def __init__(self, name: str, settings: GateRule) -> None:
        self.key = f"gate.rules.{name}"
        self.settings = settings
        self._patterns: dict[GatedAct, re.Pattern[str]] = {
            act: name_pattern(getattr(settings, key)) for act, key in _KEYS.items()
        }
        self._roles = pattern(settings.roles)

    def names(self, act: GatedAct, name: str) -> bool:
        """Whether it is about `name`, which is absolute."""
        return self._patterns[act].fullmatch(name) is not None

    def holds_for(self, role: str) -> bool:
        """Whether it holds for clients of a role."""
        return self._roles.fullmatch(role) is not None

    def __repr__(self) -> str:
        return f"<Rule {self.key}>"


class Rules:
    """All rules of a gate, in the order of the settings."""

    def __init__(self, settings: Mapping[str, GateRule]) -> None:
        self.all = tuple(Rule(name, rule) for name, rule in settings.items())
        self._found: dict[tuple[GatedAct, str], tuple[Rule, ...]] = {}

    def of(self, act: GatedAct, name: str) -> tuple[Rule, ...]:
        """The rules about a name, for whatever role."""
        found = self._found.get((act, name))
        if found is None:
            if len(self._found) >= _MOST_NAMES:
                self._found.clear()
            found = self._found[act, name] = tuple(rule for rule in self.all if rule.names(act, name))
        return found


def pattern(globs: Iterable[str]) -> re.Pattern[str]:
    """One pattern for several globs; one that matches nothing where there are none."""
    return re.compile("|".join(map(fnmatch.translate, globs)) or r"(?!)")


def name_pattern(globs: Iterable[str]) -> re.Pattern[str]:
    """As :func:`pattern`, of absolute names."""
    return pattern(glob if glob.startswith(("/", "*")) else f"/{glob}" for glob in globs)
