# SPDX-License-Identifier: BSD-3-Clause
"""Files made to do harm: sizes that are claimed and not there, archives that unpack to far more than themselves, links to
other files, texts that a terminal or a spreadsheet program would obey. Each is refused with status 2, at once, and with
little memory, or is taken for what it is: data."""

import io
import json
import os
import re
import resource
import signal
import struct
import subprocess
import time
import zlib

import h5py
import numpy as np
import pytest
import scipy.io

from conftest import ROOT

GIGABYTE = 1 << 30


@pytest.fixture
def refused(tokid, tmp_path):
    """Runs the tool with little memory and few seconds on a file that it must refuse, and returns its message. `memory`
    [bytes] is for those that must be refused because of it. `own` are words of a check of tokid that HDF5 1.10 needs; later
    releases of the library refuse some of these files themselves."""
    sanitized = "TOKID_SANITIZED" in os.environ  # takes more address space than any limit allows

    def call(name, *words, own=(), arguments=("info",), memory=None):
        if sanitized and memory:
            pytest.skip("no limits of memory under sanitizers")

        def little():
            resource.setrlimit(resource.RLIMIT_AS, (memory or GIGABYTE,) * 2)
            resource.setrlimit(resource.RLIMIT_CPU, (5, 5))

        result = tokid(*arguments, tmp_path / name, status=2, preexec_fn=None if sanitized else little, cwd=tmp_path)
        assert len(result.stderr.splitlines()) == 1 and len(result.stderr) < 5000
        for word in (name, *words, *(own if ": HDF5: " not in result.stderr else ())):
            assert word in result.stderr, f"{word!r} is not in {result.stderr!r}"
        return result.stderr

    return call


def npy(shape, descr="<f8", payload=b"", order=False):
    header = f"{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}".encode()
    return b"\x93NUMPY\x02\x00" + struct.pack("<I", len(header)) + header + payload


def zipped(path, name, packed, size, method=8):
    """An archive of one entry, as it is: nobody looks whether it unpacks to `size` bytes."""
    entry = name.encode()
    fields = struct.pack("<HHHHHIII", 20, 0, method, 0, 33, 0, len(packed), size)
    local = b"PK\x03\x04" + fields + struct.pack("<HH", len(entry), 0) + entry + packed
    central = b"PK\x01\x02" + struct.pack("<H", 20) + fields + struct.pack("<HHHHHII", len(entry), 0, 0, 0, 0, 0, 0) + entry
    path.write_bytes(local + central + b"PK\x05\x06" + struct.pack("<HHHHIIH", 0, 0, 1, 1, len(central), len(local), 0))


def deflated(begin, zeros, window=-15):
    """A stream of `begin` and then so many times a megabyte of zeros, without unpacking it once."""
    stream = zlib.compressobj(9, zlib.DEFLATED, window)
    first = stream.compress(begin) + stream.flush(zlib.Z_FULL_FLUSH)
    one = stream.compress(bytes(1 << 20)) + stream.flush(zlib.Z_FULL_FLUSH)
    return first + zeros * one + stream.flush()


def mat5_header():
    return b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"


def mat5_variable(name, shape, payload):
    """A matrix of doubles of that shape, whatever there is of it, and the size of the whole if it were there."""
    def element(kind, content, size=None):
        return struct.pack("<II", kind, len(content) if size is None else size) + content + bytes(-len(content) % 8)

    size = min(8 * int(np.prod(shape, dtype=object)), 2**32 - 1)
    inside = (element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack(f"<{len(shape)}i", *shape)) +
              element(1, name.encode()) + element(9, payload, size))
    return inside


# Sizes that are claimed

def test_a_header_of_an_array_that_is_not_there(refused, tmp_path):
    content = npy((10**7, 10**8), payload=bytes(800))
    zipped(tmp_path / "data.npz", "u.npy", content, len(content), method=0)
    refused("data.npz", "'u'", "(10000000, 100000000)", "800 bytes found", "8000000000000000 needed")


def test_an_archive_that_claims_what_its_array_claims(refused, tmp_path):
    content = npy((5000, 100000))
    zipped(tmp_path / "data.npz", "u.npy", deflated(content, 1), len(content) + 8 * 5000 * 100000)
    refused("data.npz", "'u'", "(5000, 100000)", "4000000000 bytes", "consistent size")


def test_dimensions_without_end(refused, tmp_path):
    # An array of one number, turned axis by axis.
    content = npy("(" + "1," * 20000 + ")", payload=bytes(8), order=True)
    zipped(tmp_path / "data.npz", "u.npy", content, len(content), method=0)
    refused("data.npz", "'u'", "20000 dimensions")


@pytest.mark.parametrize("options", [{"chunks": (1, 1000, 1), "compression": "gzip"}, {"chunks": (1, 1000, 1)},
                                     {"fillvalue": 1.5}, {"chunks": (1, 1000, 1), "fillvalue": 1.5}])
def test_a_data_set_without_values(refused, tmp_path, options):
    with h5py.File(tmp_path / "data.h5", "w") as file:
        u = file.create_dataset("u", (10**8, 10**7, 1), "f8", **options)
        if "chunks" in options:
            u[0, :1000, 0] = 1.0
        file["y"] = np.ones((3, 4, 1))
    refused("data.h5", "'u'", "(100000000, 10000000, 1)")
    refused("data.h5", "'u'", arguments=("identify", "-o", "model.h5", "--block", "100"))


@pytest.mark.parametrize("options", [{}, {"chunks": (3, 400, 1), "shuffle": True}])
def test_inputs_that_were_never_written_are_zeros(tokid, tmp_path, options):
    """As they are to all others who read them."""
    with h5py.File(tmp_path / "data.h5", "w") as file:
        u = file.create_dataset("u", (3, 400, 1), "f8", **options)
        if "chunks" in options:
            u[0, :10, 0] = 1.5
        file["y"] = np.ones((3, 400, 1))
        expected = u[()]
    tokid("convert", tmp_path / "data.h5", tmp_path / "out.npz")
    with np.load(tmp_path / "out.npz") as file:
        np.testing.assert_array_equal(file["u"], expected)


@pytest.mark.parametrize("packed", [False, True])
def test_a_variable_that_is_not_there(refused, tmp_path, packed):
    inside = mat5_variable("u", (10**7, 10**8), bytes(8000))
    element = struct.pack("<II", 14, len(inside)) + inside
    if packed:
        content = zlib.compress(element)
        element = struct.pack("<II", 15, len(content)) + content
    (tmp_path / "data.mat").write_bytes(mat5_header() + element)
    refused("data.mat", "'u'", "(10000000, 100000000)")


@pytest.mark.parametrize("rows", ["0,0,1,2\n0,1000000000000000,1,2\n", "0,0,1,2\n0,1e15,1,2\n", "0,0,1,2\n0,1e300,1,2\n"])
@pytest.mark.parametrize("column", ["k", "time"])
def test_steps_without_end(refused, tmp_path, column, rows):
    comment = "# dt = 1\n" if column == "time" else ""
    (tmp_path / "data.csv").write_text(f"{comment}experiment,{column},u1,y1\n{rows}")
    refused("data.csv", "most rows would be missing")


def test_many_columns_and_a_late_step(refused, tmp_path):
    names = ",".join(f"u{c}" for c in range(30000))
    cells = ",".join(["1"] * 30000)
    (tmp_path / "data.csv").write_text(f"k,y,{names}\n0,1,{cells}\n900000,1,{cells}\n")
    refused("data.csv", "900001 steps", "most rows would be missing")


# Archives that unpack to far more than themselves, at the rate that DEFLATE can reach

def test_bomb_in_npz(refused, tmp_path):
    shape = (1 << 10, 1 << 17, 2)  # 2 GiB
    zipped(tmp_path / "data.npz", "u.npy", deflated(npy(shape), 2048), len(npy(shape)) + 2 * GIGABYTE)
    assert (tmp_path / "data.npz").stat().st_size < 3 << 20
    refused("data.npz", "'u'", "(1024, 131072, 2)", "2147483648 bytes of memory", f"the {GIGABYTE} of this machine",
            memory=GIGABYTE)


def test_bomb_of_several_arrays(refused, tmp_path):
    # Any two of them would fit.
    zeros = zlib.compress(bytes(1 << 23), 9)
    with h5py.File(tmp_path / "data.h5", "w") as file:
        for name in ("free_y", "u", "y"):
            data = file.create_dataset(name, (26, 1 << 20, 1), "f8", chunks=(1, 1 << 20, 1), compression="gzip")
            for n in range(26):
                data.id.write_direct_chunk((n, 0, 0), zeros)
    refused("data.h5", "'y'", "(26, 1048576, 1)", "bytes of memory", memory=600 << 20)


def test_bomb_in_mat(refused, tmp_path):
    inside = mat5_variable("u", (1 << 14, 1 << 14), b"")
    packed = deflated(struct.pack("<II", 14, len(inside) + 2 * GIGABYTE) + inside, 2048, window=15)
    (tmp_path / "data.mat").write_bytes(mat5_header() + struct.pack("<II", 15, len(packed)) + packed)
    refused("data.mat", "variable 1", "bytes of memory", memory=GIGABYTE)


def test_many_texts_that_are_one(refused, tmp_path):
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file["u"] = file["y"] = np.ones((3, 4, 1))
        texts = file.create_dataset("input_names", (5000,), h5py.string_dtype())
        texts[:] = "x"
        texts[0] = "x" * (1 << 20)
        place, size = texts.id.get_offset(), 16
    with open(tmp_path / "data.h5", "r+b") as file:
        file.seek(place)
        first = file.read(size)
        file.seek(place)
        file.write(5000 * first)
    refused("data.h5", "'input_names'", "HDF5", memory=GIGABYTE)


def test_chunks_without_end(refused, tmp_path):
    """The library keeps a kilobyte of each, also of those that were never written."""
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file.create_dataset("u", (1000, 10000, 1), chunks=(1, 1, 1))
        file["y"] = np.ones((1000, 10000, 1), "i1")
    refused("data.h5", "'u'", "10000000 needed")


def test_options_that_are_deep(tokid, refused, tmp_path, oscillator):
    with np.load(oscillator / "model.npz") as file:
        values = {name: file[name] for name in file.files}
    for options, words in (('{"states":' + "[" * 300000 + "]" * 300000 + "}", "300001 levels of brackets"),
                           ("{" + ",".join(f'"{n}":1' for n in range(50000)) + "}", "50000 keys")):
        np.savez(tmp_path / "model.npz", **{**values, "options": options})
        refused("model.npz", "'options'", words)


@pytest.mark.parametrize("note", ["{" + ",".join(f'"{n}":1' for n in range(200000)) + "}", "[" * 10**6 + "]" * 10**6],
                         ids=["keys", "depth"])
@pytest.mark.parametrize("name", ["dt", "length", "input_names", "initial_state"])
def test_notes_that_are_deep(refused, tmp_path, name, note):
    """Of objects and of nested lists, which no note holds; the message quotes the beginning."""
    (tmp_path / "data.csv").write_text(f"# {name} = {note}\nexperiment,k,u1,y1\n0,0,1,2\n")
    assert len(refused("data.csv", name, note[:50])) < 250 + 2 * len(str(tmp_path))  # which is named twice


def test_notes_that_are_said_often(refused, tmp_path):
    notes = "# length = [1," + 10**6 * " " + "1]\n" + 20000 * "# length = [1, 1]\n"
    (tmp_path / "data.csv").write_text(notes + "experiment,k,u1,y1\n0,0,1,2\n1,0,one,2\n")
    refused("data.csv", "line 20004", "'one'")


# Paths

def test_links_are_not_followed_out_of_the_file(refused, tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["u"] = file["y"] = np.ones((3, 4, 1))
    np.ones((3, 4, 1)).tofile(tmp_path / "raw.bin")

    def link(file):
        file["u"] = h5py.ExternalLink("other.h5", "/u")

    def link_behind_a_link(file):
        file["group"] = h5py.ExternalLink("other.h5", "/")
        file["u"] = h5py.SoftLink("/group/u")

    def raw(file):
        file.create_dataset("u", (3, 4, 1), "f8", external=[(str(tmp_path / "raw.bin"), 0, 96)])

    def virtual(file):
        layout = h5py.VirtualLayout((3, 4, 1), "f8")
        layout[:] = h5py.VirtualSource("other.h5", "u", (3, 4, 1))
        file.create_virtual_dataset("u", layout)

    for lead_away, words in ((link, "another file"), (link_behind_a_link, ""), (raw, "other files"),
                             (virtual, "other files")):
        with h5py.File(tmp_path / "data.h5", "w") as file:
            lead_away(file)
            file["y"] = np.ones((3, 4, 1))
            assert file["u"][()].sum() == 12  # as others read it
        refused("data.h5", "'u'", words)


def test_links_within_the_file_are_followed(tokid, tmp_path):
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file["group/u"] = np.ones((3, 4, 1))
        file["u"] = h5py.SoftLink("/group/u")
        file["y"] = np.ones((3, 4, 2))
    assert tokid.json("info", tmp_path / "data.h5")["inputs"] == 1


def test_names_in_archives_are_no_paths(tokid, tmp_path):
    content = io.BytesIO()
    np.save(content, np.ones((3, 4, 1)))
    zipped(tmp_path / "data.npz", "../../u.npy", content.getvalue(), len(content.getvalue()), method=0)
    assert "no data set 'u'" in tokid("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", status=2).stderr
    assert os.listdir(tmp_path) == ["data.npz"]


# Texts

# A title for the terminal, the same without a byte below 0x80, a line of its own, a text that runs backwards
WICKED = ["\x1b]0;title\x07", "\u009b31mred", "a\nb\u2028c\x7f", "\u202egnp.tset"]
OBEYED = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def test_names_are_text_to_a_terminal(tokid, tmp_path):
    values = {"u": np.random.default_rng(1).standard_normal((30, 12, 2)), "dt": 0.1}
    values["y"] = np.cumsum(values["u"], axis=1)
    np.savez(tmp_path / "data.npz", **values, input_names=WICKED[:2], output_names=WICKED[2:],
             input_units=["\x1b[2J", ""])
    shown = [tokid("info", tmp_path / "data.npz").stdout, tokid("info", tmp_path / "data.npz", "--json").stdout]
    call = tokid("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz")
    shown += [call.stdout, call.stderr]
    shown += [tokid("info", tmp_path / "model.npz", *options).stdout for options in ([], ["--json"])]
    values["y"][:, :, 0] = np.inf
    np.savez(tmp_path / "data.npz", **values, output_names=WICKED[2:])
    shown.append(tokid("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", status=2).stderr)
    assert "infinite" in shown[-1]
    for text in shown:
        assert not OBEYED.search(text), OBEYED.search(text)
    assert json.loads(shown[1])["channels"][1]["name"] == WICKED[1]  # escaped, not changed


@pytest.mark.parametrize("text", ["=cmd|' /C calc'!A0", "@SUM(1+1)", '=HYPERLINK("http://a.b","c")', "-2+3+cmd|'/c'!A1"])
@pytest.mark.parametrize("name", ["input_names", "output_units"])
def test_formulas_are_not_written_into_tables(tokid, tmp_path, text, name):
    np.savez(tmp_path / "data.npz", u=np.ones((2, 3, 1)), y=np.ones((2, 3, 1)), **{name: [text]})
    message = tokid("convert", tmp_path / "data.npz", tmp_path / "data.csv", status=2).stderr
    assert name in message and "formula" in message
    assert os.listdir(tmp_path) == ["data.npz"]


def test_names_with_signs_are_written(tokid, tmp_path):
    np.savez(tmp_path / "data.npz", u=np.ones((2, 3, 1)), y=np.ones((2, 3, 1)), dt=1.0, input_names=["-Fz"],
             output_names=["d(x)/dt"])
    tokid("convert", tmp_path / "data.npz", tmp_path / "data.csv")
    assert "time,-Fz,d(x)/dt\n" in (tmp_path / "data.csv").read_text()


# Files that another program cuts while they are read

def read_bytes(pid):
    with open(f"/proc/{pid}/io") as file:
        return int(re.search(r"^rchar: (\d+)", file.read(), re.MULTILINE)[1])


def cut_while_read(tokid, data, folder):
    """The message of a call whose data are cut when a part of them has been read; nothing where it was too fast."""
    size = data.stat().st_size
    with subprocess.Popen([tokid.executable, "info", data], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          text=True, cwd=folder) as process:
        begun = read_bytes(process.pid)
        while process.poll() is None and read_bytes(process.pid) < size // 8:
            pass
        process.send_signal(signal.SIGSTOP)
        done = read_bytes(process.pid) if process.poll() is None else size
        if done < size:
            os.truncate(data, size // 2)
        process.send_signal(signal.SIGCONT)
        message = process.communicate()[1]
    assert begun < size
    return (process.returncode, message) if done < size else None


@pytest.mark.parametrize("name", ["data.h5", "data.npz", "data.mat", "data.csv"])
def test_files_that_are_cut_while_they_are_read(tokid, tmp_path, name):
    u = np.random.default_rng(1).standard_normal((40, 4000 if name.endswith("csv") else 40000, 1))
    for _ in range(10):
        if name == "data.h5":
            with h5py.File(tmp_path / name, "w") as file:
                for part in "uy":
                    file.create_dataset(part, data=u, chunks=(1, 4000, 1), shuffle=True)
        elif name == "data.npz":
            np.savez(tmp_path / name, u=u, y=u)
        elif name == "data.mat":
            scipy.io.savemat(tmp_path / name, {"u": u, "y": u, "experiments": len(u)})
        else:
            rows = [f"{n},{k},{v!r},{v!r}" for n in range(len(u)) for k, v in enumerate(u[n, :, 0].tolist())]
            (tmp_path / name).write_text("experiment,k,u,y\n" + "\n".join(rows) + "\n")
        if found := cut_while_read(tokid, tmp_path / name, tmp_path):
            assert found[0] == 2, found[1]
            assert name in found[1] and len(found[1].splitlines()) == 1
            return
    pytest.fail("always read too fast to be cut")


def test_nothing_is_told_behind_the_message(tokid):
    """The HDF5 library complains when it is closed about what a damaged file has left open."""
    found = ROOT / "fuzz" / "corpus" / "ensemble_h5" / "found-superblock-beyond-file.h5"
    assert len(tokid("info", found, status=2).stderr.splitlines()) == 1


def test_model_whose_matrices_hold_nothing(refused, tmp_path):
    """No numbers are in the file, and two gigabytes in the model that its shapes speak of."""
    shapes = {"A": (2, 100, 100), "B": (2, 0, 1_000_000), "C": (2, 1_000_000, 0), "D": (2, 0, 0), "G": (2, 0, 0)}
    np.savez(tmp_path / "model.npz", state_dim=[100] * 3, **{name: np.zeros(shape) for name, shape in shapes.items()})
    refused("model.npz", "'B'", "2 steps of 0 x 1000000 found, 2 steps of 100 x 1000000 needed")
