"""The pages about properties: every example runs, every timeline is what the monitors say."""

from __future__ import annotations

import re
from pathlib import Path

from m2c.model.diagnostics import DiagnosticLog
from moon.properties.patterns import PatternName, ScopeName
from moon.properties.yaml_file import parse_property_yaml
from tests.properties.catalogue import page

DOCS = Path(__file__).parents[2] / "docs"


def blocks(language: str) -> list[str]:
    found = re.findall(rf"```{language}\n(.*?)```", (DOCS / "properties.md").read_text(), re.DOTALL)
    assert found
    return found


def test_the_examples_in_yaml_are_good_property_files():
    for source in blocks("yaml"):
        log = DiagnosticLog()
        found = parse_property_yaml(source.encode(), "docs/properties.md", log)
        assert [str(finding) for finding in log.diagnostics] == []
        assert len(found) == 4


def test_the_examples_in_python_run():
    for source in blocks("python"):
        exec(compile(source, "docs/properties.md", "exec"), {})


def test_the_timelines_are_what_the_monitors_say():
    assert (DOCS / "property-patterns.md").read_text() == page()


def test_every_pattern_and_scope_is_drawn():
    text = (DOCS / "property-patterns.md").read_text()
    for name in PatternName:
        for scope in ScopeName:
            assert f"### {name}, {scope}\n" in text
