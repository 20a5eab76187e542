"""Make the picture of the live viewer: python -m docs.make_viewer_picture CHROMIUM

Needs the packages playwright and Pillow, and the path of a Chromium or Chrome.
"""

import subprocess
import sys
from io import BytesIO
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

ROOT = Path(__file__).parents[1]
PROBLEM = ROOT / "problems" / "safe_reach_g1.yaml"
PICTURE = ROOT / "docs" / "pictures" / "viewer.png"
PORT, LOADED = 8123, 60_000  # ms: meshes come slowly where the page is drawn without a GPU
WITHOUT_GPU = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
# The page says that it is drawn in software, which is not what the picture is about.
DISMISS = "document.querySelectorAll('[class*=Notification]').forEach(one => one.remove())"


def main(browser: str) -> None:
    command = [sys.executable, "-m", "wbc", "view", str(PROBLEM), "--port", str(PORT)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as viewer:
        try:
            next(line for line in viewer.stdout if "http" in line)
            with sync_playwright() as playwright:
                window = playwright.chromium.launch(executable_path=browser, args=WITHOUT_GPU)
                page = window.new_page(viewport={"width": 1200, "height": 720})
                page.goto(f"http://localhost:{PORT}")
                page.wait_for_timeout(LOADED)
                page.evaluate(DISMISS)
                image = Image.open(BytesIO(page.screenshot()))
                window.close()
        finally:
            viewer.terminate()
    image.convert("RGB").quantize(256).save(PICTURE, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1])
