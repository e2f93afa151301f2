"""Bad input to `python -m benchmarks`."""

import pytest
from helpers.toy_experiments import OPTIONS

from benchmarks import main as bench


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "the following arguments are required: COMMAND"),
        (["sweep"], "invalid choice: 'sweep'"),
        (["paper-preset", "--settings", "powergen8"], "invalid choice: 'powergen8'"),
        (["paper-preset", "--seeds", "0"], "--seeds: must be a positive integer, got '0'"),
        (["paper-preset", "--alphas", "1"], "unrecognized arguments: --alphas 1"),
        (["noise-sweep", "--alphas", "0"], "--alphas: must be a number above 0, got '0'"),
        (["noise-sweep", "--sigma-maxes", "-1"], "--sigma-maxes: must be a number at least 0"),
    ],
)
def test_bench_refuses_bad_options_in_one_line(capsys, arguments, complaint):
    with pytest.raises(SystemExit) as ended:
        bench.main(arguments)
    assert ended.value.code == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    assert line.startswith("benchmarks")
    assert complaint in line


def test_bench_names_the_file_that_it_cannot_use(tmp_path, capsys):
    (tmp_path / "runs.csv").write_text("a,b\n")
    assert bench.main(["paper-preset", *OPTIONS, "--out", str(tmp_path)]) == 2
    path = tmp_path / "runs.csv"
    complaint = f"benchmarks: error: {path}: holds other results (columns a, b)\n"
    assert capsys.readouterr() == ("", complaint)
