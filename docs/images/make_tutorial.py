#!/usr/bin/env python3
"""Takes the pictures of docs/tutorial.md and docs/explanation/trust.md from pages of the tool. No test runs it.

It needs Playwright, Pillow and a Chromium.

    make build
    python3 docs/images/make_tutorial.py [TOOL] [CHROMIUM]

TOOL is the tool (build/bin/tokid unless given), CHROMIUM the browser (/usr/bin/chromium unless given).
"""
# SPDX-License-Identifier: BSD-3-Clause

import io
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
# Section of the report page → name of the picture
SECTIONS = {"verdict": "report-verdict", "checks": "report-checks", "outputs": "report-outputs", "order": "report-order",
            "poles": "report-eigenvalues", "responses": "report-responses"}


def pages(tool, folder):
    """The pages that the commands of the tutorial write."""
    def call(*arguments):
        subprocess.run([tool, *map(str, arguments)], cwd=folder, check=True, stdout=subprocess.DEVNULL)

    noise = ["--steps", 80, "--process-noise", 0.02, "--measurement-noise", 0.05]
    call("example", "oscillator", "-o", "data.npz", "--experiments", 200, *noise)
    call("identify", "data.npz", "-o", "model.npz", "--hold-out", 0.2, "--report", "report.html")


def save(shot, name):
    """256 colours are plenty for such a picture, and a third of the bytes."""
    image = Image.open(io.BytesIO(shot)).convert("RGB").quantize(256, dither=Image.Dither.NONE)
    image.save(HERE / f"{name}.png", optimize=True)


def main():
    tool = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "build" / "bin" / "tokid").resolve()
    chromium = sys.argv[2] if len(sys.argv) > 2 else "/usr/bin/chromium"
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        pages(tool, folder)
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1000, "height": 1600}, device_scale_factor=1.5, color_scheme="light")
        page.goto((folder / "report.html").as_uri())
        page.evaluate("document.querySelector('nav').style.position = 'static'")  # else it lies over the pictures
        page.locator("#poles input[type=range]").evaluate(
            "slider => { slider.value = Math.round(slider.max / 2); slider.dispatchEvent(new Event('input')); }")
        for section, picture in SECTIONS.items():
            save(page.locator(f"#{section}").screenshot(), picture)
        browser.close()


if __name__ == "__main__":
    main()
