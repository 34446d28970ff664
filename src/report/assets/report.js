// Draws the plots of the report from the data in the page. Names come from files, so they enter as text, never as HTML.
// SPDX-License-Identifier: BSD-3-Clause
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("report-data").textContent);
  const root = document.documentElement;
  const at = id => document.getElementById(id);
  const colour = name => getComputedStyle(root).getPropertyValue(name).trim();
  const palette = ["--c-blue", "--c-orange", "--c-green", "--c-purple", "--c-pink", "--c-sky", "--c-yellow", "--c-measured"];
  const dashes = [[], [6, 4], [2, 3], [9, 3, 2, 3]];
  const font = size => `${size}px ${colour("--sans")}`;
  const narrow = () => root.clientWidth < 600;
  const printing = () => root.dataset.printing === "true";
  const printed_width = 660;  // fits A4 and Letter at 96 pixels per inch
  const make = (tag, text, parent) => {
    const element = document.createElement(tag);
    if (text !== undefined) element.textContent = text;
    if (parent) parent.append(element);
    return element;
  };

  // Formats numbers for readers.
  const raised = exponent => "10" + [...String(exponent)].map(c => c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[Number(c)]).join("");
  function short(value) {
    if (value === null || value === undefined || !Number.isFinite(value)) return "–";
    if (value === 0) return "0";
    const size = Math.abs(value);
    if (size >= 1e5 || size < 1e-3) {
      const [mantissa, exponent] = value.toExponential(2).split("e");
      return `${mantissa.replace("-", "−")}·${raised(Number(exponent))}`;
    }
    return String(Number(value.toPrecision(4))).replace("-", "−");
  }
  function tick(value) {
    if (value === null) return "";
    if (value !== 0 && (Math.abs(value) >= 1e5 || Math.abs(value) < 1e-3)) {
      const [mantissa, exponent] = String(Number(value.toPrecision(6)).toExponential()).split("e");
      return `${mantissa === "1" ? "" : mantissa.replace("-", "−") + "·"}${raised(Number(exponent))}`;
    }
    return String(Number(value.toPrecision(6))).replace("-", "−");
  }
  const named = channel => channel.unit ? `${channel.name} [${channel.unit}]` : channel.name;

  // Plots over time share one range of steps.
  const plots = new Map();  // name → plot
  const first_step = 0, last_step = Math.max(data.steps - 1, data.end - 1, 1);
  let view = null;  // [from, to], or null for all
  const full = () => {
    const margin = Math.max(0.5, (last_step - first_step) * 0.01);
    return [first_step - margin, last_step + margin];
  };

  function set_view(range) {
    if (range) {
      const all = full(), width = Math.min(range[1] - range[0], all[1] - all[0]);
      if (!(width >= 1)) return;
      const from = Math.min(Math.max(all[0], range[0]), all[1] - width);
      range = [from, from + width];
    }
    view = range;
    const [min, max] = view || full();
    for (const plot of plots.values()) if (plot.shared) plot.u.setScale("x", {min, max});
    at("reset").disabled = !view;
  }

  const sync = uPlot.sync("steps");
  const steps = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 1e4, 2e4, 5e4, 1e5, 2e5, 5e5];

  function width_of(place) {
    return printing() ? Math.min(printed_width, place.clientWidth || printed_width) : Math.max(200, place.clientWidth);
  }
  const height_of = plot => printing() ? 200 : Math.round((plot.tall || 250) * (narrow() ? 0.84 : 1));

  // Single samples between gaps would vanish from a line.
  function lone(u, i, show) {
    if (show) return null;
    const y = u.data[i], found = [];
    for (let k = 0; k < y.length; ++k)
      if (y[k] != null && (k === 0 || y[k - 1] == null) && (k === y.length - 1 || y[k + 1] == null)) found.push(k);
    return found;
  }

  const cut = (text, most) => [...text].length > most ? [...text].slice(0, most - 1).join("") + "…" : text;

  function legend_of(plot) {
    const place = at(plot.legend);
    if (!place) return;
    place.replaceChildren();
    plot.values = [];
    if (plot.bar) plot.bar(place);
    for (const curve of plot.curves) {
      if (curve.silent) continue;
      const item = make("span", undefined, place), mark = make("i", undefined, item);
      mark.style.borderColor = colour(curve.colour);
      if (curve.dash && curve.dash.length) mark.className = "dashed";
      make("span", curve.label, item);
      plot.values.push([make("b", "", item), curve]);
    }
    plot.where = make("span", "", place);
  }

  function show_values(plot) {
    if (!plot.values) return;
    const k = plot.pick ? plot.pick(plot.u) : plot.u.cursor.idx;
    for (const [element, curve] of plot.values) element.textContent = k == null ? "" : short((curve.shown || curve.values)[k]);
    if (k == null) plot.where.textContent = "";
    else if (plot.shared) {
      // Each thinned curve has the least or the largest value of a stretch, from any place in it.
      if (plot.stretch > 1) {
        const begin = plot.step_of ? plot.step_of(k) : plot.x[k - k % 2];
        const end = Math.min(begin + plot.stretch - 1, last_step);
        plot.where.textContent = `${plot.step_of ? "largest" : "least or largest"} of steps ${begin}–${end}`;
        return;
      }
      const step = plot.step_of ? plot.step_of(k) : plot.x[k];
      plot.where.textContent = `step ${step}, ${short(step * data.dt)} s`;
    }
    else plot.where.textContent = `lag ${plot.x[k]}`;
  }

  // Touch: a movement across zooms, a movement down scrolls the page, and a double tap shows the whole range again.
  function touch(u) {
    const over = u.over, fingers = new Set();
    let start = null, tap = null;  // where the only finger went down; the last tap
    const left = event => Math.min(over.clientWidth, Math.max(0, event.clientX - over.getBoundingClientRect().left));
    const between = (a, b) => Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
    const unselect = () => u.setSelect({left: 0, width: 0, top: 0, height: 0}, false);
    over.addEventListener("pointerdown", event => {
      if (event.pointerType === "mouse") return;
      fingers.add(event.pointerId);
      const alone = fingers.size === 1;
      if (!alone) unselect(), tap = null;  // the browser handles several fingers
      start = alone ? {left: left(event), clientX: event.clientX, clientY: event.clientY} : null;
    });
    over.addEventListener("pointermove", event => {
      if (start === null) return;
      const now = left(event);
      u.setSelect({left: Math.min(start.left, now), width: Math.abs(now - start.left), top: 0, height: over.clientHeight}, false);
    });
    const end = event => {
      fingers.delete(event.pointerId);
      if (start === null) return;
      const begun = start, now = left(event), from = Math.min(begun.left, now), to = Math.max(begun.left, now);
      start = null;
      unselect();
      const tapped = event.type === "pointerup" && between(begun, event) < 10;
      const again = tapped && tap && event.timeStamp - tap.timeStamp < 350 && between(tap, event) < 30;
      tap = tapped && !again ? event : null;
      if (again) set_view(null);
      else if (event.type === "pointerup" && to - from > 12) set_view([u.posToVal(from, "x"), u.posToVal(to, "x")]);
    };
    over.addEventListener("pointerup", end);
    over.addEventListener("pointercancel", end);
  }

  // Keyboard: arrows read the values, + and − zoom about the cursor, Escape undoes it.
  const spoken = make("div", undefined, document.body);
  spoken.className = "unseen";
  spoken.setAttribute("role", "status");

  const nearest = (sorted, value) => {
    let best = 0;
    sorted.forEach((x, i) => { if (Math.abs(x - value) < Math.abs(sorted[best] - value)) best = i; });
    return best;
  };

  function move_to(plot, wanted) {
    const stops = plot.stops || plot.x, u = plot.u, {min, max} = u.scales.x;
    const x = stops[Math.min(stops.length - 1, Math.max(0, wanted))], margin = (max - min) / 20;
    const beyond = x < min ? x - min - margin : x > max ? x - max + margin : 0;
    if (beyond && plot.shared) set_view([min + beyond, max + beyond]);
    queueMicrotask(() => {  // after the plots have taken the new range
      u.setCursor({left: u.valToPos(x, "x"), top: u.over.clientHeight / 2}, true, true);
      spoken.textContent = [plot.where.textContent, ...plot.values.map(([value, curve]) => `${curve.label} ${value.textContent}`)].join("; ");
    });
  }

  function zoom_by(plot, factor) {
    const u = plot.u, {min, max} = u.scales.x, all = full();
    const centre = u.cursor.left >= 0 ? u.posToVal(u.cursor.left, "x") : (min + max) / 2;
    if ((max - min) * factor >= all[1] - all[0]) set_view(null);
    else if ((max - min) * factor >= 3) set_view([centre - (centre - min) * factor, centre + (max - centre) * factor]);
  }

  const leave = plot => plot.u.setCursor({left: -10, top: -10}, true, true);

  function press(plot, event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const u = plot.u, stops = plot.stops || plot.x;
    const here = u.cursor.left >= 0 ? nearest(stops, u.posToVal(u.cursor.left, "x")) : null;
    const visible = [stops.findIndex(x => x >= u.scales.x.min), stops.findLastIndex(x => x <= u.scales.x.max)];
    const pace = event.shiftKey ? 10 : 1;
    const act = {
      ArrowRight: () => move_to(plot, here === null ? visible[0] : here + pace),
      ArrowLeft: () => move_to(plot, here === null ? visible[1] : here - pace),
      Home: () => move_to(plot, 0), End: () => move_to(plot, stops.length - 1),
      ...(plot.shared ? {"+": () => zoom_by(plot, 0.5), "=": () => zoom_by(plot, 0.5), "-": () => zoom_by(plot, 2)} : {}),
      Escape: () => plot.shared && view ? set_view(null) : leave(plot)
    }[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  function listen(plot, place) {
    if (place.tabIndex === 0) return;  // another curve in the same place
    place.tabIndex = 0;
    place.setAttribute("role", "application");  // otherwise a screen reader keeps the arrow keys
    place.setAttribute("aria-roledescription", "plot");
    place.setAttribute("aria-keyshortcuts", "ArrowLeft ArrowRight Home End" + (plot.shared ? " Plus Minus" : "") + " Escape");
    place.addEventListener("keydown", event => press(plots.get(plot.name), event));
    place.addEventListener("blur", () => leave(plots.get(plot.name)));
  }

  // A text beneath a plot says what the plot does not show.
  function remark(place, text) {
    let note = at(`${place}-remark`);
    if (!note && !text) return;
    if (!note) {
      note = document.createElement("p");
      note.id = `${place}-remark`;
      note.className = "note remark";
      at(place).after(note);
    }
    note.textContent = text;
    note.hidden = !text;
  }

  function build(plot) {
    const place = at(plot.place);
    if (!place) return;
    if (plot.u) plot.u.destroy();
    const axis = {
      stroke: colour("--muted"), font: font(12),
      grid: {stroke: colour("--grid"), width: 1}, ticks: {stroke: colour("--line"), width: 1, size: 5}
    };
    const hidden_grid = plot.image ? {grid: {show: false}} : {};
    const options = {
      width: width_of(place), height: height_of(plot), padding: [10, 18, 0, 0],
      legend: {show: false},
      cursor: {
        y: false, points: {size: 6, fill: (u, i) => plot.curves[i - 1].silent ? "transparent" : colour(plot.curves[i - 1].colour)},
        drag: {x: true, y: false, setScale: false},
        bind: {dblclick: () => () => { if (plot.shared) set_view(null); return null; }},
        ...(plot.shared ? {sync: {key: sync.key, scales: ["x", null], filters: {pub: type => type === "mousemove" || type === "mouseleave"}}} : {})
      },
      scales: {
        x: {time: false, range: () => plot.shared ? view || full() : [0.5, plot.x.length + 0.5]},
        y: plot.scale || {range: (u, min, max) => {
          if (min === null || max === null) return [0, 1];
          const pad = (max - min) * 0.06 || Math.abs(max) * 0.1 || 1;
          return [plot.zero && min >= 0 ? Math.min(0, min) : min - pad, max + pad];
        }}
      },
      axes: [
        {...axis, ...hidden_grid, incrs: steps, size: 30, label: plot.shared ? "Step" : "Lag", labelSize: 18, labelFont: font(12), space: narrow() ? 48 : 64, values: (u, ticks) => ticks.map(v => Number.isInteger(v) ? tick(v) : "")},
        // The width is the same with a label as without, so that steps stand below each other.
        {...axis, ...hidden_grid, size: (narrow() ? 48 : 58) + (plot.label ? 0 : 20), space: 34, ...(plot.incrs ? {incrs: plot.incrs} : {}),
          ...(plot.label ? {label: cut(plot.label, Math.max(8, Math.floor((height_of(plot) - 50) / 8))), labelSize: 20, labelFont: font(12)} : {}),
          ...(plot.filter ? {filter: plot.filter, grid: {...axis.grid, filter: plot.filter}, ticks: {...axis.ticks, filter: plot.filter}} : {}),
          values: (u, ticks) => ticks.map(plot.tick || tick)}
      ],
      series: [{}, ...plot.curves.map(curve => ({
        stroke: colour(curve.colour), width: curve.width || 1.6, dash: curve.dash || [],
        spanGaps: false,
        paths: curve.stepped ? uPlot.paths.stepped({align: 1}) : curve.none ? () => null : undefined,
        points: {
          show: curve.points === undefined ? false : curve.points, filter: lone, size: curve.size || 4.5,
          fill: colour(curve.colour), stroke: colour(curve.colour), width: 0
        }
      }))],
      hooks: {
        setCursor: [() => show_values(plot)],
        setSelect: [u => {
          const {left, width} = u.select;
          if (width > 4 && plot.shared) set_view([u.posToVal(left, "x"), u.posToVal(left + width, "x")]);
          u.setSelect({left: 0, width: 0, top: 0, height: 0}, false);
        }],
        drawClear: plot.image ? [u => plot.image(u)] : []
      }
    };
    plot.u = new uPlot(options, [plot.x, ...plot.curves.map(curve => curve.values)], place);
    if (plot.shared) touch(plot.u);
    listen(plot, place);
    legend_of(plot);
    if (plot.after) plot.after(plot.u);
  }

  function add(plot) {
    if (!at(plot.place) || !plot.x.length) return;
    const before = plots.get(plot.name);
    if (before && before.u) {
      plot.u = before.u;
    }
    plots.set(plot.name, plot);
    build(plot);
  }

  // Outputs, errors, inputs

  const experiment = at("experiment"), output = at("output"), input = at("input"), motion = at("motion");
  const fill = (select, texts, chosen) => {
    texts.forEach((text, i) => { make("option", text, select).value = String(i); });
    select.value = String(chosen);
    if (texts.length < 2) select.disabled = true;
  };

  function draw_traces() {
    const traces = data.traces, e = traces.experiments[Number(experiment.value)];
    const j = Number(output.value), i = Number(input.value), x = traces.x;
    const nominal = traces.nominal;
    const few = traces.stretch === 1;
    // The nominal trajectory may be so much larger than the differences between experiments that it hides every error.
    const departures = nominal && motion && motion.value === "departures";
    const less = (values, mean) => departures ? values.map((v, k) => v === null || mean[k] === null ? null : v - mean[k]) : values;
    const of_output = values => less(values, nominal && nominal.y[j]), of_input = values => less(values, nominal && nominal.u[i]);
    const curves = [
      {label: "Measured", colour: "--c-measured", values: of_output(e.y[j]), width: 1.4, points: few ? undefined_points : false, size: 4},
      {label: "Simulated", colour: "--c-blue", values: of_output(e.simulated[j]), width: 2},
      {label: "One-step prediction", colour: "--c-orange", values: of_output(e.predicted[j]), width: 1.6, dash: [5, 3]}
    ];
    if (nominal && !departures) curves.push({label: "Nominal", colour: "--c-faint", values: nominal.y[j], width: 1.4, dash: [2, 3]});
    add({name: "outputs", place: "plot-outputs", legend: "legend-outputs", shared: true, tall: 310, x, stretch: traces.stretch, curves, label: named(data.outputs[j])});
    add({name: "errors", place: "plot-errors", legend: "legend-errors", shared: true, tall: 190, x, stretch: traces.stretch, label: named(data.outputs[j]), curves: [
      {label: "Measured − simulated", colour: "--c-blue", values: e.simulation_error[j]},
      {label: "Measured − predicted", colour: "--c-orange", values: e.prediction_error[j]}]});
    if (data.inputs.length) {
      const shown = [{label: "Measured", colour: "--c-green", values: of_input(e.u[i]), stepped: few}];
      if (nominal && !departures) shown.push({label: "Nominal", colour: "--c-faint", values: nominal.u[i], width: 1.4, dash: [2, 3]});
      add({name: "inputs", place: "plot-inputs", legend: "legend-inputs", shared: true, tall: 190, x, stretch: traces.stretch, curves: shown, label: named(data.inputs[i])});
    }
    at("previous").disabled = experiment.selectedIndex === 0;
    at("next").disabled = experiment.selectedIndex === experiment.options.length - 1;
    const place = at("plot-outputs");
    if (!few) remark("plot-outputs", `Of every ${traces.stretch} steps the least and the largest value are drawn.`);
    place.setAttribute("aria-label", `${e.label}, output ${named(data.outputs[j])}: measured, simulated and predicted over the steps`);
  }
  // Samples are marked if there is room.
  const undefined_points = (u, i, i0, i1) => (i1 - i0) * 8 < u.bbox.width / devicePixelRatio;

  function setup_traces() {
    fill(experiment, data.traces.experiments.map(e => e.label), data.traces.first);
    fill(output, data.outputs.map(named), 0);
    fill(input, data.inputs.length ? data.inputs.map(named) : ["none"], 0);
    if (motion) {
      // The least and largest values of a stretch cannot be compared with the nominal ones.
      make("option", "whole motion", motion).value = "whole";
      make("option", "departures from nominal", motion).value = "departures";
      motion.disabled = data.traces.stretch > 1;
    }
    for (const select of [experiment, output, input, motion].filter(s => s)) select.addEventListener("change", draw_traces);
    const move = by => {
      experiment.selectedIndex = Math.min(experiment.options.length - 1, Math.max(0, experiment.selectedIndex + by));
      draw_traces();
    };
    at("previous").addEventListener("click", () => move(-1));
    at("next").addEventListener("click", () => move(1));
    at("reset").addEventListener("click", () => set_view(null));
    draw_traces();
  }

  // Singular values: dark is small and bright is large. The lightness of the scale rises evenly.

  const scale = [[68, 1, 84], [72, 40, 120], [62, 74, 137], [49, 104, 142], [38, 130, 142], [31, 158, 137], [53, 183, 121], [110, 206, 88], [181, 222, 43], [253, 231, 37]];
  function shade(share) {
    const x = Math.min(1, Math.max(0, share)) * (scale.length - 1), i = Math.min(scale.length - 2, Math.floor(x)), f = x - i;
    return scale[i].map((c, n) => Math.round(c + f * (scale[i + 1][n] - c)));
  }

  function draw_order() {
    const sigma = data.sigma;
    if (!sigma || !sigma.log.length) return;
    // Values at rounding level are grey, so that the colours are left to the rest.
    const rounding = value => value === null || sigma.rounding === null || value < sigma.rounding;
    const all = sigma.log.flat(), sizes = all.filter(value => !rounding(value));
    let most = sizes.reduce((a, b) => Math.max(a, b), -Infinity), least = sizes.reduce((a, b) => Math.min(a, b), Infinity);
    least = Math.min(100 * Math.floor(least / 100), most - 100);
    most = 100 * Math.ceil(most / 100);
    const grey = [140, 148, 158];
    const picture = document.createElement("canvas");
    picture.width = sigma.log.length;
    picture.height = sigma.rows;
    const context = picture.getContext("2d"), pixels = context.createImageData(picture.width, picture.height);
    sigma.log.forEach((column, x) => column.forEach((value, y) => {
      const [r, g, b] = rounding(value) ? grey : shade((value - least) / (most - least));
      pixels.data.set([r, g, b, 255], 4 * (y * picture.width + x));
    }));
    context.putImageData(pixels, 0, 0);

    const x = sigma.log.map((_, s) => sigma.begin + s * sigma.stride - 0.5);
    const order = sigma.order.map(n => n + 0.5);
    x.push(sigma.begin + sigma.log.length * sigma.stride - 0.5);
    order.push(order[order.length - 1]);
    add({
      name: "order", place: "plot-order", legend: "legend-order", shared: true, tall: Math.min(380, 130 + 16 * sigma.rows), x,
      curves: [{label: "", silent: true, colour: "--surface", values: order, stepped: true, width: 5},
               {label: "Number of states", colour: "--c-orange", values: order, shown: sigma.order, stepped: true, width: 2.4}],
      label: "Singular value",
      step_of: s => sigma.begin + s * sigma.stride, stretch: sigma.stride,
      stops: sigma.order.map((_, s) => sigma.begin + (s + 0.5) * sigma.stride - 0.5),
      pick: u => {
        if (u.cursor.left < 0) return null;
        const s = Math.floor((u.posToVal(u.cursor.left, "x") - sigma.begin + 0.5) / sigma.stride);
        return s >= 0 && s < sigma.order.length ? s : null;
      },
      scale: {range: [0.5, sigma.rows + 0.5], dir: -1}, incrs: [1, 2, 5, 10],
      tick: v => Number.isInteger(v) && v >= 1 && v <= sigma.rows ? String(v) : "",
      image: u => {
        const c = u.ctx, left = u.valToPos(sigma.begin - 0.5, "x", true);
        const right = u.valToPos(sigma.begin + sigma.log.length * sigma.stride - 0.5, "x", true);
        const top = u.valToPos(0.5, "y", true), bottom = u.valToPos(sigma.rows + 0.5, "y", true);
        c.save();
        c.beginPath();
        c.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
        c.clip();
        c.imageSmoothingEnabled = false;
        c.drawImage(picture, left, top, right - left, bottom - top);
        c.restore();
      },
      bar: place => {
        if (sizes.length) scale_of(place);
        if (sizes.length === all.length) return;
        const none = make("span", undefined, place), chip = make("i", undefined, none);
        chip.className = "chip";
        chip.style.background = `rgb(${grey.join()})`;
        make("span", "rounding errors", none);
      }
    });
    if (sigma.stride > 1) remark("plot-order", `Of every ${sigma.stride} steps the largest values are drawn.`);

    function scale_of(place) {
      const item = make("span", undefined, place);
      item.className = "bar";
      make("span", raised(least / 100), item);
      const strip = make("canvas", undefined, item);
      strip.width = 64;
      strip.height = 1;
      const c = strip.getContext("2d");
      for (let i = 0; i < 64; ++i) { c.fillStyle = `rgb(${shade(i / 63).join()})`; c.fillRect(i, 0, 1, 1); }
      make("span", raised(most / 100), item);
    }
  }

  // Quality of the regression of each step

  function draw_steps() {
    const p = data.per_step, x = p.x;
    const some = values => values && values.some(v => v !== null);
    if (some(p.condition))
      add({name: "condition", place: "plot-condition", legend: "legend-condition", shared: true, tall: 200, x, stretch: p.stretch,
        curves: [{label: "Condition number", colour: "--c-blue", values: p.condition.map(v => v > 0 ? v : null), points: undefined_points}],
        scale: {distr: 3}, tick: v => v === null ? "" : v >= 1e4 ? raised(Math.round(Math.log10(v))) : tick(v),
        // The axis shows decades only; within a single decade it shows 1, 2 and 5.
        filter: (u, ticks) => {
          const decades = ticks.map(v => Math.abs(Math.log10(v) - Math.round(Math.log10(v))) < 1e-6 ? v : null);
          const count = decades.filter(v => v !== null).length, stride = Math.ceil(count / 6);
          return count < 3 ? ticks.map(v => [1, 2, 5].includes(Math.round(v / 10 ** Math.floor(Math.log10(v) + 1e-9))) ? v : null) : decades.map(v => v !== null && Math.round(Math.log10(v)) % stride === 0 ? v : null);
        }});
    const counts = [["unknowns", "Unknowns", "--c-faint", 4], ["rank", "Rank", "--c-blue", 1.8], ["lags", "Lag order", "--c-orange", 1.8], ["states", "States", "--c-green", 1.8]]
      .filter(([key]) => some(p[key])).map(([key, label, name, width], i) => ({label, colour: name, values: p[key], stepped: true, width, dash: i > 2 ? [5, 3] : []}));
    if (some(p.rank))
      add({name: "rank", place: "plot-rank", legend: "legend-rank", shared: true, tall: 200, x, stretch: p.stretch, zero: true, curves: counts});
    const error = data.step_error;
    add({name: "step", place: "plot-step", legend: "legend-step", shared: true, tall: 180, x: error.x, stretch: error.stretch, zero: true,
      curves: [{label: "One-step error over the spread of the outputs", colour: "--c-orange", values: error.value, points: undefined_points}]});
  }

  // Entries of matrices

  function draw_entries(name, symbol, table, select) {
    if (!select || !table.values.length || !table.x.length) return;
    const chosen = select.value === "all" ? null : Number(select.value), curves = [];
    for (let i = 0; i < table.rows; ++i) {
      if (chosen !== null && i !== chosen) continue;
      for (let j = 0; j < table.cols; ++j) {
        const n = curves.length;
        curves.push({label: `${symbol}(${i + 1},${j + 1})`, colour: palette[n % palette.length], dash: dashes[Math.floor(n / palette.length) % dashes.length],
          values: table.values[i * table.cols + j], width: 1.5});
      }
    }
    add({name, place: `plot-${name}`, legend: `legend-${name}`, shared: true, tall: 260, x: table.x, stretch: table.stretch, curves});
  }

  function setup_entries(name, symbol, table, select) {
    if (!select) return;  // no states
    const all = table.rows * table.cols <= 8;
    if (all || table.rows === 0) make("option", "all", select).value = "all";
    for (let i = 0; i < table.rows; ++i) make("option", `row ${i + 1}`, select).value = String(i);
    select.addEventListener("change", () => draw_entries(name, symbol, table, select));
    select.disabled = select.options.length < 2;
    draw_entries(name, symbol, table, select);
  }

  // Eigenvalues

  const poles = data.poles;
  let pole = 0, timer = null, faint = null, pole_at = null;
  const pole_colours = {open: "--c-orange", closed: "--c-blue"};
  const extent = (() => {
    const sizes = [];
    for (const list of [poles.open, poles.closed]) for (const values of list) for (const v of values) if (v !== null) sizes.push(Math.abs(v));
    sizes.sort((a, b) => a - b);
    const most = sizes.length ? sizes[Math.min(sizes.length - 1, Math.floor(0.995 * sizes.length))] : 1;
    return Math.min(4, Math.max(1.12, most * 1.06));
  })();

  function mark(c, kind, x, y, size) {
    c.beginPath();
    if (kind === "open") c.arc(x, y, size, 0, 2 * Math.PI);
    else { c.moveTo(x, y - size); c.lineTo(x + size, y); c.lineTo(x, y + size); c.lineTo(x - size, y); c.closePath(); }
  }

  function each(list, k, use) {
    const values = list[k];
    for (let i = 0; i + 1 < values.length; i += 2) if (values[i] !== null) use(values[i], values[i + 1]);
  }

  const in_square = (re, im) => Math.abs(re) <= extent && Math.abs(im) <= extent;

  function pole_remarks() {
    const texts = [];
    if (poles.stride > 1)
      texts.push(`Of every ${poles.stride} steps those two are drawn at which A and A + GC have their largest eigenvalues.`);
    let count = 0, outside = 0, most = 0;
    for (const list of [poles.open, poles.closed])
      for (const k of poles.k.keys())
        each(list, k, (re, im) => {
          ++count;
          if (!in_square(re, im)) ++outside, most = Math.max(most, Math.hypot(re, im));
        });
    if (outside)
      texts.push(`${outside} of ${count} eigenvalues ${outside === 1 ? "lies" : "lie"} outside this square, up to ${short(most)} in magnitude; those of the chosen step stand at its edge, small.`);
    remark("plot-poles", texts.join(" "));
  }

  function pole_canvas(size) {
    const canvas = document.createElement("canvas"), ratio = window.devicePixelRatio || 1;
    canvas.width = canvas.height = Math.round(size * ratio);
    const c = canvas.getContext("2d");
    c.scale(ratio, ratio);
    return [canvas, c];
  }

  function draw_poles(anew) {
    const place = at("plot-poles");
    if (!place || !poles.k.length) return;
    const size = Math.min(width_of(place), 540), gap = extent > 2 ? 1 : 0.5;
    const marks = [];
    for (let v = -Math.floor(extent / gap) * gap; v <= extent; v += gap) marks.push(v);
    // Room for the widest label at the left, for one line below, and for half a label at the right.
    const ruler = document.createElement("canvas").getContext("2d");
    ruler.font = font(12);
    const label_width = Math.max(...marks.map(v => ruler.measureText(tick(v)).width));
    const left = Math.ceil(label_width) + 8, bottom = 24, rest = 8;
    const unit = Math.min(size - left - rest, size - bottom - rest) / (2 * extent);
    const px = re => left + (re + extent) * unit, py = im => rest + (extent - im) * unit;
    pole_at = (re, im) => [px(re), py(im)];
    if (anew || !faint) {
      const [canvas, c] = pole_canvas(size);
      faint = canvas;
      c.font = font(12);
      c.strokeStyle = colour("--grid");
      c.fillStyle = colour("--muted");
      for (const v of marks) {
        c.beginPath();
        c.moveTo(px(v), py(-extent)); c.lineTo(px(v), py(extent));
        c.moveTo(px(-extent), py(v)); c.lineTo(px(extent), py(v));
        c.stroke();
        c.textAlign = "center";
        c.fillText(tick(v), px(v), py(-extent) + 17);
        c.textAlign = "right";
        if (v !== 0) c.fillText(tick(v), left - 5, py(v) + 4);
      }
      c.strokeStyle = colour("--c-faint");
      c.beginPath();
      c.moveTo(px(-extent), py(0)); c.lineTo(px(extent), py(0));
      c.moveTo(px(0), py(-extent)); c.lineTo(px(0), py(extent));
      c.stroke();
      c.lineWidth = 1.6;
      c.strokeStyle = colour("--muted");
      c.beginPath();
      c.arc(px(0), py(0), unit, 0, 2 * Math.PI);
      c.stroke();
      c.save();
      c.beginPath();
      c.rect(px(-extent), py(extent), 2 * extent * unit, 2 * extent * unit);
      c.clip();
      c.globalAlpha = Math.min(0.55, Math.max(0.12, 60 / poles.k.length));
      for (const kind of ["open", "closed"]) {
        c.fillStyle = colour(pole_colours[kind]);
        for (let k = 0; k < poles.k.length; ++k) each(poles[kind], k, (re, im) => { mark(c, kind, px(re), py(im), 2.6); c.fill(); });
      }
      c.restore();
    }
    const [canvas, c] = pole_canvas(size);
    canvas.style.width = canvas.style.height = `${size}px`;
    c.save();
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.drawImage(faint, 0, 0);
    c.restore();
    for (const kind of ["open", "closed"]) {
      c.strokeStyle = colour(pole_colours[kind]);
      c.fillStyle = colour("--surface");
      c.lineWidth = 2.6;
      each(poles[kind], pole, (re, im) => {
        const inside = in_square(re, im);
        const clamp = v => Math.max(-extent, Math.min(extent, v));
        mark(c, kind, px(clamp(re)), py(clamp(im)), inside ? 6.5 : 3.5);
        c.globalAlpha = 0.4;  // the other steps shine through
        c.fill();
        c.globalAlpha = 1;
        c.stroke();
      });
    }
    place.replaceChildren(canvas);
    const step = `Step ${poles.k[pole]}, ${short(poles.k[pole] * data.dt)} s`;
    at("pole-label").textContent = step;
    at("pole-step").setAttribute("aria-valuetext", step);
    const text = kind => short(largest(poles[kind][pole]));
    const legend = at("legend-poles");
    legend.replaceChildren();
    for (const [kind, shape, label] of [["open", "dot", "Open loop, A"], ["closed", "ring", "With the observer, A + GC"]]) {
      const item = make("span", undefined, legend), swatch = make("i", undefined, item);
      swatch.className = shape;
      swatch.style.borderColor = colour(pole_colours[kind]);
      make("span", label, item);
      make("b", `largest ${text(kind)}`, item);
    }
  }

  function play(on) {
    clearInterval(timer);
    timer = null;
    if (on) timer = setInterval(() => {
      pole = (pole + 1) % poles.k.length;
      at("pole-step").value = String(pole);
      draw_poles(false);
    }, Math.max(40, Math.min(250, 12000 / poles.k.length)));
    at("pole-play").textContent = on ? "Stop" : "Play";
  }

  function draw_radius() {
    add({name: "radius", place: "plot-radius", legend: "legend-radius", shared: true, tall: 290, x: poles.k, zero: true, curves: [
      {label: "Open loop", colour: "--c-orange", values: poles.open.map(largest)},
      {label: "With the observer", colour: "--c-blue", values: poles.closed.map(largest), dash: [5, 3]},
      {label: "Unit circle", colour: "--c-faint", values: poles.k.map(() => 1), width: 1.2}]});
  }
  function largest(values) {
    let most = null;
    for (let i = 0; i + 1 < values.length; i += 2) if (values[i] !== null) most = Math.max(most || 0, Math.hypot(values[i], values[i + 1]));
    return most;
  }

  function setup_poles() {
    const slider = at("pole-step"), button = at("pole-play");
    if (!slider || !poles.k.length) return;  // no step has eigenvalues
    slider.max = String(poles.k.length - 1);
    slider.disabled = button.disabled = poles.k.length < 2;
    slider.addEventListener("input", () => { pole = Number(slider.value); draw_poles(false); });
    button.addEventListener("click", () => play(timer === null));
    draw_poles(true);
    pole_remarks();
    draw_radius();
  }

  // Whiteness

  function draw_whiteness() {
    const white = data.whiteness;
    if (!white) return;
    const x = white.bound.map((_, i) => i + 1), bound = white.bound;
    const curves = [
      {label: "99 % bound", colour: "--c-faint", values: bound, dash: [4, 4]},
      {label: "", silent: true, colour: "--c-faint", values: bound.map(v => v === null ? null : -v), dash: [4, 4]}];
    white.correlation.slice(0, 12).forEach((values, j) => curves.push({label: data.outputs[j].name, colour: palette[j % palette.length],
      dash: dashes[Math.floor(j / palette.length) % dashes.length], values, points: true, size: 7}));
    add({name: "whiteness", place: "plot-whiteness", legend: "legend-whiteness", shared: false, tall: 220, x, curves,
      scale: {range: (u, min, max) => {
        const most = 1.15 * Math.max(Math.abs(min || 0), Math.abs(max || 0), 0.02);
        return [-most, most];
      }}});
  }

  setup_traces();
  draw_order();
  draw_steps();
  setup_entries("gain", "G", data.gain, at("gain-row"));
  setup_entries("a", "A", data.A, at("a-row"));
  setup_poles();
  draw_whiteness();

  function rebuild() {
    draw_traces();
    for (const plot of plots.values()) if (!["outputs", "errors", "inputs"].includes(plot.name)) build(plot);
    draw_poles(true);
    set_view(view);
  }
  document.addEventListener("tokid:theme", rebuild);

  let width = root.clientWidth, pending = 0;
  new ResizeObserver(() => {
    if (root.clientWidth === width || printing()) return;
    width = root.clientWidth;
    cancelAnimationFrame(pending);
    pending = requestAnimationFrame(() => {
      for (const plot of plots.values()) plot.u.setSize({width: width_of(at(plot.place)), height: height_of(plot)});
      draw_poles(true);
    });
  }).observe(root);

  // For tests and for users of the console.
  window.tokid = {
    plots: () => [...plots.values()].map(plot => ({
      name: plot.name, shared: plot.shared, from: plot.u.scales.x.min, to: plot.u.scales.x.max,
      place: plot.place, x: plot.x, area: plot.u.bbox,
      curves: plot.curves.map(curve => ({label: curve.label, values: curve.values, colour: colour(curve.colour)}))
    })),
    plot: name => plots.get(name).u,
    poles: () => ({step: poles.k[pole], open: poles.open[pole], closed: poles.closed[pole]}),
    pole_at: (re, im) => pole_at(re, im),
    zoom: (from, to) => set_view(from === undefined ? null : [from, to])
  };
})();
