"""The rows of the progress bar."""

from mdpo_rddl.planner.training.training import Progress
from mdpo_rddl.session.progress_bar import ProgressBar


def progress(iteration: int) -> Progress:
    return Progress(iteration=iteration, fraction=0.5, test_return=1.0, best_return=2.0)


def test_training_has_a_row_of_its_own_whichever_iteration_is_reported_first():
    bar = ProgressBar(shown=False)
    bar.stage("compiling")
    bar.training(progress(49))
    bar.training(progress(99))
    compiling, training = bar._bar.tasks
    assert (compiling.description, training.description) == ("compiling", "training")
    assert compiling.finished
    assert training.fields["note"].startswith("iteration 100 ")
