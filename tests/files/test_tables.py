"""Tables of text files: what is read, and which line is reported where one cannot be."""

import numpy as np
import pytest
from refusals import refused

from taichi_plume.files.tables import Table, TextFile, cells_of, delimiter_of, listed


def table(path, text: str | bytes, width: int = 3, **options) -> Table:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    file = TextFile(path, ValueError)
    return Table(file, file.rows(0), width, **options)


@pytest.mark.parametrize(
    ("text", "options"),
    [
        ("1,2,3\n4,5,6\n", {}),
        ('\ufeff# x,y,z\n\n 1, 2 ,+3.0\r\n\r\n4,5e0,"6"\n \n', {}),
        ("1;2;3\n4;5;6", {"delimiter": ";"}),
        ("  1 2\t 3\n4   5 6 \n", {"delimiter": None}),
        ("1,2,3\nNA,nan,\n4,5,6\n", {"gaps": True}),
    ],
)
def test_numbers_of_all_sorts(text, options, tmp_path):
    values = table(tmp_path / "a.csv", text, **options).numbers(0, 2)
    np.testing.assert_array_equal(values[~np.isnan(values[:, 0])], [[1, 3], [4, 6]])
    assert np.isnan(values).any() == ("gaps" in options)


def test_texts_and_no_rows(tmp_path):
    named = table(tmp_path / "a.csv", 'a,"b, c"\nd,\n', 2, gaps=True)
    assert named.texts(1).tolist() == ["b, c", None]
    assert Table(named.file, [], 2).numbers(0, 1).shape == (0, 2)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("1,2,3\n\n4,5\n", "line 3: has 2 columns, not 3; is the file whole?"),
        ("1,2,3\n# note\n4,,6\n", "line 3: '' is no number"),
        ("1,2,3\n4,5,1_0\n", "line 2: '1_0' is no number"),
        (f"1,2,3\n4,5,{'x' * 90}\n", f"line 2: '{'x' * 37}...' is no number"),
        ('1,2,3\n4,"5,6\n7,8,9\n', "line 2: has 2 columns, not 3"),
        ('1,2,3\n4,5,"6\n7,8,9\n', "line 2: '6' is no number"),
        ("1,2,3\n" * 300_000 + "4,5\n", "line 300001: has 2 columns"),
        ("1,2,3\n" * 300_000 + "4,5,q\n" + "1,2,3\n" * 9, "line 300001: 'q' is no number"),
        (b"1,2,3\n4,\x00,6\n", "line 2: is not plain text"),
        (" \n\n", "is empty"),
    ],
)  # fmt: skip
def test_the_line_at_fault_is_reported(text, fault, tmp_path):
    path = tmp_path / "a.csv"
    with refused(ValueError, path, f"{path}: {fault}"):
        table(path, text).numbers(0, 1, 2)


def test_what_a_row_has_to_be_is_reported_where_there_is_a_form(tmp_path):
    with pytest.raises(ValueError, match="line 2: must be a,b,c, got '4,q,6'"):
        table(tmp_path / "a.csv", "1,2,3\n4,q,6\n", form="a,b,c").numbers(0, 1)


def test_a_quotation_mark_does_not_take_in_lines(tmp_path):
    with pytest.raises(ValueError, match="line 2: a quotation mark is not closed"):
        table(tmp_path / "a.csv", '1,2,c\n4,5,"c\n7,8,c\n').texts(2)


def test_headers():
    assert delimiter_of("a;b;c,d") == ";"
    assert delimiter_of("a b") is None
    assert cells_of('a, "b,c" ,d ', ",") == ["a", "b,c", "d"]
    assert cells_of("  a  b\tc", None) == ["a", "b", "c"]
    assert len(listed(["x" * 70_000] * 99)) <= 400
