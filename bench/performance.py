#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Measures tokid beside what it is compared with, all in one run, and writes the tables of docs/performance.md.

    performance.py BUILD [--quick] [--parts streaming,...] [--gigabytes 4] [--output DIR] [--document FILE]

BUILD holds the tool and the programs of bench/. Figures go to DIR/performance.json (DIR: BUILD/bench), with every
single measurement; the tables of the document between `<!-- table: NAME -->` and `<!-- end -->` are written anew, those
of parts that did not run are left as they are. The parts numpy, em and n4sid need the Python package of tokid in BUILD
and the Python of BUILD/bench-venv, which `make bench` sets up; where something is not installed, the table says so.
--quick runs everything on small sizes, to see that it works: its figures mean nothing, and its document is
DIR/performance.md.
"""

import argparse
import json
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import h5py
import numpy as np

from numpy_tokid import difference_of_files

HERE = Path(__file__).resolve().parent
DOCUMENT = HERE.parent / "docs" / "performance.md"
# Debian's OpenBLAS does not know newer processors and falls back to kernels of 2004: the fastest of these is taken.
CORE_TYPES = ["HASWELL", "ZEN", "SKYLAKEX", "COOPERLAKE", "SAPPHIRERAPIDS"]
CASES = {"large": "N = 4000, m = r = 8, p = 16, T = 200", "small": "example, N = 50, p = 2, T = 100 000",
         "middle": "N = 200, m = r = 4, p = 8, T = 1000"}


# Systems and ensembles in files

def oscillator(steps, dt=0.05):
    """A, B, C, D of the paper's example (77), (78); the exponential by its series, of which twenty terms are exact."""
    t = np.arange(steps) * dt
    generator = np.zeros((steps, 4, 4))
    generator[:, 0, 2] = generator[:, 1, 3] = dt
    generator[:, 2, 0], generator[:, 3, 1] = -dt * (4 + 3 * np.sin(10 * t)), -dt * (7 + 3 * np.cos(10 * t))
    generator[:, 2, 1] = generator[:, 3, 0] = dt
    A = term = np.broadcast_to(np.eye(4), generator.shape)
    for i in range(1, 20):
        term = term @ generator / i
        A = A + term
    B = np.array([[1, 0], [1, -1], [0, 1], [-1, 0]], float)
    C = np.array([[1, 0, 1, 0.2], [1, -1, 0, -0.5]])
    return A, np.tile(B, (steps, 1, 1)), np.tile(C, (steps, 1, 1)), np.tile(0.1 * np.eye(2), (steps, 1, 1))


def random_system(states, outputs, inputs, steps, seed=1):
    rng = np.random.default_rng(seed)
    A = 0.9 * np.linalg.qr(rng.standard_normal((steps, states, states)))[0]
    return (A, rng.standard_normal((steps, states, inputs)), rng.standard_normal((steps, outputs, states)),
            rng.standard_normal((steps, outputs, inputs)))


def write_ensemble(path, system, experiments, noise=0.0, block=500):
    """Simulated experiments with Gaussian inputs in an .h5 of contiguous (N, T, r) and (N, T, m), by blocks of time."""
    rng = np.random.default_rng(2)
    A, B, C, D = system
    steps, outputs, inputs = D.shape
    x = np.zeros((experiments, A.shape[1]))
    with h5py.File(path, "w") as file:
        file["dt"], file["initial_state"] = 0.05, "zero"
        all_u = file.create_dataset("u", (experiments, steps, inputs), dtype=float)
        all_y = file.create_dataset("y", (experiments, steps, outputs), dtype=float)
        for begin in range(0, steps, block):
            end = min(begin + block, steps)
            u = rng.standard_normal((experiments, end - begin, inputs))
            y = np.zeros((experiments, end - begin, outputs))
            if noise:
                y += noise * rng.standard_normal(y.shape)
            for k in range(begin, end):
                y[:, k - begin] += x @ C[k].T + u[:, k - begin] @ D[k].T
                x = x @ A[k].T + u[:, k - begin] @ B[k].T
            all_u[:, begin:end], all_y[:, begin:end] = u, y
    with open(path, "rb") as file:
        os.fsync(file.fileno())


def drop_from_cache(path):
    with open(path, "rb") as file:
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def read_seconds(path):
    """A plain read from the first byte to the last, by a megabyte at a time."""
    buffer = bytearray(1 << 20)
    begin = time.perf_counter()
    with open(path, "rb", buffering=0) as file:
        while file.readinto(buffer):
            pass
    return time.perf_counter() - begin


# Running and measuring

class Runner:
    def __init__(self, build, quick, gigabytes, folder):
        self.build, self.quick, self.gigabytes, self.folder = build, quick, gigabytes, folder
        self.repetitions = 2 if quick else 5
        self.environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        self.context, self.dgemm_by_core_type, self.load = {}, {}, os.getloadavg()[0]

    def program(self, name):
        path = self.build / "bin" / name
        if not path.exists():
            sys.exit(f"{path} is not there: build it first, with TOKID_BUILD_BENCH=ON")
        return path

    def benchmarks(self, name, *arguments, min_time=0.3, repetitions=None, environment=None):
        """{benchmark: {field: every repetition's value}} of a program of Google Benchmark."""
        output = self.folder / f"{name}.json"
        quick = ["--quick"] if self.quick else []
        command = [self.program(name), *quick, f"--benchmark_out={output}", "--benchmark_out_format=json",
                   f"--benchmark_repetitions={repetitions or self.repetitions}",
                   "--benchmark_enable_random_interleaving=true",
                   f"--benchmark_min_time={0.005 if self.quick else min_time}", *arguments]
        result = subprocess.run(command, env=environment or self.environment, stdout=subprocess.DEVNULL,
                                stderr=subprocess.PIPE, text=True, check=False)
        if result.returncode != 0:
            raise RuntimeError(f"{name}: exit status {result.returncode}\n{result.stderr}")
        written = json.loads(output.read_text())
        self.context.update(written["context"])
        found = {}
        for entry in sorted(written["benchmarks"], key=lambda entry: entry["family_index"]):  # as registered
            if entry.get("error_occurred"):
                raise RuntimeError(f"{entry['name']}: {entry['error_message']}")
            if entry["run_type"] == "iteration":
                values = found.setdefault(entry["run_name"].removesuffix("/real_time"), {})
                entry["seconds"] = entry["real_time"] * {"s": 1, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[entry["time_unit"]]
                for field, value in entry.items():
                    if isinstance(value, float):
                        values.setdefault(field, []).append(value)
        return found

    def choose_core_type(self):
        for core_type in [os.environ["OPENBLAS_CORETYPE"]] if "OPENBLAS_CORETYPE" in os.environ else CORE_TYPES:
            environment = {**self.environment, "OPENBLAS_CORETYPE": core_type}
            try:
                found = self.benchmarks("tokid_least_squares", "--benchmark_filter=^dgemm/threads:1", repetitions=2,
                                        environment=environment)
            except RuntimeError:
                continue  # not for this processor
            self.dgemm_by_core_type[core_type] = max(found["dgemm/threads:1"]["flops"])
            if self.dgemm_by_core_type[core_type] == max(self.dgemm_by_core_type.values()):
                fastest, context = environment, dict(self.context)
        if not self.dgemm_by_core_type:
            sys.exit("tokid_least_squares runs with no core type of OpenBLAS")
        self.environment, self.context = fastest, context

    def measured(self, *command):
        """Wall time, CPU time and peak memory of a command, and the JSON object that it printed, if it did."""
        result = subprocess.run([sys.executable, "-S", "-E", HERE / "measured.py", *map(str, command)],
                                env=self.environment, stdin=subprocess.DEVNULL, capture_output=True, text=True,
                                check=False)
        if result.returncode != 0:
            raise RuntimeError(f"{' '.join(map(str, command))}: exit status {result.returncode}\n"
                               f"{result.stdout}{result.stderr}")
        *printed, figures = result.stdout.strip().splitlines()
        figures = json.loads(figures)
        if printed and printed[0].startswith("{"):
            figures["printed"] = json.loads("\n".join(printed))
        return figures

    def in_process(self, part, *arguments):
        """What in_process.py found, or {"missing": {"": why}}."""
        python, package = self.build / "bench-venv" / "bin" / "python", self.build / "python"
        if not python.exists() or not list((package / "tokid").glob("_tokid*.so")):
            return {"missing": {"": f"{python} or the Python package of tokid is not there"}}
        quick = ["--quick"] if self.quick else []
        result = subprocess.run([python, HERE / "in_process.py", part, *map(str, arguments), *quick,
                                 f"--repetitions={self.repetitions}"],
                                env={**os.environ, "PYTHONPATH": str(package)}, stdin=subprocess.DEVNULL,
                                capture_output=True, text=True, check=False)
        if result.returncode != 0:
            raise RuntimeError(f"in_process.py {part}\n{result.stdout}{result.stderr}")
        return json.loads(result.stdout.splitlines()[-1])

    def identify(self, data, model="model.npz"):
        return self.measured(self.program("tokid"), "identify", data, "-o", self.folder / model, "--quiet")


# Tables

def pad(rows):
    """A table of Markdown; numbers to the right."""
    head, *body = [[str(cell) for cell in row] for row in rows]
    right = [all(re.match(r"^[-+<>]?[\d.]", row[c]) or row[c] in ("", "-") for row in body) for c in range(len(head))]
    lines = [head, ["---:" if r else "---" for r in right], *body]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def number(value):
    """Three digits, without exponents."""
    return "-" if value is None else f"{value:.0f}" if abs(value) >= 99.95 else f"{value:.3g}"


def duration(seconds):
    for unit, size in (("s", 1), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size:
            break
    return f"{number(seconds / size)} {unit}"


def spread(values):
    """Half the range over the median, of several values."""
    if len(values) < 2:
        return ""
    return f"± {50 * (max(values) - min(values)) / median(values):.0f} %"


class Results:
    def __init__(self):
        self.figures, self.tables, self.targets = {}, {}, []

    def not_measured(self, what, wanted):
        self.targets.append([what, "not measured", wanted, "-"])

    def target(self, what, measured, wanted, at_most=False, unit=""):
        met = measured <= wanted if at_most else measured >= wanted
        self.targets.append([what, f"{number(measured)}{unit}", f"{'≤' if at_most else '≥'} {wanted}{unit}",
                             "yes" if met else "**no**"])


# The parts

LONGEST = 60  # [s] of processor time for one identification; what takes longer is stopped


def with_gaps(source, target, kind):
    """The ensemble with missing samples: 10 % of all at random, 30 % of one output, or with ends cut off."""
    rng = np.random.default_rng(4)
    with np.load(source) as file:
        arrays = dict(file)
    y = arrays["y"]
    if kind == "random":
        y[rng.random(y.shape) < 0.1] = np.nan
    elif kind == "output":
        y[..., 0][rng.random(y.shape[:2]) < 0.3] = np.nan
    else:
        arrays["length"] = rng.integers(y.shape[1] // 2, y.shape[1] + 1, len(y))
    np.savez(target, **arrays)


def noise(run, results):
    """`tokid identify` with all of its defaults, of the example with noise."""
    data = run.folder / "noisy.npz"

    def example(experiments, steps):
        subprocess.run([run.program("tokid"), "example", "oscillator", "-o", data, "--experiments", str(experiments),
                        "--steps", str(steps), "--process-noise", "0.02", "--measurement-noise", "0.05", "--seed", "1"],
                       stdout=subprocess.DEVNULL, check=True)

    def identified(path=data):
        """Every repetition, fewer of what takes long; none where it takes too long."""
        found = []
        while len(found) < run.repetitions and sum(f["cpu_seconds"] for f in found) < 5:
            try:
                found.append(run.measured("prlimit", f"--cpu={LONGEST}", run.program("tokid"), "identify", path, "-o",
                                          run.folder / "model.npz", "--quiet"))
            except RuntimeError as stopped:
                # Only the limit of processor time may have stopped it, by one of these signals.
                signals = (256 - signal.SIGKILL, 256 - signal.SIGXCPU)
                if found or not any(f": exit status {status}\n" in str(stopped) for status in signals):
                    raise
                return []
        return found

    def seconds(found):
        return median(f["cpu_seconds"] for f in found)

    def cells(found):
        if not found:
            return [f"> {LONGEST} s", "", "", ""]
        return [duration(seconds(found)), spread([f["cpu_seconds"] for f in found]), len(found),
                f"{median(f['peak_bytes'] for f in found) / 1e6:.0f} MB"]

    sizes = [(50, 200), (200, 80), (50, 500), (200, 500), (100_000, 10), (10, 10_000)]
    series = {"T": [(10, steps) for steps in (100, 1000, 10_000, 100_000)],
              "N": [(experiments, 10) for experiments in (100, 1000, 10_000, 100_000)]}
    if run.quick:
        sizes, series = [(20, 20)], {"T": [(10, 20), (10, 40)], "N": [(10, 20), (20, 20)]}
    measured, gaps = {}, {}
    for size in dict.fromkeys([*sizes, *(size for some in series.values() for size in some)]):
        example(*size)
        measured[size] = identified()
        if size == sizes[0]:
            for kind in ("random", "output", "length"):
                with_gaps(data, run.folder / "gaps.npz", kind)
                gaps[kind] = identified(run.folder / "gaps.npz")
    results.figures["noise"] = {"sizes": [[*size, found] for size, found in measured.items()], "gaps": gaps}

    rows = [["N", "T", "processor time", "spread", "runs", "peak memory"]]
    results.tables["noise"] = pad([*rows, *([*size, *cells(measured[size])] for size in sizes)])
    for symbol, some in series.items():
        done = [size for size in some if measured[size]]
        times = [seconds(measured[size]) for size in done]
        slope = exponent([n * t for n, t in done], times) if done == some else None
        last = ["exponent", "", "-" if slope is None else f"{slope:.3f}", "", "", ""]
        results.tables[f"noise {symbol}"] = pad([*rows, *([*size, *cells(measured[size])] for size in some), last])
        what = f"noisy data: exponent of {symbol}"
        if len(done) == len(some):
            results.target(what, slope, 1.05, at_most=True)
        else:
            results.not_measured(what, "≤ 1.05")
    words = {"random": "10 % of the samples of the outputs at random", "output": "30 % of one output",
             "length": "ends of experiments: lengths between T / 2 and T"}
    rows = [["missing", "processor time", "spread", "runs", "ratio to complete data"]]
    for kind, found in gaps.items():
        what = f"noisy data: missing {words[kind]}, ratio to complete data"
        if not measured[sizes[0]]:
            rows.append([words[kind], *cells(found)[:3], "-"])
            results.not_measured(what, "≤ 5")
            continue
        ratio = (seconds(found) if found else LONGEST) / seconds(measured[sizes[0]])
        rows.append([words[kind], *cells(found)[:3], f"{'' if found else '> '}{number(ratio)}"])
        if found or ratio > 5:  # that is at least the ratio of what was stopped
            results.target(what, ratio, 5, at_most=True)
        else:
            results.not_measured(what, "≤ 5")
    results.tables["noise gaps"] = pad(rows)


def medians(times):
    return {name: median(values["cpu"]) for name, values in times.items()}


def timed(label, times, name, reference):
    """Cells of a table: label, processor time and its spread, wall time, the first over that of the reference."""
    cpu = times[name]["cpu"]
    return [label, duration(median(cpu)), spread(cpu), duration(median(times[name]["wall"])),
            number(median(cpu) / median(times[reference]["cpu"]))]


def numpy(run, results):
    """The example without noise, the Python package beside a batched script of NumPy."""
    sizes = [(20, 40)] if run.quick else [(50, 3200), (1000, 3200), (50, 100_000), (1000, 10_000)]
    wanted = {(50, 3200): 3, (1000, 3200): 5}
    rows = [["", "N", "T", "processor time", "spread", "wall time", "ratio to tokid"]]
    labels = {"tokid": "`tokid.identify`, with its checks and the validation", "numpy": "NumPy, the model",
              "numpy_validated": "NumPy, the model and its validation"}
    results.figures["numpy"] = []
    for size in sizes:
        found = run.in_process("numpy", *size)
        results.figures["numpy"].append(found)
        if "missing" in found:
            results.tables["numpy"] = pad([rows[0], ["not measured", *size, "", "", "", ""]])
            for other, factor in wanted.items():
                results.not_measured(f"Python package: speed-up over NumPy, N = {other[0]}, T = {other[1]}",
                                     f"≥ {factor}")
            return
        for name, label in labels.items():
            first, *rest = timed(label, found["times"], name, "tokid")
            rows.append([first, *size, *rest])
        if size in wanted:
            times = medians(found["times"])
            results.target(f"Python package: speed-up over NumPy, N = {size[0]}, T = {size[1]}",
                           times["numpy"] / times["tokid"], wanted[size])
    results.tables["numpy"] = pad(rows)


def beside(run, results, part, labels, reference, extra=None):
    """The table of a part of in_process.py; its times by name."""
    head = ["", "processor time", "spread", "wall time", "ratio to tokid", *([extra[0]] if extra else [])]
    found = run.in_process(part)
    results.figures[part] = found
    if "times" not in found:
        results.tables[part] = pad([head, ["not measured", *[""] * (len(head) - 1)]])
        return {}
    rows = [head]
    for name, label in labels.items():
        label += f" {found['versions'][name]}" if name in found.get("versions", {}) else ""
        if name in found["times"]:
            rows.append(timed(label, found["times"], name, reference) + ([extra[1](found, name)] if extra else []))
        else:
            rows.append([f"{label}: not measured, not installed", *[""] * (len(head) - 1)])
    results.tables[part] = pad(rows)
    return medians(found["times"])


def em(run, results):
    """One iteration of EM."""
    labels = {"tokid": "tokid, matrices that vary in time", "tokid_invariant": "tokid, one model for all steps",
              "dynamax": "dynamax, one model for all steps", "numpy": "NumPy, one model for all steps"}
    times = beside(run, results, "em", labels, "tokid_invariant")
    for other in ("dynamax", "numpy"):
        what = f"EM: speed-up of an iteration over {labels[other].split(',')[0]}"
        if other in times:
            results.target(what, times[other] / times["tokid_invariant"], 5)
        else:
            results.not_measured(what, "≥ 5")


def n4sid(run, results):
    """A time-invariant model of one record with noise."""
    labels = {"tokid": "tokid", "tokid_no_refine": "tokid, without EM", "octave": "n4sid of Octave",
              "nfoursid": "nfoursid"}
    beside(run, results, "n4sid", labels, "tokid",
           ("error above that of the Kalman filter", lambda found, name: f"{100 * found['excess'][name]:.2f} %"))


def least_squares(run, results):
    found = run.benchmarks("tokid_least_squares")
    results.figures["least_squares"] = found
    dgemm = {threads: median(found[f"dgemm/threads:{threads}"]["flops"]) for threads in (1, 2)}
    names = {"tokid": "tokid", "eigen": "Eigen HouseholderQR", "eigen_native": "Eigen HouseholderQR, -march=native",
             "dgels": "LAPACK dgels"}
    per_step = {}
    for case in CASES:
        rows = [["", "threads", "time per step", "spread", "naive GFLOP/s", "ratio to dgemm",
                 "tokid faster by a factor of"]]
        for threads in (1, 2):
            for name, label in names.items():
                values = found[f"{case}/{name}/threads:{threads}"]
                seconds = per_step[case, name, threads] = 1 / median(values["items_per_second"])
                rate = median(values["naive_flops"])
                ratio = "" if name == "tokid" else number(seconds / per_step[case, "tokid", threads])
                rows.append([label, threads, duration(seconds), spread(values["items_per_second"]), number(rate / 1e9),
                             number(rate / dgemm[threads]), ratio])
            rows.append(["dgemm", threads, "", spread(found[f"dgemm/threads:{threads}"]["flops"]),
                         number(dgemm[threads] / 1e9), "1", ""])
        results.tables[case] = pad(rows)

    def faster(case, name):
        return per_step[case, name, 1] / per_step[case, "tokid", 1]

    naive = median(found["large/tokid/threads:1"]["naive_flops"])
    results.target("large: naive rate, ratio to dgemm", naive / dgemm[1], 1.8)
    results.target("large: speed-up over dgels", faster("large", "dgels"), 5)
    for case, wanted in (("small", 5), ("middle", 3)):
        results.target(f"{case}: speed-up over Eigen, compiled like tokid", faster(case, "eigen"), wanted)
        results.target(f"{case}: speed-up over Eigen, -march=native", faster(case, "eigen_native"), wanted)
    for case in CASES:
        results.target(f"{case}: speed-up by two threads", per_step[case, "tokid", 1] / per_step[case, "tokid", 2], 1.8)


def end_to_end(run, results):
    steps = 100 if run.quick else 3200
    data, script_model = run.folder / "example.npz", run.folder / "script.npz"
    subprocess.run([run.program("tokid"), "example", "oscillator", "--experiments", "50", "--steps", str(steps), "-o",
                    data], stdout=subprocess.DEVNULL, check=True)
    script = [sys.executable, HERE / "numpy_tokid.py", data, "-o", script_model, "--lags", 2]
    tool, numpy, read = [], [], []
    for _ in range(run.repetitions):
        numpy.append(run.measured(*script))
        tool += [run.identify(data) for _ in range(2)]
        read += [read_seconds(data) for _ in range(2)]
    difference = difference_of_files(script_model, run.folder / "model.npz")
    if not difference <= 1e-8:
        raise RuntimeError(f"the NumPy script and the tool disagree: pulse responses differ by {difference:.1e}")
    data_bytes = 50 * steps * 4 * 8
    above = median(t["peak_bytes"] for t in tool) - data_bytes
    results.figures["end_to_end"] = {"steps": steps, "data_bytes": data_bytes, "tokid": tool, "numpy": numpy,
                                     "read_seconds": read, "pulse_response_difference": difference}
    walls = {"tokid": [t["seconds"] for t in tool], "numpy": [n["seconds"] for n in numpy],
             "inside": [n["printed"]["seconds"] for n in numpy], "read": read}
    tokid = median(walls["tokid"])
    rows = [["", "time", "spread", "ratio to tokid", "peak memory"]]
    for label, key, peak in (("tokid identify, the process", "tokid", median(t["peak_bytes"] for t in tool)),
                             ("NumPy script, the process", "numpy", median(n["peak_bytes"] for n in numpy)),
                             ("NumPy script, from file to file", "inside", None),
                             ("plain read of the file", "read", None)):
        rows.append([label, duration(median(walls[key])), spread(walls[key]), number(median(walls[key]) / tokid),
                     f"{peak / 1e6:.0f} MB" if peak else ""])
    results.tables["end to end"] = pad(rows)
    results.target("end to end: time", tokid, 0.1, at_most=True, unit=" s")
    results.target("end to end: peak memory above the data", above / 1e6, 60, at_most=True, unit=" MB")


def stages(run, results):
    found = run.benchmarks("tokid_stages", min_time=0.1)
    results.figures["stages"] = found
    for end in ("small", "large"):
        rows = [["function", "one thread", "spread", "two threads", "share"]]
        whole = median(found[f"{end}/identify_tvera/threads:1"]["seconds"])
        for name in found:
            if name.startswith(end + "/") and name.endswith(":1"):
                one, two = found[name]["seconds"], found[name[:-1] + "2"]["seconds"]
                rows.append([f"`{name.split('/')[1]}`", duration(median(one)), spread(one), duration(median(two)),
                             f"{100 * median(one) / whole:.0f} %"])
        results.tables[f"stages {end}"] = pad(rows)


def exponent(sizes, seconds):
    return np.polyfit(np.log(sizes), np.log(seconds), 1)[0]


def scaling(run, results):
    found = run.benchmarks("tokid_scaling", min_time=0.1)
    results.figures["scaling"] = found
    exponents = {}
    for over, symbol, fixed in (("steps", "T", "N = 50"), ("experiments", "N", "T = 200")):
        rows = [[symbol, "regressions", "whole identification"]]
        sizes = sorted({int(name.split("/")[0].split(":")[1]) for name in found if name.startswith(over + ":")})
        times = {stage: [median(found[f"{over}:{size}/{stage}"]["seconds"]) for size in sizes]
                 for stage in ("gtv_arx", "identify")}
        for i, size in enumerate(sizes):
            rows.append([size, duration(times["gtv_arx"][i]), duration(times["identify"][i])])
        exponents[over] = {stage: exponent(sizes, seconds) for stage, seconds in times.items()}
        rows.append(["exponent", *(f"{e:.3f}" for e in exponents[over].values())])
        results.tables[f"scaling {over}"] = pad(rows)
        for stage, label in (("gtv_arx", "regressions"), ("identify", "whole identification")):
            results.target(f"{label}: exponent of {symbol} at {fixed}", exponents[over][stage], 1.05, at_most=True)
    results.figures["scaling_exponents"] = exponents


def streaming(run, results):
    experiments = 100 if run.quick else 2000
    steps = int(run.gigabytes * 1e9 / (experiments * 4 * 8))
    data = run.folder / "stream.h5"
    write_ensemble(data, oscillator(steps), experiments)
    size = data.stat().st_size
    read, identify = {"cold": [], "warm": []}, {"cold": [], "warm": []}
    for _ in range(run.repetitions):
        drop_from_cache(data)
        for cache in ("cold", "warm"):
            read[cache].append(read_seconds(data))
        drop_from_cache(data)
        for cache in ("cold", "warm"):
            identify[cache].append(run.identify(data, "model.h5"))
    data.unlink()
    results.figures["streaming"] = {"file_bytes": size, "experiments": experiments, "steps": steps,
                                    "read_seconds": read, "identify": identify}
    rows = [["", "cache", "time", "spread", "rate", "ratio to plain read", "peak memory"]]
    for cache in ("cold", "warm"):
        walls = [i["seconds"] for i in identify[cache]]
        peak = max(i["peak_bytes"] for i in identify[cache])
        share = median(read[cache]) / median(walls)
        for label, values, ratio, memory in (("plain read of the file", read[cache], 1, ""),
                                             ("tokid identify", walls, share, f"{peak / 1e6:.0f} MB")):
            rows.append([label, cache, duration(median(values)), spread(values),
                         f"{number(size / 1e9 / median(values))} GB/s", number(ratio), memory])
        if cache == "cold":  # a file larger than memory is never in it
            results.target("large file: rate, ratio to plain read", share, 0.5)
            results.target("large file: peak memory", peak / 1e6, 400, at_most=True, unit=" MB")
    results.tables["streaming"] = pad([["file", f"{size / 1e9:.2f} GB: N = {experiments}, T = {steps}, m = r = 2"]]) \
        + "\n\n" + pad(rows)


def mpi(run, results):
    program = run.build / "bin" / "tokid-mpi"
    rows = [["", "ranks", "time", "spread", "speed-up"]]
    if not program.exists() or not shutil.which("mpirun"):
        results.tables["mpi"] = pad([*rows, ["tokid-mpi: not built", "", "", "", ""]])
        results.targets.append(["MPI: speed-up by two ranks", "not built", "≥ 1.7", "-"])
        return
    experiments, steps, channels, lags, states = (200, 600, 2, 2, 4) if run.quick else (1000, 12000, 4, 8, 8)
    data = run.folder / "mpi.h5"
    write_ensemble(data, random_system(states, channels, channels, steps), experiments, noise=0.1, block=100)
    times = {1: [], 2: []}
    for _ in range(run.repetitions):
        for ranks, seconds in times.items():
            seconds.append(run.measured("mpirun", "--allow-run-as-root", "--oversubscribe", "-n", ranks, program,
                                        "identify", data, "-o", run.folder / "model.h5", "--quiet", "--block", "auto",
                                        "--method", "tvera", "--lags", lags, "--states", states)["seconds"])
    data.unlink()
    results.figures["mpi"] = {"experiments": experiments, "steps": steps, "seconds": times}
    for ranks, seconds in times.items():
        rows.append(["tokid-mpi identify", ranks, duration(median(seconds)), spread(seconds),
                     number(median(times[1]) / median(seconds))])
    results.tables["mpi"] = pad(rows)
    results.target("MPI: speed-up by two ranks", median(times[1]) / median(times[2]), 1.7)


PARTS = {part.__name__: part for part in (noise, numpy, em, n4sid, least_squares, end_to_end, stages, scaling,
                                          streaming, mpi)}


# What it was measured on

def first_line(*command):
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[0].strip()
    except (OSError, subprocess.CalledProcessError, IndexError):
        return ""


def machine(run):
    information = Path("/proc/cpuinfo").read_text()
    cache = (run.build / "CMakeCache.txt").read_text()
    build_type = re.search(r"^CMAKE_BUILD_TYPE:\w+=(.*)$", cache, re.MULTILINE)[1]
    flags = re.search(rf"^CMAKE_CXX_FLAGS_{build_type.upper()}:\w+=(.*)$", cache, re.MULTILINE)
    facts = {
        "processor": re.search(r"^model name\s*:\s*(.*)$", information, re.MULTILINE)[1],
        "family, model, stepping": ", ".join(re.search(rf"^{name}\s*:\s*(\d+)$", information, re.MULTILINE)[1]
                                             for name in ("cpu family", "model", "stepping")),
        "vector instructions": " ".join(flag for flag in ("sse2", "avx2", "fma", "avx512f", "avx512dq")
                                        if re.search(rf"\b{flag}\b", information)),
        "cores": str(len(os.sched_getaffinity(0))),
        "memory": f"{os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 1e9:.0f} GB",
        "system": f"{platform.freedesktop_os_release().get('PRETTY_NAME', '')}, Linux {platform.release()}",
        "load before the run": f"{run.load:.2f}",
        "compiler": f"{run.context['compiler']}, {build_type} {flags[1] if flags else ''}",
        "tokid": run.context["tokid"],
        "Eigen": run.context["eigen"],
        "OpenBLAS": f"{run.context['openblas'].strip()}; core type {run.context['openblas_core']}",
        "dgemm by requested core type": ", ".join(f"{core} {rate / 1e9:.0f} GFLOP/s" for core, rate in
                                                  run.dgemm_by_core_type.items()),
        "HDF5": h5py.version.hdf5_version,
        "NumPy": f"{np.__version__}, Python {platform.python_version()}",
        "Highway": first_line("pkg-config", "--modversion", "libhwy") if re.search("hwy", cache, re.IGNORECASE) else "",
        "MPI": first_line("mpirun", "--version") if (run.build / "bin" / "tokid-mpi").exists() else "",
    }
    return {name: value for name, value in facts.items() if value}


def with_tables(text, tables):
    """The document with its tables written anew."""
    for name, table in tables.items():
        place = re.compile(rf"(<!-- table: {re.escape(name)} -->\n).*?(<!-- end -->)", re.DOTALL)
        if not place.search(text):
            sys.exit(f"the document has no place for the table '{name}'")
        text = place.sub(lambda match, table=table: f"{match[1]}{table}\n{match[2]}", text)
    return text


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build", type=Path)
    parser.add_argument("--quick", action="store_true", help="small sizes, to see that it works")
    parser.add_argument("--parts", type=lambda text: text.split(","), default=list(PARTS),
                        help=f"of {','.join(PARTS)} (default: all)")
    parser.add_argument("--gigabytes", type=float, help="size of the large file (default 4)")
    parser.add_argument("--output", type=Path, help="folder of performance.json (default BUILD/bench)")
    parser.add_argument("--document", type=Path, help=f"whose tables to write anew (default {DOCUMENT.name})")
    call = parser.parse_args()
    if unknown := set(call.parts) - set(PARTS):
        parser.error(f"--parts: {', '.join(sorted(unknown))} found, one of {', '.join(PARTS)} needed")
    build = call.build.resolve()
    output = call.output or build / "bench"
    output.mkdir(parents=True, exist_ok=True)
    gigabytes = call.gigabytes or (0.01 if call.quick else 4)

    results, seconds = Results(), {}
    # Not in /tmp, which may be memory.
    with tempfile.TemporaryDirectory(dir=output, prefix="performance-") as folder:
        run = Runner(build, call.quick, gigabytes, Path(folder))
        run.choose_core_type()
        for name in call.parts:
            begin = time.perf_counter()
            print(f"{name} ...", end="", flush=True)
            PARTS[name](run, results)
            seconds[name] = time.perf_counter() - begin
            print(f" {seconds[name]:.0f} s", flush=True)
        facts = machine(run)

    results.tables["machine"] = pad([["", ""], *facts.items()])
    if set(call.parts) == set(PARTS):
        results.tables["targets"] = pad([["target", "measured", "wanted", "met"], *results.targets])
    text = {"quick": call.quick, "repetitions": run.repetitions, "machine": facts, "targets": results.targets,
            "seconds": seconds, "figures": results.figures}
    (output / "performance.json").write_text(json.dumps(text, indent=1, default=str))
    document = call.document or DOCUMENT
    updated = with_tables(document.read_text(), results.tables)
    (output / document.name if call.quick else document).write_text(updated)
    for name, table in results.tables.items():
        print(f"\n{name}\n{table}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
