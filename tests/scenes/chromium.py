# SPDX-License-Identifier: Apache-2.0
"""Headless Chromium by its DevTools protocol over a pipe: real input events, screenshots, what the console said."""

import base64
import json
import os
import shutil
import subprocess
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome")
ANSWER_S = 120


def executable() -> str | None:
    """Chromium on this machine; COTTON3DG_CHROMIUM names another one."""
    return os.environ.get("COTTON3DG_CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)


class PageGone(AssertionError):
    """The page that was asked has given way to another one."""


class Browser:
    """One page. Closed as a context manager."""

    def __init__(self, profile: Path, *, webgl: bool = True):
        to_browser, self._input = os.pipe()
        self._output, from_browser = os.pipe()
        graphics = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"] if webgl else [
            "--disable-gpu", "--disable-3d-apis"
        ]  # fmt: skip

        def pipes() -> None:
            # Via high numbers, for one of the pipes may itself be 3 or 4.
            high = os.dup2(to_browser, 100), os.dup2(from_browser, 101)
            for number, handle in zip((3, 4), high, strict=True):
                os.dup2(handle, number)

        self._process = subprocess.Popen(
            [executable() or "chromium", "--headless=new", "--no-sandbox", "--disable-dev-shm-usage",
             "--remote-debugging-pipe", f"--user-data-dir={profile}", "--no-first-run", "--hide-scrollbars",
             "--disable-background-networking", "--disable-component-update", "--disable-extensions", *graphics,
             "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, close_fds=False,
            preexec_fn=pipes,  # noqa: PLW1509 - there are no threads
        )  # fmt: skip
        os.close(to_browser)
        os.close(from_browser)
        self._buffer, self._last = b"", 0
        self._session: str | None = None
        self.complaints: list[str] = []
        """Errors of the console, and exceptions."""
        self.requests: list[str] = []
        """Addresses that the page asked for."""
        targets = self._ask("Target.getTargets")["targetInfos"]
        page = next(target["targetId"] for target in targets if target["type"] == "page")
        self._session = self._ask("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self._ask(f"{domain}.enable")

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._input)
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._output)

    def open(self, page: Path | str, width: int = 1280, height: int = 900, *, dark: bool = False) -> None:
        """Show a file or an address."""
        self._ask(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 500
        )
        self._ask("Emulation.setTouchEmulationEnabled", enabled=width < 500)
        self.colours(dark=dark)
        self.requests.clear()
        self._ask("Page.navigate", url=page if isinstance(page, str) else page.resolve().as_uri())
        self.wait("document.readyState === 'complete'")

    def colours(self, *, dark: bool) -> None:
        theme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self._ask("Emulation.setEmulatedMedia", features=[theme])

    def downloads_to(self, folder: Path) -> None:
        """Where the page's downloads go."""
        self._ask("Page.setDownloadBehavior", behavior="allow", downloadPath=str(folder))

    def on_paper(self, *, on: bool = True) -> None:
        """Show the page as it is printed."""
        self._ask("Emulation.setEmulatedMedia", media="print" if on else "")

    def printed(self) -> bytes:
        return base64.b64decode(self._ask("Page.printToPDF", printBackground=False)["data"])

    def value(self, expression: str) -> Any:
        """What a JavaScript expression is."""
        answer = self._ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise AssertionError(f"{expression}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def wait(self, expression: str, seconds: float = 60) -> None:
        """Until the expression is true; what a page cannot say because another one takes its place is not true yet."""
        end = time.monotonic() + seconds
        while True:
            with suppress(PageGone):
                if self.value(expression):
                    return
            if time.monotonic() > end:
                raise AssertionError(f"not within {seconds} s: {expression}")
            time.sleep(0.1)

    def middle(self, selector: str) -> tuple[float, float]:
        """Scroll an element into view; its middle in px."""
        box = self.value(
            f"(e => {{ e.scrollIntoView({{block: 'center'}}); const b = e.getBoundingClientRect();"
            f" return [b.x + b.width / 2, b.y + b.height / 2]; }})(document.querySelector({json.dumps(selector)}))"
        )
        return box[0], box[1]

    def move(self, x: float, y: float, *, pressed: bool = False) -> None:
        buttons = {"button": "left", "buttons": 1} if pressed else {}
        self._ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, **buttons)

    def press(self, x: float, y: float) -> None:
        self._mouse("mousePressed", x, y, buttons=1)

    def release(self, x: float, y: float) -> None:
        self._mouse("mouseReleased", x, y, buttons=0)

    def wheel(self, x: float, y: float, down_px: float) -> None:
        """A notch of the wheel."""
        self._ask("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=down_px)

    def touches(self, kind: str, *fingers: tuple[float, float]) -> None:
        """touchStart, touchMove or touchEnd of all fingers."""
        points = [{"x": x, "y": y, "id": n} for n, (x, y) in enumerate(fingers)]
        self._ask("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    def swipe(self, x: float, y: float, down_px: float) -> None:
        """A finger that goes down, along the screen and up."""
        self.touches("touchStart", (x, y))
        for step in range(1, 11):
            self.touches("touchMove", (x, y + down_px * step / 10))
        self.touches("touchEnd")

    def click(self, x: float, y: float) -> None:
        self.move(x, y)
        self.press(x, y)
        self.release(x, y)

    def drop(self, file: Path, x: float, y: float) -> None:
        """A file that is dragged over the page and let go there."""
        data = {"items": [], "files": [str(file.resolve())], "dragOperationsMask": 1}
        for kind in ("dragEnter", "dragOver", "drop"):
            self._ask("Input.dispatchDragEvent", type=kind, x=x, y=y, data=data)

    def write(self, text: str) -> None:
        """Type a text into what has the focus."""
        self._ask("Input.insertText", text=text)

    def key(self, name: str) -> None:
        codes = {"Enter": 13, "Escape": 27, "ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, "Tab": 9}
        text = {"text": "\r"} if name == "Enter" else {}
        for kind in ("keyDown", "keyUp"):
            extra = text if kind == "keyDown" else {}
            self._ask("Input.dispatchKeyEvent", type=kind, key=name, windowsVirtualKeyCode=codes[name], **extra)

    def screenshot(self, selector: str | None = None, *, whole: bool = False) -> bytes:
        """PNG of the screen, of an element, or of the whole page."""
        extra: dict[str, Any] = {}
        if selector:
            self.middle(selector)
            box = self.value(
                f"(b => [b.x + scrollX, b.y + scrollY, b.width, b.height])"
                f"(document.querySelector({json.dumps(selector)}).getBoundingClientRect())"
            )
            extra["clip"] = dict(zip(("x", "y", "width", "height"), box, strict=True)) | {"scale": 1}
        return base64.b64decode(
            self._ask("Page.captureScreenshot", format="png", captureBeyondViewport=whole, **extra)["data"]
        )

    def _mouse(self, kind: str, x: float, y: float, buttons: int) -> None:
        self._ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=buttons, clickCount=1)

    def _ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._last += 1
        message = {"id": self._last, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._input, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._read()
            if answer.get("id") == self._last:
                if "error" in answer:
                    kind = PageGone if "navigated" in answer["error"]["message"] else AssertionError
                    raise kind(f"{method}: {answer['error']}")
                return answer["result"]
            self._note(answer)

    def _read(self) -> dict[str, Any]:
        import select

        while b"\0" not in self._buffer:
            if not select.select([self._output], [], [], ANSWER_S)[0]:
                raise AssertionError("Chromium does not answer")
            part = os.read(self._output, 1 << 20)
            if not part:
                raise AssertionError("Chromium has ended")
            self._buffer += part
        message, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(message)

    def _note(self, event: dict[str, Any]) -> None:
        what, about = event.get("method"), event.get("params", {})
        if what == "Runtime.consoleAPICalled" and about["type"] in ("error", "assert"):
            self.complaints.append(" ".join(str(item.get("value", item.get("description"))) for item in about["args"]))
        elif what == "Runtime.exceptionThrown":
            self.complaints.append(json.dumps(about["exceptionDetails"])[:500])
        elif what == "Log.entryAdded" and about["entry"]["level"] == "error":
            self.complaints.append(about["entry"]["text"])
        elif what == "Network.requestWillBeSent":
            self.requests.append(about["request"]["url"][:200])
