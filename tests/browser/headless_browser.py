"""A real headless Chromium, driven by chromedriver over HTTP (W3C WebDriver), without a library."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

PATIENCE_S = 60.0
ELEMENT = "element-6066-11e4-a52e-4f735466cecf"
DOCS = Path(__file__).parents[2] / "docs"
DESKTOP, PHONE = (1400, 1100), (390, 844)
TOOLS = ("chromium", "chromedriver")


def missing_tools() -> list[str]:
    return [tool for tool in TOOLS if shutil.which(tool) is None]


class Browser:
    """One chromedriver with one window."""

    def __init__(self, folder: Path, size: tuple[int, int] = DESKTOP) -> None:
        """folder: for the profile and the driver's log. What the page shows runs at normal priority, the
        browser at a lower one: it draws without a graphics card."""
        log = folder / "chromedriver.log"
        self._driver = subprocess.Popen(
            ["nice", "-n", "10", "chromedriver", "--port=0", f"--log-path={log}"],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._driver.stdout is not None
        line = next(line for line in self._driver.stdout if "started successfully on port" in line)
        port = line.rstrip(".\n").rsplit(" ", 1)[1]
        self._root = f"http://127.0.0.1:{port}"
        arguments = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        arguments += [f"--user-data-dir={folder / 'profile'}", f"--window-size={size[0]},{size[1]}"]
        options = {"args": arguments, "binary": shutil.which("chromium")}
        wanted = {
            "browserName": "chrome",
            "goog:chromeOptions": options,
            "goog:loggingPrefs": {"browser": "ALL"},
        }
        session = self._call("POST", "/session", {"capabilities": {"alwaysMatch": wanted}})
        self._root += f"/session/{session['sessionId']}"
        self.resize(size)

    def open(self, url: str) -> None:
        self._call("POST", "/url", {"url": url})

    def resize(self, size: tuple[int, int]) -> None:
        """Set the size of the page itself, as a phone of that width has it."""
        metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": size[0] < 600}
        self.devtools("Emulation.setDeviceMetricsOverride", metrics)

    def devtools(self, method: str, parameters: dict[str, Any]) -> Any:
        return self._call("POST", "/goog/cdp/execute", {"cmd": method, "params": parameters})

    def run(self, script: str) -> Any:
        """The value that a JavaScript function body returns."""
        return self._call("POST", "/execute/sync", {"script": script, "args": []})

    def text(self, selector: str) -> str:
        return str(self.run(f"return document.querySelector({json.dumps(selector)}).textContent"))

    def click(self, selector: str) -> None:
        """Click as a person does: scrolled into view, and only where nothing covers it."""
        found = self._call("POST", "/element", {"using": "css selector", "value": selector})
        self._call("POST", f"/element/{found[ELEMENT]}/click", {})

    def press_keys(self, selector: str, keys: str) -> None:
        found = self._call("POST", "/element", {"using": "css selector", "value": selector})
        self._call("POST", f"/element/{found[ELEMENT]}/value", {"text": keys})

    def until(self, condition: Callable[[], bool], what: str, *shown: str) -> None:
        """Wait. shown: selectors whose texts are in the error when the condition does not hold in time."""
        end_s = time.monotonic() + PATIENCE_S
        while not condition():
            if time.monotonic() > end_s:
                texts = [" ".join(self.text(one).split()) for one in shown]
                raise AssertionError(f"not within {PATIENCE_S:g} s: {what}; {texts} {self.console_errors()}")
            time.sleep(0.02)

    def picture_for_docs(self, name: str) -> None:
        """Write the whole page, at the width of a desktop and of a phone, as docs/NAME.jpg and
        docs/NAME-phone.jpg when $PALPATE_PICTURES is set: `make console-pictures`."""
        if "PALPATE_PICTURES" in os.environ:
            for size, suffix in ((PHONE, "-phone"), (DESKTOP, "")):
                self.resize(size)
                time.sleep(0.5)  # until the next event is drawn
                self.run("window.scrollTo(0, 0)")
                taken = {"captureBeyondViewport": True, "format": "jpeg", "quality": 80}
                data = self.devtools("Page.captureScreenshot", taken)["data"]
                (DOCS / f"{name}{suffix}.jpg").write_bytes(base64.b64decode(data))

    def console_errors(self) -> list[str]:
        """Return the errors that the page logged, refusals by the security policy included."""
        entries = self._call("POST", "/se/log", {"type": "browser"})
        return [entry["message"] for entry in entries if entry["level"] == "SEVERE"]

    def close(self) -> None:
        try:
            self._call("DELETE", "", None)
        finally:
            self._driver.terminate()
            self._driver.communicate()

    def _call(self, method: str, path: str, body: dict[str, Any] | None) -> Any:
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self._root + path, data, method=method)
        request.add_header("Content-Type", "application/json")
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE_S) as response:
                return json.load(response)["value"]
        except urllib.error.HTTPError as error:
            raise AssertionError(json.load(error)["value"]["message"].splitlines()[0]) from None
