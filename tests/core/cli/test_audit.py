"""`rwt audit show` and `rwt audit verify`: a client cannot forge what they print."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from contextlib import redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt.access.gate.audit.file import AuditFile, encode
from rwt.access.settings import AuditSettings
from rwt.cli import main

FORGED = (
    "\n2026-01-01T00:00:00.000Z stop stop by rosbridge:9 (role admin, 10.0.0.1): forged\x1b[2J\u2028\u202e"
)


def _written(folder: Path, *lines: Mapping[str, object]) -> Path:
    path = folder / "audit.jsonl"
    audit = AuditFile(AuditSettings(file=path))
    for line in lines:
        audit.write(encode(line))
    audit.close()
    return path


def _shown(path: Path, *options: str) -> str:
    with redirect_stdout(io.StringIO()) as out:
        assert main(("audit", "show", str(path), *options)) == 0
    return out.getvalue()


@pytest.mark.parametrize(
    "field", ["act", "name", "client", "role", "address", "credential", "text", "decision"]
)
def test_a_field_cannot_forge_a_line(tmp_path: Path, field: str) -> None:
    path = _written(tmp_path, {"time": "T", "decision": "stop", "client": "c", field: FORGED})
    for options in ((), ("--json",)):
        shown = _shown(path, *options)
        assert shown.count("\n") == 1
        assert shown.removesuffix("\n").isprintable()


@given(
    st.dictionaries(st.sampled_from(["act", "name", "client", "role", "address", "rule", "text"]), st.text())
)
def test_every_line_is_one_printable_line(fields: dict[str, str]) -> None:
    with TemporaryDirectory() as folder:
        clean = {key: value.encode(errors="replace").decode() for key, value in fields.items()}
        path = _written(Path(folder), {"time": "T", "decision": "refused", **clean})
        shown = _shown(path)
        assert shown.count("\n") == 1
        assert shown.removesuffix("\n").isprintable()
        assert json.loads(_shown(path, "--json")).items() >= clean.items()


def test_a_name_with_spaces_is_quoted(tmp_path: Path) -> None:
    line = {"time": "T", "decision": "stop", "client": "x (role admin, 10.0.0.1): y", "role": "viewer"}
    assert '"x (role admin, 10.0.0.1): y" (role viewer, no address)' in _shown(_written(tmp_path, line))


def test_verify(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = _written(tmp_path, *({"number": number} for number in range(5)))
    assert main(("audit", "verify", str(path))) == 0
    assert capsys.readouterr().out.endswith("5 lines, 0 faults\n")
    assert main(("audit", "verify", str(path), "--hash", "0" * 64)) == 1
    assert "no line has the hash 0000" in capsys.readouterr().out
    path.write_bytes(path.read_bytes().replace(b'"number":1', b'"number":9'))
    assert main(("audit", "verify", str(path))) == 1
    assert f"fault {path}:2: changed" in capsys.readouterr().out
    assert main(("audit", "verify", str(path), "--json")) == 1
    report = json.loads(capsys.readouterr().out)
    assert (report["ok"], report["lines"], report["faults"][0]["line"]) == (False, 5, 2)
    assert main(("audit", "verify", str(tmp_path / "missing"))) == 2
    assert "cannot be read" in capsys.readouterr().err
