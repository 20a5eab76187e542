"""Make the pictures of the live viewer: python -m docs.make_viewer_picture CHROMIUM [NAME ...]

Needs the packages playwright and Pillow, and the path of a Chromium or Chrome. All of them, or
those that are named.
"""

import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

from PIL import Image
from playwright.sync_api import sync_playwright

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "pictures"
PORT, LOADED, SETTLED = 8123, 60_000, 20_000  # ms: slow where the page is drawn without a GPU
WITHOUT_GPU = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WIDTH, HEIGHT, SCALE = 1100, 640, 1.4
MIDDLE = (0.5 * WIDTH, 0.5 * HEIGHT)  # where the robot's middle is drawn at first
# The page warns about software rendering, which does not belong in the picture.
DISMISS = "document.querySelectorAll('[class*=Notification]').forEach(one => one.remove())"


class Shot(NamedTuple):
    """A picture of the page: the actions on it, the zoom, and the crop [pixels]."""

    problem: str
    left: float
    height: float
    nearer: int
    act: Callable[[Any], None]


def look(page: Any) -> None:
    """Only wait for the robot to arrive."""
    page.wait_for_timeout(SETTLED)


def steer(page: Any) -> None:
    """Set the target of the vertical inertia to 1.9 times."""
    page.get_by_role("tab", name="Steer").click()
    row = page.locator("label:text-is('zz times')").locator("xpath=ancestor::*[.//input][1]")
    box = row.locator("input").last
    box.fill("1.9")
    box.press("Enter")
    page.mouse.move(WIDTH - 20, HEIGHT - 5)  # away, so that no hint is shown
    page.wait_for_timeout(SETTLED)


def pull(page: Any) -> None:
    """Pull the trunk to the robot's left."""
    x, y = MIDDLE[0], MIDDLE[1] - 0.16 * HEIGHT
    page.mouse.move(x, y)
    page.wait_for_timeout(3_000)
    page.keyboard.down("Shift")
    page.mouse.down()
    for k in range(1, 9):
        page.mouse.move(x + 7 * k, y)
        page.wait_for_timeout(500)
    page.wait_for_timeout(3_000)


SHOTS: Mapping[str, Shot] = {
    "viewer": Shot("safe_reach_g1", 270, HEIGHT, 1, look),
    "viewer_steer": Shot("shape_standing_g1", 390, 525, 2, steer),
    "viewer_torque": Shot("push_g1", 390, HEIGHT, 2, pull),
}


@contextmanager
def viewed(problem: str) -> Iterator[None]:
    """Show a problem in the viewer."""
    file = ROOT / "problems" / f"{problem}.yaml"
    command = [sys.executable, "-m", "wbc", "view", str(file), "--port", str(PORT)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as viewer:
        try:
            next(line for line in viewer.stdout or () if "http" in line)
            yield
        finally:
            viewer.terminate()


def main(browser: str, *names: str) -> None:
    """Make the pictures of these names, or all."""
    for name in names or SHOTS:
        shot = SHOTS[name]
        with viewed(shot.problem), sync_playwright() as playwright:
            window = playwright.chromium.launch(executable_path=browser, args=[*WITHOUT_GPU])
            page = window.new_page(
                viewport={"width": WIDTH, "height": HEIGHT}, device_scale_factor=SCALE
            )
            page.set_default_timeout(3 * LOADED)
            page.goto(f"http://localhost:{PORT}")
            page.wait_for_timeout(LOADED)
            page.evaluate(DISMISS)
            page.mouse.move(*MIDDLE)
            for _ in range(shot.nearer):
                page.mouse.wheel(0, -100)
                page.wait_for_timeout(1_000)
            shot.act(page)
            clip = {"x": shot.left, "y": 0, "width": WIDTH - shot.left, "height": shot.height}
            image = Image.open(BytesIO(page.screenshot(clip=clip)))
            window.close()
        image.convert("RGB").quantize(256).save(FOLDER / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
