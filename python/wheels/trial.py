# SPDX-License-Identifier: BSD-3-Clause
"""The installed package, tried: trial.py [REFERENCE]

The command `tokid` of its environment, and `python -m tokid`, are there and write the same models as the package. Every
format of data and models is written and read back. REFERENCE is a folder of NAME.h5 and NAME.model.h5, data and the
model that another build of tokid identified from them without EM: this build finds the same. Prints the largest
difference.
"""

import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import tokid

MATRICES = ("A", "B", "C", "D", "G")
TOLERANCE = 1e-12  # relative to the norm: hundreds of roundings, while a wrong kernel is wrong in the first digits


def same(a, b, names):
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in names)


def try_formats(folder):
    data = tokid.example("oscillator", experiments=30, steps=30)
    fresh = tokid.example("oscillator", experiments=10, steps=30, seed=2)
    model = tokid.identify(data)
    assert model.states == 4 and abs(model.simulate(data) - data.y).max() < 1e-8
    for options, names in (({}, ("a.npz", "a.h5", "a.mat", "a.csv")), ({"mat73": True}, ("b.mat",))):
        for name in names:
            data.save(folder / name, **options)
            assert same(tokid.load(folder / name), data, ("u", "y")), name
            if name.endswith(".csv"):
                continue
            model.save(folder / f"model-{name}", **options)
            again = tokid.load(folder / f"model-{name}")
            assert all(np.array_equal(getattr(again, m).stack(), getattr(model, m).stack()) for m in MATRICES), name
            assert again.validate(fresh).simulation.fit.min() > 99.99, name
    with ThreadPoolExecutor(8) as threads:  # HDF5 that is not made for threads crashes
        assert all(same(read, data, ("u", "y")) for read in threads.map(tokid.load, 200 * [folder / "a.h5"]))
    assert all(line.agrees for line in tokid.paper().printed)
    try:
        tokid.load(folder / "none.h5")
    except tokid.IoError as error:  # an exception of the C++ library becomes one of Python
        assert "none.h5" in str(error)
    else:
        raise AssertionError("a missing file was read")


def try_command(folder):
    """The tool beside this Python, which is not on the path, and what this Python runs of it."""
    folder.mkdir()
    program = Path(sys.prefix) / "bin" / "tokid"
    assert program.exists(), f"{program} is missing: the package has no command line tool"
    for words in ([program], [sys.executable, "-m", "tokid"]):
        def call(*arguments, words=words):
            return subprocess.run([*words, *arguments], check=False, capture_output=True, text=True, cwd=folder)

        assert call("--version").stdout == f"tokid {tokid.__version__}\n", words
        wrong = call("identify", "none.npz", "-o", "model.npz")
        assert wrong.returncode == 2 and "none.npz" in wrong.stderr, words
        made = call("example", "oscillator", "--experiments", "30", "--steps", "30", "-o", "data.npz")
        assert made.returncode == 0, made.stderr
        made = call("identify", "data.npz", "-o", "model.npz")
        assert made.returncode == 0, made.stderr
        own = tokid.example("oscillator", experiments=30, steps=30)
        assert same(tokid.load(folder / "data.npz"), own, ("u", "y"))
        theirs, model = tokid.load(folder / "model.npz"), tokid.identify(own)
        assert all(np.array_equal(getattr(theirs, m).stack(), getattr(model, m).stack()) for m in MATRICES), words


def difference(model, reference):
    """The largest of the matrices, in the coordinates of the reference, and of the responses, which have none. D counts as
    a part of the responses: where the true one is zero it consists of rounding errors."""
    aligned = model.align(reference)
    responses = np.nan_to_num(reference.markov(5))  # NaN after the last step
    pairs = [(getattr(aligned, name).stack(), getattr(reference, name).stack()) for name in MATRICES]
    pairs.append((np.nan_to_num(model.markov(5)), responses))
    scales = [np.linalg.norm(responses if name == "D" else b) for name, (_, b) in zip((*MATRICES, "responses"), pairs)]
    return max(np.linalg.norm(a - b) / scale for (a, b), scale in zip(pairs, scales))


def main():
    assert tokid.__file__.startswith(sys.prefix), tokid.__file__
    with tempfile.TemporaryDirectory() as folder:
        try_formats(Path(folder))
        try_command(Path(folder) / "command")
    worst = 0.0
    for path in sorted(Path(sys.argv[1]).glob("*.model.h5")) if len(sys.argv) > 1 else ():
        data = tokid.load(path.with_name(path.name.replace(".model", "")))
        found = difference(tokid.identify(data, refine=False), tokid.load(path))
        print(f"{path.name}: {found:.1e}")
        worst = max(worst, found)
    assert worst <= TOLERANCE, worst
    print(f"Python {sys.version.split()[0]}, NumPy {np.__version__}, largest difference {worst:.1e}")


if __name__ == "__main__":
    main()
