# SPDX-License-Identifier: BSD-3-Clause
"""The report page: drawn, quiet, readable on every screen and on paper, and what its controls do."""

import json
import re
import zlib

import numpy as np
import pytest
from drawn import READABLE, coloured, of_colour, picture, positions, rgb, undrawn, variable, within
from playwright.sync_api import expect

TIME_PLOTS = {"outputs", "errors", "inputs", "order", "condition", "rank", "step", "radius", "frequency", "damping", "gain", "a"}
OTHER_PLOTS = {"poles", "whiteness", "inputs-lags", "experiments", "pulse", "step-response"}
NASTY = ["</script><script>alert(1)</script>", "<img src=x onerror=alert(2)>", "\"quoted\" 'name' & co \\u003c 🛩",
         "a name of very great length " * 12]

# Choices that take the tool the most time, where they are not what is looked at.
QUICK = ["--states", 4, "--lags", 4, "--smoothing", 1, "--no-refine"]


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
    tokid("identify", folder / "nasty.npz", "-o", folder / "model & <b>.npz", "--report", page, *QUICK)
    return page


def values(page, plot, curve):
    return page.evaluate("([p, c]) => tokid.plots().find(x => x.name === p).curves.find(x => x.label === c).values",
                         [plot, curve])


def ranges(page):
    """name → (from, to) of the plots that share the steps."""
    return {p["name"]: (p["from"], p["to"]) for p in page.evaluate("tokid.plots()") if p["shared"]}


def colours(page):
    """Numbers of different colours of each canvas in a plot that is on the page."""
    return page.evaluate("() => { const readable = " + READABLE + """;
    return Object.fromEntries([...document.querySelectorAll(".plot")].map(place => {
      const canvas = place.querySelector("canvas");
      if (!canvas || !canvas.width) return [place.id, 0];
      const pixels = readable(canvas).getImageData(0, 0, canvas.width, canvas.height);
      return [place.id, new Set(new Uint32Array(pixels.data.buffer)).size];
    })); }""")


def report_data(page):
    return json.loads(page.locator("#report-data").text_content())


def clipped(page):
    """Is anything wider than the window?"""
    return page.evaluate("document.documentElement.scrollWidth > document.documentElement.clientWidth")


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [375, 1400])
def test_every_plot_is_drawn(visit, typical, screenshots, width, scheme):
    with visit(typical, width, color_scheme=scheme) as page:
        assert page.evaluate("document.documentElement.dataset.theme") == scheme
        assert not clipped(page)
        assert set(colours(page)) == {f"plot-{name}" for name in TIME_PLOTS | OTHER_PLOTS}
        assert set(ranges(page)) == TIME_PLOTS
        page.screenshot(path=screenshots / f"report-{width}-{scheme}.png", full_page=True)
    # Twice as many pixels, so that thin lines have some of their own colour, not only of their edges.
    with visit(typical, width, color_scheme=scheme, device_scale_factor=2) as page:
        assert undrawn(page) == []


def test_a_curve_that_is_not_drawn_is_noticed(visit, typical):
    """What the test above relies on."""
    with visit(typical, device_scale_factor=2) as page:
        plots = page.evaluate("tokid.plots()")
        every = {(plot["name"], curve["label"]) for plot in plots for curve in plot["curves"]}
        page.evaluate("""tokid.plots().forEach(({name, curves}) =>
          curves.forEach((_, i) => tokid.plot(name).setSeries(i + 1, {show: false})))""")
        assert set(undrawn(page)) == every


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_eigenvalues_are_drawn_where_they_lie(visit, typical, scheme):
    with visit(typical, color_scheme=scheme, device_scale_factor=2) as page:
        poles, pixels = report_data(page)["poles"], picture(page, "plot-poles")
        for kind, name in (("open", "--c-orange"), ("closed", "--c-blue")):
            x, y = positions(page, *np.array(poles[kind]).reshape(-1, 2).T, "poles")
            inside = (x > 0) & (y > 0) & (x < pixels.shape[1]) & (y < pixels.shape[0])
            assert inside.mean() > 0.9
            assert coloured(pixels[y[inside], x[inside]]).mean() > 0.9, kind
            # The chosen step has rings, 6.5 to each side, in the colour itself.
            for x, y in zip(*positions(page, *np.array(page.evaluate("tokid.poles()")[kind]).reshape(-1, 2).T, "poles")):
                assert of_colour(pixels[y - 16:y + 17, x - 16:x + 17], variable(page, name)).sum() > 20, kind
        # The labels are whole: there is nothing but ground at the edges.
        for edge in (pixels[:, :2], pixels[:, -2:], pixels[:2], pixels[-2:]):
            assert np.ptp(edge.reshape(-1, 3), axis=0).max() == 0


def test_samples_and_correlations_have_marks(visit, typical):
    with visit(typical, device_scale_factor=2) as page:
        plots = {plot["name"]: plot for plot in page.evaluate("tokid.plots()")}
        pixels = picture(page, "plot-whiteness")
        for curve in plots["whiteness"]["curves"][2:]:
            x, y = positions(page, range(1, len(curve["values"]) + 1), curve["values"], "whiteness")
            # Well within the mark, well beyond the line, above or below it: other curves may lie upon it.
            beside = of_colour(pixels[y - 5, x], curve["colour"]) | of_colour(pixels[y + 5, x], curve["colour"])
            assert beside.mean() > 0.7
        page.evaluate("tokid.zoom(20, 40)")
        page.wait_for_function("tokid.plots()[0].from === 20")
        pixels, curve = picture(page, "plot-outputs"), plots["outputs"]["curves"][0]
        x, y = positions(page, range(21, 40), curve["values"][21:40], "outputs")
        beside = of_colour(pixels[y - 3, x], curve["colour"]) | of_colour(pixels[y + 3, x], curve["colour"])
        assert beside.mean() > 0.5


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_heat_map_has_the_colours_of_its_scale(visit, typical, scheme):
    with visit(typical, color_scheme=scheme, device_scale_factor=2) as page:
        sigma, pixels = report_data(page)["sigma"], picture(page, "plot-order")
        strip = picture(page, "legend-order")[0]
        least, most = (float(text[2:].translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))) for text in
                       page.locator("#legend-order .bar > span").all_text_contents())
        k, i, log = np.array([(sigma["begin"] + k, i + 1, value) for k, column in enumerate(sigma["log"])
                              for i, value in enumerate(column) if value >= sigma["rounding"]]).T
        share = (log / 100 - least) / (most - least)
        assert share.min() >= 0 and share.max() <= 1
        x, y = positions(page, k, i, "order")
        found, expected = pixels[y, x], strip[np.round(share * (len(strip) - 1)).astype(int)]
        # The strip has 64 colours: half a step of it, at most 6 of 255.
        right = np.abs(found - expected).max(axis=-1) <= 6
        assert right.mean() > 0.95
        assert len(np.unique(found[right], axis=0)) > 20


def test_the_verdict_comes_first_and_in_words(visit, typical):
    with visit(typical) as page:
        assert page.locator("main > section").first.get_attribute("id") == "verdict"
        assert page.locator(".status").inner_text() == "Good"
        assert "held-out experiments" in page.locator(".summary").inner_text()


def test_the_page_is_small(typical):
    # Style, scripts, tables and the curves of 13 experiments.
    assert typical.stat().st_size < 500_000


def test_experiment_and_channels_can_be_chosen(visit, typical):
    with visit(typical) as page:
        page.select_option("#experiment", index=0)
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


def test_experiments_have_the_names_of_the_data(visit, tokid, folder, typical):
    """With their rows in the file, of which a quarter was held out."""
    with np.load(folder / "data.npz") as file:
        data = {name: file[name] for name in ("u", "y", "dt", "initial_state")}
    names = [f"flight <b>{n + 1}</b>" for n in range(len(data["u"]))]
    np.savez(folder / "named.npz", **data, experiment_names=names)
    tokid("report", folder / "model.npz", folder / "named.npz", "-o", folder / "named.html")
    with visit(folder / "named.html") as page:
        page.select_option("#experiment", index=1)
        shown = page.evaluate("experiment.options[1].textContent")
        row = int(re.search(r"\(row (\d+)\)", shown).group(1))
        assert shown.startswith(f'Experiment "flight <b>{row + 1}</b>" (row {row})') and row > 4
        np.testing.assert_allclose(values(page, "outputs", "Measured"), data["y"][row, :, 0], rtol=1e-5)
        assert page.locator("#plot-outputs").get_attribute("aria-label").startswith(shown)
        assert page.get_by_text(f'Experiment "flight <b>{row + 1}</b>" (row {row})').count() > 0


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
          *QUICK, "--report", folder / "moved.html")
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


def test_axes_over_time_are_in_seconds(visit, tokid, folder, typical):
    """With round numbers, at the steps of these times. Without a stated sample time, they are steps."""
    with visit(typical) as page:
        for zoom in ("tokid.zoom()", "tokid.zoom(13, 29)", "tokid.zoom(40, 43)"):
            page.evaluate(zoom)
            page.wait_for_timeout(100)
            for plot in page.evaluate("tokid.plots()"):
                if not plot["shared"]:
                    continue
                assert plot["x_label"] == "Time [s]"
                texts, ticks = np.array(plot["tick_texts"], float), np.array(plot["ticks"], float)
                assert len(ticks) >= 3 and ticks.min() >= plot["from"] - 1e-9 and ticks.max() <= plot["to"] + 1e-9
                np.testing.assert_allclose(texts, ticks * 0.05, atol=1e-9)
                width = np.diff(texts)
                assert np.ptp(width) < 1e-9 and round(width[0] / 10 ** np.floor(np.log10(width[0]) + 1e-9), 6) in (1, 2, 5)
        page.focus("#plot-outputs")
        page.keyboard.press("Escape")
        page.keyboard.press("ArrowRight")
        expect(page.locator("#legend-outputs")).to_contain_text(re.compile(r"step \d+, [\d.]+ s"))
    with np.load(folder / "data.npz") as file:
        np.savez(folder / "untimed.npz", **{key: file[key] for key in file.files if key != "dt"})
    tokid("report", folder / "model.npz", folder / "untimed.npz", "-o", folder / "untimed.html")
    with visit(folder / "untimed.html") as page:
        plots = [plot for plot in page.evaluate("tokid.plots()") if plot["shared"]]
        assert {plot["x_label"] for plot in plots} == {"Step"}
        assert all(float(text).is_integer() for plot in plots for text in plot["tick_texts"])
        page.focus("#plot-outputs")
        page.keyboard.press("ArrowRight")
        expect(page.locator("#legend-outputs")).to_contain_text(re.compile(r"step \d+$"))


def test_responses_follow_their_controls(visit, typical):
    with visit(typical) as page:
        found = report_data(page)["responses"]
        chosen = len(found["starts"]) // 2
        label = page.evaluate("document.querySelector('#response-start').selectedOptions[0].textContent")
        assert label.startswith(f"step {found['starts'][chosen]}, ")
        assert values(page, "pulse", f"From {label}") == found["pulse"][chosen][0]
        assert values(page, "step-response", f"From {label}") == found["step"][chosen][0]
        page.select_option("#response-start", index=1)
        page.select_option("#response-input", label="u2")
        page.select_option("#response-output", label="y2")
        label = page.evaluate("document.querySelector('#response-start').selectedOptions[0].textContent")
        assert values(page, "pulse", f"From {label}") == found["pulse"][1][3]
        assert page.get_by_text("no confidence bands").is_visible()
        x = page.evaluate("tokid.plots().find(p => p.name === 'pulse').x")
        np.testing.assert_allclose(x, 0.05 * np.arange(found["length"]), atol=1e-12)


def test_checks_are_listed_with_their_figures(visit, typical):
    with visit(typical) as page:
        rows = page.locator("#checks tbody tr")
        assert rows.count() == len(report_data(page)["checks"]) > 15
        assert page.locator("#checks p").first.inner_text().startswith(
            f"{sum(c['result'] == 'good' for c in report_data(page)['checks'])} of ")
        assert all(rows.nth(i).locator("td").nth(0).inner_text()[0] in "✓!✗–" for i in range(rows.count()))


def test_every_experiment_has_its_place_and_name(visit, typical):
    with visit(typical) as page:
        found = report_data(page)["experiments"]
        assert len(found["row"]) == 13 and found["excess"] == sorted(found["excess"], reverse=True)
        assert values(page, "experiments", "One-step prediction") == found["one_step_error"]
        page.focus("#plot-experiments")
        page.keyboard.press("Home")
        expect(page.locator("#legend-experiments")).to_contain_text(f"experiment {found['row'][0]}")


@pytest.mark.parametrize("width", [375, 1400])
def test_bands_frozen_responses_and_other_models(visit, tokid, folder, typical, screenshots, width):
    """A slow constant system, so that frozen responses mean something, beside two other models, with bands."""
    page_file = folder / "compared.html"
    if not page_file.exists():
        rng = np.random.default_rng(5)
        A = np.array([[0.97, 0.2, 0.0], [-0.2, 0.97, 0.0], [0.0, 0.0, 0.9]]) * 0.99
        B, C = rng.standard_normal((3, 2)), rng.standard_normal((2, 3))
        for name, seed in (("slow", 1), ("slow-fresh", 2)):
            rng = np.random.default_rng(seed)
            u = rng.standard_normal((16, 60, 2))
            x, y = np.zeros((16, 3)), []
            for k in range(60):
                y.append(x @ C.T + 0.1 * rng.standard_normal((16, 2)))
                x = x @ A.T + u[:, k] @ B.T
            np.savez(folder / f"{name}.npz", u=u, y=np.stack(y, axis=1), dt=0.05, initial_state="zero",
                     input_units=["N", "V"], output_units=["m", "rad"])
        common = ["--no-refine", "--smoothing", "inf"]
        tokid("identify", folder / "slow.npz", "-o", folder / "three.npz", "--states", 3, *common)
        tokid("identify", folder / "slow.npz", "-o", folder / "one.npz", "--states", 1, *common)
        tokid("identify", folder / "slow.npz", "-o", folder / "two <b>.npz", "--states", 2, *common)
        tokid("report", folder / "three.npz", folder / "slow-fresh.npz", "-o", page_file, "--bands", folder / "slow.npz",
              "--compare", folder / "one.npz", "--compare", folder / "two <b>.npz")
    for scheme in ("light", "dark"):
        with visit(page_file, width, color_scheme=scheme, device_scale_factor=2) as page:
            assert not clipped(page)
            assert set(colours(page)) == {f"plot-{name}" for name in TIME_PLOTS | OTHER_PLOTS | {"magnitude", "phase"}}
            labels = {plot["name"]: [curve["label"] for curve in plot["curves"]] for plot in page.evaluate("tokid.plots()")}
            assert labels["outputs"][3:5] == ["Simulated by one.npz", "Simulated by two <b>.npz"]
            assert labels["pulse"][-2:] == ["one.npz", "two <b>.npz"] and "95 % band from" in labels["pulse"]
            assert all("95 % band from" in labels[name] for name in ("magnitude", "phase"))
            assert page.locator("main script, main b:not(.tile b):not(.legend b)").count() == 0
            assert not {("magnitude", label) for label in labels["magnitude"]} & set(undrawn(page))
            page.screenshot(path=screenshots / f"report-compared-{width}-{scheme}.png", full_page=True, scale="css")


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
        page.select_option("#experiment", index=0)  # another experiment, the same steps
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


def test_taps_undo_the_zoom_on_one_place_and_with_one_finger_only(visit, typical):
    """The events of a touch screen, with their times left to the page: two taps are quick here."""
    tap = """points => {
      const over = document.querySelector("#plot-outputs .u-over"), box = over.getBoundingClientRect();
      for (const [type, finger, share] of points)
        over.dispatchEvent(new PointerEvent(type, {pointerId: finger, pointerType: "touch", bubbles: true,
          clientX: box.left + share * box.width, clientY: box.top + box.height / 2}));
    }"""
    down, up = "pointerdown", "pointerup"
    with visit(typical, 375, has_touch=True) as page:
        def zoomed_after(*points):
            page.evaluate("tokid.zoom(20, 60)")
            page.wait_for_function("tokid.plots()[0].from === 20")
            page.evaluate(tap, points)
            page.evaluate("new Promise(done => setTimeout(done))")
            left = ranges(page)["outputs"] == (20, 60)
            page.evaluate("new Promise(done => setTimeout(done, 400))")  # taps of the next trial are others
            return left
        assert zoomed_after((down, 1, .2), (up, 1, .2), (down, 2, .8), (up, 2, .8))     # two places
        assert zoomed_after((down, 1, .5), (down, 2, .52), (up, 2, .52), (up, 1, .5))   # two fingers
        assert zoomed_after((down, 1, .5), (up, 1, .5))                                 # one tap
        assert not zoomed_after((down, 1, .5), (up, 1, .5), (down, 2, .51), (up, 2, .51))


def test_plots_with_the_keyboard(visit, typical):
    with visit(typical) as page:
        whole = ranges(page)
        page.focus("#plot-outputs")
        measured, order = values(page, "outputs", "Measured"), report_data(page)["sigma"]["order"]
        legend, spoken = page.locator("#legend-outputs"), page.locator("div.unseen[role=status]")
        for key, step in [("ArrowRight", 0), ("ArrowRight", 1), ("End", 79), ("ArrowRight", 79), ("ArrowLeft", 78),
                          ("Shift+ArrowLeft", 68), ("Home", 0), ("Shift+ArrowRight", 10)]:
            page.keyboard.press(key)
            expect(legend).to_contain_text(f"step {step},")
            shown = legend.locator("b").first.inner_text().replace("−", "-")
            assert float(shown) == pytest.approx(measured[step], rel=1e-3)
            expect(spoken).to_contain_text(f"Measured {legend.locator('b').first.inner_text()}")
        expect(page.locator("#legend-order")).to_contain_text("step 10,")  # the others follow
        for _ in range(2):
            page.keyboard.press("+")
        expect(page.locator("#reset")).to_be_enabled()
        begin, end = ranges(page)["gain"]
        assert end - begin == pytest.approx((whole["gain"][1] - whole["gain"][0]) / 4)
        assert begin < 10 < end
        for _ in range(20):
            page.keyboard.press("ArrowRight")
        expect(legend).to_contain_text("step 30,")
        begin, end = ranges(page)["errors"]
        assert begin < 30 < end  # the view went along
        page.keyboard.press("-")
        assert np.ptp(ranges(page)["errors"]) == pytest.approx(2 * (end - begin))
        page.keyboard.press("End")
        page.wait_for_function("tokid.plots()[0].to > 79")
        assert np.ptp(ranges(page)["errors"]) == pytest.approx(2 * (end - begin))
        page.keyboard.press("Escape")
        assert ranges(page) == whole
        page.keyboard.press("Escape")
        expect(legend).not_to_contain_text(re.compile(r"step \d"))
        page.focus("#plot-order")
        for _ in range(80):
            page.keyboard.press("ArrowRight")
        expect(page.locator("#legend-order")).to_contain_text(f"{order[79]}step 79,")
        page.focus("#plot-whiteness")
        expect(page.locator("#legend-order")).not_to_contain_text("step")
        page.keyboard.press("ArrowRight")
        page.keyboard.press("+")  # lags are not steps
        expect(page.locator("#legend-whiteness")).to_contain_text("Lag: 1")
        assert ranges(page) == whole


def test_tables_take_the_focus_where_they_scroll(visit, typical):
    focus = "[...document.querySelectorAll('.scroll')].filter(s => s.offsetWidth).map(s => [s.tabIndex, s.scrollWidth > s.clientWidth])"
    with visit(typical, 1400) as page:
        assert all(index == -1 and not scrolls for index, scrolls in page.evaluate(focus))
        page.set_viewport_size({"width": 320, "height": 700})
        page.wait_for_function("document.querySelector('.scroll[tabindex]')")
        found = page.evaluate(focus)
        assert any(scrolls for _, scrolls in found)
        assert all((index == 0) == scrolls for index, scrolls in found)


def luminance(colour):
    parts = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in colour / 255]
    return np.dot([0.2126, 0.7152, 0.0722], parts)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_curves_and_controls_stand_out_from_their_ground(visit, typical, scheme):
    with visit(typical, color_scheme=scheme) as page:
        colour = lambda name: rgb(variable(page, name))
        def contrast(a, b):
            low, high = sorted([luminance(a), luminance(b)])
            return (high + 0.05) / (low + 0.05)
        names = ["measured", "blue", "orange", "green", "purple", "pink", "sky", "yellow", "faint"]
        assert min(contrast(colour(f"--c-{name}"), colour("--surface")) for name in names) >= 3
        for ground in ("--surface", "--ground"):
            assert contrast(colour("--control"), colour(ground)) >= 3
            assert contrast(colour("--muted"), colour(ground)) >= 4.5
        border = lambda element: page.evaluate("e => getComputedStyle(document.querySelector(e)).borderTopColor", element)
        for element in ("#theme", "#experiment", "#next", "#pole-play"):
            np.testing.assert_array_equal([int(v) for v in re.findall(r"\d+", border(element))], colour("--control"))


@pytest.mark.parametrize("width, rows", [(375, [2, 2, 2]), (768, [3, 3]), (1400, [6])])
def test_no_tile_of_the_verdict_stands_alone(visit, typical, width, rows):
    with visit(typical, width) as page:
        boxes = [tile.bounding_box() for tile in page.locator(".tile").all()]
        tops = [round(box["y"]) for box in boxes]
        assert [tops.count(top) for top in sorted(set(tops))] == rows
        for top in set(tops):  # a row is as wide as the others
            row = [box for box in boxes if round(box["y"]) == top]
            assert np.ptp([box["width"] for box in row]) < 1
            assert row[0]["x"] == pytest.approx(boxes[0]["x"], abs=1)
            end = boxes[rows[0] - 1]
            assert row[-1]["x"] + row[-1]["width"] == pytest.approx(end["x"] + end["width"], abs=1)


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
        assert page.get_attribute("#pole-step", "aria-valuetext") == page.locator("#pole-label").inner_text()
        page.keyboard.press("End")
        last = page.locator("#pole-label").inner_text()
        page.click("#pole-play")
        expect(page.locator("#pole-label")).not_to_have_text(last)
        page.click("#pole-play")


def test_light_and_dark_by_button(visit, typical):
    background = "getComputedStyle(document.body).backgroundColor"
    with visit(typical, color_scheme="light", device_scale_factor=2) as page:
        light = page.evaluate(background)
        page.focus("#theme")
        page.keyboard.press("Enter")
        assert page.evaluate(background) != light
        assert page.locator("#theme").inner_text() == "Light"
        assert undrawn(page) == []  # in the colours that the theme has now


def test_names_stay_text(visit, nasty, screenshots):
    with visit(nasty, 375) as page:
        assert page.title() == "model & <b>.npz"
        assert page.locator("img").count() == 0
        assert page.locator("main script, main b:not(.tile b):not(.legend b)").count() == 0
        assert page.locator("#input option").all_text_contents() == [f"{NASTY[0]} [<b>N</b>]", f"{NASTY[1]} [m]"]
        assert NASTY[2] in page.locator("#fit").inner_text()
        row = page.locator("#fit tbody th").nth(1)
        assert row.inner_text().endswith("…") and row.get_attribute("title") == NASTY[3][:80] + "…"
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
    assert pdf.startswith(b"%PDF") and len(re.findall(rb"/Type /Page\b", pdf)) > 2
    # What is set in type, and the lines of the plots in the colours of the light theme.
    streams = [zlib.decompressobj().decompress(body) for head, body in  # the last byte may look like the end of a line
               re.findall(rb"<<([^>]*?/FlateDecode[^>]*)>>\s*stream\r?\n(.*?)\r?\nendstream", pdf, re.S)
               if b"/Image" not in head]
    assert sum(len(re.findall(rb"\bT[jJ]\b", body)) for body in streams) > 300
    lines = {}  # stroke colour → segments
    for body in streams:
        colour = None
        for new, _ in re.findall(rb"^([\d. ]+) RG\b|( l)$", body, re.M):
            if new:
                colour = "#" + "".join(f"{round(255 * float(c)):02x}" for c in new.split())
            else:
                lines[colour] = lines.get(colour, 0) + 1
    # Curves of 80 steps, four of each colour. A page begins with the colour of the one before, so the sum counts.
    assert min(lines["#0072b2"], lines["#d05a00"]) > 79 and lines["#0072b2"] + lines["#d05a00"] > 8 * 79
    with visit(typical, 700, color_scheme="dark", device_scale_factor=2) as page:  # about as wide as the text on A4
        page.emulate_media(media="print")
        expect(page.locator("html")).to_have_attribute("data-theme", "light")
        assert not page.locator("nav").is_visible() and not page.locator("#experiment").is_visible()
        assert variable(page, "--c-blue") == "#0072b2"
        assert page.locator("#fit table").is_visible() and page.locator("#regressions tbody tr").last.is_visible()
        assert "held-out experiments" in page.locator(".summary").inner_text()
        widths = page.evaluate("[...document.querySelectorAll('.plot canvas')].map(c => c.getBoundingClientRect().width)")
        assert len(widths) == len(TIME_PLOTS | OTHER_PLOTS) and max(widths) <= 660
        assert not clipped(page)
        assert undrawn(page) == []
        page.screenshot(path=screenshots / "report-print.png", full_page=True, scale="css")
        page.emulate_media(media="screen")
        expect(page.locator("html")).to_have_attribute("data-theme", "dark")


def test_without_states_nothing_is_empty_or_bright(visit, tokid, folder, screenshots):
    """Outputs that follow the inputs at once: the Hankel matrices hold rounding errors, or nothing at all."""
    rng = np.random.default_rng(3)
    u = rng.standard_normal((30, 12, 2))
    for name, D in (("static", rng.standard_normal((12, 2, 2))), ("zero", np.zeros((12, 2, 2)))):
        data, model, page_file = (folder / f"{name}{end}" for end in (".npz", "-model.npz", ".html"))
        np.savez(data, u=u, y=np.einsum("kij,nkj->nki", D, u), initial_state="zero")
        tokid("identify", data, "-o", model, "--report", page_file)
        with visit(page_file, 375, device_scale_factor=2) as page:
            assert report_data(page)["poles"]["k"] == []
            for heading in page.locator("h3").all_text_contents():
                assert not re.search("gain|smooth frame|magnitude", heading)
            assert page.locator("#poles .plot, #matrices .plot, #poles select, #matrices select").count() == 0
            assert page.get_by_text("has no states").first.is_visible()
            legend = page.locator("#legend-order")
            assert "rounding errors" in legend.inner_text() and legend.locator("canvas").count() == 0
            plot = next(p for p in page.evaluate("tokid.plots()") if p["name"] == "order")
            pixels = within(plot, picture(page, "plot-order"))
            grey = of_colour(pixels, "#8c949e")
            assert grey.mean() > 0.7
            assert not (coloured(pixels) & (pixels[..., 1] > pixels[..., 0])).any()  # no green of the scale
            page.screenshot(path=screenshots / f"report-{name}-375.png", full_page=True, scale="css")


def test_what_is_left_out_is_said_beside_the_plot(visit, tokid, folder, typical, screenshots):
    """A long system that measures its states, and one step of it that is like no other."""
    steps, event = 8000, 4777
    A = np.tile(np.diag([0.5, -0.4]), (steps, 1, 1))
    A[event] = [[7.1, 0], [0, -6]]
    rng = np.random.default_rng(4)
    sigma = np.tile([1.0, 0.5, 1e-9], (steps, 1))
    sigma[event, 2] = 0.25
    np.savez(folder / "long-model.npz", A=A, B=np.ones((steps, 2, 1)), C=np.tile(np.eye(2), (steps, 1, 1)),
             D=np.zeros((steps, 2, 1)), G=np.zeros((steps, 2, 2)), k_begin=0, dt=0.1, frame="raw",
             singular_values=sigma, state_dim=np.full(steps + 1, 2), initial_state="zero")
    u = rng.standard_normal((3, steps, 1))
    np.savez(folder / "long.npz", u=u, y=np.repeat(u, 2, axis=2), initial_state="zero", dt=0.1)
    tokid("report", folder / "long-model.npz", folder / "long.npz", "-o", folder / "long.html")
    with visit(folder / "long.html") as page:
        data = report_data(page)
        stretch, stride = data["traces"]["stretch"], data["sigma"]["stride"]
        assert stretch > 1 and stride > 1
        expect(page.locator("#plot-outputs + p")).to_contain_text(f"Of every {stretch} steps the least and the largest")
        expect(page.locator("#plot-order + p")).to_contain_text(f"Of every {stride} steps the largest")
        assert data["sigma"]["log"][event // stride][2] == round(100 * np.log10(0.25))
        assert data["poles"]["stride"] > 1 and event in data["poles"]["k"]
        assert len(data["poles"]["k"]) * 2 <= 12500
        outside = page.locator("#plot-poles + p").inner_text()
        assert f"Of every {data['poles']['stride']} steps those two" in outside
        count = 4 * len(data["poles"]["k"])  # of A and of A + GC
        assert f"4 of {count} eigenvalues lie outside this square, up to 7.1 in magnitude" in outside
        page.screenshot(path=screenshots / "report-long-1400.png", full_page=True)
    with visit(typical) as page:
        assert page.locator("#plot-outputs + p, #plot-order + p").count() == 0


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
    # Without EM, which takes the longest: with gaps and unknown initial states, such a model begins late.
    tokid("identify", data, "-o", model, "--no-refine")
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
    with visit(page_file, 375, device_scale_factor=2) as page:
        assert not clipped(page)
        # Where a model is nearly right, the last curve covers those before it.
        assert not {("outputs", "One-step prediction"), ("inputs", "Measured"), ("a", "A(1,1)")} & set(undrawn(page))
        if case == "gaps":
            assert None in page.evaluate("tokid.plots().find(p => p.name === 'outputs').curves[1].values")
            page.select_option("#experiment", label=page.evaluate(
                "[...document.querySelectorAll('#experiment option')].find(o => /^Experiment 3( |$)/.test(o.textContent)).textContent"))
            assert values(page, "outputs", "Measured")[4:9] == [None] * 5
        if case == "known system":
            assert page.get_by_text("has no singular values").is_visible()
