"""Races by a clock that does not wait."""

from helpers.clocks import Ticking
from helpers.lakes import preset
from mdpo_rddl.auto import RaceOptions, plan_automatically

CLOCK = Ticking()


def raced(problem, ticks: float, options: RaceOptions | None = None, **search):
    """A race of so many ticks of the clock, which an iteration of a search takes three of."""
    options = options or RaceOptions(clock=CLOCK, most_iterations=60)
    return plan_automatically(problem, preset(ticks, **search), 0, options)


def means_of(judge) -> dict[str, float]:
    """The mean return of the latest candidate of each label."""
    return {judged.candidate.label: judged.candidate.mean for judged in judge.judged}


def means(outcome) -> dict[str, float]:
    """As `means_of`, by the judge of a race."""
    return means_of(outcome)
