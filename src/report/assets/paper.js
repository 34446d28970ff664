// Draws the figures of the paper's page. SPDX-License-Identifier: BSD-3-Clause
"use strict";
(() => {
  const {data, add, palette} = tokid;
  const look = series => ({
    label: series.name, silent: !series.name, colour: palette[series.colour], mark: series.mark,
    dash: series.mark === "dashed" ? [6, 4] : []
  });

  function draw(name, panel) {
    const plot = {name, x_label: panel.x_label, label: panel.y_label, tall: 290};
    if (panel.complex_plane) {
      const clouds = panel.series.map(series => ({...look(series), x: series.x, y: series.y}));
      const most = Math.max(1, ...clouds.flatMap(cloud => [...cloud.x, ...cloud.y]).map(Math.abs));
      add({...plot, clouds, square: 1.06 * most});
    } else {
      const [x, ...values] = uPlot.join(panel.series.map(series => [series.x, series.y]));
      const curves = panel.series.map((series, i) => ({...look(series), values: values[i]}));
      add({...plot, x, curves, log: panel.y_log, y_range: panel.y_range});
    }
  }

  for (const figure of data.figures) figure.panels.forEach((panel, i) => draw(`${figure.id}-${i + 1}`, panel));
})();
