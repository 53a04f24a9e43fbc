"""The environments as Gymnasium and PettingZoo see them; one engine is behind them all."""

import re
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import yaml
from gymnasium import wrappers
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode
from pettingzoo.test import parallel_api_test
from small_task import TASK, task

import taichi_plume as tp
import taichi_plume.envs
from taichi_plume.engine import program
from taichi_plume.envs import ID, parallel_env, picture
from taichi_plume.envs.step_kernel import INFO
from taichi_plume.envs.task import Options, open_task
from taichi_plume.envs.truth import KEYS

pytestmark = pytest.mark.usefixtures("taichi")

COUNT, STEPS = 3, 40
SEEDS = [11, 12, 13]


def act(observations: np.ndarray, size: int = 2) -> np.ndarray:
    """Some policy: what it does follows from what is observed alone, so that episodes can be compared."""
    count = observations.shape[-1]
    weights = np.random.default_rng(0).normal(size=(count, size))
    return np.tanh(observations @ weights + [0.5, 0.1]).astype(np.float32)


@pytest.fixture(scope="module")
def made():
    """Environments that tests share: a single one, and a vector, closed before one of another mode is made."""
    program.start("cpu")
    single = gymnasium.make(ID, scenario=TASK, render_mode="rgb_array", disable_env_checker=True)
    vectors: list[Any] = []

    def make(kind: str) -> Any:
        if kind == "single":
            return single
        if vectors and vectors[0].autoreset_mode.name.lower() != kind:
            vectors.pop().close()
        if not vectors or vectors[0].closed:
            vectors[:] = [
                gymnasium.make_vec(ID, num_envs=COUNT, scenario=TASK, autoreset_mode=kind, copy=True)
            ]
        return vectors[0]

    return make


def singly(env: Any, seed: int) -> list[tuple]:
    """Steps of a single environment: observation, reward, terminated, truncated, the next observation."""
    steps, (seen, _) = [], env.reset(seed=seed)
    while len(steps) < STEPS:
        after, reward, ended, late, _ = env.step(act(seen))
        steps.append((seen, reward, ended, late, after))
        seen = env.reset()[0] if ended or late else after
    return steps


def at_once(envs: Any, mode: str) -> list[list[tuple]]:
    """The same of each environment of a vector, however it begins episodes anew."""
    steps: list[list[tuple]] = [[] for _ in range(COUNT)]
    seen, _ = envs.reset(seed=SEEDS[0])
    over = np.zeros(COUNT, bool)
    while min(map(len, steps)) < STEPS:
        if mode == "disabled" and over.any():
            seen, _ = envs.reset(options={"reset_mask": over})
        begins = over if mode == "next_step" else np.zeros(COUNT, bool)
        after, rewards, ended, late, info = envs.step(act(seen))
        over = ended | late
        for e in np.flatnonzero(~begins):
            final = info["final_obs"][e] if mode == "same_step" and over[e] else after[e]
            steps[e].append((seen[e], rewards[e], ended[e], late[e], final))
        assert not (begins & over).any()
        assert (rewards[begins] == 0).all()
        expected = info.get("final_info", info)
        assert ("found" in expected) == over.any()
        if over.any():
            np.testing.assert_array_equal(expected["_found"], over)
            np.testing.assert_array_equal(expected["found"][over] == 1, ended[over])
        seen = after
    return steps


def assert_same(one: list[tuple], other: list[tuple]) -> None:
    """Two sequences of steps, to the bit, as far as both go."""
    assert min(len(one), len(other)) >= STEPS
    for a, b in zip(one, other, strict=False):
        for x, y in zip(a, b, strict=True):
            np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize("mode", ["next_step", "same_step", "disabled"])
@pytest.mark.slow
def test_single_environments_give_the_episodes_of_a_vector_in_every_autoreset_mode(made, mode):
    several = at_once(made(mode), mode)
    for seed, steps in zip(SEEDS, several, strict=True):
        alone = singly(made("single"), seed)
        assert_same(alone, steps)
        assert sum(ended or late for _, _, ended, late, _ in alone) >= 3, "several episodes were compared"
    assert any(ended for steps in several for _, _, ended, _, _ in steps), "some are found"
    assert not np.array_equal(several[0][0][0], several[1][0][0])


@pytest.mark.slow
def test_gymnasiums_checker_has_nothing_to_say(made):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(made("single").unwrapped)


@pytest.mark.slow
def test_the_registry_makes_the_vector_by_itself(made):
    envs = made("next_step")
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert envs.num_envs == COUNT
    assert envs.observation_space.shape == (COUNT, *envs.single_observation_space.shape)
    assert envs.observation_space.contains(envs.reset(seed=1)[0])
    taichi_plume.envs.register()  # as a plug-in does once more
    assert ID in gymnasium.registry


@pytest.mark.slow
def test_a_picture_shows_the_world(made):
    env = made("single")
    env.reset(seed=5)
    first = env.render()
    assert first.dtype == np.uint8
    assert first.shape == (240, 400, 3)
    engine = env.unwrapped.episodes
    x, y = np.array(engine.swarm.position[0]) / 2.0 * 400
    np.testing.assert_array_equal(first[239 - int(y), int(x)], picture.ROBOT)
    (place,) = engine.bank.sources[0][int(engine.info["source"][0])]
    x, y = place / 2.0 * 400
    np.testing.assert_array_equal(first[239 - int(y), int(x)], picture.SOURCE)
    for _ in range(3):
        env.step(np.array([1.0, 0.0], np.float32))
    assert (env.render() != first).any()


def test_the_last_observation_stays_valid_for_a_step(made):
    engine = made("same_step").unwrapped.episodes
    engine.reset(np.arange(COUNT, dtype=np.uint64))
    first = engine.observations
    before = first.copy()
    engine.step(act(first))
    np.testing.assert_array_equal(first, before)
    assert engine.observations is not first


@pytest.mark.parametrize(
    ("actions", "expected"),
    [
        (np.full((COUNT, 2), np.nan), "nan"),
        (np.full((COUNT, 2), 1.5), "1.5"),
        (np.zeros((COUNT, 3)), "shape"),
        (np.full((COUNT, 2), 1j), "an array of numbers: got complex128"),
        (np.full((COUNT, 2), "left"), "an array of numbers"),
        ([{}] * COUNT, "an array of numbers"),
    ],
)
def test_bad_actions_are_refused_in_a_line_and_nothing_moves(made, actions, expected):
    envs = made("same_step")
    envs.reset(seed=2)
    before = envs.unwrapped.episodes.swarm.position.to_numpy()
    with pytest.raises(ValueError, match=expected) as error:
        envs.step(actions)
    assert "\n" not in str(error.value)
    np.testing.assert_array_equal(envs.unwrapped.episodes.swarm.position.to_numpy(), before)
    single = made("single")
    single.reset(seed=2)
    with pytest.raises(ValueError, match=expected):
        single.step(actions[0])


def test_an_episode_that_is_over_has_to_be_reset(made):
    env = made("single")
    env.reset(seed=1)
    over = False
    while not over:
        _, _, ended, late, info = env.step(np.array([-1.0, 0.0], np.float32))
        over = ended or late
    assert late
    assert info["time_s"] == pytest.approx(env.unwrapped.episodes.most_steps * env.unwrapped.episodes.step_s)
    assert info["found"] == 0
    assert info["path_m"] == 0
    with pytest.raises(ValueError, match="its episode is over; reset it first"):
        env.step(np.zeros(2, np.float32))
    envs = made("disabled")
    envs.reset(seed=1)
    for mask in (np.zeros(COUNT, bool), np.ones(COUNT + 1, bool), np.ones(COUNT), [[True], [True, False]]):
        with pytest.raises(ValueError, match=r"reset_mask: .* 3 truth values"):
            envs.reset(options={"reset_mask": mask})


OPENINGS = [{"kind": "inlet", "face": "x-", "speed": 0.5}, {"kind": "outlet", "face": "x+"}]
MIXED = [
    {"kind": "eulerian", "species": "acetone", "sources": [{"position": [0.4, y, 0.1], "rate": "1 mg/s"}]}
    for y in (0.4, 0.8)
]
HEAVY = {
    "domain": {"size": [2.0, 1.2, 0.6], "spacing": 0.1},
    "wind": {"kind": "cfd", "openings": OPENINGS, "buoyancy": {"solutal": True}},
    "gas": {"kind": "mixture", "parts": MIXED},
}
PATH = {"path": [[2, 1.0, 0.4], [5, 1.0, 0.8]]}
WALKED = {
    "obstacles": [{"kind": "cylinder", "center": [1.0, 0.3], "radius": 0.1, "motion": PATH}],
    "wind": {"kind": "synthetic"},
    "gas": {"kind": "eulerian", "sources": [{"position": [0.4, 0.8], "rate": "1 mg/s"}]},
}


@pytest.mark.parametrize("overrides", [["task.airs=3"], {"task.airs": 3}])
def test_overrides_of_a_file_are_texts_or_a_dict(tmp_path, overrides):
    (tmp_path / "task.yaml").write_text(yaml.safe_dump(TASK))
    scenario, _ = open_task(tmp_path / "task.yaml", overrides)
    assert scenario.task.airs == 3


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"scenario": "nowhere.yaml"}, "nowhere.yaml"),
        ({"scenario": task(robots=[])}, "robots"),
        ({"scenario": task(robots=[TASK["robots"][0] | {"found": "declared"}])}, "never declares"),
        ({"scenario": task(**WALKED)}, r"obstacles\[0\]: moves"),
        ({"scenario": 3}, "scenario: got int"),
        ({"scenario": TASK, "render_mode": "ansi"}, "render_mode: got 'ansi'"),
        ({"scenario": TASK, "bank": "nowhere.zarr"}, "nowhere.zarr"),
        ({"scenario": TASK, "overrides": "task.airs=3"}, "overrides: got a text"),
        ({"scenario": task(**HEAVY)}, "task.sources: one: .* use sources: all"),
        ({"scenario": TASK, "overrides": ["task.airs=3"]}, "overrides: apply only to a scenario file"),
        ({"scenario": TASK, "truth": 1}, "truth: got 1, must be True or False"),
        ({"scenario": TASK, "reward": 3.0}, r"reward: got 3.0, must be a function"),
    ],
)
def test_what_is_no_task_is_reported_in_a_line(keys, expected):
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(ValueError, match=expected) as error:
            make(ID, **keys)
        assert "\n" not in str(error.value)
    with pytest.raises(ValueError, match=expected):
        parallel_env(**keys)


def test_numbers_that_no_vector_has_are_reported_in_a_line():
    for count in (0, -1, 1.5, 10**10):
        with pytest.raises(ValueError, match="num_envs: got"):
            gymnasium.make_vec(ID, num_envs=count, scenario=TASK)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"autoreset_mode: got 'never', allowed are next_step"):
        gymnasium.make_vec(ID, num_envs=2, scenario=TASK, autoreset_mode="never")
    with pytest.raises(ValueError, match="arrays: got 'lists', allowed are numpy, torch"):
        gymnasium.make_vec(ID, num_envs=2, scenario=TASK, arrays="lists")


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5, "one", [1.5, 2, 3], [1, 2]])
def test_what_is_no_seed_is_reported_in_a_line(made, seed):
    with pytest.raises(ValueError, match="seed: got") as error:
        made("same_step").reset(seed=seed)
    assert "\n" not in str(error.value)


def test_options_are_a_dict(made):
    for mode in ("single", "same_step"):
        with pytest.raises(ValueError, match="options: got list"):
            made(mode).reset(options=[True])


def test_gymnasiums_wrappers_count_episodes(made):
    def count(env, action):
        env.reset(seed=1)
        for _ in range(STEPS):
            *_, info = env.step(action)
            if "episode" in info:
                return info["episode"]
        return None

    still = np.array([-1.0, 0.0], np.float32)
    expected = count(wrappers.RecordEpisodeStatistics(made("single")), still)
    assert expected
    assert expected["l"] == made("single").unwrapped.episodes.most_steps == 8
    many = wrappers.vector.RecordEpisodeStatistics(made("same_step"))
    expected = count(many, np.tile(still, (COUNT, 1)))
    assert expected
    assert expected["l"].tolist() == [8] * COUNT


def test_a_missing_package_is_reported_with_its_extra(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(
        ImportError, match=r'pettingzoo is not installed; pip install "taichi_plume\[learn\]"'
    ):
        parallel_env(TASK)
    with pytest.raises(ImportError, match="stable_baselines3 is not installed"):
        taichi_plume.envs.sb3_env(TASK, 4)


@pytest.mark.slow
def test_pettingzoos_tests_pass(made):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        team = parallel_env(TASK)
        assert team.possible_agents == ["robot_0", "robot_1"]
        parallel_api_test(team, num_cycles=60)
        team.reset(seed=1)
        with pytest.raises(ValueError, match="actions: missing for robot_1"):
            team.step({"robot_0": np.zeros(2, np.float32)})
        assert team.state_space.contains(team.state())
        place, size = team.episodes.swarm.position.to_numpy(), np.array(TASK["domain"]["size"])
        side = np.array([1.0, 1.0 - 2.0 * team.episodes.info["mirror"][0]])
        assert team.state().reshape(2, 7)[:, :2] == pytest.approx((2.0 * place / size - 1.0) * side, abs=1e-5)
    actions = {name: np.array([0.3, 0.1 * k], np.float32) for k, name in enumerate(team.possible_agents)}
    first, again = ([team.reset(seed=4), team.step(actions), team.step(actions)] for _ in range(2))
    assert data_equivalence(first, again)
    team.close()
    with pytest.raises(ValueError, match="the environment is closed"):
        team.reset()


@pytest.mark.slow
def test_stable_baselines3_steps_the_same_episodes(made):
    pytest.importorskip("torch")
    check_baselines = pytest.importorskip("stable_baselines3.common.env_checker").check_env
    from taichi_plume.envs import sb3_env

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_baselines(made("single").unwrapped)
    wanted = at_once(made("same_step"), "same_step")
    made("same_step").close()
    envs = sb3_env(TASK, COUNT)
    envs.seed(SEEDS[0])
    seen: Any = envs.reset()
    steps: list[list[Any]] = [[] for _ in range(COUNT)]
    while min(map(len, steps)) < STEPS:
        after: Any
        after, rewards, over, infos = envs.step(act(seen))
        for e, info in enumerate(infos):
            late = info.get("TimeLimit.truncated", False)
            final = info.get("terminal_observation", after[e])
            steps[e].append((seen[e], rewards[e], over[e] and not late, late, final))
            if over[e]:
                assert info["search"]["found"] == (not late)
                length = len(steps[e]) - max(
                    [k + 1 for k, s in enumerate(steps[e][:-1]) if s[2] or s[3]] or [0]
                )
                assert info["episode"]["l"] == length
        seen = after
    for one, other in zip(steps, wanted, strict=True):
        assert_same(one, other)
    envs.close()


@pytest.mark.slow
def test_robots_of_teams_are_rows_that_share_a_policy():
    """Two teams of two: observations and rewards are those of the engine, and a team's episode ends in both rows."""
    pytest.importorskip("torch")
    pytest.importorskip("stable_baselines3")
    envs = taichi_plume.envs.sb3_env(TASK, 2, team=True)
    assert envs.num_envs == 4
    envs.seed(5)
    seen: Any = envs.reset()
    rows = 0
    for _ in range(STEPS):
        after, rewards, over, infos = envs.step(act(seen))
        np.testing.assert_array_equal(rewards, envs.episodes.rewards)
        assert np.array_equal(over[::2], over[1::2])
        for e in np.flatnonzero(over[::2]):
            assert infos[2 * e]["search"] == infos[2 * e + 1]["search"]
            assert not np.array_equal(*(infos[2 * e + k]["terminal_observation"] for k in (0, 1)))
        rows += over.sum()
        seen = after
    assert rows > 4
    envs.close()


def test_the_page_lists_the_keys_of_info_and_truth_and_the_options():
    text = (Path(__file__).parents[2] / "docs" / "howto" / "learning.md").read_text(encoding="utf-8")
    section = text.partition("## What `info` holds")[2].partition("\n## ")[0]
    assert re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE) == [*INFO, *KEYS]
    options = text.partition("All four take the options ")[2].partition(". ")[0]
    assert set(re.findall(r"`(\w+)`", options)) == {*Options.__annotations__, "render_mode"}


@pytest.mark.slow
def test_truth_is_in_every_info_if_asked_for(made):
    env = gymnasium.make(ID, scenario=TASK, truth=True)
    seen, info = env.reset(seed=7)
    assert "truth" not in made("single").reset(seed=7)[1]
    over = False
    while not over:
        engine = env.unwrapped.episodes
        assert info.keys() == {"truth"}
        assert tuple(info["truth"]) == KEYS
        np.testing.assert_array_equal(info["truth"]["robot_position"], engine.swarm.position.to_numpy()[0])
        seen, _, ended, late, info = env.step(act(seen))
        over = ended or late
    assert info.keys() == {"truth", *INFO}
    env.close()
    vector = gymnasium.make_vec(
        ID, num_envs=COUNT, scenario=TASK, autoreset_mode="same_step", copy=True, truth=True
    )
    seen, info = vector.reset(seed=7)
    assert info["_truth"].all()
    over = np.zeros(COUNT, bool)
    while not over.any():
        before, engine = info["truth"]["robot_position"], vector.unwrapped.episodes
        np.testing.assert_array_equal(before, engine.swarm.position.to_numpy())
        seen, _, ended, late, info = vector.step(act(seen))
        over = ended | late
    np.testing.assert_array_equal(info["truth"]["robot_position"], engine.swarm.position.to_numpy())
    final = info["final_info"]
    np.testing.assert_array_equal(final["_truth"], over)
    moved = np.hypot(*(final["truth"]["robot_position"] - before).T)
    assert (moved[over] <= 0.4 * engine.step_s + 1e-5).all()  # the end of the episode, not the next start
    vector.close()
    team = parallel_env(TASK, truth=True)
    _, infos = team.reset(seed=7)
    for k, agent in enumerate(team.agents):
        place = team.episodes.swarm.position.to_numpy()[k]
        np.testing.assert_array_equal(infos[agent]["truth"]["robot_position"], place)
    team.close()


@pytest.mark.slow
def test_a_reward_function_is_called_for_all_environments(made):
    calls = []

    def reward(step):
        calls.append(step)
        return -np.hypot(*step.truth["source_offset"].T)

    vector = gymnasium.make_vec(ID, num_envs=COUNT, scenario=TASK, reward=reward, truth=True)
    vector.reset(seed=7)
    _, rewards, _, _, info = vector.step(np.zeros((COUNT, 2), np.float32))
    assert len(calls) == 1
    np.testing.assert_array_equal(rewards, -np.hypot(*info["truth"]["source_offset"].T))
    vector.close()


def test_a_closed_environment_says_so_and_closes_twice(made):
    envs = made("disabled")
    envs.close()
    envs.close()
    envs.render_mode = "rgb_array"
    for use in (envs.reset, lambda: envs.step(np.zeros((COUNT, 2), np.float32)), envs.render):
        with pytest.raises(ValueError, match="the environment is closed; make another"):
            use()


@pytest.mark.slow
def test_a_second_engine_of_a_task_compiles_nothing(made):
    """It has the same episodes, in arrays of its own."""
    first = gymnasium.make(ID, scenario=TASK).unwrapped
    actions = np.random.default_rng(3).uniform(-1, 1, (5, 2)).astype(np.float32)
    expected = [first.reset(seed=4)[0], *(first.step(action)[0] for action in actions)]
    engine, before = first.episodes, program.compiled()
    shown = engine.observations
    kept = shown.copy()
    first.close()
    second = gymnasium.make(ID, scenario=TASK).unwrapped
    with pytest.raises(ValueError, match="reset"):
        second.step(actions[0])
    again = [second.reset(seed=4)[0], *(second.step(action)[0] for action in actions)]
    assert np.array_equal(expected, again)
    assert np.array_equal(shown, kept)
    assert program.compiled() == before
    assert made("single").unwrapped.episodes is not engine
    second.close()


@pytest.mark.parametrize(
    ("sections", "key"),
    [
        ({"gas": {"kind": "own", "file": "laws.py"}}, "gas.kind: own"),
        (
            {
                "gas": {
                    "kind": "eulerian",
                    "fluctuations": True,
                    "sources": [{"position": [0.4, 0.4], "rate": 1e-5}],
                }
            },
            "gas.fluctuations",
        ),
        ({"robots": [TASK["robots"][0] | {"sensors": {"range": {"bearings_deg": [0.0]}}}]}, "sensors.range"),
    ],
)
def test_parts_that_environments_do_not_have_are_refused(tmp_path, monkeypatch, sections, key):
    (tmp_path / "laws.py").write_text("def concentration(points, t):\n    return 1.0\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(tp.ScenarioError, match=re.escape(key)):
        open_task(task(**sections))
