"""Errors of a script that cannot be played: the file, the key, what is expected, the nearest known."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rwt.extensions.testing import ObservedGraph, ObservedWire, ScriptError
from rwt.extensions.testing.script.control import ScriptControl
from rwt.extensions.testing.script.file import Script, read_recorded, read_script


def complaint(tmp_path: Path, text: str) -> str:
    file = tmp_path / "robot.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ScriptError) as raised:
        read_script(file)
    return str(raised.value).removeprefix(f"{file}: ")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("topcis = {}", "unknown key `topcis`; did you mean `topics`?"),
        ("[zzz]", "unknown key `zzz`; known are name, parameters, topics, services, actions, faults"),
        (
            '[topics."/x"]\ntype = "std_msgs/String"\nrat = 2',
            'unknown key `topics."/x".rat`; did you mean `rate`?',
        ),
        ('[topics."/x"]\nrate = 2', '`topics."/x".type`: expected a string, and it is missing'),
        ('[topics."/x"]\ntype = 3', '`topics."/x".type`: expected a string, got 3'),
        (
            '[topics."/x"]\ntype = "a/B"\nmessages = [{}]\nrate = 0',
            '`topics."/x".rate`: expected a number of at least 0.001 and at most 1000000, got 0',
        ),
        ('[topics."/x"]\ntype = "a/B"\nrate = 1', '`topics."/x"`: `rate` needs `messages`'),
        (
            '[topics."/x"]\ntype = "a/B"\nlatched = {}\nmessages = [{}]',
            '`topics."/x"`: expected one of `latched` and `messages`, not both',
        ),
        (
            '[topics."/x"]\ntype = "a/B"\nmessages = [1]',
            '`topics."/x".messages[0]`: expected a table, got 1',
        ),
        (
            '[services."/x"]\ntype = "a/B"',
            '`services."/x"`: expected one of `returns`, `fails`, `never_answers` and `when`',
        ),
        (
            '[services."/x"]\ntype = "a/B"\n[[services."/x".when]]\nreqest = {}\nreturns = {}',
            'unknown key `services."/x".when[0].reqest`; did you mean `request`?',
        ),
        (
            '[services."/x"]\ntype = "a/B"\nreturns = 3',
            '`services."/x".returns`: expected a table or a list of tables, got 3',
        ),
        (
            '[actions."/x"]\ntype = "a/B"\nsucceeds = {}\naborts = {}',
            '`actions."/x"`: expected one of `succeeds` and `aborts`, not both',
        ),
        ('[[faults]]\ndorp = "/x"', "unknown key `faults[0].dorp`; did you mean `drop`?"),
        (
            '[[faults]]\nop = "publish"',
            "`faults[0]`: expected one of `drop`, `delay`, `duplicate`, `refuse` and `slow_reader`",
        ),
        ('[[faults]]\ndelay = "/x"', "`faults[0]`: expected `delay` and `seconds` together"),
        (
            '[[faults]]\ndrop = "/x"\nto = "me"',
            '`faults[0].to`: expected "client" or "server" or "both", got \'me\'',
        ),
        (
            "[[faults]]\nrefuse = 200",
            "`faults[0].refuse`: expected a whole number of at least 400 and at most 599, got 200",
        ),
    ],
)
def test_the_key_and_what_instead(tmp_path: Path, text: str, said: str) -> None:
    assert complaint(tmp_path, text) == said


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    assert complaint(tmp_path, "name = ").startswith("not TOML: ")
    assert complaint(tmp_path, "name = " + "[" * 100_000).startswith("tables or lists are nested")
    with pytest.raises(ScriptError, match=r"nowhere\.toml: No such file"):
        read_script(tmp_path / "nowhere.toml")
    (tmp_path / "bytes.toml").write_bytes(b"name = '\xff'")
    with pytest.raises(ScriptError, match="not UTF-8 at byte 8"):
        read_script(tmp_path / "bytes.toml")


def test_recorded_messages_name_the_line(tmp_path: Path) -> None:
    file = tmp_path / "drive.jsonl"
    file.write_text('{"at": 0, "msg": {"data": [1]}}\n\n{"at": 1.5, "msg": {}}\n')
    assert [each.at for each in read_recorded(file)] == [0.0, 1.5]
    for line, said in {
        "nonsense": "not JSON",
        "[]": "expected a table",
        '{"at": -1, "msg": {}}': "`at`: expected a number of at least 0 and at most 1000000000, got -1",
        '{"at": 1, "message": {}}': "unknown key `message`; did you mean",
    }.items():
        file.write_text('{"at": 0, "msg": {}}\n' + line)
        with pytest.raises(ScriptError) as raised:
            read_recorded(file)
        assert str(raised.value).startswith(f"{file}:2: ") and said in str(raised.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[topics."/x"]\ntype = "std_msgs/Strin"', r'`topics."/x"`: .*std_msgs/String'),
        (
            '[topics."/x"]\ntype = "std_msgs/Int32"\nrate = 1\nmessages = [{data = 1}, {data = "1"}]',
            r'`topics."/x".messages\[1\]`: /x \(std_msgs/Int32\): data: expected int32, got "1"',
        ),
        ('[topics."/x y"]\ntype = "std_msgs/Int32"', r'`topics."/x y"`: '),
        (
            '[services."/x"]\ntype = "std_srvs/SetBool"\nreturns = {sucess = true}',
            r'`services."/x"`: /x \(std_srvs/SetBool_Response\): .*sucess',
        ),
        (
            '[services."/x"]\ntype = "std_srvs/SetBool"\nwhen = [{request = {dat = 1}, fails = "no"}]',
            r'`services."/x".when\[0\]`: no message here has a field `dat`; did you mean `data`',
        ),
        (
            '[actions."/x"]\ntype = "example_interfaces/Fibonacci"\nfeedback = [{sequence = "x"}]',
            r'`actions."/x"`: .*sequence',
        ),
        ('name = "a b"', "`name`: "),
        ('[parameters]\n"arm.start" = 2024-05-01', '`parameters."arm.start"`: '),
        ('[parameters]\nmixed = [1, "a"]', "`parameters.mixed`: "),
        ("[parameters.table]\ninner = 1", "`parameters.table`: "),
        (
            '[topics."/x"]\ntype = "std_msgs/String"\nlatched = {data = 2024-05-01}',
            r'`topics."/x"`: .*data: expected string',
        ),
        ('[topics."/x"]\ntype = "std_msgs/Int32"\nfile = "nowhere.jsonl"', "nowhere.jsonl: No such file"),
    ],
)
def test_what_the_types_say(tmp_path: Path, graph: ObservedGraph, text: str, said: str) -> None:
    file = tmp_path / "robot.toml"
    file.write_text(text)
    nodes = {node.name for node in graph.nodes()}
    with pytest.raises(ScriptError, match=said):
        ScriptControl(graph, ObservedWire(graph), file)
    assert {node.name for node in graph.nodes()} == nodes, "nothing is left of it"


VALUES = st.recursive(
    st.one_of(st.booleans(), st.integers(-5, 5), st.floats(allow_nan=False), st.text('ab/"\n ü', max_size=5)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.dictionaries(
            st.sampled_from([*Script.model_fields, "type", "messages", "when", "request", "rate", "x"]),
            inner,
            max_size=4,
        ),
    ),
    max_leaves=12,
)


@given(st.dictionaries(st.sampled_from(list(Script.model_fields)), VALUES, max_size=3))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=200)
def test_any_file_is_read_or_refused_in_words(tmp_path: Path, values: dict[str, object]) -> None:
    file = tmp_path / "robot.toml"
    file.write_text("\n".join(f"{key} = {_toml(value)}" for key, value in values.items()), encoding="utf-8")
    try:
        read_script(file)
    except ScriptError as error:
        assert str(error).startswith(f"{file}: ")
        assert "`" in str(error) or "not TOML" in str(error)


@given(
    st.lists(
        st.one_of(
            st.text('{}[]":,at msg01\\ü', max_size=30),
            st.builds(lambda at, msg: json.dumps({"at": at, "msg": msg}), VALUES, VALUES),
        ),
        max_size=5,
    )
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=200)
def test_any_recorded_file_is_read_or_refused_with_its_line(tmp_path: Path, lines: list[str]) -> None:
    file = tmp_path / "any.jsonl"
    file.write_text("\n".join(lines), encoding="utf-8")
    try:
        recorded = read_recorded(file)
    except ScriptError as error:
        number = int(str(error).removeprefix(f"{file}:").partition(":")[0])
        assert 1 <= number <= len(lines)
    else:
        assert len(recorded) == len([line for line in lines if line.strip()])
        assert all(each.at >= 0 for each in recorded)


def _toml(value: object) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_toml(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, bool | float | int):
        return str(value).lower()
    return '"' + "".join(f"\\U{ord(letter):08x}" for letter in str(value)) + '"'
