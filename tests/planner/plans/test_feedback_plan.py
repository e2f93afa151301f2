"""The feedback policy as a plan: legal actions of every kind, and how a configuration names it."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import shipped, tiny_files

from mdpo_rddl.errors import InputError
from mdpo_rddl.noise import AdaptiveNoise, ConstantNoise
from mdpo_rddl.noise.sensitivity import step_sensitivity
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape
from mdpo_rddl.planner.training.training import train
from mdpo_rddl.planner.update.restarts import PerRestart
from mdpo_rddl.problem.load import load_problem

KEY = jax.random.PRNGKey(0)
DOMAIN = """
domain kinds {
    types { item : object; };
    pvariables {
        x(item) : { state-fluent, real, default = 0.0 };
        push(item) : { action-fluent, real, default = 0.0 };
        count(item) : { action-fluent, int, default = 1 };
        on(item) : { action-fluent, bool, default = false };
        off(item) : { action-fluent, bool, default = true };
    };
    cpfs { x'(?i) = x(?i) + push(?i) + count(?i) + on(?i) - off(?i); };
    reward = -(sum_{?i : item} [pow[x(?i), 2]]);
    action-preconditions {
        forall_{?i : item} [count(?i) >= 0]; forall_{?i : item} [count(?i) <= 4];
    };
}
"""
INSTANCE = """
non-fluents nf { domain = kinds; objects { item : {i1, i2, i3}; }; }
instance one {
    domain = kinds; non-fluents = nf; max-nondef-actions = LIMIT; horizon = 3; discount = 1.0;
}
"""

FROM_UPDATES = AdaptiveNoise(0.0, 0.1, analysis_samples=0, unit="absolute")


def make(folder, limit="pos-inf", noise=None, units=None, **arguments):
    domain, instance = folder / "d.rddl", folder / "i.rddl"
    domain.write_text(DOMAIN)
    instance.write_text(INSTANCE.replace("LIMIT", str(limit)))
    plan = FeedbackPlan(FeedbackShape(topology=[3], **arguments), units)
    problem = load_problem(str(domain), str(instance))
    sizes = {"batch_size_train": 1, "batch_size_test": 1}
    return MDPOPlanner(problem.model, plan, pgpe=None, noise=noise, **sizes)


def act(planner, params):
    return planner.get_action(KEY, params, 0, {"x": np.zeros(3)})


def pushed(planner, value):
    """The policy whose raw actions are all `value`."""
    params = planner.plan.initializer(KEY, {}, None)
    for own in params["own"].values():
        own["bias"] = jnp.full_like(own["bias"], value)
    return params


def test_the_initial_policy_does_nothing(tmp_path):
    planner = make(tmp_path)
    actions = act(planner, planner.plan.initializer(KEY, {}, None))
    np.testing.assert_array_equal(actions["push"], [0, 0, 0])
    np.testing.assert_array_equal(actions["count"], [1, 1, 1])
    np.testing.assert_array_equal(actions["on"], [False] * 3)
    np.testing.assert_array_equal(actions["off"], [True] * 3)


def test_every_kind_answers_in_its_unit(tmp_path):
    planner = make(tmp_path, units={"push": 100.0})
    actions = act(planner, pushed(planner, 0.5))
    np.testing.assert_allclose(actions["push"], [50.0] * 3)
    # the box is 4 wide and begins at 0; doing nothing is 1
    np.testing.assert_array_equal(actions["count"], [3, 3, 3])
    np.testing.assert_array_equal(actions["on"], [True] * 3)
    np.testing.assert_array_equal(actions["off"], [False] * 3)
    assert np.issubdtype(actions["count"].dtype, np.integer)


def test_actions_stay_in_their_box(tmp_path):
    planner = make(tmp_path)
    np.testing.assert_array_equal(act(planner, pushed(planner, 1e6))["count"], [4, 4, 4])
    np.testing.assert_array_equal(act(planner, pushed(planner, -1e6))["count"], [0, 0, 0])


def test_few_bools_at_a_time_where_the_instance_says_so(tmp_path):
    planner = make(tmp_path, limit=2)
    actions = act(planner, pushed(planner, 1.0))
    # the environment counts numbers too
    noop = {"push": 0.0, "count": 1, "on": False, "off": True}
    assert sum(np.count_nonzero(actions[name] != value) for name, value in noop.items()) == 2
    relaxed = planner.plan.train_policy(KEY, pushed(planner, 1.0), {}, 0, {"x": jnp.zeros(3)}, {})
    assert float(jnp.sum(relaxed["on"]) + jnp.sum(1.0 - relaxed["off"])) == pytest.approx(2.0)


def test_groups_and_the_limit_on_all_bools_hold_together():
    problem = load_problem("RecSim_ippc2023", "1")
    problem.model.max_allowed_actions = 4
    plan = FeedbackPlan(FeedbackShape(topology=None))
    planner = MDPOPlanner(problem.model, plan, pgpe=None, batch_size_train=1, batch_size_test=1)
    state = {
        name: np.zeros([len(problem.model.type_to_objects[t]) for t in params])
        for name, params in problem.model.variable_params.items()
        if name in problem.model.state_fluents
    }
    chosen = planner.get_action(KEY, pushed(planner, 0.5), 0, state)["recommend"]
    assert chosen.sum() == 4
    assert chosen.sum(axis=1).max() == 1


def test_noise_is_in_the_plans_units(tmp_path):
    problem = shipped("reservoir15", 2)
    plan = FeedbackPlan(FeedbackShape(topology=None))
    planner = MDPOPlanner(
        problem.model, plan, pgpe=None, batch_size_train=1, noise=ConstantNoise(0.1, "absolute")
    )
    width = np.median(problem.model.non_fluents["TOP_RES"])
    np.testing.assert_allclose(planner.action_specs["release"].unit, np.full(15, width))


def test_a_preprocessor_is_refused(tmp_path):
    problem = load_problem(*tiny_files(tmp_path))
    with pytest.raises(ValueError, match="preprocessor must be None"):
        FeedbackPlan().compile(
            MDPOPlanner(problem.model, FeedbackPlan(), pgpe=None).compiled, {}, 4, object()
        )


CONFIG = """
[Compiler]
[Planner]
method='FeedbackPlan'
method_kwargs={'topology': [4], 'units': {'push': 0.5}, 'state_scales': {'x': [0.5, 2.0]}}
optimizer='normalized_adam'
optimizer_kwargs={'learning_rate': 0.01}
batch_size_train=2
parallel_updates=2
pgpe=None
[Optimize]
key=1
"""


def test_a_configuration_names_the_plan_and_the_optimiser(tmp_path):
    config = PlannerConfig.from_text(CONFIG)
    planner = build_planner(load_problem(*tiny_files(tmp_path)), config).planner
    assert isinstance(planner.plan, FeedbackPlan)
    np.testing.assert_array_equal(planner.plan.units["push"], [0.5, 0.5])
    assert PlannerConfig.from_text(config.to_text()).sections == config.sections


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("'topology'", "'topologi'", "unknown key 'topologi'"),
        (
            "'topology': [4]",
            "'lifted': -1",
            "lifted: must be a whole number from 0 to 1024",
        ),
        ("normalized_adam", "abnormal_adam", "optax has no function 'abnormal_adam'"),
        ("[Optimize]", "[Search]\nuntil=2\n[Optimize]", "unexpected keyword argument 'until'"),
        ("[Optimize]", "[Search]\nwithout=['drp']\n[Optimize]", "'drp' is none of dynamic prog"),
        ("[Optimize]", "[Search]\nwithout=['slq']\n[Optimize]", "'slq' is none of dynamic prog"),
    ],
)
def test_mistakes_are_named(old, new, said):
    with pytest.raises(InputError, match=said.replace("[", r"\[")):
        PlannerConfig.from_text(CONFIG.replace(old, new))


def test_a_search_needs_the_feedback_plan():
    text = CONFIG.replace("FeedbackPlan", "JaxStraightLinePlan")
    lines = [line for line in text.splitlines() if not line.startswith("method_kwargs")]
    with pytest.raises(InputError, match="needs method='FeedbackPlan'"):
        PlannerConfig.from_text("\n".join([*lines, "[Search]", "without=[]"]))


@pytest.mark.long
def test_restarts_can_start_from_different_policies(tmp_path):
    config = PlannerConfig.from_text(CONFIG)
    planner = build_planner(load_problem(*tiny_files(tmp_path)), config).planner
    one, other = pushed(planner, 0.0), pushed(planner, 0.3)
    stacked = PerRestart(jax.tree.map(lambda *leaves: jnp.stack(leaves), one, other))
    planner.vary_restarts(learning_rate=[1e-9, 1e-9])
    callback = planner.optimize(
        key=KEY, epochs=2, guess=stacked, print_summary=False, print_progress=False
    )
    bias = callback["params"]["own"]["push"]["bias"]
    np.testing.assert_allclose(bias, [[0.0, 0.0], [0.3, 0.3]], atol=1e-6)


def logs_of(planner, epochs):
    generator = planner.optimize_generator(
        key=KEY, epochs=epochs, print_summary=False, print_progress=False, print_hyperparams=False
    )
    return [callback["train_log"] for callback in generator]


def test_the_last_update_stands_in_for_the_analysis(tmp_path):
    planner = make(tmp_path, noise=FROM_UPDATES, plan=True)
    logs = logs_of(planner, epochs=3)
    # nothing is known before the first update, and so nothing is perturbed
    np.testing.assert_array_equal(logs[0]["sensitivity"], np.zeros((1, 3)))
    np.testing.assert_array_equal(logs[0]["sigma"], np.zeros((1, 3)))
    for before, after in itertools.pairwise(logs):
        gradients = planner.plan.action_gradients(jax.tree.map(lambda g: g[0], before["grad"]))
        expected = step_sensitivity(gradients)
        np.testing.assert_allclose(after["sensitivity"][0], expected, rtol=1e-5)
    assert np.max(logs[-1]["sigma"]) > 0.09


def test_what_updates_sense_is_in_the_unit_of_the_noise(tmp_path):
    """As an analysis has it, in boxes of other widths than the plan's units."""
    sensed = {}
    for samples in (0, 1):
        noise = AdaptiveNoise(0.0, 1e-6, analysis_samples=samples, unit="range")
        planner = make(tmp_path, noise=noise, plan=True, units={"push": 0.25, "count": 20.0})
        logs = logs_of(planner, epochs=2)
        sensed[samples] = [log["sensitivity"][0] for log in logs]
    # an update senses for the next one what an analysis does for its own
    assert np.all(sensed[1][0][:2] > 0.0)
    np.testing.assert_allclose(sensed[0][1], sensed[1][0], rtol=1e-4)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"units": {"pull": 1.0}}, "units: there is no action fluent 'pull'"),
        ({"units": {"push": 0.0}}, "units: that of push must be above 0, got 0.0"),
        ({"state_scales": {"y": (0.0, 1.0)}}, "state_scales: there is no fluent 'y'"),
        ({"state_scales": {"x": (0.0, 0.0)}}, "state_scales: x must have a centre and a scale"),
        ({"state_scales": {"x": 5.0}}, "state_scales: x must have a centre and a scale"),
        ({"state_scales": {"x": ("a", 1.0)}}, "state_scales: x must have a centre and a scale"),
        ({"state_scales": [1.0]}, "state_scales: must be a dictionary"),
        ({"plan": "no"}, "plan: must be True or False, got 'no'"),
    ],
)
def test_what_names_no_fluent_or_is_no_size_is_told(tmp_path, arguments, said):
    with pytest.raises(ValueError, match=said):
        make(tmp_path, **arguments)


def test_a_plan_that_cannot_say_needs_rollouts(tmp_path):
    planner = make(tmp_path, noise=FROM_UPDATES, plan=False)
    with pytest.raises(InputError, match="by rollouts only"):
        train(Built(planner, Budget(2, 10.0)), KEY)


def test_a_plan_is_one_step_shorter_after_a_decision(tmp_path):
    plan = make(tmp_path, plan=True).plan
    params = plan.initializer(KEY, {}, None)
    params["plan"]["push"] = jnp.arange(9.0).reshape(3, 3)
    later = plan.guess_next_epoch(params)
    np.testing.assert_array_equal(later["plan"]["push"][:, 0], [3.0, 6.0, 6.0])
    assert later["shared"] is params["shared"]
