# SPDX-License-Identifier: BSD-3-Clause
"""What the plots of a page show: the pixels of their canvases, and where values lie in them."""

import base64

import numpy as np

# A copy of a canvas that is read, not shown.
READABLE = """canvas => {
  const copy = document.createElement("canvas");
  copy.width = canvas.width;
  copy.height = canvas.height;
  const context = copy.getContext("2d", {willReadFrequently: true});
  context.drawImage(canvas, 0, 0);
  return context;
}"""


# The picture of a plot, as rows of red, green, blue.
PIXELS = "place => { const readable = " + READABLE + """;
  const canvas = document.querySelector(`#${place} canvas`);
  const bytes = readable(canvas).getImageData(0, 0, canvas.width, canvas.height).data;
  let text = "";
  for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
  return [canvas.width, canvas.height, btoa(text)];
}"""


def picture(page, place):
    width, height, text = page.evaluate(PIXELS, place)
    return np.frombuffer(base64.b64decode(text), np.uint8).reshape(height, width, 4)[..., :3].astype(int)


def rgb(colour):
    """Red, green, blue of #rrggbb."""
    return np.array([int(colour[i:i + 2], 16) for i in (1, 3, 5)])


def of_colour(pixels, colour):
    """Which pixels have it, but for rounding."""
    return np.abs(pixels - rgb(colour)).max(axis=-1) <= 2


def within(plot, pixels):
    """The part of the picture between the axes."""
    left, top, width, height = (round(plot["area"][key]) for key in ("left", "top", "width", "height"))
    return pixels[top:top + height, left:left + width]


def undrawn(page):
    """Curves with values of which nothing is seen: fewer pixels of their colour than a tenth of the plot's width."""
    # Counted in the page: the pictures would take seconds on their way out of it.
    missing = page.evaluate("() => { const readable = " + READABLE + """;
    return tokid.plots().flatMap(plot => {
      const [left, top, width, height] = ["left", "top", "width", "height"].map(key => Math.round(plot.area[key]));
      const pixels = readable(document.querySelector(`#${plot.place} canvas`)).getImageData(left, top, width, height).data;
      const seen = colour => {
        const [red, green, blue] = [1, 3, 5].map(i => parseInt(colour.slice(i, i + 2), 16));
        const near = (a, b) => Math.abs(a - b) <= 2;  // but for rounding
        let count = 0;
        for (let i = 0; i < pixels.length; i += 4)
          count += near(pixels[i], red) && near(pixels[i + 1], green) && near(pixels[i + 2], blue);
        return count;
      };
      return plot.curves.filter(curve => curve.values.some(v => v != null) && seen(curve.colour) < 0.1 * width)
                        .map(curve => [plot.name, curve.label]);
    }); }""")
    return [tuple(names) for names in missing]


def variable(page, name):
    return page.evaluate("name => getComputedStyle(document.documentElement).getPropertyValue(name).trim()", name)


def coloured(pixels):
    """Which pixels are of a colour: text, grid and ground are nearly grey."""
    return pixels.max(axis=-1) - pixels.min(axis=-1) > 32


def positions(page, x, y, plot):
    """Columns and rows of the pixels at values of a plot."""
    where = page.evaluate("""([name, x, y]) => x.map((_, i) => {
      const u = tokid.plot(name);
      return [u.valToPos(x[i], "x", true), u.valToPos(y[i], "y", true)];
    })""", [plot, [float(v) for v in x], [float(v) for v in y]])
    return np.floor(where).astype(int).T
