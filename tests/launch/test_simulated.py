"""``m2c run --transport simulated``: a system in one process, in virtual time."""

from __future__ import annotations

import re
import signal
import subprocess
from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main as m2c
from m2c.launch.description import LaunchError
from m2c.launch.observers import observer
from moon.cli import main as moon
from tests.launch.system import HEAD, LEVEL, M2C, Run, System

pytestmark = pytest.mark.slow

LAB_TOUR = Path(__file__).parents[2] / "examples" / "lab_tour"
WORLD = ("--transport", "simulated")


def run(system: Path, *options: object) -> Run:
    """A run that has ended."""
    made = Run(system, *WORLD, *options, endpoint=None)
    made.end()
    return made


def code(made: Run) -> int:
    return made.process.returncode


def without_real_time(made: Run) -> list[str]:
    """Its lines, but for the seconds that it took, which end the last one."""
    return [re.sub(r" in [\d.]+ s", "", line) for line in made.lines]


def received(made: Run) -> list[int]:
    return [int(line.rpartition(" ")[2]) for line in made.lines if "Listener: got" in line]


def test_a_run_is_ticks_and_a_last_line(system: System) -> None:
    made = run(system.path, "--ticks", 3)
    assert code(made) == 0, made.output
    assert [*without_real_time(made)[:5], without_real_time(made)[6]] == [
        "lab: 2 nodes in virtual time, as fast as it goes, seed 0",
        "ticking the tree 50 times a second",
        *(f"tick {number:4d}  RUNNING  Level ok  Move .." for number in (1, 2, 3)),
        "stopped after 3 ticks: 0.0 s of virtual time",
    ]
    assert "MoveSkill: halted: Move" in made.lines[5]


def test_without_an_end_a_run_takes_sixty_virtual_seconds(system: System) -> None:
    made = run(system.path, "--rate", 1, "--quiet")
    assert code(made) == 0
    assert without_real_time(made)[-1] == "stopped after 60 ticks: 60.0 s of virtual time"


@pytest.mark.parametrize("max_time", ["", '<max_time value="2" unit="s"/>'])
@pytest.mark.parametrize("steps", [(), ("--semantics", "as2fm")])
def test_ticks_that_are_asked_for_are_made_whatever_time_they_take(
    system: System, max_time: str, steps: tuple[str, ...]
) -> None:
    text = system.path.read_text()
    head, parameters, rest = text.partition("<parameters>")
    assert parameters
    system.path.write_text(
        f'{head}{parameters}{max_time}<bt_tick_if_not_running value="true"/>{rest}'
    )
    made = run(system.path, "--ticks", 70, "--rate", 1, *steps)
    assert code(made) == 0, made.output
    assert without_real_time(made)[-1].startswith("stopped after 70 ticks: ")
    ended = run(system.path, "--ticks", 70, "--rate", 1, "--for", 10, *steps)
    assert code(ended) == 0, ended.output
    assert re.match("stopped after 1[01] of 70 ticks: ", without_real_time(ended)[-1])


def test_one_seed_is_one_run_and_others_are_others(system: System) -> None:
    options = ("--ticks", 60, "--monitor", "--delay", "0.1..30", "--tap-loss", 0.01)
    first, again, other = (
        run(LAB_TOUR / "system.xml", *options, "--seed", seed) for seed in (7, 7, 8)
    )
    assert without_real_time(first) == without_real_time(again)
    assert without_real_time(first)[1:] != without_real_time(other)[1:]
    for made in (first, other):  # delays, disorder and losses accuse nobody
        assert code(made) == 0, made.output
        assert "VIOLATED" not in made.output
        assert "missed" in made.output


def test_messages_of_best_effort_topics_are_lost(talk: Path) -> None:
    assert received(run(talk, "--for", 10)) == list(range(1, 100))
    got = received(run(talk, "--for", 10, "--loss", 0.3))
    assert 40 < len(got) < 90
    assert received(run(talk, "--for", 10, "--loss", 1)) == []


def test_logs_say_who_and_when_in_virtual_time(talk: Path) -> None:
    made = run(talk, "--for", 1, "--delay", 5)
    (first, *_) = [line for line in made.lines if "Listener |" in line]
    assert re.fullmatch(r"Listener \| \d\d:13:20\.115000 INFO Listener: got: 1", first), made.output


def test_a_faulty_model_is_found_by_the_monitor(tmp_path: Path) -> None:
    fault = LAB_TOUR / "faults" / "T3-BatteryLevelSkill.scxml"
    recording = tmp_path / "run.mcap"
    made = run(
        *(LAB_TOUR / "system.xml", "--ticks", 25, "--replace", f"BatteryLevelSkill={fault}"),
        *("--monitor", "--record", recording),
    )
    assert code(made) == 1, made.output
    assert "BatteryLevelSkill  VIOLATED" in made.output
    assert made.lines[-1].endswith("; moon found violations")
    checked = CliRunner().invoke(moon, ["check", str(recording), str(LAB_TOUR / "system.xml")])
    assert checked.exit_code == 1
    assert verdicts(checked.output) == verdicts(made.output)


def verdicts(output: str) -> list[str]:
    """The rows of the final table without lags, and verdicts with all that explains them."""
    lines = output.splitlines()
    start = next(place for place, line in enumerate(lines) if line.startswith("machine "))
    names = [line.split()[:5] for line in lines[start + 1 :] if re.match(r"\w+ +\w+ ", line)]
    news = [line for line in lines if re.match(r"\d\d:\d\d:\d\d|    \w", line)]
    return news + [" ".join(row) for row in names if row[1] in ("conforming", "violated")]


def test_a_recording_alone_is_checked_like_any_other(system: System, tmp_path: Path) -> None:
    recording = tmp_path / "run.mcap"
    made = run(system.path, "--ticks", 5, "--record", recording)
    assert code(made) == 0, made.output
    assert "recorded " in made.output
    assert "note" not in made.output
    checked = CliRunner().invoke(moon, ["check", str(recording), str(system.path)])
    assert checked.exit_code == 0, checked.output
    assert "0 violations" in checked.output
    assert "inconclusive" not in checked.output


def test_a_monitor_that_wants_no_more_ends_the_run(system: System) -> None:
    faulty = system.folder / "faulty.scxml"
    faulty.write_text(LEVEL.replace("{status}", "1"))
    made = run(system.path, "--replace", f"LevelSkill={faulty}", "--monitor=--exit-on-violation")
    assert code(made) == 1, made.output
    assert "1 violation in" in made.output
    assert made.lines[-1].startswith("stopped after ")
    assert "60.0 s" not in made.lines[-1]


def test_options_of_the_monitor_that_are_wrong_are_said_before_anything_runs(
    system: System,
) -> None:
    made = run(system.path, "--monitor=--propertis x.yaml")
    assert code(made) == 2
    assert "No such option '--propertis'" in made.output.replace(
        "No such option:", "No such option"
    )
    assert "tick" not in made.output
    assert "Traceback" not in made.output


def test_nodes_are_left_out_and_replaced(system: System) -> None:
    made = run(system.path, "--ticks", 1, "--without", "MoveSkill")
    assert code(made) == 0, made.output
    assert "lab: 1 node in virtual time" in made.lines[0]
    assert "leaf Move: /MoveSkill/tick" in made.output
    assert "tick    1  FAILURE  Level ok  Move no" in made.output


def test_what_code_in_a_node_raises_is_one_error_that_names_the_node(system: System) -> None:
    package = system.generate() / "level_skill"
    machine = package / "level_skill" / "machine.py"
    text = machine.read_text()
    assert "status=0" in text
    machine.write_text(text.replace("status=0", "status=1 // 0"))
    for options in ((), ("--monitor",)):
        made = run(system.path, "--ticks", 5, "--replace", f"LevelSkill={package}", *options)
        assert code(made) == 1, made.output
        (error,) = [line for line in made.lines if line.startswith("error: ")]
        assert error.startswith("error: LevelSkill: ZeroDivisionError: "), error
        assert "level_skill.machine" in error
        assert "status=1 // 0" in error
        assert "Traceback" not in made.output


@pytest.mark.parametrize("options", [(), ("--monitor",)])
def test_a_node_that_fails_as_it_starts_is_one_error(
    options: tuple[str, ...], system: System
) -> None:
    package = system.generate() / "level_skill"
    machine = package / "level_skill" / "machine.py"
    head = "    def start(self) -> None:\n"
    text = machine.read_text()
    assert head in text
    machine.write_text(text.replace(head, f"{head}        1 // 0\n"))
    made = run(system.path, "--ticks", 5, "--replace", f"LevelSkill={package}", *options)
    assert code(made) == 1, made.output
    (error,) = [line for line in made.lines if line.startswith("error: ")]
    assert error.startswith("error: LevelSkill: ZeroDivisionError: "), error


@pytest.mark.timeout(60)
@pytest.mark.parametrize("options", [(), ("--monitor",), ("--monitor", "--delay", "0")])
def test_a_node_that_goes_round_without_end_while_the_tree_waits_for_it_is_one_error(
    options: tuple[str, ...], system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("m2c.launch.simulated.STILL", 1_000)
    endless = system.folder / "Endless.scxml"
    endless.write_text(
        HEAD.format("LevelSkill", "idle")
        + """<ros_service_server service_name="/LevelSkill/tick" type="t/TickCondition"/>
        <ros_topic_publisher topic="/round" type="std_msgs/Int32"/>
        <state id="idle"><ros_service_handle_request name="/LevelSkill/tick" target="round"/></state>
        <state id="round">
          <onentry><send event="again"/>
            <ros_topic_publish name="/round"><field name="data" expr="1"/></ros_topic_publish>
          </onentry>
          <transition event="again" target="round"/>
        </state></scxml>"""
    )
    asked = (*WORLD, "--ticks", "5", "--replace", f"LevelSkill={endless}", *options)
    made = CliRunner().invoke(m2c, ["run", str(system.path), *asked])
    assert made.exit_code == 1, made.output
    (error,) = [line for line in made.output.splitlines() if line.startswith("error: ")]
    assert error.startswith("error: LevelSkill: 1,000 events and no time has passed: "), error
    assert "tick    1  FAILURE  Level no" in made.output  # its caller got an error, and could go on
    assert "Python exception" not in made.output


def test_a_script_that_fails_while_ticking_ends_the_run_with_its_reason(system: System) -> None:
    system.write('<Sequence><Script code="n:=\'x\'"/><Script code="m:=n*2"/></Sequence>')
    made = run(system.path, "--ticks", 5)
    assert code(made) == 1, made.output
    (error,) = [line for line in made.lines if line.startswith("error: ")]
    assert error.startswith("error: policy: the tree cannot be ticked: ")


def test_a_model_for_which_no_time_passes_is_one_error(talk: Path) -> None:
    talk.with_name("Listener.scxml").write_text(
        HEAD.format("Listener", "a")
        + """<state id="a"><onentry><send event="again"/></onentry>
        <transition event="again" target="a"/></state></scxml>"""
    )
    made = run(talk, "--monitor=--only Talker")
    assert code(made) == 1, made.output
    (error,) = [line for line in made.lines if line.startswith("error: ")]
    assert error.startswith("error: Listener: 100,000 events and no time has passed: ")


def test_a_run_at_the_pace_of_real_time_ends_at_ctrl_c(system: System) -> None:
    made = Run(system.path, *WORLD, "--speed", 1, "--for", 3600, "--monitor", endpoint=None)
    made.until("tick ")
    made.process.send_signal(signal.SIGINT)
    assert made.end() == 0, made.output
    assert "1 times as fast as real time" in made.lines[0]
    assert "0 violations in" in made.output
    assert "MoveSkill: halted: Move" in made.output  # the policy ends as it does elsewhere
    assert made.lines[-1].startswith("stopped after ")


def test_a_reader_that_leaves_ends_the_run(system: System) -> None:
    command = [str(M2C), "run", str(system.path), *WORLD, "--speed", "1", "--for", "3600"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline()
        process.stdout.close()
        assert process.stderr is not None
        assert process.stderr.read() == b""
        assert process.wait(60) == 0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            [*WORLD, "--endpoint", "tcp/x:1"],
            "--transport simulated: --endpoint is for a middleware",
        ),
        (
            [*WORLD, "--namespace", "a", "--zenoh-config", __file__],
            "--transport simulated: --zenoh-config and --namespace are for a middleware",
        ),
        (["--seed", "1"], "--transport zenoh: --seed is for simulated"),
        (
            ["--transport", "ros2", "--for", "1", "--loss", "0.1"],
            "--transport ros2: --for and --loss are for simulated",
        ),
        ([*WORLD, "--delay", "20..1"], "Invalid value for '--delay': '20..1' is no delay; write"),
        ([*WORLD, "--delay", "nan"], "Invalid value for '--delay': 'nan' is no delay; write"),
        ([*WORLD, "--speed", "inf"], "Invalid value for '--speed': 'inf' is no finite number"),
        ([*WORLD, "--loss", "2"], "Invalid value for '--loss': 2"),
        ([*WORLD, "--for", "0"], "Invalid value for '--for': 0"),
        ([*WORLD, "--only", "MoveSkil"], "lab has no node MoveSkil; did you mean MoveSkill?"),
        ([*WORLD, "--without", "policy", "--ticks", "3"], "--ticks 3: the policy is not run"),
        ([*WORLD, "--replace", f"Move={__file__}"], "lab has no node Move; "),
        (
            [*WORLD, "--replace", f"MoveSkill={LAB_TOUR}"],
            f"{LAB_TOUR}: not a generated package; expected <package>/__main__.py in it",
        ),
        ([*WORLD, "--record", __file__], "is there already; a recording is not written over"),
    ],
)
def test_a_wrong_option_is_one_error(system: System, options: list[str], said: str) -> None:
    done = CliRunner().invoke(m2c, ["run", str(system.path), *options])
    assert done.exit_code == 2, done.output
    assert said in " ".join(done.output.split())
    assert "Traceback" not in done.output


def test_the_interfaces_that_are_named_are_the_run_s_and_the_monitor_s(
    talk: Path, tmp_path: Path
) -> None:
    for folder, kind in (("interfaces", "bool"), ("named", "int32")):
        path = tmp_path / folder / "p" / "msg" / "Count.msg"
        path.parent.mkdir(parents=True)
        path.write_text(f"{kind} data\n")
    for name in ("Talker", "Listener"):
        path = tmp_path / f"{name}.scxml"
        path.write_text(path.read_text().replace("std_msgs/Int32", "p/Count"))
    refused = run(talk, "--for", 1)
    assert code(refused) == 2
    assert "a value of type int32 where bool is declared" in refused.output
    made = run(talk, "--for", 1, "--interfaces", tmp_path / "named", "--monitor")
    assert code(made) == 0, made.output
    assert received(made) == list(range(1, len(received(made)) + 1)) != []
    assert "1 machine: 1 conforming" in made.output
    assert "named/p/msg/Count.msg:0:0: warning: p/msg/Count is defined differently" in made.output


SILENT = re.sub(
    r"<ros_service_send_response.*</ros_service_send_response>", "", LEVEL, flags=re.DOTALL
)


@pytest.mark.parametrize(("options", "seconds"), [((), 5.0), (("--tick-timeout", 0.5), 0.5)])
def test_a_leaf_that_does_not_answer_fails_after_the_tick_s_timeout(
    system: System, options: tuple[object, ...], seconds: float
) -> None:
    silent = system.folder / "silent.scxml"
    silent.write_text(SILENT)
    made = run(system.path, "--ticks", 1, "--replace", f"LevelSkill={silent}", *options)
    assert code(made) == 0, made.output
    assert any(line.startswith("tick    1  FAILURE") for line in made.lines), made.output
    assert f"stopped after 1 tick: {seconds:.1f} s of virtual time" in made.output


def test_what_nodes_log_is_chosen_and_kept(talk: Path, tmp_path: Path) -> None:
    logs = tmp_path / "made" / "logs"
    made = run(talk, "--for", 1, "--log-dir", logs)
    shown = [line.partition(" | ")[2] for line in made.lines if "Listener: got" in line]
    assert [path.name for path in logs.iterdir()] == ["Listener.log"]
    assert (logs / "Listener.log").read_text().splitlines() == shown != []
    quiet = run(talk, "--for", 1, "--log-dir", logs, "--log-level", "warning")
    assert received(quiet) == []
    assert (logs / "Listener.log").read_text().splitlines() == shown  # nothing was added


def test_a_folder_for_logs_that_cannot_be_made_is_one_error(talk: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    made = run(talk, "--for", 1, "--log-dir", tmp_path / "file" / "logs")
    assert code(made) == 2
    assert made.lines == [f"error: --log-dir {tmp_path}/file/logs: Not a directory"]


def test_a_generated_folder_is_refused(tmp_path: Path) -> None:
    done = CliRunner().invoke(m2c, ["run", str(tmp_path), *WORLD])
    assert done.exit_code == 2
    assert done.output == (
        "error: --transport simulated: it runs models: give the system file as SYSTEM\n"
    )


def test_an_observer_that_is_not_installed_is_an_error() -> None:
    with pytest.raises(LaunchError, match="--watch: no observer `watch` is installed"):
        observer("watch")


# --- the meaning that AS2FM gives to models -------------------------------------------------------

STEPS = ("--semantics", "as2fm")


def test_max_time_ends_a_run_and_still_counts_in_as2fm(talk: Path) -> None:
    text = talk.read_text().replace(
        "<roaml>", '<roaml><parameters><max_time value="2" unit="s"/></parameters>'
    )
    talk.write_text(text)
    assert received(run(talk)) == [*range(1, 20)]
    assert received(run(talk, *STEPS)) == [*range(1, 21)]


def test_a_chain_of_steps_without_end_ends_the_run_and_is_no_fault(
    talk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("m2c.launch.simulated.STILL", 1_000)
    talk.with_name("Talker.scxml").write_text(
        HEAD.format("Talker", "a") + """<state id="a"><transition target="a"/></state></scxml>"""
    )
    done = CliRunner().invoke(m2c, ["run", str(talk), *WORLD, *STEPS])
    assert done.exit_code == 0, done.output
    assert done.output.endswith("; 1,000 events needed no time, and more would have followed\n")


def test_a_leaf_that_waits_when_steps_have_no_end_is_let_go(
    system: System, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("m2c.launch.simulated.STILL", 1_000)
    busy = system.folder / "busy.scxml"
    loop = """<ros_time_rate name="soon" rate_hz="40"/>
    <state id="early"><ros_rate_callback name="soon" target="busy"/></state>
    <state id="busy"><transition cond="true" target="busy"/><transition event="e" target="idle"/></state>"""
    busy.write_text(
        LEVEL.replace("{status}", "0")
        .replace('initial="idle"', 'initial="early"')
        .replace("</scxml>", f"{loop}</scxml>")
    )
    done = CliRunner().invoke(
        m2c, ["run", str(system.path), *WORLD, *STEPS, "--replace", f"LevelSkill={busy}"]
    )
    assert done.exit_code == 0, done.output
    assert "1,000 events needed no time" in done.output
    assert "TaskAbandonedError" not in capfd.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--delay", "1"], "--delay and --loss are for deployed systems"),
        (["--loss", "0.5"], "--delay and --loss are for deployed systems"),
        (["--tick-timeout", "1"], "--tick-timeout is for deployed systems"),
        (["--monitor"], "--monitor judges nodes as they are deployed"),
        (["--replace", "LevelSkill={folder}"], "generated code is deployed; give the model"),
    ],
)
def test_what_as2fm_has_no_place_for_is_refused(
    system: System, options: list[str], said: str
) -> None:
    written = [option.replace("{folder}", str(system.folder)) for option in options]
    done = CliRunner().invoke(m2c, ["run", str(system.path), *WORLD, *STEPS, *written])
    assert done.exit_code == 2
    assert done.output.startswith("error: --semantics as2fm: ")
    assert said in done.output
