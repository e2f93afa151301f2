"""What the commands of `mdpo-ipc` do."""

import argparse
import logging
import sys

from mdpo_rddl.cli.executor_options import executor_from, hardware
from mdpo_rddl.cli.ipc_display import LiveTable
from mdpo_rddl.cli.logs import show_log
from mdpo_rddl.cli.markdown import print_markdown
from mdpo_rddl.cli.results_lock import results_lock
from mdpo_rddl.errors import InputError
from mdpo_rddl.ipc.conditions import keep_conditions
from mdpo_rddl.ipc.problems import parse_problems
from mdpo_rddl.ipc.registry import check_planner
from mdpo_rddl.ipc.report import write_report
from mdpo_rddl.ipc.results import load_result
from mdpo_rddl.ipc.rules import Entry, Rules
from mdpo_rddl.ipc.run import run
from mdpo_rddl.ipc.trial import OK
from mdpo_rddl.machine.cores import usable_cores
from mdpo_rddl.machine.executors import Executor, LocalExecutor, SlurmExecutor
from mdpo_rddl.problem.repository import rddl_repository

_SUFFIX = "_ippc2023"


def _rules(options: argparse.Namespace, trials: int) -> Rules:
    return Rules(
        trials=trials,
        plan_seconds=options.plan_seconds,
        trial_seconds=options.trial_seconds,
        memory_gb=options.memory_gb,
        lenient=options.lenient,
        seed=options.seed,
    )


def _run(options: argparse.Namespace) -> int:
    for name in options.planners:
        check_planner(name)
    rules = _rules(options, options.trials)
    executor = executor_from(options, options.out)
    if isinstance(executor, SlurmExecutor):
        _check_jobs(rules, executor)
    with results_lock(options):
        _play(options, rules, executor)
        print_markdown(write_report(options.out))
    return 0


def _play(options: argparse.Namespace, rules: Rules, executor: Executor) -> None:
    keep_conditions(options.out, rules, hardware(options))
    names = dict.fromkeys(options.planners)
    entries = [Entry(problem, name) for problem in options.problems for name in names]
    shown = not options.quiet and sys.stderr.isatty()
    level = logging.WARNING if shown or options.quiet else logging.INFO
    _log_to_stderr(level)
    with LiveTable(options.out, entries, rules, shown):
        run(options.out, entries, rules, executor)


def _check_jobs(rules: Rules, jobs: SlurmExecutor) -> None:
    """Raises `InputError` if a planner could not use up what the rules give it."""
    if jobs.memory_gb <= rules.memory_gb:
        raise InputError(
            f"jobs of {jobs.memory_gb:g} GB cannot hold planners of {rules.memory_gb:g} GB: set "
            "--slurm-memory-gb or --memory-gb"
        )
    if 60 * jobs.minutes - jobs.signal_seconds <= rules.plan_seconds:
        raise InputError(
            f"jobs of {jobs.minutes} minutes cannot hold a preparation of {rules.plan_seconds:g} "
            "s: set --slurm-minutes or --plan-seconds"
        )


def _score(options: argparse.Namespace) -> int:
    print_markdown(write_report(options.folder))
    return 0


def _agent(options: argparse.Namespace) -> int:
    # rddlrepository's plain HVAC, for one, is another problem than the competition's
    is_short = options.domain + _SUFFIX in rddl_repository().list_problems()
    domain = options.domain + _SUFFIX if is_short else options.domain
    problems = parse_problems(f"{domain}:{options.instance}")
    if len(problems) != 1:
        raise InputError(f"{options.instance}: an agent plays one instance")
    (problem,) = problems
    check_planner(options.method)
    rules, entry = _rules(options, options.episodes), Entry(problem, options.method)
    with results_lock(options):
        keep_conditions(options.out, rules, {"executor": "local", "cores": usable_cores()})
        _log_to_stderr(logging.INFO)
        run(options.out, [entry], rules, LocalExecutor())
        result = load_result(options.out, entry, rules.trials)
    for trial in result.trials:
        end = "" if trial.status == OK else f" ({trial.status}: {trial.cause})"
        print(f"episode {trial.trial + 1} ended with return {trial.total}{end}")
    return int(len([trial for trial in result.trials if trial.status == OK]) < rules.trials)


def _log_to_stderr(level: int) -> None:
    show_log(level, "%(asctime)s %(message)s")
    logging.getLogger("jax").setLevel(logging.WARNING)


COMMANDS = {"run": _run, "score": _score, "agent": _agent}
"""Per name, what takes the parsed options and returns the exit status."""
