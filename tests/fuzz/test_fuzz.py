"""Damaged files and mutated scenarios give what is meant or a line: few here, thousands by the modules' commands."""

from collections.abc import Iterable

import pytest

from tests.fuzz.files import Damaging
from tests.fuzz.formats import FORMATS
from tests.fuzz.scenarios import Fuzzing
from tests.fuzz.watched import Outcome, reported

pytestmark = pytest.mark.slow

DAMAGED = 120
MUTANTS = 500
RUN = 25.0  # s of wall time


def faults(outcomes: Iterable[tuple[str, Outcome]], meant: set[str]) -> str:
    """What is wrong with outcomes, among which are those that are meant."""
    found = list(outcomes)
    assert {outcome.kind for _, outcome in found} >= meant
    return "\n".join(reported(found)) if any(not outcome.good for _, outcome in found) else ""


@pytest.fixture(scope="module")
def damaging(tmp_path_factory):
    fuzzing = Damaging(tmp_path_factory.mktemp("files"), seed=3)
    yield fuzzing
    fuzzing.worker.close()


@pytest.mark.parametrize("name", sorted(FORMATS))
def test_damaged_files_are_read_or_refused_with_a_line(damaging, name):
    assert faults(damaging.outcomes(name, range(DAMAGED)), {"refused"}) == ""


def test_mutants_load_or_are_refused_and_those_accepted_run(tmp_path):
    fuzzing = Fuzzing(tmp_path, seed=4)
    accepted: list[int] = []
    assert faults(fuzzing.loaded(range(MUTANTS), accepted), {"accepted", "refused"}) == ""
    assert faults(fuzzing.run(accepted, RUN), {"accepted"}) == ""
