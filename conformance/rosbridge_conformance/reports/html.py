"""Self-contained page of a run: a matrix, and the frames of every case that did not pass."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

from rosbridge_conformance import SUITE_VERSION
from rosbridge_conformance.reports.counts import MARKS, by_section, conformance, grade, robustness
from rosbridge_conformance.runner import VERDICTS, Result, Run
from rosbridge_conformance.suite.rules import Rule

_STYLE = """
:root{color-scheme:light dark;--pass:#2c7a3f;--non-strict:#8a7a10;--informational:#3b6ea5;
--unimplemented:#777;--fail:#b03a2e}
body{font:15px/1.45 system-ui,sans-serif;max-width:76rem;margin:2rem auto;padding:0 1rem}
table{border-collapse:collapse}td,th{padding:.15rem .6rem;text-align:left;border-bottom:1px solid #8884}
.cells{display:flex;flex-wrap:wrap;gap:2px}
.cells a{width:1.15rem;height:1.15rem;border-radius:3px;color:#fff;text-decoration:none;font-size:.7rem;
display:grid;place-items:center}
.pass{background:var(--pass)}.non-strict{background:var(--non-strict)}.fail{background:var(--fail)}
.informational{background:var(--informational)}.unimplemented{background:var(--unimplemented)}
details{border-bottom:1px solid #8884;padding:.3rem 0}summary{cursor:pointer}
summary b{display:inline-block;min-width:7.5rem;color:#fff;border-radius:3px;text-align:center;
font-size:.8rem}
pre{overflow-x:auto;font-size:12px;background:#8881;padding:.6rem;margin:.4rem 0}
.way-out{color:#3b6ea5}.way-in{color:var(--pass)}.rule{color:#777;font-size:.9rem}
@media print{details{break-inside:avoid}}
"""

_SCRIPT = """
function show(){const p=location.hash.slice(1);const d=p&&document.getElementById(p);if(d)d.open=true}
addEventListener('hashchange',show);show();
document.getElementById('only').onchange=e=>document.querySelectorAll('details').forEach(
d=>d.hidden=e.target.checked&&d.dataset.verdict!=='fail');
"""


def render(run: Run, rules: Mapping[str, Rule]) -> str:
    """Return the whole page."""
    title = f"rosbridge conformance: {escape(run.target.name)}"
    cases = "\n".join(_case(result, rules) for result in run.results)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{title}</title><style>{_STYLE}</style></head><body>
<h1>{title}</h1>
<p>Grade <strong>{grade(run)}</strong>. {len(run.results)} cases of suite {SUITE_VERSION} against
<code>{escape(run.url)}</code> in {run.seconds:.1f} s.
Conformance: {conformance(run).words or "nothing asked"}.
Robustness: {robustness(run).words or "nothing asked"}.</p>
<p>{
        " ".join(
            f'<span class="{name}" style="color:#fff;padding:0 .4rem">{MARKS[name]} {name}</span>'
            for name in VERDICTS
        )
    }</p>
{_stale(run)}
<table><tr><th>section</th><th>cases</th><th>passed</th></tr>
{_matrix(run)}</table>
<h2>Cases</h2><p><label><input type="checkbox" id="only"> failures only</label></p>
{cases}
<script>{_SCRIPT}</script></body></html>
"""


def _stale(run: Run) -> str:
    if not run.stale:
        return ""
    items = "".join(f"<li><code>{escape(key)}</code></li>" for key in run.stale)
    return f"<p>Stale expectations, which no longer fail:</p><ul>{items}</ul>"


def _matrix(run: Run) -> str:
    rows = []
    for row in by_section(run):
        cells = "".join(_cell(result) for result in run.results if result.case.section == row.name)
        rows.append(
            f'<tr><td>{row.name}</td><td><div class="cells">{cells}</div></td>'
            f"<td>{row.passed}/{row.asked}</td></tr>"
        )
    return "\n".join(rows)


def _cell(result: Result) -> str:
    case = result.case
    label = escape(f"{case.id}: {result.verdict}", quote=True)
    return f'<a class="{result.verdict}" href="#{case.id}" title="{label}">{MARKS[result.verdict]}</a>'


def _case(result: Result, rules: Mapping[str, Rule]) -> str:
    case = result.case
    said = "".join(
        f'<p class="rule">{rule} ({escape(rules[rule].levels)}): {escape(rules[rule].text)}</p>'
        for rule in case.rules
    )
    texts = ", ".join(f"{text} §{section}" for text, section in case.spec.items())
    about = f"<p>{escape(case.about)}</p>" if case.about else ""
    diverging = "".join(
        f"<p>Known: {escape(item.server)} {escape(item.does)}</p>" for item in case.divergences
    )
    return f"""<details id="{case.id}" data-verdict="{result.verdict}">
<summary><b class="{result.verdict}">{result.verdict}</b>
<code>{case.id}</code> {escape(case.title)}</summary>
{about}{said}<p class="rule">{case.level}, {case.profile}{", " + escape(texts) if texts else ""},
{result.seconds * 1000:.0f} ms</p>{diverging}{_outcome(result)}{_frames(result)}</details>"""


def _outcome(result: Result) -> str:
    parts = [f"<p>not strict: {escape(remark)}</p>" for remark in result.remarks]
    if result.missing:
        parts.append(f"<p>not declared: {escape(', '.join(result.missing))}</p>")
    if result.expected:
        parts.append(f"<p>expected: {escape(result.expected)}</p>")
    if result.fault is not None:
        fault, different = result.fault, result.fault.difference
        where = f" at <code>{escape(different.path)}</code>" if different.path else ""
        parts.append(
            f"<p>Step {fault.step}, {escape(fault.doing)}{where}</p>"
            f"<pre>expected {escape(different.expected)}\ngot      {escape(different.got)}</pre>"
        )
    return "".join(parts)


def _frames(result: Result) -> str:
    if not result.transcript or result.verdict == "pass":
        return ""
    kinds = {">": "way-out", "<": "way-in", "!": ""}
    lines = "\n".join(
        f'<span class="{kinds[line.way]}">{line.at * 1000:9.1f} ms  {line.client} {escape(line.way)} '
        f"{escape(line.text)}</span>"
        for line in result.transcript
    )
    return f"<pre>{lines}</pre>"
