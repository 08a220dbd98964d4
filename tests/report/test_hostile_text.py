"""A report whose every text is hostile: it is shown as text, runs nothing and makes no element."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from selenium import webdriver
from selenium.common.exceptions import NoAlertPresentException
from selenium.webdriver.common.by import By

from m2c.printable import printable
from tests.report.browser import MissingBrowserError, browser, complaints, opened
from tests.report.hostile import TEXTS, harmless, write_hostile_report

ELEMENTS = """return [...document.querySelectorAll('*')].map((one) =>
    [one.namespaceURI, one.localName, ...one.getAttributeNames().sort()].join(' '))"""


@pytest.fixture(scope="module")
def driver() -> Iterator[webdriver.Chrome]:
    try:
        with browser() as found:
            yield found
    except MissingBrowserError as error:
        pytest.skip(str(error))


def require_nothing_ran(driver: webdriver.Chrome) -> None:
    with pytest.raises(NoAlertPresentException):
        driver.switch_to.alert.accept()
    assert driver.execute_script("return window.__pwned") is None


def elements_of(driver: webdriver.Chrome) -> Counter[str]:
    return Counter(driver.execute_script(ELEMENTS))


def every_violation(driver: webdriver.Chrome) -> None:
    """Look at all that the page can show."""
    for button in driver.find_elements(By.CSS_SELECTOR, ".violation"):
        button.click()
        require_nothing_ran(driver)


@pytest.mark.parametrize("number", range(len(TEXTS)))
def test_hostile_text_in_every_slot_runs_nothing_and_makes_no_element(
    number: int, driver: webdriver.Chrome, tmp_path: Path
) -> None:
    text = TEXTS[number]
    opened(driver, write_hostile_report(harmless(text), tmp_path / "harmless"))
    every_violation(driver)
    expected = elements_of(driver)
    opened(driver, write_hostile_report(text, tmp_path / "hostile"))
    require_nothing_ran(driver)
    every_violation(driver)
    assert elements_of(driver) == expected
    assert complaints(driver) == []
    assert driver.find_elements(By.CSS_SELECTOR, "figure svg .transition")
    words = driver.execute_script("return document.body.textContent")
    assert printable(text) in words
    assert all(c.isprintable() or c == "\n" for c in words)


def test_a_script_that_got_into_the_page_all_the_same_is_not_run(
    driver: webdriver.Chrome, tmp_path: Path
) -> None:
    page = write_hostile_report("x", tmp_path / "page")
    intruder = "<script>window.__pwned=1</script><img src=x onerror='window.__pwned=1'>"
    written = page.read_text(encoding="utf-8")
    page.write_text(written.replace("<body>", f"<body>{intruder}"), encoding="utf-8")
    opened(driver, page)
    require_nothing_ran(driver)
    refused = [entry["message"] for entry in complaints(driver)]
    assert any("script" in message and "Content Security Policy" in message for message in refused)
    assert len(driver.find_elements(By.CSS_SELECTOR, ".violation")) == 3  # and the page works


@pytest.mark.parametrize("text", TEXTS)
def test_nothing_that_a_terminal_or_html_obeys_is_in_the_file(text: str, tmp_path: Path) -> None:
    page = write_hostile_report(text, tmp_path / "page").read_text(encoding="utf-8")
    assert all(c.isprintable() or c == "\n" for c in page)
    data = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert data is not None
    assert set(data[1]) & set("<>&") == set()
    assert page.lower().count("<script") == 3
