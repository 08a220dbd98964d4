"""The check command: exit codes, formats, and what machines say of each other."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main

NS = 'xmlns="http://www.w3.org/2005/07/scxml" version="1.0"'
GOOD = f'<scxml {NS} name="Good" initial="a"><state id="a"/></scxml>'
WARNS = f'<scxml {NS} name="Warns" initial="a"><state id="a"/><state id="b"/></scxml>'
FAILS = f'<scxml {NS} name="Fails" initial="z"><state id="a"/></scxml>'


def run(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(main, ["check", *arguments])
    return result.exit_code, result.output


def model(folder: Path, text: str, name: str = "model.scxml") -> str:
    path = folder / name
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize(
    ("text", "options", "code", "summary"),
    [
        (GOOD, [], 0, "1 model, 0 errors, 0 warnings"),
        (WARNS, [], 0, "1 model, 0 errors, 1 warning"),
        (WARNS, ["--strict"], 2, "1 model, 0 errors, 1 warning"),
        (FAILS, [], 2, "0 models, 1 error, 0 warnings"),
    ],
)
def test_the_exit_code_says_whether_the_models_can_be_used(
    tmp_path: Path, text: str, options: list[str], code: int, summary: str
) -> None:
    exit_code, output = run(model(tmp_path, text), *options)
    assert exit_code == code
    assert output.splitlines()[-1] == summary


def test_json_has_an_object_per_finding(tmp_path: Path) -> None:
    path = model(tmp_path, FAILS)
    code, output = run(path, "--format", "json")
    assert code == 2
    (found,) = json.loads(output)
    assert (found["file"], found["line"], found["rule"]) == (path, 1, "unknown-target")
    assert found["message"] == "the initial state `z` does not exist"


def sarif_uri(*arguments: str) -> str:
    _, output = run(*arguments, "--format", "sarif")
    (result,) = json.loads(output)["runs"][0]["results"]
    (location,) = result["locations"]
    artifact = location["physicalLocation"]["artifactLocation"]
    assert artifact["uriBaseId"] == "%SRCROOT%"
    return str(artifact["uri"])


def test_sarif_names_files_relative_to_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my models").mkdir()
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path)
    path = model(tmp_path / "my models", FAILS, "späte #1.scxml")
    assert sarif_uri(path) == "my%20models/sp%C3%A4te%20%231.scxml"
    assert sarif_uri("my models/späte #1.scxml") == "my%20models/sp%C3%A4te%20%231.scxml"
    model(tmp_path, FAILS, "c:1.scxml")
    assert sarif_uri("c:1.scxml") == "c%3A1.scxml"
    monkeypatch.chdir(tmp_path / "work")
    assert sarif_uri(path) == "../my%20models/sp%C3%A4te%20%231.scxml"


def test_sarif_describes_the_rules_it_uses(tmp_path: Path) -> None:
    _, output = run(model(tmp_path, WARNS), "--format", "sarif")
    driver = json.loads(output)["runs"][0]["tool"]["driver"]
    assert driver["rules"] == [
        {
            "id": "unreachable-state",
            "shortDescription": {"text": "no run enters the state"},
            "defaultConfiguration": {"level": "warning"},
        }
    ]


def test_without_a_path_the_system_of_the_folder_is_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model(tmp_path, FAILS)
    (tmp_path / "system.xml").write_text(
        '<roaml><node_models><input type="node-ascxml" src="nowhere.scxml"/></node_models></roaml>'
    )
    monkeypatch.chdir(tmp_path)
    code, output = run()
    assert code == 2
    assert output.startswith("system.xml:1:")


def test_no_input_is_a_usage_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    code, output = run()
    assert code == 2
    assert "nothing to check; give a model, a folder or a system file" in output


def test_sarif_names_rule_and_region(tmp_path: Path) -> None:
    code, output = run(model(tmp_path, FAILS), "--format", "sarif")
    assert code == 2
    log = json.loads(output)
    assert log["version"] == "2.1.0"
    (result,) = log["runs"][0]["results"]
    assert (result["ruleId"], result["level"]) == ("unknown-target", "error")
    assert result["locations"][0]["physicalLocation"]["region"]["startLine"] == 1


def server(name: str, kind: str = "Trigger") -> str:
    return (
        f'<scxml {NS} name="{name}" initial="a">'
        f'<ros_service_server service_name="/s" type="std_srvs/{kind}"/>'
        '<state id="a"><ros_service_handle_request name="/s"/></state></scxml>'
    )


def test_two_servers_of_one_service_are_an_error(tmp_path: Path) -> None:
    model(tmp_path, server("One"), "one.scxml")
    model(tmp_path, server("Two"), "two.scxml")
    code, output = run(str(tmp_path))
    assert code == 2
    assert "error: Two and One both serve /s; a service has one server [duplicate-server]" in output


def test_a_channel_with_two_types_is_an_error(tmp_path: Path) -> None:
    model(tmp_path, server("One"), "one.scxml")
    model(tmp_path, server("Two", "Empty"), "two.scxml")
    _, output = run(str(tmp_path))
    assert (
        "error: Two declares /s as std_srvs/srv/Empty, One as std_srvs/srv/Trigger; both ends of a "
        "channel have one type [type-disagreement]"
    ) in output


def test_a_topic_and_a_service_may_share_a_name(tmp_path: Path) -> None:
    model(tmp_path, server("One"), "one.scxml")
    publisher = (
        f'<scxml {NS} name="Two" initial="a"><ros_topic_publisher topic="/s" type="std_msgs/Empty"/>'
        '<state id="a"><onentry><ros_topic_publish name="/s"/></onentry></state></scxml>'
    )
    model(tmp_path, publisher, "two.scxml")
    code, output = run(str(tmp_path))
    assert code == 0, output


def test_two_nodes_of_one_name_are_an_error(tmp_path: Path) -> None:
    model(tmp_path, GOOD, "one.scxml")
    model(tmp_path, GOOD, "two.scxml")
    code, output = run(str(tmp_path))
    assert code == 2
    assert "error: <scxml>: a second node is called `Good`; the first is" in output


def test_a_file_that_does_not_exist_is_one_message(tmp_path: Path) -> None:
    code, output = run(str(tmp_path / "none.scxml"))
    assert code == 2
    assert "cannot read the file: No such file or directory [unreadable-file]" in output
