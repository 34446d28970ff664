# SPDX-License-Identifier: BSD-3-Clause
"""The progress of long calls."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Callable, Optional

from ._options import switch
from ._typing import Progress, ProgressShare

# It gets the finished share and the stage.
Listener = Optional[Callable[[float, str], Any]]


@contextmanager
def listener(progress: Progress, what: str) -> Iterator[Listener]:
    """The function that gets the progress: a bar of tqdm, a line on stderr, or the callable of the user."""
    if callable(progress):
        yield lambda share, stage: progress(ProgressShare._of(share, stage))
    elif not switch("progress", progress, " or a function"):
        yield None
    else:
        bar = _bar(what)
        try:
            yield bar.show
        finally:
            bar.close()


class _Line:
    """One line on stderr, which is overwritten."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._shown = ""

    def show(self, share: float, stage: str) -> None:
        text = f"{self._what}: {100 * min(max(share, 0.0), 1.0):3.0f} %"
        if share < 1:
            text = f"{text}  {stage}".rstrip()
        if text != self._shown:
            blank = "\r" + " " * len(self._shown) if len(text) < len(self._shown) else ""
            print(f"{blank}\r{text}", end="", file=sys.stderr, flush=True)
            self._shown = text

    def close(self) -> None:
        if self._shown:
            print(file=sys.stderr, flush=True)


class _Tqdm:
    def __init__(self, tqdm: Any, what: str) -> None:
        self._bar = tqdm(total=100, desc=what, bar_format="{l_bar}{bar}| {elapsed}{postfix}")

    def show(self, share: float, stage: str) -> None:
        self._bar.n = 100 * min(max(share, 0.0), 1.0)
        self._bar.set_postfix_str(stage if share < 1 else "")

    def close(self) -> None:
        self._bar.close()


def _bar(what: str) -> Any:
    try:
        from tqdm.auto import tqdm  # type: ignore[import-untyped,unused-ignore]
    except ImportError:
        return _Line(what)
    return _Tqdm(tqdm, what)
