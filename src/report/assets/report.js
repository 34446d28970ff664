// Fills the controls of a model's report and draws its plots. SPDX-License-Identifier: BSD-3-Clause
"use strict";
(() => {
  const {data, at, make, colour, palette, raised, short, time_of, add, remark, mark, set_view} = tokid;
  const dashes = [[], [6, 4], [2, 3], [9, 3, 2, 3]];
  // The curves of the other models of a comparison.
  const other_colours = ["--c-green", "--c-purple", "--c-pink", "--c-sky", "--c-yellow"];
  const other_look = i => ({colour: other_colours[i % other_colours.length], dash: [[6, 3], [2, 2], [8, 3, 2, 3]][Math.floor(i / other_colours.length) % 3]});
  const named = channel => channel.unit ? `${channel.name} [${channel.unit}]` : channel.name;

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
    // The nominal trajectory may be much larger than the differences between experiments, and would then hide every
    // error.
    const departures = nominal && motion && motion.value === "departures";
    const less = (values, mean) => departures ? values.map((v, k) => v === null || mean[k] === null ? null : v - mean[k]) : values;
    const of_output = values => less(values, nominal && nominal.y[j]), of_input = values => less(values, nominal && nominal.u[i]);
    const curves = [
      {label: "Measured", colour: "--c-measured", values: of_output(e.y[j]), width: 1.4, points: few ? undefined_points : false, size: 4},
      {label: "Simulated", colour: "--c-blue", values: of_output(e.simulated[j]), width: 2},
      {label: "One-step prediction", colour: "--c-orange", values: of_output(e.predicted[j]), width: 1.6, dash: [5, 3]}
    ];
    e.others.forEach((values, i) => curves.push({label: `Simulated by ${data.models[i + 1]}`, ...other_look(i), values: of_output(values[j]), width: 1.6}));
    if (nominal && !departures) curves.push({label: "Nominal", colour: "--c-faint", values: nominal.y[j], width: 1.4, dash: [2, 3]});
    add({name: "outputs", shared: true, tall: 310, x, stretch: traces.stretch, curves, label: named(data.outputs[j])});
    add({name: "errors", shared: true, tall: 190, x, stretch: traces.stretch, label: named(data.outputs[j]), curves: [
      {label: "Measured − simulated", colour: "--c-blue", values: e.simulation_error[j]},
      {label: "Measured − predicted", colour: "--c-orange", values: e.prediction_error[j]}]});
    if (data.inputs.length) {
      const shown = [{label: "Measured", colour: "--c-green", values: of_input(e.u[i]), stepped: few}];
      if (nominal && !departures) shown.push({label: "Nominal", colour: "--c-faint", values: nominal.u[i], width: 1.4, dash: [2, 3]});
      add({name: "inputs", shared: true, tall: 190, x, stretch: traces.stretch, curves: shown, label: named(data.inputs[i])});
    }
    at("previous").disabled = experiment.selectedIndex === 0;
    at("next").disabled = experiment.selectedIndex === experiment.options.length - 1;
    const place = at("plot-outputs");
    if (!few) remark("plot-outputs", `Of every ${traces.stretch} steps the least and the largest value are drawn.`);
    place.setAttribute("aria-label", `${e.label}, output ${named(data.outputs[j])}: measured, simulated and predicted over time`);
  }
  // Samples are marked if there is enough space.
  const undefined_points = (u, i, i0, i1) => (i1 - i0) * 8 < u.bbox.width / devicePixelRatio;

  function setup_traces() {
    fill(experiment, data.traces.experiments.map(e => e.label), data.traces.first);
    fill(output, data.outputs.map(named), 0);
    fill(input, data.inputs.length ? data.inputs.map(named) : ["none"], 0);
    if (motion) {
      // The points of a stretch are its least and largest values, from different steps than those of the nominal
      // trajectory, so their difference has no meaning.
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

  // The errors of all experiments. The logarithmic axis needs values above zero; an exact error of zero is not drawn.

  function draw_experiments() {
    const e = data.experiments, errors = ["simulation_error", "one_step_error"].flatMap(key => e[key]).filter(v => v > 0);
    if (!errors.length) return;
    const points = (u, i, i0, i1) => (i1 - i0) * 6 < u.bbox.width / devicePixelRatio;
    // A mark lies on the larger error over its limit.
    const marked = e.simulation_error.map((v, i) => {
      if (!e.outlying[i] && !e.outlying_samples[i]) return null;
      return v / e.simulation_limit >= e.one_step_error[i] / e.one_step_limit || e.one_step_error[i] === null ? v : e.one_step_error[i];
    });
    const curves = [
      {label: "Simulation", colour: "--c-blue", values: e.simulation_error, points},
      {label: "One-step prediction", colour: "--c-orange", values: e.one_step_error, points, dash: [5, 3]}];
    if (e.outlying.some(is => is))
      for (const [label, limit] of [["Limit of the simulation", e.simulation_limit], ["Limit of the prediction", e.one_step_limit]])
        curves.push({label, colour: "--c-faint", values: e.x.map(() => limit), width: 1.2, dash: [2, 3]});
    if (marked.some(v => v !== null))
      curves.push({label: "Marked", colour: "--bad", values: marked, marks: true, size: 9});
    const name = i => e.name[i] === null || e.name[i] === String(e.row[i]) ? String(e.row[i]) : `"${e.name[i]}" (row ${e.row[i]})`;
    add({
      name: "experiments", tall: 240, x: e.x, x_label: "Experiments, the worst first", curves, log: true,
      where_of: i => `experiment ${name(i)}` + (e.outlying_samples[i] ? `, outlying samples: ${e.outlying_samples[i]}` : "")
    });
  }

  // Singular values: dark means small and bright means large. The lightness of the scale increases evenly.

  const scale = [[68, 1, 84], [72, 40, 120], [62, 74, 137], [49, 104, 142], [38, 130, 142], [31, 158, 137], [53, 183, 121], [110, 206, 88], [181, 222, 43], [253, 231, 37]];
  function shade(share) {
    const x = Math.min(1, Math.max(0, share)) * (scale.length - 1), i = Math.min(scale.length - 2, Math.floor(x)), f = x - i;
    return scale[i].map((c, n) => Math.round(c + f * (scale[i + 1][n] - c)));
  }

  function draw_order() {
    const sigma = data.sigma;
    if (!sigma || !sigma.log.length) return;
    // Values at rounding level are grey, so that all colours are used for the other values.
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
      name: "order", shared: true, tall: Math.min(380, 130 + 16 * sigma.rows), x,
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

  // The quality of the regression of each step

  function draw_steps() {
    const p = data.per_step, x = p.x;
    const some = values => values && values.some(v => v !== null);
    if (some(p.condition))
      add({name: "condition", shared: true, tall: 200, x, stretch: p.stretch,
        curves: [{label: "Condition number", colour: "--c-blue", values: p.condition, points: undefined_points}], log: true});
    const counts = [["unknowns", "Unknowns", "--c-faint", 4], ["rank", "Rank", "--c-blue", 1.8], ["lags", "Lag order", "--c-orange", 1.8], ["states", "States", "--c-green", 1.8]]
      .filter(([key]) => some(p[key])).map(([key, label, name, width], i) => ({label, colour: name, values: p[key], stepped: true, width, dash: i > 2 ? [5, 3] : []}));
    if (some(p.rank))
      add({name: "rank", shared: true, tall: 200, x, stretch: p.stretch, zero: true, curves: counts});
    const error = data.step_error;
    add({name: "step", shared: true, tall: 180, x: error.x, stretch: error.stretch, zero: true,
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
    add({name, shared: true, tall: 260, x: table.x, stretch: table.stretch, curves});
  }

  function setup_entries(name, symbol, table, select) {
    if (!select) return;  // the model has no states
    const all = table.rows * table.cols <= 8;
    if (all || table.rows === 0) make("option", "all", select).value = "all";
    for (let i = 0; i < table.rows; ++i) make("option", `row ${i + 1}`, select).value = String(i);
    select.addEventListener("change", () => draw_entries(name, symbol, table, select));
    select.disabled = select.options.length < 2;
    draw_entries(name, symbol, table, select);
  }

  // Eigenvalues

  const poles = data.poles;
  let pole = 0, timer = null;
  const parts = (kind, part) => poles[kind].flatMap(values => values.filter((_, i) => i % 2 === part));
  const clouds = [["open", "Open loop, A", "--c-orange", "dot"], ["closed", "With the observer, A + GC", "--c-blue", "ring"]]
    .map(([kind, label, colour, mark]) => ({kind, label, colour, mark, x: parts(kind, 0), y: parts(kind, 1)}));
  const points = clouds.flatMap(cloud => cloud.x.map((re, i) => [re, cloud.y[i]]));
  const extent = (() => {
    const sizes = points.flat().map(Math.abs).sort((a, b) => a - b);
    const most = sizes.length ? sizes[Math.min(sizes.length - 1, Math.floor(0.995 * sizes.length))] : 1;
    return Math.min(4, Math.max(1.12, most * 1.06));
  })();
  const in_square = ([re, im]) => Math.abs(re) <= extent && Math.abs(im) <= extent;

  function pole_remarks() {
    const texts = [];
    if (poles.stride > 1)
      texts.push(`Of every ${poles.stride} steps those two are drawn at which A and A + GC have their largest eigenvalues.`);
    const outside = points.filter(point => !in_square(point)), most = largest(outside.flat());
    if (outside.length)
      texts.push(`${outside.length} of ${points.length} eigenvalues ${outside.length === 1 ? "lies" : "lie"} outside this square, up to ${short(most)} in magnitude; those of the chosen step stand at its edge, small.`);
    remark("plot-poles", texts.join(" "));
  }

  // Draws the eigenvalues of the chosen step over those of all steps.
  function draw_chosen(u) {
    const c = u.ctx, pixel = devicePixelRatio, clamp = v => Math.max(-extent, Math.min(extent, v));
    c.save();
    c.lineWidth = 2.6 * pixel;
    c.fillStyle = colour("--surface");
    for (const cloud of clouds) {
      const values = poles[cloud.kind][pole];
      c.strokeStyle = colour(cloud.colour);
      for (let i = 0; i + 1 < values.length; i += 2) {
        const [re, im] = [values[i], values[i + 1]], size = in_square([re, im]) ? 6.5 : 3.5;
        mark(c, cloud.mark, u.valToPos(clamp(re), "x", true), u.valToPos(clamp(im), "y", true), size * pixel);
        c.globalAlpha = 0.4;  // transparent, so that the other steps remain visible
        c.fill();
        c.globalAlpha = 1;
        c.stroke();
      }
    }
    c.restore();
    at("legend-poles").querySelectorAll("b").forEach((note, i) => {
      note.textContent = `largest ${short(largest(poles[clouds[i].kind][pole]))}`;
    });
  }

  function choose_pole(k) {
    pole = k;
    const step = time_of(poles.k[pole]).replace("step", "Step");
    at("pole-label").textContent = step;
    at("pole-step").value = String(pole);
    at("pole-step").setAttribute("aria-valuetext", step);
    tokid.plot("poles").redraw(false);
  }

  function play(on) {
    clearInterval(timer);
    timer = null;
    if (on) timer = setInterval(() => choose_pole((pole + 1) % poles.k.length), Math.max(40, Math.min(250, 12000 / poles.k.length)));
    at("pole-play").textContent = on ? "Stop" : "Play";
  }

  function draw_radius() {
    add({name: "radius", shared: true, tall: 290, x: poles.k, zero: true, curves: [
      {label: "Open loop", colour: "--c-orange", values: poles.open.map(largest)},
      {label: "With the observer", colour: "--c-blue", values: poles.closed.map(largest), dash: [5, 3]},
      {label: "Unit circle", colour: "--c-faint", values: poles.k.map(() => 1), width: 1.2}]});
  }
  function largest(values) {
    let most = null;
    for (let i = 0; i + 1 < values.length; i += 2) most = Math.max(most || 0, Math.hypot(values[i], values[i + 1]));
    return most;
  }

  function setup_poles() {
    const slider = at("pole-step"), button = at("pole-play");
    if (!slider || !poles.k.length) return;  // no step has eigenvalues
    slider.max = String(poles.k.length - 1);
    slider.disabled = button.disabled = poles.k.length < 2;
    slider.addEventListener("input", () => choose_pole(Number(slider.value)));
    button.addEventListener("click", () => play(timer === null));
    add({name: "poles", square: extent, x_label: "Real part", label: "Imaginary part", clouds, front: draw_chosen});
    choose_pole(0);
    pole_remarks();
    draw_radius();
  }

  // Natural frequencies and damping ratios. A mode is faint where it is not valid.
  function setup_modes() {
    const found = data.modes;
    if (!found) return;
    for (const name of ["frequency", "damping"]) {
      const curves = found.modes.flatMap((mode, i) => [
        {label: `Mode ${mode.mode}`, colour: palette[i % palette.length], dash: dashes[Math.floor(i / palette.length) % dashes.length], values: mode[name], width: 2, points: true, size: 3},
        {label: "", silent: true, colour: "--c-faint", values: mode[`other_${name}`], width: 1.2, points: true, size: 3}]).filter(curve => curve.values.some(value => value !== null));
      found.others.forEach((modes, i) => modes.forEach((mode, first) => curves.push(
        {label: first ? "" : data.models[i + 1], silent: first > 0, ...other_look(i), values: mode[name], width: 1.2})));
      add({name, shared: true, tall: 230, x: found.x, stretch: found.stretch, zero: name === "frequency", curves});
    }
  }

  // Responses to pulses and steps, and frozen frequency responses. The chosen step is strong, the others are faint.

  const response_input = at("response-input"), response_output = at("response-output");

  // Adds a plot of the curves of all steps. `band`: the lower and upper bounds of the chosen step.
  function add_responses(plot, labels, curves, chosen, band, level, others) {
    const faint = curves.map((values, s) => s === chosen ? null : {label: "", silent: true, colour: "--c-faint", values, width: 1}).filter(curve => curve);
    if (faint.length) Object.assign(faint[0], {label: "Other steps", silent: false});
    const edges = band ? [band[0], band[1]].map((values, i) => ({label: i ? "to" : `${short(100 * level)} % band from`, silent: false, colour: "--c-blue", values, width: 0.8, dash: [2, 3]})) : [];
    const strong = {label: labels[chosen], colour: "--c-blue", values: curves[chosen], width: 2.2};
    const compared = others.map((values, i) => values && {label: data.models[i + 1], ...other_look(i), values, width: 1.8}).filter(curve => curve);
    add({...plot, curves: [...faint, ...edges, strong, ...compared], bands: band ? [[faint.length + 1, faint.length, "--c-blue"]] : []});
  }

  function draw_responses() {
    const found = data.responses, chosen = Number(at("response-start").value);
    const pair = Number(response_output.value) + found.outputs * Number(response_input.value);
    const timed = data.dt_stated, x = [...Array(found.length).keys()].map(k => timed ? k * data.dt : k);
    const labels = found.starts.map(start => `From ${time_of(start)}`);
    for (const [name, kind] of [["pulse", "pulse"], ["step-response", "step"]]) {
      const band = found.bands && [found.bands[`${kind}_lower`][chosen][pair], found.bands[`${kind}_upper`][chosen][pair]];
      add_responses({
        name, tall: 230, x, x_label: timed ? "Time after the input [s]" : "Steps after the input", label: named(data.outputs[Number(response_output.value)]),
        where_of: k => `${k} steps later`
      }, labels, found[kind].map(pairs => pairs[pair]), chosen, band, found.bands && found.bands.level, found.others.map(other => other[kind][chosen][pair]));
    }
  }

  function draw_frozen() {
    const found = data.frozen, chosen = Number(at("frozen-step").value);
    const pair = Number(response_output.value) + found.outputs * Number(response_input.value);
    const labels = found.steps.map(k => `At ${time_of(k)}`);
    for (const [name, log] of [["magnitude", true], ["phase", false]]) {
      const band = found.bands && [found.bands[`${name}_lower`][chosen][pair], found.bands[`${name}_upper`][chosen][pair]];
      const others = found.others.map(other => other[name][chosen] && other[name][chosen][pair]);
      add_responses({
        name, log, tall: 230, x: found.frequencies, x_log: true, x_label: `Frequency [${found.timed ? "rad/s" : "rad per step"}]`,
        where_of: i => `${short(found.frequencies[i])} ${found.timed ? "rad/s" : "rad per step"}, ${short(found.frequencies[i] / (2 * Math.PI))} ${found.timed ? "Hz" : "per step"}`
      }, labels, found[name].map(pairs => pairs[pair]), chosen, band, found.bands && found.bands.level, others);
    }
  }

  function setup_responses() {
    const found = data.responses;
    if (!found) return;
    fill(response_input, data.inputs.slice(0, found.inputs).map(named), 0);
    fill(response_output, data.outputs.slice(0, found.outputs).map(named), 0);
    fill(at("response-start"), found.starts.map(time_of), Math.floor(found.starts.length / 2));
    const draw = () => { draw_responses(); if (data.frozen) draw_frozen(); };
    if (data.frozen) {
      fill(at("frozen-step"), data.frozen.steps.map(time_of), Math.floor(data.frozen.steps.length / 2));
      at("frozen-step").addEventListener("change", draw_frozen);
    }
    at("response-start").addEventListener("change", draw_responses);
    for (const select of [response_input, response_output]) select.addEventListener("change", draw);
    draw();
  }

  // Correlations over the lag: a curve for each output, within a range about zero.

  const correlation_of = (values, j) => ({label: data.outputs[j].name, colour: palette[j % palette.length],
    dash: dashes[Math.floor(j / palette.length) % dashes.length], values, points: true, size: 7});
  const symmetric = {range: (u, min, max) => {
    const most = 1.15 * Math.max(Math.abs(min || 0), Math.abs(max || 0), 0.02);
    return [-most, most];
  }};

  function draw_whiteness() {
    const white = data.whiteness;
    if (!white) return;
    const x = white.bound.map((_, i) => i + 1), bound = white.bound;
    const curves = [
      {label: "99 % bound", colour: "--c-faint", values: bound, dash: [4, 4]},
      {label: "", silent: true, colour: "--c-faint", values: bound.map(v => v === null ? null : -v), dash: [4, 4]}];
    white.correlation.slice(0, 12).forEach((values, j) => curves.push(correlation_of(values, j)));
    add({name: "whiteness", x_label: "Lag", tall: 220, x, curves, scale: symmetric});
  }

  function draw_input_correlation() {
    const found = data.input_correlation, i = Number(at("correlated-input").value), shown = found.inputs[i], bound = shown.bound;
    const curves = [
      {label: "99 % bound", colour: "--c-faint", values: bound, dash: [4, 4]},
      {label: "", silent: true, colour: "--c-faint", values: bound.map(v => v === null ? null : -v), dash: [4, 4]}];
    shown.correlation.forEach((values, j) => curves.push(correlation_of(values, j)));
    add({name: "inputs-lags", x_label: "Lag [steps] of the input before the innovation", tall: 220, x: bound.map((_, l) => found.first + l), curves, scale: symmetric});
  }

  function setup_input_correlation() {
    if (!data.input_correlation) return;
    const select = at("correlated-input");
    fill(select, data.inputs.slice(0, data.input_correlation.inputs.length).map(named), 0);
    select.addEventListener("change", draw_input_correlation);
    draw_input_correlation();
  }

  setup_traces();
  draw_experiments();
  draw_order();
  draw_steps();
  setup_entries("gain", "G", data.gain, at("gain-row"));
  setup_entries("a", "A", data.A, at("a-row"));
  setup_poles();
  setup_modes();
  setup_responses();
  draw_whiteness();
  setup_input_correlation();

  tokid.poles = () => ({step: poles.k[pole], open: poles.open[pole], closed: poles.closed[pole]});
})();
