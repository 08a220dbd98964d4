"""A headless Chromium that loads nothing but the page."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.support.ui import WebDriverWait

MISSING = (
    "no browser: the report's page is tested in `chromium` by `chromedriver` "
    "(`make browser`, or apt-get install chromium chromium-driver)"
)
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--disable-dev-shm-usage", "--hide-scrollbars"),
)


class MissingBrowserError(Exception):
    """There is no Chromium, or no driver of it, on this machine."""


@contextmanager
def browser(width: int = 1400, height: int = 1000) -> Iterator[webdriver.Chrome]:
    """A browser with a fresh profile; MissingBrowserError if there is none."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    driver_path = shutil.which("chromedriver")
    if chromium is None or driver_path is None:
        raise MissingBrowserError(MISSING)
    with tempfile.TemporaryDirectory(prefix="moon-report-") as profile:
        options = Options()
        options.binary_location = chromium
        for flag in (*FLAGS, f"--user-data-dir={profile}", f"--window-size={width},{height}"):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        driver = webdriver.Chrome(options=options, service=Service(driver_path))
        try:
            yield driver
        finally:
            driver.quit()


def opened(driver: webdriver.Chrome, page: Path) -> None:
    """Load ``page`` and wait until it is painted, with its timeline."""
    driver.get_log("browser")  # of the page before
    driver.get(page.resolve().as_uri())
    painted = (
        "return performance.getEntriesByName('timeline-painted').length"
        " && performance.getEntriesByName('first-contentful-paint').length"
    )
    WebDriverWait(driver, 60).until(lambda _: driver.execute_script(painted))


def complaints(driver: webdriver.Chrome) -> list[Any]:
    """What the console says is wrong."""
    return [entry for entry in driver.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")]


def painted_ms(driver: webdriver.Chrome) -> tuple[float, float]:
    """First contentful paint, and the timeline's first paint; from the start of navigation."""
    script = (
        "return [performance.getEntriesByName('first-contentful-paint')[0].startTime,"
        "performance.getEntriesByName('timeline-painted')[0].startTime]"
    )
    first, timeline = driver.execute_script(script)
    return float(first), float(timeline)
