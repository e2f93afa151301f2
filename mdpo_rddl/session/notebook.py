"""How planning gets on, shown in a notebook by what every notebook has."""

from collections.abc import Callable
from typing import Any

from rich.console import Console

from mdpo_rddl.session.watch import PlanProgress

OnProgress = Callable[[PlanProgress], object]


def is_notebook() -> bool:
    """Whether a notebook shows what is displayed."""
    return Console().is_jupyter


def displayed(on_progress: OnProgress | None) -> OnProgress:
    """A callback for `plan` that shows the progress under the cell, in one place.

    Args:
      on_progress: the caller's own callback, which is called too.
    """
    from IPython.display import HTML, display  # there is no notebook without it

    handles: list[Any] = []

    def tell(progress: PlanProgress) -> object:
        bar = f"<progress value='{progress.fraction:.3f}' style='width:20em'></progress>"
        shown = HTML(bar + progress._repr_html_())
        if handles:
            handles[0].update(shown)
        else:
            handles.append(display(shown, display_id=True))
        return None if on_progress is None else on_progress(progress)

    return tell
