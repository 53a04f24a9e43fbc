"""Sources that move, appear and end: what they emit and where, when robots find them, how declarations are judged."""

from math import sqrt

import numpy as np
import pytest
from rooms import air_in, blocks, cfd, flow_in

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.scenario.playback import Played, played_source
from taichi_plume.scenario.sources import Source
from taichi_plume.solvers.gas import EulerianSolver

pytestmark = pytest.mark.usefixtures("taichi")

RATE = 2e-6  # kg/s
GAS = "gas={kind: playback, file: fields.zarr, start: 0.25}"
WAY = {"path": [[1.0, 1.0, 0.9], [2.0, 1.6, 0.9]]}


def still(**keys):
    """A room of still air with a source, as a dict; keys: of the source."""
    source = {"position": [0.4, 0.3], "rate": RATE, "radius": 0.05} | keys
    return {
        "duration": 2, "stop_early": False,
        "domain": {"size": [2, 1.2], "spacing": 0.05},
        "wind": {"kind": "uniform", "velocity": [0, 0]},
        "gas": {"kind": "eulerian", "species": "acetone", "sources": [source]},
    }  # fmt: skip


def run(data, *overrides):
    sim = assemble(load_scenario(data, overrides))
    sim.run()
    return sim


def moments(sim):
    """Mass [kg], centroid and variances of the gas along the axes."""
    c = np.asarray(sim.gas.gases[0].cells(sim.t), float)
    points, mass = sim.grid.centers(), c.sum()
    middle = np.array([(c * x).sum() / mass for x in np.moveaxis(points, -1, 0)])
    variance = [
        (c * (x - m) ** 2).sum() / mass for x, m in zip(np.moveaxis(points, -1, 0), middle, strict=True)
    ]
    return mass * sim.grid.cell_volume, middle, np.array(variance)


def test_gas_lies_along_the_path_and_none_is_lost():
    """In still air the centroid is the mean of the path over time, the variance that of the path and of a release."""
    mass, middle, variance = moments(run(still(motion=WAY)))
    _, _, of_release = moments(run(still()))
    assert mass == pytest.approx(2.0 * RATE, rel=1e-6)
    assert middle == pytest.approx([0.5 * (0.7 + 1.3), 0.5 * (0.6 + 0.9)], abs=1e-3)
    t = np.linspace(0, 2, 20001)
    of_path = np.array([np.interp(t, [0, 1, 2], x).var() for x in ([0.4, 1.0, 1.6], [0.3, 0.9, 0.9])])
    assert variance == pytest.approx(of_path + of_release, rel=0.01)


def test_a_path_that_stays_is_no_path_to_the_bit():
    fixed, moving = (run(still(**keys)) for keys in ({}, {"motion": {"path": [[1, 0.4, 0.3]]}}))
    cells = [np.asarray(sim.gas.gases[0].cells(2.0)) for sim in (fixed, moving)]
    assert np.array_equal(cells[0], cells[1])


@pytest.mark.slow
def test_mass_of_a_moving_source_in_wind_and_among_walls_is_exact():
    """Emitted is the rate times the time in which the source is on; what is not inside has left."""
    data = still(motion={"path": [[1, 1.5, 0.3], [2, 0.4, 0.3]], "loop": True}, start=0.5, stop=1.7)
    data["wind"] = {
        "kind": "cfd",
        "openings": [{"kind": "honeycomb", "face": "x-", "speed": 0.8}, {"kind": "honeycomb", "face": "x+"}],
    }
    data["obstacles"] = [{"kind": "box", "center": [1.0, 0.47], "size": [0.3, 0.2]}]
    budget = run(data).gas.gases[0].budget()
    assert budget["emitted_kg"] == pytest.approx(1.2 * RATE, rel=1e-9)
    assert budget["in_domain_kg"] + budget["outflow_kg"] == pytest.approx(budget["emitted_kg"], rel=1e-5)
    assert budget["outflow_kg"] > 0.05 * budget["emitted_kg"]


def test_puffs_start_on_the_path():
    """Puffs of no spread stay where they were released: around the path, in the order of their release."""
    gas = {"kind": "puffs", "species": "acetone", "fluctuation": 0, "release_rate": 100}
    data = still(motion=WAY)
    data["gas"] = gas | {"sources": data["gas"]["sources"]}
    solver = run(data).gas.gases[0]
    rows = solver.puffs.rows().astype(float)
    number = solver.puffs.number.to_numpy()[: len(rows)]
    when = (number + 1) / 100
    way = np.stack([np.interp(when, [0, 1, 2], x) for x in ([0.4, 1.0, 1.6], [0.3, 0.9, 0.9])], axis=-1)
    apart = np.linalg.norm(rows[:, :2] - way, axis=1)
    assert len(rows) in (199, 200)  # the last is due at the end of the run
    assert apart.max() <= 0.05 + 1e-5
    assert sqrt(2.0) * apart.mean() == pytest.approx(sqrt(2.0) * 0.05 * 2 / 3, rel=0.1)  # evenly over a disc
    assert solver.budget()["emitted_kg"] == pytest.approx(2.0 * RATE, rel=1e-6)


def test_a_path_through_cells_without_air_is_refused():
    """As the walls of a film, which are no obstacles of the scenario."""
    grid = Grid((40, 24), 0.05)
    motion = {"path": [[1, 1.6, 0.3]]}
    gas = EulerianGas.model_validate(still(motion=motion)["gas"])
    flow = flow_in(grid, cfd(), blocks(grid.shape, np.s_[20, :8]))
    with pytest.raises(ValueError, match=r"sources\[0\]\.motion\.path: at 0\.49"):
        EulerianSolver(gas, grid, flow, air_in(grid, blocks(grid.shape, np.s_[20, :8])))


def test_positions_over_time():
    scenario = load_scenario(
        still(motion=WAY | {"path": [*WAY["path"], [4.0, 0.4, 0.3]], "loop": True}, stop=9.0)
    )
    t = np.array([-1.0, 0.0, 0.5, 3.0, 4.5, 9.0, 9.01])
    expected = [[1.0, 0.6], [0.4, 0.3], [0.7, 0.6], [1.0, 0.6], [0.7, 0.6], [1.0, 0.9], [np.nan, np.nan]]
    assert scenario.sources_at(t)[:, 0] == pytest.approx(np.array(expected), nan_ok=True)
    assert scenario.sources_change
    assert not load_scenario(still()).sources_change


def searching(**keys):
    """A robot that stays at (1, 0.9), which the source passes at 1 s, and one at the source's position at the start."""
    robots = {
        "name": "pair", "count": 2, "reach": 0.2, "algorithm": {"kind": "random_walk", "speed": 0},
        "start": {"kind": "positions", "positions": [[1.0, 0.9], [1.6, 0.9]]},
    }  # fmt: skip
    return still(motion=WAY, **keys) | {"robots": [robots], "duration": 3}


def test_a_robot_finds_the_source_where_it_is_at_the_time():
    """Of speed 0.6 m/s along x it is within 0.2 m of (1.6, 0.9) after 2 - 0.2/0.6 s, of (1, 0.9) after 1 - ... s."""
    sim = run(searching())
    expected = [1.0 - 0.2 / (0.6 * sqrt(2.0)), 2.0 - 0.2 / 0.6]
    assert sim.swarm.snapshot()["found_time"] == pytest.approx(expected, abs=sim.dt)


@pytest.mark.parametrize(
    ("keys", "found"), [({"stop": 1.5}, [1, 0]), ({"start": 1.4}, [0, 1]), ({"start": 5}, [0, 0])]
)
def test_a_source_that_is_not_there_is_not_found(keys, found):
    assert run(searching(**keys)).swarm.snapshot()["found"].tolist() == found


def test_a_declaration_is_judged_by_the_position_at_its_time():
    from taichi_plume.scoring.trials import trial_outcomes

    data = searching(stop=2.5)
    data["robots"][0] |= {
        "found": "declared",
        "trials": 1,
        "count": 1,
        "start": {"kind": "positions", "positions": [[0.2, 1.0]]},
    }
    sim = assemble(load_scenario(data))
    places = {1.5: [1.2, 0.9], 2.8: [1.6, 0.9]}
    judged = []
    while not sim.tick >= sim.last_tick:
        sim.step()
        for t, place in places.items():
            if abs(sim.t - t) < 1e-6:
                sim.swarm.declarations.fill(0)
                sim.swarm.false_declarations.fill(0)
                sim.swarm.found.fill(0)
                sim.swarm.declare_all(0, np.array([place]), sim.t)
                judged.append(trial_outcomes(sim, sim.swarm.groups[0], sim.swarm.snapshot()))
    assert [each["outcome"] for each in judged] == [["declared"], ["neither"]]
    assert judged[0]["localisation_error_m"] == pytest.approx([0.1], abs=1e-5)  # at 1.5 s it is at (1.3, 0.9)
    assert np.isnan(judged[1]["localisation_error_m"]).all()  # it has ended


@pytest.mark.parametrize("is_loop", [False, True])
@pytest.mark.parametrize("moves_in_loops", [False, True])
def test_a_played_source_is_where_the_record_had_it(is_loop, moves_in_loops):
    """At any time of the run, the time in the record is start + rate t, in a loop modulo its length and a frame."""
    motion = {"path": [[1.0, 1.0, 0.9], [2.0, 1.6, 0.9], [3.5, 0.4, 0.3]], "loop": moves_in_loops}
    recorded = {"position": [0.4, 0.3], "rate": RATE, "motion": motion, "start": 0.5, "stop": 6.5}
    times, model = np.linspace(-2.0, 7.0, 91), Played(start=1.3, rate=1.5, loop=is_loop)
    source = Source.model_validate(played_source(recorded, times, model))
    t = np.linspace(0.0, 20.0, 997)
    at = model.start + model.rate * t
    if is_loop:
        at = -2.0 + (at + 2.0) % 9.1
    within = at <= 7.0
    expected = Source.model_validate(recorded).places(np.clip(at, -2.0, 7.0))
    assert source.places(t)[within] == pytest.approx(expected[within], abs=1e-6)
    if is_loop:
        assert source.on == (-np.inf, np.inf)
    else:
        assert source.on == pytest.approx(((0.5 - 1.3) / 1.5, (6.5 - 1.3) / 1.5))


@pytest.mark.slow
def test_a_film_knows_the_path_of_its_source(tmp_path):
    from test_playback import LIVE, filmed

    moving = "start: -1, motion: {path: [[0.5, 0.9, 0.7], [1.5, 0.3, 0.6]]}"
    text = LIVE.replace("start: -1}]", f"{moving}}}]").replace("quantities", "")
    filmed(tmp_path, text)
    played = load_scenario(
        tmp_path / "live.yaml", ["gas={kind: playback, file: fields.zarr, start: 0.25}", "fields=null"]
    )
    t = np.array([0.0, 0.25, 1.0, 1.5])
    live = load_scenario(tmp_path / "live.yaml")
    assert played.sources_at(t) == pytest.approx(live.sources_at(t + 0.25), abs=1e-6)
    assert played.sources[0][1].on[0] == -1.25
