"""Formats of a run's report. Each module has `render(run, rules) -> str`."""
