# SPDX-License-Identifier: BSD-3-Clause
"""Files of either kind."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Union

from . import _tokid
from ._ensemble import Ensemble
from ._errors import reading
from ._model import Model
from ._typing import PathLike


def load(path: PathLike, *, inputs: Sequence[str] = (), outputs: Sequence[str] = ()) -> Union[Ensemble, Model]:
    """Reads an ensemble or a model, whichever the file holds.

    `Ensemble.load` and `Model.load` do the same for files of one kind.

    Parameters
    ----------
    path : path
        .npz, .h5, .mat, or .csv for ensembles.
    inputs, outputs : sequence of str, optional
        Columns of a .csv that are inputs and outputs; by default those whose names begin with u and y.

    Raises
    ------
    IoError
        For a file that can't be read or holds neither; an OSError, and a FileNotFoundError where there is none.
    """
    with reading(path) as file:
        is_model = _tokid.is_model(file)
    if is_model:
        return Model.load(path)
    return Ensemble.load(path, inputs=inputs, outputs=outputs)
