"""Cases of messages, QoS pairs, names, YAML and arguments that Hypothesis generates, and their comparison.

`differential.cases` answers them in the interpreter of either rclpy. Known differences are not generated:
fields of other messages, strings with NUL, where the real one ends them, and of YAML subnormal numbers,
empty maps, anchors and repeated keys.
"""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from itertools import zip_longest
from operator import itemgetter
from typing import Any, Final

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from differential.comparison import HERE, Rclpy
from rwt_interfaces.registry import Registry
from rwt_rclpy.messages.classes import MessageClasses

Strategy = st.SearchStrategy[Any]
Ask = Callable[[str, Any], list[str]]
#: Recorded cases of each area.
RECORDED_CASES: Final = 60
_RECORDED: Final = HERE / "recorded" / "generated.jsonl"

_MESSAGES: Final = {
    "test_msgs": (
        "Arrays", "BasicTypes", "BoundedPlainSequences", "BoundedSequences", "Constants", "Defaults", "Empty",
        "Strings", "UnboundedSequences", "WStrings",
    ),
    "std_msgs": ("Bool", "Byte", "Char", "Float32", "String", "UInt8"),
}  # fmt: skip
_INTEGERS: Final = re.compile(r"(u?)int(\d+)")
_SEQUENCES: Final = re.compile(r"sequence<(\w+?(?:<\d+>)?)(?:, (\d+))?>|(\w+)\[(\d+)\]")
_WRONG: Final[Strategy] = st.one_of(
    st.none(), st.integers(-300, 300), st.text(max_size=3), st.just([]), st.floats(-2, 2)
)


def _field(kind: str) -> Strategy | None:
    """Return values of a field's type, some of them wrong; None for other messages."""
    if found := _SEQUENCES.fullmatch(kind):
        element = _field(found[1] or found[3])
        most = int(found[2] or found[4] or 4)
        return (
            None if element is None else st.lists(element, min_size=most * bool(found[4]), max_size=most + 1)
        )
    if found := _INTEGERS.fullmatch(kind):
        most = 2 ** (int(found[2]) - (not found[1]))
        valid: Strategy = st.integers(0 if found[1] else -most, most - 1) | st.integers(-most - 1, most)
    elif kind in ("float", "double"):
        valid = st.floats(width=32 if kind == "float" else 64)
    elif kind == "boolean":
        valid = st.booleans()
    elif kind == "octet":
        valid = st.binary(min_size=1, max_size=1).map(lambda octet: {"bytes": list(octet)})
    elif kind.startswith(("string", "wstring")):
        valid = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=24)
    else:
        return None
    return st.one_of(valid, valid, valid, valid, _WRONG)


@cache
def _classes() -> MessageClasses:
    registry = Registry()
    registry.add_directory(HERE / "interfaces")
    return MessageClasses(registry)


@st.composite
def _message(draw: st.DrawFn) -> Any:
    package = draw(st.sampled_from(sorted(_MESSAGES)))
    name = draw(st.sampled_from(_MESSAGES[package]))
    known = _classes().message(f"{package}/{name}").get_fields_and_field_types()
    fields = {field: values for field, kind in known.items() if (values := _field(kind)) is not None}
    chosen = draw(st.lists(st.sampled_from(sorted(fields)), unique=True, max_size=4)) if fields else []
    return package, name, {field: draw(fields[field]) for field in chosen}


_SPANS: Final = st.fixed_dictionaries(
    {"ns": st.sampled_from((0, 1, 10**9, 2 * 10**9, 2**63 - 2, 2**63 - 1)) | st.integers(0, 2**63 - 1)}
)
_PROFILES: Final = st.fixed_dictionaries(
    {},
    optional={
        "history": st.integers(-1, 4),
        "depth": st.integers(-1, 20),
        "reliability": st.integers(-1, 5),
        "durability": st.integers(-1, 5),
        "liveliness": st.integers(-1, 6),
        "deadline": _SPANS,
        "lifespan": _SPANS,
        "liveliness_lease_duration": _SPANS,
        "avoid_ros_namespace_conventions": st.booleans() | st.integers(0, 1),
    },
).map(lambda policies: {"depth": 1, **policies} if policies.get("history", 1) == 1 else policies)

_PIECES: Final = st.sampled_from(
    (
        "a",
        "b1",
        "1",
        "_",
        "__",
        "/",
        "//",
        "~",
        "~/",
        "{",
        "}",
        "{node}",
        "{ns}",
        "{x}",
        " ",
        ".",
        "-",
        "é",
        ":",
        "*",
    )
)
_NAMES: Final = st.lists(_PIECES, max_size=6).map("".join)
_SPELLINGS: Final = (
    "1", "-1", "+1", "1_0", "0x1F", "0o17", "017", "0b1", "1.5", ".5", "5.", "1e3", "1.5e-3", ".inf", "-.inf",
    ".nan", ".NaN", "inf", "nan", "true", "True", "TRUE", "yes", "No", "on", "off", "y", "n", "~", "null",
    "Null", "''", '""', "'1'", '"true"', "a", "a b", "=", "1:30", "2020-01-01", "é", "- 1", "# a",
    "!!str 1", "!!int '1'", "!!float 1", "!!bool yes", "!!binary aGk=",
)  # fmt: skip
_SCALARS: Final = st.one_of(
    st.sampled_from(_SPELLINGS),
    st.integers(-(2**63), 2**63 - 1).map(str),
    st.floats(allow_subnormal=False).map(repr),
    st.text("abcxyz 019.-+eE_", max_size=6),
)
_FLOWS: Final = st.lists(_SCALARS.filter(lambda text: "\n" not in text and "#" not in text), max_size=4).map(
    lambda values: f"[{', '.join(values)}]"
)
_KEYS: Final = st.sampled_from(("a", "b", "c.d", "e/f", "1", "'g'", "h i", "use_sim_time"))
_NODES: Final = st.sampled_from(
    ("node", "/ns/node", "/**", "/*/node", "/ns/*", "other", "/**/node", "ns", "'/node'", "node_", "/*")
)


def _parameters(entries: list[tuple[str, str]]) -> str:
    return "".join(f"    {key}: {value}\n" for key, value in entries)


_YAML: Final = st.lists(
    st.tuples(
        _NODES,
        st.sampled_from(("ros__parameters",) * 9 + ("ros_parameters",)),
        st.lists(st.tuples(_KEYS, _SCALARS | _FLOWS), max_size=3, unique_by=itemgetter(0)).map(_parameters),
    ),
    max_size=2,
    unique_by=itemgetter(0),
).map(lambda nodes: "".join(f"{node}:\n  {word}:\n{below}" for node, word, below in nodes))

_RULES: Final = st.builds(
    "{}:={}".format,
    _NAMES
    | st.sampled_from(("__node", "__ns", "__name", "node:a", "node:__node", "a", "/b", "~/a", "/ns/a")),
    _NAMES | st.sampled_from(("a", "/x/y", "~/z", "made")),
)
_ASSIGNED: Final = st.builds(
    "{}:={}".format, st.sampled_from(("a", "node:a", "other:a", "a.b", "a b", "")), _SCALARS | _FLOWS
)
_TOKENS: Final = st.one_of(
    st.tuples(st.sampled_from(("-r", "--remap")), _RULES),
    st.tuples(st.sampled_from(("-p", "--param")), _ASSIGNED),
    st.tuples(
        st.sampled_from(("--", "--ros-args", "other", "-x", "--enable-rosout-logs", "--disable-stdout-logs"))
    ),
    st.tuples(st.just("--"), _RULES, st.just("--ros-args")),
    st.tuples(st.just("--log-level"), st.sampled_from(("info", "WARN", "node:=debug", "loud", ""))),
    st.tuples(st.sampled_from(("-e", "--enclave")), _NAMES),
)
_ARGUMENTS: Final = st.lists(_TOKENS, max_size=4).map(
    lambda tokens: ["--ros-args", *(token for each in tokens for token in each)]
)

#: Generated cases by the function of `differential.cases` that answers them.
AREAS: Final[dict[str, Strategy]] = {
    "messages": _message(),
    "qos": st.tuples(_PROFILES, _PROFILES),
    "names": st.tuples(_NAMES, _NAMES),
    "yaml": st.tuples(_YAML),
    "arguments": _ARGUMENTS,
}


@contextmanager
def answering(rclpy: Rclpy) -> Iterator[Ask]:
    """Yield a function that answers a case of an area; its process is started again if a case ends it."""
    environment = {**rclpy.environment, "ROS_PYTHON_CHECK_FIELDS": "1", "ROS_DOMAIN_ID": "89"}

    def start() -> subprocess.Popen[str]:
        return subprocess.Popen(
            rclpy.command("cases"),
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    process = start()

    def ask(area: str, case: Any) -> list[str]:
        nonlocal process
        assert process.stdin is not None and process.stdout is not None  # They are pipes.
        process.stdin.write(json.dumps([area, case]) + "\n")
        process.stdin.flush()
        line = process.stdout.readline()
        if line:
            answer: list[str] = json.loads(line)
            return answer
        status = process.wait()
        process = start()
        return [f"exit status {status}"]

    try:
        yield ask
    finally:
        process.kill()
        process.communicate()


def _try(area: str, number: int, function: Callable[[str, Any], None], **options: Any) -> None:
    """Call a function with generated cases of an area."""

    def call(case: Any) -> None:
        function(area, case)

    chosen = settings(
        max_examples=number,
        database=None,
        deadline=None,
        report_multiple_bugs=False,
        suppress_health_check=list(HealthCheck),
        **options,
    )
    chosen(given(AREAS[area])(call))()


def compare_generated(real: Rclpy, ours: Rclpy, number: int) -> list[str]:
    """Return for each area the smallest case with different answers, if there is one."""
    found: dict[str, str] = {}
    with answering(real) as ask_real, answering(ours) as ask_ours:

        def compare(area: str, case: Any) -> None:
            expected, answered = ask_real(area, case), ask_ours(area, case)
            if answered != expected:
                found[area] = _difference(area, case, expected, answered)
                raise AssertionError(found[area])

        for area in AREAS:
            with suppress(AssertionError):
                _try(area, number, compare, phases=(Phase.generate, Phase.shrink))
    return list(found.values())


def _difference(area: str, case: Any, expected: list[str], answered: list[str]) -> str:
    lines = [f"{area} {json.dumps(case, ensure_ascii=False)}"]
    for number, (one, other) in enumerate(zip_longest(expected, answered)):
        if one != other:
            lines += [f"  {number} real {one}", f"  {number} ours {other}"]
    return "\n".join(lines)


def record_generated(real: Rclpy) -> None:
    """Keep some generated cases with the real one's answers, which are those of all releases."""
    lines: list[str] = []
    with answering(real) as ask:

        def keep(area: str, case: Any) -> None:
            lines.append(json.dumps([area, case, ask(area, case)]))

        for area in AREAS:
            _try(area, RECORDED_CASES, keep, derandomize=True, phases=(Phase.generate,))
    _RECORDED.write_text("".join(f"{line}\n" for line in lines), "utf-8")


def differences_from_recorded(ours: Rclpy) -> list[str]:
    """Return the recorded cases with other answers."""
    rows = [json.loads(line) for line in _RECORDED.read_text("utf-8").splitlines()]
    with answering(ours) as ask:
        return [
            _difference(area, case, expected, answered)
            for area, case, expected in rows
            if (answered := ask(area, case)) != expected
        ]
