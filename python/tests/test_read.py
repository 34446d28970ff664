# SPDX-License-Identifier: BSD-3-Clause
"""Tables and logs of other programs: what they say, what is told of them, and what is refused."""

import itertools
import struct
import subprocess
import sys
import warnings

import numpy as np
import pandas as pd
import pytest
import tokid

RNG = np.random.default_rng(7)
U, Y = RNG.normal(size=40).round(4), (1000 * RNG.normal(size=40)).round(3)
DT = 0.05


def read(source, **options):
    """The ensemble, and all remarks as one text."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        data = tokid.read(source, **options)
    return data, "\n".join(str(one.message) for one in told if issubclass(one.category, tokid.TokidWarning))


@pytest.fixture
def file(tmp_path):
    def write(text, name="data.csv", encoding="utf-8"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(text.encode(encoding))
        return path

    return write


def rows(stamp, header="time,u,y", *, u=U, y=Y, separator=","):
    lines = [separator.join((str(stamp(k)), f"{a}", f"{b}")) for k, (a, b) in enumerate(zip(u, y))]
    return "\n".join([header, *lines]) + "\n"


def same(data, dt=DT, u=U, y=Y):
    assert data.dt == dt and data.dt_stated
    np.testing.assert_array_equal(data.u[0, :, 0], u)
    np.testing.assert_array_equal(data.y[0, :, 0], y)


def refused(source, *words, error=tokid.IoError, **options):
    with pytest.raises(error) as raised:
        read(source, **options)
    for word in words:
        assert word in str(raised.value), str(raised.value)


# ---- dialects ----

STAMPS = {
    "seconds": ("time", lambda k: f"{k * DT:.2f}"),
    "ms in brackets": ("t [ms]", lambda k: f"{k * 50}"),
    "time stamps": ("when", lambda k: f"2026-11-27 13:12:{5 + k * 5 // 100:02d}.{k * 5 % 100:02d}"),
    "epoch in ns": ("timestamp", lambda k: 1700000000123456789 + k * 50_000_000),
}
DIALECTS = [
    d for d in itertools.product(",;\t", ".,", ["utf-8", "utf-8-sig", "utf-16", "cp1252"], STAMPS, ["bracket", "row"])
]


@pytest.mark.parametrize("separator,decimal,encoding,stamps,units", DIALECTS)
def test_a_table_reads_the_same_in_every_dialect(separator, decimal, encoding, stamps, units, file):
    name, stamp = STAMPS[stamps]

    def cell(value):
        text = str(value).replace(".", decimal) if stamps != "time stamps" or "-" not in str(value)[1:] else str(value)
        return f'"{text}"' if separator in text else text

    header = [name, "u [V]", "y [\u00b0C]"] if units == "bracket" else [name, "u", "y"]
    below = [] if units == "bracket" else [separator.join(["s" if name == "time" else "", "V", "\u00b0C"])]
    body = [separator.join(map(cell, (stamp(k), a, b))) for k, (a, b) in enumerate(zip(U, Y))]
    path = file("\n".join(["logger 7", separator.join(header), *below, *body]) + "\n", encoding=encoding)
    data, told = read(path)
    same(data)
    assert data.input_units == ["V"] and data.output_units == ["\u00b0C"] and "line 1 was skipped" in told
    assert ("Latin-1" in told) == (encoding == "cp1252") and ("decimal commas" in told) == (decimal == ",")


@pytest.mark.parametrize(
    "text, words",
    [
        (rows(lambda k: f"{k * DT:.2f}", y=[f"{1234.5 + k:,.2f}".replace(",", "'") for k in range(40)]), "apostrophes"),
        (rows(lambda k: f"{k * DT:.2f}".replace(".", ","), "time;u;y", separator=";",
              u=[str(u).replace(".", ",") for u in U], y=[f"1 {234 + k},5" for k in range(40)]), "spaces"),
        (rows(lambda k: f"{k * DT:.2f}", "time;u;y", separator=";", y=[f"1,{234 + k}.5" for k in range(40)]), "commas"),
    ],
)
def test_separators_of_thousands(text, words, file):
    data, told = read(file(text))
    same(data, y=1234.5 + np.arange(40))
    assert f"{words} in numbers were read as separators of thousands" in told


def test_marks_that_may_group_thousands(file):
    refused(file('t [s],u,y\n0,999,"1,000"\n1,998,"1,001"\n'), "line 2", "thousands")
    refused(file("t [s];u;y\n0;1;998\n1;1;999\n2;1;1.000\n"), "line 4", "thousands", "'y'")
    data, told = read(file("t [s];u;y\n0;999;1,000\n1;998;1,001\n"))
    assert data.y[0, 1, 0] == 1.001 and "group thousands" in told


@pytest.mark.parametrize("word", ["Bad", "---", "#N/A", "-nan(ind)", "1.#QNAN", "I/O Timeout"])
def test_words_for_missing_samples(word, file):
    text = rows(lambda k: f"{k * DT:.2f}", y=[word, "", "NaN", *Y[3:]])
    data, told = read(file(text))
    assert np.isnan(data.y[0, :3, 0]).all() and f"1 cell with '{word}'" in told and "line 2, column 'y'" in told
    np.testing.assert_array_equal(data.y[0, 3:, 0], Y[3:])


def test_stated_missing_words(file):
    text = "time;u;y\n0;20;0,5\n1;-999,25;1,5\n2;25;weg\n"
    data, _ = read(file(text), missing=["-999,25", "weg"])
    np.testing.assert_array_equal(data.u[0, :, 0], [20, np.nan, 25])
    assert np.isnan(data.y[0, 2, 0])
    assert "missing='-999'" in read(file(text), missing=["-999", "weg"])[1]
    refused(file(text), "line 4, column 'y': 'weg' found, a number needed; missing='weg'")


def test_numbers_of_other_programs(file):
    data, _ = read(file("time,u,y\n0.0D+00,1.5D-01,ON\n5.0D-02,2.5D+01,off\n"))
    assert data.dt == DT and data.u[0, :, 0].tolist() == [0.15, 25.0] and data.y[0, :, 0].tolist() == [1, 0]
    refused(file("time,u,y\n0,+-5,1\n1,2,2\n"), "'+-5' found, a number needed")


@pytest.mark.parametrize(
    "above, units",
    [
        ("s,V,m\nTime,u,y", ["V", "m"]),
        ("Time,u,y\nSimulation time,Vent # 1,Upper layer\ns,V,m", ["V", "m"]),
        ('"TOA5","CR1","CR1","12","x"\n"TIMESTAMP","u","y"\n"TS","",""\n"","Smp","Smp"', ["", ""]),
        ("setting,7\n" * 30 + "t,u,y", ["", ""]),
        ("# t,u,y", ["", ""]),
        ("# dt = 0.05\n# initial_state = zero\nt,u,y", ["", ""]),
    ],
)
def test_headers(above, units, file):
    data, _ = read(file(rows(lambda k: f"{k * DT:.2f}", above)))
    same(data)
    assert data.input_units + data.output_units == units or not any(units)
    assert data.initial_state == ("zero" if "zero" in above else None)


@pytest.mark.parametrize("first", ["1,1", "1,-", "1,2.5"])
def test_a_row_of_numbers_is_no_row_of_units(first, file):
    data, _ = read(file(f"time,u,y\n0,{first}\n1,0,3\n2,0,4\n"))
    assert data.steps == 3 and data.u[0, 0, 0] == 1


REFUSED = {
    "no header": ("0,1,2\n1,2,3\n", ["line 1", "names the columns"]),
    "header of two rows": (",a,a,b,b\n,u,y,u,y\ntime,,,,\n0,1,2,3,4\n1,2,3,4,5\n", ["2 columns 'u'"]),
    "equal names": ("time,u,u,y\n0,1,2,3\n1,2,3,4\n", ["2 columns 'u'"]),
    "summary with names": ("time,u,y\n0,1,2\n1,2,3\nMean,1,2\n", ["line 4", "'Mean'", "Delete"]),
    "summary without names": ("time,u,y\n0,1,2\n1,2,3\n,1,2\n", ["line 4", "nothing found"]),
    "long row": ("t,u,y\n0,1.5,2\n1,2.5,3,4\n", ["line 3: 4 cells found, 3 needed", "'4'"]),
    "short row": ("t,u,y\n0,1.5,2\n1,2.5\n2,1,1\n", ["line 3: 2 cells found, 3 needed"]),
    "other decimal mark": ("t;u;y\n0;1.5;2\n1;2,5;3\n", ["line 3, column 'u'", "decimal mark"]),
    "no number": ("t,u,y\n0,1,2\n1,oops,3\n", ["line 3, column 'u': 'oops' found, a number needed"]),
    "zero bytes": ("t,u\0,y\n0,1,2\n", ["zero bytes"]),
    "empty": ("\n", ["no text"]),
    "infinite": ("t,u,y\n0,inf,2\n1,2,3\n", ["line 2, column 'u'"]),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_tables_that_are_refused(kind, file):
    text, words = REFUSED[kind]
    refused(file(text), "data.csv", *words)


@pytest.mark.parametrize("more", [{"dt": DT}, {}, {"dt": 1 / 3, "length": [9, 7], "initial_state": "zero"}])
def test_a_table_of_tokid_comes_back(more, tmp_path):
    samples = RNG.normal(size=(2, 9, 3))
    samples[1, 3, 0] = np.nan
    names = {"input_names": ["valve, big", "T"], "output_names": ["p (kPa)"], "input_units": ["%", ""], "output_units": ["bar"]}
    data = tokid.Ensemble(samples[:, :, :2], samples[:, :, 2:], **names, **more)
    data.save(tmp_path / "data.csv")
    back, _ = read(tmp_path / "data.csv")
    assert (back.fingerprint, back.dt, back.dt_stated, back.initial_state) == (
        data.fingerprint, data.dt, data.dt_stated, data.initial_state)
    assert all(getattr(back, name) == value for name, value in names.items())
    assert (back.length is None) == ("length" not in more)


# ---- clocks ----

CLOCKS = {
    "uptime_ms": lambda k: 5000 + 50 * k, "unix_time": lambda k: f"{1760000000 + k * DT:.3f}",
    "usec": lambda k: 50000 * k, "utc_s": lambda k: f"{k * DT:.3f}", "us": lambda k: 50000 * k,
    "TimeUS": lambda k: 98765432 + 50000 * k,
    "tow(msec)": lambda k: 345600000 + 50 * k, "millis": lambda k: 1234 + 50 * k, "Time_ms": lambda k: 50.0 * k,
    "%time": lambda k: 1700000000123456789 + k * 50_000_000, "Zeit [min]": lambda k: repr(k * DT / 60),
    "Time": lambda k: f"{45000.5 + k * DT / 86400:.10f}", "timestamp": lambda k: 1700000000123 + 50 * k,
}  # fmt: skip


@pytest.mark.parametrize("name", CLOCKS)
def test_clocks(name, file):
    data, told = read(file(rows(CLOCKS[name], f"{name},u,y")))
    same(data)
    assert (
        ("days since 1900" in told) == (name == "Time") and "since 1970" in told or name not in ("%time", "timestamp")
    )


def test_split_clocks(file):
    stamps = [1700000000_900000000 + k * 50_000_000 for k in range(40)]
    data, told = read(
        file(rows(lambda k: f"{stamps[k] // 10**9},{stamps[k] % 10**9}", "a.stamp.sec,a.stamp.nanosec,u,y"))
    )
    same(data)
    assert "read as one time" in told
    data, _ = read(
        file(rows(lambda k: f"03/04/2026,{k // 2:02d}:{k % 2 * 30:02d}:00", "Date,Clock,u,y")), dates="day-first"
    )
    same(data, 1800)


def test_doubtful_clocks(file):
    path = file(rows(lambda k: 64300000 + 50000 * k, "timestamp,u,y"))
    refused(path, "13.9 h", "time='timestamp [us]'")
    same(read(path, time="timestamp [us]")[0])
    data, told = read(file(rows(lambda k: f"{k * DT:.2f}", "Name,u,y")))
    assert not data.dt_stated and "column 'Name' rises evenly like a clock" in told
    same(read(file(rows(lambda k: f"{k * DT:.2f}", "uptime_x,u,y")), time="uptime_x")[0])
    refused(file(rows(lambda k: "1.73e+09")), "more digits")
    refused(file(rows(lambda k: f"{k * DT:.1f}")), "a second row")
    refused(file(rows(lambda k: f"0{1 + k // 20}/0{1 + k % 9}/2026 13:00")), "dates='day-first'")
    refused(file(rows(lambda k: k, "time [fortnight],u,y")), "'fortnight' is not known")


def test_pairs_of_times_and_values(file):
    path = file(
        rows(
            lambda k: f"{k * DT:.2f}", "Name;u;Name;y", separator=";", y=[f"{k * DT:.2f};{y}" for k, y in enumerate(Y)]
        )
    )
    same(read(path, time="Name")[0])


FALLS = {
    "set back": (
        "time",
        [f"{k + 0.003 * (k % 3):.3f}" for k in [*range(30), *range(15, 25)]],
        ["line 32", "times fall"],
    ),
    "12-hour clock": (
        "time",
        [f"11/27/2026 {(11 + k // 60) % 12 + 1}:{k % 60:02d}:00" for k in range(50, 90)],
        ["AM and PM"],
    ),
    "summer time": (
        "time",
        [f"2026-10-25 0{h}:{m:02d}:00" for h in (1, 2, 2, 3) for m in range(0, 60, 6)],
        ["Summer time"],
    ),
    "milliseconds": ("time", [f"13:12:05.{10 * k}" for k in range(40)], ["digits"]),
}


@pytest.mark.parametrize("kind", FALLS)
def test_falling_times_are_refused(kind, file):
    name, stamps, words = FALLS[kind]
    refused(file(rows(lambda k: stamps[k], f"{name},u,y")), "line ", *words)


@pytest.mark.parametrize("late", [0, 0.25, 0.003])
def test_times_that_begin_again(late, file):
    data, told = read(file(rows(lambda k: k if k < 20 else k - 20 + late)))
    assert "begin again at line 22" in told and data.experiment_names == ["1", "2"] and data.dt == 1
    np.testing.assert_array_equal(data.u[:, :, 0], U.reshape(2, 20))


def test_order_of_rows(file):
    data, told = read(file(rows(lambda k: f"{(39 - k) * DT:.2f}")))
    np.testing.assert_array_equal(data.u[0, ::-1, 0], U)
    assert "from the last to the first" in told
    order = RNG.permutation(40)
    data, told = read(file(rows(lambda k: f"{order[k] * DT:.2f}")))
    np.testing.assert_array_equal(data.u[0, order, 0], U)
    assert "sorted" in told


def test_times_of_day_pass_midnight(file):
    data, told = read(file(rows(lambda k: f"{(22 + k // 6) % 24:02d}:{k % 6 * 10:02d}:00")))
    same(data, 600)
    assert "pass midnight" in told


@pytest.mark.parametrize("dt", [0.05, 1 / 3, 1 / 30, 1e-3, 1 / 44100, 12.5])
@pytest.mark.parametrize("digits", ["%.17g", "%.9g", "%.7g", "%.6f"])
def test_rounded_times(dt, digits, file):
    steps = np.r_[0:10, 12:40]
    path = file(rows(lambda k: digits % (0.7 + steps[k] * dt), u=U[:38], y=Y[:38]))
    data, _ = read(path)
    assert data.dt == pytest.approx(dt, rel=1e-6) and data.steps == 40
    np.testing.assert_array_equal(data.u[0, steps, 0], U[:38])


# ---- experiments ----


def test_cycles_of_one_log(file):
    stamps = [*range(20), *range(100, 110), *range(5000, 5010)]
    path = file(rows(lambda k: f"{k // 20},{stamps[k]}", "cycle,time,u,y"))
    data, told = read(path, experiment_column="cycle")
    np.testing.assert_array_equal(data.u[0, :, 0][:20], U[:20])
    np.testing.assert_array_equal(data.u[1, :10, 0], U[20:30])
    assert "begin at its first row" in told and "gap" in told and "line 31 and line 32" in told
    refused(file(rows(lambda k: f"{k // 20},{k % 20}", "run,time,u,y")), "state experiment_column='run'")
    assert (
        "in several places"
        in read(file(rows(lambda k: f"{'abac'[k // 10]},{k}", "x,time,u,y")), experiment_column="x")[1]
    )


def test_many_files(file, tmp_path):
    for n, length in ((10, 20), (9, 15), (2, 18)):
        file(rows(lambda k: f"{k * DT:.2f}", u=U[:length]), f"runs/run{n}.csv")
    for source in (tmp_path / "runs", str(tmp_path / "runs" / "*.csv"), sorted((tmp_path / "runs").iterdir())):
        data, _ = read(source)
        assert data.experiment_names == ["run2", "run9", "run10"] and list(data.length) == [18, 15, 20]
        np.testing.assert_array_equal(data.u[2, :, 0], U[:20])
    file(rows(lambda k: f"{k * DT:.2f}", "time,u,y,y2", y=[f"{y},1" for y in Y]), "runs/run11.csv")
    refused(tmp_path / "runs", "run11.csv", "'y2'", "run2.csv")
    file(rows(lambda k: f"{k * DT:.2f}", "time,u [V],y"), "runs/run11.csv")
    refused(tmp_path / "runs", "run11.csv", "units differ")
    with pytest.raises(FileNotFoundError):
        read([tmp_path / "runs" / "run1.csv"])
    refused(tmp_path / "*.txt", "no file matches")


def test_a_folder_for_each_run(file, tmp_path):
    for run in ("run1", "run2"):
        (tmp_path / "all" / run).mkdir(parents=True)
        file(rows(lambda k: k), f"all/{run}/log.csv")
    assert read(tmp_path / "all")[0].experiment_names == ["run1", "run2"]
    file(rows(lambda k: k), "all/run2/log2.csv")
    refused(tmp_path / "all", "'run2' has 2 data files")


def test_an_odd_run_is_named():
    tables = {f"run{n}": pd.DataFrame({"time": np.arange(25.0), "u": 1.0, "y": 2.0}) for n in range(6)}
    tables["long"] = pd.DataFrame({"time": np.arange(2000.0), "u": 1.0, "y": 2.0})
    assert "experiment 'long' has 2000 steps" in read(tables)[1]


def test_held_channels_on_an_epoch(file):
    path = file(rows(lambda k: f"{1700000000 + k // 250}.{(123456789 + 4000000 * k) % 10**9:09d}"))
    plain, _ = read(path)
    held, told = read(path, resample=0.004, held="u")
    np.testing.assert_array_equal(held.u, plain.u)
    np.testing.assert_array_equal(held.y, plain.y)
    assert plain.dt == 0.004 and "changed nothing" in told


@pytest.mark.parametrize(
    "method, found", [("linear", [0, 1, 2, 3]), ("previous", [0, 0.5, 2, 2.5]), ("mean", [0, 1.0, 2.0, 3.0])]
)
def test_resampling(method, found):
    times = np.array([0, 0.5, 2, 2.5, 3.5])
    data, told = read(pd.DataFrame({"time": times, "u": times, "y": times}), resample=1.0, resample_method=method)
    np.testing.assert_allclose(data.u[0, :, 0][[0, 2]], np.array(found)[[0, 2]], atol=0.3)
    if method != "mean":
        np.testing.assert_allclose(data.u[0, :, 0], found, atol=1e-12)
    assert f"by the method {method}" in told


def test_gaps_of_resampling():
    times = np.r_[0:5, 20:25] * 1.0
    table = pd.DataFrame({"time": times, "u": times, "y": times})
    data, told = read(table, resample=1.0, held="u")
    assert np.isnan(data.y[0, 5:20, 0]).all() and (data.u[0, 5:20, 0] == 4).all() and "their gap is longer" in told
    assert np.isnan(read(table, resample=1.0, held="u", longest_gap=4)[0].u[0, 5:20, 0]).all()


def test_trigger(file):
    text = rows(lambda k: f"{k * DT:.2f},{int(k >= 12)}", "time,valve,u,y")
    data, _ = read(file(text), trigger="valve > 0.5", before=2)
    np.testing.assert_array_equal(data.u[0, :, 0], U[10:])
    refused(file(text), "holds at no row", trigger="valve > 5")


# ---- objects and logs ----


def test_objects_in_memory():
    xr = pytest.importorskip("xarray")
    raw = xr.Dataset({"u": ("time", U), "y": ("time", Y)}, {"time": np.arange(40) * DT})
    for source in (raw, raw.to_dataframe(), [raw], pd.DataFrame({"time": np.arange(40) * DT, "u": U, "y": Y})):
        same(read(source)[0])
    assert read({"a": raw, "b": raw.to_dataframe()})[0].experiment_names == ["a", "b"]
    refused(pd.DataFrame({"time": [0.0, 1.0], "u": ["x", "1"]}), "row 0, column 'u'", error=ValueError)
    refused([], "files or tables needed", error=ValueError)


def frame():
    return pd.DataFrame({"time": np.arange(40) * DT, "u": U, "y": Y})


def test_excel(tmp_path):
    pytest.importorskip("openpyxl")
    frame().to_excel(tmp_path / "a.xlsx", index=False)
    same(read(tmp_path / "a.xlsx")[0])


@pytest.mark.parametrize("kind", ["parquet", "feather"])
def test_columns_on_disk(kind, tmp_path):
    pytest.importorskip("pyarrow")
    getattr(frame(), f"to_{kind}")(tmp_path / f"a.{kind}")
    same(read(tmp_path / f"a.{kind}")[0])


def test_tdms(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    channels = [
        nptdms.ChannelObject("g", n, v, {"wf_increment": DT, "wf_start_offset": 0.0}) for n, v in (("u", U), ("y", Y))
    ]
    with nptdms.TdmsWriter(str(tmp_path / "a.tdms")) as writer:
        writer.write_segment(channels)
    same(read(tmp_path / "a.tdms")[0])


def test_mf4(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF() as log:
        log.append([asammdf.Signal(U, np.arange(40) * DT, name="u", unit="V")])
        log.append([asammdf.Signal(Y, np.arange(40) * DT, name="y")])
        log.save(tmp_path / "a.mf4")
    same(read(tmp_path / "a.mf4", inputs="u", outputs="y")[0])


def test_ulog(tmp_path):
    pyulog = pytest.importorskip("pyulog")

    def message(kind, content):
        return struct.pack("<HB", len(content), ord(kind)) + content

    parts = [
        b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0),
        message("B", bytes(40)),
        message("F", b"rates:uint64_t timestamp;double u;double y;"),
        message("A", struct.pack("<BH", 0, 0) + b"rates"),
        *(message("D", struct.pack("<HQdd", 0, 64300000 + 50000 * k, U[k], Y[k])) for k in range(40)),
    ]
    (tmp_path / "a.ulg").write_bytes(b"".join(parts))
    pyulog.ULog(str(tmp_path / "a.ulg")).write_ulog(str(tmp_path / "b.ulg"))  # as the package itself writes it
    for name in ("a.ulg", "b.ulg"):
        same(read(tmp_path / name, inputs="rates.u", outputs="rates.y")[0])


def test_mcap_with_two_clocks(tmp_path):
    writer = pytest.importorskip("mcap_ros2.writer")
    with open(tmp_path / "a.mcap", "wb") as stream, writer.Writer(stream) as log:
        schema = log.register_msgdef("std_msgs/msg/Float64", "float64 data")
        for k in range(40):
            for topic, value, late in (("/u", U[k], 0), ("/y", Y[k], 1_000_000)):
                time = 1_700_000_000 * 10**9 + k * 50_000_000 + late
                log.write_message(
                    topic=topic, schema=schema, message={"data": float(value)}, log_time=time, publish_time=time
                )
        log.finish()
    names = {"inputs": "u.data", "outputs": "y.data"}
    data, told = read(tmp_path / "a.mcap", **names, resample=DT, resample_method="previous")
    np.testing.assert_array_equal(data.u[0, :, 0], U)
    np.testing.assert_array_equal(data.y[0, 1:, 0], Y[:-1])
    assert "2 series" in told
    refused(tmp_path / "a.mcap", "'u.data', 'y.data'", inputs="x", outputs="z")


def test_absent_packages_are_named(tmp_path, monkeypatch):
    (tmp_path / "a.ulg").write_bytes(b"ULog")
    monkeypatch.setitem(sys.modules, "pyulog", None)
    refused(tmp_path / "a.ulg", "pip install tokid[logs]")
    (tmp_path / "a.npz").write_bytes(b"")
    refused(tmp_path / "a.npz", "Use tokid.load")


def test_the_command(file, tmp_path):
    def run(*words):
        return subprocess.run(
            [sys.executable, "-m", "tokid", "import", *map(str, words)], capture_output=True, text=True, check=False
        )

    path = file(rows(lambda k: f"{k * DT:.2f}", "time,a,y"))
    done = run(path, tmp_path / "out.npz", "--inputs", "a", "--outputs", "y", "--resample", "0.1")
    assert done.returncode == 0 and done.stderr.startswith("note: ") and tokid.load(tmp_path / "out.npz").dt == 0.1
    done = run(path, tmp_path / "out.npz", "--inputs", "a", "--outputs", "y", "--missing", U[3], "--missing", "weg")
    assert done.returncode == 0 and "missing='weg': no cell" in done.stderr
    assert np.isnan(tokid.load(tmp_path / "out.npz").u[0, 3, 0])
    for words in ([path, tmp_path / "o.npz", "--dt", "0,05"], [path, tmp_path / "o.xyz"], [path, path], [path],
                  [path, tmp_path / "o.npz"], [path, tmp_path / "o.npz", "--dt", "-0.5"]):
        done = run(*words)
        assert done.returncode == 2 and done.stderr.startswith("tokid import: error: ") and done.stderr.count("\n") == 1


def test_files_of_tokid_come_back_whole(tmp_path):
    """By the reader of the library, which checks the checksum."""
    rng = np.random.default_rng(1)
    data = tokid.Ensemble(rng.normal(size=(3, 5, 1)), rng.normal(size=(3, 5, 1)), dt=0.1, input_units=["V"],
                          output_names=[" edge "], experiment_names=["a", "two\nlines", " lead"], length=[5, 5, 5])
    data.save(tmp_path / "a.csv")
    back = tokid.read(tmp_path / "a.csv")
    assert back.fingerprint == data.fingerprint and back.input_units == ["V"] and back.output_names == [" edge "]
    assert back.experiment_names == data.experiment_names


@pytest.mark.parametrize("head, steps", [("u1,y1", 4), ("time,u1,y1", 3)])
def test_rows_without_content(tmp_path, head, steps):
    """Without times they are steps, and with times they state none."""
    timed = head.startswith("time")
    rows = ["0,1,2", "1,2,3", ",,", "2,3,4"] if timed else ["1,2", "2,3", ",", "3,4"]
    (tmp_path / "a.csv").write_text("\n".join([head, *rows, ""]))
    data = tokid.read(tmp_path / "a.csv")
    assert data.steps == steps and data.u[0, -1, 0] == 3 and data.missing == (0 if timed else 2)


def test_rounded_times_are_told(tmp_path):
    rows = "".join(f"{k / 30:.2f},{k},{k * k}\n" for k in range(12))
    (tmp_path / "a.csv").write_text("time,u1,y1\n" + rows)
    with pytest.warns(tokid.TokidWarning, match="the times are rounded to 0.01 s"):
        assert tokid.read(tmp_path / "a.csv").dt == pytest.approx(1 / 30, rel=1e-2)
    (tmp_path / "b.csv").write_text("time,u1,y1\n" + rows.replace("0.07", "0.08"))
    with pytest.raises(tokid.IoError, match="0.08"):
        tokid.read(tmp_path / "b.csv")


def test_the_header_is_the_nearest_line_of_names(tmp_path):
    (tmp_path / "a.csv").write_text("rig,user,unit\nt_ms,u,y\n" + "".join(f"{10 * k},{k % 3},{k}\n" for k in range(9)))
    data = tokid.read(tmp_path / "a.csv")
    assert (data.input_names, data.output_names, data.dt) == (["u"], ["y"], 0.01)


def test_groups_with_channels_of_one_name(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    times = {"wf_increment": 0.1, "wf_start_offset": 0.0}
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as file:
        for group, channel in (("a", "u"), ("a", "y"), ("b", "u")):
            start = np.datetime64("2026-11-27T13:12:05") + np.timedelta64(200 if group == "b" else 0, "ms")
            own = {**times, "wf_start_time": start, "wf_samples": 8}
            file.write_segment([nptdms.ChannelObject(group, channel, np.arange(8.0) + 10 * (group == "b"), own)])
    data = tokid.read(tmp_path / "a.tdms", inputs=["a.u", "b.u"], outputs=["a.y"])
    np.testing.assert_array_equal(data.u[0, 2:8, 0], np.arange(2.0, 8.0))
    np.testing.assert_array_equal(data.u[0, 2:8, 1], np.arange(10.0, 16.0))  # group b begins 0.2 s later


def test_the_mean_is_that_of_each_interval(tmp_path):
    table = pd.DataFrame({"time": np.arange(40) * 0.1, "u1": np.r_[1e17, np.ones(39)], "y1": 101325.1})
    data = tokid.read(table, resample=1.0, resample_method="mean")
    np.testing.assert_array_equal(data.u[0, 1:, 0], 1.0)
    np.testing.assert_allclose(data.y[0, :, 0], 101325.1, rtol=4e-16)


def test_files_of_tokid_may_need_outputs(tmp_path):
    tokid.Ensemble(np.ones((2, 5, 1)), dt=0.1).save(tmp_path / "a.csv")
    assert tokid.read(tmp_path / "a.csv").outputs == 0
    with pytest.raises(tokid.IoError, match="begins with y"):
        tokid.read(tmp_path / "a.csv", outputs_required=True)
