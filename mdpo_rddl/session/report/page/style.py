"""Colours that all pictures of the page share, and what a picture is."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup, escape

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


@dataclass(frozen=True)
class Picture:
    """A picture for the page.

    Attributes:
      markup: its element, whose texts are escaped.
      text: what it shows, for whoever does not see it.
      is_wide: whether it is too wide for a phone's screen.
    """

    markup: Markup
    text: str
    is_wide: bool = False


def stored_picture(png: bytes, text: str, is_wide: bool = False) -> Picture:
    """The picture of a PNG file's content."""
    data = base64.b64encode(png).decode("ascii")
    markup = Markup(f'<img src="data:image/png;base64,{data}" alt="{escape(text)}">')
    return Picture(markup, text, is_wide)
