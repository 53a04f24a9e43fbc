"""Episodes: their own worlds, whatever is beside them, and the same robots as in an ordinary run."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import program, ti
from taichi_plume.envs.episodes import MODES, Episodes
from taichi_plume.grid.fields import Wind
from taichi_plume.scenario.loading import scenario_from
from taichi_plume.scenario.sensors import MoxSensor
from taichi_plume.scenario.species import SPECIES

pytestmark = pytest.mark.usefixtures("taichi")

MANY, TEAM, TICKS = 5, 2, 3
SIZE, SPACING = (2.0, 1.5), 0.1
# of each film: value at 0, and slopes per m of x and y
WIND = np.array([[0.3, 0.1, 0.05], [-0.2, 0.02, 0.1], [0.1, -0.1, 0.0]])  # m/s
LEVEL = np.array([[40.0, 30.0, 20.0], [10.0, 5.0, 60.0], [20.0, 10.0, 0.0]])  # ppm
OBSERVE = ["gas", "noses", "memory", "rise", "wind", "bumper", "heading", "position", "action", "mates"]
SOURCE = {"kind": "gaussian_plume", "species": "ethanol", "intensity": 0.1}
TASK = {
    "seed": 3,
    "duration": 3.0,
    "domain": {"size": list(SIZE), "spacing": SPACING, "depth": 0.5},
    "wind": {"kind": "uniform", "velocity": [0.5, 0.0]},
    "obstacles": [{"kind": "box", "center": [1.0, 0.7], "size": [0.2, 0.2]}],
    "gas": {**SOURCE, "sources": [{"position": [0.4, 0.4], "rate": "10 mg/s"}]},
    "robots": [
        {
            "name": "learners",
            "count": TEAM,
            "start": {"kind": "area", "low": [0.3, 0.2], "high": [1.7, 1.3]},
            "algorithm": {
                "kind": "policy",
                "observe": OBSERVE,
                "memory": [1.0],
                "period": 0.3,
                "history": 2,
                "declares": True,
            },
            "body": {"radius": 0.06, "max_speed": 0.4},
            "sensors": {
                "gas": [
                    {"kind": "mox", "spread": 0.3, "noise": 0.01, "drift": 1.0, "cold_start": 0.1},
                    {"kind": "ideal", "left": 0.1, "ahead": 0.05},
                ],
                "wind": {"kind": "ultrasonic"},
            },
            "localization": {"kind": "odometry"},
            "reach": 0.1,
            "found": "declared",
        }
    ],
    "task": {
        "episode": 2.4,
        "film": 6.0,
        "sources": "one",
        "reward": {"path": -0.1, "gas": 0.3, "progress": 1.0, "false_declaration": -0.2},
    },
}


def linear(numbers):
    """(nx, ny): a + b x + c y at the cell centres."""
    x, y = (SPACING * (np.arange(round(length / SPACING)) + 0.5) for length in SIZE)
    return numbers[0] + numbers[1] * x[:, None] + numbers[2] * y[None, :]


def recorded() -> Any:
    """Three films of air that stands still in time but is linear in space; each has sources of two gases."""
    films = [
        np.stack([linear(WIND[f]), linear(WIND[f][::-1]), linear(LEVEL[f]), linear(LEVEL[f][::-1])], axis=-1)
        for f in range(3)
    ]
    values = np.repeat(np.array(films, np.float16)[:, None], 13, axis=1)
    sources = tuple((np.array([[0.4 + 0.2 * f, 0.4]]), np.array([[1.6, 1.2 - 0.2 * f]])) for f in range(3))
    return SimpleNamespace(
        values=values,
        scale=np.ones((3, 2), np.float32),
        air=np.ones((2, *values.shape[2:4])),
        spacing=SPACING,
        frame=0.5,
        species=(SPECIES["ethanol"],) * 2,
        sources=sources,
        films=3,
        length=6.0,
    )


@pytest.fixture(scope="module")
def engines(taichi):
    """One of a single environment, and one of many."""
    program.start("cpu")
    scenario = scenario_from(TASK)
    return [Episodes(scenario, count=count, robots=TEAM, bank=recorded()) for count in (1, MANY)]


def seeds(count, first=2**40 + 7):
    return np.arange(count, dtype=np.uint64) * np.uint64(2**33 + 1) + np.uint64(first)


def actions(engine, steps, seed=0):
    """Of each environment by its number, (steps, count, TEAM, 3); they rarely declare."""
    drawn = [np.random.default_rng([seed, e]).uniform(-1.0, 1.0, (steps, TEAM, 3)) for e in range(MANY)]
    commands = np.stack(drawn, axis=1).astype(np.float32)
    commands[..., 2] -= 0.4 * (commands[..., 2] > -0.6)
    for e in range(MANY):  # so that episodes end at different times
        commands[2 + e, e, :, 2] = 1.0
    return commands


def follow(engine, commands, mode):
    """What becomes of actions (steps, count, TEAM, 3): arrays over steps and environments."""
    engine.autoreset = mode
    kept = []
    for row in commands:
        over = engine.terminated | engine.truncated
        if mode == "disabled" and over.any():
            engine.reset(mask=over.copy())
        engine.step(row.reshape(-1, 3))
        ended = (engine.terminated | engine.truncated)[:, None]
        final = engine.final_observations.reshape(engine.count, -1) * (ended & (mode == "same_step"))
        parts = [engine.observations, engine.rewards, engine.terminated, engine.truncated, final]
        parts += engine.info.values()
        kept.append(
            np.concatenate([np.array(p, np.float32).reshape(engine.count, -1) for p in parts], axis=1)
        )
    return np.stack(kept)


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_single_engines_and_one_of_many_give_the_same(engines, mode):
    one, many = engines
    commands = actions(many, 20)
    many.terminated[:] = many.truncated[:] = False
    many.reset(seeds(MANY))
    begun = many.observations.copy()
    together = follow(many, commands, mode)
    assert together[:, :, -len(many.info) + 4].max() >= 2  # several episodes each
    for e in range(MANY):
        one.reset(seeds(MANY)[e : e + 1])
        np.testing.assert_array_equal(one.observations, begun[e * TEAM : (e + 1) * TEAM])
        np.testing.assert_array_equal(follow(one, commands[:, e : e + 1], mode)[:, 0], together[:, e])


@pytest.mark.slow
def test_episodes_differ(engines):
    _, many = engines
    many.reset(seeds(MANY))
    first = many.swarm.position.to_numpy()
    assert len(np.unique(first.round(5), axis=0)) == MANY * TEAM
    for e in range(MANY):  # free of each other and of walls
        a, b = first[TEAM * e : TEAM * e + TEAM]
        assert np.linalg.norm(a - b) >= 0.12
    assert many.swarm.clearance.distance_at(first).min() >= 0.06
    many.reset()
    assert (many.info["episode_number"] == 1).all()
    assert np.abs(many.swarm.position.to_numpy() - first).min() > 1e-4
    worlds = set()
    for _ in range(20):
        many.reset()
        worlds |= set(zip(*(many.info[name].tolist() for name in ("film", "source", "mirror")), strict=True))
    assert len(worlds) == 12  # films, gases and mirrors
    assert 0.0 < many.kernel.films.begin.to_numpy().min() <= many.kernel.films.begin.to_numpy().max() < 3.4


def test_a_sensor_on_the_left_is_on_the_right_in_a_mirror(engines):
    """It reads the film where it is: to the left as the policy sees it."""
    _, many = engines
    column = many.names.index("gas of sensor 1")
    for flip in (1.0, -1.0):
        many.kernel.n.mirrors[None] = 0.0 if flip > 0 else 1.0
        many.reset(seeds(MANY))
        place, heading = many.swarm.position.to_numpy(), many.swarm.heading.to_numpy()
        ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        left = flip * np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
        worlds = zip(many.info["film"].astype(int), many.info["source"].astype(int), strict=True)
        levels = np.repeat([LEVEL[f] if g == 0 else LEVEL[f][::-1] for f, g in worlds], TEAM, axis=0)
        x = np.clip(place + 0.05 * ahead + 0.1 * left, 0.05, np.array(SIZE) - 0.05)
        ppm = np.maximum(levels[:, 0] + (levels[:, 1:] * x).sum(axis=1), 0.0)
        observed = 10.0 ** (6.0 * many.observations[:, column]) - 1.0
        np.testing.assert_allclose(observed, ppm, rtol=3e-3, atol=0.05)
    many.kernel.n.mirrors[None] = 0.5


def test_a_mirrored_episode_is_the_same_seen_in_a_mirror(engines):
    _, many = engines
    commands = actions(many, 7)
    seen = []
    for flip in (1.0, -1.0):
        many.kernel.n.mirrors[None] = 0.0 if flip > 0 else 1.0
        many.reset(seeds(MANY))
        assert (many.info["mirror"] == (flip < 0)).all()
        seen.append(follow(many, commands * np.array([1.0, flip, 1.0], np.float32), "next_step"))
    many.kernel.n.mirrors[None] = 0.5
    sides = np.array(
        [any(word in name for word in ("left", "sin", "position y", "turn")) for name in many.names]
    )
    assert 0 < sides.sum() < many.observation.size
    signs = np.ones(seen[0].shape[-1])
    signs[: TEAM * many.observation.size] = np.tile(np.where(sides, -1.0, 1.0), TEAM)
    mirror_info = len(signs) - len(many.info) + 7
    assert (seen[1][..., mirror_info] != seen[0][..., mirror_info]).all()
    keep = np.arange(len(signs)) != mirror_info  # and what a sensor on one side reads
    keep[: TEAM * many.observation.size] = np.tile(["of sensor" not in name for name in many.names], TEAM)
    np.testing.assert_array_equal((seen[1] * signs)[..., keep], seen[0][..., keep])


def test_observations_do_not_tell_where_sources_are(engines):
    _, many = engines
    commands = actions(many, 7)
    commands[..., 2] = -1.0
    rows = slice(0, TEAM * many.observation.size)
    kept = many.kernel.place.to_numpy()
    seen = []
    for shift in (0.0, 1.0):
        many.kernel.place.from_numpy(np.where(kept < 10.0, kept + shift, kept).astype(np.float32))
        many.reset(seeds(MANY))
        seen.append(follow(many, commands, "next_step"))
    many.kernel.place.from_numpy(kept)
    np.testing.assert_array_equal(seen[0][..., rows], seen[1][..., rows])
    assert (seen[0] != seen[1]).any()  # progress is rewarded


def test_truth_is_the_gas_at_the_robots_and_the_way_to_the_nearest_source(engines):
    _, many = engines
    for flip in (1.0, -1.0):
        many.kernel.n.mirrors[None] = 0.0 if flip > 0 else 1.0
        many.reset(seeds(MANY))
        truth = many.read_truth()
        place, heading = many.swarm.position.to_numpy(), many.swarm.heading.to_numpy()
        worlds = list(zip(many.info["film"].astype(int), many.info["source"].astype(int), strict=True))
        levels = np.repeat([LEVEL[f] if g == 0 else LEVEL[f][::-1] for f, g in worlds], TEAM, axis=0)
        x = np.clip(place, 0.05, np.array(SIZE) - 0.05)
        ppm = np.maximum(levels[:, 0] + (levels[:, 1:] * x).sum(axis=1), 0.0)
        np.testing.assert_allclose(truth["true_ppm"], ppm, rtol=3e-3, atol=0.05)
        np.testing.assert_array_equal(truth["robot_position"], place)
        np.testing.assert_array_equal(truth["robot_heading"], heading)
        sources = np.repeat([recorded().sources[f][g][0] for f, g in worlds], TEAM, axis=0)
        np.testing.assert_allclose(truth["source_position"], sources, atol=1e-6)
        ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        left = flip * np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
        offset = truth["source_offset"]
        np.testing.assert_allclose(place + offset[:, :1] * ahead + offset[:, 1:] * left, sources, atol=1e-5)
    many.kernel.n.mirrors[None] = 0.5


@pytest.mark.parametrize("mode", ["next_step", "same_step"])
def test_a_reward_function_replaces_the_rewards_of_the_task(engines, mode):
    _, many = engines
    commands = actions(many, 12)
    many.terminated[:] = many.truncated[:] = False
    many.reset(seeds(MANY))
    expected = follow(many, commands, mode)
    seen = []

    def reward(step):
        seen.append((step.before.copy(), step.actions.copy(), step.after.copy(), step.truth["true_ppm"]))
        return 2.0 * step.rewards

    many.rewarder = reward
    many.terminated[:] = many.truncated[:] = False
    many.reset(seeds(MANY))
    rewarded = follow(many, commands, mode)
    many.rewarder = None
    factors = np.ones(rewarded.shape[2])
    at = TEAM * many.observation.size
    factors[at : at + TEAM] = factors[-1] = 2.0  # rewards, and the return as the last of the info
    assert list(many.info)[-1] == "return"
    np.testing.assert_allclose(rewarded, expected * factors, rtol=1e-5, atol=1e-5)
    assert (expected[:, :, -1] != 0).any()
    for (_, _, after, _), (before, given, _, ppm), row in zip(seen, seen[1:], commands[1:], strict=False):
        assert mode == "same_step" or np.array_equal(after, before)
        np.testing.assert_array_equal(given, row.reshape(-1, 3))
        assert ppm.shape == (MANY * TEAM,)


@pytest.mark.parametrize("returned", [1.0, np.zeros(MANY), np.full(MANY * TEAM, np.nan), "much"])
def test_rewards_of_another_shape_are_refused(engines, returned):
    _, many = engines
    many.autoreset = "next_step"
    many.reset(seeds(MANY))
    many.rewarder = lambda step: returned
    try:
        with pytest.raises(ValueError, match="reward: ") as error:
            many.step(np.zeros((MANY * TEAM, 3), np.float32))
        assert "\n" not in str(error.value)
    finally:
        many.rewarder = None


def test_a_word_ends_an_episode(engines):
    _, many = engines
    many.autoreset = "next_step"
    commands = np.tile(np.array([-1.0, 0.0, -1.0], np.float32), (MANY * TEAM, 1))
    many.reset(seeds(MANY))
    spot = many.swarm.position.to_numpy().reshape(MANY, TEAM, 2)
    source = many.swarm.episodes.sources.to_numpy()
    source[2, 0] = spot[2, 1]
    many.swarm.episodes.sources.from_numpy(source)
    many.kernel.n.for_progress[None] = 0.0
    commands[[5, 6, 7], 2] = 1.0  # the second robot of environment 2 is right, both of 3 are wrong
    many.step(commands)
    many.kernel.n.for_progress[None] = 1.0
    assert many.terminated.tolist() == [False, False, True, True, False]
    assert many.info["found"].tolist() == [0, 0, 1, 0, 0]
    assert many.rewards[5] - many.rewards[4] == pytest.approx(0.0, abs=0.05)  # what one finds all have found
    assert many.rewards[4] > 0.9
    assert many.rewards[6] < -0.19
    many.step(commands)
    assert not many.terminated[2:4].any()
    assert (many.rewards[4:8] == 0.0).all()
    assert many.info["episode_number"].tolist() == [0, 0, 1, 1, 0]


@pytest.mark.slow
def test_resets_compile_nothing(engines):
    for engine in engines:
        engine.reset(seeds(engine.count))
        engine.step(np.zeros((engine.count * TEAM, 3), np.float32))
        before = program.compiled()
        engine.reset(seeds(engine.count, 5))
        engine.reset(mask=np.arange(engine.count) == 0)
        engine.step(np.zeros((engine.count * TEAM, 3), np.float32))
        assert program.compiled() == before
    _, many = engines
    many.reset(seeds(MANY))
    shown = many.observations.copy()
    many.reset(mask=np.arange(MANY) == 1)  # the others stay as they are
    changed = (many.observations != shown).any(axis=1)
    assert changed.tolist() == [False] * TEAM + [True] * TEAM + [False] * (MANY - 2) * TEAM


def test_a_camera_counts_its_frames_from_the_start_of_each_episode(taichi):
    """With frames at each tick, and as late as a decision takes: the pose of the decision before."""
    exact = {"kind": "camera", "rate": 10, "delay": 0.1 * TICKS, "position_noise": 0, "heading_noise_deg": 0}
    scenario = scenario_from(TASK | {"robots": [TASK["robots"][0] | {"localization": exact}]})
    many = Episodes(scenario, count=2, robots=TEAM, bank=recorded())
    many.autoreset = "disabled"
    for _ in range(2):
        many.reset(seeds(2))
        before = many.swarm.position.to_numpy()
        for _ in range(4):
            np.testing.assert_allclose(many.swarm.believed_position.to_numpy(), before, atol=1e-6)
            before = many.swarm.position.to_numpy()
            many.step(np.tile(np.array([1.0, 0.3, -1.0], np.float32), (2 * TEAM, 1)))
        assert np.abs(many.swarm.position.to_numpy() - before).max() > 0.01


def test_bad_actions_move_nothing(engines):
    _, many = engines
    many.reset(seeds(MANY))
    before = many.swarm.position.to_numpy()
    commands = np.zeros((MANY * TEAM, 3), np.float32)
    for value, text in ((np.nan, "nan"), (1.5, "1.5"), (-np.inf, "-inf")):
        commands[7, 1] = value
        with pytest.raises(ValueError, match=f"environment 3: action 1 of robot 1 is {text};"):
            many.step(commands)
    np.testing.assert_array_equal(many.swarm.position.to_numpy(), before)


def test_where_no_room_is_found_by_chance_teams_start_at_free_places(engines):
    _, many = engines
    area = {"low_x": 0.95, "low_y": 0.65, "wide_x": 0.1, "wide_y": 0.1}  # within the box
    kept = {name: getattr(many.kernel.n, name)[None] for name in area}
    for name, value in area.items():
        getattr(many.kernel.n, name)[None] = value
    many.reset(seeds(MANY))
    free = many.kernel.fallback.to_numpy()
    for team in many.swarm.position.to_numpy().reshape(MANY, TEAM, 2):
        assert (np.abs(free - team).max(axis=(1, 2)) == 0.0).any()
    for name, value in kept.items():
        getattr(many.kernel.n, name)[None] = value


def test_tensors_share_the_same_episodes(engines):
    torch = pytest.importorskip("torch")
    _, many = engines
    commands = actions(many, 10).reshape(10, -1, 3)
    many.reset(seeds(MANY))
    seen = []
    for arrays in ("numpy", "torch"):
        many._allocate(arrays)
        many.autoreset = "same_step"
        many.reset(seeds(MANY), np.ones(MANY, bool))
        for row in commands:
            many.step(row if arrays == "numpy" else torch.from_numpy(row))
        kinds = [many.observations, many.rewards, many.truncated, many.final_observations]
        assert all(isinstance(one, torch.Tensor if arrays == "torch" else np.ndarray) for one in kinds)
        seen.append([np.asarray(one).copy() for one in kinds])
    with pytest.raises(ValueError, match="environment 0: action 0 of robot 0 is nan"):
        many.step(torch.full((MANY * TEAM, 3), torch.nan))
    assert many.truncated.dtype == torch.bool
    for a, b in zip(*seen, strict=True):
        np.testing.assert_array_equal(a, b)
    many._allocate("numpy")


class Air(Wind):
    """Linear in space; numbers as for the films, of gas the sum of two."""

    species = (SPECIES["ethanol"],)

    def __init__(self, film):
        self.wind_, self.level = WIND[film].tolist(), (LEVEL[film] + LEVEL[film][::-1]).tolist()

    def advance(self, t, dt):
        pass

    @ti.func
    def velocity(self, x, t):
        a, b, c = ti.static(self.wind_)
        return ti.Vector([a + b * x[0] + c * x[1], c + b * x[0] + a * x[1]])

    @ti.func
    def ppm(self, x, t):
        a, b, c = ti.static(self.level)
        return ti.Vector([a + b * x[0] + c * x[1]])


def test_robots_are_those_of_an_ordinary_run(taichi):
    """The same commands in the same air, without noise: ways, readings and winds are the same."""
    scenario = scenario_from(TASK)
    learners = scenario.learners
    exact = learners.sensors.model_copy(
        update={
            "gas": (MoxSensor(kind="mox", noise=0.0), learners.sensors.noses[1]),
            "wind": learners.sensors.wind.model_copy(update={"noise": 0.0}),
        }
    )
    plain_learners = learners.model_copy(update={"sensors": exact, "localization": None})
    robots = tuple(plain_learners if group is learners else group for group in scenario.robots)
    scenario = scenario.model_copy(update={"robots": robots, "seed": 3})
    many = Episodes(scenario, count=MANY, robots=TEAM, bank=recorded())
    swarm = many.swarm
    model = swarm.groups[0].model
    choice = many.kernel.choice.to_numpy()
    many.kernel.choice.from_numpy(np.full_like(choice, -1))
    many.kernel.n.mirrors[None] = 0.0
    many.autoreset = "disabled"
    many.reset(seeds(MANY))
    starts = swarm.position.to_numpy(), swarm.heading.to_numpy()
    air = Air(0)
    film = many.info["film"]
    here = np.repeat(film == 0, TEAM)
    assert here.any()
    plain = Swarm([model], *starts, swarm.clearance, np.empty((0, 2)), 3)
    noses = Sensors(plain, 2, 0.1, air.species)
    commands = actions(many, 7)
    commands[..., 2] = -1.0
    plain.move(1, 0.1, 0.1)
    noses.measure(air, air, 1, 0.1)
    tick = 1
    for row in commands:
        many.step(row.reshape(-1, 3))
        share = row.reshape(-1, 3)
        plain.speed_command.from_numpy(0.5 * (1.0 + share[:, 0]) * np.float32(0.4))
        plain.turn_rate_command.from_numpy(share[:, 1] * plain.max_turn_rate.to_numpy())
        for _ in range(TICKS):
            tick += 1
            plain.move(tick, 0.1 * tick, 0.1)
            noses.measure(air, air, tick, 0.1 * tick)
    known, wanted = swarm.snapshot(), plain.snapshot()
    for name in ("position", "heading", "path_length", "bumps"):
        np.testing.assert_allclose(known[name], wanted[name], atol=1e-5, err_msg=name)
    assert wanted["path_length"].min() > 0.1
    for name, error in (("reading_ppm", 2e-3), ("true_ppm", 1e-3), ("wind", 2e-3), ("resistance_ohm", 2e-3)):
        np.testing.assert_allclose(known[name][here], wanted[name][here], rtol=error, atol=3e-4, err_msg=name)
