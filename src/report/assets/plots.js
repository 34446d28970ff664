// Draws plots for the script of a page, with uPlot: curves over time or anything else, and points in the complex plane.
// Names come from files, so they enter as text, never as HTML.
// SPDX-License-Identifier: BSD-3-Clause
"use strict";
const tokid = (() => {
  const data = JSON.parse(document.getElementById("report-data").textContent);
  const root = document.documentElement;
  const at = id => document.getElementById(id);
  const colour = name => getComputedStyle(root).getPropertyValue(name).trim();
  const palette = ["--c-blue", "--c-orange", "--c-green", "--c-purple", "--c-pink", "--c-sky", "--c-yellow", "--c-measured"];
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

  // Formats numbers for people.
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

  // All plots over time show the same range of steps.
  const plots = new Map();  // name → plot
  const first_step = 0, last_step = Math.max(data.steps - 1, (data.end || 0) - 1, 1);
  let view = null;  // the steps [from, to] that are shown; null: all steps
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
    const reset = at("reset");  // the paper's page has none
    if (reset) reset.disabled = !view;
  }

  // Axes over time are in seconds, if the data state their sample time. The plots themselves count steps.
  const timed = data.dt_stated !== false, step_size = timed ? data.dt : 1;
  const time_of = k => `step ${k}${timed ? `, ${short(k * data.dt)} s` : ""}`;
  function time_ticks(u, axis, min, max) {
    const room = Math.max(2, Math.floor(u.bbox.width / devicePixelRatio / (narrow() ? 56 : 72)));
    const least = (max - min) * step_size / room, power = 10 ** Math.floor(Math.log10(least));
    const nice = [1, 2, 5, 10].map(factor => factor * power).find(width => width >= 0.999 * least);
    const width = timed ? nice : Math.max(1, nice), ticks = [];
    for (let i = Math.ceil(min * step_size / width); i * width <= max * step_size; ++i) ticks.push(i * width / step_size);
    return ticks;
  }

  const sync = uPlot.sync("steps");
  const steps = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 1e4, 2e4, 5e4, 1e5, 2e5, 5e5];

  function width_of(place) {
    return printing() ? Math.min(printed_width, place.clientWidth || printed_width) : Math.max(200, place.clientWidth);
  }
  // The space for the axes and the margins. The vertical axis has the same width with and without a label, so that the
  // same steps of different plots are one below the other.
  const margin = {top: 10, right: 18}, below = 48, beside = plot => plot.square ? 58 : narrow() ? 68 : 78;
  function height_of(plot) {
    if (plot.square) return width_of(at(plot.place)) - beside(plot) - margin.right + below + margin.top;
    return printing() ? 200 : Math.round((plot.tall || 250) * (narrow() ? 0.84 : 1));
  }

  // A line would not show a single sample between two gaps.
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
    for (const curve of [...plot.clouds, ...plot.curves]) {
      if (curve.silent) continue;
      const item = make("span", undefined, place), swatch = make("i", undefined, item);
      swatch.style.borderColor = colour(curve.colour);
      swatch.className = curve.mark || (curve.dash && curve.dash.length ? "dashed" : "");
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
    else if (plot.where_of) plot.where.textContent = plot.where_of(k);
    else if (plot.shared) {
      // A point of a thinned curve is the least or the largest value of its stretch, from any step of the stretch.
      if (plot.stretch > 1) {
        const begin = plot.step_of ? plot.step_of(k) : plot.x[k - k % 2];
        const end = Math.min(begin + plot.stretch - 1, last_step);
        const times = timed ? `, ${short(begin * data.dt)}–${short(end * data.dt)} s` : "";
        plot.where.textContent = `${plot.step_of ? "largest" : "least or largest"} of steps ${begin}–${end}${times}`;
        return;
      }
      plot.where.textContent = time_of(plot.step_of ? plot.step_of(k) : plot.x[k]);
    }
    else plot.where.textContent = `${plot.x_label}: ${short(plot.x[k])}`;
  }

  // Touch: a horizontal movement zooms, a vertical movement scrolls the page, and a double tap shows the whole range
  // again.
  function touch(u) {
    const over = u.over, fingers = new Set();
    let start = null, tap = null;  // where a single finger touched; the last tap
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

  // Keyboard: arrows read the values, + and − zoom about the cursor, Escape shows the whole range again.
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
    if (place.tabIndex === 0) return;  // the place already has these handlers, from an earlier curve
    place.tabIndex = 0;
    place.setAttribute("role", "application");  // otherwise a screen reader keeps the arrow keys
    place.setAttribute("aria-roledescription", "plot");
    place.setAttribute("aria-keyshortcuts", "ArrowLeft ArrowRight Home End" + (plot.shared ? " Plus Minus" : "") + " Escape");
    place.addEventListener("keydown", event => press(plots.get(plot.name), event));
    place.addEventListener("blur", () => leave(plots.get(plot.name)));
  }

  // A text below a plot states what the plot does not show.
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

  // A range around the values. If all values are equal, the range still has a width.
  function roomy(min, max) {
    const room = (max - min) * 0.06 || Math.abs(max) * 0.1 || 1;
    return [min - room, max + room];
  }

  function x_range(plot) {
    if (plot.shared) return view || full();
    if (plot.x_log) return [plot.x[0], plot.x[plot.x.length - 1]];
    return plot.square ? [-plot.square, plot.square] : roomy(plot.x[0], plot.x[plot.x.length - 1]);
  }

  function y_scale(plot) {
    if (plot.scale) return plot.scale;
    if (plot.square) return {range: () => x_range(plot)};
    const values = (min, max) => plot.y_range || (min === null || max === null ? [plot.log ? 0.1 : 0, 1] : [min, max]);
    if (plot.log) return {distr: 3, range: (u, min, max) => uPlot.rangeLog(...values(min, max), 10, false)};
    return {range: (u, min, max) => {
      const [least, most] = values(min, max), [from, to] = roomy(least, most);
      return [plot.zero && least >= 0 ? 0 : from, to];
    }};
  }

  // A logarithmic axis has labels at powers of ten. If it shows less than three decades, it also has labels at 2 and 5.
  function decades(u, ticks) {
    const exponents = ticks.map(v => Math.log10(v)), whole = exponents.map(e => Math.abs(e - Math.round(e)) < 1e-6);
    const count = whole.filter(is => is).length, stride = Math.ceil(count / 6);
    const near = (v, digit) => Math.abs(v / 10 ** Math.floor(Math.log10(v) + 1e-9) - digit) < 1e-6;
    const shown = count < 3 ? v => [1, 2, 5].some(digit => near(v, digit))
                            : (v, i) => whole[i] && Math.round(exponents[i]) % stride === 0;
    return ticks.map((v, i) => shown(v, i) ? v : null);
  }

  function axes_of(plot) {
    const look = {stroke: colour("--muted"), font: font(12), labelFont: font(12)};
    const filter = plot.log ? {filter: decades} : {};
    const lines = filter => ({
      grid: {stroke: colour("--grid"), width: 1, show: !plot.image, ...filter},
      ticks: {stroke: colour("--line"), width: 1, size: 5, ...filter}
    });
    const incrs = plot.square ? [0.5, 1, 2] : plot.incrs;
    const whole = plot.x.every(Number.isInteger) ? steps : undefined;
    const time = plot.shared ? {splits: time_ticks, values: (u, ticks) => ticks.map(k => tick(k * step_size)), label: timed ? "Time [s]" : "Step"}
                             : {values: (u, ticks) => ticks.map(tick), label: plot.x_label, ...(plot.x_log ? {filter: decades} : {})};
    const label = plot.label ? cut(plot.label, Math.max(8, Math.floor((height_of(plot) - 38) / 6.8))) : null;
    return [
      {...look, ...lines({}), incrs: plot.square ? incrs : whole, size: below - 18, labelSize: 18, space: narrow() ? 48 : 64, ...time},
      {...look, ...lines(filter), ...filter, incrs, label, labelSize: 20, space: 34,
        // Long numbers need more space.
        size: (u, texts) => Math.max(beside(plot) - (label ? 20 : 0), 13 + 6.2 * Math.max(0, ...(texts || []).map(text => [...text].length))),
        values: (u, ticks) => ticks.map(plot.tick || (v => plot.log && v >= 1e4 ? raised(Math.round(Math.log10(v))) : tick(v)))}
    ];
  }

  function mark(c, kind, x, y, size) {
    c.beginPath();
    if (kind === "dot") c.arc(x, y, size, 0, 2 * Math.PI);
    else { c.moveTo(x, y - size); c.lineTo(x + size, y); c.lineTo(x, y + size); c.lineTo(x - size, y); c.closePath(); }
  }

  // Draws the axes of the complex plane, the unit circle, and the points of each cloud. Many points are drawn faintly,
  // so that dense places become darker.
  function plane(u, plot) {
    const canvas = document.createElement("canvas"), c = canvas.getContext("2d"), pixel = devicePixelRatio;
    const {left, top, width, height} = u.bbox, x = re => u.valToPos(re, "x", true), y = im => u.valToPos(im, "y", true);
    canvas.width = u.ctx.canvas.width;
    canvas.height = u.ctx.canvas.height;
    c.rect(left, top, width, height);
    c.clip();
    c.strokeStyle = colour("--c-faint");
    c.lineWidth = pixel;
    c.beginPath();
    c.moveTo(left, y(0)); c.lineTo(left + width, y(0));
    c.moveTo(x(0), top); c.lineTo(x(0), top + height);
    c.stroke();
    c.lineWidth = 1.6 * pixel;
    c.strokeStyle = colour("--muted");
    c.beginPath();
    c.arc(x(0), y(0), x(1) - x(0), 0, 2 * Math.PI);
    c.stroke();
    for (const cloud of plot.clouds) {
      c.globalAlpha = Math.min(0.55, Math.max(0.12, 240 / cloud.x.length));
      c.fillStyle = colour(cloud.colour);
      cloud.x.forEach((re, i) => { mark(c, cloud.mark, x(re), y(cloud.y[i]), 2.6 * pixel); c.fill(); });
    }
    return canvas;
  }

  function series_of(plot) {
    return plot.curves.map(curve => ({
      stroke: colour(curve.colour), width: curve.width || 1.6, dash: curve.dash || [],
      spanGaps: false,
      paths: curve.marks ? () => null : curve.stepped ? uPlot.paths.stepped({align: 1}) : undefined,
      points: {
        show: curve.marks || (curve.points === undefined ? false : curve.points), filter: lone, size: curve.size || 4.5,
        fill: colour(curve.colour), stroke: colour(curve.colour), width: 0
      }
    }));
  }

  function build(plot) {
    const place = at(plot.place);
    if (plot.u) plot.u.destroy();
    place.classList.toggle("square", Boolean(plot.square));
    let picture = null;  // a copy of the drawn plane, because drawing many points takes long
    const options = {
      width: width_of(place), height: height_of(plot), padding: [margin.top, margin.right, 0, 0],
      legend: {show: false},
      cursor: {
        show: !plot.square, y: false,
        points: {size: 6, fill: (u, i) => plot.curves[i - 1].silent ? "transparent" : colour(plot.curves[i - 1].colour)},
        drag: {x: true, y: false, setScale: false},
        bind: {dblclick: () => () => { if (plot.shared) set_view(null); return null; }},
        ...(plot.shared ? {sync: {key: sync.key, scales: ["x", null], filters: {pub: type => type === "mousemove" || type === "mouseleave"}}} : {})
      },
      scales: {x: {time: false, ...(plot.x_log ? {distr: 3} : {}), range: () => x_range(plot)}, y: y_scale(plot)},
      axes: axes_of(plot),
      series: [{}, ...series_of(plot)],
      bands: (plot.bands || []).map(([upper, lower, name]) => ({series: [upper + 1, lower + 1], fill: `${colour(name)}2e`})),
      hooks: {
        setCursor: [() => show_values(plot)],
        setSelect: [u => {
          const {left, width} = u.select;
          if (width > 4 && plot.shared) set_view([u.posToVal(left, "x"), u.posToVal(left + width, "x")]);
          u.setSelect({left: 0, width: 0, top: 0, height: 0}, false);
        }],
        drawClear: plot.image ? [u => plot.image(u)] : [],
        drawAxes: plot.square ? [u => u.ctx.drawImage(picture ||= plane(u, plot), 0, 0)] : [],
        draw: plot.front ? [u => plot.front(u)] : []
      }
    };
    const drawn = curve => plot.log ? curve.values.map(v => v > 0 ? v : null) : curve.values;
    plot.u = new uPlot(options, [plot.x, ...plot.curves.map(drawn)], place);
    if (plot.shared) touch(plot.u);
    if (!plot.square) listen(plot, place);
    legend_of(plot);
  }

  // Draws a plot in its place, `plot-NAME` with `legend-NAME`, or draws it anew.
  //   x, curves [{label, colour, values, width, dash, stepped, points, size, silent, shown, marks}]: values over x;
  //   marks: points without a line
  //   square, clouds [{label, colour, mark, x, y}]: points of the complex plane within ±square, "dot" or "ring"
  //   shared: x are steps, and all such plots show one range of them; otherwise x_label names x
  //   where_of: a text on the point under the cursor
  //   stretch, step_of, stops, pick: the steps of a point that stands for several, and where the cursor stops
  //   x_log: a logarithmic horizontal axis
  //   bands [[upper, lower, colour]]: the area between two of the curves
  //   label, log, y_range, zero, scale, incrs, tick: the vertical axis
  //   bar, image, front: functions that draw into the legend, behind all else and before all else
  function add(plot) {
    plot = {x: [-plot.square, plot.square], curves: [], clouds: [], ...plot, place: `plot-${plot.name}`, legend: `legend-${plot.name}`};
    if (!at(plot.place) || !plot.x.length) return null;
    const before = plots.get(plot.name);
    if (before) plot.u = before.u;
    plots.set(plot.name, plot);
    build(plot);
    return plot;
  }

  function rebuild() {
    for (const plot of plots.values()) build(plot);
  }
  document.addEventListener("tokid:theme", rebuild);

  let width = root.clientWidth, pending = 0;
  new ResizeObserver(() => {
    if (root.clientWidth === width || printing()) return;
    width = root.clientWidth;
    cancelAnimationFrame(pending);
    pending = requestAnimationFrame(rebuild);
  }).observe(root);

  return {
    data, at, make, colour, palette, raised, short, tick, time_of, add, remark, mark, set_view,
    // For tests and for the console of the browser.
    plots: () => [...plots.values()].map(plot => ({
      name: plot.name, shared: Boolean(plot.shared), from: plot.u.scales.x.min, to: plot.u.scales.x.max,
      place: plot.place, x: plot.x, area: plot.u.bbox, x_label: plot.u.axes[0].label,
      ticks: plot.u.axes[0]._splits, tick_texts: plot.u.axes[0]._values,
      curves: plot.curves.map(curve => ({label: curve.label, values: curve.values, colour: colour(curve.colour)})),
      clouds: plot.clouds.map(cloud => ({...cloud, colour: colour(cloud.colour)}))
    })),
    plot: name => plots.get(name).u,
    zoom: (from, to) => set_view(from === undefined ? null : [from, to])
  };
})();
