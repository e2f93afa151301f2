"""Colours and sizes that all pictures of the page share."""

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO

from matplotlib.figure import Figure

POLICY_COLOUR, NOOP_COLOUR, RANDOM_COLOUR = "#1f6f8b", "#6d7680", "#c8553d"
SERIES_COLOURS: Sequence[str] = (
    "#1f6f8b",
    "#c8553d",
    "#e0a030",
    "#5b7553",
    "#7d5a91",
    "#7fb7be",
    "#8c6d46",
    "#444444",
)


# the library's own, 6, takes several times as long for files a tenth smaller
_COMPRESSION = 2


@dataclass(frozen=True)
class Picture:
    """A picture for the page.

    Attributes:
      png: its file's content.
      text: what it shows, for whoever does not see it.
      is_wide: whether it is too wide for a phone's screen.
    """

    png: bytes
    text: str
    is_wide: bool = False


def rendered(figure: Figure, dpi: int = 130) -> bytes:
    """A figure as a PNG file's content."""
    content = BytesIO()
    figure.savefig(content, format="png", dpi=dpi, pil_kwargs={"compress_level": _COMPRESSION})
    return content.getvalue()
