"""Texts and names of the source keep the rules of wording: `python -m tests.wording` lists what breaks them."""

from tests.wording import Text, faults, files, texts

EXCEPTIONS = {
    ("taichi_plume/files/ros_messages.py", "noses"),  # a field of the messages
    ("taichi_plume/scenario/policy.py", "noses"),  # a value of `observe`
    ("taichi_plume/scenario/sensors.py", "noses"),
    ("taichi_plume/scenario/suggestions.py", "nose"),  # words of users
    ("taichi_plume/scenario/suggestions.py", "noses"),
    ("taichi_plume/grid/polygons.py", "ears"),  # of ear clipping
    ("taichi_plume/record/tracks.py", "said"),  # an attribute that checkpoints name
}
"""File and word of the exceptions."""


def test_texts_and_names_keep_the_rules():
    read = [text for path in files() for text in texts(path)]
    assert sum(text.kind == "message" for text in read) > 1000
    broken = [
        f"{text.file}:{text.line}: {text.kind}: {fault}"
        for text in read
        for fault in faults(text)
        if (text.file, fault) not in EXCEPTIONS
    ]
    assert broken == []


def test_faults_are_found():
    assert faults(Text("a.py", 1, "docstring", "What the robot is told.")) == ["told", "begins with 'What'"]
    assert faults(Text("a.py", 1, "docstring", "Return " + "long " * 45 + "text.")) == [
        "a sentence of 47 words"
    ]
    assert faults(Text("a.py", 1, "name", "_told")) == ["_told"]
    assert faults(Text("a.py", 1, "docstring", "Return the Courant number of the last step.")) == []
