"""The definitions for the public forge are what it takes, and run what is there."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
FORMS = [
    form for form in sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml")) if form.stem != "config"
]


def commands(workflow: Path) -> list[str]:
    """Every line that a workflow runs."""
    jobs = yaml.safe_load(workflow.read_text(encoding="utf-8"))["jobs"].values()
    return [
        line for job in jobs for step in job.get("steps", ()) for line in step.get("run", "").splitlines()
    ]


def lint(schema: str, *files: Path) -> None:
    """Hold files against a schema of the forge."""
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", schema, *map(str, files)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_workflows_are_workflows() -> None:
    lint("vendor.github-workflows", *WORKFLOWS)


def test_a_mistake_in_a_workflow_is_found(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.yml"
    wrong.write_text(WORKFLOWS[0].read_text(encoding="utf-8").replace("runs-on", "run-on"))
    with pytest.raises(AssertionError):
        lint("vendor.github-workflows", wrong)


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.stem)
def test_forms_have_what_the_forge_asks_for(form: Path) -> None:
    content = yaml.safe_load(form.read_text(encoding="utf-8"))
    assert {"name", "description", "body"} <= set(content)
    kinds = {"textarea", "input", "checkboxes"}
    assert all(part["type"] in kinds and part["attributes"]["label"] for part in content["body"])


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda workflow: workflow.stem)
def test_workflows_run_what_is_there(workflow: Path) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for line in commands(workflow):
        for target in re.findall(r"\bmake (\w+)", line):
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), f"there is no target {target}"
        for path in re.findall(r"(?:^|\s)((?:tests|\.ci)/[\w/]+)", line):
            assert (ROOT / path).exists(), f"there is no {path}"
        for module in re.findall(r"python -m (tools\.\w+)", line):
            assert (ROOT / module.replace(".", "/")).with_suffix(".py").exists(), f"there is no {module}"


def test_every_job_ends_by_itself() -> None:
    for workflow in WORKFLOWS:
        for name, job in yaml.safe_load(workflow.read_text(encoding="utf-8"))["jobs"].items():
            if "uses" in job:
                assert (ROOT / job["uses"]).is_file(), f"{workflow.name}: {name}"  # whose jobs have limits
                continue
            assert "timeout-minutes" in job or job.get("environment") == "release", f"{workflow.name}: {name}"
