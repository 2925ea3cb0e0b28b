"""What a run can be turned into. Each module has `render(run, rules) -> str`."""
