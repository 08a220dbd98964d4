"""``moon check`` on the command line: what it prints and writes, and how it ends."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as Tree

import click
import msgspec
import pytest
from click.testing import CliRunner

from m2c.json_lines import versioned_line
from moon.cli import main
from moon.offline.command import check
from moon.offline.output import times
from moon.verdict import Verdict
from tests.offline.live import EXAMPLE, faulty_program, live_run, program

SYSTEM = str(EXAMPLE / "system.xml")
PROPERTIES = str(EXAMPLE / "properties.yaml")
PAGE = (Path(__file__).parents[2] / "docs" / "commands" / "moon-check.md").read_text()


class Runs:
    """A nominal run and one with a fault, and what was said of them live."""

    def __init__(self, folder: Path) -> None:
        self.good, self.bad = folder / "good.mcap", folder / "bad.mcap"
        self.said_of_good = live_run(self.good, program(), 1, 4.0)
        self.said_of_bad = live_run(self.bad, faulty_program("T3"), 1, 8.0)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    return Runs(tmp_path_factory.mktemp("runs"))


def run(*arguments: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(main, ["check", *arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit)
    return result.exit_code, result.stdout, result.stderr


def test_a_good_run_ends_with_0_and_a_bad_one_with_1_and_says_why(runs: Runs) -> None:
    code, out, _ = run(str(runs.good), SYSTEM, "--properties", PROPERTIES)
    assert code == 0
    assert "\n0 violations in 4.0 s; 18 machines: " in out
    code, out, _ = run(str(runs.bad), SYSTEM, "--properties", PROPERTIES)
    assert code == 1
    assert "BatteryLevelSkill  VIOLATED\n    expected  response on /BatteryLevelSkill/tick" in out


def test_the_log_is_the_one_that_the_monitor_wrote(runs: Runs, tmp_path: Path) -> None:
    log = tmp_path / "verdicts.jsonl"
    run(str(runs.bad), SYSTEM, "--properties", PROPERTIES, "--log", str(log))
    live = b"".join(versioned_line(verdict) + b"\n" for verdict in runs.said_of_bad)
    assert log.read_bytes() == live


def test_json_is_the_recording_its_verdicts_and_the_summary(runs: Runs) -> None:
    _, out, _ = run(str(runs.bad), SYSTEM, "--properties", PROPERTIES, "--json")
    events = [json.loads(line) for line in out.splitlines()]
    assert [events[0]["event"], events[-1]["event"]] == ["recording", "summary"]
    assert events[0]["complete"] is True
    assert events[0]["path"] == str(runs.bad)
    verdicts = [msgspec.convert(event, Verdict) for event in events[1:-1]]
    assert verdicts == runs.said_of_bad


def test_several_recordings_are_checked_side_by_side_and_reported_in_order(
    runs: Runs, tmp_path: Path
) -> None:
    junit = tmp_path / "junit.xml"
    done = subprocess.run(
        [
            *(sys.executable, "-m", "moon.cli", "check"),
            *(str(runs.bad), str(runs.good), str(tmp_path / "none.mcap"), SYSTEM),
            *("--jobs", "2", "--junit", str(junit)),
        ],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 2
    (error,) = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert "none.mcap: cannot be read: No such file or directory" in error
    assert done.stdout.index(f"{runs.bad}: moon recording") < done.stdout.index(
        f"{runs.good}: moon recording"
    )
    bad, good, none = Tree.parse(junit).getroot()
    failed = {case.get("name") for case in bad if case.find("failure") is not None}
    assert "BatteryLevelSkill" in failed
    assert bad.get("failures") == str(len(failed))
    assert "expected" in (bad.findtext("./testcase/failure") or "")
    assert good.get("failures") == "0"
    assert none.get("errors") == "1"


def test_the_readable_part_of_a_cut_off_recording_is_checked_and_marked(
    runs: Runs, tmp_path: Path
) -> None:
    whole = runs.bad.read_bytes()
    for part in (0.4, 0.6):
        cut = tmp_path / f"cut{part}.mcap"
        cut.write_bytes(whole[: int(len(whole) * part)])
        code, out, _ = run(str(cut), SYSTEM)
        assert code in (0, 1)
        assert "not all of the recording could be read" in out
        assert f"{cut}: byte " in out
        _, out, _ = run(str(cut), SYSTEM, "--json")
        assert json.loads(out.splitlines()[0])["complete"] is False


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("empty.mcap", b"", "is empty"),
        ("text.mcap", b"hello", "is no recording"),
        ("noise.mcap", bytes(range(256)), "is no recording"),
        ("head.mcap", b"\x89MCAP0\r\n", ""),
    ],
)
def test_what_is_no_recording_is_one_clear_error(
    name: str, content: bytes, why: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    code, out, err = run(str(path), SYSTEM)
    assert code == 2
    assert out == ""
    (line,) = err.splitlines()
    assert line.startswith(f"error: {path}: ")
    assert why in line


def test_models_alone_are_not_enough_and_neither_are_recordings(runs: Runs) -> None:
    assert "Missing argument 'RUN'" in run(SYSTEM)[2]
    code, _, err = run(str(runs.good))
    assert code == 2
    assert "Missing argument 'MODEL...|SYSTEM' (or --properties FILE)" in err


def test_properties_alone_can_be_checked(runs: Runs) -> None:
    code, out, _ = run(str(runs.good), "--properties", PROPERTIES)
    assert code == 0
    assert "6 properties: 6 conforming" in out


def test_the_page_names_every_option_and_no_other() -> None:
    options = {
        name for item in check.params if isinstance(item, click.Option) for name in item.opts
    }
    for name in options:
        assert re.search(rf"^\| `{name}\b", PAGE, re.MULTILINE), name
    assert set(re.findall(r"`(--[a-z-]+)", PAGE)) <= options | {"--help", "--record"}


def test_help_imports_nothing_heavy() -> None:
    script = (
        "import sys\n"
        "from click.testing import CliRunner\n"
        "from moon.cli import main\n"
        "for command in ('check', 'record'):\n"
        "    result = CliRunner().invoke(main, [command, '--help'])\n"
        "    assert result.exit_code == 0 and '  moon ' in result.output\n"
        "assert not {'zenoh', 'rich', 'msgspec', 'mcap', 'rosbags'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)


STRICT = """\
ports:
  level: {topic: /BatteryComponent/level, field: data}
  never: {topic: /never, type: std_msgs/msg/Int32, field: data}
properties:
  - {id: known, pattern: universality, of: level > 0}
  - {id: open, pattern: universality, of: never > 0}
"""


def test_with_strict_what_is_inconclusive_in_the_end_is_exit_code_1_and_named(
    runs: Runs, tmp_path: Path
) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(STRICT)
    code, out, err = run(str(runs.good), "--properties", str(path))
    assert (code, "strict" in err) == (0, False)
    code, strictly, err = run(str(runs.good), "--properties", str(path), "--strict")
    assert code == 1
    assert strictly.splitlines()[:-1] == out.splitlines()[:-1]
    assert err == f"strict: {runs.good}: not known to conform: open (unseen)\n"
    path.write_text(STRICT.replace("  - {id: open, pattern: universality, of: never > 0}\n", ""))
    code, _, err = run(str(runs.good), "--properties", str(path), "--strict")
    assert (code, err) == (0, "")


@pytest.mark.parametrize(
    ("ratio", "said"),
    [(0.46, "0.5"), (1.0, "1.0"), (9.94, "9.9"), (9.96, "10"), (19.8, "20"), (12345.6, "12,346")],
)
def test_how_fast_it_was_is_told_of_a_slow_check_too(ratio: float, said: str) -> None:
    assert times(ratio) == said
