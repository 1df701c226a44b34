"""``panoloc schema``: what a configuration may hold, as a JSON schema, for editors that complete and check YAML."""

from __future__ import annotations

import argparse
import importlib
import json
from typing import TYPE_CHECKING, Any

from panoloc_mcl.tools.cli.command import Command

if TYPE_CHECKING:
    from pydantic import BaseModel

# By name, since the laboratory stands above the tools.
_MODELS = {
    "live": ("panoloc_mcl.tools.config.live", "LiveConfig"),
    "run": ("panoloc_mcl.tools.config", "RunConfig"),
    "compare": ("panoloc_mcl.laboratory.comparison.matrix", "Matrix"),
    "simulate": ("panoloc_mcl.laboratory.simulation.settings", "SimulationConfig"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """KIND, ``-o``."""
    parser.add_argument("kind", nargs="?", choices=tuple(_MODELS), default="run", help="the command that reads the file")
    parser.add_argument("-o", "--output", metavar="FILE", help="write it into a file instead of printing it")


def execute(args: argparse.Namespace) -> int:
    """Print the schema, or write it and print where."""
    from pathlib import Path

    from panoloc_mcl.robot.files import write_atomically

    text = schema_text(args.kind)
    if args.output is None:
        print(text, end="")
        return 0
    write_atomically(Path(args.output), text)
    print(args.output)
    return 0


def schema_text(kind: str) -> str:
    """The schema of a configuration of ``panoloc run``, ``live``, ``compare`` or ``simulate``."""
    from pydantic.json_schema import GenerateJsonSchema

    class Lenient(GenerateJsonSchema):
        """Says nothing of values that only code can check, such as a mask; ``panoloc check`` does."""

        def handle_invalid_for_json_schema(self, schema: Any, error_info: str) -> dict[str, Any]:
            return {}

    module, name = _MODELS[kind]
    model: type[BaseModel] = getattr(importlib.import_module(module), name)
    schema: dict[str, Any] = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **model.model_json_schema(schema_generator=Lenient),
    }
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


COMMAND = Command("schema", "print the JSON schema of a configuration, for editors", add_arguments, execute)
