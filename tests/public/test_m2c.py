"""``m2c.read_system``, ``check``, ``generate`` and ``simulate`` do what the commands do."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner

import m2c
from m2c.cli import main
from tests.monitor.hand_driven import write_models
from transports import SimulatedWorld, TransportError

TOUR = Path(__file__).parents[2] / "examples" / "lab_tour"


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return write_models(tmp_path)


def changed(model: Path, before: str, after: str) -> Path:
    text = model.read_text()
    assert before in text
    model.write_text(text.replace(before, after))
    return model


def commands_findings(*arguments: object) -> list[dict[str, object]]:
    ran = CliRunner().invoke(main, ["check", "--format", "json", *map(str, arguments)])
    found: list[dict[str, object]] = json.loads(ran.stdout)
    return found


def in_short(found: m2c.Diagnostic) -> tuple[object, ...]:
    place = found.position
    return (place.file, place.line, place.column, str(found.severity), found.rule, found.message)


def test_check_finds_what_the_command_finds(model: Path) -> None:
    changed(model, "level &gt; 30 ? 0 : 1", "level &gt; 30 ? 0 : nobody")
    system = m2c.read_system(model)
    expected = commands_findings(model)
    assert [item["rule"] for item in expected if item["severity"] == "error"]
    keys = ("file", "line", "column", "severity", "rule", "message")
    assert [in_short(found) for found in m2c.check(system)] == [
        tuple(item[key] for key in keys) for item in expected
    ]


def test_check_tells_what_the_reader_warned_of(tmp_path: Path) -> None:
    shutil.copytree(TOUR, tmp_path / "tour", ignore=shutil.ignore_patterns("faults"))
    path = tmp_path / "tour" / "system.xml"
    inputs = path.read_text()
    first = next(line for line in inputs.splitlines() if "skills/AlarmSkill.scxml" in line)
    path.write_text(inputs.replace(first, f"{first}\n{first}"))
    found = m2c.check(m2c.read_system(path))
    assert [item.rule for item in found] == [item["rule"] for item in commands_findings(path)]
    assert "duplicate-input" in [item.rule for item in found]


def test_check_asks_the_transport_where_the_nodes_will_run(model: Path) -> None:
    changed(model, "/Level/tick", "/Level/1tick")
    system = m2c.read_system(model)
    anywhere, there = m2c.check(system), m2c.check(system, transport="ros2")
    assert {str(found.severity) for found in anywhere} == {"warning"}
    assert "error" in {str(found.severity) for found in there}
    assert m2c.check(system, transport="zenoh") == []


def test_what_cannot_be_read_is_an_error_with_its_place(tmp_path: Path, model: Path) -> None:
    changed(model, "</scxml>", "")
    with pytest.raises(m2c.ModelError, match=r"Level\.scxml:\d+:\d+: error: "):
        m2c.read_system(model)
    with pytest.raises(m2c.ModelError, match="nowhere"):
        m2c.read_system(tmp_path / "nowhere.xml")
    (tmp_path / "empty").mkdir()
    with pytest.raises(m2c.ModelError, match="no model in this folder"):
        m2c.read_system(tmp_path / "empty")


def test_interfaces_may_be_in_another_folder(tmp_path: Path, model: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    shutil.move(tmp_path / "interfaces", elsewhere)
    assert "unknown-type" in [found.rule for found in m2c.check(m2c.read_system(model))]
    system = m2c.read_system(str(model), interfaces=[str(elsewhere)])
    assert m2c.check(system) == []


@pytest.mark.parametrize("transport", ["zenoh", "ros2"])
def test_generate_writes_what_the_command_writes(tmp_path: Path, transport: str) -> None:
    system = m2c.read_system(TOUR / "system.xml")
    paths = m2c.generate(system, tmp_path / "by_function", transport=transport)
    arguments = ["generate", str(TOUR / "system.xml"), "--transport", transport]
    CliRunner().invoke(
        main, [*arguments, "-o", str(tmp_path / "by_command")], catch_exceptions=False
    )
    contents = [
        {
            file.relative_to(tmp_path / folder): file.read_text()
            for file in (tmp_path / folder).rglob("*")
            if file.is_file()
        }
        for folder in ("by_function", "by_command")
    ]
    assert contents[0] == contents[1]
    assert paths == sorted(paths)
    listed = {path.relative_to(tmp_path / "by_function") for path in paths}
    assert {path for path in contents[0] if path.name != "generated.sha256"} == listed


def test_nothing_is_generated_from_a_system_with_errors(tmp_path: Path, model: Path) -> None:
    system = m2c.read_system(changed(model, "level &gt; 30 ? 0 : 1", "nobody"))
    with pytest.raises(m2c.ModelError, match="nobody"):
        m2c.generate(system, tmp_path / "out")
    with pytest.raises(m2c.ModelError, match="nobody"):
        m2c.simulate(system, SimulatedWorld())
    assert not (tmp_path / "out").exists()


def test_a_file_that_was_edited_is_not_overwritten_unless_asked_to(
    tmp_path: Path, model: Path
) -> None:
    system = m2c.read_system(model)
    node = next(path for path in m2c.generate(system, tmp_path / "out") if path.name == "node.py")
    before = node.read_text()
    node.write_text(before + "# mine\n")
    with pytest.raises(m2c.EditedFilesError, match=r"node\.py"):
        m2c.generate(system, tmp_path / "out")
    m2c.generate(system, tmp_path / "out", force=True)
    assert node.read_text() == before


def test_packages_for_two_transports_are_not_mixed(tmp_path: Path, model: Path) -> None:
    system = m2c.read_system(model)
    m2c.generate(system, tmp_path / "out")
    with pytest.raises(m2c.OtherPackagesError, match="has packages for another transport"):
        m2c.generate(system, tmp_path / "out", transport="ros2")


def test_a_transport_that_is_not_there_is_named(tmp_path: Path, model: Path) -> None:
    system = m2c.read_system(model)
    for use in (
        lambda: m2c.check(system, transport="pigeon"),
        lambda: m2c.generate(system, tmp_path / "out", transport="pigeon"),
    ):
        with pytest.raises(TransportError, match="no transport `pigeon` is installed; installed: "):
            use()


def test_a_template_of_ones_own_is_used(tmp_path: Path, model: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "header.j2").write_text("# Ours.\n")
    paths = m2c.generate(m2c.read_system(model), tmp_path / "out", templates=tmp_path / "mine")
    assert all("# Ours." in path.read_text() for path in paths if path.suffix == ".py")
    (tmp_path / "mine" / "header.j2").write_text("{{ nothing }}\n")
    with pytest.raises(m2c.TemplateFault, match=r"header\.j2"):
        m2c.generate(m2c.read_system(model), tmp_path / "out", templates=tmp_path / "mine")


def test_a_simulated_run_is_the_same_for_the_same_seed() -> None:
    system = m2c.read_system(TOUR / "system.xml")
    runs = [m2c.simulate(system, SimulatedWorld(seed=3)) for _ in range(2)]
    for run in runs:
        run.run(5.0)
    assert runs[0].ticks
    assert runs[0].world.events == runs[1].world.events
    assert runs[0].ticks == runs[1].ticks


def test_time_passes_on_after_a_tree_that_is_not_ticked_again_has_ended() -> None:
    system = m2c.read_system(TOUR / "system.xml")
    ended = m2c.simulate(
        msgspec.structs.replace(system, tick_if_not_running=False), SimulatedWorld(seed=3)
    )
    began_ns = ended.world.now_ns
    ended.run(200.0)
    assert [tick.status != "RUNNING" for tick in ended.ticks] == [
        *[False] * (len(ended.ticks) - 1),
        True,
    ]
    assert ended.world.now_ns - began_ns == 200_000_000_000
