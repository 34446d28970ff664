# SPDX-License-Identifier: BSD-3-Clause
"""The page of the paper and its figures: drawn, quiet, readable on every screen, on paper and without scripts."""

import json

import numpy as np
import pytest
from drawn import coloured, picture, positions, undrawn
from playwright.sync_api import expect

PLOTS = {f"figure-{i}-1" for i in range(1, 8)} | {"figure-6-2", "kalman-error-1", "kalman-gain-1"}


@pytest.fixture(scope="session")
def paper(tokid, tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    tokid("paper", "-o", folder)
    return folder


@pytest.fixture(scope="session")
def panels(paper):
    """Name of the plot → panel of paper.json."""
    figures = json.loads((paper / "paper.json").read_text())["figures"]
    return {f"{figure['id']}-{i + 1}": panel for figure in figures for i, panel in enumerate(figure["panels"])}


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [375, 1400])
def test_every_figure_is_drawn(visit, paper, panels, screenshots, width, scheme):
    # Twice as many pixels, so that thin lines have some of their own colour, not only of their edges.
    with visit(paper / "paper.html", width, color_scheme=scheme, device_scale_factor=2) as page:
        assert page.evaluate("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
        assert {plot["name"] for plot in page.evaluate("tokid.plots()")} == set(panels) == PLOTS
        assert undrawn(page) == []
        boxes = [page.locator(f"#plot-{name}").bounding_box() for name in PLOTS]
        assert all(250 < box["width"] <= width for box in boxes)
        page.screenshot(path=screenshots / f"paper-{width}-{scheme}.png", full_page=True, scale="css")


def test_values_are_drawn_where_they_lie(visit, paper, panels):
    with visit(paper / "paper.html", device_scale_factor=2) as page:
        for name, panel in panels.items():
            pixels = picture(page, f"plot-{name}")
            for series in panel["series"]:
                points = np.array([(x, y) for x, y in zip(series["x"], series["y"])
                                   if y is not None and not (panel["y_log"] and y <= 0)])
                x, y = positions(page, *points.T, name)
                assert ((x > 0) & (y > 0) & (x < pixels.shape[1]) & (y < pixels.shape[0])).all(), name
                if series["colour"] == 7:  # nearly grey
                    continue
                # A line is three pixels wide and ends at its last point; a dashed one has gaps.
                seen = np.max([coloured(pixels[y + up, x + right]) for up in (-1, 0, 1) for right in (-1, 0, 1)], axis=0)
                assert seen.mean() > (0.5 if series["mark"] == "dashed" else 0.9), (name, series["name"])


def test_scales(visit, paper, panels):
    with visit(paper / "paper.html") as page:
        for width in (1400, 375, 800):
            page.set_viewport_size({"width": width, "height": 900})
            page.evaluate("new Promise(done => requestAnimationFrame(() => setTimeout(done, 50)))")
            # The unit circle is round, and every pole is inside the axes.
            x, y = positions(page, [0, 1, 0], [0, 0, 1], "figure-1-1")
            assert abs((x[1] - x[0]) - (y[0] - y[2])) <= 1 and x[1] > x[0] + 50
        # Equal ratios are equal lengths.
        rows = positions(page, [1] * 4, [1e-14, 1e-13, 1e-12, 1e-11], "figure-2-1")[1]
        assert np.ptp(np.diff(rows)) <= 1 and rows[0] > rows[1] + 10
        # Figures to be compared share their scale, others do not.
        scale = lambda name: page.evaluate("name => [tokid.plot(name).scales.y.min, tokid.plot(name).scales.y.max]", name)
        assert scale("figure-2-1") == scale("figure-3-1")
        assert scale("figure-4-1") != scale("figure-5-1")


def test_values_by_the_keyboard(visit, paper, panels):
    with visit(paper / "paper.html") as page:
        page.focus("#plot-kalman-error-1")
        page.keyboard.press("End")
        page.keyboard.press("ArrowLeft")
        legend = page.locator("#legend-kalman-error-1")
        expect(legend).to_contain_text("lag order p: 15")
        shown = [text.replace("−", "-") for text in legend.locator("b").all_inner_texts()]
        assert shown[0] == "–"  # 50 experiments are too few
        for text, series in zip(shown[1:], panels["kalman-error-1"]["series"][1:]):
            assert float(text) == pytest.approx(series["y"][series["x"].index(15)], rel=1e-3)


def test_everything_but_the_plots_is_there_without_scripts(visit, paper):
    with visit(paper / "paper.html", java_script_enabled=False) as page:
        assert page.get_by_text("JavaScript is off").is_visible()
        assert not any(place.is_visible() for place in page.locator(".plot, .legend, #theme").all())
        assert page.locator("figcaption").count() == 9 and page.locator("figcaption").first.is_visible()
        assert page.locator("#appendix-b tbody tr").count() == 98
        assert page.locator("#kalman tbody tr").count() == 7


def test_on_paper(visit, paper, screenshots):
    with visit(paper / "paper.html", color_scheme="dark") as page:
        assert page.pdf(path=screenshots / "paper.pdf", format="A4").startswith(b"%PDF")
    with visit(paper / "paper.html", 700, color_scheme="dark", device_scale_factor=2) as page:  # as wide as A4
        page.emulate_media(media="print")
        expect(page.locator("html")).to_have_attribute("data-theme", "light")
        assert undrawn(page) == []
        widths = page.evaluate("[...document.querySelectorAll('.plot canvas')].map(c => c.getBoundingClientRect().width)")
        assert len(widths) == len(PLOTS) and max(widths) <= 660
        page.screenshot(path=screenshots / "paper-print.png", full_page=True, scale="css")


def test_appendix_b_says_what_was_printed(visit, paper):
    with visit(paper / "paper.html") as page:
        rows = [page.locator("#appendix-b tbody tr").nth(i).inner_text().split("\t") for i in range(98)]
        assert ["(79)", "Ā36[1,1]", "-2.0405"] == rows[[row[1] for row in rows].index("Ā36[1,1]")][:3]
        assert page.locator("#appendix-b tr.mark").count() == 0
        assert page.locator("#verdict").get_attribute("class") == "verdict good"


def test_light_and_dark_by_the_button(visit, paper):
    with visit(paper / "paper.html", color_scheme="light", device_scale_factor=2) as page:
        before = picture(page, "plot-figure-1-1")
        page.click("#theme")
        assert page.evaluate("document.documentElement.dataset.theme") == "dark"
        assert (picture(page, "plot-figure-1-1") != before).any()
        assert undrawn(page) == []  # in the colours that the theme has now
