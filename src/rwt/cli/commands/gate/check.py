"""`rwt gate`: explain the rules of a configuration, and check a single request against them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rwt.cli.console.message_argument import read_message, read_value
from rwt.cli.console.output import Output, Style
from rwt.cli.errors import CALLED_WRONGLY, FAILED, CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import JSON_OPTION, Arguments, LocalVerb, add_family, argument, arguments

if TYPE_CHECKING:
    from rwt.access.roles import Role
    from rwt.access.settings import GateRule
    from rwt.cli.commands.gate.trial import Outcome
    from rwt.settings import LoadedSettings

REQUESTS: Final = ("publish", "subscribe", "call", "goal", "set_param", "get_param", "provide")

_WITH_MESSAGE: Final = ("publish", "call", "goal", "set_param")
_STYLES: Final[dict[str, Style]] = {"allowed": "good", "changed": "warning", "denied": "bad"}


def add_gate_command(commands: Commands) -> None:
    """Add `gate` to the command line."""
    add_family(commands, "gate", "Explain and check the roles and gate rules of a server.", VERBS)


def _load(path: Path) -> LoadedSettings:
    from rwt.access.settings import SettingsError
    from rwt.settings import load_settings

    try:
        return load_settings(path, os.environ)
    except SettingsError as error:
        raise CommandError(str(error), CALLED_WRONGLY) from error


# -- check -------------------------------------------------------------------------------------------------


def _check(arguments: Arguments, output: Output) -> int:
    """Decide one request as a server with this configuration would.

    At rest: no lease is held, nothing is approved, and no stop is pressed.
    Exit code 0: allowed, perhaps with changed values; 1: denied, or needs approval; 2: incorrect use.

    example:
      rwt gate check robot.toml --as phone publish /cmd_vel '{linear: {x: 2}}' --type geometry_msgs/msg/Twist
      rwt gate check robot.toml --role viewer call /reset --type std_srvs/srv/Trigger

    --json prints:
      {"decision": "denied", "text": "linear.x: expected -0.3 to 0.8, got 2 (…)", "role": "op",
      "rule": "gate.rules.drive.fields", "place": "robot.toml:11", "credential": "phone",
      "rules": {"gate.rules.drive": "robot.toml:5"}, "sent": ""}
    """
    from rwt.cli.commands.gate.trial import Trial  # `--help` does not need a graph

    if arguments.token is not None and arguments.role is not None:
        raise CommandError("expected one of --as and --role", CALLED_WRONGLY)
    if arguments.message is not None and arguments.verb not in _WITH_MESSAGE:
        raise CommandError(f"{arguments.verb} has no message", CALLED_WRONGLY)
    loaded = _load(arguments.config)
    message: object = {}
    if arguments.message is not None:
        read = partial(read_value, what="the value") if arguments.verb == "set_param" else read_message
        message = read(arguments.message)
    trial = Trial(loaded.settings)
    role = trial.role_of(arguments.token, arguments.role)
    outcome = trial.decide(role, arguments.verb, arguments.name, message, arguments.type)
    _print(outcome, loaded, output)
    return 0 if outcome.decision in ("allowed", "changed") else FAILED


def _print(outcome: Outcome, loaded: LoadedSettings, output: Output) -> None:
    place = loaded.place(tuple(outcome.rule.split("."))) if outcome.rule else ""
    places = {rule: loaded.place(tuple(rule.split("."))) for rule in outcome.rules}
    if output.json:
        output.record({**asdict(outcome), "place": place, "rules": places})
        return
    who = f"role {outcome.role or 'none'}" + (f", token {outcome.credential}" if outcome.credential else "")
    output.line(f"{output.styled(outcome.decision, _STYLES.get(outcome.decision, 'warning'))} ({who})")
    if outcome.text:
        output.line(f"  {output.escape_terminal(outcome.text)}")
    if outcome.sent:
        output.line(f"  sent to the robot: {output.escape_terminal(outcome.sent)}")
    if outcome.rule:
        output.line(f"  decided by {outcome.rule} ({output.escape_terminal(place)})")
    for rule, at in places.items():
        output.line(f"  checked by {rule} ({output.escape_terminal(at)})")


# -- explain -----------------------------------------------------------------------------------------------


def _explain(arguments: Arguments, output: Output) -> None:
    """Print who may do what, with the rules that apply.

    Everything else is denied.

    example:
      rwt gate explain robot.toml
      rwt gate explain robot.toml --role operator

    --json prints:
      [{"role": "operator", "verb": "publish", "resource": "/cmd_vel", "rules": ["drive"],
      "limits": "lease 0.5 s, linear.x -0.3 to 0.8 (clamp)", "places": ["robot.toml:5"]}, …]
    """
    from rwt.access.roles import roles

    loaded = _load(arguments.config)
    known = roles(loaded.settings)
    if arguments.role is not None and arguments.role not in known:
        raise CommandError(
            f"{arguments.config}: no role {arguments.role!r}; known are {', '.join(known)}", CALLED_WRONGLY
        )
    wanted = [known[arguments.role]] if arguments.role else list(known.values())
    rows = [row for role in wanted for row in _rows(loaded, role)]
    if output.json:
        output.record(rows)
        return
    table = [("ROLE", "VERB", "RESOURCE", "RULES", "LIMITS")]
    for row in rows:
        rules = [f"{rule} ({place})" for rule, place in zip(row["rules"], row["places"], strict=True)]
        table.append(
            (str(row["role"]), str(row["verb"]), str(row["resource"]), ", ".join(rules), str(row["limits"]))
        )
    output.columns(table, ("name", None, "type", None, None))
    for line in _credentials(loaded):
        output.line(output.escape_terminal(line))


def _rows(loaded: LoadedSettings, role: Role) -> Iterator[dict[str, Sequence[str] | str]]:
    """Return what a role may do. A glob is decided like a name: a narrower one has a row of its own."""
    from rwt.access.gate.rules import RULE_KEYS, Rules, is_gated
    from rwt.access.roles import ACTS, absolute_globs

    gate = loaded.settings.gate
    rules = Rules(gate)
    for act in ACTS:
        verb = "goal" if act == "goals" else act
        resources = list(role.globs[act])
        if is_gated(verb):
            for rule in gate.rules.values():
                resources += absolute_globs(getattr(rule, RULE_KEYS[verb]))
        for resource in dict.fromkeys(resources):
            if not role.allows(act, resource):
                continue
            found = rules.of(verb, resource) if is_gated(verb) else ()
            applied = [rule for rule in found if rule.holds_for(role.name)]
            yield _row(
                role,
                verb,
                resource,
                [rule.key.removeprefix("gate.rules.") for rule in applied],
                [loaded.place(tuple(rule.key.split("."))) for rule in applied],
                "; ".join(filter(None, (limits_of(rule.settings) for rule in applied))),
            )
    if gate.rules:
        yield from _emergency_rows(loaded, role)


def _emergency_rows(loaded: LoadedSettings, role: Role) -> Iterator[dict[str, Sequence[str] | str]]:
    from rwt.access.roles import glob_pattern

    emergency = loaded.settings.gate.emergency
    for verb, roles in (("stop", emergency.stop_roles), ("release_stop", emergency.release_roles)):
        if glob_pattern(roles).fullmatch(role.name):
            place = loaded.place(("gate", "emergency", f"{verb.removesuffix('_stop')}_roles"))
            yield _row(role, verb, "/gate", ["emergency"], [place])
    for name, rule in loaded.settings.gate.rules.items():
        if rule.approval is not None and glob_pattern(rule.approval.roles).fullmatch(role.name):
            place = loaded.place(("gate", "rules", name, "approval"))
            yield _row(role, "approve", name, [name], [place])


def _row(
    role: Role, verb: str, resource: str, rules: list[str], places: list[str], limits: str = ""
) -> dict[str, Sequence[str] | str]:
    row = {"role": role.name, "verb": verb, "resource": resource, "rules": rules}
    return {**row, "limits": limits, "places": places}


def limits_of(rule: GateRule) -> str:
    """Return what a rule requires, in words."""
    words = []
    if rule.approval is not None:
        words.append(f"approval by {' or '.join(rule.approval.roles)}")
    if rule.lease is not None:
        words.append(f"lease {rule.lease.seconds:g} s")
    if rule.emergency:
        words.append("emergency stop")
    for path, limit in rule.fields.items():
        if limit.one_of:
            words.append(f"{path} one of {', '.join(limit.one_of)}")
            continue
        parts = [_range(limit.min, limit.max), "" if limit.rate is None else f"{limit.rate:g} per s"]
        words.append(f"{path} {', '.join(filter(None, parts))} ({limit.beyond})")
    if rule.largest_bytes:
        words.append(f"{rule.largest_bytes} bytes")
    if rule.messages_per_second:
        words.append(f"{rule.messages_per_second} messages per s")
    return ", ".join(words)


def _range(low: float | None, high: float | None) -> str:
    if low is None:
        return "" if high is None else f"at most {high:g}"
    return f"at least {low:g}" if high is None else f"{low:g} to {high:g}"


def _credentials(loaded: LoadedSettings) -> Iterator[str]:
    auth = loaded.settings.auth
    for name, token in auth.tokens.items():
        yield f"token {name}: role {token.role} ({loaded.place(('auth', 'tokens', name))})"
    role = auth.role_without_credentials
    yield f"without credentials: {f'role {role}' if role else 'refused'}"
    if loaded.settings.gate.mode == "observe":
        yield "the gate only observes (gate.mode): nothing is denied by a rule"


_CONFIG: Final = argument(
    "config", type=Path, metavar="CONFIG", help="TOML file with the settings of the server"
)

VERBS: Final = (
    LocalVerb(
        "explain",
        _explain,
        arguments(_CONFIG, argument("--role", metavar="NAME", help="only this role"), JSON_OPTION),
    ),
    LocalVerb(
        "check",
        _check,
        arguments(
            _CONFIG,
            argument(
                "--as",
                dest="token",
                metavar="TOKEN",
                help="name of a token in auth.tokens, or the token (default: a client without credentials)",
            ),
            argument("--role", metavar="NAME", help="a client with this role, instead of --as"),
            argument("verb", choices=REQUESTS, metavar="VERB", help=f"one of {', '.join(REQUESTS)}"),
            argument("name", metavar="NAME", help="topic, service, action or parameter"),
            argument(
                "message",
                metavar="MESSAGE",
                nargs="?",
                help="message, request or goal as YAML or JSON (default: zeros)",
            ),
            argument(
                "--type",
                metavar="TYPE",
                help="type of the topic, service or action, for example geometry_msgs/msg/Twist",
            ),
            JSON_OPTION,
        ),
    ),
)
