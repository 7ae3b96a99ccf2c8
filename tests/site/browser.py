"""Chromium without a window, driven over a pipe by its DevTools protocol: no package is needed."""

import base64
import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--allow-file-access-from-files",
    "--remote-debugging-pipe",
)


class Browser:
    """One Chromium with one page; use it in a `with` block."""

    def __enter__(self) -> "Browser":
        assert CHROMIUM is not None
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        (to_read, self._to), (self._from, to_write) = os.pipe(), os.pipe()
        for end in (to_read, to_write):
            os.set_inheritable(end, True)
        # Chromium reads from 3 and writes to 4
        pipes = f"exec {CHROMIUM} {' '.join(OPTIONS)} --user-data-dir={self._profile.name} about:blank"
        self._process = subprocess.Popen(
            ["bash", "-c", f"exec 3<&{to_read} 4>&{to_write}; {pipes}"],
            pass_fds=(to_read, to_write),
            stderr=subprocess.DEVNULL,
        )
        os.close(to_read)
        os.close(to_write)
        self._buffer, self._count, self._session = b"", 0, ""
        self.problems = list[str]()
        """What the page wrote to its console as an error, or could not load."""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        return self

    def __exit__(self, *error: object) -> None:
        self._process.terminate()
        self._process.wait(30)
        os.close(self._to)
        os.close(self._from)
        self._profile.cleanup()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        self._count += 1
        message: dict[str, Any] = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._count:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            part = os.read(self._from, 1 << 20)
            assert part, "Chromium ended"
            self._buffer += part
        line, _, self._buffer = self._buffer.partition(b"\0")
        message = json.loads(line)
        self._note(message.get("method", ""), message.get("params", {}))
        return message

    def _note(self, event: str, of: dict[str, Any]) -> None:
        if event == "Runtime.exceptionThrown":
            self.problems.append(str(of["exceptionDetails"].get("exception", {}).get("description", of)))
        elif event == "Runtime.consoleAPICalled" and of["type"] in ("error", "assert"):
            self.problems.append(str([each.get("value", each) for each in of["args"]]))
        elif event == "Log.entryAdded" and of["entry"]["level"] == "error":
            self.problems.append(f"{of['entry']['text']} {of['entry'].get('url', '')}")
        elif event == "Network.requestWillBeSent" and of["request"]["url"].startswith(("http", "ws", "//")):
            self.problems.append(f"from the network: {of['request']['url'][:200]}")
        elif event == "Page.loadEventFired":
            self._loaded = True

    def open(self, page: Path, width: int, *, dark: bool = False) -> None:
        """Open a file in a window of a width [px], and wait until it is loaded."""
        self.problems.clear()
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self._loaded = False
        self.call("Page.navigate", url=page.as_uri())
        while not self._loaded:
            self._next()
        self.run("document.fonts.ready.then(() => new Promise(r => setTimeout(r, 150)))")

    def run(self, script: str) -> Any:
        """Return the value of an expression of JavaScript in the page."""
        out = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in out, out
        return out["result"].get("value")

    def picture(self, path: Path) -> None:
        """Write the whole page as PNG."""
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": min(size["height"], 12_000), "scale": 1}
        shot = self.call("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)
        path.write_bytes(base64.b64decode(shot["data"]))
