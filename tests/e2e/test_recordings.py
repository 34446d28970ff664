# SPDX-License-Identifier: BSD-3-Clause
""".csv files as people have them: many files, dialects, time stamps, missing samples, triggers, resampling."""

import re
import subprocess
import sys

import numpy as np
import pytest

from conftest import ROOT

U = np.array([0.5, -0.25, 1.0, 0.0, 2.5, 1.5, -1.0, 0.25, 3.0, 0.75])
Y = np.array([20.0, 20.5, 20.25, 21.0, 20.75, 22.0, 22.5, 21.75, 21.5, 23.0])


def write(path, text, encoding="utf-8"):
    path.write_bytes(text.encode(encoding))
    return path


def read(tokid, tmp_path, *arguments):
    """The arrays and the warnings of what convert reads."""
    result = tokid("convert", *arguments, tmp_path / "read.npz")
    with np.load(tmp_path / "read.npz") as file:
        return {name: file[name] for name in file.files}, result.stderr


def rows(template, separator_of_decimals="."):
    """A line for each sample; {k} is its number."""
    lines = []
    for k, (u, y) in enumerate(zip(U, Y)):
        u, y = (f"{value:g}".replace(".", separator_of_decimals) for value in (u, y))
        lines.append(template(k, u, y))
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    folder = tmp_path_factory.mktemp("batches") / "plant"
    subprocess.run([sys.executable, ROOT / "examples" / "batch_plant.py", folder], check=True)
    return folder


COLUMNS = ["--inputs", "valve [%]", "--outputs", "T [degC],p [bar]"]


def test_a_folder_of_a_batch_plant_becomes_a_model(tokid, plant, tmp_path):
    model = tmp_path / "model.h5"
    result = tokid("identify", plant, *COLUMNS, "-o", model, "--hold-out", "0.2")
    assert "in all files, lines 1 to 2 were skipped, because the names of the columns are in line 3" in result.stderr
    assert "22 cells with 'Bad' were read as missing samples. The first one is at batch1.csv, line 53" in result.stderr
    found = tokid.json("validate", model, *sorted(plant.glob("batch*5.csv")))
    assert found["data"] == [str(path) for path in sorted(plant.glob("batch*5.csv"))]
    # In simulation, the errors are hardly larger than the noise of the sensors: 0.05 K and 0.002 bar.
    assert found["simulation_rmse"][0] < 2 * 0.05 and found["simulation_rmse"][1] < 2 * 0.002
    info = tokid.json("info", plant, *COLUMNS)
    assert info["experiment_names"] == [f"batch{n}" for n in range(1, 26)]  # batch2 before batch10
    assert info["dt"] == 10 and info["dt_stated"] and min(info["length"]) < info["steps"] == 90
    assert [channel["unit"] for channel in info["channels"]] == ["%", "degC", "bar"]
    assert [channel["name"] for channel in info["channels"]] == ["valve", "T", "p"]


def test_files_folders_and_patterns_are_the_same_data(tokid, plant, tmp_path):
    folder, warnings = read(tokid, tmp_path, plant, *COLUMNS)
    assert "warning" in warnings
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
        texts[name] = f"t [s],u,y\n0,{ord(name)},2\n1,2,3\n"
        write(folder / f"{name}.csv", texts[name])
    files = sorted(folder.iterdir())
    # OUT was forgotten: the shell put the last recording there.
    for names in (files, files[:2]):
        assert "may be a recording, so it was not replaced" in tokid("convert", *names, status=2).stderr
    for paths in ([folder], [folder / "*.csv"], [files[0], folder / "[bc].csv"]):
        message = tokid("convert", *paths, folder / "b.csv", status=2).stderr
        assert "another file of this command has this name, and writing would replace it" in message
    assert {path.stem: path.read_text() for path in folder.iterdir()} == texts


DIALECTS = {
    "semicolons and decimal commas": rows(lambda k, u, y: f"{0.1 * k:.1f};{u};{y}".replace(".", ","), ","),
    "tabs": rows(lambda k, u, y: f"{0.1 * k:.1f}\t{u}\t{y}"),
    "quoted decimal commas": rows(lambda k, u, y: f'"{0.1 * k:.1f}","{u}","{y}"'.replace(".", ","), ","),
}
HEADERS = {"semicolons and decimal commas": "t [s];u [V];y [\u00b0C]", "tabs": "t [s]\tu [V]\ty [\u00b0C]",
           "quoted decimal commas": '"t [s]","u [V]","y [\u00b0C]"'}


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_dialects(tokid, tmp_path, dialect, encoding):
    path = write(tmp_path / "data.csv", f"{HEADERS[dialect]}\n{DIALECTS[dialect]}", encoding)
    data, warnings = read(tokid, tmp_path, path)
    np.testing.assert_array_equal(data["u"][0, :, 0], U)
    np.testing.assert_array_equal(data["y"][0, :, 0], Y)
    assert data["dt"] == 0.1
    assert list(data["input_units"]) == ["V"] and list(data["output_units"]) == ["\u00b0C"]
    assert ("Latin-1" in warnings) == (encoding == "latin-1")


def test_marks_of_thousands_are_not_decimal_marks(tokid, tmp_path):
    thousands = 't [s],u,y\n0,999,"1,000"\n1,998,"1,001"\n'
    message = tokid("info", write(tmp_path / "data.csv", thousands), status=2).stderr
    assert "line 2: '1,000' found; its comma and the commas of all numbers may group thousands" in message
    for mark in ".,":
        rising = "t [s];u;y\n" + "".join(f"{k};1;{y}\n" for k, y in enumerate(["998", "999", f"1{mark}000"]))
        message = tokid("info", write(tmp_path / "data.csv", rising), status=2).stderr
        assert f"line 4: '1{mark}000' found; this mark and those of all numbers seem to group thousands" in message
        assert "because column 'y' has whole numbers below 1000 without one" in message
    for text, remark in [
        ("t [s];u;y\n0;999;1.000\n1;998;1.001\n", "points in numbers were read as decimal points, so 1.000 is 1. If they"),
        ("t [s];u;y\n0;999;1,000\n1;998;1,001\n", "commas in numbers were read as decimal commas, so 1,000 is 1. If they"),
        ("t [s];u;y\n0;9;1,5\n1;9;1,001\n", "commas in numbers were read as decimal commas, so 1,5 is 1.5"),
        ('t [s],u,y\n"0,5",9,"1,001"\n"1,5",9,"1,002"\n', "commas in numbers were read as decimal commas, so 1,5 is 1.5"),
        ('t [s],u,y\n0,9,"1,001"\n1,9,"0,125"\n', "commas in numbers were read as decimal commas, so 1,5 is 1.5"),
    ]:
        data, warnings = read(tokid, tmp_path, write(tmp_path / "data.csv", text))
        assert remark in warnings and 1.001 in data["y"]
    for text in ("t [s];u;y\n0;9;1.5\n1;9;1.001\n", "t [s],u,y\n0,9,1.000\n1,9,1.001\n"):
        assert "decimal" not in read(tokid, tmp_path, write(tmp_path / "data.csv", text))[1]


TIMES = {
    "milliseconds": ("t [ms]", lambda k: f"{100 * k}"),
    "ISO 8601": ("Zeitpunkt", lambda k: f"2026-11-27T23:59:59.{k}+01:00"),
    "ISO 8601 with a space": ("stamp", lambda k: f"2026-11-27 13:12:05.{k}00"),
    "day.month.year": ("Zeit", lambda k: f"27.11.2026 13:12:05,{k}"),
    "month/day/year": ("Date", lambda k: f"11/27/2026 1:12:05.{k} PM"),
    "month by name": ("Timestamp", lambda k: f"27-Nov-26 13:12:05.{k}"),
    "time of day": ("Uhrzeit", lambda k: f"13:12:05.{k}"),
}


@pytest.mark.parametrize("kind", TIMES)
def test_times(tokid, tmp_path, kind):
    title, stamp = TIMES[kind]
    text = f"{title};u;y\n" + rows(lambda k, u, y: f"{stamp(k)};{u};{y}")
    data, warnings = read(tokid, tmp_path, write(tmp_path / "data.csv", text))
    np.testing.assert_array_equal(data["u"][0, :, 0], U)
    assert data["dt"] == 0.1
    assert ("dates were read as month/day, because of '11/27/2026 1:12:05.0 PM'" in warnings) == (kind == "month/day/year")


def test_a_stated_column_of_times(tokid, tmp_path):
    path = write(tmp_path / "data.csv", "X [ms],time [s],u,y\n" + rows(lambda k, u, y: f"{20 * k},{k},{u},{y}"))
    data, warnings = read(tokid, tmp_path, path, "--time", "X")
    assert data["dt"] == 0.02 and "column 'time [s]' is not used" in warnings
    assert "no column 'Z' found among" in tokid("info", path, "--time", "Z", status=2).stderr
    assert "column 'u' is stated as times and as a channel" in tokid("info", path, "--time", "u", status=2).stderr
    write(path, "X [bar],u,y\n" + rows(lambda k, u, y: f"{20 * k},{u},{y}"))
    assert "the unit 'bar' is not known" in tokid("info", path, "--time", "X", status=2).stderr


def test_dates_and_times_of_day_in_two_columns_over_midnight(tokid, tmp_path):
    text = "Date,Clock,u,y\n" + rows(lambda k, u, y: f"0{3 + (k > 4)}/04/2026,{(19 + k) % 24:02d}:00:00,{u},{y}")
    path = write(tmp_path / "data.csv", text)
    refused = tokid("info", path, status=2)
    assert "'03/04/2026 19:00:00': this may be day/month or month/day, and no date of the column shows which of them" in refused.stderr
    assert "--dates day-first" in refused.stderr
    data, _ = read(tokid, tmp_path, path, "--dates", "day-first")
    assert data["dt"] == 3600
    np.testing.assert_array_equal(data["y"][0, :, 0], Y)
    # If all rows have the same date, its order does not matter.
    text = "Date,Clock,u,y\n" + rows(lambda k, u, y: f"03/04/2026,{k}:00:00 AM,{u},{y}".replace(",0:", ",12:"))
    data, _ = read(tokid, tmp_path, write(tmp_path / "data.csv", text))
    assert data["dt"] == 3600 and data["y"].shape == (1, 10, 1)


def times(stamps, title="time"):
    return f"{title},u,y\n" + "".join(f"{stamp},{k},2\n" for k, stamp in enumerate(stamps))


def test_times_of_day_of_several_days(tokid, tmp_path):
    path = write(tmp_path / "data.csv", times(["17:00", "18:00", "19:00", "20:00", "21:00", "09:00"]))
    data, warnings = read(tokid, tmp_path, path)
    assert data["dt"] == 3600 and data["u"][0, -1, 0] == 5 and data["u"].shape[1] == 17
    assert "line 7: '09:00' after '21:00' was read as a time of another day" in warnings
    newest_first = [f"{h % 24:02d}:{m:02d}:00" for h in (25, 24, 23) for m in (40, 20, 0)]
    data, warnings = read(tokid, tmp_path, write(path, times(newest_first)))
    np.testing.assert_array_equal(data["u"][0, :, 0], range(8, -1, -1))
    assert "the times of day pass midnight" in warnings
    message = tokid("info", write(path, times([f"{h}:{m}" for h in (11, 12, 1) for m in (10, 30, 50)])), status=2).stderr
    assert "line 8: '1:10' found after '12:50'; without AM and PM, this may be noon or midnight; dates" in message


def test_times_that_can_mean_something_else(tokid, tmp_path):
    path = write(tmp_path / "data.csv", times([1764246725123 + k for k in range(9)], "timestamp"))
    message = tokid("info", path, status=2).stderr
    assert "'1764246725123' found, which is more than 3000 years in s; the unit" in message
    write(path, path.read_text().replace("timestamp", "timestamp [ms]"))
    assert read(tokid, tmp_path, path)[0]["dt"] == 0.001
    short = [f"{s // 60:02d}:{s % 60:02d}" for s in range(0, 700, 10)]
    data, warnings = read(tokid, tmp_path, write(path, times(short, "Time [mm:ss]")))
    assert data["dt"] == 10 and "minutes" not in warnings
    data, warnings = read(tokid, tmp_path, write(path, times(short, "Time")))
    assert data["dt"] == 600
    assert "column 'Time': times such as 05:10 were read as hours and minutes. If they are minutes and seconds" in warnings
    assert "minutes" not in read(tokid, tmp_path, write(path, times(short, "Time [hh:mm]")))[1]
    message = tokid("info", write(path, times(["2026-11-27 13:00:00", "2026-11-27 13:00:01Z"])), status=2).stderr
    assert "line 3: '2026-11-27 13:00:01Z' found with a time zone, but '2026-11-27 13:00:00' in line 2 without" in message


def test_clocks_of_experiments(tokid, tmp_path):
    folder = tmp_path / "runs"
    folder.mkdir()

    def runs(**begins):
        for name, begin in begins.items():
            write(folder / f"{name}.csv", times(begin + np.arange(20)))
        return read(tokid, tmp_path, folder)

    data, warnings = runs(a=0, b=5)
    assert "read as readings of one clock, on which the experiments begin up to 5 s apart" in warnings
    assert np.isnan(data["u"][1, :5, 0]).all()
    data, warnings = runs(a=0, b=19)  # one common sample
    np.testing.assert_array_equal(data["u"][:, 0, 0], [0, 0])
    assert "less than half of the shortest experiment in common, so tokid lets each experiment begin at its first row" in warnings
    _, warnings = runs(a=0, b=30)
    assert "have nothing in common, so tokid lets each experiment begin at its first row" in warnings
    assert runs(a=7, b=7)[1] == ""
    # Time stamps count from the first row of each file.
    for name, second in (("a", 0), ("b", 5)):
        write(folder / f"{name}.csv", times([f"2026-11-27 13:00:{second + k:02d}" for k in range(20)]))
    data, warnings = read(tokid, tmp_path, folder)
    np.testing.assert_array_equal(data["u"][:, 0, 0], [0, 0])
    assert "in all files, the time stamps count from the first row of each file. Use --trigger" in warnings
    # Without a trigger, the begins of the experiments may be wrong, so this remark is the first one.
    for name, begin in (("a", 0), ("b", 5)):
        write(folder / f"{name}.csv", "logger 7\n" + times(begin + np.arange(20)).replace("u,y", "u,y,v").replace(",2\n", ",2,3\n"))
    warnings = read(tokid, tmp_path, folder)[1].split("warning: ")
    assert "read as readings of one clock" in warnings[1] and "line 1 was skipped" in warnings[2]
    for name in "ab":
        write(folder / f"{name}.csv", "logger 7\n" + times([f"2026-11-27 13:00:{k:02d}" for k in range(20)]))
    warnings = read(tokid, tmp_path, folder)[1].split("warning: ")
    assert "the time stamps count from the first row" in warnings[1] and "line 1 was skipped" in warnings[2]


def test_seconds_since_1970_keep_their_rounding(tokid, tmp_path):
    folder = tmp_path / "runs"
    folder.mkdir()
    for name, begin in (("a", 1764246725), ("b", 1764250000)):
        write(folder / f"{name}.csv", times([f"{begin + k // 1000}.{k % 1000:03d}" for k in range(300)]))
    for options in ([], ["--trigger", "u > 20"]):
        data, _ = read(tokid, tmp_path, folder, *options)
        assert data["dt"] == 0.001
        np.testing.assert_array_equal(data["u"][0], data["u"][1])


def test_units_below_the_header_and_a_preamble(tokid, tmp_path):
    text = ("Batch;17\nOperator;M\u00fcller\n\nZeit;Ventil;Temperatur\ns;%;\u00b0C\n" +
            rows(lambda k, u, y: f"{k};{u};{y};", ","))
    path = write(tmp_path / "data.csv", text, "latin-1")
    data, warnings = read(tokid, tmp_path, path, "--inputs", "Ventil", "--outputs", "Temperatur")
    np.testing.assert_array_equal(data["y"][0, :, 0], Y)
    assert list(data["output_units"]) == ["\u00b0C"] and data["dt"] == 1
    assert "lines 1 to 3 were skipped, because the names of the columns are in line 4" in warnings
    assert "line 5 was read as the units of the columns" in warnings


def test_headers_below_preambles(tokid, tmp_path):
    path = tmp_path / "data.csv"
    for text, options in [
        ("1,2,3\n4,5,6\nt [s],u,y\n0,1,2\n1,2,3\n2,3,4\n", []),
        ("Report\ntime,1,2\n0,1,2\n1,2,3\n2,3,4\n", ["--inputs", "1", "--outputs", "2"]),
        ("setting,7\n" * 30 + "t [s],u,y\n0,1,2\n1,2,3\n2,3,4\n", []),
        ("9,8,7\nt [s],p [bar],T [K]\n0,1,2\n1,2,3\n2,3,4\n", ["--inputs", "p", "--outputs", "T [K]"]),
        ("9,8,7\nt,p,T\ns,bar,K\n0,1,2\n1,2,3\n2,3,4\n", ["--inputs", "p", "--outputs", "T"]),
    ]:
        data, warnings = read(tokid, tmp_path, write(path, text), *options)
        np.testing.assert_array_equal(data["y"][0, :, 0], [2, 3, 4])
        assert "because the names of the columns are in line" in warnings
    message = tokid("info", write(path, "a,b\nspeed,force\n1,2\n3,4\n5,6\n"), status=2).stderr
    assert "found among 'speed', 'force'" in message and "line 2 was taken for the header" in message


def test_stated_missing_words_and_times(tokid, tmp_path):
    data, _ = read(tokid, tmp_path, write(tmp_path / "data.csv", "t [s],u,y\n0,0,2\n1,2,0\n2,3,4\n"), "--missing", "0")
    np.testing.assert_array_equal(data["u"][0, :, 0], [np.nan, 2, 3])


def test_switches_blank_lines_and_dates(tokid, tmp_path):
    path = tmp_path / "data.csv"
    data, warnings = read(tokid, tmp_path, write(path, "t [s],u,y\n0,ON,True\n1,off,false\n"))
    np.testing.assert_array_equal([data["u"][0, :, 0], data["y"][0, :, 0]], [[1, 0], [1, 0]])
    assert "cells with on and true were read as 1, and cells with off and false as 0" in warnings
    data, warnings = read(tokid, tmp_path, write(path, "u\n1\n\n3\n4\n\n"))
    np.testing.assert_array_equal(data["u"][0, :, 0], [1, np.nan, 3, 4])
    assert "1 blank line of the only column was read as missing samples" in warnings
    data, _ = read(tokid, tmp_path, write(path, "date,k,u,y\n2026-11-27,0,1,2\n2026-11-27,1,2,3\n"))
    np.testing.assert_array_equal(data["u"][0, :, 0], [1, 2])
    message = tokid("info", write(path, "k,u,y\n0,1,2\n0,2,3\n"), status=2).stderr
    assert "line 3: a second row for step 0 found, one needed" in message


def test_words_for_missing_samples(tokid, tmp_path):
    words = ["Bad", "---", "NaN", "NA", "null", "#N/A", "I/O Timeout", "", "-999.0"]
    text = "t [s],u,y\n" + "".join(f"{k},{k},{word}\n" for k, word in enumerate(words)) + "9,9,1.5\n"
    path = write(tmp_path / "data.csv", text)
    data, warnings = read(tokid, tmp_path, path, "--missing", "-999,Fault 7")
    assert np.isnan(data["y"][0, :9, 0]).all() and data["y"][0, 9, 0] == 1.5
    assert "5 cells with '#N/A', '---', 'Bad', 'I/O Timeout', 'null' were read as missing samples" in warnings
    path = write(tmp_path / "data.csv", text.replace("Bad", "Fault seven"))
    refused = tokid("info", path, status=2).stderr
    assert "line 2, column 'y': 'Fault seven' found, a number needed; --missing 'Fault seven' reads it" in refused


def valve(states, title="XV104.STAT"):
    """A table with a column of the states of a valve."""
    return f"t [s],u,y,{title}\n" + "".join(f"{k},{k},2,{state}\n" for k, state in enumerate(states))


def test_columns_of_texts(tokid, tmp_path):
    path = tmp_path / "data.csv"
    channel = ["--inputs", "XV104.STAT", "--outputs", "y"]
    for states, options, part in [
        (["", "ZU", "ZU", "AUF"], ["--trigger", "XV104.STAT > 0.5"],
         "line 3, column 'XV104.STAT': 'ZU' found, a number needed for the trigger 'XV104.STAT > 0.5'; the column has "
         "the texts 'ZU' and 'AUF': use 'XV104.STAT == AUF' or 'XV104.STAT == ZU'\n"),
        (["ZU", "Bad", "ZU"], ["--trigger", "XV104.STAT > 0.5"], "the column has the text 'ZU': use 'XV104.STAT == ZU'\n"),
        (["ZU", "ZU", "AUF"], channel, "line 2, column 'XV104.STAT': 'ZU' found, a number needed; the column has the "
         "texts 'ZU' and 'AUF' and no numbers: replace them by numbers, such as 0 and 1\n"),
        (["A", "B", "C"], channel, "the texts 'A', 'B' and 'C' and no numbers: replace them by numbers, such as 0, 1 and 2\n"),
        (["A", "B", "C", "D", "E"], channel, "the column has many texts and no numbers, so it can't be a channel\n"),
        (["ZU", "ZU"], channel, "the column has the text 'ZU' and no numbers: replace this text by a number, or state "
         "--missing 'ZU' if it stands for a missing sample\n"),
        # Single words among numbers, above or below them, may stand for missing samples.
        (["1", "ZU", "AUF"], channel, "'ZU' found, a number needed; --missing 'ZU' reads it as a missing sample\n"),
        (["ZU", "AUF", "1"], channel, "'ZU' found, a number needed; --missing 'ZU' reads it as a missing sample\n"),
        (["1.2.3", "4.5.6"], channel, "'1.2.3' found, a number needed\n"),
    ]:
        message = tokid("info", write(path, valve(states)), *options, status=2).stderr
        assert part in " ".join(message.split()) + "\n", message
        assert ("--missing" in message) == ("--missing" in part)
    # The advice holds.
    data, _ = read(tokid, tmp_path, write(path, valve(["ZU", "ZU", "AUF"])), "--trigger", "XV104.STAT == AUF")
    assert data["u"][0, 0, 0] == 2


@pytest.mark.parametrize("text, options, parts", [
    ("Valve [%],T [degC]\n1,2\n", [], ["no column whose name begins with u found among 'Valve [%]', 'T [degC]'",
                                      "--inputs 'A,B' --outputs 'C,D'"]),
    ("t,u,y\n0,1.5,2\n1,2.5,3,4\n", [], ["line 3: 4 cells found, 3 needed; '4' after the last column 'y'"]),
    ("t;u;y\n0;1.5;2\n1;2,5;3\n", [], ["line 3, column 'u': '2,5' found, but '1.5' in line 2; the same decimal mark"]),
    ("0,1.5,2\n1,2.5,3\n", [], ["line 1: samples found, but no line above them names the columns"]),
    ("time;u;y\n27.11.2026 13:00:00;1;2\nsoon;1;2\n", [],
     ["line 3, column 'time': 'soon' found, a time stamp like '27.11.2026 13:00:00' needed"]),
    ("t;u;y\n13/04/2026 01:00;1;2\n04/13/2026 01:00;1;2\n", [],
     ["line 2, '13/04/2026 01:00': the first number can only be the day, but in line 3"]),
    ("t [s],u,y\n0,1,2\n1,2,3\n", ["--trigger", "u>5"], ["trigger 'u>5': it holds at no row of any experiment; the column has numbers from 1 to 2, a condition"]),
    ("t [s],u,y,v\n0,1,2,ZU\n1,2,3,AUF\n", ["--trigger", "v == OPEN"],
     ["it holds at no row of any experiment; the column has the texts 'ZU' and 'AUF', a condition that holds somewhere"]),
    ("t [s],u,y,v\n0,1,2,Bad\n1,2,3,\n", ["--trigger", "v > 0"], ["the column has only missing samples, a condition"]),
    ("t [s],u,y\n0,1,2\n1,2,3\n", ["--held", "u"], ["held: no resample found"]),
    ("t [s],u,y,v\n0,1,2,3\n1,2,3,4\n", ["--held", "v", "--resample", "1"],
     ["held: column 'v' found, which is neither an input nor an output"]),
    ("t [s],u,y\n0,1,2\n1,2,3\n", ["--experiment-column", "run"], ["no column 'run' found among 't [s]', 'u', 'y'"]),
    ("t [s],u,y\n0,1,2\n1,2,3\n", ["--experiment-column", "t [s]", "--time", "t [s]"],
     ["column 't [s]' is stated as times and as names of experiments"]),
    ("t [s],u,y\n0,1,2\n1,2,3\n", ["--experiment-column", "u", "--inputs", "u"],
     ["column 'u' is stated as names of experiments and as a channel"]),
    ("t [s],u,y\n0,1,2\n1,2,3\n", ["--trigger", "valve>5"], ["no column 'valve' found among 't [s]', 'u', 'y'"]),
    ("t [s],u,y\n0,1,2\n1,2,3\n", ["--trigger", "valve"], ["trigger: 'valve' found, a column, one of > >= < <= == !="]),
    ("t [s],u,y\n0,1,2\n1,2,3\n", ["--before", "3"], ["before: no trigger found"]),
    ("k,u,y\n0,1,2\n1,2,3\n", ["--resample", "0.5"], ["resample: no column of times found"]),
    ("t [s],p [bar],y\n0,1,2\n1,2,3\n", ["--inputs", "p [mbar]"],
     ["column 'p [bar]' found, 'p [mbar]' needed: the units differ"]),
])
def test_bad_tables(tokid, tmp_path, text, options, parts):
    message = tokid("info", write(tmp_path / "data.csv", text), *options, status=2).stderr
    for part in parts:
        assert part in message


def test_utf16_is_refused_with_advice(tokid, tmp_path):
    message = tokid("info", write(tmp_path / "data.csv", "t,u,y\n0,1,2\n", "utf-16"), status=2).stderr
    assert "UTF-16 found, UTF-8 needed. Save the table as 'CSV UTF-8'" in message


def test_files_that_differ_are_named(tokid, tmp_path):
    folder = tmp_path / "runs"
    folder.mkdir()
    write(folder / "run1.csv", "t [s],u,p [bar],y\n0,1,2,3\n1,2,3,4\n")
    arguments = ["--inputs", "u", "--outputs", "p,y"]
    for text, part in [("t [s],u,y\n0,1,2\n", "no column 'p [bar]' found among 't [s]', 'u', 'y'"),
                       ("t [s],u,p [mbar],y\n0,1,2,3\n", "column 'p [mbar]' found, 'p [bar]' needed: the units differ"),
                       ("u,y,p [bar]\n0,1,2\n", "no column of times or step numbers found, but column 't [s]' of times "
                                                "in 'run1.csv'"),
                       ("t [s],u,p [bar],y\n0,1,oops,3\n", "line 2, column 'p [bar]': 'oops' found, a number needed")]:
        write(folder / "run2.csv", text)
        message = tokid("info", folder, *arguments, status=2).stderr
        assert "run2.csv: " in message and part in message
    write(folder / "run2.csv", "t [s],u,y,y2,p [bar]\n0,1,2,3,4\n1,2,3,4,5\n")
    message = tokid("info", folder, status=2).stderr
    assert "run2.csv: column 'y2' found, which 'run1.csv' does not have" in message
    data, _ = read(tokid, tmp_path, folder, *arguments)
    np.testing.assert_array_equal(data["y"][1], [[4, 2], [5, 3]])  # by name
    write(folder / "run2.csv", "t [s],u,p [bar],y\n0,1,2,3\n1,2,3,4\n2.5,2,3,4\n3,1,1,1\n")
    message = tokid("info", folder, *arguments, status=2).stderr
    assert "run2.csv, line" in message and "resample to even times (option resample)" in message
    assert "a directory without any .csv found" in tokid("info", tmp_path, status=2).stderr
    assert "no file matches this pattern" in tokid("info", tmp_path / "x*.csv", status=2).stderr


def test_trigger(tokid, tmp_path):
    folder = tmp_path / "runs"
    folder.mkdir()
    for run, start in (("a", 3), ("b", 5)):
        valve = [1.0 if k >= start else 0.0 for k in range(10)]
        phase = ["idle" if k < start else "heat" for k in range(10)]
        write(folder / f"{run}.csv", "t [s],u,y,valve,phase\n" + "".join(
            f"{100 + k},{k - start},{10 * (k - start)},{valve[k]},{phase[k]}\n" for k in range(10)))
    write(folder / "c.csv", "t [s],u,y,valve,phase\n0,1,2,0,idle\n1,1,2,0,idle\n")
    for condition in ("valve>0.5", "phase == heat"):
        data, warnings = read(tokid, tmp_path, folder, "--trigger", condition)
        assert list(data["experiment_names"]) == ["a", "b"]
        assert f"trigger '{condition}': this condition never holds in experiment 'c', so this experiment was dropped" in warnings
        np.testing.assert_array_equal(data["u"][0, :, 0], range(7))
        np.testing.assert_array_equal(data["u"][1, :5, 0], range(5))
        assert list(data["length"]) == [7, 5]
    data, _ = read(tokid, tmp_path, folder, "--trigger", "valve>0.5", "--before", "4")
    np.testing.assert_array_equal(data["u"][0, :, 0], [np.nan, -3, -2, -1, 0, 1, 2, 3, 4, 5, 6])
    np.testing.assert_array_equal(data["u"][1, :9, 0], range(-4, 5))


def test_trigger_that_holds_at_the_first_row(tokid, tmp_path):
    folder = tmp_path / "runs"
    folder.mkdir()
    for run, valve in {"a": [0, 0, 1, 1, 1, 0], "b": [1, 1, 0, 1, 1, 0], "c": [1, 1, 1, 0, 0, 0],
                       "d": ["", "Bad", 1, 1, 1, 0]}.items():
        write(folder / f"{run}.csv", "t [s],u,y,valve\n" + "".join(f"{k},{k},2,{v}\n" for k, v in enumerate(valve)))
    data, warnings = read(tokid, tmp_path, folder, "--trigger", "valve > 0.5")
    np.testing.assert_array_equal(data["u"][:, 0, 0], [2, 3, 0, 2])
    assert "so the event may be earlier. The first row became step 0\n" in warnings.replace("\n  ", " ")
    assert "this condition already holds at the first row of experiment 'b'. Step 0 is the row at which the condition begins to hold again" in warnings
    assert "this condition already holds at the first row of experiments 'c', 'd', so the event may be earlier" in warnings
    data, warnings = read(tokid, tmp_path, folder, "--trigger", "valve > 0.5", "--before", "2")
    np.testing.assert_array_equal(data["u"][:, 2, 0], [2, 3, 0, 2])
    assert "The first row became step 2\n" in warnings.replace("\n  ", " ")  # experiment d has rows before it
    assert "Step 2 is the row at which the condition begins to hold again" in warnings
    (folder / "d.csv").unlink()
    for before, absent in (("1", "step 1, and step 0 is missing"), ("2", "step 2, and steps 0 to 1 are missing")):
        _, warnings = read(tokid, tmp_path, folder, "--trigger", "valve > 0.5", "--before", before)
        assert f"The first row became {absent}" in warnings


def test_missing_words_fulfil_no_trigger(tokid, tmp_path):
    phases = ["Bad", "idle", "I/O Timeout", "out", "heat", "heat"]
    text = "t [s],u,y,phase\n" + "".join(f"{k},{k},2,{phase}\n" for k, phase in enumerate(phases))
    path = write(tmp_path / "data.csv", text)
    data, warnings = read(tokid, tmp_path, path, "--trigger", "phase != idle", "--missing", "out")
    assert data["u"][0, 0, 0] == 4
    assert "2 cells with 'Bad', 'I/O Timeout' were read as missing samples" in warnings
    data, _ = read(tokid, tmp_path, path, "--trigger", "phase == 'I/O Timeout'")
    assert data["u"][0, 0, 0] == 2


def test_resampling(tokid, tmp_path):
    rng = np.random.default_rng(5)
    t = np.arange(0, 10.01, 0.05) + np.append(0, rng.uniform(-0.02, 0.02, 200))
    t = t[(t < 4) | (t > 6)]
    path = write(tmp_path / "data.csv", "t [s],u,y\n" + "".join(f"{v!r},{2 * v!r},{v * v!r}\n" for v in map(float, t)))
    assert "resample to even times (option resample)" in tokid("info", path, status=2).stderr
    data, warnings = read(tokid, tmp_path, path, "--resample", "0.05")
    u = data["u"][0, :, 0]
    grid = 0.05 * np.arange(len(u))
    gap = np.isnan(u)
    assert gap[81:120].all() and not gap[:79].any() and not gap[122:].any()  # not interpolated across the gap
    np.testing.assert_allclose(u[~gap], 2 * grid[~gap], rtol=0, atol=1e-12)  # linear data, linear interpolation
    assert "interpolation makes the noise of neighbouring steps correlated" in warnings and "because their gap is longer" in warnings
    data, warnings = read(tokid, tmp_path, path, "--resample", "0.5", "--resample-method", "mean")
    inside = (t >= 0.75) & (t < 1.25)
    np.testing.assert_allclose(data["y"][0, 2, 0], np.mean(t[inside] ** 2), rtol=1e-12)
    assert "reduce the standard deviation of the noise" in warnings
    data, _ = read(tokid, tmp_path, path, "--resample", "0.5", "--resample-method", "previous")
    np.testing.assert_array_equal(data["u"][0, 2, 0], 2 * t[t <= 1.0][-1])


def test_only_some_files_are_resampled(tokid, tmp_path):
    folder = tmp_path / "runs"
    folder.mkdir()
    even, late = 60.0 * np.arange(20), 60.0 * np.arange(20) + 7 * (np.arange(20) % 2)
    for run, own in {"a": even, "b": late, "c": late, "d": even, "e": even}.items():
        write(folder / f"{run}.csv", "t [s],u,y\n" + "".join(f"{v:g},{v:g},2\n" for v in own))
    message = tokid("info", folder, status=2).stderr
    assert re.search(r"[bc]\.csv, line 3, column 't \[s\]': 67 found", message) and "1 more file has uneven times, too" in message
    _, warnings = read(tokid, tmp_path, folder, "--resample", "60")
    assert "'b.csv' and 1 more: the samples were resampled from about 67 s to 60 s by the method linear" in warnings
    assert "The samples of the other 3 files already lie at these steps and stay as they are" in warnings
    (folder / "b.csv").unlink(), (folder / "c.csv").unlink()
    data, warnings = read(tokid, tmp_path, folder, "--resample", "60")
    assert "all samples already lie at even steps of 60 s, so resampling changed nothing" in warnings
    np.testing.assert_array_equal(data["u"][0, :, 0], even)
    # A missing sample that is filled is a change.
    write(folder / "a.csv", (folder / "a.csv").read_text().replace("\n120,120,", "\n120,,"))
    data, warnings = read(tokid, tmp_path, folder, "--resample", "60")
    assert "'a.csv': the samples were resampled" in warnings and data["u"][0, 2, 0] == 120


def test_uneven_times_are_resampled_first(tokid, tmp_path):
    path = tmp_path / "data.csv"
    message = tokid("info", write(path, times([0, 60, 97, 180, 240, 300, 360, 420, 480])), status=2).stderr
    assert "even steps of 60 that begin at 0; resample to even times (option resample), or number" in message
    message = tokid("info", write(path, times(["0.0", "0.3", "0.5", "0.8", "1.0"])), status=2).stderr
    assert "(option resample), state '# dt = \u2026' above the header if the times are even but rounded, or" in message


def test_repeated_times(tokid, tmp_path):
    folder = tmp_path / "runs"
    folder.mkdir()
    repeated = [0, 1, 1, 1, 2, 3]
    text = "t [s],u,y\n" + "".join(f"{v},{k},2\n" for k, v in enumerate(repeated))
    write(folder / "a.csv", text)
    write(folder / "b.csv", times(range(4), "t [s]"))
    assert "a second row for step 1" in tokid("info", folder, status=2).stderr
    for method, value, kept in [("linear", 2, "the samples of each time were replaced by their mean"),
                                ("mean", 2, "the samples of each time were replaced by their mean"),
                                ("previous", 3, "the last sample of each time was used")]:
        data, warnings = read(tokid, tmp_path, folder, "--resample", "1", "--resample-method", method)
        assert data["u"][0, 1, 0] == value
        assert f"'a.csv': 2 rows have the time of an earlier row, so {kept}. Check whether" in warnings
    data, warnings = read(tokid, tmp_path, folder, "--resample", "1", "--held", "u")
    assert data["u"][0, 1, 0] == 3 and "and those of held channels by the last" in warnings


def test_held_channels(tokid, tmp_path):
    # The valve v opens between 9.9 s and 10.9 s; the temperature rises linearly.
    t = np.arange(60) + 0.9
    t[0] = 0
    text = "t [s],v,T\n" + "".join(f"{s:g},{39.7 * (s > 10)},{2 * s:g}\n" for s in t)
    path = write(tmp_path / "data.csv", text)
    columns = ["--inputs", "v", "--outputs", "T", "--resample", "1"]
    data, warnings = read(tokid, tmp_path, path, *columns)
    assert 0 < data["u"][0, 10, 0] < 39.7
    assert "channel 'v' changes at few samples, and these changes were interpolated. If it holds its value until the next sample, state it as held (option held)" in warnings
    data, warnings = read(tokid, tmp_path, path, *columns, "--held", "v")
    np.testing.assert_array_equal(data["u"][0, :, 0], 39.7 * (np.arange(60) > 10))
    np.testing.assert_allclose(data["y"][0, :, 0], 2 * np.arange(60), rtol=0, atol=1e-12)
    assert "The held channel 'v' repeats the last sample, which is up to 1 s old" in warnings
    assert "interpolation makes the noise of neighbouring steps correlated" in warnings and "option held" not in warnings
    both, warnings = read(tokid, tmp_path, path, *columns, "--held", "v,T")
    previous, _ = read(tokid, tmp_path, path, *columns, "--resample-method", "previous")
    np.testing.assert_array_equal(both["y"], previous["y"])
    assert "by the method previous" in warnings
    # Held channels fill long gaps, and the others do not.
    sparse = "t [s],v,T\n" + "".join(f"{k},{5 if k == 0 else ''},{'' if 3 < k < 20 else k}\n" for k in range(40))
    data, _ = read(tokid, tmp_path, write(path, sparse), *columns, "--held", "v")
    assert (data["u"] == 5).all() and np.isnan(data["y"][0, 4:20, 0]).all()
    data, warnings = read(tokid, tmp_path, path, *columns, "--held", "v", "--longest-gap", "2")
    assert np.isnan(data["u"][0, 3:, 0]).all()


def test_steps_much_shorter_than_the_distance_of_the_samples(tokid, tmp_path):
    path = write(tmp_path / "data.csv", times(60 * np.arange(10), "t [s]"))
    _, warnings = read(tokid, tmp_path, path, "--resample", "1")
    assert "the samples are about 60 s apart, so most of the 541 steps of 1 s have no sample of their own. A sample time of about 60 s is enough" in warnings
    assert "of their own" not in read(tokid, tmp_path, path, "--resample", "10")[1]


def test_columns_of_experiments(tokid, tmp_path):
    def table(title, blocks, stamp=lambda k: k):
        return f"t [s],u,y,{title}\n" + "".join(
            f"{stamp(k)},{n},{k},{name}\n" for n, name in enumerate(blocks) for k in range(4))

    path = tmp_path / "data.csv"
    def advice(title):
        return f"column '{title}' may name the experiments: state --experiment-column '{title}', or rename it to 'experiment'"

    for title, blocks, found in [("run", "ab", True), ("Batch no", "ab", True), ("Versuch", "12", True),
                                 ("rezept", "xy", True),  # it changes where the times begin anew
                                 ("rezept", "xyx", True), ("rezept", "xx", False), ("run", "xx", False),
                                 ("pressure", "xyy", False), ("run", "xyy", True)]:
        message = tokid("info", write(path, table(title, blocks)), status=2).stderr
        assert "line 6: a second row for step 0 found, one needed" in message
        assert (advice(title) in message) == found, (title, blocks, message)
    data, warnings = read(tokid, tmp_path, write(path, table("run", "ab")), "--experiment-column", "run")
    assert list(data["experiment_names"]) == ["a", "b"] and "not used" not in warnings
    np.testing.assert_array_equal(data["y"][:, :, 0], [range(4)] * 2)
    # A name that begins with u is no input, and the column 'experiment' is not needed.
    data, _ = read(tokid, tmp_path, write(path, table("unit,experiment", ["a,1", "b,1"])), "--experiment-column", "unit")
    assert data["u"].shape == (2, 4, 1)
    message = tokid("info", write(path, table("run", ["a", ""])), "--experiment-column", "run", status=2).stderr
    assert "line 6, column 'run': nothing found, a number or name needed" in message
    _, warnings = read(tokid, tmp_path, write(path, table("run", "ab")), "--resample", "1")
    assert "4 rows have the time of an earlier row" in warnings and advice("run") in warnings


def test_channels_that_are_logged_at_their_changes(tokid, tmp_path):
    # The set point u is logged at 0 s and at 50 s, y each second; the set point is valid up to the end.
    rows = [(k, {0: "5", 50: "7"}.get(k, ""), "" if k == 3 else str(k)) for k in range(101)]
    text = "t [s],u,y\n" + "".join(f"{k},{u},{y}\n" for k, u, y in rows)
    path = write(tmp_path / "data.csv", text)
    data, warnings = read(tokid, tmp_path, path, "--resample", "1", "--resample-method", "previous")
    np.testing.assert_array_equal(data["u"][0, :, 0], [5] * 50 + [7] * 51)
    assert data["y"][0, 3, 0] == 2 and "samples are up to 50 s old" in warnings and "missing" not in warnings
    data, warnings = read(tokid, tmp_path, path, "--resample", "1", "--resample-method", "previous",
                          "--longest-gap", "4")
    np.testing.assert_array_equal(np.flatnonzero(~np.isnan(data["u"][0, :, 0])), [0, *range(50, 55)])
    assert "95 samples stay missing, because their gap is longer than 4 s" in warnings
    late = write(tmp_path / "late.csv", text.replace("\n0,5,", "\n0,,"))
    _, warnings = read(tokid, tmp_path, late, "--resample", "1", "--resample-method", "previous")
    assert "50 samples stay missing before the first or after the last sample of the channel" in warnings
    assert "because their gap" not in warnings


def test_times_that_jitter_are_moved(tokid, tmp_path):
    rng = np.random.default_rng(3)
    t = np.arange(300) + rng.uniform(-1e-3, 1e-3, 300)
    text = "t [s],u,y\n" + "".join(f"{v:.6f},{k},2\n" for k, v in enumerate(t))
    path = write(tmp_path / "data.csv", text)
    refused = tokid("info", path, status=2).stderr
    assert "move the times to even steps of 1 s (option dt), resample to even times" in refused
    assert "# dt" not in refused  # this would not help
    data, warnings = read(tokid, tmp_path, path, "--dt", "1")
    assert data["dt"] == 1
    np.testing.assert_array_equal(data["u"][0, :, 0], range(300))
    assert "times were moved by up to 0.000999 s to even steps of 1 s, as the option dt states" in warnings
    write(path, text + "300.2,300,2\n")
    message = tokid("info", path, "--dt", "1", status=2).stderr
    assert "line 302, column 't [s]': 300.2 found, which lies more than a tenth of a step beside" in message
    assert "'dt = 0.5' found, but all rows" in tokid("info", write(path, text), "--dt", "0.5", status=2).stderr
    message = tokid("info", path, "--dt", "1", "--resample", "1", status=2).stderr
    assert "dt: a sample time found together with resample" in message
    rows = write(tmp_path / "rows.csv", "u,y\n1,2\n2,3\n")
    assert read(tokid, tmp_path, rows, "--dt", "0.25")[0]["dt"] == 0.25


def test_wide_tables(tokid, tmp_path):
    channels = 2000
    names = ["t [s]", "u", *(f"y{c} [m]" for c in range(channels))]
    text = ";".join(names) + "\n" + "".join(";".join(str(k + c) for c in range(channels + 2)) + "\n" for k in range(3))
    data, _ = read(tokid, tmp_path, write(tmp_path / "data.csv", text))
    assert data["y"].shape == (1, 3, channels)
    assert data["y"][0, 2, -1] == 2 + channels + 1


def test_options_of_csv_files_are_refused_for_others(tokid, tmp_path):
    npz = tmp_path / "data.npz"
    tokid("example", "oscillator", "-o", npz, "--experiments", "8", "--steps", "20")
    message = tokid("info", npz, "--trigger", "u1>0", status=2).stderr
    assert "trigger: this option is for .csv files only" in message
    for options in (["--held", "u1", "--resample", "1"], ["--experiment-column", "run"]):
        assert "this option is for .csv files only" in tokid("info", npz, *options, status=2).stderr
    message = tokid("info", npz, npz.parent / "x.csv", status=2).stderr
    assert "but several files must all be .csv" in message


def test_picture(tokid, plant, tmp_path):
    page = tmp_path / "picture.html"
    for locale, block in (("C.UTF-8", "\u2588"), ("C", "#")):
        lines = tokid("info", plant, *COLUMNS, "--picture", page, env={"LC_ALL": locale}).stdout.splitlines()
        drawn = next(line for line in lines if line.startswith("T [degC]"))
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
        for options in (["--picture", str(page)], ["--inputs", "valve"], ["--resample", "0.1"], ["--dates", "day-first"]):
            message = tokid("info", path, *options, status=2).stderr
            assert f"{found} found, an ensemble needed with the options {' '.join(options)}" in message
        assert not page.exists()
        tokid("info", path)


def test_the_first_missing_word_is_named(tokid, tmp_path):
    path = write(tmp_path / "data.csv", "t [s],u,y\n0,Fault,2\n1,Bad,2\n2,1,2\n")
    assert "2 cells with 'Bad', 'Fault' were read as missing samples. The first one is at line 2" in read(
        tokid, tmp_path, path)[1]


def test_ends_without_a_line_break_are_one_warning(tokid, tmp_path):
    folder = tmp_path / "runs"
    folder.mkdir()
    for n in range(4):
        write(folder / f"{n}.csv", f"t [s],u,y\n0,1,2\n1,2,{n}")
    warnings = read(tokid, tmp_path, folder)[1]
    assert warnings.count("line break") == 3 and warnings.count("warning: ") == 1
    assert "'0.csv': the last line 3 ends without" in warnings
    assert "; 3 more files end without a line break" in warnings


def test_one_file_by_two_names_and_subfolders(tokid, tmp_path):
    folder = tmp_path / "runs"
    (folder / "more").mkdir(parents=True)
    for path in (folder / "a.csv", folder / "more" / "b.csv"):
        write(path, "t [s],u,y\n0,1,2\n1,2,3\n")
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
        write(folder / f"e{n}.csv", "t [s],u with a rather long name,y\n" + "\n".join(cells) + "\n")
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
    lines = (folder / "batch4.csv").read_text().splitlines()
    hot = [",".join([*line.split(",")[:2], str(30 + 0.01 * k), line.split(",")[3]]) for k, line in enumerate(lines[3:])]
    write(folder / "batch4.csv", "\n".join(lines[:3] + hot) + "\n")
    shown = tokid("info", folder, *COLUMNS).stdout
    assert 'experiment "batch4" (row 3): T [degC] is' in shown
