"""What a property's violation is drawn from, and how many violations a page tells."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree as Tree

import pytest
from click.testing import CliRunner

from moon.cli import main
from moon.report.plot_drawing import drawn
from moon.report.plots import Limit, Plot, Series
from tests.report.hostile import TEXTS

ROOT = Path(__file__).parents[2]
TOUR = ROOT / "examples" / "lab_tour"
FILE = """\
ports:
  battery: {topic: /level, field: data}
  alarm: {topic: /alarm}
  mode: {topic: /mode, field: data}
properties:
  - {id: high, text: Never low., formula: "historically(not {battery < 30})"}
  - {id: rung, text: Rung., pattern: response, request: -5 > battery, response: alarm, within: 1 s}
  - {id: calm, text: Calm., formula: "historically({mode == 'calm'})"}
"""


def checked(folder: Path, entries: list[dict[str, object]]) -> str:
    """The page of a check of a log."""
    (folder / "p.yaml").write_text(FILE)
    log = folder / "run.jsonl"
    log.write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    page = folder / "report.html"
    arguments = ["check", log, "--properties", folder / "p.yaml", "--report", page]
    done = CliRunner().invoke(main, list(map(str, arguments)))
    assert done.exit_code == 1, done.output
    return page.read_text(encoding="utf-8")


def plots_of(page: str) -> list[Tree.Element]:
    return [Tree.fromstring(svg) for svg in re.findall(r'<div class="plot">(<svg.*?</svg>)', page)]


def parts(plot: Tree.Element, kind: str) -> list[Tree.Element]:
    return [part for part in plot.iter() if part.get("class") == kind]


def levels(*values: int) -> list[dict[str, object]]:
    return [{"topic": "/level", "time": 100 + n, "data": value} for n, value in enumerate(values)]


def test_the_values_that_a_violation_is_about_are_plotted_with_their_limit(tmp_path: Path) -> None:
    (plot,) = plots_of(checked(tmp_path, [*levels(50, 40, 20, 60), *levels(1, 1, 1, 1, 1, 9)[5:]]))
    (name,) = parts(plot, "name")
    assert name.text == "battery (/level)"
    (limit,) = parts(plot, "limit-text")
    assert limit.text == "battery < 30"
    (steps,) = parts(plot, "value")
    path = str(steps.get("d"))
    assert path.count("V") >= 3  # each value that the window has
    (at,) = parts(plot, "at")
    place = re.match(r"M([\d.]+),", str(at.get("d")))
    assert place is not None
    assert f"H{place[1]}V" in path  # it is violated where the value falls
    (time,) = parts(plot, "at-text")
    assert time.text == "+2.000 s"


def test_an_event_and_a_text_are_marks(tmp_path: Path) -> None:
    entries = [
        *levels(50, -9),
        {"topic": "/alarm", "time": 100.5},
        {"topic": "/mode", "time": 101.2, "data": "wild"},
    ]
    entries += [{"topic": "/mode", "time": 104, "data": "calm"}]
    entries.sort(key=lambda entry: float(str(entry["time"])))
    plots = plots_of(checked(tmp_path, entries))
    by_names = {" ".join(str(name.text) for name in parts(plot, "name")): plot for plot in plots}
    calm = by_names["mode (/mode)"]
    assert [part.text for part in calm.iter() if part.text == "wild"] == ["wild"]
    rung = by_names["battery (/level) alarm (/alarm)"]
    assert [limit.text for limit in parts(rung, "limit-text")] == ["battery < -5"]
    assert len(parts(rung, "event")) == 1


@pytest.mark.parametrize("text", TEXTS)
def test_hostile_text_in_a_plot_is_text(text: str) -> None:
    series = (
        Series(text, text, [(0, 1.0), (5, 2.0)], False, (Limit(1.5, text),)),
        Series(text, text, [(0, text), (5, text)], False, ()),
    )
    plot = Tree.fromstring(str(drawn(Plot(0, 2, 10, 5, series), 0)))
    assert {part.tag for part in plot.iter()} == {"svg", "title", "text", "rect", "path", "g"}
    assert {key for part in plot.iter() for key in part.attrib} <= {
        *("viewBox", "role", "class", "x", "y", "width", "height", "d", "text-anchor")
    }


@pytest.mark.parametrize("value", [10**400, 1e308, float("inf"), float("nan"), None, [1], {"a": 1}])
def test_a_value_that_is_no_height_is_a_mark(value: object) -> None:
    series = (Series("p", "/c", [(0, -1e308), (5, value)], False, ()),)
    plot = Tree.fromstring(str(drawn(Plot(0, 2, 10, 5, series), 0)))
    assert len(parts(plot, "event")) == 2


@pytest.mark.parametrize("name", ["zenoh-T3", "ros2-T5", "zenoh-T4"])
def test_the_list_has_as_many_violations_as_the_banner_says(name: str, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    arguments = ["check", ROOT / "tests" / "recordings" / f"{name}.mcap", TOUR / "system.xml"]
    arguments += ["--properties", TOUR / "properties.yaml", "--report", page]
    CliRunner().invoke(main, list(map(str, arguments)))
    text = page.read_text(encoding="utf-8")
    (count,) = re.findall(r"</span> (\d+) violations?</p>", text)
    assert text.count('class="violation" data-violation=') == int(count)
    assert text.count('<article id="violation-') == int(count)
    data = re.search(r'id="data">(.*?)</script>', text, re.DOTALL)
    assert data is not None
    marks = json.loads(data[1])["violations"]
    assert len(marks) == int(count)
    assert len({(mark["t"], mark["row"]) for mark in marks}) == int(count)
    by_row = re.findall(r'<td class="number">(\d+)</td>\s*<td class="last">', text)
    assert sum(map(int, by_row)) == int(count)
