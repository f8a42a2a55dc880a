"""Measured tips as CSV: what is written is read, and what cannot be read is named by line and column."""

from __future__ import annotations

import numpy as np
import pytest

from pieper.errors import ArrayError, DescriptionError
from pieper.kinematics.fk import fk
from pieper.kinematics.measurements import read_measurements, write_measurements
from tests.robots import chain

ARM = chain("ur5e")
Q = np.random.default_rng(0).uniform(-2.0, 2.0, (5, 6))


@pytest.mark.parametrize("positions_only", [False, True])
def test_what_is_written_is_read(tmp_path, positions_only):
    file = tmp_path / "m.csv"
    measured = fk(ARM, Q)[:, :3, 3] if positions_only else fk(ARM, Q)
    write_measurements(file, ARM, Q, measured)
    q, again = read_measurements(file, ARM)
    np.testing.assert_array_equal(q, Q)
    np.testing.assert_allclose(again, measured, atol=1e-15)


def test_numbered_columns_in_any_order_with_comments(tmp_path):
    file = tmp_path / "m.csv"
    file.write_text("\ufeff# a tracker\nz;y;x;note;q6;q5;q4;q3;q2;q1\n\n3;2;1;first;6;5;4;3;2;1\n", encoding="utf-8")
    q, p = read_measurements(file, ARM)
    np.testing.assert_array_equal(q, [[1, 2, 3, 4, 5, 6]])
    np.testing.assert_array_equal(p, [[1, 2, 3]])


def test_a_form_to_fill_in(tmp_path):
    file = tmp_path / "m.csv"
    write_measurements(file, ARM, Q)
    with pytest.raises(DescriptionError, match=r"line 2, column 'x': must be a finite number, got ''"):
        read_measurements(file, ARM)
    with pytest.raises(ArrayError, match="as many rows"):
        write_measurements(file, ARM, Q, np.zeros((4, 3)))


NAMED = "q1,q2,q3,q4,q5,q6,x,y,z"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "is empty; its first line must name the columns"),
        (NAMED + "\n", "holds no measurements"),
        ("q1,q2,x,y,z\n1,2,3,4,5\n", "no column for shoulder_pan_joint"),
        (NAMED.replace(",y", "") + "\n", "there must be one column 'y', got no column"),
        (NAMED + ",x\n", "there must be one column 'x', got 2 columns"),
        (NAMED + "\n0,0,0,0,0,0,1,2\n", "line 2: has 8 values for 9 columns"),
        (
            NAMED + "\n0,0,0,0,0,0,1,2,3\n0,0,0,nan,0,0,1,2,3\n",
            "line 3, column 'q4': must be a finite number, got 'nan'",
        ),
        (NAMED + ",qx,qy,qz,qw\n0,0,0,0,0,0,1,2,3,0,0,0,2\n", "line 2: qx qy qz qw must be of length 1, got length 2"),
        (NAMED + ",qx\n0,0,0,0,0,0,1,2,3,0\n", "there must be one column 'qy'"),
    ],
)
def test_what_cannot_be_read(tmp_path, text, complaint):
    file = tmp_path / "m.csv"
    file.write_text(text)
    with pytest.raises(DescriptionError) as caught:
        read_measurements(file, ARM)
    assert complaint in str(caught.value)


def test_a_file_that_is_no_text(tmp_path):
    file = tmp_path / "m.csv"
    file.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DescriptionError, match="is not text in UTF-8; save it as CSV in that encoding"):
        read_measurements(file, ARM)
