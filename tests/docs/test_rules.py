"""The page of rules is what the code says, example by example."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.check.rules import RULES
from m2c.cli import main
from tests.docs.rule_examples import RULE_EXAMPLES

ROOT = Path(__file__).parents[2]
REFERENCE = (ROOT / "docs" / "rules.md").read_text()
ROW = re.compile(r"^\| `([a-z-]+)` \| (error|warning|note) \| (.+?) \| (.+) \|$", re.MULTILINE)
READERS = ("language", "model", "check", "policy")
"""Packages whose findings `m2c check` shows."""
_REPORTS = ("error", "warning", "note", "_error")
_RULE = re.compile(r"[a-z]+(-[a-z]+)+\Z")


def rules_in_code() -> set[str]:
    """The first argument of every report in the source, and rule names chosen beside one."""
    found = set()
    for path in (path for name in READERS for path in (ROOT / "m2c" / name).rglob("*.py")):
        source = ast.parse(path.read_text())
        for node in ast.walk(source):
            if not (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and node.func.attr in _REPORTS
                and len(node.args) >= 3
            ):
                continue
            rule = node.args[0]
            if isinstance(rule, ast.Constant) and _RULE.match(str(rule.value)):
                found.add(str(rule.value))
    # the parser of expressions chooses between two names in a variable
    return found | {"bad-expression", "unsupported-expression"}


def test_the_table_of_rules_is_the_code_s() -> None:
    assert rules_in_code() == {rule.id for rule in RULES}


def test_every_rule_has_a_row_on_its_page() -> None:
    rows = [(name, severity, meaning) for name, severity, meaning, _ in ROW.findall(REFERENCE)]
    assert rows == [(rule.id, str(rule.severity), rule.meaning) for rule in RULES]


def message_of(rule: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """What ``m2c check`` says of the rule's example: the finding of that rule."""
    example = RULE_EXAMPLES[rule]
    for name, text in example.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.chdir(folder)
    arguments = example.arguments or (next(iter(example.files)),)
    result = CliRunner().invoke(main, ["check", "--format", "json", *arguments])
    findings = json.loads(result.output)
    found = next((item for item in findings if item["rule"] == rule), None)
    assert found is not None, findings
    assert result.exit_code == (2 if any(i["severity"] == "error" for i in findings) else 0)
    return {key: str(value).replace(f"{folder}/", "") for key, value in found.items()}


@pytest.mark.parametrize("rule", [rule.id for rule in RULES])
def test_the_example_of_a_rule_is_what_the_check_says(
    rule: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = message_of(rule, tmp_path, monkeypatch)
    severity, example = next((row[1], row[3]) for row in ROW.findall(REFERENCE) if row[0] == rule)
    assert found["severity"] == severity
    assert as_shown(found) == example


def as_shown(found: dict[str, str]) -> str:
    """A finding as the table shows it: element, message and hint, bars and dots escaped."""
    element = f"<{found['element']}>: " if found["element"] else ""
    hint = f"; {found['hint']}" if found["hint"] else ""
    return f"`` {element}{found['message']}{hint} ``".replace("|", "\\|")
