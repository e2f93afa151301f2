"""JaxPlan's tuner over MDPO: it trains MDPO, and the noise can be tuned like anything else."""

import csv
import sys
import warnings

import jax
import pyRDDLGym
import pyRDDLGym_jax.core
import pytest
from helpers.problems import tiny_files

from mdpo_rddl import (
    ConstantNoise,
    JaxOfflineController,
    JaxOnlineController,
    MDPOPlanner,
    load_config_from_string,
)

TEMPLATE = """
[Compiler]
method='DefaultJaxRDDLCompilerWithGrad'
print_warnings=False

[Planner]
method='JaxStraightLinePlan'
method_kwargs={}
optimizer='rmsprop'
optimizer_kwargs={'learning_rate': 0.05}
batch_size_train=2
pgpe=None

[Optimize]
epochs=4
train_seconds=1e300
print_summary=False
print_progress=False
"""
NOISE = """
[Noise]
method='ConstantNoise'
sigma=SIGMA_TUNE
"""


@pytest.fixture
def env(tmp_path):
    return pyRDDLGym.make(*tiny_files(tmp_path), vectorized=True)


@pytest.fixture
def tuning():
    for package in ("sklearn", "bayes_opt"):
        pytest.importorskip(package)
    from mdpo_rddl.planner import tuning

    return tuning


def make_tuner(tuning, env, template=TEMPLATE + NOISE, online=False, **arguments):
    hyperparams = [tuning.Hyperparameter("SIGMA_TUNE", 0.1, 4.0, float)]
    return tuning.MDPOParameterTuning(
        env, template, hyperparams, online, eval_trials=1, verbose=False, **arguments
    )


@pytest.mark.slow
def test_a_worker_trains_mdpo_with_the_noise_it_is_given(tuning, env, tmp_path):
    tuner = make_tuner(tuning, env, num_workers=1, gp_iters=2)
    best = tuner.tune(key=42, log_file=str(tmp_path / "log.csv"))
    with open(tmp_path / "log.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2
    sigmas = [float(row["SIGMA_TUNE"]) for row in rows]
    assert sigmas[0] != sigmas[1]
    key = jax.random.PRNGKey(42)
    for sigma, row in zip(sigmas, rows, strict=True):
        key, worker_key = jax.random.split(key)
        trial_key = jax.random.split(worker_key)[1]
        config = TEMPLATE + NOISE.replace("SIGMA_TUNE", str(sigma))
        planner_args, _, train_args = load_config_from_string(config)
        planner = MDPOPlanner(rddl=env.model, **planner_args)
        agent = JaxOfflineController(planner, key=trial_key, **train_args)
        expected = agent.evaluate(env, episodes=1, seed=int(trial_key[0]))["mean"]
        assert float(row["target"]) == expected
    best_sigma = max(rows, key=lambda row: float(row["target"]))["SIGMA_TUNE"]
    assert best == {"SIGMA_TUNE": float(best_sigma)}

    agent = tuner.build_best_controller()
    assert type(agent) is JaxOfflineController
    assert type(agent.planner) is MDPOPlanner
    assert agent.planner.noise == ConstantNoise(best["SIGMA_TUNE"], "absolute")


@pytest.mark.parametrize("online", [False, True])
def test_without_noise_the_objective_is_jaxplan_s(tuning, env, online):
    arguments = {
        "hyperparams_dict": {},
        "online": online,
        "domain": env.domain_text,
        "instance": env.instance_text,
        "eval_trials": 1,
        "rollouts_per_trial": 1,
        "viz": None,
        "verbose": False,
    }
    targets = {}
    for tuner in (tuning.JaxParameterTuning, tuning.MDPOParameterTuning):
        for noise in ("NoNoise", "ConstantNoise"):
            template = f"{TEMPLATE}\n[Noise]\nmethod={noise!r}\n"
            kwargs = {**arguments, "config_template": template}
            found = tuner.objective_function({}, jax.random.PRNGKey(3), 0, 0, kwargs, None, False)
            targets[tuner.__name__, noise] = found[1]
    theirs = targets["JaxParameterTuning", "NoNoise"]
    assert targets["MDPOParameterTuning", "NoNoise"] == theirs
    # JaxPlan reads the template, and goes on without the noise
    assert targets["JaxParameterTuning", "ConstantNoise"] == theirs
    assert targets["MDPOParameterTuning", "ConstantNoise"] != theirs


def test_the_best_online_controller_replans_with_mdpo(tuning, env):
    tuner = make_tuner(tuning, env, online=True)
    tuner.best_params = {"SIGMA_TUNE": 2.5}
    agent = tuner.build_best_controller()
    assert type(agent) is JaxOnlineController
    assert agent.planner.noise == ConstantNoise(2.5, "absolute")
    assert agent.train_kwargs["epochs"] == 4


def test_a_missing_package_is_told_with_its_cure(monkeypatch):
    monkeypatch.setitem(sys.modules, "bayes_opt", None)
    for name in ("pyRDDLGym_jax.core.tuning", "mdpo_rddl.planner.tuning"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.delattr(pyRDDLGym_jax.core, "tuning", raising=False)
    filters = list(warnings.filters)
    with pytest.raises(ImportError, match=r"^tuning needs .*: pip install mdpo-rddl\[tuning\]$"):
        import mdpo_rddl.planner.tuning  # noqa: F401
    assert warnings.filters == filters, "JaxPlan's module silences all warnings"
