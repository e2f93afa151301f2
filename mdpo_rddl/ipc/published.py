"""What the competition published: other machines, other versions, an hour to prepare."""

from mdpo_rddl.ipc.score import Scores
from mdpo_rddl.ipc.tables import table

SOURCE = "IPPC 2023, results/IPPC2023_results.pdf of the organisers' site (ataitler/IPPC2023)"

# normalised scores of instances 1 to 5; there, 1 is the better one of JaxPlan and the best entry
SCORES: dict[str, dict[str, tuple[float, ...]]] = {
    "JaxSLP": {
        "HVAC_ippc2023": (0.779, 1, 0.932, 0.974, 0.957),
        "MarsRover_ippc2023": (0, 0, 0, 0, 0),
        "MountainCar_ippc2023": (0.76, 1, 1, 1, 1),
        "UAV_ippc2023": (0.401, 0.529, 0.492, 0.454, 0.450),
        "PowerGen_ippc2023": (1, 0.871, 0.970, 0.832, 0.213),
        "Reservoir_ippc2023": (1, 1, 1, 0.970, 0.956),
        "RaceCar_ippc2023": (1, 1, 1, 1, 1),
        "RecSim_ippc2023": (1, 0.672, 0, 0, 0),
    },
    "JaxDRP": {
        "HVAC_ippc2023": (0.822, 0.904, 0.847, 0.972, 0.576),
        "MarsRover_ippc2023": (0, 1, 1, 1, 1),
        "MountainCar_ippc2023": (0.24, 1, 0, 0, 0),
        "UAV_ippc2023": (0.270, 0.272, 0.124, 0.233, 0.216),
        "PowerGen_ippc2023": (0.942, 1, 0.871, 0.892, 1),
        "Reservoir_ippc2023": (0.920, 0.923, 0.820, 1, 1),
        "RaceCar_ippc2023": (0, 0.443, 0.068, 0, 0),
        "RecSim_ippc2023": (0.929, 1, 0, 0, 0),
    },
    "DiSProD (the winner)": {
        "HVAC_ippc2023": (1, 0.974, 1, 1, 1),
        "MarsRover_ippc2023": (1, 0, 0.528, 0.189, 0.203),
        "MountainCar_ippc2023": (1, 1, 0.86, 1, 0),
        "UAV_ippc2023": (1, 1, 1, 1, 1),
        "PowerGen_ippc2023": (0.975, 0.636, 1, 1, 0.674),
        "Reservoir_ippc2023": (0.927, 0.99, 0.808, 0.932, 0.81),
        "RaceCar_ippc2023": (0, 0, 0, 0, 0),
        "RecSim_ippc2023": (0.153, 0.054, 1, 1, 1),
    },
}


def published_score(planner: str, domain: str, instance: str) -> float | None:
    """A published normalised score; None for what the competition did not have.

    Args:
      planner: a key of `SCORES`.
      domain: a problem's name in rddlrepository.
      instance: its name there.
    """
    scores = SCORES[planner].get(domain)
    is_known = scores is not None and instance in ("1", "2", "3", "4", "5")
    return scores[int(instance) - 1] if scores is not None and is_known else None


def published_table(scores: Scores) -> list[str]:
    """Markdown: per instance the first planner's score beside the published ones.

    Returns:
      No lines if the competition had none of the instances.
    """
    own, rows = scores.planners[0], []
    for problem, row in scores.cells.items():
        published = [published_score(name, problem.domain, problem.instance) for name in SCORES]
        if None in published:
            continue
        ours = row[own].normalised if own in row else None
        cells = ["–" if value is None else f"{value:.3f}" for value in (ours, *published)]
        rows.append([f"{problem.domain_label} {problem.label}", *cells])
    if not rows:
        return []
    text = (
        f"From {SOURCE}. They come from the competition's own runs: other machines, other "
        "versions, an hour to prepare, and other returns at 0 and 1. The first column is of this "
        "run and cannot be compared figure by figure."
    )
    return [text, "", *table(["instance", f"{own}, this run", *SCORES], rows)]
