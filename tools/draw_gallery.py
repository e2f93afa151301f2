"""Plans twelve problems, draws what the policies do, and writes docs/gallery.md.

    python tools/draw_gallery.py               # what is not there yet, then the page
    python tools/draw_gallery.py --page-only   # the page alone, from docs/images/gallery
    python tools/draw_gallery.py --check       # status 1 if the page is not what it would write

Pictures and figures of a problem are made again if its picture is deleted. Short runs: see SECONDS.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "images" / "gallery"
PAGE = ROOT / "docs" / "gallery.md"
FIGURES = FOLDER / "gallery.json"
SECONDS = 60
EPISODES = 20

# what to write after mdpo-plan, and what the problem is
PROBLEMS = {
    "hvac10": "Air and heat for ten zones of a building, whose occupants come and go.",
    "reservoir15": "Fifteen reservoirs under random rain, each to be kept between two levels.",
    "powergen7": "Seven power plants, switched and set to meet a demand that follows the weather.",
    "UAV_ippc2023 1": "Aircraft flown to their goals; some follow random controls.",
    "MountainCar_ippc2023 1": "A car too weak for the hill has to swing up to the goal.",
    "RaceCar_ippc2023 1": "A car driven around obstacles to a goal.",
    "Quadcopter_physics 0": "A quadcopter flown by the thrusts of its rotors.",
    "CartPole_Continuous_gym 0": "A pole balanced on a cart by a bounded force.",
    "Pendulum_gym 0": "A pendulum swung up and held by a bounded torque.",
    "Elevators_MDP_ippc2011 1": "Elevators for passengers who arrive at random. Bools only.",
    "SysAdmin_MDP_ippc2011 1": "Computers that fail with their neighbours, one reboot at a time.",
    "Wildfire_MDP_ippc2014 1": "A fire that spreads at random, put out or cut off cell by cell.",
}

HEAD = """# Gallery

One picture and one command for each of twelve problems. Each picture shows an episode on the exact
environment under the no-op policy, and the episode with the same seed under the policy that the
command found: the state fluent that differs most between the two (each line an object, or each row
of a map), and the return so far.

These are short runs: {seconds} s of planning each, seed 0, on two cores; the
mean returns are over {episodes} episodes. They are of 41d6d77; later versions
find better policies in the same time (UAV 1: -2,476), see [results](results.md).
`python tools/draw_gallery.py` makes this page.
"""
ENTRY = """
## {name}

{about}

```sh
mdpo-plan {name} --seconds {seconds}
```

Mean return {policy}, no-op {noop}.{proof}

![An episode of {name} under the no-op and under the policy](images/gallery/{slug}.png)
"""


def slug(name: str) -> str:
    """The name of a problem's picture."""
    return name.replace(" ", "-")


def shown(value: float) -> str:
    """A mean return as it is written: whole where it is large."""
    return f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.4g}"


def make(name: str) -> dict[str, Any]:
    """Plans a problem with the page's command and draws its picture; returns its figures."""
    # these take seconds to import, which the page alone does not need
    from trajectories import both, draw

    import mdpo_rddl as mdpo

    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        command = [sys.executable, "-m", "mdpo_rddl.cli.plan", *name.split(), "--quiet"]
        command += ["--seconds", str(SECONDS), "--episodes", str(EPISODES), "--out", str(run)]
        subprocess.run(command, check=True)
        summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
        policy = mdpo.load_policy(run)
    environment = mdpo.make_environment(policy.problem)
    noop = mdpo.evaluate(environment, lambda step, state: {}, EPISODES, seed=0)
    draw(FOLDER / f"{slug(name)}.png", name, both(policy))
    return {
        "policy": summary["mean_return"],
        "noop": noop.mean,
        "proven": "optimum" in summary,
    }


def page(figures: dict[str, Any]) -> str:
    """The page, of the problems that have figures."""
    text = HEAD.format(seconds=SECONDS, episodes=EPISODES)
    for name, about in PROBLEMS.items():
        if name not in figures:
            continue
        found = figures[name]
        text += ENTRY.format(
            name=name,
            about=about,
            seconds=SECONDS,
            policy=shown(found["policy"]),
            noop=shown(found["noop"]),
            proof=" The policy is a [proven optimum](optima.md)." if found["proven"] else "",
            slug=slug(name),
        )
    return text


def main() -> int:
    """Makes what is missing, and the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--page-only", action="store_true")
    parser.add_argument("--check", action="store_true")
    options = parser.parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    figures = json.loads(FIGURES.read_text()) if FIGURES.exists() else {}
    if not (options.page_only or options.check):
        for name in PROBLEMS:
            if name in figures and (FOLDER / f"{slug(name)}.png").exists():
                continue
            figures[name] = make(name)
            FIGURES.write_text(json.dumps(figures, indent=1) + "\n")
            print(name, figures[name])
    text = page(figures)
    if options.check:
        return int(PAGE.read_text(encoding="utf-8") != text)
    PAGE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
