"""Mistakes in a configuration: each told in one line that says where it is."""

from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.config_texts import NOISE, TEXT
from helpers.files import changed
from helpers.mistakes import one_line

from mdpo_rddl import load_config
from mdpo_rddl.planner.config.config import PlannerConfig

WITH_PGPE = changed(TEXT, "pgpe=None\n", "")


def complaint(text: str) -> str:
    """What `from_text` says about a text after the name of its source."""
    message = one_line(lambda: PlannerConfig.from_text(text, "my.cfg"))
    assert message.startswith("my.cfg:")
    return message.removeprefix("my.cfg:")


def edited(old: str, new: str) -> str:
    return changed(TEXT + NOISE, old, new)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("key=1\n", "1: no section header, such as [Planner], comes before this line"),
        (edited("[Noise]\n", "[Noise\n"), "19: neither a section header nor key=value"),
        (edited("key=42\n", "key\n"), "14: neither a section header nor key=value"),
        (edited("alpha=0.5\n", "alpha=0.5\nalpha=1\n"), "23: [Noise] alpha: given twice"),
        (edited("[Noise]\n", "[Planner]\n"), "19: section [Planner] begins twice"),
        (edited("[Noise]\n", "[noise]\n"), " unknown section [noise], known are Compiler, "),
        (edited("[Optimize]\n", ""), " section [Optimize] is missing"),
        ("", " section [Compiler] is missing"),
        ("[Compiler]\n[Planner]\n", " section [Optimize] is missing"),
        (edited("'adam'", "'adam"), '8: [Planner] optimizer: "\'adam" is not a Python literal'),
        (edited("'adam'", "adam"), "8: [Planner] optimizer: 'adam' is not a Python literal"),
        (edited("sigma_max=3", "sigma_max="), "21: [Noise] sigma_max: '' is not a Python literal"),
        (edited("sigma_max=3", "sigma_max=nan"), "21: [Noise] sigma_max: 'nan' is not a Python"),
        (edited("sigma_max=3", "sigma_max=2*3"), "21: [Noise] sigma_max: '2*3' is not a Python"),
        (edited("key=42", "key=" + "-" * 9999 + "1"), "14: [Optimize] key: '---"),
    ],
)
def test_a_text_that_is_no_configuration(text: str, said: str) -> None:
    assert complaint(text).startswith(said)


@pytest.mark.parametrize(
    ("section", "line", "known"),
    [
        ("Compiler", "sigmoid_weight=20", "sigmoid_weight"),
        ("Planner", "pgpe=None", "batch_size_train"),
        ("Optimize", "key=42", "train_seconds"),
        ("Noise", "alpha=0.5", "quantile"),
    ],
)
def test_an_unknown_key_is_named_with_its_section(section: str, line: str, known: str) -> None:
    said = complaint(edited(line, f"{line}\nsgima=1"))
    start, _, names = said.partition("known are ")
    assert start == f" [{section}] unknown key 'sgima', "
    assert known in names.split(", ")
    assert "self" not in names.split(", ")


def test_an_unknown_key_among_the_plans_arguments() -> None:
    said = complaint(edited("'topology': [8]", "'topologie': [8]"))
    start, _, names = said.partition("known are ")
    assert start == " [Planner] method_kwargs: unknown key 'topologie', "
    assert {"topology", "activation", "initializer", "initializer_kwargs"} <= set(names.split(", "))


def test_keys_of_another_noise_are_unknown() -> None:
    said = complaint(edited("'AdaptiveNoise'", "'ConstantNoise'"))
    assert said == " [Noise] unknown key 'sigma_max', known are method, paired, sigma, unit"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("'DefaultJaxRDDL", "'NoJaxRDDL", "[Compiler] method: JaxPlan has no relaxing compiler "),
        ("'DefaultJaxRDDLCompilerWithGrad'", "1", "[Compiler] method: JaxPlan has no relaxing "),
        ("'DefaultJaxRDDLCompilerWithGrad'", "'JaxRDDLCompiler'", "[Compiler] method: JaxPlan has"),
        ("'JaxDeepReactivePolicy'", "'Deep'", "[Planner] method: JaxPlan has no plan 'Deep'"),
        ("'JaxDeepReactivePolicy'", "'JaxPlan'", "[Planner] method: JaxPlan has no plan 'JaxPlan'"),
        ("'JaxDeepReactivePolicy'", "'GaussianPGPE'", "[Planner] method: JaxPlan has no plan "),
        ("method='JaxDeepReactivePolicy'\n", "", "[Planner] method is missing"),
        ("'adam'", "'adma'", "[Planner] optimizer: optax has no function 'adma'"),
        ("'adam'", "3", "[Planner] optimizer: optax has no function 3"),
        ("'adam'", "['adam']", "[Planner] optimizer: optax has no function ['adam']"),
        ("'JaxDeepReactivePolicy'", "['x']", "[Planner] method: JaxPlan has no plan ['x']"),
        ("'JaxDeepReactivePolicy'", "{1: 2}", "[Planner] method: JaxPlan has no plan {1: 2}"),
        (
            "pgpe=None",
            "compiler='x'",
            "[Planner] unknown key 'compiler', known are action_bounds, ",
        ),
        ("epochs=300", "epochs=2147483648", "[Optimize] epochs: must be at most 2,147,483,647"),
        ("'relu'", "'rleu'", "[Planner] method_kwargs: activation: jax.nn or jax.numpy has no "),
        ("'normal'", "'nromal'", "[Planner] method_kwargs: initializer: jax.nn.initializers or "),
        ("pgpe=None", "pgpe='PGPE'", "[Planner] pgpe: JaxPlan has no pgpe 'PGPE'"),
        ("pgpe=None", "preprocessor='x'", "[Planner] preprocessor: JaxPlan has no preprocessor "),
        ("pgpe=None", "utility='maen'", "[Planner] utility: unknown name 'maen', known are mean, "),
        ("key=42", "stopping_rule='x'", "[Optimize] stopping_rule: JaxPlan has no stopping rule "),
        ("'AdaptiveNoise'", "'adaptive'", "[Noise] method: no noise rule 'adaptive'"),
        ("'AdaptiveNoise'", "'ActionNoise'", "[Noise] method: no noise rule 'ActionNoise'"),
        ("'AdaptiveNoise'", "'NoiseProfile'", "[Noise] method: no noise rule 'NoiseProfile'"),
        ("'AdaptiveNoise'", "None", "[Noise] method: no noise rule None"),
    ],
)
def test_an_unknown_name(old: str, new: str, said: str) -> None:
    assert complaint(edited(old, new)).startswith(f" {said}")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("sigma_max=3", "sigma_max=-1", "[Noise] sigma_max must be at least 0, got -1"),
        ("sigma_max=3", "sigma_min=4\nsigma_max=3", "[Noise] sigma_max must be at least 4, got 3"),
        (
            "sigma_max=3",
            "sigma_max=3\npaired=True",
            "[Noise] sigma_max: beside paired it needs unit='absolute' or unit='range'",
        ),
        ("sigma_max=3", "sigma_max=True", "[Noise] sigma_max must be a number, got True"),
        ("sigma_max=3", "sigma_max='3'", "[Noise] sigma_max must be a number, got '3'"),
        ("sigma_max=3", "sigma_max=[3]", "[Noise] sigma_max must be a number, got [3]"),
        ("sigma_max=3", "sigma_max=3j", "[Noise] sigma_max must be a number, got 3j"),
        ("sigma_max=3", "sigma_max=None", "[Noise] sigma_max must be a number, got None"),
        ("sigma_max=3", "sigma_max=1e999", "[Noise] sigma_max: must be finite, got inf"),
        ("sigma_max=3", f"sigma_max={10**400}", "[Noise] sigma_max: must be finite, got 1000"),
        ("alpha=0.5", "alpha=0", "[Noise] alpha must be above 0, got 0"),
        ("alpha=0.5", "quantile=0", "[Noise] quantile must be above 0, got 0"),
        ("alpha=0.5", "quantile=1.01", "[Noise] quantile must be at most 1, got 1.01"),
        ("alpha=0.5", "regularization=0.0", "[Noise] regularization must be above 0, got 0"),
        ("alpha=0.5", "analysis_samples=-1", "[Noise] analysis_samples must be at least 0, got -1"),
        ("alpha=0.5", "analysis_samples=1.5", "[Noise] analysis_samples must be an integer, got "),
        ("_weight=20", "_weight=0", "[Compiler] sigmoid_weight: must be a positive number, got 0"),
        ("_weight=20", "_weight='a'", "[Compiler] sigmoid_weight: must be a positive number, got "),
        ("_train=4", "_train=0", "[Planner] batch_size_train: must be a positive integer, got 0"),
        ("_train=4", "_train=True", "[Planner] batch_size_train: must be a positive integer, got "),
        ("_train=4", "_test=2.0", "[Planner] batch_size_test: must be a positive integer, got 2.0"),
        ("pgpe=None", "parallel_updates=-1", "[Planner] parallel_updates: must be a positive "),
        ("pgpe=None", "rollout_horizon=0", "[Planner] rollout_horizon: must be a positive "),
        ("pgpe=None", "clip_grad=0.0", "[Planner] clip_grad: must be a positive number, got 0.0"),
        ("pgpe=None", "pgpe_kwargs=[]", "[Planner] pgpe_kwargs: must be a dictionary, got []"),
        ("{'learning_rate': 0.01}", "1", "[Planner] optimizer_kwargs: must be a dictionary, got 1"),
        (
            "0.01}",
            "1e999}",
            "[Planner] optimizer_kwargs: must be finite, got {'learning_rate': inf",
        ),
        (
            "0.01}",
            "[(-1e999,)]}",
            "[Planner] optimizer_kwargs: must be finite, got {'learning_rate",
        ),
        ("key=42", "key=-1", "[Optimize] key: must be an integer from 0 to 2147483647, got -1"),
        ("key=42", "key=2147483648", "[Optimize] key: must be an integer from 0 to 2147483647"),
        ("key=42", "key='42'", "[Optimize] key: must be an integer from 0 to 2147483647, got '42'"),
        ("epochs=300", "epochs=0", "[Optimize] epochs: must be a positive integer, got 0"),
        ("epochs=300", "epochs=3e2", "[Optimize] epochs: must be a positive integer, got 300.0"),
        ("epochs=300", "epochs=None", "[Optimize] epochs: must be a positive integer, got None"),
        ("_seconds=60", "_seconds=-1", "[Optimize] train_seconds: must be a positive number, got"),
        (
            "epochs=300",
            "test_rolling_window=0",
            "[Optimize] test_rolling_window: must be a positiv",
        ),
    ],
)
def test_a_value_out_of_range(old: str, new: str, said: str) -> None:
    assert complaint(edited(old, new)).startswith(f" {said}")


def test_method_kwargs_that_are_no_dictionary() -> None:
    line = "{'topology': [8], 'activation': 'relu', 'initializer': 'normal'}"
    said = complaint(edited(line, "[8]"))
    assert said == " [Planner] method_kwargs: must be a dictionary, got [8]"


def test_what_jaxplan_alone_refuses_names_the_source() -> None:
    text = edited("key=42", "stopping_rule='NoImprovementStoppingRule'")
    config = PlannerConfig.from_text(text, "my.cfg")
    said = one_line(config.jaxplan_arguments)
    assert said.startswith("my.cfg: JaxPlan refuses it: ")
    assert "patience" in said


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda path: None, "No such file or directory"),
        (lambda path: path.mkdir(), "Is a directory"),
        (lambda path: path.write_bytes(b"[Planner]\nmethod='\xe9'\n"), "not a UTF-8 text file"),
    ],
    ids=["missing", "folder", "latin-1"],
)
def test_a_file_that_cannot_be_read(
    tmp_path: Path, make: Callable[[Path], object], reason: str
) -> None:
    path = tmp_path / "my.cfg"
    make(path)
    for read in (load_config, PlannerConfig.from_file):
        said = one_line(lambda read=read: read(path))
        assert said == f"{path}: cannot read the configuration: {reason}"


@pytest.mark.parametrize(
    ("text", "values", "message"),
    [
        (TEXT, "iterations_per_call=20\ntest_every=3", "test_every: must divide"),
        (TEXT, "iterations_per_call=0", "iterations_per_call: must be a positive integer"),
        (TEXT, "test_every=2.0", "test_every: must be a positive integer"),
        (WITH_PGPE, "iterations_per_call=2", "needs pgpe=None in [Planner]"),
    ],
)
def test_sizes_that_make_no_sense(text: str, values: str, message: str) -> None:
    said = complaint(f"{text}\n[MDPO]\n{values}\n")
    assert said.startswith(" [MDPO] ")
    assert message in said
