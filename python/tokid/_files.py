# SPDX-License-Identifier: BSD-3-Clause
"""Reading files of unknown kind."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Union

from . import _tokid
from ._ensemble import Ensemble
from ._errors import reading
from ._model import Model
from ._typing import PathLike


def load(
    path: Union[PathLike, Sequence[PathLike]],
    *,
    inputs: Union[str, Sequence[str]] = (),
    outputs: Union[str, Sequence[str]] = (),
    outputs_required: bool = False,
) -> Union[Ensemble, Model]:
    """Read an ensemble or a model, depending on the content of the file.

    `Ensemble.load` and `Model.load` read one kind of file, and `read` reads tables and logs of other programs.

    Parameters
    ----------
    path : path, or sequence of paths
        A .npz, .h5 or .mat, or a .csv with an ensemble. A folder, a pattern such as ``"runs/*.csv"`` and a list of .csv
        files are an ensemble with an experiment in each file.
    inputs, outputs : str or sequence of str, optional
        Columns of a .csv that are inputs and outputs; by default those whose names begin with u and y.
    outputs_required : bool, default False
        Refuse an ensemble without outputs.

    Raises
    ------
    IoError
        If the file can't be read or contains neither. It is an OSError, and a FileNotFoundError for a missing file.
    """
    if isinstance(path, (str, bytes, os.PathLike)):
        with reading(path) as file:
            is_model = _tokid.is_model(file)
        if is_model:
            return Model.load(path)
    return Ensemble.load(path, inputs=inputs, outputs=outputs, outputs_required=outputs_required)
