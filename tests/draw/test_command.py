"""``m2c draw`` on the command line."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner, Result

from m2c.cli import main

EXAMPLE = Path(__file__).parents[2] / "examples" / "lab_tour"
INPUTS = {
    "model": EXAMPLE / "skills" / "GoToPoiSkill.scxml",
    "system": EXAMPLE / "system.xml",
    "policy": EXAMPLE / "policy.xml",
    "folder": EXAMPLE / "skills",
}


def draw(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["draw", *map(str, arguments)])


@pytest.mark.parametrize("kind", INPUTS)
@pytest.mark.parametrize("suffix", [".svg", ".mmd", ".dot"])
def test_everything_is_drawn_in_every_format(kind: str, suffix: str, tmp_path: Path) -> None:
    output = tmp_path / f"picture{suffix}"
    result = draw(INPUTS[kind], "-o", output)
    assert result.exit_code == 0, result.output
    assert result.output == ""
    text = output.read_text()
    if suffix == ".svg":
        assert ElementTree.fromstring(text).tag == "{http://www.w3.org/2000/svg}svg"
    assert text.startswith({".svg": "<svg", ".mmd": "---\ntitle", ".dot": "digraph"}[suffix])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "the file is empty"),
        ("<scxml", "malformed XML"),
        ("<other/>", "neither a model nor a system file"),
        ('<!DOCTYPE x [<!ENTITY y "z">]><root/>', "a document type declaration"),
        ('<root BTCPP_format="4"/>', "the policy has no <BehaviorTree>"),
    ],
)
def test_bad_input_is_refused_as_the_check_refuses_it(
    content: str, said: str, tmp_path: Path
) -> None:
    path = tmp_path / "input.xml"
    path.write_text(content)
    result = draw(path, "-o", tmp_path / "x.svg")
    assert result.exit_code == 2
    assert said in result.output
    assert f"{path}:" in result.output
    assert not (tmp_path / "x.svg").exists()


def test_a_model_with_errors_is_not_drawn(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    path.write_text(
        '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="M" initial="a">'
        '<state id="a"><transition event="e" target="nowhere"/></state></scxml>'
    )
    result = draw(path, "-o", tmp_path / "x.svg")
    assert result.exit_code == 2
    assert "the target state `nowhere` does not exist" in result.output


def test_one_machine_of_a_system_is_drawn_by_its_name(tmp_path: Path) -> None:
    alone, named = tmp_path / "alone.svg", tmp_path / "named.svg"
    assert draw(INPUTS["model"], "-o", alone).exit_code == 0
    assert draw(INPUTS["system"], "--node", "GoToPoiSkill", "-o", named).exit_code == 0
    assert alone.read_bytes() == named.read_bytes()
    unknown = draw(INPUTS["system"], "--node", "GoToPoi", "-o", named)
    assert unknown.exit_code == 2
    assert "lab_tour has no machine GoToPoi" in unknown.output
    assert "GoToPoiSkill" in unknown.output


def test_a_machine_too_large_for_a_picture_is_refused_and_still_dot(tmp_path: Path) -> None:
    states = "".join(
        f'<state id="s{i}">'
        + "".join(f'<transition event="e{j}" target="s{(i * 7 + j) % 400}"/>' for j in range(3))
        + "</state>"
        for i in range(400)
    )
    path = tmp_path / "model.scxml"
    head = '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="M" initial="s0">'
    path.write_text(f"{head}{states}</scxml>")
    refused = draw(path, "-o", tmp_path / "x.svg")
    assert refused.exit_code == 2
    assert "make no readable picture; draw them as .dot or .mmd" in refused.output
    assert draw(path, "-o", tmp_path / "x.dot").exit_code == 0


def test_a_missing_file_and_an_unknown_format_are_said(tmp_path: Path) -> None:
    missing = draw(tmp_path / "no.scxml", "-o", tmp_path / "x.svg")
    assert (missing.exit_code, "No such file" in missing.output) == (2, True)
    unknown = draw(INPUTS["model"], "-o", tmp_path / "x.png")
    assert (unknown.exit_code, ".svg, .mmd, .dot" in unknown.output) == (2, True)


def test_an_output_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    result = draw(INPUTS["model"], "-o", tmp_path / "missing" / "x.svg")
    assert result.exit_code == 2
    assert "cannot be written: No such file or directory" in result.output
