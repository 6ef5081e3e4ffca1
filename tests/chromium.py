"""Headless Chromium, for the tests and benches that open our pages as a person does. What is looked at is theirs."""

from __future__ import annotations

import shutil
from typing import Any

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--window-size=1300,1000",
)


def ready(browser: Any) -> None:
    """Wait until the page shows its data."""
    from selenium.webdriver.support.ui import WebDriverWait

    WebDriverWait(browser, 60).until(
        lambda one: one.execute_script("return document.documentElement.dataset.ready") == "yes"
    )


def chromium() -> Any | None:
    """A selenium driver, its console kept; to be `quit`. None where selenium, chromium or chromedriver is missing."""
    driver = shutil.which("chromedriver")
    if not (driver and shutil.which("chromium")):
        return None
    try:
        from selenium import webdriver
    except ImportError:
        return None
    options = webdriver.ChromeOptions()
    for flag in FLAGS:
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    return webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
