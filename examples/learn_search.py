"""Learn to find the source of a plume by PPO, and compare the policy with casting in held-out flow realisations.

    pip install "taichi_plume[learn]"
    python examples/learn_search.py --out runs/learn_search

Learning takes about 5 min on a laptop. Output files: bank.zarr (flow realisations of the training, called airs in
the code), policy.onnx, learning.json (success and return over time), result.json (both searches in the same held-out
runs, and the policy in the environment), curves.png and comparison.png.

Held out are the seeds, the flow realisations (other air seeds), and the source positions, which lie between and beyond
the training positions. Both searches run as scenarios, with the same starts in the same flows, each alone. Casting uses
the best of several thresholds in training flows, for a fair comparison.

`--task configs/tasks/search_drone.yaml` trains a drone in space, in about 8 min. `--robots 3` trains a team that shares
the parameters of one policy and observes the messages of its mates; a search of a team ends with its first success.
"""

import argparse
import json
import time
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from taichi_plume.assembly.assemble import assemble
from taichi_plume.engine import program
from taichi_plume.envs import bank as banks
from taichi_plume.envs import export_onnx, sb3_env
from taichi_plume.envs.task import open_task
from taichi_plume.files.bundled import path_of
from taichi_plume.guard.terminal import say
from taichi_plume.scenario.algorithms import Casting, Casting3D
from taichi_plume.scenario.policy import Policy
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scoring.trials import mean_with_interval, share_with_interval

TASK = path_of("tasks/search_whiffs")
THRESHOLDS = (0.5, 1.0, 2.0, 5.0)  # ppm, of casting
HELD_OUT: dict[int, Any] = {
    2: ((0.5, 0.9), (0.5, 2.1), (0.85, 1.5), (0.9, 0.5), (1.3, 0.9), (1.3, 2.3)),
    3: ((0.5, 1.5, 1.1), (0.5, 0.8, 1.1), (1.0, 2.2, 0.6), (1.0, 1.5, 1.6), (1.0, 0.8, 1.1), (1.5, 1.5, 1.1)),
}  # source positions [m] of 2-D and 3-D tasks
LEAST_SPREAD = 0.02  # lower bound for nearly constant observations
FAR = 1000  # offset of the held-out seeds from the training seeds


def main() -> None:
    """Learn, export, compare, draw."""
    args = _arguments()
    torch.set_num_threads(args.threads)
    args.out.mkdir(parents=True, exist_ok=True)
    program.start("cpu")
    scenario, folder = open_task(args.task, args.set)
    if args.robots > 1:
        observed = json.dumps([*policy_of(scenario).observe, "mates"])
        team = [f"robots.0.count={args.robots}", f"robots.0.algorithm.observe={observed}"]
        scenario, folder = open_task(args.task, [*args.set, *team])
    path = args.out / "bank.zarr"
    begun = time.perf_counter()
    try:
        bank = banks.bank_of(scenario, folder, path)
    except ValueError:
        bank = banks.record(scenario, folder)
        bank.write(path)
    say(f"{bank.films} airs of {bank.length:g} s in {time.perf_counter() - begun:.1f} s")
    if not args.evaluate:
        learn(scenario, bank, args)
    result = compare(scenario, folder, args)
    (args.out / "result.json").write_text(json.dumps(result, indent=1))
    draw(args.out, result)
    for name in ("policy", "casting", "environment"):
        say(f"{name}: {words(result[name])}")


def policy_of(scenario: Scenario) -> Policy:
    """Return the policy of the learners. Raises ValueError without one."""
    policy = scenario.learners.algorithm
    if not isinstance(policy, Policy):
        raise ValueError("the task's first group has no policy")
    return policy


def words(scores: dict[str, Any]) -> str:
    """Return a result as one line of text."""
    share, times = scores["success"], scores["time_s"]
    found = (
        f", {times['mean']:.1f} s ({times['low']:.1f} to {times['high']:.1f} s) on success"
        if share["mean"]
        else ""
    )
    airs, censored = scores["over_airs"], scores["censored_time_s"]
    return (
        f"{share['mean']:.1%} of {share['n']} find the source (over {airs['n']} airs {airs['low']:.1%} to "
        f"{airs['high']:.1%}){found}; {censored['mean']:.1f} s ({censored['low']:.1f} to {censored['high']:.1f} s) "
        "including failures"
    )


# ---------------------------------------------------------------- learning


class Progress(BaseCallback):
    """Callback that stops at the time limit and records success and return of each rollout."""

    def __init__(self, minutes: float, begun: float, over: int):
        """over: number of last episodes to average. A small number favours short episodes, as all start at once."""
        super().__init__()
        self.end, self.begun = begun + 60.0 * minutes, begun
        self.curve: list[dict[str, float]] = []
        self._ended: deque[dict[str, float]] = deque(maxlen=over)

    def _on_step(self) -> bool:
        self._ended += [info["search"] for info in self.locals["infos"] if "search" in info]
        return time.perf_counter() < self.end

    def _on_rollout_end(self) -> None:
        if not self._ended:
            return
        found = np.array([one["found"] for one in self._ended])
        times = np.array([one["time_s"] for one in self._ended])
        self.curve.append(
            {
                "wall_s": time.perf_counter() - self.begun,
                "steps": float(self.num_timesteps),
                "success": float(found.mean()),
                "time_s": float(times[found > 0].mean()) if found.any() else float("nan"),
                "return": float(np.mean([one["return"] for one in self._ended])),
            }
        )
        last = self.curve[-1]
        say(
            f"{last['wall_s']:6.0f} s {last['steps']:12,.0f} steps: {last['success']:.1%} found, return "
            f"{last['return']:.3f}"
        )


class Standardised(BaseFeaturesExtractor):
    """Standardised observations, by mean and spread of random episodes: raw values of whiffs are small."""

    def __init__(self, observation_space: Any, mean: np.ndarray, spread: np.ndarray):
        super().__init__(observation_space, len(mean))
        self.register_buffer("mean", torch.as_tensor(mean, dtype=torch.float32))
        self.register_buffer("spread", torch.as_tensor(spread, dtype=torch.float32))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return standardised observations (batch, size)."""
        return (observation - self.mean) / self.spread


def scales(envs: Any, steps: int = 100) -> dict[str, np.ndarray]:
    """Mean and spread of observations under random actions."""
    rng, low, high = np.random.default_rng(0), -1.0, 1.0
    envs.reset()
    actions = (envs.num_envs, envs.action_space.shape[0])
    seen = np.concatenate([envs.step(rng.uniform(low, high, actions))[0] for _ in range(steps)])
    return {"mean": seen.mean(axis=0), "spread": np.maximum(seen.std(axis=0), LEAST_SPREAD)}


def learn(scenario: Scenario, bank: Any, args: argparse.Namespace) -> None:
    """Train by PPO; write policy.onnx and learning.json."""
    envs = sb3_env(scenario, args.envs // args.robots, team=args.robots > 1, bank=bank)
    envs.seed(args.seed)
    begun = time.perf_counter()

    def rate(_: float) -> float:
        """Learning rate, falling with wall-clock time, as the number of steps is unknown beforehand."""
        return 1e-3 * max(0.1, 1.0 - (time.perf_counter() - begun) / (60.0 * args.minutes))

    model = PPO(
        "MlpPolicy",
        envs,
        n_steps=args.rollout,
        batch_size=max(64, args.envs * args.rollout // 8),
        n_epochs=5,
        learning_rate=rate,
        gamma=0.99,
        gae_lambda=0.95,
        ent_coef=1e-3,
        policy_kwargs={
            "net_arch": [64, 64],
            "log_std_init": -0.7,
            "features_extractor_class": Standardised,
            "features_extractor_kwargs": scales(envs),
        },
        seed=args.seed,
        device="cpu",
    )
    progress = Progress(args.minutes, begun, 2 * args.envs)
    model.learn(10**9, callback=progress)
    export_onnx(model, args.out / "policy.onnx")
    scores = {
        "task": args.task.name,
        "minutes": args.minutes,
        "environments": args.envs,
        "seed": args.seed,
        "steps": model.num_timesteps,
        "wall_s": time.perf_counter() - begun,
        "cpu_s": time.process_time(),
        "curve": progress.curve,
    }
    (args.out / "learning.json").write_text(json.dumps(scores, indent=1))
    envs.close()


# ---------------------------------------------------------------- comparing


def compare(scenario: Scenario, folder: Path, args: argparse.Namespace) -> dict[str, Any]:
    """Compare both searches in the same held-out scenarios, and the policy in the environment."""
    threshold = best_threshold(scenario, folder, args)
    casting, places = casting_of(scenario, threshold), HELD_OUT[scenario.domain.dim]
    policy = policy_of(scenario).model_copy(update={"file": "policy.onnx"})
    result: dict[str, Any] = {"casting_threshold_ppm": threshold, "held_out_places": places}
    for name, algorithm, at in (("policy", policy, args.out), ("casting", casting, folder)):
        result[name] = runs(scenario, algorithm, at, places, FAR, args.airs, args.trials)
    result["environment"] = in_environment(scenario, folder, args)
    return result


def casting_of(scenario: Scenario, threshold: float) -> Casting | Casting3D:
    """Return casting with a threshold [ppm], along the floor or for drones in space."""
    if not scenario.learners.body.flies:
        return Casting(kind="casting", threshold_ppm=threshold)
    return Casting3D(kind="casting_3d", threshold_ppm=threshold)


def alone(scenario: Scenario, algorithm: Any, place: tuple[float, ...], shift: int, trials: int) -> Scenario:
    """Scenario of a search for one source at a position, in the flow of another seed."""
    gas = scenario.gases[0][1]
    source = gas.sources[0].model_copy(update={"position": place})
    group = scenario.learners.model_copy(update={"algorithm": algorithm, "trials": trials})
    return scenario.model_copy(
        update={
            "gas": gas.model_copy(update={"sources": (source,)}),
            "seed": scenario.seed + shift,
            "air_seed": scenario.seed_of_air + shift,
            "robots": (group,),
            "duration": scenario.task.episode,
        }
    )


def runs(
    scenario: Scenario, algorithm: Any, folder: Path, places: Any, shift: int, airs: int, trials: int
) -> dict[str, Any]:
    """Result of a search, run as an ordinary scenario, for each source position in each of several flows."""
    sim, found, times, by_run = None, [], [], []
    for p, place in enumerate(places):
        for k in range(airs):
            one = alone(scenario, algorithm, place, shift + p * airs + k, trials)
            if sim is None:
                sim = assemble(one, folder)
            else:
                sim.reset(one)
            sim.run()
            ends = sim.swarm.found_time.to_numpy().reshape(trials, -1)
            times.append(np.nan_to_num(ends, nan=one.duration).min(axis=1))
            has = np.isfinite(ends).any(axis=1)
            found.append(has)
            by_run.append(
                {"place": place, "air": k, "success": float(has.mean()), "time_s": float(times[-1].mean())}
            )
    air = np.repeat(np.arange(len(found)), trials)
    return summary(np.concatenate(found), np.concatenate(times), air) | {"runs": by_run}


def summary(found: np.ndarray, times: np.ndarray, air: np.ndarray) -> dict[str, Any]:
    """Success with Wilson's interval, and times; in the censored time, a failure counts with the full duration.

    air: number of the flow realisation of each search. Intervals of over_airs and of the censored time are those of the
    means of the realisations, in which searches are alike.
    """
    alike = [air == n for n in np.unique(air)]
    return {
        "success": share_with_interval(int(found.sum()), len(found)),
        "over_airs": mean_with_interval(np.array([found[one].mean() for one in alike]), most=1.0),
        "time_s": mean_with_interval(times[found]),
        "censored_time_s": mean_with_interval(np.array([times[one].mean() for one in alike])),
    }


def best_threshold(scenario: Scenario, folder: Path, args: argparse.Namespace) -> float:
    """Threshold of casting with the shortest mean time in training flows and with training positions."""
    places = [tuple(gas.sources[0].position) for _, gas in scenario.gases][::3]
    scores = {
        threshold: runs(scenario, casting_of(scenario, threshold), folder, places, 0, 2, args.trials)
        for threshold in THRESHOLDS
    }
    return min(scores, key=lambda threshold: scores[threshold]["censored_time_s"]["mean"])


def in_environment(scenario: Scenario, folder: Path, args: argparse.Namespace) -> dict[str, Any]:
    """Result of the ONNX file in the environment itself, with held-out flows and source positions."""
    import onnxruntime

    gas = scenario.gases[0][1]
    parts = tuple(
        gas.model_copy(update={"sources": (gas.sources[0].model_copy(update={"position": place}),)})
        for place in HELD_OUT[scenario.domain.dim]
    )
    held = scenario.model_copy(
        update={
            "gas": scenario.gas.model_copy(update={"parts": parts}),
            "air_seed": scenario.seed_of_air + FAR,
            "task": scenario.task.model_copy(update={"airs": args.airs}),
        }
    )
    envs = sb3_env(held, args.trials, team=args.robots > 1, bank=banks.record(held, folder))
    envs.seed(FAR)
    session = onnxruntime.InferenceSession(str(args.out / "policy.onnx"), providers=["CPUExecutionProvider"])
    seen, ended = envs.reset(), []
    per, count = args.airs * len(parts), np.zeros(envs.num_envs, int)
    while (
        count.min() < per
    ):  # equal numbers of episodes per environment: otherwise short episodes would count more often
        seen, _, over, infos = envs.step(session.run(None, {"observation": seen})[0])
        alone = (
            over & (count < per) & (np.arange(len(over)) % args.robots == 0)
        )  # a team's outcome counts once
        ended += [infos[e]["search"] for e in np.flatnonzero(alone)]
        count += over
    envs.close()
    found = np.array([one["found"] for one in ended]) > 0
    times = np.array([one["time_s"] for one in ended])
    airs = np.array([one["film"] * len(parts) + one["source"] for one in ended])
    return summary(found, np.where(found, times, scenario.task.episode), airs)


# ---------------------------------------------------------------- drawing


def draw(out: Path, result: dict[str, Any]) -> None:
    """Draw curves.png of learning and comparison.png of success and time."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    scores = json.loads((out / "learning.json").read_text())
    minutes = np.array([one["wall_s"] for one in scores["curve"]]) / 60
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    left.plot(minutes, [one["success"] for one in scores["curve"]])
    left.axhline(
        result["casting"]["success"]["mean"], color="tab:orange", linestyle="--", label="casting, held out"
    )
    left.axhline(
        result["policy"]["success"]["mean"], color="tab:blue", linestyle="--", label="policy, held out"
    )
    left.set(xlabel="minutes of learning", ylabel="episodes that find the source", ylim=(0, 1.02))
    left.legend()
    right.plot(minutes, [one["return"] for one in scores["curve"]])
    right.set(xlabel="minutes of learning", ylabel="return")
    figure.savefig(out / "curves.png", dpi=150)
    figure, axes = plt.subplots(1, 2, figsize=(7, 3.2), layout="constrained")
    names = ["casting", "policy", "environment"]
    share = np.array([result[name]["success"]["mean"] for name in names])
    ends = np.array([[result[name]["success"][end] for end in ("low", "high")] for name in names])
    axes[0].bar(
        names, share, yerr=np.abs(ends.T - share), color=["tab:orange", "tab:blue", "tab:cyan"], capsize=4
    )
    axes[0].set(ylabel="success, with Wilson's interval", ylim=(0, 1.05))
    axes[1].bar(
        names,
        [result[name]["censored_time_s"]["mean"] for name in names],
        color=["tab:orange", "tab:blue", "tab:cyan"],
    )
    axes[1].set(ylabel="mean time, failures count in full [s]")
    figure.savefig(out / "comparison.png", dpi=150)
    plt.close("all")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Learn a task by PPO, and compare the policy with casting.")
    parser.add_argument(
        "--task", type=Path, default=TASK, help="scenario with a mixture of gases of one source each"
    )
    parser.add_argument("--out", type=Path, default=Path("runs/learn_search"))
    parser.add_argument(
        "--set", action="append", default=[], metavar="PATH=VALUE", help="change a key of the task"
    )
    parser.add_argument("--minutes", type=float, default=5.0, help="training time")
    parser.add_argument("--envs", type=int, default=256, help="environments at once")
    parser.add_argument("--robots", type=int, default=1, help="robots of a team, which shares the policy")
    parser.add_argument("--rollout", type=int, default=45, help="decisions per environment between updates")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=2, help="threads of torch")
    parser.add_argument("--trials", type=int, default=100, help="trials of each held-out run")
    parser.add_argument("--airs", type=int, default=4, help="held-out flow realisations per source position")
    parser.add_argument(
        "--evaluate", action="store_true", help="compare an existing policy, without training"
    )
    return parser.parse_args()


if __name__ == "__main__":
    main()
