"""The example that tells TensorBoard and Weights & Biases how planning gets on."""

import importlib.util

from helpers.problems import ROOT

from mdpo_rddl.session.watch import PlanProgress

SPEC = importlib.util.spec_from_file_location("callbacks", ROOT / "examples" / "callbacks.py")
callbacks = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(callbacks)

BEFORE, AFTER = PlanProgress("probing", 0.5, 0.1), PlanProgress("searching", 1.5, 0.3, -7.0)


class Writer:
    """As much of `SummaryWriter` and of a run as is used."""

    def __init__(self):
        self.told = []

    def add_scalar(self, name, value, step):
        self.told.append((name, value, step))

    def log(self, values):
        self.told.append(values)


def test_tensorboard_hears_of_the_best_return():
    writer = Writer()
    tell = callbacks.to_tensorboard(writer)
    # nothing that it returns cancels
    assert [tell(BEFORE), tell(AFTER)] == [None, None]
    assert writer.told == [("best return", -7.0, 1500)]


def test_wandb_hears_of_the_time_too():
    run = Writer()
    tell = callbacks.to_wandb(run)
    assert [tell(BEFORE), tell(AFTER)] == [None, None]
    assert run.told == [
        {"seconds": 0.5, "done": 0.1},
        {"seconds": 1.5, "done": 0.3, "best return": -7.0},
    ]
