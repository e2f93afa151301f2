"""`mdpo_rddl.plan`: from a problem to a policy, in a program or a notebook."""

import contextlib
import math
import os
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Union

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.jax_setup import kept_tables
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets import DEFAULT_PRESET
from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.problem.functions import FunctionsGiven
from mdpo_rddl.problem.load import Problem, load_problem
from mdpo_rddl.problem.of_environment import problem_of
from mdpo_rddl.session.configuration import config_of_file, load_preset
from mdpo_rddl.session.notebook import displayed, is_notebook
from mdpo_rddl.session.observed import warn_of, warn_of_exploits
from mdpo_rddl.session.progress_bar import ProgressBar
from mdpo_rddl.session.race import find_by_race, is_race
from mdpo_rddl.session.watch import PlanProgress, Watch

if TYPE_CHECKING:  # which imports JAX
    from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy

PlannedPolicy = Union[AnyPolicy, "LookaheadPolicy"]
"""What `plan` returns: the last one where the policy thinks at its decisions."""

_MOST_SEEDS = 2**31
# of JAX's variables
_TRUE = ("y", "yes", "t", "true", "on", "1")
# what is left of a time that loading has used up
_LEAST_SECONDS = 1e-3


@dataclass(frozen=True)
class PlanOptions:
    """Options of `plan` that are rarely needed.

    Attributes:
      preset: "auto" or "paper"; "auto" if neither it nor `config` is given.
      config: a `PlannerConfig`, a JaxPlan `.cfg` file, or "drp" or "slp", as
        `mdpo-plan --config` takes them.
      horizon: replaces the instance's.
      progress: whether to draw a bar; if None in a terminal and in a notebook only.
      cancel: ends planning once it is set; what was found so far is returned.
      start_from: a policy that the race of "auto" begins with: of the same problem or of another
        instance of its domain.
      decision_seconds: that the policy may think at each decision, where trials show that it pays;
        these are part of `seconds`. 0 returns the policy as it was found.
      functions: the Python file of the functions that the domain calls, which is run, or they
        themselves by name.

    Raises:
      InputError: if both a preset and a configuration are given, the configuration plans anew
        at every decision, or the time is below 0.
    """

    preset: str | None = None
    config: PlannerConfig | str | Path | None = None
    horizon: int | None = None
    progress: bool | None = None
    cancel: threading.Event | None = None
    start_from: AnyPolicy | None = None
    decision_seconds: float = 0.0
    functions: FunctionsGiven = None

    def __post_init__(self) -> None:
        if self.preset is not None and self.config is not None:
            raise InputError("preset and config do not go together")
        if str(self.config) == "replan":
            raise InputError(
                'config "replan" plans anew at every decision, where there is no policy to return: '
                "use JaxOnlineController or mdpo-plan --replan"
            )
        seconds = self.decision_seconds
        is_number = isinstance(seconds, (int, float)) and not isinstance(seconds, bool)
        if not is_number or not 0.0 <= seconds < math.inf:
            raise InputError(f"decision_seconds must be a number of at least 0, got {seconds!r}")
        if self.preset is not None and not isinstance(self.preset, str):
            raise InputError(f"preset must be a name, got {self.preset!r}")
        if self.config is not None and not isinstance(self.config, (str, Path, PlannerConfig)):
            raise InputError(
                f"config must be a file, a name or a PlannerConfig, got {self.config!r}"
            )
        if self.cancel is not None and not hasattr(self.cancel, "is_set"):
            raise InputError(f"cancel must be an event of threading's, got {self.cancel!r}")
        if self.start_from is not None and not hasattr(self.start_from, "to_saved"):
            raise InputError(f"start_from must be a policy, got {self.start_from!r}")


@dataclass(frozen=True)
class _Terms:
    """What is planned."""

    problem: Problem
    config: PlannerConfig
    seed: int
    episodes: int = 0
    traced_cache: Path | None = None
    start_from: AnyPolicy | None = None


def plan(
    domain: Any,
    instance: str | int | Path | None = None,
    *,
    seconds: float | None = None,
    seed: int | None = None,
    on_progress: Callable[[PlanProgress], object] | None = None,
    **options: Any,
) -> PlannedPolicy:
    """Finds a policy, as `mdpo-plan` does.

    It prints nothing but a bar in a terminal or a notebook, and leaves JAX's configuration as it
    was. A keyboard interrupt ends it like `cancel`.

    Args:
      domain: a problem's name in rddlrepository or a domain file; or, without an instance, the
        name of a shipped problem, a `Problem` or a pyRDDLGym environment.
      instance: the instance's name, number or file.
      seconds: the time for everything, loading and compilation included; the configuration's if
        None, which for "auto" is 90. A compilation under way is not interrupted; a race does not
        wait for it any longer, but Python does at its end.
      seed: of everything that is drawn; the configuration's if None, which is 0 unless it says
        otherwise.
      on_progress: called now and then, from whatever thread is at work. False from it ends
        planning as `cancel` does; what it raises ends planning and is raised.
      **options: see `PlanOptions`.

    Raises:
      InputError: for whatever is wrong with the arguments or in the files, in one line.
      TypeError: for an option that there is not.
      KeyboardInterrupt: if interrupted before there was any policy.
    """
    chosen = PlanOptions(**options)
    _check(seconds, seed)
    if on_progress is not None and not callable(on_progress):
        raise InputError(f"on_progress must be a function, got {on_progress!r}")
    # rich draws in a notebook only with a package that not all have
    in_notebook = chosen.progress is not False and is_notebook()
    if in_notebook:
        on_progress = displayed(on_progress)
    with _precision_kept(), ProgressBar(False if in_notebook else chosen.progress) as bar:
        watch = Watch(math.inf if seconds is None else seconds, bar, on_progress, chosen.cancel)
        problem = _problem(domain, instance, chosen)
        warn_of(problem)
        config = _config(chosen, domain, problem)
        if seconds is not None:
            left = max(seconds - watch.elapsed, _LEAST_SECONDS)
            config = config.with_values("Optimize", train_seconds=left)
        watch.seconds = whole = config.budget().seconds
        kept = 0.0
        if chosen.decision_seconds > 0.0:
            from mdpo_rddl.session.thinking import choice_seconds  # imports JAX

            kept = choice_seconds(problem, whole, chosen.decision_seconds)
            config = config.with_values("Optimize", train_seconds=whole - kept)
        key = config.key if seed is None else seed
        terms = _Terms(problem, config, key, start_from=chosen.start_from)
        began = watch.elapsed
        found, was_interrupted = _find(terms, watch, seconds is not None)
        policy: PlannedPolicy = found
        if watch.error is not None:
            raise watch.error
        if kept > 0.0 and not (watch.is_cancelled or was_interrupted):
            left = whole - (watch.elapsed - began)
            policy = _thinking(found, chosen.decision_seconds, kept, left)
        # compiled now, the first decision need not wait for it
        policy.reset()
        first = policy.sample_action()
        policy.reset()
        warn_of_exploits(problem, first, float(found.returns[-1]) if len(found.returns) else 0.0)
    return policy


def _thinking(policy: AnyPolicy, seconds: float, kept: float, left: float) -> PlannedPolicy:
    """The policy with so much time for a decision, if that pays.

    Args:
      policy: to be played.
      seconds: of a decision.
      kept: seconds to find out whether it pays.
      left: of all the time.
    """
    # import JAX
    from mdpo_rddl.policy.lookahead.choice import choose
    from mdpo_rddl.session.thinking import costing_nothing, with_leftover

    with costing_nothing():
        within = with_leftover(kept, left, seconds)
        return choose(policy, seconds, within).policy or policy
    return policy


def _find(terms: _Terms, watch: Watch, counts_compilation: bool) -> tuple[AnyPolicy, bool]:
    """The policy, and whether it was found until somebody interrupted that."""
    if not is_race(terms.config):
        from mdpo_rddl.session.training import find_by_training  # imports JAX

        policy, trained = find_by_training(terms, watch, counts_compilation)
        return policy, trained.status == "interrupted"
    found = find_by_race(terms, watch)
    return found.policy, found.interrupted


def _check(seconds: Any, seed: Any) -> None:
    if seconds is not None:
        is_number = isinstance(seconds, (int, float)) and not isinstance(seconds, bool)
        if not is_number or not 0 < seconds < math.inf:
            raise InputError(f"seconds must be a number above 0, got {seconds!r}")
    if seed is not None:
        is_whole = isinstance(seed, int) and not isinstance(seed, bool)
        if not is_whole or not 0 <= seed < _MOST_SEEDS:
            raise InputError(f"seed must be an integer from 0 to {_MOST_SEEDS - 1}, got {seed!r}")


def _problem(domain: Any, instance: Any, options: PlanOptions) -> Problem:
    horizon, functions = options.horizon, options.functions
    if isinstance(domain, (str, Path)):
        name = None if instance is None else str(instance)
        return load_problem(str(domain), name, horizon, kept_tables(), functions)
    if instance is not None:
        raise InputError(f"an instance does not go with a {type(domain).__name__}, which has one")
    if horizon is not None:
        raise InputError("horizon goes with names or files; load the problem with it instead")
    if functions is not None:
        raise InputError("functions go with names or files; load the problem with them instead")
    return domain if isinstance(domain, Problem) else problem_of(domain)


def _config(options: PlanOptions, domain: Any, problem: Problem) -> PlannerConfig:
    if isinstance(options.config, PlannerConfig):
        return options.config
    if options.config is not None:
        name = str(domain) if isinstance(domain, (str, Path)) else str(problem.domain_path)
        return config_of_file(options.config, name, problem.domain_name)[1]
    return load_preset(options.preset or DEFAULT_PRESET, problem.domain_name)


@contextlib.contextmanager
def _precision_kept() -> Iterator[None]:
    """Undoes JaxPlan's choice of JAX's precision, which it makes for the whole process."""
    if (jax := sys.modules.get("jax")) is not None:
        before = jax.config.values["jax_enable_x64"]
    else:  # as it will begin
        before = os.environ.get("JAX_ENABLE_X64", "").lower() in _TRUE
    try:
        yield
    finally:
        if (jax := sys.modules.get("jax")) is not None:
            jax.config.update("jax_enable_x64", before)
