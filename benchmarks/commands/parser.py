"""The options of `python -m benchmarks`, parsed without importing JAX."""

from pathlib import Path
from typing import Any

from benchmarks.commands.noise_parser import add_noise_command
from benchmarks.commands.paper_parser import add_paper_commands
from benchmarks.commands.tasks_parser import add_task_commands
from benchmarks.common.names import SETTINGS
from benchmarks.configs.names import PLANS, SCALES
from benchmarks.optima.names import OPTIMA_INSTANCES
from benchmarks.presets.names import NOISES, PLANNERS, TRANSFER_PAIRS
from benchmarks.problems.names import DOMAINS, INSTANCES
from benchmarks.speed.names import AXES, SPEED_SETTINGS
from mdpo_rddl.cli.options import OneLineParser, number, positive_int, seed_int
from mdpo_rddl.planner.config.budgets import AUTO_SECONDS


def bench_parser() -> OneLineParser:
    """The parser of `python -m benchmarks`; `run` names the command."""
    parser = OneLineParser(prog="benchmarks", description="Measure what the project reports.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=OneLineParser)

    noise = commands.add_parser("noise-sweep", help="alpha and sigma_max of the paper preset")
    noise.add_argument("--alphas", nargs="+", type=number(above=0), default=[0.25, 0.5, 1, 2, 4])
    noise.add_argument("--sigma-maxes", nargs="+", type=number(at_least=0), default=[10])
    noise.set_defaults(run="noise-sweep", out=Path("results/noise_sweep"))

    paper = commands.add_parser("paper-preset", help="the paper preset, with and without noise")
    paper.add_argument("--noises", nargs="+", choices=list(NOISES), default=list(NOISES))
    paper.set_defaults(run="paper-preset", out=Path("results/paper_preset"))

    for command in (noise, paper):
        command.add_argument(
            "--settings", nargs="+", choices=list(SETTINGS), default=list(SETTINGS)
        )
        command.add_argument(
            "--decay",
            type=number(above=0, at_most=1),
            help="RMSProp's (default: 0.99 in the sweep, else the preset's)",
        )
        command.add_argument("--seeds", type=positive_int, default=5)
        command.add_argument("--iterations", type=positive_int, default=3000)
        command.add_argument("--episodes", type=positive_int, default=20)
    speed = commands.add_parser("speed", help="iterations a second, against JaxPlan's loop")
    profile = commands.add_parser("profile", help="where the time of an iteration goes")
    for command, seconds in ((speed, 3), (profile, 1)):
        command.add_argument(
            "--settings", nargs="+", choices=list(SETTINGS), default=SPEED_SETTINGS
        )
        command.add_argument("--turns", type=positive_int, default=5, help="of each side")
        command.add_argument(
            "--seconds", type=number(above=0), default=seconds, help="of each turn"
        )
    profile.set_defaults(run="profile", out=Path("results/profile"))
    speed.add_argument(
        "--command-turns",
        metavar="N",
        type=int,
        choices=range(100),
        default=3,
        help="of the whole command; 0: none",
    )
    speed.set_defaults(run="speed", out=Path("results/speed"))

    auto = commands.add_parser(
        "auto", help="the preset auto against experts and JaxPlan's defaults"
    )
    auto.add_argument(
        "--problems",
        nargs="+",
        metavar="NAME",
        default=list(SETTINGS),
        help="settings, or Problem:instance of rddlrepository (default: the six settings)",
    )
    auto.add_argument("--planners", nargs="+", choices=PLANNERS, default=["expert", "auto"])
    auto.add_argument("--seeds", type=positive_int, default=5)
    auto.add_argument("--seconds", type=number(above=0), default=AUTO_SECONDS)
    auto.add_argument("--episodes", type=positive_int, default=50)
    auto.set_defaults(run="auto", out=Path("results/auto"))
    transfer = commands.add_parser(
        "transfer", help="a policy of one instance on another one, untrained and as a start"
    )
    transfer.add_argument("--pairs", nargs="+", metavar="NAME:I:J", default=list(TRANSFER_PAIRS))
    transfer.add_argument("--seconds", type=number(above=0), default=60.0)
    transfer.add_argument("--seed", type=seed_int, default=0)
    transfer.set_defaults(run="transfer", out=Path("results/transfer"))

    others = [auto, transfer, *_add_trial_commands(commands), *add_task_commands(commands)]
    others += [*add_paper_commands(commands), add_noise_command(commands)]
    for command in (noise, paper, speed, profile, *others):
        command.add_argument("--out", metavar="DIR", type=Path, help="results folder")
    return parser


def _add_trial_commands(commands: Any) -> list[OneLineParser]:
    everything = commands.add_parser(
        "compatibility", help="every problem of rddlrepository, with JaxPlan and with ours"
    )
    everything.add_argument(
        "--problems", nargs="+", metavar="NAME", help="of rddlrepository (default: all)"
    )
    everything.add_argument(
        "--instance", default="first", help="its name (default: the first of each problem)"
    )
    everything.add_argument("--iterations", type=positive_int, default=3)
    everything.add_argument(
        "--max-horizon", type=positive_int, default=20, help="cuts a longer one (default: 20)"
    )
    everything.set_defaults(run="compatibility", out=Path("results/compatibility"), timeout=900)

    exactness = commands.add_parser(
        "exactness", help="the compiled exact model against the environment, on every problem"
    )
    exactness.add_argument("--problems", nargs="+", metavar="NAME", help="(default: all)")
    exactness.add_argument("--max-horizon", type=positive_int, default=40)
    exactness.set_defaults(run="exactness", out=Path("results/exactness"), timeout=600)

    simulated = commands.add_parser(
        "simulator", help="steps a second beside pyRDDLGym and the compiled model, on every problem"
    )
    simulated.add_argument("--problems", nargs="+", metavar="NAME", help="(default: all)")
    simulated.set_defaults(run="simulator", out=Path("results/simulator"), timeout=300)
    law = commands.add_parser(
        "simulator-law", help="the simulator against the environment, on every problem"
    )
    law.add_argument("--problems", nargs="+", metavar="NAME", help="(default: all)")
    law.set_defaults(run="simulator-law", out=Path("results/simulator_law"))

    legal = commands.add_parser(
        "legal-play", help="random policies on every problem: is what they play legal?"
    )
    legal.add_argument("--problems", nargs="+", metavar="NAME", help="(default: all)")
    legal.add_argument("--policies", type=positive_int, default=20, help="on each problem")
    legal.add_argument("--steps", type=positive_int, default=5, help="of each policy")
    legal.set_defaults(run="legal-play", out=Path("results/legal"), timeout=600)

    smoke = commands.add_parser("ipc-smoke", help="the eight IPC 2023 domains with ours")
    smoke.add_argument("--domains", nargs="+", choices=DOMAINS, default=list(DOMAINS))
    smoke.add_argument("--instances", nargs="+", metavar="NAME", default=list(INSTANCES))
    smoke.add_argument("--iterations", type=positive_int, default=50)
    smoke.add_argument("--episodes", type=positive_int, default=2)
    smoke.set_defaults(run="ipc-smoke", out=Path("results/ipc_smoke"), timeout=7200)

    configs = commands.add_parser(
        "configs", help="configurations for the eight IPC 2023 domains, against JaxPlan's own"
    )
    configs.add_argument("--domains", nargs="+", choices=list(SCALES), default=list(SCALES))
    configs.add_argument("--instances", nargs="+", metavar="NAME", default=["3"])
    configs.add_argument("--plans", nargs="+", choices=PLANS, default=PLANS)
    configs.add_argument(
        "--candidates",
        nargs="+",
        metavar="NAME",
        help="'chosen' is what the results so far speak for (default: all)",
    )
    configs.add_argument("--seconds", type=number(above=0), default=20)
    configs.add_argument("--episodes", type=positive_int, default=10)
    configs.add_argument(
        "--ship", metavar="FOLDER", type=Path, help="write the chosen configurations there"
    )
    configs.set_defaults(run="configs", out=Path("results/configs"), timeout=600)

    growth = commands.add_parser("growth", help="time and memory of an iteration against sizes")
    growth.add_argument("--axes", nargs="+", choices=list(AXES), default=list(AXES))
    growth.add_argument("--seconds", type=number(above=0), default=5)
    growth.set_defaults(run="growth", out=Path("results/growth"), timeout=900)

    optima = commands.add_parser(
        "optima", help="proven optima, where the reachable states can be enumerated"
    )
    optima.add_argument(
        "--problems", nargs="+", metavar="NAME", help="(default: all of IPPC 2011 and 2014's MDPs)"
    )
    optima.add_argument("--instances", nargs="+", metavar="NAME", default=list(OPTIMA_INSTANCES))
    optima.add_argument("--episodes", type=positive_int, default=30)
    optima.add_argument(
        "--published",
        metavar="FILE",
        type=Path,
        help="CSV of problem, instance and best: a column of the table, and only its tasks",
    )
    optima.set_defaults(run="optima", out=Path("results/optima"), timeout=60, memory_gb=4)

    limited = [everything, exactness, simulated, legal, smoke, configs, growth, optima]
    for command in limited:
        command.add_argument(
            "--timeout",
            metavar="SECONDS",
            type=number(above=0),
            default=command.get_default("timeout"),
            help="of each planner (default: %(default)s)",
        )
        command.add_argument(
            "--memory-gb",
            metavar="GB",
            type=number(above=0),
            default=command.get_default("memory_gb") or 8,
            help="of each process (default: %(default)s)",
        )
    return [*limited, law]
