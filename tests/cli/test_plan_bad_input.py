"""Bad input to `mdpo-plan`: one line, and nothing is left behind."""

from pathlib import Path

import pytest
from helpers.files import changed, contents
from helpers.plan_command import CONFIG, DOMAIN, INSTANCE, TANKS, in_a_process, refuse, run

from mdpo_rddl.cli import plan as command

BAD_FILES = {
    "broken.rddl": changed(DOMAIN, "- Uniform", "- - ) Uniform"),
    "unfinished.rddl": changed(INSTANCE, "horizon = 7;", "horizon = 7"),
    "undefined.rddl": changed(DOMAIN, "+ fill(?t)", "+ fil(?t)"),
    "lakes.rddl": INSTANCE.replace("domain = tanks", "domain = lakes"),
    "endless.rddl": changed(INSTANCE, "    horizon = 7;\n", ""),
    "key.cfg": changed(CONFIG, "epochs=4", "epoch=4"),
    "quote.cfg": changed(CONFIG, "'rmsprop'", "'rmsprop"),
    "sigma.cfg": changed(CONFIG, "sigma=0.5", "sigma=-1"),
    "latin.cfg": CONFIG,
    "width.cfg": changed(
        CONFIG, "'JaxStraightLinePlan'", "'JaxDeepReactivePolicy'\nmethod_kwargs={'topology': 'a'}"
    ),
    "rate.cfg": changed(CONFIG, "'learning_rate'", "'learning_speed'"),
    "file": "x",
    "thesis/chapter.tex": "x",
}


@pytest.fixture
def bad_workplace(workplace: Path) -> Path:
    """The current folder, with a problem and all sorts of mistakes in it."""
    (workplace / "thesis").mkdir()
    for name, text in BAD_FILES.items():
        (workplace / name).write_text(text)
    (workplace / "latin.cfg").write_bytes(b"# \xe9\n" + CONFIG.encode())
    return workplace


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("no.rddl two.rddl", "no.rddl: cannot read the domain file: No such file or directory"),
        ("tanks.rddl no/no", "no/no: cannot read the instance file: No such file or directory"),
        ("thesis/ two.rddl", "thesis: cannot read the domain file: Is a directory"),
        ("broken.rddl two.rddl", "broken.rddl:9: syntax error at ')'"),
        (
            "tanks.rddl unfinished.rddl",
            "unfinished.rddl:12: syntax error at the keyword 'discount' (or at the end of line 11)",
        ),
        ("two.rddl tanks.rddl", "two.rddl: the domain file has no domain block but an instance"),
        ("undefined.rddl two.rddl", "undefined.rddl, two.rddl: Variable <fil> is not defined"),
        ("tanks.rddl endless.rddl", "endless.rddl: instance 'two' has no horizon"),
        (
            "tanks.rddl lakes.rddl",
            "lakes.rddl: instance 'two' is for domain 'lakes', but tanks.rddl defines 'tanks'",
        ),
        ("Resevoir 1", "'Resevoir' is neither a file nor a problem of rddlrepository"),
        (
            "Reservoir_ippc2023 99",
            "'99' is neither a file nor an instance of the rddlrepository problem "
            "'Reservoir_ippc2023', which has: 1 2 3 4 5",
        ),
        (f"{TANKS} --sigma 1", "--sigma needs --noise constant"),
        (f"{TANKS} --noise none --alpha 1", "--alpha needs --noise adaptive"),
        (
            f"{TANKS} --sigma-min 11",
            "--sigma-min 11 is above sigma_max, 10: set --sigma-max",
        ),
        (f"{TANKS} --config no.cfg", "no.cfg: cannot read the configuration: No such file or"),
        (f"{TANKS} --config latin.cfg", "latin.cfg: cannot read the configuration: not a UTF-8"),
        (f"{TANKS} --config key.cfg", "key.cfg: [Optimize] unknown key 'epoch', known are "),
        (f"{TANKS} --config quote.cfg", 'quote.cfg:6: [Planner] optimizer: "\'rmsprop" is not a'),
        (f"{TANKS} --config sigma.cfg", "sigma.cfg: [Noise] sigma must be at least 0, got -1"),
        (f"{TANKS} --config two.rddl", "two.rddl:1: no section header, such as [Planner], comes"),
        (f"{TANKS} --config rate.cfg", "two.rddl: JaxPlan cannot compile it: "),
        (f"{TANKS} --config width.cfg", "width.cfg: [Planner] method_kwargs: topology must be "),
        (f"{TANKS} --out file", "file: cannot write the run there: it is a file"),
        (f"{TANKS} --out file/run", "file/run: cannot write the run there: File exists"),
        (f"{TANKS} --out thesis", "thesis: not overwritten: it is not empty and holds no run"),
        (f"{TANKS} --out .", ".: cannot write the run there: name a folder inside it"),
        (f"{TANKS} --load no", "no: no such run folder"),
        (f"{TANKS} --load file", "file: no such run folder"),
        (f"{TANKS} --load thesis", "thesis/policy.safetensors: no such policy"),
        (f"{TANKS} --load no --iterations 3", "--iterations does not go with --load, which train"),
        (f"{TANKS} --load no --sigma-max 3", "--sigma-max does not go with --load, which trains"),
    ],
)
def test_bad_input_ends_with_one_line_and_leaves_nothing(
    arguments: str, said: str, bad_workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refuse(f"{arguments} --json", said, bad_workplace, capsys, start=True)


def test_what_jaxplan_cannot_compile_names_the_configuration_too(
    bad_workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    outcome = run(f"{TANKS} --config rate.cfg", capsys)
    assert "'learning_speed'" in outcome.err
    assert outcome.err.endswith(" (configured by rate.cfg)\n")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--iteration-count 3", "unrecognized arguments: --iteration-count 3"),
        ("--noise loud", "argument --noise: invalid choice: 'loud'"),
        ("--policy net", "argument --policy: invalid choice: 'net'"),
        ("--preset mine", "argument --preset: invalid choice: 'mine'"),
        ("--sigma -1", "argument --sigma: must be a number at least 0, got '-1'"),
        ("--sigma-min -0.1", "argument --sigma-min: must be a number at least 0, got '-0.1'"),
        ("--sigma-max inf", "argument --sigma-max: must be a number at least 0, got 'inf'"),
        ("--alpha 0", "argument --alpha: must be a number above 0, got '0'"),
        ("--alpha nan", "argument --alpha: must be a number above 0, got 'nan'"),
        ("--quantile 0", "argument --quantile: must be a number above 0 and at most 1, got '0'"),
        ("--quantile 1.1", "argument --quantile: must be a number above 0 and at most 1, got "),
        ("--weight 0", "argument --weight: must be a number above 0, got '0'"),
        ("--weight ten", "argument --weight: must be a number above 0, got 'ten'"),
        ("--seconds 0", "argument --seconds: must be a number above 0, got '0'"),
        ("--iterations 0", "argument --iterations: must be a positive integer, got '0'"),
        ("--iterations 1e3", "argument --iterations: must be a positive integer, got '1e3'"),
        ("--restarts 0", "argument --restarts: must be a positive integer, got '0'"),
        ("--batch -2", "argument --batch: must be a positive integer, got '-2'"),
        ("--horizon 0", "argument --horizon: must be a positive integer, got '0'"),
        ("--episodes \u00b2", "argument --episodes: must be a positive integer, got '\u00b2'"),
        ("--seed -1", "argument --seed: must be an integer from 0 to 2147483647, got '-1'"),
        ("--seed 2147483648", "argument --seed: must be an integer from 0 to 2147483647, got "),
        ("--out", "argument --out: expected one argument"),
        ("--preset paper --config my.cfg", "argument --config: not allowed with argument --preset"),
        ("--load run --config my.cfg", "argument --config: not allowed with argument --load"),
    ],
)
def test_a_bad_option_ends_with_one_line(
    options: str, said: str, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refuse(f"{TANKS} {options}", said, workplace, capsys, start=True)


def test_arguments_with_line_breaks_still_make_one_line(
    workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command.main(["tanks.rddl", "two.rddl", "--out", "two.rddl/a\nb"]) == 2
    with pytest.raises(SystemExit) as end:
        command.main(["tanks.rddl", "two.rddl", "--a\nb"])
    assert end.value.code == 2
    assert capsys.readouterr().err == (
        "mdpo-plan: error: two.rddl/a b: cannot write the run there: File exists\n"
        "mdpo-plan: error: unrecognized arguments: --a b (see mdpo-plan --help)\n"
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("no.rddl two.rddl", "no.rddl: cannot read the domain file: No such file or directory"),
        ("broken.rddl two.rddl", "broken.rddl:9: syntax error at ')'"),
        (f"{TANKS} --sgima 1", "unrecognized arguments: --sgima 1 (see mdpo-plan --help)"),
        (f"{TANKS} --config rate.cfg", "two.rddl: JaxPlan cannot compile it: "),
    ],
)
def test_bad_input_to_the_real_command(arguments: str, said: str, bad_workplace: Path) -> None:
    before = contents(bad_workplace)
    status, out, err = in_a_process(f"{arguments} --json", bad_workplace)
    assert (status, out) == (2, "")
    assert err.startswith(f"mdpo-plan: error: {said}")
    assert err.count("\n") == 1
    assert contents(bad_workplace) == before
