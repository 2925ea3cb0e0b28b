"""Badge for a page: the grade, and the number of passed cases."""

from __future__ import annotations

from collections.abc import Mapping

from rosbridge_conformance.reports.counts import conformance, grade
from rosbridge_conformance.runner import Run
from rosbridge_conformance.suite.rules import Rule

_COLOURS = {"A+": "#2c7a3f", "A": "#2c7a3f", "B": "#7a8a1c", "C": "#b7791f", "D": "#b03a2e", "none": "#777"}


def render(run: Run, rules: Mapping[str, Rule]) -> str:
    """Return an SVG image, 20 pixels high."""
    row, mark = conformance(run), grade(run)
    left, right = "rosbridge v2", f"{mark}  {row.passed}/{row.asked}"
    first, second = 7 * len(left) + 10, 7 * len(right) + 10
    return f"""\
<svg xmlns="http://www.w3.org/2000/svg" width="{first + second}" height="20" role="img">
<title>{left}: {right}</title>
<rect width="{first}" height="20" fill="#444"/>
<rect x="{first}" width="{second}" height="20" fill="{_COLOURS[mark]}"/>
<g fill="#fff" font-family="Verdana,DejaVu Sans,sans-serif" font-size="11" text-anchor="middle">
<text x="{first / 2}" y="14">{left}</text><text x="{first + second / 2}" y="14">{right}</text>
</g></svg>
"""
