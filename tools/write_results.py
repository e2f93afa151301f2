"""Writes docs/results.md from the files under results/ and the text in tools/results_page.md.

    python tools/write_results.py            # writes the page
    python tools/write_results.py --check    # status 1 if it is not what would be written

results/sources.json says which command made a folder, and at which commit; where the rows
themselves name their commits, those are taken. Each row of the page's tables ends with both.
"""

import csv
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "results"
TEMPLATE = Path(__file__).with_name("results_page.md")
PAGE = ROOT / "docs" / "results.md"
SECTION = re.compile(r"<!-- section: (\w+) -->\n(.*?)<!-- end -->\n\n", re.DOTALL)
PLACE = re.compile(r"<!-- (?:table|value): ([\w-]+) -->")

Table = list[list[str]]


def sources() -> dict[str, dict[str, str]]:
    """Per folder of results what it holds, its command and its commit.

    Raises:
      KeyError: for a folder of which nobody says these.
    """
    told = json.loads((RESULTS / "sources.json").read_text(encoding="utf-8"))
    for folder in sorted(path for path in RESULTS.iterdir() if path.is_dir()):
        commits = recorded_commits(folder)
        if commits:
            kept = told.setdefault(
                folder.name, {"command": f"python -m benchmarks {folder.name}", "what": folder.name}
            )
            kept["commit"] = ", ".join(commits)
        elif folder.name not in told:
            raise KeyError(f"{folder}: neither its rows nor results/sources.json name a commit")
    return dict(sorted(told.items()))


def recorded_commits(folder: Path) -> list[str]:
    """The commits that the rows of a folder name."""
    path = folder / "rows.csv"
    rows = read_csv(path) if path.exists() else []
    return sorted({row["commit"] for row in rows if row.get("commit")})


def read_csv(path: Path) -> list[dict[str, str]]:
    """The rows of a file."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def rows_of(folder: str) -> Table:
    """The first table of a folder's table.md, header first."""
    lines = (RESULTS / folder / "table.md").read_text(encoding="utf-8").splitlines()
    table = []
    for line in lines:
        if line.startswith("|"):
            table.append([cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip()[1:-1])])
        elif table:
            break
    return [table[0], *table[2:]]


def with_source(table: Table, folder: str) -> Table:
    """The table with its command and commit in two more columns."""
    source = sources()[folder]
    header, *rows = table
    told = [f"`{source['command']}`", source["commit"]]
    return [[*header, "command", "commit"], *([*row, *told] for row in rows)]


def markdown(table: Table) -> str:
    """The table as Markdown."""
    header, *rows = table
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def index() -> str:
    """What there is under results/."""
    table = [["results", "folder", "command", "commit"]]
    for name, source in sources().items():
        where = f"[{name}](../results/{name}/{main_file(name)})"
        table.append([source["what"], where, f"`{source['command']}`", source["commit"]])
    return markdown(table)


def main_file(folder: str) -> str:
    """The file of a folder that a reader opens first."""
    names = (
        "table.md",
        "scores.md",
        "noise_sweep/table.md",
        "rows.csv",
        "plays.csv",
        "figures.json",
    )
    return next(name for name in names if (RESULTS / folder / name).exists())


def competition() -> str:
    """Scores by domain, from the report of the competition run."""
    found = json.loads((RESULTS / "ipc2023" / "scores.json").read_text(encoding="utf-8"))["strict"]
    overall, domains = found["overall"], found["domains"]
    names = [name.removesuffix("_ippc2023") for name in domains]
    table = [["planner", "score", *names, "best or level"]]
    for planner in overall:
        if planner in ("noop", "random"):
            continue
        cells = [f"{scores[planner]:.3f}" for scores in domains.values()]
        level = f"{found['best_or_level'][planner]} of {len(found['instances'])}"
        table.append([planner, f"{overall[planner]:.3f}", *cells, level])
    return markdown(with_source(table, "ipc2023"))


def linear_quadratic() -> str:
    """Mean returns of the race and of the optimal gains, a linear system and a form a row."""
    names = ["system", "form", "states", "inputs", "mean", "lqr", "difference", "error"]
    rows = read_csv(RESULTS / "linear_quadratic" / "rows.csv")
    table = [names, *([row[name] for name in names] for row in rows)]
    return markdown(with_source(table, "linear_quadratic"))


def rules() -> str:
    """Mean returns of the race, of a rule by hand and of the no-op, a problem a row."""
    names = ["problem", "policy", "rule", "noop", "lead", "lead_error"]
    rows = read_csv(RESULTS / "rules" / "rows.csv")
    table = [names, *([row[name] for name in names] for row in rows)]
    return markdown(with_source(table, "rules"))


def better_of_two() -> str:
    """The score of JaxPlan's better plan on each instance."""
    found = json.loads((RESULTS / "ipc2023" / "scores.json").read_text(encoding="utf-8"))
    return f"{found['strict']['jaxplan_better_of_two']:.3f}"


def auto_jaxplan() -> str:
    """Mean returns of the three planners, an instance a row."""
    rows = read_csv(RESULTS / "auto_jaxplan" / "runs.csv")
    returns = {(row["problem"], row["planner"]): float(row["mean_return"]) for row in rows}
    table = [["instance", "auto", "jaxplan-slp", "jaxplan-drp"]]
    for problem in dict.fromkeys(problem for problem, _ in returns):
        label = problem.replace("_ippc2023:", " ")
        cells = [f"{returns[problem, planner]:,.0f}" for planner in table[0][1:]]
        table.append([label, *cells])
    return markdown(with_source(table, "auto_jaxplan"))


def paper() -> str:
    """Ours and the paper's mean and deviation, a method in two rows, a setting a column."""
    cells = json.loads((RESULTS / "paper" / "table.json").read_text(encoding="utf-8"))["cells"]
    settings = list(dict.fromkeys(cell["setting"] for cell in cells))
    by_place = {(cell["method"], cell["setting"]): cell for cell in cells}
    table = [["method", *settings]]
    for method in dict.fromkeys(cell["method"] for cell in cells):
        row = [by_place[method, setting] for setting in settings]
        ours = [f"{cell['mean']:,.0f} ± {cell['std']:,.0f}" for cell in row]
        theirs = [f"*{cell['paper_mean']:,.0f} ± {cell['paper_std']:,.0f}*" for cell in row]
        table += [[method, *ours], [f"{method}, *the paper's*", *theirs]]
    return markdown(with_source(table, "paper"))


def plain(folder: str) -> Callable[[], str]:
    """A folder's own table."""
    return lambda: markdown(with_source(rows_of(folder), folder))


PIECES: dict[str, Callable[[], str]] = {
    "index": index,
    "published": plain("published"),
    "published_thinking": plain("published_thinking"),
    "ippc2014": plain("ippc2014"),
    "ippc2014_thinking": plain("ippc2014_thinking"),
    "anytime": plain("anytime"),
    "ablation": plain("ablation"),
    "ablation_settings": plain("ablation_settings"),
    "ipc2023": competition,
    "better-of-two": better_of_two,
    "linear_quadratic": linear_quadratic,
    "rules": rules,
    "auto": plain("auto"),
    "auto_jaxplan": auto_jaxplan,
    "paper": paper,
    "paper_preset": plain("paper_preset"),
    "noise_value": plain("noise_value"),
}


def page() -> str:
    """The page; a section about a folder that is not there is left out."""
    text = SECTION.sub(
        lambda found: found[2] + "\n" if (RESULTS / found[1]).is_dir() else "",
        TEMPLATE.read_text(encoding="utf-8"),
    )
    return PLACE.sub(lambda found: PIECES[found[1]](), text)


def main() -> int:
    """Writes the page, or compares it."""
    text = page()
    if "--check" in sys.argv[1:]:
        return int(not PAGE.exists() or PAGE.read_text(encoding="utf-8") != text)
    PAGE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
