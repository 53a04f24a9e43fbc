# pyright: strict
"""All public names, as a strict type checker sees them."""

import taichi_plume as tp


class Upwind:
    def __init__(self, speed: float = 0.2):
        self.speed = speed

    def act(self, robots: tp.Robots) -> None:
        robots.speed[:] = self.speed * robots.prior(0.1).max()


def use() -> None:
    scenario = tp.Scenario.from_file("casting_room").with_({"robots.0.count": 6})
    check = scenario.check()
    print(check.errors, check.warnings, check.size["cells"], scenario.to_yaml(), scenario.domain.spacing)
    loaded: tp.Scenario = tp.load_scenario({"name": "a"}, ["robots.0.count=3"])
    scenario.plot()
    try:
        run: tp.Run = tp.simulate(loaded, seed=3, overrides={"duration": "2 s"}, duration=2, out="run")
    except (tp.InputError, tp.ScenarioError, tp.RunFolderError) as error:
        print(error.lines)
        return
    except tp.RunError as error:
        print(error.status, error.lines, error.folder)
        return
    except tp.UnstableError:
        return
    run = tp.open_run(run.folder)
    run.plot(at=20)
    axes = run.plot(at=20, figsize=(4, 3)).gca()
    run.plot(at=20, ax=axes)
    run.animate()
    run.show()
    print(
        run.robots, run.trials, run.maps, run.gas_at(1.0, 2.0), run.sources_at(1.0), run.fields, run.pictures
    )
    print(tp.cite(run), run.scenario.sources_at(1.0))
    print(tp.picture(run.folder, at="20 s"), tp.export(run.folder, to="csv"), tp.repair(run.folder))
    with tp.Simulation(scenario, overrides={"robots.0.algorithm": tp.Own(Upwind, speed=0.3)}) as sim:
        sim.every(1.0, lambda now: print(now.t))
        sim.step()
        sim.run(until=20)
        sim.change({"gas.sources.0.rate": "1 mg/s"})
        sim.write("fields.zarr", every=1.0)
        sim.reset(seed=4)
        print(sim.gas, sim.wind, sim.temperature, sim.robots)
        sim.plot()
    gas_map = tp.maps(run, {"kind": "gmrf", "cell": "20 cm"}, sources=[(1.0, 2.0)])
    print(gas_map.data, gas_map.scores["peak"], gas_map.estimate.max())
    gas_map.plot()
    air = tp.dispersion(run, diffusivity=0.02)
    print(air.adjoint(air.at((1.0, 2.0))), air.concentration(air.at((1.0, 1.0))).max())
    plume = tp.statistics(run, threshold="5 ppm", sensors=[{"kind": "pid"}])
    print(plume.points, plume.durations, plume.spectra, plume.maps, plume.notes)
    tp.study("studies/wind_speeds", shard=(1, 2))
    results = tp.study("studies/wind_speeds", workers=2)
    print(tp.open_study(results.folder).points(), results.trials(), results.differences("speed"))
    standings: tp.Standings = tp.contest(["casting"], quick=True, files=["own.py"], allow_code=True)
    print(standings.table, standings.study("open_2d").runs())
    tp.envs.parallel_env(scenario="task.yaml")
    tp.envs.sb3_env(scenario="task.yaml", num_envs=4, team=True)
