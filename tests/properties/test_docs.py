"""The pages about properties: every example runs, every timeline is what the monitors say."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.diagnostics import DiagnosticLog
from moon.cli import main
from moon.properties.files.xml import parse_property_xml
from moon.properties.files.yaml import parse_property_yaml
from moon.properties.patterns import PatternName, ScopeName
from tests.properties.catalogue import pages

DOCS = Path(__file__).parents[2] / "docs"


PAGES = ("properties.md", "property-verdicts.md")


def blocks(page: str, language: str) -> list[str]:
    found = re.findall(rf"```{language}\n(.*?)```", (DOCS / page).read_text(), re.DOTALL)
    assert found
    return found


def test_the_examples_in_yaml_are_good_property_files():
    for source in blocks("properties.md", "yaml"):
        log = DiagnosticLog()
        found = parse_property_yaml(source.encode(), "docs/properties.md", log)
        assert [str(finding) for finding in log.diagnostics] == []
        assert len(found) == 4


MOON = "".join(blocks("properties.md", "xml"))


def read_xml(source: str) -> tuple[list[str], list[str]]:
    """The ids of the properties in ``source``, and what is said of it."""
    log = DiagnosticLog()
    found = parse_property_xml(source.encode(), "properties.xml", log)
    said = [f"<{item.element}> {item.message}; {item.hint}" for item in log.diagnostics]
    return [item.name for item in found], said


def test_the_example_in_moon_s_xml_is_a_good_property_file():
    assert read_xml(MOON) == (["alarm_in_time"], [])


ELEMENTS = sorted(set(re.findall(r"<(\w+)", MOON)))


@pytest.mark.parametrize("element", ELEMENTS)
def test_an_attribute_that_an_element_of_moon_s_xml_does_not_have_is_named(element: str):
    _, said = read_xml(re.sub(rf"<{element}\b", f'<{element} wrnog="x"', MOON, count=1))
    (found,) = said
    assert found.startswith(f"<{element}> `wrnog` means nothing here; it takes ")


@pytest.mark.parametrize(
    ("written", "wrong", "hint"),
    [
        ('field="data"', 'feild="data"', "did you mean `field`?"),
        ('within="5"', 'witin="5"', "did you mean `within`?"),
        ('topic_name="/battery"', 'topic_nam="/battery"', "did you mean `topic_name`?"),
        ('pattern="response"', 'patern="response"', "did you mean `pattern`?"),
    ],
)
def test_a_misspelt_attribute_of_moon_s_xml_comes_with_what_was_meant(
    written: str, wrong: str, hint: str
):
    _, said = read_xml(MOON.replace(written, wrong))
    name = wrong.partition("=")[0]
    assert any(f"`{name}` means nothing here; {hint}" in item for item in said)


@pytest.mark.parametrize("page", PAGES)
def test_the_examples_in_python_run(page):
    for source in blocks(page, "python"):
        exec(compile(source, f"docs/{page}", "exec"), {})


def test_the_timelines_are_what_the_monitors_say():
    committed = {path: (DOCS / path).read_text(encoding="utf-8") for path in pages()}
    assert committed == pages(), "run `python -m tests.properties.catalogue`"


def test_every_pattern_and_scope_is_drawn():
    index = (DOCS / "property-patterns.md").read_text(encoding="utf-8")
    for name in PatternName:
        assert f"(patterns/{name}.md)" in index
        text = (DOCS / "patterns" / f"{name}.md").read_text(encoding="utf-8")
        for scope in ScopeName:
            assert f"## {name}, {scope}\n" in text


def test_the_page_of_check_properties_shows_what_it_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (DOCS / "commands" / "moon-check-properties.md").read_text()
    (source,) = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    runs = re.findall(r"```\n\$ moon (check-properties .*?)\n(.*?)```", text, re.DOTALL)
    corrected = source.replace("allarm", "alarm").replace("fortnights", "s")
    corrected = corrected.replace('30)"', '30})"')
    corrected = corrected.replace("existence, of: alarm", "existence, of: alarm, within: 60 s")
    codes = []
    for (command, output), content in zip(runs, (source, corrected, corrected), strict=True):
        (tmp_path / "tour.yaml").write_text(content)
        result = CliRunner().invoke(main, command.split())
        assert result.output == output
        codes.append(result.exit_code)
    assert codes == [2, 0, 0]


def test_the_page_shows_what_is_said_of_a_field_that_the_models_do_not_have(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (DOCS / "commands" / "moon-check-properties.md").read_text()
    (shown,) = re.findall(r"^wrong.yaml:.*$", text, re.MULTILINE)
    example = DOCS.parent / "examples" / "lab_tour"
    source = (example / "properties.yaml").read_text()
    (tmp_path / "wrong.yaml").write_text(source.replace("field: data}", "field: date}"))
    arguments = ["check-properties", "wrong.yaml", str(example / "system.xml")]
    result = CliRunner().invoke(main, arguments)
    assert result.stderr.splitlines() == [shown]
    assert result.stdout.splitlines()[-1] == "4 properties, 1 error"
    assert result.exit_code == 2
