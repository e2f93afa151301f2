"""Replan at every decision, from the state that the exact environment shows."""

import csv
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from mdpo_rddl.machine.versions import package_versions
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.budgets import DECISION_SECONDS, JAXPLAN_EPOCHS
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.training import bound_calls
from mdpo_rddl.planner.upstream import JaxOnlineController
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.session.report.run_folder import SUMMARY, RunFolder, write_json
from mdpo_rddl.session.report.summary import identity, return_figures
from mdpo_rddl.session.requests import PlanRequest, Reporter

_CALLS_IN_A_DECISION = 10


class Decision(NamedTuple):
    """How one decision was made.

    Attributes:
      episode, step: when, both from 0.
      iterations: gradient steps done.
      seconds: wall time, from the state to the action.
      best_return: smoothed test return of the plan acted on, over the lookahead.
      mean_sigma: the noise's scale at the last iteration, averaged over the lookahead.
    """

    episode: int
    step: int
    iterations: int
    seconds: float
    best_return: float
    mean_sigma: float


class OnlinePolicy:
    """Plays by replanning with JaxPlan's online controller, warm-started from step to step.

    Attributes:
      decisions: every decision so far.
    """

    def __init__(self, planner: MDPOPlanner, seed: int, optimize_args: Mapping[str, Any]) -> None:
        silent = {"print_summary": False, "print_progress": False}
        self._controller = JaxOnlineController(
            planner,
            key=jax.random.PRNGKey(seed),
            max_attempts=0,  # everything is compiled before the first decision
            **{**optimize_args, **silent},
        )
        self.decisions: list[Decision] = []
        self._episode = -1

    def compile(self, state: Mapping[str, Any]) -> float:
        """Makes a cold and some warm decisions, and forgets them.

        The planner's calls become so short that a decision can keep to its time.

        Args:
          state: any state, as the environment shows it.

        Returns:
          The seconds that it took.
        """
        started = time.perf_counter()
        arguments = self._controller.train_kwargs
        self._controller.train_kwargs = {**arguments, "epochs": 2, "train_seconds": 1e9}
        planner = self._controller.planner
        sizes = planner.iterations_per_call, planner.test_every
        if planner.in_calls:
            planner.iterations_per_call = planner.test_every = 1
        for _ in range(3):
            began = time.perf_counter()
            self._controller.sample_action(dict(state))
        if planner.in_calls:
            planner.iterations_per_call, planner.test_every = sizes
            seconds = (time.perf_counter() - began) / 2
            bound_calls(planner, arguments["train_seconds"] / _CALLS_IN_A_DECISION / seconds)
        self._controller.train_kwargs = arguments
        self._controller.reset()
        return time.perf_counter() - started

    def __call__(self, step: int, state: Mapping[str, Any]) -> Mapping[str, Any]:
        """The action for a state; step 0 begins a new episode."""
        if step == 0:
            self._episode += 1
            self._controller.reset()
        started = time.perf_counter()
        action = self._controller.sample_action(dict(state))
        seconds = time.perf_counter() - started
        callback = self._controller.callback
        sigma = float(np.mean(callback["sigma"]))
        best = float(callback["best_return"])
        iterations = callback["iteration"] + 1
        decision = Decision(self._episode, step, iterations, seconds, best, sigma)
        self.decisions.append(decision)
        return action


def replan(request: PlanRequest, reporter: Reporter) -> dict[str, Any]:
    """Plays the exact environment by replanning at every decision, and writes the run folder.

    The budget of a decision is `train_seconds` and `epochs` of `[Optimize]`; compilation is
    done before the first one and counts in none.

    Returns:
      The summary, as `summary.json` holds it.

    Raises:
      InputError: as `plan` does.
    """
    with RunFolder(request.out) as folder:
        reporter.stage("compiling")
        planner, optimize_args = build_planner(request.problem, request.config)
        optimize_args.pop("key", None)
        budget = {
            "train_seconds": optimize_args.pop("train_seconds", DECISION_SECONDS),
            # JaxPlan divides by epochs - 1
            "epochs": max(2, optimize_args.pop("epochs", JAXPLAN_EPOCHS)),
        }
        policy = OnlinePolicy(planner, request.seed, {**optimize_args, **budget})
        env = make_environment(request.problem)
        compile_seconds = policy.compile(env.reset(seed=request.seed)[0])
        reporter.stage("replanning")
        done = iter(range(1, request.episodes + 1))
        found = evaluate(
            env,
            policy,
            request.episodes,
            request.seed,
            lambda: reporter.episode(next(done), request.episodes),
        )
        seconds = [decision.seconds for decision in policy.decisions]
        summary = {
            **identity(
                request.problem,
                request.config,
                planner,
                config_name=request.config_name,
                seed=request.seed,
                episodes=request.episodes,
            ),
            **return_figures(found),
            "mode": "replan",
            "lookahead": planner.horizon,
            "decision_seconds": budget["train_seconds"],
            "decision_iterations": budget["epochs"],
            "decisions": len(policy.decisions),
            "mean_iterations": float(np.mean([d.iterations for d in policy.decisions])),
            "mean_seconds": float(np.mean(seconds)),
            "max_seconds": float(np.max(seconds)),
            "restarts": planner.parallel_updates,
            "batch": planner.batch_size_train,
            "compile_seconds": compile_seconds,
            "device": str(jax.devices()[0]),
            "versions": package_versions(),
        }
        config = {
            "source": request.config_name,
            "sections": request.config.sections,
            "seed": request.seed,
            "episodes": request.episodes,
        }
        with folder.writing():
            _write_decisions(folder.staging / "decisions.csv", policy.decisions)
            write_json(folder.staging / "config.json", config)
            write_json(folder.staging / SUMMARY, summary)
        folder.commit()
    return summary


def _write_decisions(path: Path, decisions: list[Decision]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(Decision._fields)
        writer.writerows(decisions)
