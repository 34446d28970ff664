#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""make_corpus.py TOKID: writes the seeds in corpus/, one small file of every kind that a target reads, with the tool at
TOKID for what only it writes. Findings, whose names begin with found-, stay."""

import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import numpy as np
import scipy.io

CORPUS = Path(__file__).parent / "corpus"
RNG = np.random.default_rng(1)
N, T, R, M = 3, 4, 1, 2

ENSEMBLE = {"u": RNG.standard_normal((N, T, R)), "y": RNG.standard_normal((N, T, M)), "dt": 0.1,
            "length": np.array([4, 3, 4]), "initial_state": "zero"}
NAMES = {"input_names": ["F"], "output_names": ["x", "ä"]}
OPTIONS = ('{"states":2,"lags":"auto","method":"subspace","smoothing":"infinity","period":3,"weighting":"one-step",'
           '"refine":"no","initial_state":"zero","nominal":"mean","frame":"reference","reference_step":1,"hold_out":0.25,'
           '"rows":4,"cols":"auto","experiments":40,"data":["0123456789abcdef"],"choices":{"smoothing":10.5,"period":0,'
           '"state_smoothing":1.0,"weighting":"many-steps","refinement_smoothing":"infinity","refinement_iterations":2},'
           '"refined":{"smoothing":3.5,"iterations":7}}')
MODEL = {"A": 0.5 * np.ones((2, 1, 1)), "B": np.ones((2, 1, R)), "C": np.ones((2, M, 1)), "D": np.zeros((2, M, R)),
         "G": np.zeros((2, 1, M)), "state_dim": np.array([1, 1, 1]), "k_begin": 0, "dt": 0.1, "options": OPTIONS[:60],
         "singular_values": np.array([[1.0, np.nan], [2.0, 0.1]]), "rank": np.array([1, 1])}
STATE = {"window_factors": np.triu(np.ones((3, 3, 3))), "window_rows": np.array([2, 2, 2]),
         "sample_sums": np.ones((3, 2)), "sample_counts": np.ones((3, 2)), "sample_spreads": np.ones((3, 2)),
         "inputs": 1, "lags": 1, "experiments": 2, "dt": 1.0, "options": "{}", "method": "tvera", "states": 1,
         "together": 0, "noisy": 1, "nominal": 0, "initial_state": "zero"}


def npz(path, **values):
    np.savez(path, **values)


def h5(path, attributes=(), libver="earliest", **values):
    with h5py.File(path, "w", libver=libver) as file:
        for name, value in values.items():
            if name in attributes:
                file.attrs[name] = value
            else:
                file[name] = value


def mat(path, **values):
    def of(value):
        return np.array(value, dtype=object) if isinstance(value, list) else value
    scipy.io.savemat(path, {name: of(value) for name, value in values.items()}, do_compression=path.stem != "version5")


def mat73(path, **numbers):
    """As MATLAB writes them: in the oldest format, packed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in numbers.items():
            value = np.atleast_2d(np.asarray(value, "f8")).T
            file.create_dataset(name, data=value, chunks=value.shape, compression="gzip")
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(116) + bytes(8) + b"\0\2IM")


def by_step(values):
    """MATLAB's order: the step is the last index."""
    return {name: np.moveaxis(v, 0, -1) if np.ndim(v) == 3 else v for name, v in values.items()}


def write(folder, name, content):
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)


def ensembles(tokid, folder):
    npz(folder("ensemble_npz") / "plain.npz", **ENSEMBLE, **NAMES)
    np.savez_compressed(folder("ensemble_npz") / "compressed.npz",
                        u=np.asfortranarray(np.ones((N, T, R), ">f4")), y=np.ones((N, T, M), "i2"),
                        output_names=np.array([b"a", b"b"]), free_y=np.ones((2, 3, M), bool))
    h5(folder("ensemble_h5") / "plain.h5", attributes=("dt", "initial_state"), **ENSEMBLE, **NAMES)
    h5(folder("ensemble_h5") / "new.h5", libver="latest", **ENSEMBLE)
    with h5py.File(folder("ensemble_h5") / "chunks.h5", "w") as file:
        file.create_dataset("u", data=ENSEMBLE["u"], chunks=(2, 2, 1), compression="gzip", shuffle=True, fletcher32=True)
        file.create_dataset("y", data=np.ones((N, T, M), "<f2"), chunks=(3, 4, 2))
        file["input_names"] = np.array(["F"], "S1")
    with h5py.File(folder("ensemble_h5") / "packed.h5", "w", libver="latest") as file:
        file.create_dataset("u", data=ENSEMBLE["u"], chunks=(2, 2, 1), compression="gzip", shuffle=True)
        file.create_dataset("y", data=np.ones((N, T, M), "i2"), chunks=(3, 4, 2), maxshape=(None, None, M), fillvalue=2,
                            compression="gzip", fletcher32=True)
    for name in ("version5.mat", "version7.mat"):
        mat(folder("ensemble_mat") / name, experiments=N, **ENSEMBLE, **NAMES)
    mat(folder("ensemble_mat") / "others.mat", u=np.ones((N, T), "i1"), y=np.ones((N, T, M), "f4"), s={"a": 1.0},
        c=1j, e=np.zeros((0, 3)), output_names=["x", "v"])
    tokid("convert", folder("ensemble_npz") / "plain.npz", folder("ensemble_mat73") / "plain.mat", "--mat73")
    tokid("convert", folder("ensemble_npz") / "plain.npz", folder("ensemble_h5") / "tokid.h5")
    with tempfile.NamedTemporaryFile(suffix=".npz") as long:  # as chunks with checksums, not within headers
        np.savez(long, u=np.ones((N, 700, R)), y=np.zeros((N, 700, M)))
        long.flush()
        tokid("convert", long.name, folder("ensemble_h5") / "checked.h5")
    mat73(folder("ensemble_mat73") / "matlab.mat", experiments=N,
          **{name: value for name, value in ENSEMBLE.items() if name != "initial_state"})
    for name in ("plain.h5", "new.h5", "chunks.h5", "packed.h5", "tokid.h5", "checked.h5"):
        write(folder("blocks"), name, (folder("ensemble_h5") / name).read_bytes())


def tables(tokid, folder):
    tokid("convert", folder("ensemble_npz") / "plain.npz", folder("ensemble_csv") / "plain.csv")
    write(folder("ensemble_csv"), "steps.csv", '\ufeffk,experiment,"u,1",y\r\n0,a,1,2\r\n3,a,+1e-3,NA\r\n0,"b ""c""",,4\r\n')
    write(folder("ensemble_csv"), "notes.csv",
          '# dt = 0.5\n# length = [2]\n# initial_state = unknown\n# input_names = ["a"]\n# input_units = ["V"]\n\n'
          'a,y\n1,2\n3,nan\n')
    write(folder("ensemble_csv"), "german.csv",
          'Anlage;7\n\nZeit;u [V];y\ns;;\u00b0C\n0,0;1,5;20\n0,1;---;Bad;\n;;\n'.encode("latin-1"))
    write(folder("ensemble_csv"), "stamps.csv",
          'Date\tClock\tu\ty (degC)\n13/04/2026\t11:59:59.5 PM\t1\t2\n14/04/2026\t12:00:00 AM\t1\tI/O Timeout\n')
    table = "time;valve [%];T (degC);phase\n27.11.2026 13:12:05,1;{};20;idle\n27.11.2026 13:12:05,3;1,5;21;heat\n"
    write(folder("recordings"), "trigger.txt",
          "valve\nT\n-999\nphase == heat\n\n\n" + table.format(0) + "\f" + table.format("-999"))
    write(folder("recordings"), "mean.txt", "valve [%]\nT\n\n\n0.15\nmean\n" + table.format("0,5"))
    write(folder("recordings"), "linear.txt", "u\ny\n\nu>0.5\n0.05\nlinear\n# t,u,y\n0,0,1\n0.1,1,2\n0.25,2,3\n9,1,1\n")
    write(folder("columns"), "chosen.csv", "a,b\ny\ntime,a,b,y\n0,1,2,3\n1,4,5,6\n")


def models(tokid, folder):
    npz(folder("model_npz") / "plain.npz", **MODEL)
    h5(folder("model_h5") / "plain.h5", **MODEL)
    mat(folder("model_mat") / "version7.mat", **by_step(MODEL))
    tokid("convert", folder("model_npz") / "plain.npz", folder("model_mat") / "version73.mat", "--mat73")
    tokid("convert", folder("model_npz") / "plain.npz", folder("model_h5") / "tokid.h5")
    npz(folder("state_npz") / "plain.npz", **STATE)
    h5(folder("state_h5") / "plain.h5", **STATE)


def texts(tokid, folder):
    write(folder("options"), "all.json", OPTIONS)
    write(folder("options"), "automatic.json", '{"states":"auto","smoothing":"auto","choices":null}')
    for name, words in {
            "identify": "identify data.npz -o model.npz --states 2 --lags auto --smoothing 1e3 --period 4 --hold-out 0.2",
            "identify2": "identify d.csv --inputs a,b --outputs c --output=m.h5 --method subspace --json --quiet",
            "validate": "validate model.npz data.npz --horizon 3 --cross-validate 5 --json",
            "plan": "plan --states 2 --inputs 1 --outputs 1 --steps 9 --kind white --amplitude 1 -o p.npz --seed 3",
            "help": "refine --help", "version": "--version"}.items():
        write(folder("command_line"), name, words.replace(" ", "\n"))


def main():
    tool = sys.argv[1]

    def tokid(*arguments):
        subprocess.run([tool, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)

    def folder(name):
        (CORPUS / name).mkdir(parents=True, exist_ok=True)
        return CORPUS / name

    for old in CORPUS.glob("*/*"):
        if not old.name.startswith("found-"):
            old.unlink()
    for make in (ensembles, tables, models, texts):
        make(tokid, folder)


if __name__ == "__main__":
    main()
