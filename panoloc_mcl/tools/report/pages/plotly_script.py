"""The plotting library of the report's page; needs the extra ``report``."""

from __future__ import annotations

import importlib.util


def can_plot() -> bool:
    """Whether it is there."""
    return importlib.util.find_spec("plotly") is not None


def script() -> str:
    """Its JavaScript, to be put into the page: some 5 MB, so that the page needs no network."""
    from plotly.offline import get_plotlyjs

    text: str = get_plotlyjs()
    # Within a page, this would end the script.
    return text.replace("</script", "<\\/script")
