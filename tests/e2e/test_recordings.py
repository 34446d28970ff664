# SPDX-License-Identifier: BSD-3-Clause
"""Many .csv files, an experiment in each."""

import re
import subprocess
import sys

import numpy as np
import pytest

from conftest import ROOT


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def read(tokid, tmp_path, *arguments):
    """The arrays and the warnings of what convert reads."""
    result = tokid("convert", *arguments, tmp_path / "read.npz")
    with np.load(tmp_path / "read.npz") as file:
        return {name: file[name] for name in file.files}, result.stderr


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    """Twenty-five batches, in strict .csv."""
    folder = tmp_path_factory.mktemp("batches") / "plant"
    subprocess.run([sys.executable, ROOT / "examples" / "batch_plant.py", folder], check=True)
    for path in folder.iterdir():
        rows = path.read_text(encoding="utf-8").splitlines()[3:]
        path.write_text("\n".join(["time,valve,T,p", *rows, ""]).replace("Bad", ""), encoding="utf-8")
    return folder


COLUMNS = ["--inputs", "valve", "--outputs", "T,p"]


def test_a_folder_of_a_batch_plant_becomes_a_model(tokid, plant, tmp_path):
    model = tmp_path / "model.h5"
    tokid("identify", plant, *COLUMNS, "-o", model, "--hold-out", "0.2")
    found = tokid.json("validate", model, *sorted(plant.glob("batch*5.csv")))
    assert found["data"] == [str(path) for path in sorted(plant.glob("batch*5.csv"))]
    # In simulation, the errors are hardly larger than the noise of the sensors: 0.05 K and 0.002 bar.
    assert found["simulation_rmse"][0] < 2 * 0.05 and found["simulation_rmse"][1] < 2 * 0.002
    info = tokid.json("info", plant, *COLUMNS)
    assert info["experiment_names"] == [f"batch{n}" for n in range(1, 26)]  # batch2 before batch10
    assert info["dt"] == 10 and info["dt_stated"] and min(info["length"]) < info["steps"] == 90
    assert [channel["name"] for channel in info["channels"]] == ["valve", "T", "p"]


def test_files_folders_and_patterns_are_the_same_data(tokid, plant, tmp_path):
    folder, warnings = read(tokid, tmp_path, plant, *COLUMNS)
    assert warnings == ""
    for arguments in ([plant / "batch*.csv"], reversed(sorted(plant.iterdir())), [plant, plant / "batch1.csv"]):
        other, _ = read(tokid, tmp_path, *arguments, *COLUMNS)
        assert other.keys() == folder.keys()
        for name, values in folder.items():
            np.testing.assert_array_equal(values, other[name])


def test_convert_never_replaces_a_recording(tokid, tmp_path):
    folder = tmp_path / "runs"
    folder.mkdir()
    texts = {}
    for name in ("a", "b", "c"):
        texts[name] = f"time,u,y\n0,{ord(name)},2\n1,2,3\n"
        write(folder / f"{name}.csv", texts[name])
    files = sorted(folder.iterdir())
    # OUT was forgotten: the shell put the last recording there.
    for names in (files, files[:2]):
        assert "may be a recording, so it was not replaced" in tokid("convert", *names, status=2).stderr
    for paths in ([folder], [folder / "*.csv"], [files[0], folder / "[bc].csv"]):
        message = tokid("convert", *paths, folder / "b.csv", status=2).stderr
        assert "another file of this command has this name, and writing would replace it" in message
    assert {path.stem: path.read_text() for path in folder.iterdir()} == texts


def test_files_that_differ_are_named(tokid, tmp_path):
    folder = tmp_path / "runs"
    folder.mkdir()
    write(folder / "run1.csv", "time,u,p,y\n0,1,2,3\n1,2,3,4\n")
    arguments = ["--inputs", "u", "--outputs", "p,y"]
    for text, part in [("time,u,y\n0,1,2\n", "no column 'p' found among 'time', 'u', 'y'"),
                       ('# output_units = ["mbar", ""]\n# output_names = ["p", "y"]\ntime,u,p,y\n0,1,2,3\n',
                        "other units of the channels found than in 'run1.csv'"),
                       ("u,y,p\n0,1,2\n", "no column of steps found, but a column 'time' in 'run1.csv'"),
                       ("time,u,p,y\n0,1,oops,3\n", "line 2, column 'p': 'oops' found, a number")]:
        write(folder / "run2.csv", text)
        message = tokid("info", folder, *arguments, status=2).stderr
        assert "run2.csv: " in message and part in message
    write(folder / "run1.csv", "time,u,y\n0,1,2\n1,2,3\n")
    write(folder / "run2.csv", "time,u,y,y2\n0,1,2,3\n1,2,3,4\n")
    assert "run2.csv: 3 channels found, but 2 in 'run1.csv'" in tokid("info", folder, status=2).stderr
    write(folder / "run2.csv", "time,y,u\n0,1,2\n1,2,3\n")
    data, _ = read(tokid, tmp_path, folder)
    np.testing.assert_array_equal(data["y"][1, :, 0], [1, 2])  # by name
    write(folder / "run2.csv", "time,u,y\n0,1,2\n1,2,3\n2.3,2,3\n3,1,1\n")
    message = tokid("info", folder, status=2).stderr
    assert "run2.csv, line 4" in message and "even times needed" in message
    assert f"tokid import '{folder}' data.npz" in message
    assert "a directory without any .csv found" in tokid("info", tmp_path, status=2).stderr
    assert "no file matches this pattern" in tokid("info", tmp_path / "x*.csv", status=2).stderr


def test_tables_of_other_programs_are_refused_with_the_command_that_reads_them(tokid, tmp_path):
    path = write(tmp_path / "a 1.csv", "t [s];valve [%]\n0,0;1,5\n")
    assert f"tokid import '{path}' data.npz" in tokid("info", path, status=2).stderr


def test_wide_tables(tokid, tmp_path):
    channels = 2000
    names = ["time", "u", *(f"y{c}" for c in range(channels))]
    text = ";".join(names) + "\n" + "".join(";".join(str(k + c) for c in range(channels + 2)) + "\n" for k in range(3))
    data, _ = read(tokid, tmp_path, write(tmp_path / "data.csv", text))
    assert data["y"].shape == (1, 3, channels)
    assert data["y"][0, 2, -1] == 2 + channels + 1


def test_columns_are_chosen_in_csv_files_only(tokid, tmp_path):
    npz = tmp_path / "data.npz"
    tokid("example", "oscillator", "-o", npz, "--experiments", "8", "--steps", "20")
    assert "columns can be chosen in .csv files only" in tokid("info", npz, "--inputs", "u1", status=2).stderr
    message = tokid("info", npz, npz.parent / "x.csv", status=2).stderr
    assert "but several files must all be .csv" in message


def test_picture(tokid, plant, tmp_path):
    page = tmp_path / "picture.html"
    for locale, block in (("C.UTF-8", "\u2588"), ("C", "#")):
        lines = tokid("info", plant, *COLUMNS, "--picture", page, env={"LC_ALL": locale}).stdout.splitlines()
        drawn = next(line for line in lines if line.startswith("T "))
        assert block in drawn and max(map(len, lines)) <= 100
        assert any(line.startswith("  missing") for line in lines)
        assert lines[-1].split() == ["Written", str(page)]
    assert tokid.json("info", plant, *COLUMNS, "--picture", page)["picture"] == str(page)
    assert tokid.json("info", plant, *COLUMNS)["picture"] is None
    text = page.read_text(encoding="utf-8")
    assert text.count("<svg") == 3 and "batch" not in text.split("<h1>")[0].replace("batches", "")


def test_options_of_ensembles_are_refused_for_other_files(tokid, oscillator, tmp_path):
    model, controller, page = oscillator / "model.npz", tmp_path / "c.npz", tmp_path / "picture.html"
    tokid("lqr", model, "-o", controller)
    for path, found in ((model, "a model"), (controller, "a controller")):
        for options in (["--picture", str(page)], ["--inputs", "valve"]):
            message = tokid("info", path, *options, status=2).stderr
            assert f"{found} found, an ensemble needed with the options {' '.join(options)}" in message
        assert not page.exists()
        tokid("info", path)


def test_ends_without_a_line_break_are_one_warning(tokid, tmp_path):
    folder = tmp_path / "runs"
    folder.mkdir()
    for n in range(4):
        write(folder / f"{n}.csv", f"time,u,y\n0,1,2\n1,2,{n}")
    warnings = read(tokid, tmp_path, folder)[1]
    assert warnings.count("warning: ") == 1 and "in all files, the last line 3 ends without a line break" in warnings


def test_one_file_by_two_names_and_subfolders(tokid, tmp_path):
    folder = tmp_path / "runs"
    (folder / "more").mkdir(parents=True)
    for path in (folder / "a.csv", folder / "more" / "b.csv"):
        write(path, "time,u,y\n0,1,2\n1,2,3\n")
    (folder / "c.csv").symlink_to(folder / "a.csv")
    data, warnings = read(tokid, tmp_path, folder)
    assert data["u"].shape[0] == 1
    assert f"'{folder / 'a.csv'}' and '{folder / 'c.csv'}' are the same file, which was read only once" in warnings
    assert f"the folder '{folder}' has .csv files in the subfolder 'more', which were not read" in warnings


def test_pictures_of_lone_samples_and_equal_experiments(tokid, tmp_path):
    folder = tmp_path / "runs"
    folder.mkdir()
    for n in range(6):
        cells = [f"{k},{k},{'' if k in (1, 3, 4) else 7 + (n == 5)}" for k in range(5)]
        write(folder / f"e{n}.csv", "time,u with a rather long name,y\n" + "\n".join(cells) + "\n")
    page = tmp_path / "picture.html"
    result = tokid("info", folder, "--picture", page, env={"LC_ALL": "C"})
    assert "u with a rather l..." in result.stdout and "\u2026" not in result.stdout
    assert 'experiment "e5" (row 5): y differs where the others are equal' in result.stdout
    text = page.read_text(encoding="utf-8")
    assert re.search(r'class="mean" d="M0\.0 [\d.]+h0M', text)  # the lone sample of step 0 is a point
    gaps = re.findall(r'class="gap" x="([\d.]+)" y="\d+" width="([\d.]+)"', text)
    assert len(gaps) == 3 and all(float(x) + float(width) <= 900 for x, width in gaps)


def test_odd_experiments_are_named(tokid, plant, tmp_path):
    folder = tmp_path / "runs"
    folder.mkdir()
    for path in plant.iterdir():
        (folder / path.name).write_text(path.read_text())
    header, *lines = (folder / "batch4.csv").read_text().splitlines()
    hot = [",".join([*line.split(",")[:2], str(30 + 0.01 * k), line.split(",")[3]]) for k, line in enumerate(lines)]
    write(folder / "batch4.csv", "\n".join([header, *hot, ""]))
    assert 'experiment "batch4" (row 3): T is' in tokid("info", folder, *COLUMNS).stdout
