"""Rehearsal of a run in real time: compilation of kernels that are first launched later than in the first tick.

Maps end windows, belief algorithms take in whole periods and scores are computed every few seconds. Each of these
launches kernels for the first time, whose compilation would take many ticks of the clock.
"""

from math import ceil

from taichi_plume.agents.own_algorithm import OwnAlgorithm
from taichi_plume.grid.state import State
from taichi_plume.scoring.beliefs import BeliefScores
from taichi_plume.scoring.maps import LOOKS, MapScores
from taichi_plume.scoring.trials import PERIOD
from taichi_plume.time_loop import TimeLoop


def rehearse(sim: TimeLoop) -> None:
    """Run robots, maps, algorithms and scores in standing air through two of their longest periods; then restore `sim`.

    Users' own algorithms do not act: they launch no kernels, and may write files.
    """
    state = State(sim)
    saved = state.save()
    periods = [gas_map.window or 0.0 for gas_map in sim.maps]
    periods += [vars(group.algorithm).get("period") or 0.0 for group in sim.scenario.robots]
    end = ceil(2.0 * max(PERIOD, *periods) / sim.dt) + 1
    maps, beliefs = MapScores(sim), BeliefScores(sim)
    every = max(1, round(LOOKS / sim.dt))
    for tick in range(min(end, sim.last_tick) + 1):
        sim.tick = tick
        if tick > 0:
            sim.advance_robots([team for team in sim.teams if not isinstance(team.algorithm, OwnAlgorithm)])
        if tick % every == 0:
            maps.sample(sim)
            beliefs.sample(sim)
    state.restore(saved)
