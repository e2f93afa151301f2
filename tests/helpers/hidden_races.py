"""Races of a partially observed problem of which the ends are told beforehand."""

from types import SimpleNamespace

from helpers.clocks import Stopped
from helpers.lakes import preset
from mdpo_rddl.auto import RaceOptions, RaceOutcome, plan_automatically
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.hidden import partially_observed, underlying_optimum

LONG = preset(100.0)


def race_outcome(policy, interrupted=False):
    """Of a race that found the policy in a second."""
    candidate = Candidate("own weights", "own weights", LONG, None, {}, mean=1.0)
    rest = {"noop_return": None, "random_return": None, "compile_seconds": 0.25}
    probe = SimpleNamespace(compile_seconds=0.25)
    ended = {"seconds": 1.0, "interrupted": interrupted}
    return RaceOutcome(policy, candidate, (), [], probe=probe, **ended, **rest)


def told_races(monkeypatch):
    """Plans with races of which the seconds are noted, and which give what they are told to."""

    def use(first, second=None, without=(), enumerates=True, clock=None, takes=0.0, earlier=None):
        asked, lefts, latest, ends = [], [], [], iter((first, second))

        def run(problem, config, seed, options):
            asked.append((bool(problem.model.observ_fluents), config.budget().seconds))
            lefts.append(config.section("Search")["without"])
            latest.append(options.at_the_latest)
            if clock is not None:
                clock.now = max(clock.now + takes, options.at_the_latest)
            end = next(ends)
            if isinstance(end, BaseException):
                raise end
            return end

        monkeypatch.setattr(partially_observed, "run_race", run)
        if not enumerates:
            monkeypatch.setattr(underlying_optimum, "is_discrete", lambda problem: False)
        stages, judged = [], []
        options = RaceOptions(
            on_stage=stages.append,
            on_judged=judged.append,
            clock=clock or Stopped(),
            earlier=earlier,
        )
        problem = first.policy.problem
        config = LONG.with_values("Search", without=[*without])
        outcome = plan_automatically(problem, config, 0, options)
        told = {"outcome": outcome, "stages": stages, "judged": judged}
        return SimpleNamespace(asked=asked, lefts=lefts, latest=latest, **told)

    return use
