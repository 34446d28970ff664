# SPDX-License-Identifier: BSD-3-Clause
"""Data as another processor would compute them: outputs one rounding error larger or smaller.

Sums in NumPy, Octave and the C library have other last digits on other processors. What documents show must not depend
on these digits. TOKID_PERTURBATION is the seed of the signs; with 0, the data stay as they are.
"""

import os
import zipfile

import numpy as np

SEED = int(os.environ.get("TOKID_PERTURBATION", "1"))


def perturbed(values):
    """The values, with a relative change of ± 3e-16 of those that have all digits: recorded numbers have fewer."""
    values = np.array(values)
    if SEED == 0 or values.dtype != np.float64:
        return values
    flat = values.ravel()
    few = np.array([float(f"{value:.12g}") == value or np.isnan(value) for value in flat], dtype=bool)
    signs = np.random.default_rng([SEED, flat.size]).choice([-3e-16, 3e-16], flat.size)
    return np.where(few, flat, flat * (1 + signs)).reshape(values.shape)


def perturb_file(path):
    """Perturbs the outputs of an ensemble in place. Other files stay as they are."""
    if path.suffix == ".npz" and zipfile.is_zipfile(path):
        with np.load(path) as file:
            arrays = dict(file)
        if {"u", "y"} <= arrays.keys():
            np.savez(path, **{**arrays, "y": perturbed(arrays["y"])})
    elif path.suffix == ".h5":
        import h5py  # the environment of the Python package has none

        if not h5py.is_hdf5(path):
            return
        with h5py.File(path, "r+") as file:
            if {"u", "y"} <= file.keys():
                file["y"][...] = perturbed(file["y"][()])
