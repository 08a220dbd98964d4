"""The page in headless Chromium: it renders, zooms, and shows what was clicked."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.wheel_input import ScrollOrigin
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import WebDriverWait

from moon.cli import main
from moon.report import write_report
from tests.report.browser import MissingBrowserError, browser, complaints, opened
from tests.report.samples import (
    HOSTILE,
    START_S,
    machines,
    property_violation,
    result,
    violation,
    write_log,
)

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
VIOLATED = ("GoToPoiSkill", "BatteryLevelSkill", "NavigationComponent")


@pytest.fixture(scope="module")
def driver() -> Iterator[webdriver.Chrome]:
    try:
        with browser() as found:
            yield found
    except MissingBrowserError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    nodes = {machine.name: machine for machine in machines()}
    said = [violation(nodes[name], 10 + 10 * n, n) for n, name in enumerate(VIOLATED)]
    log = write_log(folder / "run.jsonl", 3000)
    write_report(result(log, 3000, (*said, property_violation(45))), folder / "report.html")
    return folder / "report.html"


def canvas_of(driver: webdriver.Chrome) -> WebElement:
    return driver.find_element(By.ID, "canvas")


def shown(driver: webdriver.Chrome) -> tuple[float, float]:
    """Which part of the time the timeline shows, once it has drawn what is waiting."""
    driver.execute_async_script(
        "const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done))"
    )
    data = driver.execute_script("return {...document.getElementById('canvas').dataset}")
    return float(data["from"]), float(data["to"])


def offending(driver: webdriver.Chrome) -> list[WebElement]:
    return driver.find_elements(By.CSS_SELECTOR, "figure .offending")


def wheel(driver: webdriver.Chrome, x: int, delta: int) -> None:
    canvas = canvas_of(driver)
    driver.execute_script("arguments[0].scrollIntoView()", canvas)
    origin = ScrollOrigin.from_element(canvas, x, -60)
    ActionChains(driver).scroll_from_origin(origin, 0, delta).perform()


def test_the_page_renders_without_a_complaint_on_the_console(
    driver: webdriver.Chrome, page: Path
) -> None:
    opened(driver, page)
    assert complaints(driver) == []
    assert driver.find_element(By.CSS_SELECTOR, ".conclusion").text == "✗ 4 violations"
    rows = driver.find_elements(By.CSS_SELECTOR, "tbody tr")
    assert len(rows) == len(machines()) + 1
    drawn = "const c = document.getElementById('canvas'); const d = c.getContext('2d')"
    colours = driver.execute_script(
        f"{drawn}.getImageData(0, 0, c.width, c.height).data; const s = new Set();"
        "for (let i = 0; i < d.length; i += 4) s.add(d[i] << 16 | d[i + 1] << 8 | d[i + 2]);"
        "return s.size"
    )
    assert colours > 5


def test_the_wheel_zooms_about_the_pointer_and_a_drag_moves(
    driver: webdriver.Chrome, page: Path
) -> None:
    opened(driver, page)
    whole = shown(driver)
    wheel(driver, 100, -400)
    near = shown(driver)
    assert near[1] - near[0] < 0.8 * (whole[1] - whole[0])
    assert whole[0] < near[0] < near[1] < whole[1]
    canvas = canvas_of(driver)
    ActionChains(driver).move_to_element_with_offset(
        canvas, 100, -60
    ).click_and_hold().move_by_offset(-150, 0).release().perform()
    moved = shown(driver)
    assert moved[0] > near[0]
    assert moved[1] - moved[0] == pytest.approx(near[1] - near[0])
    wheel(driver, 100, 4000)
    assert shown(driver)[1] - shown(driver)[0] > near[1] - near[0]


def test_keys_zoom_move_and_show_everything(driver: webdriver.Chrome, page: Path) -> None:
    opened(driver, page)
    canvas = canvas_of(driver)
    whole = shown(driver)
    canvas.send_keys("+")
    canvas.send_keys("+")
    near = shown(driver)
    assert near[1] - near[0] == pytest.approx(0.36 * (whole[1] - whole[0]))
    canvas.send_keys(Keys.ARROW_RIGHT)
    assert shown(driver)[0] > near[0]
    canvas.send_keys("0")
    assert shown(driver) == pytest.approx(whole)


def test_a_clicked_violation_highlights_its_transition(
    driver: webdriver.Chrome, page: Path
) -> None:
    opened(driver, page)
    nodes = {machine.name: machine for machine in machines()}
    for number, name in enumerate(VIOLATED):
        driver.find_element(By.CSS_SELECTOR, f'[data-violation="{number}"]').click()
        article = driver.find_element(By.ID, f"violation-{number}")
        assert article.is_displayed()
        figures = [one for one in driver.find_elements(By.TAG_NAME, "figure") if one.is_displayed()]
        assert len(figures) == 1
        assert name in figures[0].get_attribute("textContent")
        keys = set(str(article.get_attribute("data-keys")).split())
        marked = offending(driver)
        ids = {str(one.get_attribute("id")) for one in marked} - {""}
        assert keys
        assert ids == keys
        states = nodes[name].states
        transitions = states[number % len(states)].transitions
        assert str(transitions[number % len(transitions)].position) in article.text
        seen = driver.execute_script(
            "const style = (what) => [...document.querySelectorAll(what)].map((one) => getComputedStyle(one));"
            "return [style('.offending .ground').map((one) => one.fill),"
            "style('.offending .line').map((one) => one.strokeWidth)]"
        )
        # BatteryLevelSkill's is taken at once and has no words: its arrow is all of it
        assert set(seen[0]) == (set() if name == "BatteryLevelSkill" else {"rgb(255, 215, 94)"})
        assert set(seen[1]) <= {"3.4px"}
        assert seen[0] or seen[1]


def test_a_recorded_fault_is_shown_where_its_model_owed_the_answer(
    driver: webdriver.Chrome, tmp_path: Path
) -> None:
    page = tmp_path / "report.html"
    run = ROOT / "tests" / "recordings" / "zenoh-T1.mcap"
    system = ROOT / "examples" / "lab_tour" / "system.xml"
    done = CliRunner().invoke(main, ["check", str(run), str(system), "--report", str(page)])
    assert done.exit_code == 1, done.output
    opened(driver, page)
    assert complaints(driver) == []
    violations = driver.find_elements(By.CSS_SELECTOR, ".violation")
    assert [one.find_element(By.TAG_NAME, "b").text for one in violations] == ["BatteryLevelSkill"]
    violations[0].click()
    assert "nothing in time" in driver.find_element(By.ID, "violation-0").text
    words = [one.get_attribute("textContent") for one in offending(driver)]
    assert "request tick" in words  # which the faulty skill takes, and does not answer


def test_each_repeat_can_be_reached_and_a_property_shows_its_values(
    driver: webdriver.Chrome, tmp_path: Path
) -> None:
    page = tmp_path / "report.html"
    run = ROOT / "tests" / "recordings" / "zenoh-T3.mcap"
    tour = ROOT / "examples" / "lab_tour"
    arguments = ["check", run, tour / "system.xml", "--properties", tour / "properties.yaml"]
    CliRunner().invoke(main, [*map(str, arguments), "--report", str(page)])
    opened(driver, page)
    assert driver.find_element(By.CSS_SELECTOR, ".conclusion").text == "✗ 3 violations"
    plot = driver.find_element(By.CSS_SELECTOR, "#violation-0 .plot svg")
    assert plot.is_displayed()
    assert plot.size["width"] > 200
    assert "battery < 30" in plot.text
    colour = "return getComputedStyle(document.querySelector('.plot .at')).stroke"
    assert driver.execute_script(colour) not in ("none", "rgb(0, 0, 0)")
    for number in (2, 1):  # the same, said once: links lead to each
        driver.execute_script(f"location.hash = 'violation-{number}'")
        chosen = driver.find_element(By.ID, f"violation-{number}")
        WebDriverWait(driver, 10).until(lambda _, chosen=chosen: chosen.is_displayed())
    assert complaints(driver) == []


def test_a_property_violation_shows_its_witness(driver: webdriver.Chrome, page: Path) -> None:
    opened(driver, page)
    driver.find_element(By.CSS_SELECTOR, '[data-violation="3"]').click()
    told = driver.find_element(By.ID, "violation-3").text
    assert "message on /BatteryComponent/level: {data: 28}" in told
    assert offending(driver) == []
    assert "There is no diagram" in driver.find_element(By.ID, "no-figure").text


def test_a_violation_can_be_chosen_on_the_timeline(driver: webdriver.Chrome, page: Path) -> None:
    opened(driver, page)
    canvas = canvas_of(driver)
    canvas.send_keys("n")
    chosen = '[data-violation="1"][aria-pressed="true"]'
    assert len(driver.find_elements(By.CSS_SELECTOR, chosen)) == 1
    where = driver.execute_script(
        "const c = document.getElementById('canvas'); const d = JSON.parse("
        "document.getElementById('data').textContent); const left = 230;"
        "const span = c.dataset.to - c.dataset.from; const mark = d.violations[2];"
        "return [left + (mark.t - c.dataset.from) / span * (c.clientWidth - left) - c.clientWidth / 2,"
        "24 + 24 * mark.row + 6 - c.clientHeight / 2]"
    )
    ActionChains(driver).move_to_element_with_offset(canvas, *map(round, where)).click().perform()
    assert driver.find_element(By.ID, "violation-2").is_displayed()


def test_pointing_at_a_message_tells_it(driver: webdriver.Chrome, tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    entry = {"topic": "/speech", "time": START_S + 30, "text": HOSTILE}
    log.write_text(json.dumps(entry) + "\n")
    write_report(result(log, 1, models=()), tmp_path / "report.html")
    opened(driver, tmp_path / "report.html")
    canvas = canvas_of(driver)
    where = driver.execute_script(
        "const c = document.getElementById('canvas'); const span = c.dataset.to - c.dataset.from;"
        "return 230 + (30e6 - c.dataset.from) / span * (c.clientWidth - 230) - c.clientWidth / 2"
    )
    row = canvas.size["height"] / 2
    ActionChains(driver).move_to_element_with_offset(
        canvas, round(where), round(24 + 9 - row)
    ).perform()
    tip = driver.find_element(By.ID, "tip")
    assert tip.is_displayed()
    assert "message on /speech" in tip.text
    assert "</script><script>alert" in tip.text
    assert complaints(driver) == []


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_the_page_follows_the_colours_that_its_reader_prefers(
    scheme: str, driver: webdriver.Chrome, page: Path
) -> None:
    feature = {"name": "prefers-color-scheme", "value": scheme}
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})
    opened(driver, page)
    pixel: list[Any] = driver.execute_script(
        "return [...document.getElementById('canvas').getContext('2d').getImageData(2, 2, 1, 1).data]"
    )
    assert (pixel[0] < 80) == (scheme == "dark")
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


@pytest.mark.parametrize("width", [360, 800])
def test_a_narrow_screen_shows_all_of_it_without_sideways_scrolling(
    width: int, driver: webdriver.Chrome, page: Path
) -> None:
    size = {"width": width, "height": 800, "deviceScaleFactor": 2, "mobile": True}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    try:
        opened(driver, page)
        reach = driver.execute_script("return document.documentElement.scrollWidth")
        assert reach <= width
        driver.find_element(By.CSS_SELECTOR, '[data-violation="0"]').click()
        assert offending(driver)
        assert complaints(driver) == []
    finally:
        driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_nothing_heard_is_a_page_too(driver: webdriver.Chrome, tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    log.write_text("\n{}\n")
    write_report(result(log, 0), tmp_path / "report.html")
    opened(driver, tmp_path / "report.html")
    assert complaints(driver) == []
    assert "Nothing was received." in driver.find_element(By.ID, "timeline").text
    canvas_of(driver).send_keys("+", "n", "0")
    assert complaints(driver) == []


def test_a_thousand_violations_are_told(driver: webdriver.Chrome, tmp_path: Path) -> None:
    nodes = machines()
    said = tuple(violation(nodes[n % len(nodes)], n * 0.05, n) for n in range(1000))
    log = write_log(tmp_path / "run.jsonl", 1000)
    write_report(result(log, 1000, said), tmp_path / "report.html")
    opened(driver, tmp_path / "report.html")
    assert len(driver.find_elements(By.CSS_SELECTOR, ".violation")) == 1000
    canvas = canvas_of(driver)
    canvas.send_keys("p")
    last = driver.find_element(By.CSS_SELECTOR, '[aria-pressed="true"]')
    assert last.get_attribute("data-violation") in ("0", "999")
    driver.execute_script("document.querySelector('[data-violation=\"999\"]').click()")
    assert driver.find_element(By.ID, "violation-999").is_displayed()
    assert complaints(driver) == []


def test_a_hundred_thousand_observations_are_painted_and_zoomed(
    driver: webdriver.Chrome, tmp_path: Path
) -> None:
    log = write_log(tmp_path / "run.jsonl", 100_000)
    write_report(result(log, 100_000, (violation(machines()[0], 5),)), tmp_path / "report.html")
    opened(driver, tmp_path / "report.html")  # waits a minute at most: more is a hang
    whole = shown(driver)
    canvas_of(driver).send_keys("+" * 12)
    near = shown(driver)
    assert near[1] - near[0] < (whole[1] - whole[0]) / 400
    WebDriverWait(driver, 5).until(lambda _: complaints(driver) == [])
