# SPDX-License-Identifier: BSD-3-Clause
"""The report page: drawn, quiet, readable on every screen and on paper, and what its controls do."""

import numpy as np
import pytest
from playwright.sync_api import expect

TIME_PLOTS = {"outputs", "errors", "inputs", "order", "condition", "rank", "step", "radius", "gain", "a"}
NASTY = ["</script><script>alert(1)</script>", "<img src=x onerror=alert(2)>", "\"quoted\" 'name' & co \\u003c 🛩",
         "a name of very great length " * 12]


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pages")


@pytest.fixture(scope="session")
def typical(tokid, folder):
    """Noisy experiments, some of them held out."""
    tokid("example", "oscillator", "-o", folder / "data.npz", "--experiments", 50, "--steps", 80,
          "--process-noise", 0.05, "--measurement-noise", 0.1)
    tokid("identify", folder / "data.npz", "-o", folder / "model.npz", "--hold-out", 0.25,
          "--report", folder / "typical.html")
    return folder / "typical.html"


@pytest.fixture(scope="session")
def nasty(tokid, folder, typical):
    """Names that would do harm if they were not text."""
    with np.load(folder / "data.npz") as file:
        data = {name: file[name] for name in ("u", "y", "dt", "initial_state")}
    np.savez(folder / "nasty.npz", **data, input_names=NASTY[:2], output_names=NASTY[2:],
             input_units=["<b>N</b>", "m"], output_units=["</title>", "</style>"])
    page = folder / "nasty <i>.html"
    tokid("identify", folder / "nasty.npz", "-o", folder / "model & <b>.npz", "--report", page)
    return page


def values(page, plot, curve):
    return page.evaluate("([p, c]) => tokid.plots().find(x => x.name === p).curves.find(x => x.label === c).values",
                         [plot, curve])


def ranges(page):
    """name → (from, to) of the plots that share the steps."""
    return {p["name"]: (p["from"], p["to"]) for p in page.evaluate("tokid.plots()") if p["shared"]}


def colours(page):
    """Numbers of different colours of each canvas in a plot that is on the page."""
    return page.evaluate("""() => Object.fromEntries([...document.querySelectorAll(".plot")].map(place => {
      const canvas = place.querySelector("canvas");
      if (!canvas || !canvas.width) return [place.id, 0];
      const copy = document.createElement("canvas");
      copy.width = canvas.width;
      copy.height = canvas.height;
      const context = copy.getContext("2d", {willReadFrequently: true});
      context.drawImage(canvas, 0, 0);
      const pixels = new Uint32Array(context.getImageData(0, 0, copy.width, copy.height).data.buffer);
      return [place.id, new Set(pixels).size];
    }))""")


def clipped(page):
    """Is anything wider than the window?"""
    return page.evaluate("document.documentElement.scrollWidth > document.documentElement.clientWidth")


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [375, 1400])
def test_every_plot_is_drawn(visit, typical, screenshots, width, scheme):
    with visit(typical, width, color_scheme=scheme) as page:
        assert page.evaluate("document.documentElement.dataset.theme") == scheme
        assert not clipped(page)
        found = colours(page)
        assert len(found) == len(TIME_PLOTS) + 2  # and the complex plane, and the whiteness
        # Text, grid and curves, with their smooth edges: many colours. An empty canvas has one.
        assert {name: count for name, count in found.items() if count < 10} == {}
        assert set(ranges(page)) == TIME_PLOTS
        page.screenshot(path=screenshots / f"report-{width}-{scheme}.png", full_page=True)


def test_the_verdict_comes_first_and_in_words(visit, typical):
    with visit(typical) as page:
        assert page.locator("main > section").first.get_attribute("id") == "verdict"
        assert page.locator(".status").inner_text() == "Look closer"
        assert "held-out experiments" in page.locator(".summary").inner_text()


def test_the_page_is_small(typical):
    # Style, scripts, tables and the curves of 13 experiments.
    assert typical.stat().st_size < 500_000


def test_experiment_and_channels_can_be_chosen(visit, typical):
    with visit(typical) as page:
        first = values(page, "outputs", "Measured")
        assert len(first) == 80
        page.click("#next")
        second = values(page, "outputs", "Measured")
        assert second != first
        page.click("#previous")
        assert values(page, "outputs", "Measured") == first
        page.select_option("#experiment", index=0)
        assert page.locator("#previous").is_disabled()
        before = values(page, "outputs", "Measured"), values(page, "inputs", "Measured"), colours(page)
        page.select_option("#output", label="y2")
        page.select_option("#input", label="u2")
        after = values(page, "outputs", "Measured"), values(page, "inputs", "Measured"), colours(page)
        assert all(a != b for a, b in zip(before, after))
        row = values(page, "a", "A(1,1)")
        page.select_option("#a-row", label="row 2")
        assert values(page, "a", "A(2,1)") != row


def test_errors_are_differences(visit, typical):
    with visit(typical) as page:
        measured, simulated, error = (np.array(values(page, *curve), float) for curve in
                                      [("outputs", "Measured"), ("outputs", "Simulated"), ("errors", "Measured − simulated")])
        # Six digits of each are on the page: half a unit of the last is at most 5e-6 of a number.
        np.testing.assert_allclose(measured - simulated, error, atol=1.1e-5 * np.nanmax(np.abs(measured)))


def test_departures_from_the_nominal_trajectory(visit, tokid, folder, typical):
    with np.load(folder / "data.npz") as file:
        data = {key: file[key] for key in file.files}
    mean = 40 * np.sin(np.arange(80) / 9)
    np.savez(folder / "moved.npz", **{**data, "y": data["y"] + mean[:, None]})
    tokid("identify", folder / "moved.npz", "-o", folder / "moved-model.npz", "--hold-out", 0.25, "--nominal", "mean",
          "--report", folder / "moved.html")
    with visit(folder / "moved.html") as page:
        whole, nominal = (np.array(values(page, "outputs", name)) for name in ("Measured", "Nominal"))
        assert np.corrcoef(nominal, mean)[0, 1] > 0.95  # the means of 37 experiments are about it
        page.select_option("#motion", "departures")
        np.testing.assert_allclose(values(page, "outputs", "Measured"), whole - nominal, atol=1e-9)
        assert "Nominal" not in page.locator("#legend-outputs").inner_text()


def drag(page, plot, start, end):
    box = page.locator(f"#plot-{plot} .u-over").bounding_box()
    at = lambda share: (box["x"] + share * box["width"], box["y"] + box["height"] / 2)
    page.mouse.move(*at(start))
    page.mouse.down()
    page.mouse.move(*at((start + end) / 2))
    page.mouse.move(*at(end))
    page.mouse.up()


def test_zoom_is_shared_and_can_be_undone(visit, typical):
    with visit(typical) as page:
        whole = ranges(page)
        assert len(set(whole.values())) == 1
        page.locator("#plot-outputs").scroll_into_view_if_needed()
        drag(page, "outputs", 0.25, 0.5)
        zoomed = ranges(page)
        assert len(set(zoomed.values())) == 1
        begin, end = zoomed["order"]
        assert 15 < begin < 25 and 35 < end < 45  # a quarter and a half of 80 steps
        page.click("#next")  # another experiment, the same steps
        assert ranges(page) == zoomed
        page.click("#reset")
        assert ranges(page) == whole and page.locator("#reset").is_disabled()
        drag(page, "errors", 0.8, 0.6)  # backwards
        assert ranges(page) != whole
        page.locator("#plot-errors .u-over").dblclick()
        assert ranges(page) == whole


def test_zoom_with_a_finger(visit, typical):
    with visit(typical, 375, has_touch=True) as page:
        whole = ranges(page)
        over = page.locator("#plot-outputs .u-over")
        over.scroll_into_view_if_needed()
        box = over.bounding_box()
        y = box["y"] + box["height"] / 2
        session = page.context.new_cdp_session(page)
        points = [box["x"] + share * box["width"] for share in (0.3, 0.4, 0.5, 0.6)]
        session.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": points[0], "y": y}]})
        for x in points[1:]:
            session.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [{"x": x, "y": y}]})
        session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        begin, end = ranges(page)["outputs"]
        assert 15 < begin < 32 and 40 < end < 56
        page.click("#reset")
        expect(page.locator("#reset")).to_be_disabled()
        assert ranges(page) == whole


def test_slider_moves_the_eigenvalues(visit, typical):
    picture = "document.querySelector('#plot-poles canvas').toDataURL()"
    with visit(typical) as page:
        before, drawn = page.evaluate("tokid.poles()"), page.evaluate(picture)
        page.focus("#pole-step")
        page.keyboard.press("ArrowRight")
        after = page.evaluate("tokid.poles()")
        assert after["step"] == before["step"] + 1
        assert after["open"] != before["open"] and after["closed"] != before["closed"]
        assert page.evaluate(picture) != drawn
        assert f"Step {after['step']}," in page.locator("#pole-label").inner_text()
        page.keyboard.press("End")
        last = page.locator("#pole-label").inner_text()
        page.click("#pole-play")
        expect(page.locator("#pole-label")).not_to_have_text(last)
        page.click("#pole-play")


def test_light_and_dark_by_button(visit, typical):
    background = "getComputedStyle(document.body).backgroundColor"
    with visit(typical, color_scheme="light") as page:
        light, drawn = page.evaluate(background), colours(page)
        page.focus("#theme")
        page.keyboard.press("Enter")
        assert page.evaluate(background) != light
        assert page.locator("#theme").inner_text() == "Light"
        assert colours(page).keys() == drawn.keys() and min(colours(page).values()) >= 10


def test_names_stay_text(visit, nasty, screenshots):
    with visit(nasty, 375) as page:
        assert page.title() == "model & <b>.npz"
        assert page.locator("img").count() == 0
        assert page.locator("main script, main b:not(.tile b):not(.legend b)").count() == 0
        assert page.locator("#input option").all_text_contents() == [f"{NASTY[0]} [<b>N</b>]", f"{NASTY[1]} [m]"]
        assert NASTY[2] in page.locator("#fit").inner_text()
        row = page.locator("#fit tbody th").nth(1)
        assert row.inner_text().endswith("…") and row.get_attribute("title") == NASTY[3]
        assert not clipped(page)
        page.screenshot(path=screenshots / "report-names-375.png", full_page=True)


def test_readable_without_javascript(visit, typical, screenshots):
    for scheme in ("light", "dark"):
        with visit(typical, 375, java_script_enabled=False, color_scheme=scheme) as page:
            assert page.get_by_text("JavaScript is off").is_visible()
            assert page.locator(".summary").is_visible()
            assert page.locator("#fit td").count() == 10 and page.locator("#fit td").first.is_visible()
            assert page.locator("#regressions tbody tr").count() == 10
            assert not any(place.is_visible() for place in page.locator(".plot, .controls, #theme").all())
            page.screenshot(path=screenshots / f"report-375-{scheme}-no-script.png", full_page=True)


def test_on_paper(visit, typical, screenshots):
    with visit(typical, 1400, color_scheme="dark") as page:
        pdf = page.pdf(path=screenshots / "report.pdf", format="A4")
        assert pdf.startswith(b"%PDF") and b"/Type /Page" in pdf
    with visit(typical, 700, color_scheme="dark") as page:  # about as wide as the text on A4
        page.emulate_media(media="print")
        expect(page.locator("html")).to_have_attribute("data-theme", "light")
        assert not page.locator("nav").is_visible() and not page.locator("#experiment").is_visible()
        assert page.locator("#fit table").is_visible()
        widths = page.evaluate("[...document.querySelectorAll('.plot canvas')].map(c => c.getBoundingClientRect().width)")
        assert len(widths) == len(TIME_PLOTS) + 2 and max(widths) <= 660
        assert not clipped(page)
        assert min(colours(page).values()) >= 10
        page.screenshot(path=screenshots / "report-print.png", full_page=True)
        page.emulate_media(media="screen")
        expect(page.locator("html")).to_have_attribute("data-theme", "dark")


@pytest.mark.parametrize("case", ["one experiment", "one output", "gaps", "known system", "many channels"])
def test_unusual_models(visit, tokid, folder, case):
    rng = np.random.default_rng(1)
    name = case.replace(" ", "-")
    data, model, page_file = (folder / f"{name}{end}" for end in (".npz", "-model.npz", ".html"))
    if case == "many channels":
        u, y = rng.standard_normal((60, 6, 20)), rng.standard_normal((60, 6, 20))
        np.savez(data, u=u, y=y + u, initial_state="zero")
    else:
        tokid("example", "rotating-tube" if case == "one output" else "oscillator", "-o", data, "--experiments", 30,
              "--steps", 25, "--measurement-noise", 0.01, "--initial-state", "unknown" if case == "gaps" else "zero")
    with np.load(data) as file:
        arrays = {key: file[key] for key in file.files}
    if case == "gaps":
        arrays["y"][3, 4:9] = np.nan
        arrays["u"][5, 12] = np.nan
        np.savez(data, **arrays)
    tokid("identify", data, "-o", model)
    if case == "known system":
        with np.load(model) as file:
            known = {key: file[key] for key in file.files
                     if key not in ("singular_values", "condition", "rank", "lags", "options", "innovation_cov")}
        np.savez(model, **known)
    if case == "one experiment":
        for key in ("u", "y"):
            arrays[key] = arrays[key][:1]
        np.savez(data, **arrays)
    tokid("report", model, data, "-o", page_file)
    with visit(page_file, 375) as page:
        assert not clipped(page)
        found = colours(page)
        assert found["plot-outputs"] >= 10 and found["plot-inputs"] >= 10
        if case == "gaps":
            assert None in page.evaluate("tokid.plots().find(p => p.name === 'outputs').curves[1].values")
            page.select_option("#experiment", label=page.evaluate(
                "[...document.querySelectorAll('#experiment option')].find(o => /^Experiment 3( |$)/.test(o.textContent)).textContent"))
            assert values(page, "outputs", "Measured")[4:9] == [None] * 5
        if case == "known system":
            assert page.get_by_text("carries no singular values").is_visible()
