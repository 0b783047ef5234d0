"""The page in a real browser, without a display and without a network. Oracle: our own picture from the same place.

Needs Chromium; SACHA_REQUIRE_BROWSER=1 turns its absence from a skip into a failure.
"""

from __future__ import annotations

import base64
import json
import os
import shutil
import socket
import subprocess
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from sacha_core.cli.common import HeadSource
from sacha_core.cli.sources import open_avatar
from sacha_core.cli.view import open_page
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.raster.camera import Camera
from sacha_core.raster.scene import render_avatar

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
LIMIT_S = 60.0
FOUND_S = 0.2
SIDE = 300  # pixels of the part of the page that is compared: the middle, which no panel covers
CANVAS = "(r => [r.x, r.y, r.width, r.height])(document.querySelector('canvas').getBoundingClientRect())"
LIKE_OURS = 0.93  # correlation of both pictures: browsers sort by depth and blend as we do, but in 8 bits and without our filter
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--window-size=1100,800", "--no-first-run",
    "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",
)  # fmt: skip


def browser() -> str:
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    if found is None:
        if os.environ.get("SACHA_REQUIRE_BROWSER", "") not in {"", "0"}:
            pytest.fail("SACHA_REQUIRE_BROWSER is set, but there is no Chromium")
        pytest.skip("no Chromium here (SACHA_REQUIRE_BROWSER=1 makes that a failure)")
    return found


def until(condition: Callable[[], Any], what: str) -> Any:
    end = time.monotonic() + LIMIT_S
    while not (value := condition()):
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(FOUND_S)
    return value


def free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return int(listener.getsockname()[1])


@dataclass
class Browser:
    """A page that a browser has open."""

    page: Any
    client: Any
    debugger: Any

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Ask the browser something by its debugger."""
        self.debugger.send(json.dumps({"id": 1, "method": method, "params": parameters}))
        while (answer := json.loads(self.debugger.recv(LIMIT_S))).get("id") != 1:
            pass
        return dict(answer["result"])

    def screenshot(self) -> np.ndarray:
        data = self.ask("Page.captureScreenshot")["data"]
        picture = Image.open(BytesIO(base64.b64decode(data))).convert("RGB")
        return np.asarray(picture) / np.float32(255)

    def camera(self) -> Camera:
        """Give the camera of the part of a screenshot that shows the avatar, in the middle of the page's canvas."""
        told = self.ask("Runtime.evaluate", expression=CANVAS, returnByValue=True)["result"]["value"]
        left, top, width, height = map(round, told)
        seen = self.client.camera
        focal = height / 2 / np.tan(seen.fov / 2)
        whole = Camera.look_at(np.array(seen.position), np.array(seen.look_at), width, height, focal)
        shown = whole.crop(width // 2 - SIDE // 2, height // 2 - SIDE // 2, SIDE, SIDE)
        self.part = (left + width // 2 - SIDE // 2, top + height // 2 - SIDE // 2)
        return shown

    def shown(self) -> np.ndarray:
        """Give what that camera shows."""
        left, top = self.part
        return self.screenshot()[top : top + SIDE, left : left + SIDE]


@contextmanager
def opened_page(avatar: Path, folder: Path) -> Iterator[tuple[Any, Browser]]:
    """Open an avatar's page and a browser that looks at it."""
    from websockets.sync.client import connect  # noqa: PLC0415  # comes with the page's own package

    opened = open_avatar(avatar, HeadSource())
    page = open_page(avatar.name, opened, "127.0.0.1", free_port())
    clients: list[Any] = []
    page.server.on_client_connect(clients.append)
    thread = threading.Thread(target=page.run)
    thread.start()
    port = free_port()
    where = (f"--user-data-dir={folder}", f"--remote-debugging-port={port}", f"http://127.0.0.1:{page.port}")
    process = subprocess.Popen([browser(), *FLAGS, *where], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        client = until(lambda: clients, "the browser")[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
            tabs = json.load(answer)
        address = next(tab["webSocketDebuggerUrl"] for tab in tabs if tab["type"] == "page")
        with connect(address, max_size=None) as debugger:
            yield opened, Browser(page, client, debugger)
    finally:
        process.terminate()
        process.wait(LIMIT_S)
        page.close()
        thread.join(LIMIT_S)
        assert not thread.is_alive()


def expected(opened: Any, frame: int, camera: Camera) -> np.ndarray:
    frames = triangle_frames(Poser(opened.head, opened.avatar.motion)(frame), opened.head.faces)
    return render_avatar(opened.avatar.gaussians, frames, camera).colour


def likeness(a: np.ndarray, b: np.ndarray) -> float:
    if a.std() == 0:  # an empty page, before the first picture
        return 0.0
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


@pytest.mark.slow
def test_a_browser_shows_the_face_as_we_draw_it(shown_avatar: Path, tmp_path: Path) -> None:
    browser()
    with opened_page(shown_avatar, tmp_path) as (opened, tab):
        until(lambda: np.allclose(tab.client.camera.look_at, tab.page.server.initial_camera.look_at), "the camera")

        def like(frame: int) -> float:
            camera = tab.camera()  # anew: the page may still be laying itself out
            return likeness(tab.shown(), expected(opened, frame, camera))

        assert until(lambda: like(0) > LIKE_OURS, "the face")
        camera = tab.camera()
        first, moved = expected(opened, 0, camera), expected(opened, 1, camera)
        tab.page.set(frame=1)
        assert likeness(first, moved) < LIKE_OURS, "the frames must differ for this to say anything"
        assert until(lambda: likeness(tab.shown(), moved) > LIKE_OURS, "the next frame")
        assert (tab.screenshot().std(axis=(0, 1)) > 0.04).all()  # a face and its controls, not an empty page
        tab.page.set(colours="by region")
        until(lambda: likeness(tab.shown(), moved) < LIKE_OURS, "the regions' colours")
        tab.page.set(colours="as it looks", jaw=0.3)
        opening = tab.page._gesture().turns["jaw"]
        assert opening == (0.3, 0.0, 0.0)
        tab.page.set(level="level 1")
        until(lambda: "KB" in tab.page._facts.content, "the level's size")
