"""Strict parser of case files: rejects unknown keys, with file and location."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from rosbridge_conformance.suite.case import (
    LEVELS,
    PROFILES,
    SIDES,
    TEXTS,
    VIA,
    Case,
    Close,
    Divergence,
    Expect,
    ExpectAll,
    ExpectClose,
    ExpectNothing,
    Hear,
    HearNothing,
    Level,
    Open,
    Send,
    Settle,
    Side,
    Step,
    Tell,
    Tolerated,
    Wait,
)
from rosbridge_conformance.suite.matching import check_pattern
from rosbridge_conformance.suite.values import Json
from rosbridge_conformance.wire.line_protocol import COMMANDS

CASES = Path(__file__).parents[1] / "cases"
"""Cases of this suite for servers."""

CLIENT_CASES = Path(__file__).parents[1] / "cases-client"
"""Cases of this suite for client libraries."""

REQUIRED = ("title", "rules", "level", "profile", "steps")
OPTIONAL = (
    "$schema", "about", "spec", "ros", "needs", "alone", "timed", "leftover", "probe", "example",
    "divergences", "side",
)  # fmt: skip

VERBS: Mapping[str, tuple[str, ...]] = {
    "send": ("as", "times", "every", "via", "fragment_size", "note"),
    "send_text": ("as", "times", "every", "note"),
    "send_hex": ("as", "times", "every", "note"),
    "expect": ("as", "within", "via", "fragment_size", "tolerate", "note"),
    "expect_all": ("as", "within", "note"),
    "expect_nothing": ("as", "matching", "note"),
    "expect_close": ("as", "within", "note"),
    "wait": ("note",),
    "settle": ("note",),
    "open": ("note",),
    "close": ("abruptly", "note"),
    "tell": ("within", "note"),
    "hear": ("within", "note"),
    "hear_nothing": ("note",),
}
"""Verbs of a step, and the keys allowed with each."""

CLIENT_VERBS = ("tell", "hear", "hear_nothing")
"""Verbs only for cases of client libraries; they address the program around the library."""

_ID = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*(/[a-z0-9]+(-[a-z0-9]+)*)+")
_RULE = re.compile(r"[A-Z]+-\d{2}")
_CLIENT = re.compile(r"[a-z]")
_LONGEST_TITLE = 80
_ASKING = (Expect, ExpectAll, ExpectNothing, ExpectClose, Hear, HearNothing)


class CaseError(ValueError):
    """A case file is invalid; the text gives file, location and expected value."""


def load_cases(folder: Path = CASES) -> tuple[Case, ...]:
    """Return all cases below a folder, sorted by id.

    Raises:
        CaseError: a file is invalid, or two cases have the same title.
    """
    cases = tuple(load_case(path, folder) for path in sorted(folder.rglob("*.json")))
    seen: dict[str, str] = {}
    for case in cases:
        if case.title in seen:
            raise CaseError(f"{case.id}: title: the same as that of {seen[case.title]}")
        seen[case.title] = case.id
    return cases


def load_case(path: Path, folder: Path) -> Case:
    """Return one case; its id is its path below `folder`."""
    case_id = path.relative_to(folder).with_suffix("").as_posix()
    try:
        value: Json = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise CaseError(f"{path}: cannot be read: {error}") from error
    except json.JSONDecodeError as error:
        raise CaseError(f"{path}:{error.lineno}: not JSON: {error.msg}") from error
    return read_case(case_id, value)


def read_case(case_id: str, value: Json) -> Case:
    """Return one case from the content of its file.

    Raises:
        CaseError: the content is invalid; the text gives the location (`topics/echo: steps[2].within: …`).
    """
    at = _Place(case_id)
    if _ID.fullmatch(case_id) is None:
        raise at.error("an id is `section/name` in lower case, digits and single dashes")
    fields = at.object(value, REQUIRED, OPTIONAL)
    steps = at.key("steps").list(fields["steps"])
    if not steps:
        raise at.key("steps").error("a case needs steps")
    side = _side(at.key("side"), fields.get("side", "server"))
    read = [_step(at.key("steps").index(number), step, side) for number, step in enumerate(steps)]
    title = at.key("title").text(fields["title"])
    if len(title) > _LONGEST_TITLE:
        raise at.key("title").error(f"at most {_LONGEST_TITLE} characters, got {len(title)}")
    asks = any(isinstance(step, _ASKING) for step, _ in read)
    if not asks and not at.key("probe").flag(fields.get("probe", True)):
        raise at.key("steps").error("nothing is expected, and no probe either: the case cannot fail")
    return Case(
        id=case_id,
        title=title,
        rules=_rules(at.key("rules"), fields["rules"]),
        spec=_spec(at.key("spec"), fields.get("spec", {})),
        level=_level(at.key("level"), fields["level"]),
        profile=at.key("profile").choice(fields["profile"], PROFILES),
        steps=tuple(step for step, _ in read),
        notes=tuple(note for _, note in read),
        clients=_clients(at, [step for step, _ in read]),
        about=at.key("about").text(fields.get("about", ""), empty=True),
        ros=_ros(at.key("ros"), fields.get("ros", [1, 2])),
        needs=at.key("needs").texts(fields.get("needs", [])),
        alone=at.key("alone").flag(fields.get("alone", False)),
        timed=at.key("timed").flag(fields.get("timed", False)),
        leftover=at.key("leftover").flag(fields.get("leftover", False)),
        probe=at.key("probe").flag(fields.get("probe", True)),
        example=at.key("example").texts(fields.get("example", [])),
        divergences=_divergences(at.key("divergences"), fields.get("divergences", [])),
        side=side,
    )


class _Place:
    """Location in a file: reads values of an expected kind, and raises errors with the location."""

    def __init__(self, where: str, path: str = "") -> None:
        self._where = where
        self._path = path

    def key(self, name: str) -> _Place:
        return _Place(self._where, f"{self._path}.{name}" if self._path else name)

    def index(self, number: int) -> _Place:
        return _Place(self._where, f"{self._path}[{number}]")

    def error(self, text: str) -> CaseError:
        return CaseError(f"{self._where}: {self._path}: {text}" if self._path else f"{self._where}: {text}")

    def object(self, value: Json, required: tuple[str, ...], optional: tuple[str, ...]) -> dict[str, Json]:
        if not isinstance(value, dict):
            raise self.error(f"expected an object, got {json.dumps(value)}")
        for name in required:
            if name not in value:
                raise self.error(f"`{name}` is missing")
        for name in value:
            if name not in required and name not in optional:
                raise self.error(f"unknown key `{name}`; known are {', '.join((*required, *optional))}")
        return value

    def list(self, value: Json) -> list[Json]:
        if not isinstance(value, list):
            raise self.error(f"expected a list, got {json.dumps(value)}")
        return value

    def text(self, value: Json, *, empty: bool = False) -> str:
        if not isinstance(value, str) or not (value or empty):
            raise self.error(f"expected text, got {json.dumps(value)}")
        return value

    def texts(self, value: Json) -> tuple[str, ...]:
        return tuple(self.index(number).text(item) for number, item in enumerate(self.list(value)))

    def flag(self, value: Json) -> bool:
        if not isinstance(value, bool):
            raise self.error(f"expected true or false, got {json.dumps(value)}")
        return value

    def whole(self, value: Json, least: int) -> int:
        if not isinstance(value, int) or isinstance(value, bool) or value < least:
            raise self.error(f"expected a whole number of at least {least}, got {json.dumps(value)}")
        return value

    def seconds(self, value: Json) -> float:
        if not isinstance(value, int | float) or isinstance(value, bool) or not 0 <= value <= 60:
            raise self.error(f"expected seconds from 0 to 60, got {json.dumps(value)}")
        return float(value)

    def choice(self, value: Json, among: tuple[str, ...]) -> str:
        if not isinstance(value, str) or value not in among:
            raise self.error(f"expected one of {', '.join(among)}, got {json.dumps(value)}")
        return value

    def client(self, value: Json) -> str:
        if not isinstance(value, str) or _CLIENT.fullmatch(value) is None:
            raise self.error(f"a client's name is one lower-case letter, got {json.dumps(value)}")
        return value

    def pattern(self, value: Json) -> Json:
        fault = check_pattern(value)
        if fault is not None:
            raise self.error(fault)
        return value


def _rules(at: _Place, value: Json) -> tuple[str, ...]:
    rules = at.texts(value)
    if not rules:
        raise at.error("a case checks at least one rule")
    for number, rule in enumerate(rules):
        if _RULE.fullmatch(rule) is None:
            raise at.index(number).error(f"a rule id is like PUB-01, got {json.dumps(rule)}")
    return rules


def _spec(at: _Place, value: Json) -> dict[str, str]:
    fields = at.object(value, (), TEXTS)
    return {name: at.key(name).text(section) for name, section in fields.items()}


def _level(at: _Place, value: Json) -> Level:
    for level in LEVELS:
        if value == level:
            return level
    raise at.error(f"expected one of {', '.join(LEVELS)}, got {json.dumps(value)}")


def _side(at: _Place, value: Json) -> Side:
    for side in SIDES:
        if value == side:
            return side
    raise at.error(f"expected one of {', '.join(SIDES)}, got {json.dumps(value)}")


def _ros(at: _Place, value: Json) -> tuple[int, ...]:
    ros = tuple(at.index(number).whole(item, 1) for number, item in enumerate(at.list(value)))
    if ros not in ((1,), (2,), (1, 2)):
        raise at.error(f"expected [1], [2] or [1, 2], got {json.dumps(value)}")
    return ros


def _divergences(at: _Place, value: Json) -> tuple[Divergence, ...]:
    def one(place: _Place, item: Json) -> Divergence:
        fields = place.object(item, ("server", "does"), ())
        return Divergence(place.key("server").text(fields["server"]), place.key("does").text(fields["does"]))

    return tuple(one(at.index(number), item) for number, item in enumerate(at.list(value)))


def _clients(at: _Place, steps: list[Step]) -> tuple[str, ...]:
    """Return clients in order of first use; the first is open from the start, the others from first use."""
    names: dict[str, None] = {}
    for step in steps:
        for name in _clients_of(step):
            names.setdefault(name)
    if not names:
        raise at.key("steps").error("no step names a client")
    return tuple(names)


def _clients_of(step: Step) -> Iterator[str]:
    match step:
        case Settle():
            yield from step.clients
        case Tell() | Hear() | HearNothing():
            yield "a"
        case Wait():
            return
        case _:
            yield step.client


def _step(at: _Place, value: Json, side: Side) -> tuple[Step, str]:
    if not isinstance(value, dict):
        raise at.error(f"expected an object, got {json.dumps(value)}")
    verbs = [name for name in value if name in VERBS]
    if len(verbs) != 1:
        raise at.error(f"a step has exactly one of {', '.join(VERBS)}, got {', '.join(value) or 'nothing'}")
    verb = verbs[0]
    if side == "server" and (verb in CLIENT_VERBS or (verb == "send" and "via" in value)):
        raise at.error(f"`{verb if verb in CLIENT_VERBS else 'via'}` is for cases with `side` client")
    fields = at.object(value, (verb,), VERBS[verb])
    note = at.key("note").text(fields.get("note", ""), empty=True)
    return _READERS[verb](at, fields), note


def _client(at: _Place, fields: Mapping[str, Json]) -> str:
    return at.key("as").client(fields.get("as", "a"))


def _within(at: _Place, fields: Mapping[str, Json]) -> float | None:
    return at.key("within").seconds(fields["within"]) if "within" in fields else None


def _send(at: _Place, fields: Mapping[str, Json]) -> Step:
    client = _client(at, fields)
    times = at.key("times").whole(fields.get("times", 1), 1)
    every = at.key("every").seconds(fields.get("every", 0))
    if "send" in fields:
        via = _via(at, fields)
        size = at.key("fragment_size").whole(fields["fragment_size"], 1) if "fragments" in via else 0
        return Send(client, "json", fields["send"], times, every, via, size)
    if "send_text" in fields:
        text = at.key("send_text").text(fields["send_text"], empty=True)
        return Send(client, "text", text, times, every)
    digits = at.key("send_hex").text(fields["send_hex"], empty=True)
    try:
        bytes.fromhex(digits)
    except ValueError as error:
        raise at.key("send_hex").error("expected pairs of hexadecimal digits") from error
    return Send(client, "hex", digits, times, every)


def _via(at: _Place, fields: Mapping[str, Json]) -> tuple[str, ...]:
    via = at.key("via").texts(fields.get("via", []))
    for number, name in enumerate(via):
        at.key("via").index(number).choice(name, VIA)
    if ("fragment_size" in fields) != ("fragments" in via):
        raise at.error("`fragment_size` stands where `via` has fragments, and only there")
    return via


def _expect(at: _Place, fields: Mapping[str, Json]) -> Step:
    via = _via(at, fields)
    size = fields.get("fragment_size")
    return Expect(
        _client(at, fields),
        at.key("expect").pattern(fields["expect"]),
        _within(at, fields),
        via,
        at.key("fragment_size").whole(size, 1) if size is not None else None,
        tuple(
            _tolerated(at.key("tolerate").index(number), item)
            for number, item in enumerate(at.key("tolerate").list(fields.get("tolerate", [])))
        ),
    )


def _tolerated(at: _Place, value: Json) -> Tolerated:
    fields = at.object(value, ("frame", "why"), ())
    return Tolerated(at.key("frame").pattern(fields["frame"]), at.key("why").text(fields["why"]))


def _expect_all(at: _Place, fields: Mapping[str, Json]) -> Step:
    frames = at.key("expect_all").list(fields["expect_all"])
    if len(frames) < 2:
        raise at.key("expect_all").error("expected at least two frames")
    patterns = [at.key("expect_all").index(number).pattern(item) for number, item in enumerate(frames)]
    return ExpectAll(_client(at, fields), tuple(patterns), _within(at, fields))


def _expect_nothing(at: _Place, fields: Mapping[str, Json]) -> Step:
    seconds = at.key("expect_nothing").seconds(fields["expect_nothing"])
    matching = at.key("matching").pattern(fields["matching"]) if "matching" in fields else None
    return ExpectNothing(_client(at, fields), seconds, matching)


def _expect_close(at: _Place, fields: Mapping[str, Json]) -> Step:
    place = at.key("expect_close")
    codes = [
        place.index(number).whole(item, 1000)
        for number, item in enumerate(place.list(fields["expect_close"]))
    ]
    return ExpectClose(_client(at, fields), tuple(codes), _within(at, fields))


def _settle(at: _Place, fields: Mapping[str, Json]) -> Step:
    place = at.key("settle")
    names = [place.index(number).client(item) for number, item in enumerate(place.list(fields["settle"]))]
    if not names:
        raise place.error("expected the names of clients")
    return Settle(tuple(names))


def _wait(at: _Place, fields: Mapping[str, Json]) -> Step:
    return Wait(at.key("wait").seconds(fields["wait"]))


def _open(at: _Place, fields: Mapping[str, Json]) -> Step:
    return Open(at.key("open").client(fields["open"]))


def _close(at: _Place, fields: Mapping[str, Json]) -> Step:
    client = at.key("close").client(fields["close"])
    return Close(client, at.key("abruptly").flag(fields.get("abruptly", False)))


def _tell(at: _Place, fields: Mapping[str, Json]) -> Step:
    command = fields["tell"]
    place = at.key("tell")
    if not isinstance(command, dict):
        raise place.error(f"expected an object, got {json.dumps(command)}")
    place.key("do").choice(command.get("do"), tuple(COMMANDS))
    for key in command:
        if key not in ("do", *COMMANDS[str(command["do"])]):
            known = ", ".join(COMMANDS[str(command["do"])])
            raise place.error(f"unknown key `{key}`; {command['do']} takes {known}")
    return Tell(command, _within(at, fields))


def _hear(at: _Place, fields: Mapping[str, Json]) -> Step:
    return Hear(at.key("hear").pattern(fields["hear"]), _within(at, fields))


def _hear_nothing(at: _Place, fields: Mapping[str, Json]) -> Step:
    return HearNothing(at.key("hear_nothing").seconds(fields["hear_nothing"]))


_READERS: Mapping[str, Callable[[_Place, Mapping[str, Json]], Step]] = {
    "send": _send,
    "send_text": _send,
    "send_hex": _send,
    "expect": _expect,
    "expect_all": _expect_all,
    "expect_nothing": _expect_nothing,
    "expect_close": _expect_close,
    "wait": _wait,
    "settle": _settle,
    "open": _open,
    "close": _close,
    "tell": _tell,
    "hear": _hear,
    "hear_nothing": _hear_nothing,
}
