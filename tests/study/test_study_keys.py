"""Every key of a study is described, in the schema and by `--explain`."""

import json

import pytest

from taichi_plume.guard.input_error import InputError
from taichi_plume.scenario.facts import first_sentence
from taichi_plume.scenario.keys import all_keys, look_up, print_key, print_schema
from taichi_plume.study.model import Study


def test_the_schema_describes_every_key(capsys):
    assert print_schema(Study) == 0
    schema = json.loads(capsys.readouterr().out)
    sections = [schema, *schema["$defs"].values()]
    told = [one["description"] for section in sections for one in section["properties"].values()]
    assert len(told) == len(list(all_keys(Study))) >= 20
    for text in told:
        meaning = text.split("\n\n")[0]
        assert len(meaning.split()) >= 4
        assert len(first_sentence(meaning)) <= 115, meaning
        assert meaning[0].isupper()


def test_a_key_is_found_by_its_name_and_what_is_near_is_told(capsys):
    assert print_key("axes.values", Study) == 0
    assert capsys.readouterr().out.startswith("axes[].values\n  The values that the key takes")
    with pytest.raises(InputError, match="share_air"):
        print_key("shareair", Study)
    assert look_up("wind.openings.speed", Study) == ([], [])
