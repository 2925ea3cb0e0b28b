"""Errors of settings name what has set the value, whatever it is."""

from __future__ import annotations

from pathlib import Path

import pytest

from rwt import SettingsError, load_settings

FILE = """\
[auth.tokens.tablet]
token = "0123456789abcdef"
role = "viewer"

[auth.tokens.kiosk]
token = "fedcba9876543210"
"""


def error_of(tmp_path: Path, text: str, environment: dict[str, str]) -> str:
    file = tmp_path / "rwt.toml"
    file.write_text(text)
    with pytest.raises(SettingsError) as error:
        load_settings(file, environment)
    return str(error.value).replace(f"{file}:", "line ")


def test_a_table_that_a_variable_creates_is_named_by_the_variable(tmp_path: Path) -> None:
    variable = "RWT_AUTH__TOKENS__OPERATOR__TOKEN"
    text = error_of(tmp_path, FILE.partition("\n\n")[0], {variable: "abcdefabcdefabcd"})
    assert text.startswith(f"{variable}: `auth.tokens.operator.role`: expected a string")
    assert "abcdef" not in text


def test_a_table_of_the_file_is_named_by_its_line(tmp_path: Path) -> None:
    assert error_of(tmp_path, FILE, {}).startswith("line 5: `auth.tokens.kiosk.role`: expected a string")


def test_a_wrong_value_of_a_variable_is_named_by_it(tmp_path: Path) -> None:
    text = error_of(tmp_path, "", {"RWT_LIMITS__CONNECTIONS": "many"})
    assert text.startswith("RWT_LIMITS__CONNECTIONS: `limits.connections`: expected")
