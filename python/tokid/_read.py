# SPDX-License-Identifier: BSD-3-Clause
"""Reading tables and logs of other programs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Optional, Union

from . import _reading
from ._ensemble import Ensemble
from ._typing import ArrayLike


def read(
    source: Any,
    *,
    inputs: Union[str, Sequence[Any], None] = None,
    outputs: Union[str, Sequence[Any], None] = None,
    outputs_required: bool = False,
    time: Optional[str] = None,
    experiment_column: Optional[str] = None,
    missing: Union[str, Sequence[str]] = (),
    dates: Optional[str] = None,
    dt: Optional[float] = None,
    trigger: Optional[str] = None,
    before: int = 0,
    resample: Optional[float] = None,
    resample_method: str = "linear",
    held: Union[str, Sequence[str]] = (),
    longest_gap: Optional[int] = None,
    length: Optional[ArrayLike] = None,
    free_y: Optional[ArrayLike] = None,
    initial_state: Optional[str] = None,
    input_units: Optional[Sequence[str]] = None,
    output_units: Optional[Sequence[str]] = None,
) -> Ensemble:
    """Read an ensemble from tables and logs of other programs. It needs pandas: ``pip install tokid[read]``.

    Parameters
    ----------
    source : path, DataFrame, Dataset, or a sequence or dict of them
        A file, a folder, a pattern such as ``"runs/*.csv"``, or a list of them. Each file is an experiment. A folder
        may have one sub-folder for each run, with one file in each. Files may be .csv, .txt, .tsv, .dat, .xlsx, .xls,
        .parquet, .feather, .ulg, .mcap, .mf4 and .tdms. They are sorted by name, run2 before run10. The same rules
        hold for a `pandas.DataFrame`, an `xarray.Dataset`, and a list or dict of them. Keys of a dict name experiments.
    inputs, outputs : str or sequence of str, optional
        Columns that are inputs and outputs; by default those whose names begin with u and y. The columns of logs have
        the names ``topic.field``.
    outputs_required : bool, default False
        Refuse a source without outputs.
    time : str, optional
        The column of the times. It may state the unit: ``"timestamp [us]"``. By default found by its name or its cells.
    experiment_column : str, optional
        The column that names the experiments; by default the column ``experiment``.
    missing : str or sequence of str, optional
        Words that stand for a missing sample, besides Bad, ---, NaN, null and others.
    dates : {"day-first", "month-first"}, optional
        Order of the numbers in dates such as 03/04/2026; by default as the dates of the column show.
    dt : float, optional
        Sample time [s], to whose steps times are moved by up to a tenth of a step. By default the times must be even.
    trigger : str, optional
        A condition such as ``"valve > 0.5"`` on a column. The first sample at which it becomes true is step 0.
    before : int, default 0
        Steps that are kept before the trigger.
    resample : float, optional
        Sample time [s] of a common grid on which the samples are brought.
    resample_method : {"linear", "previous", "mean"}
        By interpolation, as the last sample, or as the mean of the samples within half a step.
    held : str or sequence of str, optional
        Channels that hold their value between two samples. They are resampled by the method previous.
    longest_gap : int, optional
        Steps of the longest gap that resampling fills; by default 3, or no limit for held channels.
    length, free_y, initial_state, input_units, output_units
        As in `Ensemble`.

    Raises
    ------
    IoError
        If a file can't be read or understood. The message names the file, the line and the column.
    ValueError
        If an argument or a table in memory is wrong.

    Warns
    -----
    TokidWarning
        What was read as what, and what was left out.
    """
    given = locals()
    options = {name: given[name] for name in _reading.OPTIONS}
    described = {name: given[name] for name in ("length", "free_y", "initial_state", "input_units", "output_units")}
    return Ensemble._with_warnings(_reading.read(source, options, described))
