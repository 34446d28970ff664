# SPDX-License-Identifier: BSD-3-Clause
"""The page of the paper and its figures: drawn, quiet, readable on every screen and without scripts."""

import base64

import pytest

FIGURES = [f"figure-{i}" for i in range(1, 8)] + ["kalman-error", "kalman-gain"]


@pytest.fixture(scope="session")
def paper(tokid, tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    tokid("paper", "-o", folder)
    return folder


def colours(page, shot):
    """Number of different colours of a picture, and the share of the commonest one."""
    return page.evaluate("""async source => {
      const image = new Image();
      image.src = source;
      await image.decode();
      const canvas = document.createElement("canvas");
      canvas.width = image.width;
      canvas.height = image.height;
      const context = canvas.getContext("2d");
      context.drawImage(image, 0, 0);
      const count = new Map();
      for (const pixel of new Uint32Array(context.getImageData(0, 0, canvas.width, canvas.height).data.buffer))
        count.set(pixel, (count.get(pixel) || 0) + 1);
      return [count.size, Math.max(...count.values()) / (canvas.width * canvas.height)];
    }""", "data:image/png;base64," + base64.b64encode(shot).decode())


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [375, 1400])
def test_every_figure_is_drawn(visit, browser, paper, screenshots, width, scheme):
    with visit(paper / "paper.html", width, color_scheme=scheme) as page:
        assert page.evaluate("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
        shots = {name: page.locator(f"#{name} svg").screenshot() for name in FIGURES}
        page.screenshot(path=screenshots / f"paper-{width}-{scheme}.png", full_page=True)
        # In the page each figure fills its column and is no wider than it.
        assert all(box["width"] <= width and box["width"] > 250 for box in
                   (page.locator(f"#{name} svg").bounding_box() for name in FIGURES))
    blank = browser.new_page()  # the page itself allows no pictures but its own
    for name, shot in shots.items():
        number, ground = colours(blank, shot)
        assert number > 30, name   # curves and text with smooth edges
        assert 0.5 < ground < 0.995, name
    blank.close()


def test_figures_stand_alone(browser, visit, paper):
    blank = browser.new_page()
    for scheme, ground in [("light", "rgb(255, 255, 255)"), ("dark", "rgb(25, 31, 39)")]:
        for name in FIGURES:
            with visit(paper / f"{name}.svg", color_scheme=scheme) as page:
                assert page.evaluate("getComputedStyle(document.querySelector('.ground')).fill") == ground
                assert colours(blank, page.locator("svg").screenshot())[0] > 30, name
    blank.close()


def test_everything_is_there_without_scripts_and_on_paper(visit, paper, screenshots):
    with visit(paper / "paper.html", java_script_enabled=False) as page:
        assert page.locator("svg").count() >= len(FIGURES)
        assert page.locator("#appendix-b tbody tr").count() == 98
        assert page.locator("#kalman tbody tr").count() == 7
        assert page.locator("noscript").count() == 0
        (screenshots / "paper.pdf").write_bytes(page.pdf(format="A4"))


def test_appendix_b_says_what_was_printed(visit, paper):
    with visit(paper / "paper.html") as page:
        rows = [page.locator("#appendix-b tbody tr").nth(i).inner_text().split("\t") for i in range(98)]
        assert ["(79)", "Ā36[1,1]", "-2.0405"] == rows[[row[1] for row in rows].index("Ā36[1,1]")][:3]
        assert page.locator("#appendix-b tr.mark").count() == 0
        assert page.locator("#verdict").get_attribute("class") == "verdict good"


def test_light_and_dark_by_the_button(visit, paper):
    with visit(paper / "paper.html", color_scheme="light") as page:
        before = page.locator("#figure-1 svg").screenshot()
        page.click("#theme")
        assert page.evaluate("document.documentElement.dataset.theme") == "dark"
        assert page.locator("#figure-1 svg").screenshot() != before
