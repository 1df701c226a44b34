import importlib.util
import sys
from pathlib import Path

import pytest

from panoloc_mcl.robot.files import CACHE_VARIABLE

SCRIPTS = Path(__file__).parents[2] / "scripts"
SHARED = Path(__file__).parents[3] / "shared" / "data"


@pytest.fixture(scope="session")
def load_script():
    """A script of the project as a module."""

    def load(name):
        spec = importlib.util.spec_from_file_location(name, SCRIPTS / f"{name}.py")
        module = importlib.util.module_from_spec(spec)
        # Where dataclasses look up the module that they are defined in.
        sys.modules[name] = module
        spec.loader.exec_module(module)
        return module

    before = set(sys.modules)
    yield load
    for name in [name for name in set(sys.modules) - before if (SCRIPTS / f"{name}.py").is_file()]:
        del sys.modules[name]


@pytest.fixture(scope="session")
def studies_cache(tmp_path_factory):
    return tmp_path_factory.mktemp("studies_cache")


@pytest.fixture
def own_cache(studies_cache, monkeypatch):
    """Maps of the tests are kept apart from the user's."""
    monkeypatch.setenv(CACHE_VARIABLE, str(studies_cache))


@pytest.fixture(scope="session")
def hall():
    """The larger data set, where it is at hand."""
    if not (SHARED / "hall").is_dir():
        pytest.skip("needs the data set hall beside the project")
    return SHARED / "hall"
