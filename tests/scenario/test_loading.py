import pytest
import yaml

from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.files.run_folder import to_yaml
from taichi_plume.guard import yaml_text
from taichi_plume.scenario.loading import MOST_LINES, ScenarioError
from taichi_plume.scenario.obstacles import Box
from taichi_plume.scenario.openings import Fan
from taichi_plume.scenario.windows import Region
from taichi_plume.scenario.winds import CfdWind

GOOD = """\
duration: 10
domain: {size: [4, 3], spacing: 5 cm}
wind:
  kind: cfd
  openings:
    - {kind: fan, face: x-, center: [1.5], diameter: 0.4, speed: 0.5}
    - {kind: outlet, face: x+}
obstacles:
  - {kind: box, center: [2, 1], size: [0.4, 0.3]}
gas:
  kind: eulerian
  sources: [{position: [1, 1.5], rate: 1e-5}]
robots:
  - {count: 1, start: {kind: positions, positions: [[1, 1]]}, algorithm: {kind: casting}}
"""
OBSTACLES = "obstacles:\n  - {kind: box, center: [2, 1], size: [0.4, 0.3]}\n"


def load(tmp_path, text, *overrides):
    path = tmp_path / "s.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_scenario(path, overrides)


def fault(tmp_path, text, *overrides):
    """The one line that is said about a faulty file, without the file's name."""
    with pytest.raises(ScenarioError) as caught:
        load(tmp_path, text, *overrides)
    assert len(caught.value.lines) == 1
    assert str(caught.value) == caught.value.lines[0]
    assert "\n" not in str(caught.value)
    return str(caught.value).removeprefix(f"{tmp_path / 's.yaml'}: ")


def test_several_faults_make_several_lines(tmp_path):
    with pytest.raises(ScenarioError) as caught:
        load(tmp_path, GOOD, "seed=-1", "tick=0", "wind.openings.0.speed=fast")
    assert all(line.startswith(f"{tmp_path / 's.yaml'}: ") for line in caught.value.lines)
    assert [line.split(": ")[1] for line in caught.value.lines] == ["seed", "tick", "wind.openings[0].speed"]
    many = "[" + "{kind: outlet, face: up}, " * 100 + "]"
    with pytest.raises(ScenarioError) as caught:
        load(tmp_path, GOOD, f"wind.openings={many}")
    assert len(caught.value.lines) == MOST_LINES + 1
    assert caught.value.lines[-1] == f"... and {100 - MOST_LINES} more"


BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 10)}]\n"
    for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)
NESTS = "".join(f"{of[0]}: &{of[0]} [[[[[[[[[[{of[1:]}]]]]]]]]]]\n" for of in ("a1", "b*a", "c*b", "d*c"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("# nothing\n", "is empty"),
        ("- 1\n- 2\n", "must be a mapping (key: value), got [1, 2]"),
        ("duration: [1, 2\nwind: 3\n", "line 2, column 5: not YAML: "),
        ("a: \x01", "line 1: not YAML: "),
        ("duration: !!bool 3", "line 1, column 11: '3' is no bool"),
        ("duration: !!int ''", "line 1, column 11: '' is no int"),
        ("a: 1\nb:\n\tc: 2\n", "line 3, column 1: indent with spaces, not tabs"),
        (
            "a: 1\nb: see: there\n",
            "line 2, column 7: not YAML: mapping values are not allowed here; check the indentation, or quote "
            "a text that contains ': '",
        ),
        ("a: 2024-13-45", "line 1, column 4: 2024-13-45 is a date; put it in quotes"),
        ("a: !!python/object:os.system x", "line 1, column 4: !!python/object:os.system is not taken"),
        ("a: 1\n---\nb: 1\n", "line 2, column 1: not YAML: a second document begins"),
        ("[" * 100_000, "line 1, column 33: is nested too deeply"),
        (f"{GOOD}duration: 3\n", "line 15, column 1: duplicate key 'duration', first on line 1; remove one"),
        ("wind: {kind: cfd, kind: cfd}", "line 1, column 19: duplicate key 'kind'"),
        ("a: &a [*a]", "line 1, column 4: an alias contains itself"),
        (BOMB, "line 5, column 4: aliases expand to more than 100,000 values"),
        (b"name: \xff\xfe", "line 1: is not UTF-8 text"),
        ("#" * yaml_text.LARGEST_FILE + "\n", "is larger than 4 MiB"),
        (f"a: {'9' * 6000}", "line 1, column 4: a number of 6,000 characters; at most 1,000 are taken"),
        ("a: !!binary aGFsbG8=", "line 1, column 4: !!binary is not taken"),
        ("a: !!set {b, c}", "line 1, column 4: !!set is not taken"),
        (f"a: {'[' * 300}{']' * 300}", "line 1, column 35: is nested too deeply, more than 32 levels"),
        (NESTS, "line 4, column 15: aliases nest it too deeply, more than 32 levels"),
        (r'"\ud800": 1', r"line 1, column 1: has the character \ud800, which does not print"),
        (r'name: "\e[31m"', r"line 1, column 7: has the character \x1b, which does not print"),
        ('name: "a\u202eb"', r"line 1, column 7: has the character \u202e, which does not print"),
        ("1: 2", "line 1, column 1: a key must be a text; put it in quotes"),
        (
            "name: a\nbase: b.yaml\naxes: {}",
            "is a study, no scenario; python -m taichi_plume.study makes its runs",
        ),
        ("{[a]: 2}", "line 1, column 2: a key must be a text"),
        (f"a: '{'x' * 20_000}'", "line 1, column 4: a text of 20,000 characters; at most 10,000 are taken"),
        (
            f"a: &a '{'x' * 5000}'\nb: [{'*a, ' * 500}]",
            "line 2, column 4: aliases expand to more than 100,000",
        ),
        (f"? {'k' * 5000}\n: 1", f"unknown key '{'k' * 62} ... {'k' * 33}'; allowed: name, seed"),
    ],
    ids=range(33),
)
def test_files_that_are_no_scenario(tmp_path, text, said):
    assert fault(tmp_path, text).startswith(said)


def test_reading_ends_where_there_are_too_many_values(tmp_path, monkeypatch):
    monkeypatch.setattr(yaml_text, "MOST_VALUES", 50)
    assert fault(tmp_path, f"a: [{'1, ' * 60}'").startswith("line 1, column 146: has more than 50 values")


def test_what_is_said_prints_and_is_short(tmp_path):
    """Also where a fault shows what was got."""
    for text in (f"name: {'n' * 9000}", f"wind: {{kind: {'k' * 9000}}}", f"duration: '{'9' * 9000} s'"):
        with pytest.raises(ScenarioError) as caught:
            load(tmp_path, text)
        assert all(line.isprintable() and len(line) <= 1000 for line in caught.value.lines)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        (f"robots.{'9' * 6000}.count=1", "override 'robots.9999"),
        (f"{'a.' * 5000}a=1", "override 'a.a.a"),
        ("name=\ud800", r"override 'name=\ud800': line 1: not YAML"),
        ("na\x1b[31mme=1", r"unknown key 'na\x1b[31mme'"),
        ('name="\\e"', r"""override 'name="\e"': line 1, column 1: has the character \x1b"""),
        (f"name={'9' * 6000}", "override 'name=99999"),
        (f"gas.sources.0.rate=1{'0' * 400}", "gas.sources[0].rate: got 10000000000"),
    ],
)
def test_overrides_that_are_none(tmp_path, override, said):
    reported = fault(tmp_path, GOOD, override)
    assert reported.startswith(said)
    assert reported.isprintable()
    assert len(reported) <= 1000


def test_what_is_written_out_can_be_read_again(tmp_path):
    """Or is refused at once: 50,000 aliases of one obstacle took more than a minute, and were too much to read."""
    post = "{kind: cylinder, center: [1, 2], radius: 0.01}"
    few, many = (
        f"{GOOD.replace(OBSTACLES, '')}obstacles:\n- &a {post}\n{n * '- *a'}\n".replace("- *a", "- *a\n")
        for n in (2000, 11_000)
    )
    again = tmp_path / "again.yaml"
    again.write_text(to_yaml(load(tmp_path, few)))
    assert len(load_scenario(again).obstacles) == 2001
    assert "values with all defaults written out, at most 100,000 are allowed" in fault(tmp_path, many)


def test_missing_files_and_folders(tmp_path):
    for path in (tmp_path, tmp_path / "none.yaml"):
        with pytest.raises(ScenarioError, match=r"cannot be read: \w") as caught:
            load_scenario(path)
        assert str(caught.value).startswith(f"{path}: ")


def test_anchors_and_merges_work(tmp_path):
    text = GOOD.replace(
        "{kind: outlet, face: x+}", "{<<: &out {kind: outlet}, face: x+}\n    - {<<: *out, face: y+}"
    )
    wind = load(tmp_path, text).wind
    assert isinstance(wind, CfdWind)
    assert [opening.face for opening in wind.openings if isinstance(opening, Region)] == ["x-", "x+", "y+"]
    assert load(tmp_path, "\ufeff" + GOOD).duration == 10


def test_overrides_set_values(tmp_path):
    scenario = load(tmp_path, GOOD)
    assert isinstance(scenario.wind, CfdWind)
    assert isinstance(scenario.wind.openings[0], Fan)
    assert (scenario.domain.spacing, scenario.gas.sources[0].rate) == (0.05, 1e-5)
    scenario = load(tmp_path, GOOD, "duration=20 s", "robots.0.trials=3", "obstacles[0].yaw_deg=45")
    assert (scenario.duration, scenario.robots[0].trials) == (20.0, 3)
    assert isinstance(scenario.obstacles[0], Box)
    assert scenario.obstacles[0].yaw_deg == 45.0
    scenario = load(tmp_path, GOOD, "recording.rate=2", "robots.0.sensors.wind.kind=thermal", "obstacles=[]")
    assert scenario.recording.rate == 2
    assert scenario.robots[0].sensors.wind.kind == "thermal"
    assert scenario.obstacles == ()


def test_an_override_changes_one_place_of_an_aliased_section(tmp_path):
    data = yaml.safe_load(GOOD)
    data["gas"]["sources"] *= 2  # dumped as an anchor and an alias
    text = yaml.safe_dump(data)
    assert "*id001" in text
    assert [s.rate for s in load(tmp_path, text, "gas.sources.1.rate=0.2").gas.sources] == [1e-5, 0.2]
