"""Python functions that a domain calls: read, played, refused."""

from pathlib import Path

import numpy as np
import pytest
from helpers.mistakes import one_line
from helpers.toys import problem_from

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.problem.functions import functions_of
from mdpo_rddl.problem.load import Problem, load_problem, make_environment
from mdpo_rddl.problem.source import ProblemSource
from mdpo_rddl.problem.underlying import underlying_mdp

TEXT = """\
domain cells {
    types { cell : object; };
    pvariables {
        charge(cell) : { state-fluent, real, default = 1.0 };
        seen(cell) : { observ-fluent, real };
        load(cell) : { action-fluent, real, default = 0.0 };
    };
    cpfs {
        charge'(?c) = $leak[](charge(?c)) + load(?c);
        seen(?c) = charge'(?c);
    };
    reward = $total[](charge(_));
    action-preconditions { forall_{?c : cell} [load(?c) >= 0.0 ^ load(?c) <= 1.0]; };
}
non-fluents nf { domain = cells; objects { cell : {c1, c2}; }; }
instance two { domain = cells; non-fluents = nf; horizon = 3; discount = 1.0; }
"""
CODE = """\
import jax.numpy as jnp
from beside import SHARE

def leak(charge):
    return SHARE * charge

def total(charges):
    return jnp.sum(charges)
"""


def write(folder: Path, code: str = CODE) -> tuple[str, Path]:
    (folder / "cells.rddl").write_text(TEXT)
    (folder / "beside.py").write_text("SHARE = 0.5\n")
    (folder / "cells.py").write_text(code)
    return str(folder / "cells.rddl"), folder / "cells.py"


@pytest.fixture
def problem(tmp_path: Path) -> Problem:
    domain, path = write(tmp_path)
    return load_problem(domain, functions=path)


def test_the_environment_calls_them(problem: Problem) -> None:
    env = make_environment(problem)
    env.reset(seed=0)
    assert env.step({})[1] == 2.0
    assert env.step({"load": np.array([1.0, 0.0])})[1] == 1.0
    assert env.step({})[1] == 1.5


def test_the_file_is_part_of_the_problem(tmp_path: Path, problem: Problem) -> None:
    domain, path = write(tmp_path, CODE + "# changed\n")
    assert load_problem(domain, functions=path).digest != problem.digest


def test_the_planner_compiles_them(problem: Problem) -> None:
    config = auto_preset("cells").without_section("Search")
    planner = build_planner(underlying_mdp(problem), config).planner
    assert set(planner.python_functions) >= {"leak", "total"}


def test_without_them_the_domain_is_refused(tmp_path: Path) -> None:
    domain, _ = write(tmp_path)
    assert one_line(lambda: load_problem(domain)) == (
        f"{domain}: calls the Python function $leak: give the file that has it, with "
        "--functions FILE.py or functions="
    )


def test_a_missing_one_is_named(tmp_path: Path) -> None:
    domain, path = write(tmp_path, "def leak(charge): return charge\n_own = print\n")
    assert one_line(lambda: load_problem(domain, functions=path)) == (
        f"{path}: it has no function total, which {domain} calls; it has: leak"
    )


@pytest.mark.parametrize(
    ("code", "said"),
    [
        (
            "x = 1\ny = 1 / 0\n",
            "cells.py:2: the file of functions cannot be run: ZeroDivision",
        ),
        ("def leak(:\n", "cells.py:1: the file of functions cannot be run: SyntaxError"),
        ("raise SystemExit(3)\n", "cells.py:1: the file of functions cannot be run: SystemExit"),
        ("import not_there\n", "cells.py:1: the file of functions cannot be run: ModuleNotFound"),
    ],
)
def test_a_file_that_cannot_be_run_is_refused(tmp_path: Path, code: str, said: str) -> None:
    domain, path = write(tmp_path, code)
    message = one_line(lambda: load_problem(domain, functions=path))
    assert message.startswith(f"{tmp_path}/{said}")


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "none.py"
    assert one_line(lambda: functions_of(path)) == (
        f"{path}: cannot read the file of functions: No such file or directory"
    )


def test_what_is_neither_a_file_nor_functions_is_refused() -> None:
    assert "got int" in one_line(lambda: functions_of(3))  # type: ignore[arg-type]
    assert "got dict" in one_line(lambda: functions_of({"leak": 3}))  # type: ignore[dict-item]


def test_one_that_fails_is_named(tmp_path: Path) -> None:
    code = CODE.replace("return SHARE * charge", "raise ValueError('flat')")
    domain, path = write(tmp_path, code)
    said = one_line(lambda: load_problem(domain, functions=path))
    assert said == f"{path}: the function leak fails: ValueError: flat"


def test_a_source_keeps_the_name_and_never_runs_a_file(problem: Problem, tmp_path: Path) -> None:
    source = ProblemSource.of(problem)
    assert source.functions == "cells.py"
    assert "calls Python functions of cells.py, which are not kept" in one_line(source.load)
    again = source.load(functions=tmp_path / "cells.py")
    assert again.digest == problem.digest


def test_functions_may_be_given_by_name() -> None:
    text = TEXT.replace("$leak[](charge(?c))", "charge(?c)").replace("$total[](charge(_))", "1.0")
    plain = problem_from(text)
    given = {"leak": lambda charge: 0.5 * charge, "total": np.sum}
    assert plain.functions is None
    own = functions_of(given)
    assert own is not None
    assert (own.path, own.digest) == (None, None)
    assert own.by_name["leak"](4.0) == 2.0
