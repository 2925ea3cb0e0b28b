"""Put each fault that the dashboard once had back into a copy of it, and see whether its test finds it.

    make page-mutants
    make page-mutants ARGS='stop lease'

Prints a table, and ends with 1 if a test passes with the fault, or fails without it. Needs the built page. It
takes about half an hour; the environment variable BROWSER chooses the browser, as for the tests.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.processes import ROOT

PATIENCE: Final = "15.0"
"""Seconds that a test waits for a page which a fault keeps from what is waited for."""
LEFT_OUT: Final = shutil.ignore_patterns("node_modules", "__pycache__", "screenshots", ".*")


@dataclass(frozen=True, slots=True)
class Mutant:
    """One fault.

    Attributes:
        name: one word.
        fault: what was wrong.
        file: below ``web/``.
        fixed, faulty: text of the file, and what takes its place.
        test: below ``tests/browser``, with its name.
    """

    name: str
    fault: str
    file: str
    fixed: str
    faulty: str
    test: str


MUTANTS: Final = (
    Mutant(
        "latch",
        "commands are sent while the page is stopped",
        "src/robot/commands.ts",
        'if (this.stopped.value) return "stopped";',
        "",
        "test_safety.py::test_while_stopped_no_control_of_any_panel_sends_a_command",
    ),
    Mutant(
        "viewer",
        "controls of a role that may not command send commands",
        "src/robot/commands.ts",
        '? null : "role";',
        "? null : null;",
        "test_safety.py::test_a_viewer_sends_no_command_by_any_control",
    ),
    Mutant(
        "press",
        "a second press on STOP releases it",
        "src/app/shell.tsx",
        "onClick={() => stop.stop()}",
        "onClick={() => (stopped ? stop.release() : stop.stop())}",
        "test_safety.py::test_only_holding_another_control_releases_the_stop",
    ),
    Mutant(
        "hold",
        "a click releases the stop",
        "src/forms/release.tsx",
        "holding.value = true;",
        "holding.value = true; onRelease();",
        "test_safety.py::test_only_holding_another_control_releases_the_stop",
    ),
    Mutant(
        "escape",
        "Escape does not stop from a menu or a tool",
        "src/app/shell.tsx",
        'addEventListener("keydown", key, { capture: true });\n    return',
        'addEventListener("keydown", key);\n    return',
        "test_safety.py::test_escape_stops_from_every_focus",
    ),
    Mutant(
        "lost",
        "a lost connection looks normal",
        "src/app/panel_frame.ts",
        'element.classList.toggle("stale", isStale);',
        "",
        "test_safety.py::test_a_lost_connection_is_seen_and_nothing_drives_by_itself_afterwards",
    ),
    Mutant(
        "driver",
        "the driver is an identifier",
        "src/robot/gate.ts",
        "return `${user || role}${device && ` (${device})`}`;",
        'return "rosbridge:5";',
        "test_gate.py::test_who_drives_is_seen_and_the_stop_holds_for_everybody",
    ),
    Mutant(
        "lease",
        "a request for the lease is not shown",
        "src/forms/gate.tsx",
        'class="lease-request"',
        'class="other"',
        "test_gate.py::test_a_lease_is_asked_for_and_handed_over",
    ),
    Mutant(
        "clamped",
        "what the gate clamps is not shown",
        "src/forms/gate.tsx",
        'class="clamped"',
        'class="other"',
        "test_gate.py::test_clamped_values_are_shown_beside_the_stick",
    ),
    Mutant(
        "notices",
        "repeated notices fill the page",
        "src/robot/session.ts",
        "kindOf(each.text) === kind,",
        "each.text === text,",
        "test_safety.py::test_notices_cover_no_control_and_repeats_merge",
    ),
    Mutant(
        "frames",
        "3D is empty without transforms, and says nothing",
        "src/panels/scene/stage.tsx",
        "if (!problems.length && !lost.length) return null;",
        "return null;",
        "test_panels.py::test_without_transforms_the_missing_frames_are_named_and_one_is_offered",
    ),
    Mutant(
        "closed",
        "the page is blank when all panels are closed",
        "src/app/shell.tsx",
        "{session.hasAsked && app.panels.value.length === 0 && <NoPanels app={app} />}",
        "{app.panels.value.length > 99 && <NoPanels app={app} />}",
        "test_safety.py::test_a_page_without_panels_offers_some",
    ),
    Mutant(
        "finite",
        "NaN and infinity are shown as null",
        "src/forms/message_tree.tsx",
        'if (value === null) return t("topics.not_finite");',
        "",
        "test_panels.py::test_integers_of_64_bits_and_numbers_that_are_not_finite",
    ),
    Mutant(
        "digits",
        "integers of 64 bits lose their last digits",
        "src/robot/transport.ts",
        "(rawJSON?.(String(value)) ?? Number(value))",
        "Number(value)",
        "test_panels.py::test_integers_of_64_bits_and_numbers_that_are_not_finite",
    ),
    Mutant(
        "choice",
        "the topics of a plot end at 500",
        "src/panels/view/add_field.tsx",
        '.filter((each) => session.may("subscribe", each)).sort();',
        '.filter((each) => session.may("subscribe", each)).sort().slice(0, 500);',
        "test_data_panels.py::test_a_plot_has_derived_series_and_every_topic_is_found",
    ),
    Mutant(
        "rates",
        "topics that nothing shows have no rate",
        "src/robot/rates.ts",
        "if (this.timer === undefined) this.turn();",
        "",
        "test_panels.py::test_rates_of_topics_that_nothing_shows_are_measured",
    ),
    Mutant(
        "results",
        "a result is only 'sequence [12]'",
        "src/forms/message_tree.tsx",
        "useSignal(depth < 2 && isShort(value))",
        "useSignal(false)",
        "test_panels.py::test_a_goal_is_sent_with_feedback_and_result",
    ),
    Mutant(
        "download",
        "recordings cannot be downloaded",
        "src/panels/health/recorder.tsx",
        '{act(Download, t("recorder.download", { name }), name, (content) => saveAs(content, name))}',
        "",
        "test_panels.py::test_a_recording_is_begun_and_ended_from_the_page",
    ),
    Mutant(
        "warnings",
        "meshes load with warnings",
        "src/scene/layers/meshes.ts",
        'text.replace(Z_UP, "<up_axis>Y_UP</up_axis>")',
        "text",
        "test_panels.py::test_meshes_load_without_warnings",
    ),
    Mutant(
        "axe",
        "a panel takes the focus, and screen readers do not see it",
        "src/app/panel_frame.ts",
        "element.className = `panel panel-${panel.kind}`;",
        'element.className = `panel panel-${panel.kind}`; element.tabIndex = 0; element.ariaHidden = "true";',
        "test_panels.py::test_axe_finds_nothing",
    ),
    Mutant(
        "title",
        "title and header show an address",
        "src/app/state.ts",
        "described.value || (",
        "(",
        "test_panels.py::test_the_robot_s_own_name_is_in_title_and_header",
    ),
    Mutant(
        "react",
        "the elements are unknown in TSX",
        "package/react.d.ts",
        '"rwt-stop": Props<widgets.StopElement>;',
        "",
        "test_widgets_package.py::test_the_elements_are_known_in_tsx",
    ),
    Mutant(
        "keys",
        "keys drive only while a control of Drive has the focus",
        "src/panels/drive/teleop.tsx",
        "followKeys(document, drive,",
        "followKeys(here, drive,",
        "test_panels.py::test_letters_drive_from_anywhere_but_text_fields",
    ),
    Mutant(
        "pulse",
        "the text of a panel that waits fades",
        "src/app/style.css",
        ".waiting::before {",
        ".waiting { animation: pulse 1.4s 5; }\n.waiting::before {",
        "test_panels.py::test_a_panel_that_waits_is_legible_at_every_moment",
    ),
    Mutant(
        "axes",
        "the axes of a plot that begins behind another panel are black",
        "src/panels/view/plot_chart.ts",
        'stroke: () => token("--text-3"),',
        'stroke: token("--text-3"),',
        "test_look.py::test_every_panel_first_opens_as_in_the_documentation[plot-dark]",
    ),
    Mutant(
        "rate",
        "the rate of a frame is that of its arrivals",
        "src/robot/transforms.ts",
        "const told = stamp > 0 ? stamp : now;",
        "const told = now;",
        "test_data_panels.py::test_frames_show_rates_by_stamps_and_the_faults_of_the_tree",
    ),
    Mutant(
        "loop",
        "loops of frames are missing",
        "src/panels/graph/frames_panel.tsx",
        "{[...roots, ...loops.map(([first]) => first as string)].map((root) => (",
        "{[...roots, ...loops.slice(0, 0).map(([first]) => first as string)].map((root) => (",
        "test_data_panels.py::test_frames_show_rates_by_stamps_and_the_faults_of_the_tree",
    ),
    Mutant(
        "lines",
        "the log has no line breaks",
        "src/app/style.css",
        "white-space: pre-wrap;\n}\n.log-entries :is",
        "}\n.log-entries :is",
        "test_data_panels.py::test_the_log_has_milliseconds_lines_and_nodes",
    ),
    Mutant(
        "milliseconds",
        "the log has no milliseconds",
        "src/panels/health/log.tsx",
        "clockText(stamp * 1000, 3)",
        "clockText(stamp * 1000)",
        "test_data_panels.py::test_the_log_has_milliseconds_lines_and_nodes",
    ),
    Mutant(
        "stale",
        "stale diagnostics come before errors",
        "src/panels/health/diagnostics.tsx",
        '["ok", "warn", "stale", "error"]',
        '["ok", "warn", "error", "stale"]',
        "test_data_panels.py::test_diagnostics_that_are_errors_come_before_stale_ones",
    ),
    Mutant(
        "menu",
        "Escape in a menu stops although nothing moves",
        "src/app/shell.tsx",
        "app.mayBeMoving() ||",
        "true ||",
        "test_safety.py::test_escape_only_closes_a_menu_while_nothing_moves",
    ),
    Mutant(
        "moving",
        "Escape in a menu does not stop a goal",
        "src/robot/commands.ts",
        "return this.goals > 0 ||",
        "return",
        "test_safety.py::test_escape_in_a_menu_stops_a_goal",
    ),
    Mutant(
        "bidi",
        "characters of a name turn the text",
        "src/i18n/plain.ts",
        "props.children = plainChildren(props.children);",
        "",
        "test_panels.py::test_characters_that_turn_or_hide_text_are_shown_as_their_codes",
    ),
    Mutant(
        "stalled",
        "driving ends without a word when the page stalls",
        "src/robot/drive.ts",
        "this.stalled.value = this.held.size > 0;",
        "",
        "test_safety.py::test_a_page_that_stalls_says_that_driving_ended",
    ),
    Mutant(
        "large",
        "messages are decoded however large they are",
        "src/decode/bound.ts",
        "if (bytes <= most) return null;",
        "return null;",
        "test_data_panels.py::test_a_topic_with_messages_that_are_too_large_is_shown_on_request",
    ),
)


def copied(folder: Path) -> Path:
    """Copy what the tests need; packages stay where they are."""
    for name in ("src", "tests", "web", "rwt-rclpy", "conformance", "rwt-lerobot"):
        shutil.copytree(ROOT / name, folder / name, ignore=LEFT_OUT)
    for name in ("pyproject.toml", "LICENSE", "NOTICE"):
        shutil.copy(ROOT / name, folder)
    for packages in ROOT.glob("*/**/package-lock.json"):
        place = packages.parent / "node_modules"
        if place.is_dir() and "node_modules" not in packages.parent.parts:
            (folder / place.relative_to(ROOT)).symlink_to(place)
    driver = folder / "tests/browser/driver.py"
    text = driver.read_text()
    assert "PATIENCE = 60.0" in text
    driver.write_text(text.replace("PATIENCE = 60.0", f"PATIENCE = {PATIENCE}"))
    return folder


def passes(test: str, folder: Path) -> bool:
    """Run a test of the copy; returns True if it passes."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", f"tests/browser/{test}"]
    paths = (".", "src", "rwt-rclpy/src", "conformance", "rwt-lerobot/src")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(str(folder / each) for each in paths)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    if done.returncode not in (0, 1) or not (" passed" in done.stdout or " failed" in done.stdout):
        sys.exit(f"{test} did not run:\n{done.stdout}{done.stderr}")
    return done.returncode == 0


def build(folder: Path) -> None:
    """Build the copy's page."""
    subprocess.run(
        ["npm", "run", "--silent", "build"], cwd=folder / "web", check=True, stdout=subprocess.DEVNULL
    )


def main() -> int:
    """Print a row for each fault."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="a fault, by its name; all by default")
    wanted = parser.parse_args().names
    known = {mutant.name: mutant for mutant in MUTANTS}
    if unknown := [name for name in wanted if name not in known]:
        parser.error(f"unknown: {', '.join(unknown)}; known: {', '.join(known)}")
    missed = 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = copied(Path(temporary))
        build(folder)
        chosen = [known[name] for name in wanted or known]
        fine = {test: passes(test, folder) for test in dict.fromkeys(mutant.test for mutant in chosen)}
        for mutant in chosen:
            file = folder / "web" / mutant.file
            text = file.read_text(encoding="utf-8")
            assert text.count(mutant.fixed) >= 1, mutant
            file.write_text(text.replace(mutant.fixed, mutant.faulty), encoding="utf-8")
            build(folder)
            found = fine[mutant.test] and not passes(mutant.test, folder)
            file.write_text(text, encoding="utf-8")
            missed += not found
            said = "found" if found else "MISSED" if fine[mutant.test] else "fails without the fault"
            sys.stdout.write(f"| {mutant.fault} | `{mutant.test}` | {said} |\n")
            sys.stdout.flush()
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
