"""Makes ``report.png``: the page of ``moon check --report`` on a recorded fault.

Run it after a change of the page: ``python docs/images/report.py`` (needs Chromium, ``make browser``).
"""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(ROOT))

from tests.report.browser import browser, opened  # noqa: E402

RUN = (
    *("tests/recordings/zenoh-T4.mcap", "examples/lab_tour/system.xml"),
    *("--properties", "examples/lab_tour/properties.yaml"),
)
ZOOMED = (
    "const [canvas, done] = [document.getElementById('canvas'), arguments[0]];"
    "document.getElementById('timeline').scrollIntoView();"
    "for (let i = 0; i < 4; i++) canvas.dispatchEvent(new KeyboardEvent('keydown', {key: '+'}));"
    "requestAnimationFrame(() => requestAnimationFrame(done))"
)


SEEN_OF = HERE / "report.sha256"
"""The digest of the page that the picture is of; a test compares it with today's."""


def write_page(page: Path) -> str:
    """Check the recording; the page's digest, without how long it took."""
    moon = Path(sys.executable).with_name("moon")
    command = [str(moon), "check", *RUN, "--report", str(page)]
    subprocess.run(command, cwd=ROOT, check=False, stdout=subprocess.DEVNULL)
    text = re.sub(r"checked in [\d.]+ s", "", page.read_text(encoding="utf-8"))
    return hashlib.sha256(text.encode()).hexdigest()


def main() -> None:
    """Check the recording, open the page, and take the picture."""
    with tempfile.TemporaryDirectory() as folder, browser(1240, 1400) as driver:
        page = Path(folder) / "report.html"
        digest = write_page(page)
        opened(driver, page)
        driver.execute_async_script(ZOOMED)
        driver.save_screenshot(str(HERE / "report.png"))
    SEEN_OF.write_text(f"{digest}\n", encoding="ascii")


if __name__ == "__main__":
    main()
