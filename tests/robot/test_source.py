from panoloc_mcl.robot import source
from panoloc_mcl.robot.source import OF_MAPS, source_digest


def test_every_part_exists():
    root = source._ROOT
    assert all((root / part).exists() for part in OF_MAPS)


def test_the_digest_goes_with_code_and_not_with_comments(tmp_path, monkeypatch):
    monkeypatch.setattr(source, "_ROOT", tmp_path)
    (tmp_path / "robot").mkdir()
    (tmp_path / "__init__.py").write_text('__version__ = "1"\n')

    def digest(text, *parts):
        (tmp_path / "robot" / "a.py").write_text(text)
        source_digest.cache_clear()
        return source_digest(*parts)

    one = digest("x = 1\n")
    assert digest("# said otherwise\nx = 1\n\n") == one
    assert digest("x = 2\n") != one
    # Of parts that are not asked for nothing counts.
    assert digest("x = 1\n", ("tools/",)) == digest("x = 2\n", ("tools/",))
    assert digest("x = 1\n", ("",), ("robot/",)) == digest("x = 2\n", ("",), ("robot/",))
    source_digest.cache_clear()


def test_the_version_counts(tmp_path, monkeypatch):
    monkeypatch.setattr(source, "_ROOT", tmp_path)

    def digest(text):
        (tmp_path / "__init__.py").write_text(text)
        source_digest.cache_clear()
        return source_digest(("robot/",))

    assert digest('__version__ = "1"\n') != digest('__version__ = "2"\n')
    source_digest.cache_clear()
