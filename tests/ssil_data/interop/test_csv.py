"""CSV files are read, or refused with the line where they are wrong."""

from pathlib import Path

import pytest

from ssil_data.interop import Layout
from support.foreign_files import (
    csv_file,
    refuse,
    write_text,
)


def test_csv_lines_of_another_length_and_empty_cells_are_refused(tmp_path: Path):
    path = csv_file(tmp_path)
    lines = path.read_text().splitlines()
    write_text(path, "\n".join([*lines[:7], "1,2", *lines[8:]]))
    assert "expected 6 columns as in the header, found 2 in line 8" in refuse(path)
    write_text(path, "\n".join([*lines[:7], "1,,3,4,1,1", *lines[8:]]))
    assert "column 'y' has no value in line 8" in refuse(path)
    write_text(path, "\n".join([*lines[:7], "1,two,3,4,1,1", *lines[8:]]))
    assert "expected numbers in column 'y'" in refuse(path)
    write_text(path, "")
    refuse(path)


def test_the_broken_driving_log_is_refused_where_it_breaks(shared_data: Path):
    layout = Layout(state=("SPEED",), action=("STEERING",))
    message = refuse(shared_data / "torcs" / "aalborg.csv", layout)
    assert "expected 24 columns as in the header, found 25 in line 2" in message


@pytest.mark.parametrize(
    ("data", "line"),
    [
        (b"st\xe9ate,action\n1,2\n", 1),
        (b"state,action\n\xe9,2\n", 2),
        (b"state,action\n1,2\n1,2,\xe9\n", 3),
    ],
)
def test_csv_that_is_not_utf8_is_refused_with_its_line(tmp_path: Path, data: bytes, line: int):
    (tmp_path / "latin.csv").write_bytes(data)
    message = refuse(tmp_path / "latin.csv", Layout())
    assert f"expected UTF-8 text, found byte 0xe9 in line {line}" in message


def test_a_csv_without_column_names_is_refused(tmp_path: Path):
    message = refuse(write_text(tmp_path / "bare.csv", "1.5,2\n3,4\n"))
    assert "expected a line of column names, found numbers 1.5, 2" in message


def test_the_cell_that_is_no_number_is_named(tmp_path: Path):
    path = write_text(tmp_path / "t.csv", "x,a\n1,1\n2,1\nabc,1\n")
    message = refuse(path, Layout(state=("x",), action=("a",)))
    assert "expected numbers in column 'x', found 'abc' at row 2" in message
