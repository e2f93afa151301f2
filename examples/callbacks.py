"""Planning's progress in TensorBoard or Weights & Biases.

from callbacks import to_tensorboard
from torch.utils.tensorboard import SummaryWriter  # or tensorboardX's

policy = mdpo_rddl.plan("HVAC_ippc2023", 4, on_progress=to_tensorboard(SummaryWriter("logs")))

run = wandb.init(project="hvac")
policy = mdpo_rddl.plan("HVAC_ippc2023", 4, on_progress=to_wandb(run))
"""

from collections.abc import Callable
from typing import Any

from mdpo_rddl.session.watch import PlanProgress


def to_tensorboard(writer: Any) -> Callable[[PlanProgress], None]:
    """What `plan` takes as `on_progress`.

    Args:
      writer: a `SummaryWriter`, whose steps are milliseconds here.
    """

    def tell(progress: PlanProgress) -> None:
        if progress.best_return is not None:
            milliseconds = round(1e3 * progress.seconds)
            writer.add_scalar("best return", progress.best_return, milliseconds)

    return tell


def to_wandb(run: Any) -> Callable[[PlanProgress], None]:
    """What `plan` takes as `on_progress`.

    Args:
      run: of `wandb.init`.
    """

    def tell(progress: PlanProgress) -> None:
        values = {"seconds": progress.seconds, "done": progress.fraction}
        if progress.best_return is not None:
            values["best return"] = progress.best_return
        run.log(values)

    return tell
