import subprocess
import sys

HEAVY = ("numba", "cv2", "numpy", "scipy", "pydantic", "rich", "yaml")


def loaded_after(code, heavy=HEAVY):
    """Which heavy packages a fresh interpreter has loaded after some code."""
    report = f"\nimport sys\nprint('LOADED', *[name for name in {heavy!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code + report], capture_output=True, text=True, check=True)
    return done.stdout.rsplit("LOADED", 1)[1].split()


def test_importing_the_package_loads_nothing():
    assert loaded_after("import panoloc_mcl") == []


def test_importing_every_public_name_compiles_nothing():
    code = "import panoloc_mcl\nfor name in panoloc_mcl.__all__: getattr(panoloc_mcl, name)\n"
    code += "from panoloc_mcl.robot.kernels import voting\nfrom panoloc_mcl.robot.kernels.filtering import particles\n"
    code += "assert not particles.predict.signatures and not voting.vote.signatures"
    if "NUMBA_DISABLE_JIT" not in __import__("os").environ:
        loaded_after(code)


def test_configurations_are_read_without_numbers_and_images():
    assert not {"numba", "cv2", "numpy"} & set(loaded_after("from panoloc_mcl import load_config"))


def test_help_loads_nothing_heavy():
    for words in (["--help"], ["run", "--help"], ["--version"]):
        code = "from panoloc_mcl.tools.cli.main import main\n"
        code += f"try:\n    main({words!r})\nexcept SystemExit as end:\n    assert end.code == 0"
        assert loaded_after(code) == []


def test_unknown_names_are_refused():
    import panoloc_mcl

    assert not hasattr(panoloc_mcl, "Localiser")
    assert set(panoloc_mcl.__all__) <= set(dir(panoloc_mcl))
