# SPDX-License-Identifier: BSD-3-Clause
"""Results as text and as tables of HTML, with the numbers of the command line tool."""

from __future__ import annotations

import html
import math
import textwrap
from collections.abc import Sequence
from typing import Union

# A label with a text, or with a table whose first row has the titles.
Table = Sequence[Sequence[str]]
Row = tuple[str, Union[str, Table]]

_WIDTH = 100


def number(value: float) -> str:
    """A number with three digits; "–" if it is not known."""
    return "–" if math.isnan(value) else f"{value:.3g}"


def percent(fit: float) -> str:
    """A fit [%], rounded down, because 99.97 must not become 100."""
    if not math.isfinite(fit):
        return "–"
    if fit < -999:
        return "below −999 %"
    gap = 100 - fit
    if gap < 1e-6:
        return "100 %"
    digits = 1 if gap >= 1 else min(max(math.ceil(-math.log10(gap)), 1), 6)
    scale = 10.0**digits
    return f"{math.floor(fit * scale) / scale:.{digits}f} %".replace("-", "−")


def as_text(title: str, rows: Sequence[Row]) -> str:
    """A title, and below it each label with its text or its table."""
    column = max((len(label) for label, _ in rows), default=0) + 2
    lines = [title]
    for label, value in rows:
        if isinstance(value, str):
            hanging = "  " if value.startswith("- ") else ""
            shown = textwrap.wrap(value, _WIDTH - column - 2, subsequent_indent=hanging) or [""]
        else:
            shown = _lines_of(value)
        lines += [f"  {label if n == 0 else '':{column}}{line}".rstrip() for n, line in enumerate(shown)]
    return "\n".join(lines)


def _lines_of(table: Table) -> list[str]:
    widths = [max(len(cell) for cell in column) for column in zip(*table)]
    aligned = "<" + ">" * (len(widths) - 1)
    return ["   ".join(f"{cell:{a}{w}}" for cell, a, w in zip(row, aligned, widths)) for row in table]


def as_html(title: str, rows: Sequence[Row]) -> str:
    """A table with the title as its caption."""
    cells = "".join(f"<tr><th>{html.escape(label)}</th><td>{_cell(value)}</td></tr>" for label, value in rows)
    return f"<table><caption>{html.escape(title)}</caption>{cells}</table>"


def _cell(value: Union[str, Table]) -> str:
    if isinstance(value, str):
        return html.escape(value)
    lines = [[html.escape(cell) for cell in row] for row in value]
    head = "".join(f"<th>{cell}</th>" for cell in lines[0])
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in lines[1:])
    return f"<table><tr>{head}</tr>{body}</table>"
