import json
from pathlib import Path

import pytest
import yaml

from panoloc_mcl.tools.cli.checks.schema import schema_text

CONFIGS = Path(__file__).parents[3] / "configs"


@pytest.mark.parametrize("kind", ["run", "compare", "simulate", "live"])
def test_the_shipped_schema_is_the_printed_one(kind, panoloc):
    done = panoloc("schema", kind)
    assert done.code == 0
    shipped = CONFIGS / "schema" / f"{kind}.json"
    assert shipped.read_text(encoding="utf-8") == done.out, f"run: panoloc schema {kind} -o configs/schema/{kind}.json"


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_configurations_name_the_schema_that_knows_their_keys(path):
    first, *_ = path.read_text(encoding="utf-8").splitlines()
    kind = Path(first.rpartition("$schema=")[2]).stem
    assert first == f"# yaml-language-server: $schema=schema/{kind}.json"
    schema = json.loads(schema_text(kind))
    assert set(yaml.safe_load(path.read_text(encoding="utf-8"))) <= set(schema["properties"])
    assert schema["additionalProperties"] is False


def test_it_is_written_where_it_is_asked_for(panoloc):
    done = panoloc("schema", "-o", "run.json")
    assert json.loads(Path(done.lines[-1]).read_text())["title"] == "RunConfig"
