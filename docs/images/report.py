"""Makes ``report.png``: the page of ``moon check --report`` on a recorded fault.

Run it after a change of the page: ``python docs/images/report.py`` (needs Chromium, ``make browser``).
"""

from __future__ import annotations

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


def main() -> None:
    """Check the recording, open the page, and take the picture."""
    with tempfile.TemporaryDirectory() as folder, browser(1240, 1400) as driver:
        page = Path(folder) / "report.html"
        moon = Path(sys.executable).with_name("moon")
        command = [str(moon), "check", *RUN, "--report", str(page)]
        subprocess.run(command, cwd=ROOT, check=False, stdout=subprocess.DEVNULL)
        opened(driver, page)
        driver.execute_async_script(ZOOMED)
        driver.save_screenshot(str(HERE / "report.png"))


if __name__ == "__main__":
    main()
