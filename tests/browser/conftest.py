# SPDX-License-Identifier: BSD-3-Clause
"""Pages of the tool in a real browser: TOKID is the tool, TOKID_CHROMIUM the browser, TOKID_SCREENSHOTS a directory."""

import os
import subprocess
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import sync_playwright

ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
             "--disable-component-update", "--disable-sync"]


@pytest.fixture(scope="session")
def tokid():
    def run(*arguments):
        result = subprocess.run([os.environ["TOKID"], *map(str, arguments)], stdin=subprocess.DEVNULL,
                                capture_output=True, text=True, check=False)
        assert result.returncode == 0, f"{' '.join(map(str, arguments))}\n{result.stdout}{result.stderr}"
        return result.stdout
    return run


@pytest.fixture(scope="session")
def screenshots():
    directory = Path(os.environ["TOKID_SCREENSHOTS"])
    directory.mkdir(parents=True, exist_ok=True)
    return directory


@pytest.fixture(scope="session")
def browser():
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=os.environ["TOKID_CHROMIUM"], args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def visit(browser):
    """Opens a file; at the end the page must have been silent and have asked for nothing but itself."""
    @contextmanager
    def opened(path, width=1400, height=900, **options):
        context = browser.new_context(viewport={"width": width, "height": height}, **options)
        page = context.new_page()
        complaints, requests = [], []
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("dialog", lambda dialog: (complaints.append(dialog.message), dialog.dismiss()))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(Path(path).as_uri())
        try:
            yield page
            assert complaints == []
            assert requests == [Path(path).as_uri()]
        finally:
            context.close()
    return opened
