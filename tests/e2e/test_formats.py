# SPDX-License-Identifier: BSD-3-Clause
"""NumPy, h5py, SciPy and pandas read what the tool writes, and the tool reads what they write."""

import csv
import ctypes
import zlib

import h5py
import numpy as np
import pytest
import scipy.io

N, T, R, M = 4, 6, 2, 3
INPUT_NAMES, OUTPUT_NAMES = ["force", "voltage, \"filtered\""], ["x", "ϑ", "two\nlines"]


def ensemble(seed=1):
    rng = np.random.default_rng(seed)
    return {"u": rng.standard_normal((N, T, R)), "y": rng.standard_normal((N, T, M)), "dt": 0.05}


def full_ensemble():
    """Every optional field; what `length` cuts off is missing."""
    rng = np.random.default_rng(2)
    arrays = ensemble() | {
        "length": np.array([6, 3, 5, 0]), "free_y": rng.standard_normal((2, 5, M)), "initial_state": "unknown",
        "input_names": np.array(INPUT_NAMES), "output_names": np.array(OUTPUT_NAMES),
        "input_units": np.array(["N", "V"]), "output_units": np.array(["m", "", "°/s²"])}
    arrays["y"][0, 2, 1] = np.nan
    for n, length in enumerate(arrays["length"]):
        arrays["u"][n, length:] = np.nan
        arrays["y"][n, length:] = np.nan
    return arrays


def assert_same(found, expected):
    """The same names, shapes and values; numbers as doubles or 64-bit integers."""
    assert set(found) == set(expected)
    for name, value in expected.items():
        value = np.asarray(value)
        assert found[name].shape == value.shape, name
        if value.dtype.kind == "U":
            assert found[name].tolist() == value.tolist(), name
        else:
            assert found[name].dtype == (np.int64 if value.dtype.kind == "i" else np.float64), name
            np.testing.assert_array_equal(found[name], value, err_msg=name)


def read_h5(path):
    with h5py.File(path) as file:
        assert not file.attrs
        return {name: np.asarray(data.asstr()[()] if data.dtype.kind == "S" else data[()])
                for name, data in file.items()}


def read_mat(path):
    return {name: value for name, value in scipy.io.loadmat(path).items() if not name.startswith("__")}


def matlab_73_value(file, data):
    """As MATLAB shows it: dimensions reversed, cell arrays of texts as lists."""
    kind = data.attrs["MATLAB_class"].decode()
    if "MATLAB_empty" in data.attrs:
        return "" if kind == "char" else np.empty(data[()].astype(int))
    if kind == "char":
        assert data.dtype == np.uint16 and data.attrs["MATLAB_int_decode"] == 2
        return data[()].tobytes().decode("utf-16-le")
    if kind == "cell":
        return [matlab_73_value(file, file[reference]) for reference in data[()].ravel()]
    assert kind == "double" and data.dtype == np.float64
    return data[()].T


def read_mat_73(path):
    with open(path, "rb") as file:
        header = file.read(128)
    assert header.startswith(b"MATLAB 7.3 MAT-file") and header[124:] == b"\x00\x02IM"
    with h5py.File(path) as file:
        assert file.userblock_size == 512
        return {name: matlab_73_value(file, data) for name, data in file.items() if name != "#refs#"}


@pytest.fixture
def through(tokid, tmp_path):
    """Writes arrays with np.savez and converts them to a file of the given name."""
    def convert(arrays, name, *options):
        np.savez(tmp_path / "original.npz", **arrays)
        tokid("convert", tmp_path / "original.npz", tmp_path / name, *options)
        return tmp_path / name

    return convert


def check_read(tokid, tmp_path, path, expected=None):
    tokid("convert", path, tmp_path / "read.npz")
    with np.load(tmp_path / "read.npz", allow_pickle=False) as file:
        assert_same(dict(file), expected or ensemble())


# What the tool writes

def test_npz_for_numpy(through):
    with np.load(through(full_ensemble(), "out.npz"), allow_pickle=False) as file:
        assert_same(dict(file), full_ensemble())


@pytest.mark.parametrize("extension", ["h5", "hdf5"])
def test_hdf5_for_h5py(through, extension):
    assert_same(read_h5(through(full_ensemble(), f"out.{extension}")), full_ensemble())


def check_matlab(found, cells):
    """Everything has two dimensions at least, numbers are doubles, lists are columns."""
    expected = full_ensemble()
    assert set(found) == {*expected, "experiments"}
    for name in ("u", "y", "free_y"):
        np.testing.assert_array_equal(found[name], expected[name])
    for name in ("dt", "length"):
        np.testing.assert_array_equal(found[name], np.asarray(expected[name], float).reshape(-1, 1))
    assert found["experiments"] == [[N]]
    for name in ("input_names", "output_names", "input_units", "output_units"):
        assert cells(found[name]) == expected[name].tolist()


def test_mat_for_scipy(through):
    found = read_mat(through(full_ensemble(), "out.mat"))
    assert found["initial_state"] == ["unknown"]
    check_matlab(found, lambda cells: ["".join(cell) for cell in cells[:, 0]])


def test_mat_73_for_h5py(through):
    found = read_mat_73(through(full_ensemble(), "out.mat", "--mat73"))
    assert found["initial_state"] == "unknown"
    check_matlab(found, list)


def test_csv_for_python(through):
    expected = full_ensemble()
    del expected["free_y"]
    with open(through(expected, "out.csv"), newline="", encoding="utf-8") as file:
        comments = 0
        while file.readline().startswith("#"):
            comments += 1
        file.seek(0)
        for _ in range(comments):
            file.readline()
        header, *rows = csv.reader(file)
    assert header == ["experiment", "time", *INPUT_NAMES, *OUTPUT_NAMES]
    samples = np.full((N, T, R + M), np.nan)
    for row in rows:
        step = round(float(row[1]) / expected["dt"])
        samples[int(row[0]), step] = [float(cell) if cell else np.nan for cell in row[2:]]
    np.testing.assert_array_equal(samples, np.concatenate([expected["u"], expected["y"]], axis=2))


def test_csv_for_pandas(through):
    pandas = pytest.importorskip("pandas")
    table = pandas.read_csv(through(ensemble(), "out.csv"), comment="#", float_precision="round_trip")
    assert list(table.columns) == ["experiment", "time", "u1", "u2", "y1", "y2", "y3"]
    np.testing.assert_array_equal(table[["u1", "u2"]].to_numpy().reshape(N, T, R), ensemble()["u"])


@pytest.mark.parametrize("name,options", [("out.h5", []), ("out.mat", []), ("out.mat", ["--mat73"]), ("out.npz", [])])
def test_back_again(tokid, tmp_path, through, name, options):
    check_read(tokid, tmp_path, through(full_ensemble(), name, *options), full_ensemble())


def test_back_again_from_csv(tokid, tmp_path, through):
    expected = full_ensemble()
    del expected["free_y"]
    check_read(tokid, tmp_path, through(expected, "out.csv"), expected)


# Models

def model_arrays(directory):
    with np.load(directory / "model.npz", allow_pickle=False) as file:
        return dict(file)


def test_model_arrays(oscillator):
    model = model_arrays(oscillator)
    steps, n, _ = model["A"].shape
    r, m = model["B"].shape[2], model["C"].shape[1]
    shapes = {"A": (steps, n, n), "B": (steps, n, r), "C": (steps, m, n), "D": (steps, m, r), "G": (steps, n, m),
              "innovation_cov": (steps, m, m), "state_dim": (steps + 1,), "condition": (steps,), "rank": (steps,),
              "lags": (steps,)}
    shapes |= dict.fromkeys(["k_begin", "dt", "frame", "method", "initial_state", "options", "version"], ())
    for name, shape in shapes.items():
        assert model[name].shape == shape, name
    assert model["singular_values"].shape[0] == steps and model["singular_values"].ndim == 2
    for name in ("state_dim", "rank", "lags", "k_begin"):
        assert model[name].dtype == np.int64
    assert model["frame"] == "raw" and model["method"] == "tvera" and model["initial_state"] == "zero"
    for s in range(steps):
        rows, columns = model["state_dim"][s + 1], model["state_dim"][s]
        assert not model["A"][s, rows:].any() and not model["A"][s, :, columns:].any()


def test_model_in_hdf5(tokid, tmp_path, oscillator):
    tokid("convert", oscillator / "model.npz", tmp_path / "model.h5")
    assert_same(read_h5(tmp_path / "model.h5"), model_arrays(oscillator))


STACKS = ("A", "B", "C", "D", "G", "innovation_cov")
TEXTS = ("frame", "method", "initial_state", "options", "version")


@pytest.mark.parametrize("options,read", [([], read_mat), (["--mat73"], read_mat_73)])
def test_model_in_mat(tokid, tmp_path, oscillator, options, read):
    tokid("convert", oscillator / "model.npz", tmp_path / "model.mat", *options)
    found, expected = read(tmp_path / "model.mat"), model_arrays(oscillator)
    assert set(found) == set(expected)
    for name, value in expected.items():
        if name in TEXTS:
            assert "".join(found[name]) == str(value)
        elif name in STACKS:  # the step is the last index
            np.testing.assert_array_equal(found[name], np.moveaxis(value, 0, 2), err_msg=name)
        else:
            np.testing.assert_array_equal(found[name], value.reshape(value.shape[0] if value.ndim else 1, -1))
    check_read(tokid, tmp_path, tmp_path / "model.mat", expected)


# What others write

def test_compressed_npz(tokid, tmp_path):
    np.savez_compressed(tmp_path / "in.npz", **full_ensemble())
    check_read(tokid, tmp_path, tmp_path / "in.npz", full_ensemble())


@pytest.mark.parametrize("dtype", ["<f4", ">f8", ">f4", "i1", "u1", "<i2", ">i4", "i8", "u8", "?"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npz_types(tokid, tmp_path, dtype, order):
    expected = ensemble()
    for name in "uy":
        expected[name] = np.asarray(np.abs(expected[name] * 50).round() % 2, dtype, order=order)
    np.savez(tmp_path / "in.npz", **expected)
    check_read(tokid, tmp_path, tmp_path / "in.npz", expected | {n: expected[n].astype(float) for n in "uy"})


def test_npz_bytes_and_what_does_not_belong(tokid, tmp_path):
    others = {"date": np.array(["2024-01-01"], "datetime64[D]"), "weather": np.array([{"rain": True}], dtype=object)}
    np.savez(tmp_path / "in.npz", **ensemble(), **others, input_names=np.array([b"a", b"bc"]), initial_state=b"zero")
    check_read(tokid, tmp_path, tmp_path / "in.npz",
               ensemble() | {"input_names": np.array(["a", "bc"]), "initial_state": "zero"})


def test_hdf5_attributes_and_filters(tokid, tmp_path):
    expected = full_ensemble()
    with h5py.File(tmp_path / "in.h5", "w") as file:
        for name in ("u", "y", "free_y"):
            file.create_dataset(name, data=expected[name], chunks=True, compression="gzip", shuffle=True)
        file.attrs["dt"] = expected["dt"]
        file.attrs["length"] = expected["length"].astype("i2")
        file.attrs["initial_state"] = "unknown"  # of variable length
        file.attrs["input_names"] = INPUT_NAMES
        file["output_names"] = OUTPUT_NAMES
        units = np.array([b"N", b"V"])  # of fixed length
        file.create_dataset("input_units", data=units, chunks=(1,), compression="gzip")
        file["output_units"] = np.array([text.encode() for text in ["m", "", "°/s²"]], h5py.string_dtype("utf-8", 8))
        file.create_group("notes").attrs["by"] = "somebody"
    check_read(tokid, tmp_path, tmp_path / "in.h5", expected)


@pytest.mark.parametrize("filters", [{"compression": "gzip"}, {"shuffle": True}, {"fletcher32": True},
                                     {"compression": "gzip", "shuffle": True, "fletcher32": True}],
                         ids=["gzip", "shuffle", "fletcher32", "all"])
@pytest.mark.parametrize("version", ["earliest", "latest"])
def test_hdf5_chunks(tokid, tmp_path, filters, version):
    """As h5py reads them: whole, cut at the edges and larger than the data set."""
    rng = np.random.default_rng(3)
    shape = (13, 41, 3)
    for chunks, dtype in (((1, 4, 1), "f8"), ((3, 7, 2), ">f4"), ((5, 41, 1), "i1"), ((13, 41, 3), "f8"),
                          ((16, 64, 4), "f2")):
        with h5py.File(tmp_path / "in.h5", "w", libver=version) as file:
            u = file.create_dataset("u", shape, dtype, maxshape=(None,) * 3, chunks=chunks, **filters)
            u[...] = rng.integers(-100, 100, shape)
            y = file.create_dataset("y", shape, dtype, maxshape=(None,) * 3, chunks=chunks, fillvalue=7, **filters)
            for n in range(0, 13, chunks[0]):  # one value of each chunk, the others are 7
                for k in range(0, 41, chunks[1]):
                    for j in range(0, 3, chunks[2]):
                        y[n, k, j] = u[n, k, j]
            file["dt"] = 0.5
            expected = {"u": u[()].astype(float), "y": y[()].astype(float), "dt": 0.5}
        check_read(tokid, tmp_path, tmp_path / "in.h5", expected)


def hdf5_library():
    """The one that h5py calls, for what it has no name for."""
    with open("/proc/self/maps") as maps:
        return ctypes.CDLL(next(line.split()[-1] for line in maps if "/libhdf5" in line and "_hl" not in line))


def test_hdf5_chunks_without_some_filters(tokid, tmp_path):
    """Of a chunk that a filter can't make smaller, and of those at the edge if the writer wants so."""
    rng = np.random.default_rng(4)
    values = rng.standard_normal((5, 6, 1))
    with h5py.File(tmp_path / "in.h5", "w", libver="latest") as file:
        u = file.create_dataset("u", values.shape, "f8", chunks=(1, 6, 1), shuffle=True, compression="gzip",
                                fletcher32=True)
        u[...] = values
        order = [u.id.get_create_plist().get_filter(i)[0] for i in range(3)]
        without = {name: 1 << order.index(getattr(h5py.h5z, f"FILTER_{name}"))
                   for name in ("SHUFFLE", "DEFLATE", "FLETCHER32")}
        shuffled = values[1].reshape(-1).view("u1").reshape(6, 8).T.tobytes()
        u.id.write_direct_chunk((0, 0, 0), values[0].tobytes(), filter_mask=7)
        u.id.write_direct_chunk((1, 0, 0), shuffled, filter_mask=without["DEFLATE"] | without["FLETCHER32"])
        shuffled = values[2].reshape(-1).view("u1").reshape(6, 8).T.tobytes()
        u.id.write_direct_chunk((2, 0, 0), zlib.compress(shuffled), filter_mask=without["FLETCHER32"])
        creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        creation.set_chunk((2, 4, 1))
        creation.set_deflate(4)
        dont_filter_partial_chunks = 2
        assert hdf5_library().H5Pset_chunk_opts(ctypes.c_int64(creation.id), dont_filter_partial_chunks) >= 0
        y = h5py.h5d.create(file.id, b"y", h5py.h5t.IEEE_F64LE, h5py.h5s.create_simple(values.shape), creation)
        y.write(h5py.h5s.ALL, h5py.h5s.ALL, values)
        file["dt"] = 0.5
    check_read(tokid, tmp_path, tmp_path / "in.h5", {"u": values, "y": values, "dt": 0.5})


@pytest.mark.parametrize("dtype", ["<f4", ">f8", "<f2", "i1", "u8", "?"])
def test_hdf5_types(tokid, tmp_path, dtype):
    expected = ensemble()
    with h5py.File(tmp_path / "in.h5", "w") as file:
        for name in "uy":
            file[name] = np.asarray(np.abs(expected[name] * 50).round() % 2, dtype)
            expected[name] = file[name][()].astype(float)
        file["dt"] = 0.05
    check_read(tokid, tmp_path, tmp_path / "in.h5", expected)


@pytest.mark.parametrize("compress", [False, True])
def test_mat_of_scipy(tokid, tmp_path, compress):
    expected = full_ensemble()
    cells = {name: np.array(expected[name].tolist(), dtype=object) for name in ("output_names", "output_units")}
    lists = {name: np.array(["ab", "c"]) for name in ("input_names", "input_units")}  # rows of characters
    scipy.io.savemat(tmp_path / "in.mat", expected | cells | lists, do_compression=compress)
    check_read(tokid, tmp_path, tmp_path / "in.mat", expected | lists)


def test_mat_types(tokid, tmp_path):
    expected = ensemble()
    found = {"u": np.abs(expected["u"] * 50).astype("u1"), "y": expected["y"].astype("f4"), "dt": 0.05}
    scipy.io.savemat(tmp_path / "in.mat", found | {"notes": {"by": "somebody"}})
    check_read(tokid, tmp_path, tmp_path / "in.mat", {n: np.asarray(v, float) for n, v in found.items()})


def test_mat_drops_trailing_ones(tokid, tmp_path):
    expected = ensemble() | {"u": ensemble()["u"][:, :, :1]}
    scipy.io.savemat(tmp_path / "in.mat", expected | {"u": expected["u"][:, :, 0]})
    check_read(tokid, tmp_path, tmp_path / "in.mat", expected)
    siso = {name: ensemble()[name][:, :, :1] for name in "uy"}
    scipy.io.savemat(tmp_path / "siso.mat", {name: x[:, :, 0] for name, x in siso.items()} | {"experiments": N})
    check_read(tokid, tmp_path, tmp_path / "siso.mat", siso)


def write_matlab_73(path, arrays, texts, userblock=512):
    """What save -v7.3 writes, less its header."""
    with h5py.File(path, "w", userblock_size=userblock) as file:
        for name, value in arrays.items():
            data = file.create_dataset(name, data=np.atleast_2d(value).T, chunks=True, compression="gzip")
            data.attrs["MATLAB_class"] = np.bytes_("double")
        for name, items in texts.items():
            references = np.empty((1, len(items)), h5py.ref_dtype)
            for i, text in enumerate(items):
                data = file.create_dataset(f"#refs#/{name}{i}",
                                           data=np.frombuffer(text.encode("utf-16-le"), "<u2").reshape(-1, 1))
                data.attrs["MATLAB_class"] = np.bytes_("char")
                references[0, i] = data.ref
            data = file.create_dataset(name, data=references, chunks=(1, 2), compression="gzip", shuffle=True)
            data.attrs["MATLAB_class"] = np.bytes_("cell")
        empty = file.create_dataset("nothing", data=np.array([0, 0], "u8"))
        empty.attrs["MATLAB_class"], empty.attrs["MATLAB_empty"] = np.bytes_("double"), np.uint8(1)


@pytest.mark.parametrize("name,userblock", [("in.mat", 512), ("in.h5", 512), ("in.h5", 0)])
def test_matlab_73_is_known_by_its_attributes(tokid, tmp_path, name, userblock):
    expected = ensemble() | {"output_names": np.array(OUTPUT_NAMES)}
    write_matlab_73(tmp_path / name, ensemble(), {"output_names": OUTPUT_NAMES}, userblock)
    check_read(tokid, tmp_path, tmp_path / name, expected)


def test_hdf5_is_not_transposed_by_its_looks(tokid, tmp_path):
    expected = {"u": np.arange(60.0).reshape(2, 3, 10), "y": np.arange(120.0).reshape(2, 3, 20)}
    with h5py.File(tmp_path / "in.h5", "w") as file:
        file["u"], file["y"] = expected["u"], expected["y"]
    check_read(tokid, tmp_path, tmp_path / "in.h5", expected)


def test_csv_of_pandas(tokid, tmp_path):
    pandas = pytest.importorskip("pandas")
    expected = ensemble()
    expected["y"][1, 2, 0] = np.nan
    index = pandas.MultiIndex.from_product([["first", "second", "third", "fourth"], np.arange(T) * 0.05],
                                           names=["experiment", "time"])
    samples = np.concatenate([expected["u"], expected["y"]], axis=2).reshape(N * T, R + M)
    table = pandas.DataFrame(samples, index, ["u1", "u2", "y1", "y2", "y3"])
    table.reset_index().to_csv(tmp_path / "in.csv")  # with a nameless column of row numbers
    check_read(tokid, tmp_path, tmp_path / "in.csv", expected)


def test_csv_with_capitals(tokid, tmp_path):
    header, rows = "experiment,time,u1,y1\n", "a,0,1,2\na,0.5,1,2\nb,0,1,2\nb,0.5,1,2\n"
    shown = []
    for text in header, "Experiment,TIME,u1,y1\n":
        (tmp_path / "data.csv").write_text(text + rows)
        shown.append(tokid.json("info", tmp_path / "data.csv"))
    assert shown[0] == shown[1] and (shown[0]["experiments"], shown[0]["dt"]) == (2, 0.5)
    (tmp_path / "data.csv").write_text("k,K,u1,y1\n0,20,1,2\n1,20,1,2\n")  # a gain, or a temperature
    assert tokid.json("info", tmp_path / "data.csv")["steps"] == 2


def test_csv_of_step_numbers(tokid, tmp_path):
    expected = {name: values for name, values in ensemble().items() if name != "dt"}  # step numbers state none
    rows = [[k + 1, n, *expected["u"][n, k], *expected["y"][n, k]] for n in range(N) for k in range(T)]
    with open(tmp_path / "in.csv", "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([["k", "experiment", "u1", "u2", "y1", "y2", "y3"], *rows])
    check_read(tokid, tmp_path, tmp_path / "in.csv", expected)


# Sizes that files only claim

def test_claims_that_no_file_could_keep(tokid, tmp_path):
    with h5py.File(tmp_path / "in.h5", "w") as file:
        file.create_dataset("u", (10**6, 10**6, 1), chunks=(1, 1000, 1), compression="gzip")
        file["y"] = np.ones((N, T, 1))
    message = tokid("info", tmp_path / "in.h5", status=2).stderr
    assert "'u'" in message and "1000000, 1000000, 1" in message
