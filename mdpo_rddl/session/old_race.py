"""The race on compiled programs, from a request to what the report is made of."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

from mdpo_rddl.auto import RaceOptions, plan_automatically
from mdpo_rddl.auto.common.candidate import Judged
from mdpo_rddl.auto.resuming.start import accepted_start, start_candidates
from mdpo_rddl.session.race import Noise, RaceResult
from mdpo_rddl.session.requests import FindTerms, Incumbent, Reporter


def find_by_old_race(
    terms: FindTerms,
    reporter: Reporter,
    on_judged: Callable[[Judged], object] = lambda judged: None,
    **options: Any,
) -> RaceResult:
    """The race of the preset `auto`.

    Args:
      terms: what to plan.
      reporter: is told how it gets on; what it raises as `Cancelled` ends it.
      on_judged: called with each candidate that was judged.
      **options: others of `RaceOptions`.

    Raises:
      InputError: if the problem or the configuration cannot be used.
    """

    def judged(one: Judged) -> None:
        if one.became_incumbent:
            reporter.incumbent(Incumbent(one.candidate.arm, one.candidate.known_mean))
        on_judged(one)

    given = RaceOptions(
        terms.traced_cache, reporter.stage, reporter.training, on_judged=judged, **options
    )
    if terms.start_from is not None:
        start = accepted_start(terms.start_from, terms.problem)
        initial = functools.partial(start_candidates, policy=start)
        given = dataclasses.replace(given, initial=initial)
    outcome = plan_automatically(terms.problem, terms.config, terms.seed, given)
    chosen, log = outcome.chosen, outcome.noise_log
    noise = None
    if log is not None and log.sigma is not None:
        noise = Noise(log.records, log.sigma)
    promised = None
    if chosen.returns is not None and chosen.mean is not None:
        promised = chosen.mean, chosen.error
    return RaceResult(
        policy=outcome.policy,
        config=outcome.config,
        seconds=outcome.seconds,
        compile_seconds=outcome.compile_seconds,
        interrupted=outcome.interrupted,
        promised=promised,
        diagnostics=outcome.diagnostics(),
        uses_noise=True,  # its configuration says what it is
        noise=noise,
    )
