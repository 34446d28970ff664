# SPDX-License-Identifier: BSD-3-Clause
"""Files with a changed bit: refused, told to be changed, or read as they were. tests/integrity_test.cpp changes many more
bits of files that tokid wrote."""

import random
import subprocess

import h5py
import numpy as np
import pytest
import scipy.io

from support import write_ensemble

FORMATS = {"npz": ("data.npz",), "h5": ("data.h5",), "mat": ("data.mat",), "mat73": ("data.mat", "--mat73"),
           "csv": ("data.csv",)}
WRITTEN = [(kind, name) for name in FORMATS for kind in ("data", "model") if (kind, name) != ("model", "csv")]


def values(steps=120):
    rng = np.random.default_rng(7)
    return {"u": rng.standard_normal((20, steps, 2)), "y": rng.standard_normal((20, steps, 3)), "dt": 0.1}


@pytest.fixture(scope="module")
def written(tokid, tmp_path_factory):
    """One file of each kind and format, as tokid writes them."""
    folder = tmp_path_factory.mktemp("written")
    np.savez(folder / "in.npz", **values())
    write_ensemble(folder / "experiments.h5")
    tokid("identify", folder / "experiments.h5", "-o", folder / "model.npz", "--lags", 2, "--states", 2)
    source = {"data": "in.npz", "model": "model.npz"}
    for kind, name in WRITTEN:
        target, *options = FORMATS[name]
        (folder / f"{kind}-{name}").mkdir()
        tokid("convert", folder / source[kind], folder / f"{kind}-{name}" / target, *options)
    return folder


def read(tokid, path):
    """What tokid reads, as the bytes that it writes of it; none where the file is refused in one line, or told to be
    changed."""
    out = path.parent / "out.npz"
    result = subprocess.run([tokid.executable, "convert", path, out], capture_output=True, text=True, check=False)
    if result.returncode == 0:
        content = out.read_bytes()
        out.unlink()
        return None if f"'{path}' does not match its line" in result.stderr else content
    assert result.returncode == 2 and len(result.stderr.splitlines()) == 1, result.stderr
    assert path.name in result.stderr
    return None


def tally(tokid, path, count, bits=None, seed=1):
    """Of single bits changed: how many leave what is read, change it in silence, are refused."""
    expected, content, dice = read(tokid, path), path.read_bytes(), random.Random(seed)
    assert expected is not None
    found = {"same": 0, "other": 0, "refused": 0}
    for _ in range(count):
        bit = dice.randrange(8 * len(content)) if bits is None else dice.choice(bits)
        changed = bytearray(content)
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        now = read(tokid, path)
        found["refused" if now is None else "same" if now == expected else "other"] += 1
    path.write_bytes(content)
    print(path.parent.name, path.name, len(content), "bytes", found)
    return found


@pytest.mark.parametrize(("kind", "name"), WRITTEN)
def test_no_bit_of_a_file_of_tokid_changes_in_silence(tokid, written, kind, name):
    found = tally(tokid, written / f"{kind}-{name}" / FORMATS[name][0], 25)
    assert found["other"] == 0 and found["refused"] > 15
    assert name != "csv" or found["same"] == 0


def test_no_bit_of_the_checksum_changes_in_silence(tokid, written):
    path = written / "data-csv" / "data.csv"
    bits = range(8 * path.read_bytes().index(b"\n") + 8)
    assert tally(tokid, path, 60, bits)["refused"] == 60


@pytest.mark.parametrize("options", [{}, {"compression": "gzip"}])
def test_missing_chunks_are_counted(tokid, tmp_path, options):
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file["y"] = values()["y"]
        u = file.create_dataset("u", (20, 120, 2), "f8", chunks=(5, 40, 1), **options)
        u[:, :80] = values()["u"][:, :80]
    for command in ("info", "data.h5"), ("identify", "data.h5", "-o", "model.h5", "--block", "60"):
        message = tokid(*command, status=2, cwd=tmp_path).stderr
        assert "data set 'u': 16 chunks found, 24 needed" in message and "NaN for missing samples" in message


def test_mat_of_others_has_a_checksum(tokid, tmp_path):
    """The samples, and names of variables that are optional."""
    path = tmp_path / "data.mat"
    scipy.io.savemat(path, values() | {"experiments": 20, "length": np.full((20, 1), 100.0)}, do_compression=True)
    found = tally(tokid, path, 100)
    assert found["other"] == 0 and found["refused"] > 95


def test_variables_that_the_size_of_another_swallows(tokid, tmp_path):
    """A chain of elements that is whole again: the last one is within the one before."""
    path = tmp_path / "data.mat"
    scipy.io.savemat(path, values(), do_compression=True)
    content = path.read_bytes()
    starts, at = [], 128
    while at < len(content):
        starts.append(at)
        at += 8 + int.from_bytes(content[at + 4:at + 8], "little")
    before = starts[-2]
    path.write_bytes(content[:before + 4] + (len(content) - before - 8).to_bytes(4, "little") + content[before + 8:])
    assert "variable 2 is damaged" in tokid("info", path, status=2).stderr


def data_sets(file):
    """All of them, those within groups too."""
    found = []
    file.visititems(lambda _, item: found.append(item) if isinstance(item, h5py.Dataset) else None)
    return found


def test_every_data_set_has_a_checksum(tokid, written, tmp_path):
    """In the header of its object, or of each chunk, with an index that has its own. Of bounds too, which nothing reads
    that tokid has."""
    tokid("confidence", written / "model.npz", written / "experiments.h5", "-o", tmp_path / "bounds.h5")
    call = ("identify", written / "experiments.h5", "--lags", 2, "--states", 2, "-o")
    tokid(*call, tmp_path / "blocks.h5", "--block", 90)
    tokid(*call, tmp_path / "model.npz", "--state", tmp_path / "state.h5")
    for path in [*tmp_path.glob("*.h5"), *written.glob("*-h5/*"), *written.glob("*-mat73/*.mat")]:
        with h5py.File(path) as file:
            superblock = path.read_bytes()[file.userblock_size:]
            assert superblock.startswith(b"\x89HDF\r\n\x1a\n\3"), path  # of the version with a checksum
            sets = data_sets(file)
            assert len(sets) > 2
            for data in sets:
                layout = data.id.get_create_plist().get_layout()
                assert layout == h5py.h5d.COMPACT or layout == h5py.h5d.CHUNKED and data.fletcher32, (path, data.name)


def test_what_is_changed_by_others_is_read(tokid, written, tmp_path):
    """Checksums are those of the format: whoever writes an array writes them too."""
    path = tmp_path / "data.h5"
    path.write_bytes((written / "data-h5" / "data.h5").read_bytes())
    with h5py.File(path, "r+") as file:
        file["u"][3, 50:70, 1] = 2.5
        file["dt"][()] = 0.25
        expected = file["u"][()]
    tokid("convert", path, tmp_path / "out.npz")
    with np.load(tmp_path / "out.npz") as file:
        np.testing.assert_array_equal(file["u"], expected)
        assert file["dt"] == 0.25
