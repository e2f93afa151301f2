"""From a problem to the best policy that the arms find in the time given."""

import logging
from dataclasses import replace

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arena.judge import ROLLOUTS, Judge, rollouts_for
from mdpo_rddl.auto.arena.probed import Probed
from mdpo_rddl.auto.arms.dynamic_programming import DynamicProgrammingArm
from mdpo_rddl.auto.common.candidate import NOOP, Candidate, Judged
from mdpo_rddl.auto.common.compilations import TooLateError
from mdpo_rddl.auto.common.sizes import plans_fit
from mdpo_rddl.auto.outcome.confirmation import confirm
from mdpo_rddl.auto.outcome.failures import incumbent_kept, one_line_errors
from mdpo_rddl.auto.outcome.first_policy import first_policy
from mdpo_rddl.auto.outcome.outcome import RaceOutcome, policy_of
from mdpo_rddl.auto.outcome.unjudged import (
    NothingPlayedError,
    ended_by,
    known_kept,
    left_at,
    noop_of,
    record_found,
    unjudged_outcome,
)
from mdpo_rddl.auto.probing.fitting import (
    scaled,
    simplified,
    with_memory,
    with_single_rollouts,
    without_pairs,
    without_plan,
    without_scales,
)
from mdpo_rddl.auto.probing.probing import constants_for, probe
from mdpo_rddl.auto.probing.raising import RAISING_SHARE, watched
from mdpo_rddl.auto.race.early_rules import EarlyRulesArm
from mdpo_rddl.auto.race.ground_arms import GroundArms, GroundSlices
from mdpo_rddl.auto.race.options import RaceOptions
from mdpo_rddl.auto.race.schedule import Schedule
from mdpo_rddl.errors import Cancelled, note_heard
from mdpo_rddl.machine.device import computing_on
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.search_section import SEARCH, read_search
from mdpo_rddl.planner.config.search_section import Search as Shares
from mdpo_rddl.planner.device import fitting_device
from mdpo_rddl.planner.programs.quick import jit_for
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.problem.enumeration.discrete import is_discrete
from mdpo_rddl.problem.load import Problem

logger = logging.getLogger(__name__)

_PROBING_SEED = 0
# of the time: the no-op's episodes, before anything else
_FIRST_SHARE = 0.05
# of the time: the result's episodes on the environment, and how late they may be
_CONFIRMING_SHARE = 0.02
_LATE_SHARE = 0.05


def run_race(
    problem: Problem, config: PlannerConfig, seed: int, options: RaceOptions
) -> RaceOutcome:
    """Finds a policy by the race alone.

    The arguments and what is raised are those of `mdpo_rddl.auto.planning.plan_automatically`.
    """
    clock, earlier = options.clock, options.earlier
    used = 0.0 if earlier is None else earlier.seconds
    started = clock() - used
    options.on_begun(lambda: clock() - started)
    seconds, shares = config.budget().seconds, _shares(config)
    if not problem.model.observ_fluents:  # else it was watched before
        by = clock() + RAISING_SHARE * seconds
        problem = watched(problem, lambda: clock() < by)
    with computing_on(fitting_device(problem)), one_line_errors(problem):
        ground = GroundSlices(problem, config, seed, options, shares)
        exact = ground.arms.exact
        if exact is not None:
            options.on_stage("enumerating")
        first = None
        # a race that goes on has something better already
        is_ground = exact is not None or (problem.raises and is_discrete(problem))
        if is_ground and earlier is None:
            until = clock() + _FIRST_SHARE * seconds
            first = first_policy(problem, config, seed, lambda: clock() < until)
        if first is not None:
            options.on_judged(Judged(first, clock() - started, became_incumbent=True))
        try:
            if exact is not None:
                ground.enumerate(started + seconds)
                if exact.solution is not None:
                    return _proven(exact, seed, started, options)
                ground.search(started + seconds, options.on_stage)
            options.on_stage("probing")
            options.on_pulse()
            arena = _arena(problem, config, seed, started, options)
            return _raced(arena, shares, ground.arms, options)
        except (KeyboardInterrupt, Cancelled, NothingPlayedError) as end:
            note_heard(end)
            if exact is not None and exact.solution is not None:
                return replace(_proven(exact, seed, started, options), interrupted=True)
            left = left_at(end, first, earlier, problem, seed)
            seconds = clock() - started
            outcome = unjudged_outcome(left, ground.arms.all, problem, seed, seconds)
            return replace(ended_by(outcome, end), earlier=options.earlier_curve)


def _raced(arena: Arena, shares: Shares, ground: GroundArms, options: RaceOptions) -> RaceOutcome:
    """The race of all arms but the exact one.

    Raises:
      KeyboardInterrupt, Cancelled: if interrupted before any candidate was judged.
    """
    initial = [*options.initial(arena)]
    schedule = Schedule(arena, shares, options.on_stage, initial)
    interrupted, chosen = False, None
    schedule.arms += [] if ground.exact is None else [ground.exact]
    schedule.plans, schedule.early = ground.plans, ground.trials
    try:
        rules = EarlyRulesArm(arena)
        early = [arm for arm in (ground.plans, ground.trials, rules) if arm is not None]
        with known_kept(arena, options.earlier, early), incumbent_kept(arena.judge):
            if options.earlier is not None:
                # the first that is left is the incumbent, so that the result is not worse
                for candidate in options.earlier.candidates(arena):
                    arena.judge.record(candidate)
            if options.earlier is None and not initial:
                rules.play()
            schedule.run()
        end = arena.began + arena.config.budget().seconds
        late = end + _LATE_SHARE * (end - arena.began)
        with incumbent_kept(arena.judge):
            chosen = confirm(arena, end, late)
    except (KeyboardInterrupt, Cancelled) as stop:
        note_heard(stop)
        if arena.judge.incumbent is None:
            raise
        record_found(arena.judge, early)
        logger.warning("interrupted: the best policy so far is kept")
        interrupted = True
    finally:
        arena.compilations.close()
        for arm in schedule.arms:
            arm.close()
    outcome = _outcome(schedule, arena, interrupted, chosen)
    outcome = replace(outcome, earlier=options.earlier_curve)
    policy = outcome.policy
    if isinstance(policy, Policy):
        policy = replace(policy, candidates=tuple(outcome.curve))
    return replace(outcome, policy=policy)


def _shares(config: PlannerConfig) -> Shares:
    return read_search(config.sections) or Shares()


def _proven(
    arm: DynamicProgrammingArm, seed: int, began: float, options: RaceOptions
) -> RaceOutcome:
    """The outcome of a race that nobody can win any more."""
    assert arm.solution is not None
    assert arm.proven is not None
    candidate, policy = arm.proven, arm.solution.policy(seed)
    judge = Judge(ROLLOUTS, seed, options.clock, began, options.on_judged)
    judge.record(candidate)
    arm.judged(candidate)
    return RaceOutcome(
        policy=policy,
        chosen=candidate,
        judged=judge.judged,
        arms=[arm.log],
        probe=None,
        noop_return=None,
        random_return=None,
        compile_seconds=0.0,
        seconds=options.clock() - began,
        interrupted=False,
        earlier=options.earlier_curve,
    )


def _arena(
    problem: Problem, config: PlannerConfig, seed: int, began: float, options: RaceOptions
) -> Arena:
    """Probes, and compiles the planner that suits the problem."""
    clock, shares = options.clock, _shares(config)
    seconds = config.budget().seconds
    longest = max(seconds, options.at_the_latest - began)
    now, deadline, latest = clock(), _deadline(began, seconds), _deadline(began, longest)
    config = config.without_section(SEARCH)
    # the same for all seeds, whose programs then are the same too
    plain = without_scales(config)
    bare = build_planner(problem, plain).planner
    until = now + shares.shared_until * (deadline - now)
    probed = Probed(plain, constants_for(bare, _PROBING_SEED, until, clock, latest))
    try:
        seen = probe(probed.plays, _PROBING_SEED)
    except TooLateError as error:
        raise NothingPlayedError(noop_of(bare, plain, seed), clock() - now) from error
    if now < deadline < latest and clock() + seen.compile_seconds > deadline:
        # the judge's program would come too late
        deadline, config = latest, config.with_values("Optimize", train_seconds=longest)
    config = with_memory(scaled(config, seen), problem)
    large = seen.policy_seconds is not None
    if large:
        config = simplified(config)
    elif not plans_fit(bare):
        config = without_plan(config)
    if seen.certain:
        config = without_pairs(with_single_rollouts(config))
    jit = jit_for(deadline - began)
    planner = build_planner(problem, config, options.traced_cache, jit=jit).planner
    rollouts = seen.judge_rollouts(rollouts_for(problem), deadline - clock())
    judge = Judge(rollouts, seed, clock, began, options.on_judged, deadline)
    judge.program_seconds = seen.compile_seconds
    return Arena(
        problem=problem,
        config=config,
        planner=planner,
        probe=seen,
        judge=judge,
        seed=seed,
        deadline=deadline,
        clock=clock,
        search_share=shares.shared_until,
        began=began,
        most_iterations=options.most_iterations,
        on_progress=options.on_progress,
        pulse=options.on_pulse,
        probed=None if large else probed,
    )


def _deadline(began: float, seconds: float) -> float:
    return began + (1.0 - _CONFIRMING_SHARE) * seconds


def _outcome(
    schedule: Schedule, arena: Arena, interrupted: bool, chosen: Candidate | None
) -> RaceOutcome:
    seconds, chosen = arena.clock() - arena.began, chosen or arena.judge.incumbent
    assert chosen is not None
    noop = arena.judge.latest(NOOP)
    # copies: what is still compiled in a thread is noted in the arms' own
    logs = [replace(arm.log) for arm in schedule.arms]
    return RaceOutcome(
        policy=policy_of(chosen, arena.problem, arena.seed),
        chosen=chosen,
        judged=arena.judge.judged,
        arms=logs,
        probe=arena.probe,
        noop_return=arena.probe.noop_return if noop is None else noop.mean,
        random_return=schedule.random_return,
        compile_seconds=sum(log.compile_seconds for log in logs) + arena.compile_seconds,
        seconds=seconds,
        interrupted=interrupted,
    )
