"""Loading of the templates of the summary and the report."""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import jinja2


def template(name: str) -> jinja2.Template:
    """Load a template by its file name; HTML is escaped, Markdown table cells by the filter ``md``."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("panoloc_mcl.tools.report", "templates"),
        autoescape=jinja2.select_autoescape(enabled_extensions=("html.j2",), default=False),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["md"] = _markdown_cell
    return environment.get_template(name)


def source(name: str) -> str:
    """A file beside the templates, as it is."""
    return resources.files("panoloc_mcl.tools.report").joinpath("templates", name).read_text(encoding="utf-8")


def _markdown_cell(text: str) -> str:
    """Text that stays within its table cell and is shown as it is."""
    for special in ("\\", "|", "*", "_", "`", "<"):
        text = text.replace(special, "\\" + special)
    return " ".join(text.split())
