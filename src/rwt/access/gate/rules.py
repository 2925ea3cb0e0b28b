"""Rules of the gate, looked up by act and name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal, TypeGuard

from rwt.access.errors import GateRefused
from rwt.access.roles import NameCache, absolute_globs, glob_pattern

if TYPE_CHECKING:
    import re
    from collections.abc import Mapping

    from rwt.access.settings import GateRule, GateSettings
    from rwt_interfaces.structs import MessageType

GatedAct = Literal["publish", "call", "goal", "set_param"]
"""Act with gate rules; for every other act the role alone decides."""

RULE_KEYS: Final[Mapping[GatedAct, str]] = {
    "publish": "topics",
    "call": "services",
    "goal": "actions",
    "set_param": "parameters",
}
"""Key of a rule's names, by act."""


def is_gated(act: str) -> TypeGuard[GatedAct]:
    """Return True if rules can be about an act."""
    return act in RULE_KEYS


class Rule:
    """Rule of the gate.

    Attributes:
        key: key in the settings, such as `gate.rules.drive`.
        settings: requirements of the rule.
        type: type of the rule's topics; None if the robot alone decides. Set by the gate.
    """

    __slots__ = ("_patterns", "_roles", "key", "settings", "type")

    def __init__(self, name: str, settings: GateRule) -> None:
        self.key = f"gate.rules.{name}"
        self.settings = settings
        self.type: MessageType | None = None
        self._patterns: dict[GatedAct, re.Pattern[str]] = {
            act: glob_pattern(absolute_globs(getattr(settings, key))) for act, key in RULE_KEYS.items()
        }
        self._roles = glob_pattern(settings.roles)

    def names(self, act: GatedAct, name: str) -> bool:
        """Return True if the rule is about `name`, an absolute name."""
        return self._patterns[act].fullmatch(name) is not None

    def holds_for(self, role: str) -> bool:
        """Return True if the rule applies to clients of a role."""
        return self._roles.fullmatch(role) is not None

    def __repr__(self) -> str:
        return f"<Rule {self.key}>"


class Rules:
    """All rules of a gate, in the order of the settings.

    Attributes:
        has_emergency: True if the emergency stop is for any of them.
        has_parameters: True if any of them is about parameters.
    """

    def __init__(self, settings: GateSettings) -> None:
        self.all = tuple(Rule(name, rule) for name, rule in settings.rules.items())
        self._required = glob_pattern(absolute_globs(settings.require))
        self.has_emergency = any(rule.settings.emergency for rule in self.all)
        self.has_parameters = any(rule.settings.parameters for rule in self.all)
        self._found: NameCache[GatedAct, tuple[Rule, ...]] = NameCache(
            lambda act, name: tuple(rule for rule in self.all if rule.names(act, name))
        )

    def of(self, act: GatedAct, name: str) -> tuple[Rule, ...]:
        """Return the rules about a name, for any role."""
        return self._found[act, name]

    def require(self, act: GatedAct, name: str) -> None:
        """Raise GateRefused if `gate.require` is about an absolute name, and no rule is."""
        if act != "set_param" and self._required.fullmatch(name) is not None and not self.of(act, name):
            raise GateRefused(f"{name} has to be guarded by a rule, and no rule is about it", "gate.require")
