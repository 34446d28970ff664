# SPDX-License-Identifier: BSD-3-Clause
"""Text files of other programs → raw columns: encoding, separators, header, units; then one `pandas.read_csv`."""

from __future__ import annotations

import csv
import io
import json
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Optional

from .._errors import IoError
from .recording import Recording, quoted
from .words import NUMBER, SILENT, is_unit, is_value, split_unit

_SPACES = r"\s+"
_BEYOND_ASCII = str.maketrans("\u2019\u00a0\u202f\u2212", "'  -")  # marks that pandas does not know
_MARK_NAMES = {"'": "apostrophes", " ": "spaces", ",": "commas", ".": "points"}
_NOTE = re.compile(r"#\s*(dt|initial_state|length|(?:in|out)put_(?:names|units)|checksum)\s*=\s*(.+?)\s*$")
_PLACE = re.compile(r"(?i)k|t|.*(time|date|clock|zeit|stamp|sec|step|sample|epoch|elapsed|tow).*")
_Rows = dict[int, list[str]]  # the cells of lines, which count from 0


@dataclass(frozen=True)
class _Start:
    """The lines above the samples, counted from 0."""

    header: int
    body: int
    names: Sequence[str]
    units: Sequence[str]
    remarks: Sequence[str]


@dataclass(frozen=True)
class _Marks:
    """How the numbers of a table are written."""

    decimal: str
    thousands: Optional[str]
    remarks: Sequence[str]


def read_text(path: str, place: str, name: str, wanted: Sequence[str]) -> Recording:
    """Read a table from a file. `place` is the file in messages, and `name` the name of the experiment."""
    with open(path, "rb") as file:
        data = file.read()
    remarks = []
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = data.decode("utf-16", errors="replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", errors="replace")
            remarks.append("the text is not UTF-8 and was read as Latin-1 (Windows-1252)")
    if "\0" in text or not text.strip():
        found = "zero bytes" if "\0" in text else "no text"
        raise IoError(f"{place}: {found} found, a table needed. Export the table as .csv in UTF-8")
    return table_of(
        text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text, remarks, place, name, wanted
    )


def table_of(text: str, remarks: list[str], place: str, name: str, wanted: Sequence[str]) -> Recording:
    """Read a table. Its header is the first line with all `wanted` names, or the last line above the samples."""
    for lines in (text[:30000].split("\n")[:60], None):
        lines = text.split("\n") if lines is None else lines
        separator = _separator(lines)
        rows = {n: _cells(line, separator) for n, line in enumerate(lines) if line.strip() and not line.startswith("#")}
        last = list(rows.values())[-max(3, len(rows) // 10) :]
        width = Counter(map(len, last)).most_common(1)[0][0] if rows else 0
        start = _start(lines, rows, width, separator, wanted)
        if start is not None:
            break
    else:
        first = next((n + 1 for n, cells in rows.items() if any(map(is_value, cells))), None)
        found = f"no line above the samples in line {first} names the columns" if first else "no line of numbers found"
        raise IoError(f"{place}: {found}. Write a first line such as time,u,y")
    notes = _notes(lines[: start.header], place)
    body = text.split("\n", start.body)[-1]
    if not body.endswith(("\n", '"')):
        remarks.append("the last line ends without a line break, so its last number may be incomplete")
    body = body.rstrip("\n") if body.isascii() else body.rstrip("\n").translate(_BEYOND_ASCII)
    marks = _marks([cells for n, cells in rows.items() if n >= start.body], body, separator, place, start)
    names, units = _names_and_units(start, notes, width)
    if any(names[width:]):
        raise IoError(f"{place}, line {start.header + 1}: {len(names)} names found above samples of {width} columns")
    remarks += [*start.remarks, *marks.remarks]
    table = _frame(body, separator, marks, width, place, start)
    empty = int(table.isna().all(axis=1).sum()) if table[width - 1].isna().any() else 0
    if empty:  # without times, a row without content is a step whose samples are missing
        steps = not any(map(_PLACE.fullmatch, names))
        table = table if steps else table.dropna(how="all")
        remarks.append(f"{empty} row{'s' if empty > 1 else ''} without content "
                       f"{'read as missing samples' if steps else 'left out'}")
    names, units = names[:width], units[:width]
    return Recording(name, place, table, names, units, "line", notes, remarks, marks.decimal, marks.thousands)


def _cells(line: str, separator: str) -> list[str]:
    if separator == _SPACES:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]


def _separator(lines: Sequence[str]) -> str:
    """The separator with which most cells are numbers or time stamps, and fewest are not."""
    body = [line for line in lines if line.strip() and not line.startswith("#")][-20:]
    scores = {
        s: sum(1 if is_value(cell) else -1 for line in body for cell in _cells(line, s) if cell)
        for s in (",", ";", "\t", _SPACES)
    }
    spaces = scores.pop(_SPACES)
    best = max(scores, key=lambda separator: scores[separator])
    # A time stamp may have a space, so spaces separate cells only where nothing else does.
    alone = scores[best] <= 0 or all(len(_cells(line, best)) < 2 for line in body)
    return _SPACES if alone and spaces > max(scores[best], len(body)) else best


# ---- header, units and notes ----


def _start(lines: Sequence[str], rows: _Rows, width: int, separator: str, wanted: Sequence[str]) -> Optional[_Start]:
    """The header: with `wanted` names the first line with all of them, else the first lines of names above samples."""
    data = {n for n, cells in rows.items() if len(cells) == width and any(map(is_value, cells))}
    named = next((n for n, cells in rows.items() if wanted and _has(cells, wanted)), None)
    if named is not None:
        body = min((n for n in data if n > named), default=None)
        return None if body is None else _described(rows, named, [n for n in rows if named <= n < body], body)
    group: list[int] = []
    for n, cells in rows.items():
        if n not in data:
            group += (
                [n] if group or any(cells) and abs(len("\0".join(cells).rstrip("\0").split("\0")) - width) <= 1 else []
            )
        elif group:
            nearest = [m for m in group if not _is_units(rows[m])][-1:]
            fitting = [m for m in (*nearest, *group) if any(name.startswith("u") for name in rows[m])]
            return _described(rows, (fitting or nearest or group)[0], group, n)
    # A comment with the names of the columns, as NumPy's savetxt writes it, is a header, too.
    body = min(data, default=0)
    for n in range(body - 1, -1, -1):
        cells = (
            _cells(lines[n].lstrip("#% "), separator) if lines[n].startswith("#") and not _NOTE.match(lines[n]) else []
        )
        if len(cells) == width and not any(map(is_value, cells)):
            return _Start(n, body, cells, [], [])
    return None


def _has(cells: Sequence[str], wanted: Sequence[str]) -> bool:
    names = {*cells, *(split_unit(cell)[0] for cell in cells)}
    return all(name in names or split_unit(name)[0] in names for name in wanted)


def _is_units(cells: Sequence[str]) -> bool:
    """Whether a row has only units. A row of numbers is never one of units."""
    filled = [cell for cell in cells if cell]
    return bool(filled) and all(map(is_unit, filled)) and not all(NUMBER.fullmatch(cell) for cell in filled)


def _described(rows: _Rows, header: int, group: Sequence[int], body: int) -> _Start:
    others = [n for n in group if n != header]
    units = next((n for n in sorted(others, key=lambda n: (n < header, n)) if _is_units(rows[n])), None)
    remarks = [] if units is None else [f"line {units + 1} was read as the units of the columns"]
    for skipped in (
        [n + 1 for n in rows if n < header and n != units],
        [n + 1 for n in others if n > header and n != units],
    ):
        if skipped:
            which = f"line {skipped[0]} was" if len(skipped) == 1 else f"lines {skipped[0]} to {skipped[-1]} were"
            remarks.append(f"{which} skipped, because the names of the columns are in line {header + 1} and samples "
                           f"begin in line {body + 1}")
    return _Start(header, body, rows[header], [] if units is None else rows[units], remarks)


def _notes(lines: Sequence[str], place: str) -> dict[str, Any]:
    """The values in comments above the header, such as "# dt = 0.1"."""
    notes: dict[str, Any] = {}
    for n, line in enumerate(lines):
        if found := _NOTE.match(line):
            try:
                value = found[2] if found[1] in ("initial_state", "checksum") else json.loads(found[2])
            except ValueError:
                value = None
            if value is None or notes.setdefault(found[1], value) != value:
                raise IoError(f"{place}, line {n + 1}: '{found[1]} = {found[2]}' found, one number or list needed. "
                              "Correct the comment")
    units: dict[str, str] = {}
    for side in ("input", "output"):
        units.update(zip(notes.get(f"{side}_names", []), notes.pop(f"{side}_units", [])))
    return {**notes, "units": units}


def _names_and_units(start: _Start, notes: dict[str, Any], width: int) -> tuple[list[str], list[str]]:
    noted = {name for side in ("input", "output") for name in notes.get(f"{side}_names", [])}
    header = [start.names[0].lstrip("%#").strip(), *start.names[1:]] + [""] * (width - len(start.names))
    pairs = [(cell, "") if cell in noted else split_unit(cell) for cell in header]
    counts = Counter(name for name, _ in pairs)
    pairs = [pair if counts[pair[0]] == 1 or not pair[1] else (cell, "") for pair, cell in zip(pairs, header)]
    below = [unit.strip("[]()") for unit in start.units] + [""] * len(pairs)
    return [name for name, _ in pairs], [unit or own for (_, unit), own in zip(pairs, below)]


# ---- numbers ----


def _marks(rows: Sequence[Sequence[str]], body: str, separator: str, place: str, start: _Start) -> _Marks:
    """The decimal mark and the mark of thousands that the first numbers show."""
    decimal = thousands = None
    for cell in (cell for cells in rows for cell in cells if not cell.isdigit() and NUMBER.fullmatch(cell)):
        marks = re.findall(r"(?<=\d)[ '](?=\d)|[.,]", cell)
        if len(marks) > 1 or marks and marks[0] in " '":
            thousands = thousands or marks[0]
            decimal = decimal or (marks[-1] if marks[-1] not in (marks[0], " ", "'") else None)
        elif marks:
            decimal = decimal or marks[0]
    remarks = [f"{_MARK_NAMES[thousands]} in numbers were read as separators of thousands"] if thousands else []
    told = f"{_MARK_NAMES[decimal or ',']} in numbers were read as decimal {_MARK_NAMES[decimal or ',']}, so 1{decimal}"
    if decimal and not thousands and not _decides(body, decimal, separator):
        _refuse_groups(rows, decimal, separator, place, start)
        text = f"{told}000 is 1. If they group thousands, remove them"
        remarks += [] if (separator, decimal) == (",", ".") else [text]
    elif decimal == ",":
        remarks.append(f"{told}5 is 1.5")
    return _Marks(decimal or ("," if thousands == "." else "."), thousands, remarks)


def _decides(body: str, mark: str, separator: str) -> bool:
    """Whether a number shows that the mark is a decimal one: other than three digits after it, or a zero before it."""
    text = "\n".join(re.findall(r'"([^"]*)"', body)) if separator == mark else body
    m = re.escape(mark)
    return bool(re.search(rf"(?<![\d.,:/-])(?:\d+{m}(?!\d{{3}}(?!\d))\d*(?![\d.,:/-])|0+{m}\d|\d{{4,}}{m}\d)", text))


def _refuse_groups(rows: Sequence[Sequence[str]], mark: str, separator: str, place: str, start: _Start) -> None:
    """Refuse a table in which all marks have three digits after them, if they probably group thousands."""
    for n, cells in enumerate(rows):
        for c, cell in enumerate(cells):
            small = separator != "," and any(
                other[c : c + 1] and other[c].isdigit() and int(other[c]) < 1000 for other in rows
            )
            if re.fullmatch(rf"[-+]?\d{{1,3}}{re.escape(mark)}\d{{3}}", cell) and (separator == "," == mark or small):
                why = f", because column '{start.names[c]}' has whole numbers below 1000" if small else ""
                raise IoError(f"{place}, line {start.body + n + 1}: '{cell}' found; its mark and those of all numbers "
                              f"seem to group thousands{why}. Write the numbers without separators of thousands")


def _frame(body: str, separator: str, marks: _Marks, width: int, place: str, start: _Start) -> Any:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]

    exact = (
        {"float_precision": "round_trip"} if int(pandas.__version__.split(".")[0]) < 3 else {}
    )  # the default since 3
    try:
        table = pandas.read_csv(
            io.BytesIO(body.encode()), sep=separator, decimal=marks.decimal, thousands=marks.thousands, header=None,
            index_col=False, keep_default_na=False, na_values=list(SILENT), skip_blank_lines=False,
            skipinitialspace=f"{separator} " in body, low_memory=False, **exact,
        )  # fmt: skip
    except pandas.errors.ParserError as error:
        _check_widths(body, separator, width, place, start)
        raise IoError(f"{place}: {error}. Check the quotation marks and separators of this line") from None
    table.index = pandas.RangeIndex(start.body + 1, start.body + 1 + len(table))
    # A line with too few cells has no value in the last column.
    ragged = table.shape[1] != width or table[width - 1].isna().any()
    if ragged:
        _check_widths(body, separator, width, place, start)
    return table


def _check_widths(body: str, separator: str, width: int, place: str, start: _Start) -> None:
    """Refuse a line with another number of cells, unless it is blank."""
    for n, line in enumerate(body.split("\n")):
        cells = _cells(line, separator) if '"' in line or separator == _SPACES else line.split(separator)
        if len(cells) != width and line.strip():
            more = f"; {quoted(cells[width:])} after the last column '{start.names[-1]}'" if len(cells) > width else ""
            raise IoError(f"{place}, line {start.body + n + 1}: {len(cells)} cells found, {width} needed{more}")
