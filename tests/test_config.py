"""Configuration files: JaxPlan's own read as JaxPlan reads them, mistakes told in one line."""

import inspect
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from mdpo_rddl import AdaptiveNoise, ConstantNoise, InputError, NoNoise, load_config
from mdpo_rddl.cli.options import configure, plan_parser
from mdpo_rddl.jaxplan.config import PlannerConfig, load_config_from_string
from mdpo_rddl.jaxplan.upstream import JaxBackpropPlanner, JaxDeepReactivePolicy, planner
from mdpo_rddl.planning import build_planner
from mdpo_rddl.presets import DEFAULT_PRESET, PRESETS
from mdpo_rddl.problem import load_problem

EXAMPLES = Path(inspect.getfile(JaxBackpropPlanner)).parents[1] / "examples" / "configs"
TEMPLATES = sorted(EXAMPLES.glob("tuning_*.cfg"))
CONFIGS = sorted(set(EXAMPLES.glob("*.cfg")) - set(TEMPLATES))

TEXT = """\
[Compiler]
method='DefaultJaxRDDLCompilerWithGrad'
sigmoid_weight=20

[Planner]
method='JaxDeepReactivePolicy'
method_kwargs={'topology': [8], 'activation': 'relu', 'initializer': 'normal'}
optimizer='adam'
optimizer_kwargs={'learning_rate': 0.01}
batch_size_train=4
pgpe=None

[Optimize]
key=42
epochs=300
train_seconds=60
policy_hyperparams=2.0
"""
NOISE = """
[Noise]
method='AdaptiveNoise'
sigma_max=3
alpha=0.5
"""


def assert_same(ours: Any, theirs: Any) -> None:
    """Equal where Python can tell, of the same type and contents where it cannot."""
    assert type(ours) is type(theirs)
    if isinstance(ours, dict):
        assert list(ours) == list(theirs)
        for key in ours:
            assert_same(ours[key], theirs[key])
    elif isinstance(ours, list | tuple):
        assert len(ours) == len(theirs)
        for pair in zip(ours, theirs, strict=True):
            assert_same(*pair)
    elif isinstance(ours, jax.Array | np.ndarray):
        np.testing.assert_array_equal(ours, theirs, strict=True)
    elif isinstance(ours, types.FunctionType):
        # each call of a factory makes another function around the arguments
        assert ours.__code__ is theirs.__code__
        ours_cells, theirs_cells = ours.__closure__ or (), theirs.__closure__ or ()
        for our_cell, their_cell in zip(ours_cells, theirs_cells, strict=True):
            assert_same(our_cell.cell_contents, their_cell.cell_contents)
    elif type(ours).__module__ == planner.__name__:
        assert_same(vars(ours), vars(theirs))
    else:
        assert ours == theirs


def test_there_are_example_configurations() -> None:
    assert len(CONFIGS) >= 24
    assert len(TEMPLATES) >= 3


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_jaxplans_own_configurations_give_what_jaxplan_reads(path: Path) -> None:
    planner_args, plan_args, train_args = load_config(path)
    assert planner_args.pop("noise") == AdaptiveNoise()
    assert_same((planner_args, plan_args, train_args), planner.load_config(str(path)))


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_a_noise_section_changes_nothing_for_jaxplan(path: Path, tmp_path: Path) -> None:
    with_noise = tmp_path / path.name
    with_noise.write_text(path.read_text() + "\n" + NOISE)
    assert_same(planner.load_config(str(with_noise)), planner.load_config(str(path)))

    planner_args, plan_args, train_args = load_config(str(with_noise))
    assert planner_args.pop("noise") == AdaptiveNoise(sigma_max=3, alpha=0.5)
    assert_same((planner_args, plan_args, train_args), planner.load_config(str(path)))


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.stem)
def test_the_first_placeholder_of_a_template_is_named_with_its_line(path: Path) -> None:
    lines = path.read_text().splitlines()
    line = next(number for number, text in enumerate(lines, 1) if "_TUNE" in text)
    key, _, value = lines[line - 1].partition("=")
    with pytest.raises(InputError) as caught:
        load_config(path)
    assert str(caught.value) == (
        f"{path}:{line}: [Compiler] {key}: {value!r} is not a Python literal (is a quote missing?)"
    )


@pytest.mark.parametrize(
    ("section", "noise"),
    [
        ("", AdaptiveNoise()),
        ("[Noise]\n", AdaptiveNoise()),
        ("[Noise]\nmethod='NoNoise'\n", NoNoise()),
        ("[Noise]\nmethod='ConstantNoise'\nsigma=2\n", ConstantNoise(sigma=2)),
        ("[Noise]\nsigma_min=1.5\nquantile=1\n", AdaptiveNoise(sigma_min=1.5, quantile=1)),
        (
            "[Noise]\nmethod='AdaptiveNoise'\nanalysis_samples=4\nregularization=1e-6\n",
            AdaptiveNoise(analysis_samples=4, regularization=1e-6),
        ),
    ],
)
def test_the_noise_that_a_section_describes(section: str, noise: object) -> None:
    assert load_config_from_string(TEXT + section)[0]["noise"] == noise


def test_a_string_gives_what_jaxplan_reads_from_it() -> None:
    planner_args, plan_args, train_args = load_config_from_string(TEXT + NOISE)
    del planner_args["noise"]
    expected = planner.load_config_from_string(TEXT)
    assert_same((planner_args, plan_args, train_args), expected)
    assert plan_args["topology"] == [8]
    assert plan_args["activation"] is jax.nn.relu


def test_a_byte_order_mark_is_no_part_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "x.cfg").write_text(TEXT, encoding="utf-8-sig")
    assert PlannerConfig.from_file(tmp_path / "x.cfg").section("Optimize")["key"] == 42


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_a_configuration_survives_the_way_through_text(path: Path) -> None:
    config = PlannerConfig.from_file(path).with_section("Noise", {"alpha": 0.1 + 0.2})
    text = config.to_text()
    again = PlannerConfig.from_text(text)
    assert again.sections == config.sections
    assert again.to_text() == text
    assert again.section("Noise") == {"alpha": 0.1 + 0.2}


def test_awkward_values_survive_the_way_through_text() -> None:
    awkward = {
        "policy_hyperparams": {"a = [b] # c": 1e-300, "d\ne": 2},
        "subs": {"s": ("\u03c3", "'\"", None, True)},
    }
    config = PlannerConfig.from_text(TEXT).with_values("Optimize", **awkward)
    assert PlannerConfig.from_text(config.to_text()).sections == config.sections


def test_text_without_noise_is_the_text_of_the_other_sections() -> None:
    config = PlannerConfig.from_text(TEXT + NOISE)
    assert config.to_text(for_jaxplan=True) == PlannerConfig.from_text(TEXT).to_text()


def test_changed_copies_leave_the_original_alone() -> None:
    config = PlannerConfig.from_text(TEXT, "a.cfg")
    changed = config.with_values("Optimize", epochs=7)
    assert changed.section("Optimize") == {**config.section("Optimize"), "epochs": 7}
    assert config.section("Optimize")["epochs"] == 300
    config.section("Optimize")["epochs"] = 8
    assert config.section("Optimize")["epochs"] == 300
    with pytest.raises(InputError, match=r"^a\.cfg: \[Optimize\] epochs: "):
        config.with_values("Optimize", epochs=0)


# mistakes


def complaint(text: str) -> str:
    """What `from_text` says about a text after the name of its source."""
    with pytest.raises(InputError) as caught:
        PlannerConfig.from_text(text, "my.cfg")
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert message.startswith("my.cfg:")
    return message.removeprefix("my.cfg:")


def changed(old: str, new: str, text: str = TEXT + NOISE) -> str:
    assert text.count(old) == 1
    return text.replace(old, new)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("key=1\n", "1: no section header, such as [Planner], comes before this line"),
        (changed("[Noise]\n", "[Noise\n"), "19: neither a section header nor key=value"),
        (changed("key=42\n", "key\n"), "14: neither a section header nor key=value"),
        (changed("alpha=0.5\n", "alpha=0.5\nalpha=1\n"), "23: [Noise] alpha: given twice"),
        (changed("[Noise]\n", "[Planner]\n"), "19: section [Planner] begins twice"),
        (changed("[Noise]\n", "[noise]\n"), " unknown section [noise], known are Compiler, "),
        (changed("[Optimize]\n", ""), " section [Optimize] is missing"),
        ("", " section [Compiler] is missing"),
        ("[Compiler]\n[Planner]\n", " section [Optimize] is missing"),
        (changed("'adam'", "'adam"), '8: [Planner] optimizer: "\'adam" is not a Python literal'),
        (changed("'adam'", "adam"), "8: [Planner] optimizer: 'adam' is not a Python literal"),
        (changed("sigma_max=3", "sigma_max="), "21: [Noise] sigma_max: '' is not a Python literal"),
        (changed("sigma_max=3", "sigma_max=nan"), "21: [Noise] sigma_max: 'nan' is not a Python"),
        (changed("sigma_max=3", "sigma_max=2*3"), "21: [Noise] sigma_max: '2*3' is not a Python"),
        (changed("key=42", "key=" + "-" * 9999 + "1"), "14: [Optimize] key: '---"),
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
    said = complaint(changed(line, f"{line}\nsgima=1"))
    start, _, names = said.partition("known are ")
    assert start == f" [{section}] unknown key 'sgima', "
    assert known in names.split(", ")
    assert "self" not in names.split(", ")


def test_an_unknown_key_among_the_plans_arguments() -> None:
    said = complaint(changed("'topology': [8]", "'topologie': [8]"))
    start, _, names = said.partition("known are ")
    assert start == " [Planner] method_kwargs: unknown key 'topologie', "
    assert {"topology", "activation", "initializer", "initializer_kwargs"} <= set(names.split(", "))


def test_keys_of_another_noise_are_unknown() -> None:
    said = complaint(changed("'AdaptiveNoise'", "'ConstantNoise'"))
    assert said == " [Noise] unknown key 'sigma_max', known are method, sigma"


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
    assert complaint(changed(old, new)).startswith(f" {said}")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("sigma_max=3", "sigma_max=-1", "[Noise] sigma_max must be at least 0, got -1"),
        ("sigma_max=3", "sigma_min=4\nsigma_max=3", "[Noise] sigma_max must be at least 4, got 3"),
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
        ("alpha=0.5", "analysis_samples=0", "[Noise] analysis_samples must be at least 1, got 0"),
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
    assert complaint(changed(old, new)).startswith(f" {said}")


def test_method_kwargs_that_are_no_dictionary() -> None:
    line = "{'topology': [8], 'activation': 'relu', 'initializer': 'normal'}"
    said = complaint(changed(line, "[8]"))
    assert said == " [Planner] method_kwargs: must be a dictionary, got [8]"


def test_none_where_jaxplan_takes_it() -> None:
    values = "batch_size_test=None\nrollout_horizon=None\nclip_grad=None\npgpe=None"
    text = changed("pgpe=None", values).replace("key=42", "key=None")
    planner_args, _, train_args = load_config_from_string(text)
    del planner_args["noise"]
    expected = planner.load_config_from_string(text)
    assert_same((planner_args, train_args), (expected[0], expected[2]))


def test_what_jaxplan_alone_refuses_names_the_source() -> None:
    text = changed("key=42", "stopping_rule='NoImprovementStoppingRule'")
    config = PlannerConfig.from_text(text, "my.cfg")
    with pytest.raises(InputError) as caught:
        config.jaxplan_arguments()
    assert str(caught.value).startswith("my.cfg: JaxPlan refuses it: ")
    assert "patience" in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


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
        with pytest.raises(InputError) as caught:
            read(path)
        assert str(caught.value) == f"{path}: cannot read the configuration: {reason}"


# the paper's preset


def test_the_paper_preset_holds_the_papers_values() -> None:
    """arXiv 2605.07520, section "Implementation Details"."""
    config = PRESETS["paper"]("some_domain")
    assert config.sections == {
        "Compiler": {
            "method": "DefaultJaxRDDLCompilerWithGrad",
            "argmax_weight": 100.0,
            "bernoulli_sigmoid_weight": 100.0,
            "binomial_softmax_weight": 100.0,
            "discrete_softmax_weight": 100.0,
            "floor_weight": 100.0,
            "geometric_floor_weight": 100.0,
            "poisson_comparison_weight": 100.0,
            "round_weight": 100.0,
            "sigmoid_weight": 100.0,
            "switch_weight": 100.0,
        },
        "Planner": {
            "method": "JaxDeepReactivePolicy",
            "method_kwargs": {"topology": [12, 12]},
            "optimizer": "rmsprop",
            # the decay is PyTorch's, in which the paper's code is written
            "optimizer_kwargs": {"learning_rate": 0.01, "decay": 0.99},
            "batch_size_train": 1,
            "batch_size_test": 20,
            "pgpe": None,
        },
        "Optimize": {
            "key": 0,
            "epochs": 3000,
            "train_seconds": 86400.0,
            "test_rolling_window": 5,
        },
        "Noise": {
            "method": "AdaptiveNoise",
            "sigma_min": 0.0,
            "sigma_max": 10.0,
            "alpha": 1.0,
            "quantile": 0.95,
        },
        "MDPO": {"stop_at_termination": True, "iterations_per_call": 50, "test_every": 10},
    }
    assert DEFAULT_PRESET == "paper"


@pytest.mark.parametrize("domain", ["hvac", "power_gen", "reservoir_control_cont"])
def test_a_domain_changes_only_the_presets_noise_within_the_papers_limits(domain: str) -> None:
    config, plain = PRESETS["paper"](domain), PRESETS["paper"]("some_domain")
    assert {**config.sections, "Noise": {}} == {**plain.sections, "Noise": {}}
    noise = config.noise()
    assert isinstance(noise, AdaptiveNoise)
    assert (noise.sigma_min, noise.quantile) == (0.0, 0.95)
    assert 9.0 <= noise.sigma_max <= 11.0


def test_the_preset_is_a_configuration_that_jaxplan_accepts() -> None:
    config = PRESETS["paper"]("hvac")
    assert PlannerConfig.from_text(config.to_text()).sections == config.sections
    planner_args, plan_args, _ = config.jaxplan_arguments()
    assert isinstance(planner_args["plan"], JaxDeepReactivePolicy)
    assert plan_args == {"topology": [12, 12]}


# the command's options


def configured(config: PlannerConfig, options: str) -> PlannerConfig:
    arguments = ["domain.rddl", "instance.rddl", *options.split()]
    return configure(config, plan_parser().parse_args(arguments))


ADAPTIVE = {
    "method": "AdaptiveNoise",
    "sigma_min": 0.0,
    "sigma_max": 10.0,
    "alpha": 1.0,
    "quantile": 0.95,
}
WEIGHTS = [
    "argmax_weight",
    "bernoulli_sigmoid_weight",
    "binomial_softmax_weight",
    "discrete_softmax_weight",
    "floor_weight",
    "geometric_floor_weight",
    "poisson_comparison_weight",
    "round_weight",
    "sigmoid_weight",
    "switch_weight",
]


@pytest.mark.parametrize(
    ("options", "section", "values"),
    [
        ("", "Noise", {}),
        ("--seed 3 --horizon 9 --episodes 2 --out x --json --quiet", "Noise", {}),
        ("--preset paper", "Noise", {}),
        ("--noise adaptive", "Noise", {}),
        ("--sigma-min 1.5", "Noise", {"sigma_min": 1.5}),
        ("--sigma-max 20", "Noise", {"sigma_max": 20.0}),
        ("--sigma-min 20 --sigma-max 30", "Noise", {"sigma_min": 20.0, "sigma_max": 30.0}),
        ("--alpha 0.25", "Noise", {"alpha": 0.25}),
        ("--quantile 1", "Noise", {"quantile": 1.0}),
        ("--policy drp", "Planner", {}),
        ("--policy slp", "Planner", {"method": "JaxStraightLinePlan", "method_kwargs": {}}),
        ("--weight 7", "Compiler", dict.fromkeys(WEIGHTS, 7.0)),
        ("--iterations 5", "Optimize", {"epochs": 5}),
        ("--seconds 2.5", "Optimize", {"train_seconds": 2.5}),
        ("--restarts 3", "Planner", {"parallel_updates": 3}),
        ("--batch 4", "Planner", {"batch_size_train": 4}),
    ],
)
def test_an_option_changes_what_it_says_and_nothing_else(
    options: str, section: str, values: dict[str, Any]
) -> None:
    preset = PRESETS["paper"]("some_domain")
    expected = {**preset.sections, section: {**preset.section(section), **values}}
    assert configured(preset, options).sections == expected


@pytest.mark.parametrize(
    ("options", "noise"),
    [
        ("--noise none", {"method": "NoNoise"}),
        ("--noise constant", {"method": "ConstantNoise"}),
        ("--noise constant --sigma 2", {"method": "ConstantNoise", "sigma": 2.0}),
    ],
)
def test_another_noise_replaces_the_section(options: str, noise: dict[str, Any]) -> None:
    preset = PRESETS["paper"]("some_domain")
    config = configured(preset, options)
    assert config.sections == {**preset.sections, "Noise": noise}


def test_all_options_at_once() -> None:
    options = (
        "--noise constant --sigma 0 --policy slp --weight 1 --iterations 2 --seconds 3"
        " --restarts 4 --batch 5"
    )
    preset = PRESETS["paper"]("some_domain")
    assert configured(preset, options).sections == {
        "Compiler": {**preset.section("Compiler"), **dict.fromkeys(WEIGHTS, 1.0)},
        "Planner": {
            **preset.section("Planner"),
            "method": "JaxStraightLinePlan",
            "method_kwargs": {},
            "parallel_updates": 4,
            "batch_size_train": 5,
        },
        "Optimize": {**preset.section("Optimize"), "epochs": 2, "train_seconds": 3.0},
        "Noise": {"method": "ConstantNoise", "sigma": 0.0},
        "MDPO": preset.section("MDPO"),
    }


def test_options_on_a_file_without_noise() -> None:
    config = PlannerConfig.from_text(TEXT)
    assert configured(config, "--alpha 2").noise() == AdaptiveNoise(alpha=2.0)
    assert configured(config, "--noise constant").noise() == ConstantNoise()
    assert configured(config, "").noise() == AdaptiveNoise()


def test_options_on_a_file_with_its_own_noise() -> None:
    config = PlannerConfig.from_text(TEXT + "[Noise]\nmethod='ConstantNoise'\nsigma=3\n")
    assert configured(config, "").noise() == ConstantNoise(sigma=3)
    assert configured(config, "--noise constant").noise() == ConstantNoise(sigma=3)
    assert configured(config, "--sigma 4").noise() == ConstantNoise(sigma=4.0)
    assert configured(config, "--noise adaptive").noise() == AdaptiveNoise()


def test_the_policy_that_a_file_has_keeps_its_arguments() -> None:
    config = PlannerConfig.from_text(TEXT)
    assert configured(config, "--policy drp").sections["Planner"] == config.sections["Planner"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--sigma 1", "--sigma needs --noise constant"),
        ("--noise none --sigma 1", "--sigma needs --noise constant"),
        ("--noise constant --sigma-min 1", "--sigma-min needs --noise adaptive"),
        ("--noise constant --sigma-max 1", "--sigma-max needs --noise adaptive"),
        ("--noise constant --alpha 1", "--alpha needs --noise adaptive"),
        ("--noise none --quantile 1", "--quantile needs --noise adaptive"),
        ("--sigma-min 11", "--sigma-min 11 is above sigma_max, 10: set --sigma-max"),
    ],
)
def test_an_option_that_does_not_go_with_the_noise(options: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        configured(PRESETS["paper"]("some_domain"), options)
    assert str(caught.value) == said


def test_the_keys_of_jaxplans_controllers_are_accepted_and_not_handed_to_optimize() -> None:
    text = TEXT.replace("[Optimize]", "[Optimize]\ntrain_on_reset=True\nwarm_start=False")
    _, _, train_args = load_config_from_string(text)
    assert (train_args["train_on_reset"], train_args["warm_start"]) == (True, False)
    problem = load_problem("Reservoir_ippc2023", "1", 3)
    _, optimize_args = build_planner(problem, PlannerConfig.from_text(text))
    assert optimize_args.keys() == train_args.keys() - {"train_on_reset", "warm_start"}


WITH_PGPE = TEXT.replace("pgpe=None\n", "")


def test_sizes_of_a_call() -> None:
    text = TEXT + "\n[MDPO]\niterations_per_call=20\ntest_every=5\n"
    arguments = PlannerConfig.from_text(text).mdpo_arguments()
    assert (arguments["iterations_per_call"], arguments["test_every"]) == (20, 5)


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
    with pytest.raises(InputError) as caught:
        PlannerConfig.from_text(f"{text}\n[MDPO]\n{values}\n", "my.cfg")
    assert str(caught.value).startswith("my.cfg: [MDPO] ")
    assert message in str(caught.value)
