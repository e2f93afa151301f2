"""Pictures that are there as a whole or not at all, and names on them."""

import io
from pathlib import Path

from matplotlib.figure import Figure

from mdpo_rddl.machine.files import write_atomically


def write_picture(figure: Figure, path: Path, dpi: int) -> None:
    """Writes a figure as a PNG file in one step.

    Raises:
      InputError: naming the file, if it cannot be written.
    """
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=dpi)
    write_atomically(path, content.getvalue())


def literal(name: str) -> str:
    """A name that matplotlib writes as it is: between two dollars it would read a formula."""
    return name.replace("$", r"\$")
