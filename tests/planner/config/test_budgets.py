"""Budgets that stand where nobody has named one."""

import inspect

from mdpo_rddl.planner.config.budgets import JAXPLAN_BATCH, JAXPLAN_EPOCHS, JAXPLAN_SECONDS
from mdpo_rddl.planner.upstream import JaxBackpropPlanner


def test_jaxplan_s_defaults_are_those_of_the_jaxplan_that_is_installed():
    arguments = inspect.signature(JaxBackpropPlanner.optimize_generator).parameters
    assert arguments["epochs"].default == JAXPLAN_EPOCHS
    assert arguments["train_seconds"].default == JAXPLAN_SECONDS
    arguments = inspect.signature(JaxBackpropPlanner.__init__).parameters
    assert arguments["batch_size_train"].default == JAXPLAN_BATCH
