"""What random actions return."""

import time

import numpy as np
import pytest
from helpers.probes import probed

from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.planner.config.fitting import scaled, without_scales
from mdpo_rddl.auto.probing.probing import boxes
from mdpo_rddl.auto.search.random_play import mean_until, random_plans
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.problem.load import load_problem

DOMAIN = """
domain pushed {
  pvariables {
    ground : { state-fluent, real, default = 0.0 };
    push : { action-fluent, real, default = 0.0 };
    pull : { action-fluent, bool, default = false };
  };
  cpfs { ground' = ground; };
  reward = push + 10.0 * pull;
  action-preconditions { push >= 0.0; push <= 3.0; };
}
"""
INSTANCE = """
non-fluents nf { domain = pushed; }
instance i {
  domain = pushed; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 40; discount = 1.0;
}
"""


def test_each_action_is_drawn_from_its_box_at_every_step(tmp_path):
    domain, instance = tmp_path / "d.rddl", tmp_path / "i.rddl"
    domain.write_text(DOMAIN)
    instance.write_text(INSTANCE)
    problem = load_problem(str(domain), str(instance))
    config = auto_preset("pushed").without_section("Search")
    seen = probed(build_planner(problem, without_scales(config)).planner, seed=0)
    planner = build_planner(problem, scaled(config, seen)).planner
    judge = Judge(2, 0, time.monotonic, time.monotonic())
    config = config.without_section("Search")

    def played(params):
        return judge.returns_of(Candidate("", "random", config, planner, params))

    def found(seed):
        plans = random_plans(planner.feedback_plan.noop(0), boxes(planner, seen.units), seed)
        return mean_until(map(played, plans), lambda: False)

    # 1.5 of the real at each step, and 10 of a bool that is true at every other
    assert found(0) == pytest.approx(40 * (1.5 + 5.0), rel=0.05)
    assert found(0) == found(0) != found(1)


def test_the_mean_is_that_of_what_there_was_time_for():
    over = iter([False, True])
    returns = [np.array(each) for each in ([1.0], [3.0, 5.0], [100.0])]
    assert mean_until(returns, lambda: next(over)) == 2.5
