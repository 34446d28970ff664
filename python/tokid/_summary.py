# SPDX-License-Identifier: BSD-3-Clause
"""Summaries of the channels of an ensemble."""

from __future__ import annotations

from dataclasses import dataclass

from . import _display


@dataclass(frozen=True)
class ChannelSummary:
    """The samples of one channel, without the missing ones.

    Attributes
    ----------
    samples : int
        Number of samples within the lengths of the experiments.
    missing : int
        How many of them are NaN.
    mean, std, min, max : float
        `std` is the standard deviation about the mean.
    """

    samples: int
    missing: int
    mean: float
    std: float
    min: float
    max: float

    def __repr__(self) -> str:
        cells = [f"{title}={cell}" for title, cell in zip(_TITLES, _cells(self))]
        return f"ChannelSummary({', '.join(cells)})"


ChannelSummary.__module__ = "tokid.results"  # the module where users find it

_TITLES = ("samples", "missing", "mean", "std", "min", "max")


def _cells(one: ChannelSummary) -> list[str]:
    return [str(one.samples), str(one.missing), *map(_display.number, (one.mean, one.std, one.min, one.max))]


class Summary(dict[str, ChannelSummary]):
    """A `ChannelSummary` for each channel, by its name. It is shown as a table."""

    def _table(self) -> list[_display.Row]:
        return [("", [["channel", *_TITLES], *([name, *_cells(one)] for name, one in self.items())])]

    def __repr__(self) -> str:
        return _display.as_text("Channels", self._table())

    def _repr_html_(self) -> str:
        return _display.as_html("Channels", self._table())
