"""The command line of ``moon monitor``: what it refuses, and how."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from m2c.cli import main as m2c
from moon.cli import main as moon
from moon.explain.command import explain
from moon.feed.counts import Counts
from moon.monitor.command import monitor
from moon.monitor.report import HEADER
from moon.monitor.status import MachineStatus, Summary
from moon.oracle.bounds import Bounds
from moon.sinks.topic import VerdictMessage
from tests.monitor.hand_driven import write_models
from tests.monitor.processes import free_endpoint

SYSTEM = Path(__file__).parents[2] / "examples" / "lab_tour" / "system.xml"
PAGES = Path(__file__).parents[2] / "docs" / "commands"


def said(*arguments: object) -> tuple[int, str]:
    """Exit code and error output."""
    result = CliRunner().invoke(moon, ["monitor", *map(str, arguments)])
    return result.exit_code, " ".join(result.stderr.split())


@pytest.fixture
def broken(tmp_path) -> Path:
    model = write_models(tmp_path)
    model.write_text(model.read_text().replace("_msg.data", "_msg.dta"))
    return model


@pytest.mark.parametrize("command", ["monitor", "explain"])
def test_a_model_with_errors_is_refused_as_m2c_check_refuses_it(broken, command) -> None:
    checked = CliRunner().invoke(m2c, ["check", str(broken)])
    refused = CliRunner().invoke(moon, [command, str(broken)])
    assert refused.exit_code == checked.exit_code == 2
    errors = [line for line in checked.stdout.splitlines() if " error: " in line]
    assert errors
    assert [line for line in refused.stderr.splitlines() if " error: " in line] == errors


def test_a_policy_with_errors_is_refused(tmp_path) -> None:
    write_models(tmp_path)
    (tmp_path / "policy.xml").write_text(
        '<root><BehaviorTree ID="M"><Condition ID="C" name="Nobody"/></BehaviorTree></root>'
    )
    system = tmp_path / "system.xml"
    system.write_text(
        '<roaml><behavior_tree><input type="bt.cpp-xml" src="policy.xml"/></behavior_tree>'
        '<node_models><input type="node-ascxml" src="Level.scxml"/></node_models></roaml>'
    )
    checked = CliRunner().invoke(m2c, ["check", str(system)])
    refused = CliRunner().invoke(moon, ["monitor", str(system)])
    assert checked.exit_code == refused.exit_code == 2
    errors = [line for line in checked.stdout.splitlines() if " error: " in line]
    assert errors == [line for line in refused.stderr.splitlines() if " error: " in line]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "Missing argument 'MODEL...|SYSTEM'"),
        (["/no/such.scxml"], "/no/such.scxml"),
        ([SYSTEM, "--only", "BateryLevelSkill"], "did you mean BatteryLevelSkill?"),
        ([SYSTEM, "--without", "Nobody"], "lab_tour has no node Nobody"),
        ([SYSTEM, "--only", "WaitSkill", "--without", "WaitSkill"], "no node to monitor"),
        ([SYSTEM, "--deadline", "0"], "Invalid value for '--deadline': 0.0 is not in the range"),
        ([SYSTEM, "--deadline", "nan"], "'nan' is no finite number"),
        ([SYSTEM, "--latency-bound", "-1"], "Invalid value for '--latency-bound'"),
        ([SYSTEM, "--clock-skew", "-1"], "Invalid value for '--clock-skew'"),
        ([SYSTEM, "--clock-skew", "nan"], "'nan' is no finite number"),
        ([SYSTEM, "--for", "inf"], "Invalid value for '--for'"),
        ([SYSTEM, "--transport", "telepathy"], "no transport `telepathy` is installed"),
        ([SYSTEM, "--transport", "simulated"], "that world is in one process"),
        ([SYSTEM, "--endpoint", "localhost"], "endpoint 'localhost' is not an endpoint"),
        ([SYSTEM, "--zenoh-config", "/no/such.json5"], "'/no/such.json5' does not exist"),
    ],
)
def test_a_wrong_argument_is_one_clear_error_and_exit_code_2(arguments, message) -> None:
    code, text = said(*arguments)
    assert code == 2
    assert message in text
    assert "Traceback" not in text


@pytest.mark.zenoh
def test_a_log_that_cannot_be_written_is_exit_code_2() -> None:
    from transports.zenoh_link.session import open_session

    endpoint = free_endpoint()
    hub = open_session({"listen": endpoint})
    command = ["monitor", str(SYSTEM), "--endpoint", endpoint, "--log", "/no/such/folder/log"]
    try:
        result = subprocess.run(
            [sys.executable, "-m", "moon.cli", *command],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    finally:
        hub.close()
    assert result.returncode == 2
    assert result.stderr.splitlines() == [
        "error: cannot write verdicts to /no/such/folder/log: No such file or directory"
    ]


def test_help_imports_neither_zenoh_nor_rich() -> None:
    script = (
        "import sys\n"
        "from click.testing import CliRunner\n"
        "from moon.cli import main\n"
        "for command, option in (('monitor', '--deadline'), ('explain', '--json')):\n"
        "    result = CliRunner().invoke(main, [command, '--help'])\n"
        "    assert result.exit_code == 0 and option in result.output\n"
        "assert not {'zenoh', 'rich', 'msgspec'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)


@pytest.mark.parametrize(
    ("command", "page"), [(monitor, "moon-monitor"), (explain, "moon-explain")]
)
def test_the_page_names_every_option_and_no_other(command, page) -> None:
    text = (PAGES / f"{page}.md").read_text()
    options = {
        name for item in command.params if isinstance(item, click.Option) for name in item.opts
    }
    for name in options:
        assert re.search(rf"^\| `{name}\b", text, re.MULTILINE), name
    others = {"--help", "--replace", "--ticks", "--quiet"}
    assert set(re.findall(r"`(--[a-z-]+)", text)) <= options | others


@pytest.mark.parametrize("struct", [MachineStatus, Counts, Summary, VerdictMessage])
def test_the_page_explains_every_key(struct) -> None:
    text = (PAGES / "moon-monitor.md").read_text()
    missing = [f for f in struct.__struct_encode_fields__ if f"`{f}`" not in text]
    assert missing == []


def test_the_page_shows_the_table_as_it_is() -> None:
    text = (PAGES / "moon-monitor.md").read_text()
    assert re.search(r"^" + r"\s+".join(map(re.escape, HEADER)) + r"$", text, re.MULTILINE)


def test_the_page_on_explain_shows_what_the_command_says(monkeypatch) -> None:
    monkeypatch.chdir(SYSTEM.parents[2])
    text = (PAGES / "moon-explain.md").read_text()
    shown = re.findall(
        r"^```\n\$ moon explain ([^\n]*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL
    )
    assert shown
    for arguments, output in shown:
        result = CliRunner().invoke(moon, ["explain", *arguments.split()])
        assert result.exit_code == 0
        if "--json" in arguments:
            assert json.loads(output) == json.loads(result.stdout)
        else:
            assert output.strip() == result.stdout.strip()


def test_the_clock_skew_widens_what_timers_may_be_off() -> None:
    assert Bounds(skew=25_000_000).slack(10**9) == Bounds().slack(10**9) + 15_000_000
