# SPDX-License-Identifier: BSD-3-Clause
"""How cells of tables are written: numbers, time stamps, words for missing samples, units of time."""

from __future__ import annotations

import re
from typing import Optional

_GROUPED = r"\d+(?:[ '\u2019\u00a0\u202f]\d{3})+(?:[.,]\d*)?|\d{1,3}(?:,\d{3})+\.\d*|\d{1,3}(?:\.\d{3})+,\d*"
_DIGITS = _GROUPED + r"|\d+[.,]?\d*|[.,]\d+"
NUMBER = re.compile(rf"\s*[-+]?(?:{_DIGITS})(?:[eEdD][-+]?\d+)?\s*")
_DATE = r"(?:\d{1,4}[-./]\d{1,2}[-./]\d{1,4}|\d{1,2}[- ./][A-Za-z]{3}[- ./]\d{2,4})"
_CLOCK = r"\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d*)?)?(?:\s*[AaPp]\.?[Mm]\.?)?"
_ZONE = r"(?:\s*(?:Z|[-+]\d{2}:?\d{2}))?"
STAMP = re.compile(rf"\s*(?:{_DATE}(?:[ T]+{_CLOCK}{_ZONE})?|{_CLOCK})\s*")

SILENT = ("", "NaN", "nan", "NA")  # the usual marks of missing samples, which no remark reports
_MISSING = frozenset(
    "bad|bad input|bad data|bad quality|baddata|bad value|na|n/a|#n/a|#na|#n/a n/a|#nv|nan|-nan|-nan(ind)|nan(ind)|"
    "-nan(snan)|nan(snan)|null|none|nil|<null>|(null)|no data|nodata|no value|no sample|missing|void|invalid|error|err|"
    "fault|fail|failed|timeout|offline|off-line|unavailable|stale|uncertain|i/o timeout|io timeout|io error|comm fail|"
    "comm error|scan off|not connect|shutdown|pt created|?|??|???|over range|overrange|under range|underrange|1.#qnan|"
    "-1.#qnan|1.#ind|-1.#ind|1.#ind00|-1.#ind00|1.#qnan0|#value!|#div/0!|#ref!|#num!|#wert!|<na>|nat|configure|"
    "calc failed|no result|arc off-line|\u2013|\u2014".split("|")
)
SWITCHES = {"on": 1.0, "true": 1.0, "off": 0.0, "false": 0.0}
SUMMARY = frozenset("max min mean avg average median std stdev sum total count maximum minimum mittelwert "
                    "summe".split())

# Seconds as a fraction: quotients are exact where a factor such as 0.001 is not.
TIME_UNITS: dict[str, tuple[int, int]] = {
    name: fraction
    for fraction, names in {
        (1, 1): "s sec secs second seconds",
        (1, 10**3): "ms msec msecs millisecond milliseconds millis",
        (1, 10**6): "us \u00b5s \u03bcs usec usecs microsecond microseconds micros",
        (1, 10**9): "ns nsec nsecs nanosecond nanoseconds nanos nanosec",
        (60, 1): "min mins minute minutes",
        (3600, 1): "h hr hrs hour hours",
        (86400, 1): "d day days",
    }.items()
    for name in names.split()
}
_UNITS = frozenset(
    "% - 1 v mv kv a ma w kw mw hz khz m mm cm km kg g t n kn nm bar mbar pa kpa mpa psi k c f degc degf \u00b0c "
    "\u00b0f deg rad rpm l ml j kj pct percent \u00b0 ppm g/l nm n*m lb in ft".split()
)


def is_missing(text: str) -> bool:
    """Whether a cell is empty or a usual word for a missing sample."""
    return text in SILENT or not text.strip("-") or text.lower() in _MISSING


def is_value(text: str) -> bool:
    """Whether a cell is a number, a time stamp or a switch. Words for missing samples do not count."""
    return bool(NUMBER.fullmatch(text) or STAMP.fullmatch(text)) or text.lower() in SWITCHES


def is_unit(text: str) -> bool:
    """Whether a cell of a row of its own can be a unit."""
    bare = text.strip().strip("[]()").lower()
    return bare in TIME_UNITS or bool(bare) and all(part in _UNITS or part in TIME_UNITS or part.isdigit()
                                                    for part in re.split(r"[/*\u00b7^. \u00b2\u00b3-]+", bare) if part)


def split_unit(text: str) -> tuple[str, str]:
    """The name and the unit in a header such as "p [bar]". Text in round brackets is a unit only if it is known."""
    found = re.fullmatch(r"\s*(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))\s*", text)
    if not found or not found[1] or (found[3] is not None and not is_unit(found[3]) and ":" not in found[3]):
        return text.strip(), ""
    return found[1], (found[2] if found[3] is None else found[3]).strip()


def number(text: str, decimal: str = ".", thousands: Optional[str] = None) -> Optional[float]:
    """The value of a cell; None if it is no number."""
    text = text.strip()
    if text.lower() in SWITCHES:
        return SWITCHES[text.lower()]
    if not NUMBER.fullmatch(text) or re.match(r"[-+]{2}", text):
        return None
    if thousands:
        text = text.replace(thousands, "")
    if decimal == ",":
        text = text.replace(".", "?").replace(",", ".")
    try:
        return float(text.replace("D", "e").replace("d", "e"))
    except ValueError:
        return None


def time_unit(unit: str) -> Optional[tuple[int, int]]:
    return TIME_UNITS.get(unit.strip().lower())
