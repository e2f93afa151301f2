"""The planner against hand-written rules.

    python tools/against_rules.py ROWS SECONDS SEED NAME...

Each NAME is a folder of `tools/rules`, with a domain, an instance, and the rule of somebody who
knows the problem. The planner has SECONDS for it. Then its policy, the rule and the no-op play
`EPISODES` episodes of the exact environment, the same for all. `lead` is the mean of what the
policy returns more than the rule in an episode, `lead_error` its standard error. A row is added to
ROWS for each problem; one that is there already is not made again.
"""

import csv
import importlib.util
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyRDDLGym
from rows import Rows

import mdpo_rddl as mdpo
from mdpo_rddl.problem.evaluation import episode_seeds, mean_and_error

EPISODES = 40
COLUMNS = (
    *("problem", "seconds", "seed", "policy", "policy_error", "rule", "rule_error", "noop"),
    *("lead", "lead_error", "commit"),
)
RULES = Path(__file__).with_name("rules")
# far from the seeds of races
_EPISODES_SEED = 2024

Rule = Callable[[Mapping[str, Any], int], Mapping[str, Any]]
"""(state per ground fluent, step) -> action per ground fluent."""


def files_of(name: str) -> tuple[str, str]:
    """The domain and the instance of a problem."""
    return str(RULES / name / "domain.rddl"), str(RULES / name / "instance.rddl")


def rule_of(name: str) -> Rule:
    """The hand-written rule of a problem."""
    spec = importlib.util.spec_from_file_location(f"rule_of_{name}", RULES / name / "rule.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.rule


def returns(name: str, rule: Rule, reset: Callable[[], object] = lambda: None) -> np.ndarray:
    """The return of each episode [EPISODES]; an illegal action raises an error.

    Args:
      name: of the problem.
      rule: plays it.
      reset: called as an episode begins.
    """
    env = pyRDDLGym.make(*files_of(name), vectorized=False, enforce_action_constraints=True)
    found = []
    for seed in episode_seeds(_EPISODES_SEED, EPISODES):
        reset()
        found.append(_episode(env, rule, seed))
    return np.array(found)


def _episode(env: Any, rule: Rule, seed: int) -> float:
    state, _ = env.reset(seed=seed)
    total = 0.0
    for step in range(env.horizon):
        state, reward, terminated, truncated, _ = env.step(dict(rule(state, step)))
        total += reward
        if terminated or truncated:
            break
    return total


def measured(name: str, seconds: float, seed: int) -> dict[str, str]:
    """What planning, the rule and the no-op return."""
    policy = mdpo.plan(*files_of(name), seconds=seconds, seed=seed)
    planned = returns(name, lambda state, _: policy.sample_action(state), policy.reset)
    ruled = returns(name, rule_of(name))
    numbers = {
        **dict(zip(("policy", "policy_error"), mean_and_error(planned), strict=True)),
        **dict(zip(("rule", "rule_error"), mean_and_error(ruled), strict=True)),
        "noop": float(returns(name, lambda state, step: {}).mean()),
        **dict(zip(("lead", "lead_error"), mean_and_error(planned - ruled), strict=True)),
    }
    digits = {key: 3 if key.endswith("_error") else 6 for key in numbers}
    return {key: f"{value:.{digits[key]}g}" for key, value in numbers.items()}


def made(path: str) -> set[tuple[str, float, int]]:
    """The problem, the seconds and the seed of each row that is there."""
    with Path(path).open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {(row["problem"], float(row["seconds"]), int(row["seed"])) for row in rows}


def main() -> None:
    """Adds the rows."""
    path, seconds, seed, *names = sys.argv[1:]
    rows = Rows(path, COLUMNS)
    for name in names:
        if (name, float(seconds), int(seed)) not in made(path):
            given = {"problem": name, "seconds": seconds, "seed": seed}
            rows.add({**given, **measured(name, float(seconds), int(seed))})


if __name__ == "__main__":
    main()
