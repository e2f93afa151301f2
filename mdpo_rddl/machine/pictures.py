"""Pictures that are there as a whole or not at all."""

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
