"""The command of `python -m benchmarks` that measures what noise is worth."""

import argparse

from benchmarks.noise_value.cost import run_costs
from benchmarks.noise_value.problems import with_instances
from benchmarks.noise_value.report import write_report
from benchmarks.noise_value.run import all_cells, run_noise_value
from mdpo_rddl.cli.executor_options import executor_from
from mdpo_rddl.machine.jax_setup import keep_compiled_programs, keep_no_programs, use_all_cores


def noise_value(options: argparse.Namespace) -> str:
    """Measures the cells, or the costs, that are missing; returns the report."""
    if options.report:
        return write_report(options.out)
    cells = all_cells(
        with_instances(options.problems),
        options.plans,
        options.configurations,
        out=options.out,
        seeds=options.seeds,
        iterations=options.iterations,
        max_horizon=options.max_horizon,
        rollouts=options.rollouts,
        most_seconds=options.most_seconds,
        sigma=options.sigma,
    )
    if options.cost:
        keep_no_programs()  # the time of compilation is one of the figures
        run_costs(cells)
    else:
        use_all_cores()
        keep_compiled_programs()
        run_noise_value(cells, executor_from(options, options.out), options.shard)
    return write_report(options.out)
