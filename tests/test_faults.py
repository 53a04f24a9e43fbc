"""The table of faults in docs/faults.md is what happens."""

import os

import faults
import pytest


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_the_table_of_faults_is_what_happens():
    assert faults.DOC.read_text() == faults.HEAD + faults.rows()
