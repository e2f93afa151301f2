"""A lake whose pump has no bound: its unit must be found."""

from pathlib import Path

from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.problem.load import Problem, load_problem

PLAIN = ["greedy"]
LAKE_DOMAIN = """
domain lake {
    pvariables {
        depth : { state-fluent, real, default = 500.0 };
        pump : { action-fluent, real, default = 0.0 };
    };
    cpfs { depth' = depth + pump + Normal(0.0, 25.0); };
    reward = -abs[depth - 800.0] - 0.001 * pow[pump, 2];
}
"""
LAKE_INSTANCE = """
non-fluents nf { domain = lake; }
instance one {
    domain = lake; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 8; discount = 1.0;
}
"""


def preset(seconds: float, **search: object):
    """The preset with small batches, and without the arms that compile programs of their own."""
    config = auto_preset("toy").with_values("Optimize", train_seconds=seconds)
    config = config.with_values("Search", **{"without": PLAIN, **search})
    return config.with_values("Planner", batch_size_train=2, batch_size_test=2, parallel_updates=2)


def write_lake(folder: Path) -> Problem:
    domain, instance = folder / "d.rddl", folder / "i.rddl"
    domain.write_text(LAKE_DOMAIN)
    instance.write_text(LAKE_INSTANCE)
    return load_problem(str(domain), str(instance))
