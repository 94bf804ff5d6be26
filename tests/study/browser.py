"""A headless Chromium without a network that remembers what goes wrong in a page."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any, Self

from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

FLAGS = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--host-resolver-rules=MAP * ~NOTFOUND", "--hide-scrollbars",
         "--disable-gpu")  # fmt: skip
HEIGHT = 900
KEEP_ERRORS = """
  window.wentWrong = [];
  for (const name of ["error", "unhandledrejection", "securitypolicyviolation"])
    addEventListener(name, (event) => window.wentWrong.push(String(event.message || event.reason || event.blockedURI)));
"""


class Browser:
    """A page in a window of some width, in light or dark."""

    def __init__(self, page: Path, width: int, theme: str) -> None:
        options = Options()
        options.binary_location = "/usr/bin/chromium"
        for flag in (*FLAGS, f"--window-size={width},{HEIGHT}"):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        self.driver = webdriver.Chrome(service=Service("/usr/bin/chromedriver"), options=options)
        self.page, self.theme = page.resolve(), theme
        size = {"width": width, "height": HEIGHT, "deviceScaleFactor": 1, "mobile": False}
        for command, arguments in (
            ("Emulation.setDeviceMetricsOverride", size),
            ("Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": theme}]}),
            ("Page.addScriptToEvaluateOnNewDocument", {"source": KEEP_ERRORS}),
        ):
            self.driver.execute_cdp_cmd(command, arguments)
        self.driver.get(self.page.as_uri())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.driver.quit()

    def js(self, source: str, *arguments: Any) -> Any:
        """Runs the body of a function; what it returns."""
        return self.driver.execute_script(source, *arguments)

    def settle(self) -> None:
        """Until what was asked for is drawn."""
        self.driver.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")

    def errors(self) -> list[str]:
        """Errors of scripts and of the console, and what the page asked for beyond itself."""
        severe = [e["message"] for e in self.driver.get_log("browser") if e["level"] == "SEVERE"]
        events = [json.loads(e["message"])["message"] for e in self.driver.get_log("performance")]
        urls = [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]
        own = (self.page.as_uri(), "data:", "blob:")
        return self.js("return window.wentWrong") + severe + [url for url in urls if not url.startswith(own)]

    def picture(self, selector: str) -> bytes:
        """PNG of an element, whole even if it is taller than the window."""
        clip = self.js("""const r = document.querySelector(arguments[0]).getBoundingClientRect();
          return {x: r.x + scrollX, y: r.y + scrollY, width: r.width, height: r.height, scale: 1};""", selector)
        shot = self.driver.execute_cdp_cmd("Page.captureScreenshot", {"captureBeyondViewport": True, "clip": clip})
        return base64.b64decode(shot["data"])
