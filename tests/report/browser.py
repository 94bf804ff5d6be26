"""A headless Chromium without a network that keeps what goes wrong in a page."""

from __future__ import annotations

import base64
import io
import json
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--host-resolver-rules=MAP * ~NOTFOUND",
    "--hide-scrollbars",
)
WITH_WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WITHOUT_WEBGL = ("--disable-3d-apis",)
HEIGHT = 900
KEEP_ERRORS = """
  window.wentWrong = [];
  const keep = (what) => window.wentWrong.push(String(what));
  addEventListener("error", (event) => keep(event.message));
  addEventListener("unhandledrejection", (event) => keep(event.reason));
  addEventListener("securitypolicyviolation", (event) => keep(`not allowed: ${event.blockedURI}`));
"""


class Browser:
    """A page in a window of some width, in light or dark."""

    def __init__(self, page: Path, width: int, theme: str, webgl: bool = True) -> None:
        options = Options()
        options.binary_location = "/usr/bin/chromium"
        for flag in (
            *FLAGS,
            *(WITH_WEBGL if webgl else WITHOUT_WEBGL),
            f"--window-size={width},{HEIGHT}",
        ):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        self.driver = webdriver.Chrome(service=Service("/usr/bin/chromedriver"), options=options)
        self.page = page.resolve()
        self.width = width
        self.theme = theme
        size = {"width": width, "height": HEIGHT, "deviceScaleFactor": 1, "mobile": False}
        scheme = {"features": [{"name": "prefers-color-scheme", "value": theme}]}
        self.devtools("Emulation.setDeviceMetricsOverride", size)
        self.devtools("Emulation.setEmulatedMedia", scheme)
        self.devtools("Page.addScriptToEvaluateOnNewDocument", {"source": KEEP_ERRORS})
        self.driver.get(self.page.as_uri())

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_: object) -> None:
        self.driver.quit()

    def devtools(self, command: str, arguments: dict[str, Any]) -> dict[str, Any]:
        return self.driver.execute_cdp_cmd(command, arguments)

    def js(self, source: str, *arguments: Any) -> Any:
        """Runs the body of a function; what it returns."""
        return self.driver.execute_script(source, *arguments)

    def errors(self) -> list[str]:
        """Errors of scripts and of the console since the page was opened."""
        severe = [e["message"] for e in self.driver.get_log("browser") if e["level"] == "SEVERE"]
        return self.js("return window.wentWrong") + severe

    def requests(self) -> list[str]:
        """What the page asked for beyond itself."""
        events = [json.loads(e["message"])["message"] for e in self.driver.get_log("performance")]
        sent = [
            e["params"]["request"]["url"]
            for e in events
            if e["method"] == "Network.requestWillBeSent"
        ]
        own = (self.page.as_uri(), "data:", "blob:")
        return [url for url in sent if not url.startswith(own)]

    def picture(self, selector: str) -> bytes:
        """PNG of an element, whole even where it is taller than the window."""
        box = self.js(
            "const r = document.querySelector(arguments[0]).getBoundingClientRect();"
            "return {x: r.x + scrollX, y: r.y + scrollY, width: r.width, height: r.height};",
            selector,
        )
        clip = {**box, "scale": 1}
        shot = self.devtools(
            "Page.captureScreenshot", {"captureBeyondViewport": True, "clip": clip}
        )
        return base64.b64decode(shot["data"])

    def canvas_pixels(self, selector: str) -> np.ndarray:
        """What is seen of a canvas, scrolled into view."""
        element = self.driver.find_element("css selector", selector)
        self.js("arguments[0].scrollIntoView({block: 'center', behavior: 'instant'})", element)
        return matplotlib.image.imread(io.BytesIO(element.screenshot_as_png))
