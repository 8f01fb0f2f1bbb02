"""Draw the picture of ``fieldgym open`` for the docs: the real page, in a headless Chromium.

    python docs/page.py

Needs Debian's chromium and chromium-driver. The log is simulated: a pendulum with dry friction.
"""

import re
import subprocess
import sys
import tempfile
import time
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from fieldmodels.recording.files import save_recording
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

PICTURE = Path(__file__).parent / "pictures" / "open.webp"


def browser() -> webdriver.Chrome:
    """A window of 1000 by 1000 pixels."""
    options = webdriver.ChromeOptions()
    options.binary_location = "/usr/bin/chromium"
    for flag in ("--headless=new", "--no-sandbox", "--window-size=1000,1000", "--hide-scrollbars"):
        options.add_argument(flag)
    return webdriver.Chrome(options=options, service=webdriver.ChromeService("/usr/bin/chromedriver"))


def main() -> None:
    """Open a log, have it diagnosed, keep what is seen from the sliders' heading on."""
    with tempfile.TemporaryDirectory() as name:
        log, hidden = Path(name) / "bench.csv", {"coulomb_friction": {"torque": 0.1}}
        made = synthesise(
            get_model("pendulum"), hidden, "mixed", duration=20.0, step=0.01, amplitude=0.6,
            rng=np.random.default_rng(4),
        )  # fmt: skip
        save_recording(made, log)
        command = [str(Path(sys.executable).with_name("fieldgym")), "open", str(log), "--no-browser"]
        page = subprocess.Popen([*command, "--out", name], stdout=subprocess.PIPE, text=True)
        window = browser()
        try:
            found = next(m for line in page.stdout or () if (m := re.search(r"http://\S+", line)))
            window.get(found[0])
            find = lambda one: window.find_element(By.ID, one)  # noqa: E731
            wait = WebDriverWait(window, 300, 0.3)
            wait.until(lambda _: window.find_elements(By.CSS_SELECTOR, "#model option"))
            find("model").send_keys("pend")
            find("choose").submit()
            wait.until(lambda _: find("columns").is_displayed())
            find("columns").submit()
            wait.until(lambda _: find("try").is_displayed())
            time.sleep(2.0)  # the curves are drawn
            window.execute_script("document.getElementById('try').scrollIntoView()")
            picture = Image.open(BytesIO(window.get_screenshot_as_png())).convert("RGB")
            picture.crop((0, 0, 1000, 680)).save(PICTURE, quality=80)
        finally:
            window.quit()
            page.terminate()


if __name__ == "__main__":
    main()
