"""Settings: file, environment and command line in that order, and `rwt config show`."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt.access.settings import SettingsError
from rwt.cli import main
from rwt.cli.commands.config import show
from rwt.extensions.demo.part import DemoSettings
from rwt.settings.errors import known_settings
from rwt.settings.models import Settings, with_all_tables
from rwt.settings.sources import Given, line_of, load_settings, read_settings
from rwt_protocol.error_text import annotation_of, expected

TOKEN = "a-token-of-some-length"

_LISTED = (
    (Path(__file__).parent / "transcripts/invalid_settings.txt")
    .read_text(encoding="utf-8")
    .partition("\n\n")[2]
)
INVALID = re.findall(r"(.+?)\n! ([^\n]+)\n+", _LISTED, re.DOTALL)
"""Contents of files with a part of the error about each."""


@pytest.fixture(autouse=True)
def _no_settings_of_the_tester(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RWT_CONFIG", raising=False)


def _file(folder: Path, text: str) -> Path:
    path = folder / "rwt.toml"
    path.write_text(text)
    return path


def test_the_command_line_wins_over_the_environment_and_that_over_the_file(tmp_path: Path) -> None:
    path = _file(tmp_path, "distro = 'noetic'\n[limits]\nconnections = 1\nsubscriptions = 1\ncalls = 1\n")
    environment = {"RWT_LIMITS__SUBSCRIPTIONS": "2", "RWT_LIMITS__CALLS": "2", "HOME": "/"}
    loaded = load_settings(path, environment, (Given(("limits", "calls"), 3, "command line"),))
    limits = loaded.settings.limits
    assert (limits.connections, limits.subscriptions, limits.calls) == (1, 2, 3)
    assert loaded.settings.distro == "noetic"
    sources = [
        loaded.source(("limits", name)) for name in ("connections", "subscriptions", "calls", "max_depth")
    ]
    assert sources == [str(path), "RWT_LIMITS__SUBSCRIPTIONS", "command line", "default"]


def test_the_environment_may_name_the_file(tmp_path: Path) -> None:
    path = _file(tmp_path, "demo = true")
    assert load_settings(environment={"RWT_CONFIG": str(path)}).settings.of(DemoSettings).demo
    other = tmp_path / "other.toml"
    other.write_text("demo = false")
    assert not load_settings(other, {"RWT_CONFIG": str(path)}).settings.of(DemoSettings).demo


@pytest.mark.parametrize("text", ["ws://a:1,ws://b:2", "ws://a:1, ws://b:2", '["ws://a:1", "ws://b:2"]'])
def test_a_list_in_the_environment(text: str) -> None:
    assert load_settings(environment={"RWT_LISTEN": text}).settings.listen == ("ws://a:1", "ws://b:2")


def test_named_entries_from_the_environment() -> None:
    settings = load_settings(
        environment={
            "RWT_ROLES__GUEST__SUBSCRIBE": "/odom,/scan",
            "RWT_AUTH__TOKENS__PHONE__TOKEN": TOKEN,
            "RWT_AUTH__TOKENS__PHONE__ROLE": "guest",
        }
    ).settings
    assert settings.roles["guest"].subscribe == ("/odom", "/scan")
    assert settings.auth.tokens["phone"].role == "guest"


def test_a_role_may_be_an_empty_table(tmp_path: Path) -> None:
    assert read_settings(_file(tmp_path, "[roles.nobody]")).roles["nobody"].subscribe == ()


@pytest.mark.parametrize(("text", "expected_text"), INVALID, ids=[said for _, said in INVALID])
def test_loosely_typed_and_malformed_values_are_rejected(
    tmp_path: Path, text: str, expected_text: str
) -> None:
    path = _file(tmp_path, text)
    with pytest.raises(SettingsError) as refused:
        read_settings(path)
    said = str(refused.value)
    assert re.match(rf"{re.escape(str(path))}(:\d+)?[:,] ", said)
    assert expected_text in said
    assert "\n" not in said and "pydantic" not in said


def test_both_places_of_a_token_are_named(tmp_path: Path) -> None:
    token = f"token = '{TOKEN}'\nrole = 'viewer'\n"
    with pytest.raises(SettingsError, match=r"rwt.toml:6, .*rwt.toml:1: "):
        read_settings(_file(tmp_path, f"[auth.tokens.a]\n{token}\n# again\n[auth.tokens.b]\n{token}"))


def test_names_of_hosts_and_origins() -> None:
    hosts = ("robot", "*.example.com", "*", "192.0.2.7", "2001:db8::1", "robot-?.local")
    origins = ("https://a.example", "https://*.a.example", "http://[::1]:8080", "*", "null", "http://a:*")
    allow = (*origins, "*://a", "app://x")
    found = Settings(origins={"hosts": hosts, "allow": allow}).origins
    assert (found.hosts, found.allow) == (hosts, allow)


@pytest.mark.parametrize(("text", "demo"), [("true", True), ("0", False), ("False", False), ("1", True)])
def test_text_stands_for_booleans_and_numbers_in_the_environment(text: str, demo: bool) -> None:
    settings = load_settings(environment={"RWT_DEMO": text, "RWT_LIMITS__CALLS": "7"}).settings
    assert (settings.of(DemoSettings).demo, settings.limits.calls) == (demo, 7)
    with pytest.raises(SettingsError, match="RWT_DEMO: `demo`: expected true or false, got 'yes'"):
        load_settings(environment={"RWT_DEMO": "yes"})


def test_the_line_of_a_setting(tmp_path: Path) -> None:
    path = _file(
        tmp_path, 'demo = true\n\n[a]\nlist = [\n  1,\n  2,\n]\ntext = """\n[b]\n"""\n[b]\nc.d = 1\n'
    )
    keys = [("demo",), ("a",), ("a", "list"), ("a", "text"), ("b",), ("b", "c", "d"), ("b", "x")]
    assert [line_of(path, key) for key in keys] == [1, 3, 4, 8, 11, 12, None]


@pytest.mark.parametrize(
    ("environment", "expected_text"),
    [
        ({"RWT_DISTOR": "jazzy"}, "RWT_DISTOR: unknown setting `distor`; did you mean `distro`?"),
        ({"RWT_LIMITS__CALLS": "many"}, "RWT_LIMITS__CALLS: `limits.calls`: expected a whole number"),
        ({"RWT_LISTEN": "[1"}, "RWT_LISTEN: `listen`: not a list as TOML writes it"),
        ({"RWT_TLS__CERTFILE": "a.pem"}, "RWT_TLS__CERTFILE: `tls`: expected `certfile` and `keyfile`"),
    ],
)
def test_a_wrong_variable_is_named(environment: dict[str, str], expected_text: str) -> None:
    with pytest.raises(SettingsError) as refused:
        load_settings(environment=environment)
    assert expected_text in str(refused.value)


@pytest.mark.parametrize(
    "text",
    [
        "[auth.tokens.a]\ntoken = 'Short-Secret'\nrole = 'admin'",
        "[auth.tokens.a]\nsha256 = 'Short-Secret'\nrole = 'admin'",
        "[auth.tokens]\na = 'Short-Secret'",
        "[auth.tokens.a]\ntoken = ['Short-Secret']\nrole = 'admin'",
        "[auth]\ntokens = 'Short-Secret'",
    ],
)
def test_a_wrong_token_is_not_quoted(tmp_path: Path, text: str) -> None:
    with pytest.raises(SettingsError) as refused:
        read_settings(_file(tmp_path, text))
    assert "Short-Secret" not in str(refused.value)
    assert "auth.tokens" in str(refused.value)


def test_show_says_where_each_value_came_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = _file(tmp_path, "distro = 'noetic'")
    monkeypatch.setenv("RWT_LIMITS__CONNECTIONS", "7")
    assert main(["config", "show", "--config", str(path), "--set", "limits.calls=8"]) == 0
    lines = capsys.readouterr().out.splitlines()
    found = {line.split(" = ")[0]: line for line in lines if " = " in line}
    assert found["distro"].startswith('distro = "noetic"') and found["distro"].endswith(f"# {path}")
    assert found["connections"].endswith("# RWT_LIMITS__CONNECTIONS")
    assert found["calls"].endswith("# --set limits.calls")
    assert found["demo"].endswith("# default")
    assert "# certfile is not set" in lines


def test_show_masks_secrets(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = _file(
        tmp_path,
        f"[auth.tokens.a]\ntoken = '{TOKEN}'\nrole = 'admin'\n"
        f"[auth.tokens.b]\nsha256 = '{'ab' * 32}'\nrole = 'viewer'\n",
    )
    assert main(["config", "show", "--config", str(path)]) == 0
    said = capsys.readouterr().out
    assert TOKEN not in said
    assert "abab" not in said
    assert said.count('"**********"') == 2


@given(
    st.fixed_dictionaries(
        {},
        optional={
            "interfaces": st.lists(
                st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1)
            ),
            "default_call_service_timeout": st.floats(0, 1e9),
            "demo": st.booleans(),
            "roles": st.dictionaries(
                st.text(st.characters(codec="utf-8")),
                st.fixed_dictionaries({"publish": st.lists(st.text(st.characters(codec="utf-8")))}),
            ),
        },
    )
)
def test_what_show_prints_reads_back_as_the_same_settings(values: dict[str, object]) -> None:
    settings = Settings(**values)
    printed = "\n".join(
        show(load_settings(command_line=tuple(Given((k,), v, "test") for k, v in values.items())))
    )
    assert Settings(**tomllib.loads(printed)) == with_all_tables(settings)


def test_every_setting_says_what_it_is_and_what_it_takes() -> None:
    for key, field in known_settings():
        assert field.description, key
        assert expected(annotation_of(field)), key
