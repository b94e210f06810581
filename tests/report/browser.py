"""A real browser without a window, for tests of pages; tests are skipped, in words, where there is none."""

import contextlib
import json
import shutil

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
WAIT_S = 120


def programs():
    """Return the paths of (browser, driver); skips the test where one is missing."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    driver = shutil.which("chromedriver")
    if not browser or not driver:
        pytest.skip("no Chromium with chromedriver here (Debian: apt-get install chromium chromium-driver)")
    return browser, driver


@contextlib.contextmanager
def opened(width, height, touch=False):
    """Yield a selenium driver with a window of so many pixels, a phone's where ``touch``."""
    browser, driver = programs()
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = browser
    flags = (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        f"--window-size={width},{height}",
    )
    for flag in flags:
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    if touch:
        metrics = {"width": width, "height": height, "pixelRatio": 2.0, "touch": True}
        options.add_experimental_option("mobileEmulation", {"deviceMetrics": metrics})
    window = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    try:
        yield window
    finally:
        window.quit()


def wait(window, script, *arguments):
    """Return what a script returns as soon as it is true; fails with the script where it never is."""
    from selenium.webdriver.support.ui import WebDriverWait

    return WebDriverWait(window, WAIT_S, 0.1).until(lambda w: w.execute_script(script, *arguments), f"never: {script}")


def complaints(window):
    """Return what the browser has to complain of: errors of scripts, files that are missing."""
    return [entry["message"] for entry in window.get_log("browser") if entry["level"] == "SEVERE"]


def requests(window):
    """Return the addresses that the browser has asked for since this was last called."""
    messages = [json.loads(entry["message"])["message"] for entry in window.get_log("performance")]
    return [m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"]
